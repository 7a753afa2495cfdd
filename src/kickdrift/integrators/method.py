"""What all integrators have in common: what is known of them, and how an integration with one begins."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING, Any, ClassVar

from kickdrift.errors import InputError
from kickdrift.integrators.option import (
    ATOL,
    COMPENSATED,
    CONTROLLER,
    DOUBLE,
    DT,
    MAX_STEP,
    MIXED,
    PRECISION,
    RTOL,
    Option,
)
from kickdrift.integrators.options import Options

PRECISIONS = PRECISION.choices  # of pair forces
OWN_FORCES = "adds up forces of its own"  # what rules out mixed precision
SOLVES = "solves equations to the rounding of float64"

if TYPE_CHECKING:
    from kickdrift.integrators.batch_stepping import LaneStepper, Members
    from kickdrift.integrators.flow import Flow
    from kickdrift.integrators.stepper import Stepper
    from kickdrift.model.state import Floats
    from kickdrift.model.system import System


class Method:
    """A row of the registry.

    Attributes
    ----------
    name, family, order, source, use : what ``kickdrift list integrators`` shows, and where it was published
    evaluations : of the force per step; 0 where it depends on the run
    symplectic, reversible : whether the step keeps the symplectic form; whether a step with -dt undoes one with dt
    adaptive : whether it chooses its steps from the error
    chooses_steps : whether its steps differ in length, for whatever reason, so that a time may lie inside one
    needs_dt : whether it cannot begin without a dt
    carries : whether whatever follows from y' = f(t, y) may ride along as further particles, massless and under forces
        of their own, and the others not notice, but for the steps that an error estimate sets
    separable : whether it needs accelerations that depend on positions and time alone
    trial_steps : whether it may evaluate the force far from the solution
    bath : whether it exchanges heat with a bath
    drags : whether its bath changes the total momentum
    particles_only : whether it runs Systems alone, no Problems
    rescalable : whether velocities may be changed between two steps without telling it
    declared : the options of a Simulation, beside dt and precision, that it takes; see `Option`
    tunable : their names
    choices : the values that some of these may have, the default first (None: it depends)
    """

    name: str
    order: int
    source: str
    use: str
    family: ClassVar[str]

    @property
    def evaluations(self) -> int:
        return 0

    @property
    def symplectic(self) -> bool:
        return False

    @property
    def reversible(self) -> bool:
        return False

    @property
    def adaptive(self) -> bool:
        return False

    @property
    def separable(self) -> bool:
        return False

    @property
    def trial_steps(self) -> bool:
        return self.adaptive

    @property
    def particles_only(self) -> bool:
        return False

    @property
    def bath(self) -> bool:
        return False

    @property
    def drags(self) -> bool:
        return False

    @property
    def rescalable(self) -> bool:
        return False

    @property
    def float64_because(self) -> str:
        """Why its pair forces may not be in mixed precision; "" where they may."""
        return ""

    @property
    def butcher(self) -> tuple[Floats, Floats] | None:
        """The full tableau (s, s) and weights (s,) that give a one-step method's R(z) on y' = lambda y, where it has
        one."""
        return None

    @property
    def chooses_steps(self) -> bool:
        return self.adaptive

    @property
    def needs_dt(self) -> bool:
        return not self.adaptive

    @property
    def carries(self) -> bool:
        return not self.particles_only

    @property
    def declared(self) -> tuple[Option, ...]:
        return (RTOL, ATOL, CONTROLLER, MAX_STEP) if self.adaptive else (COMPENSATED,)

    @property
    def options(self) -> tuple[Option, ...]:
        """All that it takes: dt, what it declares, and what precision its forces may have."""
        precision = replace(PRECISION, choices=(DOUBLE,)) if self.float64_because else PRECISION
        return (DT, *self.declared, precision)

    @property
    def tunable(self) -> tuple[str, ...]:
        return tuple(each.name for each in self.declared)

    @property
    def choices(self) -> dict[str, tuple[Any, ...]]:
        return {
            each.name: (each.default, *(choice for choice in each.choices if choice != each.default))
            for each in self.declared
            if each.choices
        }

    def stepper(self, flow: Flow, options: Options) -> Stepper:
        """An integration of the flow with this method."""
        raise NotImplementedError

    @property
    def batched(self) -> bool:
        """Whether many small systems may advance with it at once (see ``kickdrift.batch``)."""
        return False

    def check(self, system: System) -> None:
        """Refuse a System that this method cannot move."""

    def in_lanes(self, members: Members, options: Options) -> LaneStepper:
        """An integration of many small systems at once; of those methods that are ``batched``."""
        raise NotImplementedError

    def checked(self, given: Options, asked: Options) -> Options:
        """The options that this method takes of those given in arguments and file; those ``asked`` for in arguments
        that it does not take are an InputError, and so are values that make no sense."""
        for key, value in asked.items():
            if key not in ("dt", PRECISION.name, *self.tunable) and value is not None and value is not False:
                takes = ", ".join(("dt", *self.tunable))
                raise InputError(f"{key}: {self.name} does not take it; it takes {takes}")
        kept = {each.name: each.filled(given.get(each.name)) for each in self.declared}
        dt = asked.dt if self.adaptive else given.dt  # a file's dt is no first step for a method that chooses its own
        precision = PRECISION.filled(given.precision)
        if precision == MIXED and self.float64_because:
            raise InputError(f"precision: {self.name} {self.float64_because}, and takes {DOUBLE} alone")
        options = Options(dt=checked_dt(dt), precision=precision, **kept)
        if self.adaptive:
            from kickdrift.integrators.step_control import check_tolerances

            check_tolerances(*options.tolerances)
        return options


def checked_dt(dt: Any) -> float | None:
    """A step, if one is given; an InputError where it is no positive finite time."""
    return None if dt is None else DT.checked(dt)

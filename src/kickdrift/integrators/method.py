"""Base of all integrators: their properties, and the start of an integration."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING, Any, ClassVar

from kickdrift.errors import InputError
from kickdrift.integrators.options import (
    ATOL,
    COMPENSATED,
    CONTROLLER,
    DOUBLE,
    DT,
    MAX_STEP,
    MIXED,
    OF_PRESSURE,
    PRECISION,
    RTOL,
    TEMPERATURE,
    Option,
    Options,
)

PRECISIONS = PRECISION.choices  # precisions of pair forces
KEEPING = "velocity-verlet, baoab and csvr"  # keep constraints
FIXING = "velocity-verlet, baoab and rk4"  # leave fixed particles in place
OWN_FORCES = "adds up forces of its own"  # reason against mixed precision
WITH_BATH = "baoab, csvr and nose-hoover"  # the recommended ones
SOLVES = "solves equations to the rounding of float64"

if TYPE_CHECKING:
    from kickdrift.integrators.flows.flow import Flow
    from kickdrift.integrators.stepping.batch_loops import LaneStepper, Members
    from kickdrift.integrators.stepping.stepper import Stepper
    from kickdrift.model.state import Floats
    from kickdrift.model.system import System


class Method:
    """A row of the registry.

    Attributes
    ----------
    name, family, order, source, use : text for ``kickdrift list integrators``, and the publication
    evaluations : force evaluations per step; 0 if the number depends on the run
    symplectic, reversible : whether the step keeps the symplectic form; whether a step with -dt undoes one with dt
    adaptive : whether the error sets the steps
    chooses_steps : whether steps differ in length, for any reason, so that a time may lie inside a step
    needs_dt : whether a dt is required
    carries : whether deviations can be integrated as additional massless particles with their own forces, without
        effect on the others, except for steps set by an error estimate
    separable : whether accelerations must depend on positions and time alone
    reflects : whether the method bounces particles off hard walls
    bounces : whether the method finds and acts on collisions itself, so that no step is searched for events
    trial_steps : whether the method may evaluate the force far from the solution
    bath : whether the method exchanges heat with a bath
    drags : whether the bath changes the total momentum
    overdamped : whether velocities are drawn by the bath alone, and are not those of the motion
    slow_velocities : whether velocities are too slow by an error of the step that configurations do not have
    particles_only : whether the method runs Systems only, no Problems
    rescalable : whether velocities may change between two steps without a restart
    moves_all_because : why the method moves every particle, so that none can be fixed; "" if some can
    float64_because : why pair forces cannot be in mixed precision; "" if they can
    carries_unknowns : whether the method advances unknowns beside the bodies by themselves: see `kickdrift.Beside`
    stops_in_lanes : whether a batch with this method watches events
    moves : what a method for particles alone moves, as text
    declared : options of a Simulation that the method takes, besides dt and precision; see `Option`
    tunable : names of these options
    choices : allowed values of some options, the default first (None: it depends)
    """

    name: str
    order: int
    source: str
    use: str
    family: ClassVar[str]
    separable = overdamped = stops_in_lanes = reflects = bounces = carries_unknowns = False
    float64_because = moves_all_because = ""
    moves: ClassVar[str] = "particles under gravity"

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
    def slow_velocities(self) -> bool:
        return False

    @property
    def kinetic_bias(self) -> bool:
        """Whether kinetic energies at whole steps are those of velocity Verlet, see `run.report.molecules`."""
        return False

    @property
    def rescalable(self) -> bool:
        return False

    @property
    def free_because(self) -> str:
        """Reason why the method moves free particles alone, and keeps no constraints; "" if it keeps them."""
        return "moves each particle freely"

    def check_constraints(self, system: Any) -> None:
        """Refuse constraints, virtual sites and fixed particles of a System that the method does not keep."""
        if (tie := getattr(system, "tied_by", "")) and self.free_because:
            raise InputError(f"{self.name}: keeps no {tie}, because it {self.free_because}; {KEEPING} do")
        fixed = getattr(system, "fixed", None)
        why = self.moves_all_because
        if fixed is not None and fixed.move and self.overdamped:
            why = "has no velocities that could be given"
        if fixed is not None and why:
            raise InputError(f"{self.name}: moves fixed particles too, because it {why}; {FIXING} leave them in place")

    @property
    def butcher(self) -> tuple[Floats, Floats] | None:
        """Full tableau (s, s) and weights (s,) that give a one-step method's R(z) on y' = lambda y; None without a
        tableau."""
        return None

    @property
    def chooses_steps(self) -> bool:
        return self.adaptive

    def parted(self, options: Options, dt: float) -> Options:
        """The options of a stepper whose steps have this length."""
        return options.changed(dt=dt)

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
        """All options of the method: dt, the declared ones, and the precision of its forces."""
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
        """Start an integration of the flow with this method."""
        raise NotImplementedError

    @property
    def batched(self) -> bool:
        """Whether a batch can use this method (see ``kickdrift.batch``)."""
        return False

    def check(self, system: System) -> None:
        """Refuse a System that this method cannot move."""

    def system_of(self, flow: Flow) -> Any:
        """System of the flow. Raises InputError for a Problem, and for a System that this method cannot move."""
        from kickdrift.model.system import System

        if not isinstance(flow.subject, System):
            raise InputError(f"{self.name}: needs {self.moves}; {flow.name!r} is an ODE; use dop853")
        self.check(flow.subject)
        return flow.subject

    def in_lanes(self, members: Members, options: Options) -> LaneStepper:
        """Start an integration of many small systems at once, for methods that are ``batched``."""
        raise NotImplementedError

    def checked(self, given: Options, asked: Options) -> Options:
        """Options that this method takes, from arguments and file. Raises InputError for ``asked`` options that it does
        not take, and for values that make no sense."""
        for key, value in asked.items():
            if key not in ("dt", PRECISION.name, *self.tunable) and value is not None and value is not False:
                takes = ", ".join(("dt", *self.tunable))
                hint = f"; methods with a heat bath are {WITH_BATH}" if key == TEMPERATURE.name else ""
                if any(key == each.name for each in OF_PRESSURE):
                    hint = f"; a barostat needs a heat bath: methods with one are {WITH_BATH}"
                raise InputError(f"{key}: {self.name} does not take it; it takes {takes}{hint}")
        kept = {each.name: each.filled(given.get(each.name)) for each in self.declared}
        dt = asked.dt if self.adaptive else given.dt  # a file's dt is not the first step of an adaptive method
        precision = PRECISION.filled(given.precision)
        if precision == MIXED and self.float64_because:
            raise InputError(f"precision: {self.name} {self.float64_because}, and takes {DOUBLE} alone")
        options = Options(dt=checked_dt(dt), precision=precision, **kept)
        if self.adaptive:
            from kickdrift.integrators.stepping.step_control import check_tolerances

            check_tolerances(*options.tolerances)
        return options


def checked_dt(dt: Any) -> float | None:
    """Check a step, if one is given. Raises InputError unless it is a positive finite time."""
    return None if dt is None else DT.checked(dt)

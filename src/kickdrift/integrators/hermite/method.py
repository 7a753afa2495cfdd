"""Fourth-order Hermite method for star clusters: gravity and its time derivative, with shared or individual steps."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from kickdrift.errors import InputError
from kickdrift.integrators.method import Method
from kickdrift.integrators.options import ETA, PAIRS, REGULARISED, SCHEME, Option

if TYPE_CHECKING:
    from kickdrift.integrators.flows.flow import Flow
    from kickdrift.integrators.options import Options
    from kickdrift.integrators.stepping.stepper import Stepper


@dataclass(frozen=True)
class Hermite(Method):
    """Predict with acceleration and jerk, evaluate both, correct with the two derivatives from the step's ends (PEC).
    Steps follow Aarseth's criterion with the parameter ``eta``; the energy error goes as eta^2.

    ``scheme`` "shared" (the default) moves all bodies by the shortest of their steps. "block" moves each body by its
    own step, a power of two, so that many move together and the sum is only over these. A ``dt`` makes all steps shared
    and of this length. Between their steps, and in samples, bodies follow the polynomial of their last step, which is
    as accurate as the step.

    ``pairs`` "regularised" (in block steps, without softening) lets a bound pair that others hardly disturb move as one
    body. Its own orbit is Kepler's motion with kicks by the tides of its neighbours. It breaks up when these grow.
    """

    name: str
    order: int
    source: str
    use: str = ""

    family = "Hermite"
    moves_all_because = "predicts every body by the derivatives of its acceleration"
    moves = "bodies under gravity"
    separable = True
    particles_only = True
    chooses_steps = True
    needs_dt = False

    @property
    def declared(self) -> tuple[Option, ...]:
        return ETA, SCHEME, PAIRS

    def checked(self, given: Options, asked: Options) -> Options:
        regularised = asked.get(PAIRS.name) == REGULARISED
        if asked.dt is not None and (asked.eta is not None or asked.scheme not in (None, "shared") or regularised):
            raise InputError(f"dt: fixes the step of {self.name}; give either dt, or eta, scheme and pairs")
        if asked.dt is not None:
            given = given.changed(eta=None, scheme=None, pairs=None)
        if given.get(PAIRS.name) == REGULARISED and given.scheme is None:
            given = given.changed(scheme="block")
        options = super().checked(given.changed(dt=asked.dt), asked)  # a file's dt is for other methods
        if options.get(PAIRS.name) == REGULARISED and options.scheme != "block":
            raise InputError(f"pairs: are regularised in block steps alone, got scheme = {options.scheme}")
        return options if options.dt is not None or options.eta is not None else options.changed(eta=ETA.default)

    def parted(self, options: Options, dt: float) -> Options:
        return options.changed(dt=dt, eta=None, scheme=None, pairs=None)

    def stepper(self, flow: Flow, options: Options) -> Stepper:
        from kickdrift.forces.gravity.direct import Gravity

        system = self.system_of(flow)
        others = [force.name for force in system.forces if not isinstance(force, Gravity)]
        if others or len(system.forces) != 1:
            what = f"force {others[0]!r} has no time derivative" if others else f"the system has {len(system.forces)}"
            raise InputError(
                f"{self.name}: needs the time derivative of one force, gravity; {what}; dop853 takes any forces"
            )
        if options.get(PAIRS.name) == REGULARISED:
            (gravity,) = system.forces
            if gravity.softening > 0.0:
                raise InputError(f"pairs: orbits of pairs need gravity with softening = 0, got {gravity.softening:g}")
            from kickdrift.integrators.hermite.pairs.stepper import PairStepper

            return PairStepper(flow, options)
        from kickdrift.integrators.hermite.stepper import HermiteStepper

        return HermiteStepper(flow, options)


ROWS = (
    Hermite(
        "hermite4", 4,
        "Makino & Aarseth 1992, PASJ 44, 141, doi:10.1093/pasj/44.2.141; block steps: McMillan 1986; Makino 1991",
        "star clusters",
    ),
)  # fmt: skip

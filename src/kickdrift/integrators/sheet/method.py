"""Particles on epicycles: a splitting into Hill's motion, which is solved exactly, and the other forces."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from kickdrift.errors import InputError
from kickdrift.integrators.method import Method

if TYPE_CHECKING:
    from kickdrift.integrators.flows.flow import Flow
    from kickdrift.integrators.options import Options
    from kickdrift.integrators.stepping.stepper import Stepper
    from kickdrift.model.system import System


@dataclass(frozen=True)
class Sei(Method):
    """Half a step along Hill's epicycles, a kick by the other forces, and half a step along epicycles.

    The system has one force ``hill``, whose Coriolis and tidal forces the epicycles solve. Between two kicks the
    guiding centre and the amplitude of each epicycle are constants, and the phase comes from the number of the step.
    So rounding does not grow where no other force acts. The other forces must not depend on velocity. Hill's motion is
    linear, so deviations follow epicycles as particles do.
    """

    name: str
    order: int
    source: str
    use: str = ""

    family = "epicycle splitting"
    moves_all_because = "moves bodies along epicycles"
    symplectic = True
    reversible = True
    particles_only = True
    carries = True
    evaluations = 1
    moves = "particles in Hill's frame"
    declared = ()

    def check(self, system: System) -> None:
        """Raise InputError for a System without Hill's force, and for other forces that depend on velocity."""
        from kickdrift.forces.fields.shipped import Hill
        from kickdrift.forces.slopes.variations import unvaried

        count = sum(isinstance(unvaried(force), Hill) for force in system.forces)
        if count != 1:
            raise InputError(
                f"{self.name}: needs one force 'hill', and {system.name!r} has {count or 'none'}; leapfrog-dkd is the "
                "same without epicycles"
            )
        for force in system.forces:
            if getattr(force, "velocity_dependent", False) and not isinstance(unvaried(force), Hill):
                raise InputError(
                    f"{self.name}: force {force.name!r} depends on velocity; Runge-Kutta methods take both"
                )

    def stepper(self, flow: Flow, options: Options) -> Stepper:
        self.system_of(flow)
        from kickdrift.integrators.sheet.stepper import SeiStepper

        return SeiStepper(flow, options)


ROWS = (
    Sei(
        "sei", 2,
        "Rein & Tremaine 2011, doi:10.1111/j.1365-2966.2011.18939.x; Hill 1878, doi:10.2307/2369430",
        "a patch of a disc or ring, in Hill's frame",
    ),
)  # fmt: skip

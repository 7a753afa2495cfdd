"""Leapfrog in other forms: Verlet's two positions without a velocity, and reversible steps that follow the motion."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from kickdrift.integrators.method import Method

if TYPE_CHECKING:
    from kickdrift.integrators.flows.flow import Flow
    from kickdrift.integrators.options import Options
    from kickdrift.integrators.stepping.stepper import Stepper


@dataclass(frozen=True)
class Stormer(Method):
    """The recursion x(t + dt) = 2 x(t) - x(t - dt) + dt^2 a(t), started from the velocity, with v(t) = (x(t + dt) - x(t
    - dt)) / 2 dt.

    In exact arithmetic its positions equal those of velocity-verlet, and of leapfrog with velocities at half steps. The
    difference of two positions loses digits, the more the smaller dt.
    """

    name: str
    order: int
    source: str
    use: str = ""

    family = "two positions"
    symplectic = True
    reversible = True
    separable = True
    evaluations = 1

    def stepper(self, flow: Flow, options: Options) -> Stepper:
        from kickdrift.integrators.stepping.loops import stormer_loop
        from kickdrift.integrators.stepping.stepping import FixedStepper

        return FixedStepper(
            flow, stormer_loop, np.zeros((0, 0)), lambda shape: np.zeros((2, *shape[1:])), options, kept=True
        )


ROWS = (
    Stormer(
        "stormer-verlet", 2,
        "Stormer 1907, Arch. Sci. phys. nat. 24, 5; Verlet 1967, eq. 4, doi:10.1103/PhysRev.159.98",
        "history; velocity-verlet keeps more digits",
    ),
)  # fmt: skip


@dataclass(frozen=True)
class StepDensity(Method):
    """Drift, kick, drift with a step tau that follows a density of steps G of the positions: 1 / tau_n + 1 / tau_n+1 =
    2 G(x_n+1/2), drifts of tau_n / 2 and tau_n+1 / 2, and a kick of their sum.

    G is a smooth maximum over the particles of |a|^(3/4). In Kepler's problem this makes tau grow as r^(3/2), like the
    time of free fall. Its scale makes the first step from the system's start ``dt``. The recursion is the same from
    both ends, so a run can be reversed at the end of a step. The energy error does not grow, although no step keeps the
    symplectic form. The run stops if a step would differ tenfold from the one before, as where a force vanishes. Use
    fixed steps for oscillators and perfect lattices.
    """

    name: str
    order: int
    source: str
    use: str = ""

    family = "step density"
    reversible = True
    separable = True
    carries = False
    chooses_steps = True
    evaluations = 1
    declared = ()

    def stepper(self, flow: Flow, options: Options) -> Stepper:
        from kickdrift.integrators.splitting.step_density import StepDensityStepper

        return StepDensityStepper(flow, options)


STEP_DENSITY = (
    StepDensity(
        "leapfrog-adaptive", 2,
        "Huang & Leimkuhler 1997, doi:10.1137/S1064827595284658; Holder, Leimkuhler & Reich 2001, "
        "doi:10.1016/S0168-9274(01)00089-9",
        "eccentric orbits; not if forces vanish on the way",
    ),
)  # fmt: skip

"""Verlet's method in its original form: two positions, and no velocity in the recursion."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from kickdrift.integrators.method import Method

if TYPE_CHECKING:
    from kickdrift.integrators.flows.flow import Flow
    from kickdrift.integrators.options.options import Options
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

    @property
    def evaluations(self) -> int:
        return 1

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

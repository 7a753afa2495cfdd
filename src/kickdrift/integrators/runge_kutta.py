"""Explicit Runge-Kutta methods: a method is a Butcher tableau, run by one loop."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from math import fsum
from typing import TYPE_CHECKING

import numpy as np

from kickdrift.errors import InputError
from kickdrift.integrators.method import Method
from kickdrift.state import Floats

if TYPE_CHECKING:
    from kickdrift.flow import Flow
    from kickdrift.integrators.stepping import Options, Stepper


@dataclass(frozen=True)
class Tableau(Method):
    """y' = f(t, y): k_i = f(t + c_i dt, y + dt sum_j a_ij k_j), y <- y + dt sum b_i k_i, with y the positions and
    velocities.

    Attributes
    ----------
    a : the rows below the diagonal, from the second stage on
    b : the weights, adding up to one
    order : the power of dt in the global error
    source : author, year, DOI
    """

    name: str
    a: tuple[tuple[float, ...], ...]
    b: tuple[float, ...]
    order: int
    source: str
    use: str = ""

    family = "Runge-Kutta"
    rescalable = True

    def __post_init__(self) -> None:
        if [len(row) for row in self.a] != list(range(1, len(self.b))):
            raise InputError(f"{self.name}: an explicit tableau has rows of 1, 2, … entries below the diagonal")
        if not abs(fsum(self.b) - 1.0) <= 1e-14 * fsum(map(abs, self.b)):
            raise InputError(f"{self.name}: b adds up to {fsum(self.b)!r}, not 1")

    @property
    def evaluations(self) -> int:
        """Force evaluations per step."""
        return len(self.b)

    @cached_property
    def stages(self) -> Floats:
        """(stages + 1, stages): the full a, and b below it; c is the sum of each row."""
        table = np.zeros((len(self.b) + 1, len(self.b)))
        for i, row in enumerate(self.a, start=1):
            table[i, : len(row)] = row
        table[-1] = self.b
        return table

    def stepper(self, flow: Flow, options: Options) -> Stepper:
        from kickdrift.integrators.loops import runge_kutta_loop
        from kickdrift.integrators.stepping import FixedStepper

        return FixedStepper(
            flow, runge_kutta_loop, self.stages, lambda shape: np.zeros((len(self.b) + 1, *shape)), options
        )


ROWS = (
    Tableau("euler", (), (1.0,), 1, "Euler 1768, Institutionum calculi integralis I, §650", "teaching only"),
    Tableau("midpoint", ((0.5,),), (0.0, 1.0), 2, "Runge 1895, doi:10.1007/BF01446807", "teaching"),
    Tableau(
        "rk4", ((0.5,), (0.0, 0.5), (0.0, 0.0, 1.0)), (1 / 6, 1 / 3, 1 / 3, 1 / 6), 4,
        "Kutta 1901, Z. Math. Phys. 46, 435", "short runs",
    ),
)  # fmt: skip

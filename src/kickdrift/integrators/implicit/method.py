"""Implicit fixed-step Runge-Kutta methods. A method is a full Butcher tableau, and an iteration finds its stages."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from math import fsum, sqrt
from typing import TYPE_CHECKING

import numpy as np

from kickdrift.errors import InputError
from kickdrift.integrators.method import SOLVES, Method
from kickdrift.integrators.options import COMPENSATED, ITERATION, Option
from kickdrift.integrators.runge_kutta.tableaus import Rows
from kickdrift.model.state import Floats

if TYPE_CHECKING:
    from kickdrift.integrators.flows.flow import Flow
    from kickdrift.integrators.options import Options
    from kickdrift.integrators.stepping.stepper import Stepper

ITERATIONS = ITERATION.choices
ROUNDING = 1e-15  # rounding of a tableau's entries


@dataclass(frozen=True)
class ImplicitTableau(Method):
    """y' = f(t, y): Y_i = y + dt sum_j a_ij f(t + c_j dt, Y_j), y <- y + dt sum b_i f(t + c_i dt, Y_i).

    Simplified Newton or fixed-point iteration solves the stages to rounding level; only then is a symplectic or
    reversible method symplectic or reversible. ``iteration`` is "newton" by default for a Problem, and "fixed-point"
    for particles, whose steps are short and whose Jacobian is large.

    Attributes
    ----------
    a : the rows, whole
    b : the weights, adding up to one
    order : the power of dt in the global error
    source : author, year, DOI
    """

    name: str
    a: Rows
    b: tuple[float, ...]
    order: int
    source: str
    use: str = ""

    family = "implicit Runge-Kutta"
    float64_because = SOLVES
    trial_steps = True  # the iteration may stray
    rescalable = True  # the last step only gives the iteration's first guess

    def __post_init__(self) -> None:
        s = len(self.b)
        if [len(row) for row in self.a] != [s] * s:
            raise InputError(f"{self.name}: an implicit tableau has {s} rows of {s} entries, one row for each weight")
        if abs(fsum(self.b) - 1.0) > ROUNDING:
            raise InputError(f"{self.name}: b adds up to {fsum(self.b)!r}, not 1")
        if np.linalg.matrix_rank(np.array(self.a)) < s:
            raise InputError(f"{self.name}: a is singular: a stage is explicit, and the iteration cannot solve it")

    @property
    def declared(self) -> tuple[Option, ...]:
        return COMPENSATED, ITERATION

    @property
    def butcher(self) -> tuple[Floats, Floats]:
        """The full tableau and its weights."""
        return np.array(self.a), np.array(self.b)

    @property
    def c(self) -> tuple[float, ...]:
        """Fraction of dt at each stage."""
        return tuple(fsum(row) for row in self.a)

    @property
    def symplectic(self) -> bool:
        """b_i a_ij + b_j a_ji = b_i b_j (Sanz-Serna 1988, doi:10.1007/BF01954907)."""
        a, b = np.array(self.a), np.array(self.b)
        scaled = b[:, None] * a
        return bool(np.abs(scaled + scaled.T - np.outer(b, b)).max() <= ROUNDING)

    @property
    def reversible(self) -> bool:
        """a_ij + a_(s+1-i)(s+1-j) = b_j (Hairer, Lubich & Wanner 2006, V.2, thm. 2.3)."""
        a, b = np.array(self.a), np.array(self.b)
        return bool(np.abs(a + a[::-1, ::-1] - b).max() <= ROUNDING and np.abs(b - b[::-1]).max() <= ROUNDING)

    @cached_property
    def matrix(self) -> Floats:
        """The matrix a (s, s)."""
        return np.array(self.a)

    @cached_property
    def increment(self) -> Floats:
        """Weights d (s,) with y <- y + sum d_i (Y_i - y): b a^-1. This avoids an f that a stiff problem would magnify
        (Hairer & Wanner 1996, eq. IV.8.2b)."""
        return np.linalg.solve(self.matrix.T, np.array(self.b))

    @cached_property
    def extrapolation(self) -> Floats:
        """Matrix (s, s) from the stages Y_i - y of a step to a guess of the next step's stages. It extrapolates the
        polynomial through y and all Y_i (Hairer & Wanner 1996, eq. IV.8.5)."""
        nodes = np.array((0.0, *self.c))
        powers = np.vander(nodes, increasing=True)
        ahead = np.vander(1.0 + nodes[1:], len(nodes), increasing=True)
        weights = np.linalg.solve(powers.T, ahead.T).T[:, 1:]
        return weights - self.increment

    def stepper(self, flow: Flow, options: Options) -> Stepper:
        from kickdrift.integrators.implicit.stepper import ImplicitStepper

        return ImplicitStepper(flow, self, options)


_R = sqrt(3.0)
ROWS = (
    ImplicitTableau(
        "backward-euler", ((1.0,),), (1.0,), 1,
        "Curtiss & Hirschfelder 1952, doi:10.1073/pnas.38.3.235", "teaching; damps stiff modes",
    ),
    ImplicitTableau(
        "implicit-midpoint", ((0.5,),), (1.0,), 2,
        "Hairer, Lubich & Wanner 2006, eq. I.1.7, doi:10.1007/3-540-30666-8", "preserves the structure of any system",
    ),
    ImplicitTableau(
        "gauss-legendre4", ((0.25, 0.25 - _R / 6), (0.25 + _R / 6, 0.25)), (0.5, 0.5), 4,
        "Hammer & Hollingsworth 1955, doi:10.2307/2002062; Kuntzmann 1961", "the same, more accurate",
    ),
)  # fmt: skip

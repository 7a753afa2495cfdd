"""Explicit Runge-Kutta methods. A method is a Butcher tableau, and one loop runs all."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from fractions import Fraction
from functools import cached_property
from math import fsum
from typing import TYPE_CHECKING

import numpy as np

from kickdrift.errors import InputError
from kickdrift.integrators.method import Method
from kickdrift.integrators.runge_kutta import tableaus
from kickdrift.integrators.runge_kutta.tableaus import Rows
from kickdrift.model.state import Floats

if TYPE_CHECKING:
    from kickdrift.integrators.flows.flow import Flow
    from kickdrift.integrators.options import Options
    from kickdrift.integrators.stepping.batch_loops import LaneStepper, Members
    from kickdrift.integrators.stepping.stepper import Stepper


@dataclass(frozen=True)
class Tableau(Method):
    """y' = f(t, y): k_i = f(t + c_i dt, y + dt sum_j a_ij k_j), y <- y + dt sum b_i k_i, with y the positions and
    velocities.

    Stages 1 to s make the step. Stage s + 1 is f(t + dt, y_new), always the next step's first stage. Stages from s + 2
    on serve only dense output.

    Attributes
    ----------
    a : the rows below the diagonal, from the second stage on
    b : the weights, adding up to one
    order : the power of dt in the global error
    source : author, year, DOI
    errors : weights of stages 1 to s + 1 in an estimate of the step's error, one row or several; none: a fixed step
    error_order : q, where the step that the estimate asks for goes as its power -1 / (q + 1)
    extra : rows of a for the stages of dense output alone
    dense : P, a row a stage: y(t + theta dt) = y + dt sum_i k_i sum_j P_ij theta^(j + 1), j from 0
    """

    name: str
    a: Rows
    b: tuple[float, ...]
    order: int
    source: str
    use: str = ""
    errors: Rows = ()
    error_order: int = 0
    extra: Rows = ()
    dense: Rows = ()

    family = "Runge-Kutta"

    def __post_init__(self) -> None:
        s = len(self.b)
        if len(self.a) == s:  # a full matrix, as for implicit methods
            for i, row in enumerate(self.a):
                if any(row[i:]):
                    raise InputError(
                        f"{self.name}: the tableau is implicit (row {i + 1} has an entry on or above the diagonal); "
                        "the explicit loop cannot run it"
                    )
        if [len(row) for row in self.a] != list(range(1, s)):
            raise InputError(f"{self.name}: an explicit tableau has rows of 1, 2, … entries below the diagonal")
        if not _adds_up(self.b, 1.0):
            raise InputError(f"{self.name}: b adds up to {fsum(self.b)!r}, not 1")
        if [len(row) for row in self.extra] != [s + 1 + i for i in range(len(self.extra))]:
            raise InputError(f"{self.name}: rows of extra need an entry for each earlier stage: {s + 1}, {s + 2}, …")
        for number, row in enumerate(self.errors, start=1):
            if len(row) != s + 1:
                raise InputError(f"{self.name}: row {number} of errors has {len(row)} entries, not {s + 1}")
            if not _adds_up(row, 0.0):
                raise InputError(f"{self.name}: row {number} of errors adds up to {fsum(row)!r}, not 0")
        if bool(self.errors) != (self.error_order > 0):
            raise InputError(f"{self.name}: errors and error_order go together; error_order is {self.error_order!r}")
        if self.dense:
            self._check_dense()

    def _check_dense(self) -> None:
        count = len(self.b) + 1 + len(self.extra)
        if len(self.dense) != count or len({len(row) for row in self.dense}) != 1:
            raise InputError(f"{self.name}: dense has {count} rows of one length, one for each stage")
        for number, (row, b) in enumerate(zip(self.dense, (*self.b, *[0.0] * (count - len(self.b))), strict=True), 1):
            if not _adds_up(row, b):
                raise InputError(
                    f"{self.name}: row {number} of dense adds up to {fsum(row)!r}, not to {b!r} as at the end of a step"
                )

    @property
    def adaptive(self) -> bool:
        """Tell whether an error estimate can set the step."""
        return bool(self.errors)

    @property
    def rescalable(self) -> bool:
        """Tell whether velocities may change between steps: only step control keeps anything from step to step."""
        return not self.adaptive

    @property
    def c(self) -> tuple[float, ...]:
        """Fraction of dt at each stage of the step."""
        return (0.0, *(fsum(row) for row in self.a))

    @property
    def evaluations(self) -> int:
        """Force evaluations per step; of an adaptive method, per accepted step without dense output."""
        return len(self.b)

    @property
    def butcher(self) -> tuple[Floats, Floats]:
        """The full tableau and its weights."""
        return self.stages[:-1], self.stages[-1]

    @cached_property
    def stages(self) -> Floats:
        """(stages + 1, stages): the full a, and b below it; c is the sum of each row."""
        table = np.zeros((len(self.b) + 1, len(self.b)))
        for i, row in enumerate(self.a, start=1):
            table[i, : len(row)] = row
        table[-1] = self.b
        return table

    @cached_property
    def error_rows(self) -> Floats:
        """Weights of the error estimate (1 or 2, stages + 1)."""
        return np.array(self.errors)

    def step(self, derivative: Callable[[float, Floats], Floats], t: float, y: Floats, dt: float) -> Floats:
        """One step from y at t, in plain NumPy."""
        k: list[Floats] = []
        for c, row in zip((*self.c, 1.0), self.stages, strict=True):
            stage = y + dt * sum((w * ki for w, ki in zip(row, k, strict=False) if w), np.zeros_like(y))
            if len(k) == len(self.b):
                return stage
            k.append(derivative(t + c * dt, stage))
        raise AssertionError

    def stepper(self, flow: Flow, options: Options) -> Stepper:
        if self.adaptive:
            from kickdrift.integrators.runge_kutta.adaptive import AdaptiveStepper

            return AdaptiveStepper(flow, self, options)
        from kickdrift.integrators.stepping.loops import runge_kutta_loop
        from kickdrift.integrators.stepping.stepping import FixedStepper

        return FixedStepper(
            flow,
            runge_kutta_loop,
            self.stages,
            lambda shape: np.zeros((len(self.b) + 1, *shape)),
            options,
            kept=False,
        )

    @property
    def batched(self) -> bool:
        return not self.adaptive

    def in_lanes(self, members: Members, options: Options) -> LaneStepper:
        from kickdrift.integrators.stepping.batch_loops import FixedLanes, batch_runge_kutta_loop

        return FixedLanes(members, batch_runge_kutta_loop, self.stages, (len(self.b) + 1, *members.y.shape[1:]))


def _adds_up(row: tuple[float, ...], total: float) -> bool:
    """Tell whether a row adds up to ``total`` to within the rounding of its entries."""
    return abs(fsum(row) - total) <= 1e-14 * fsum(map(abs, row))


def interpolant(b: tuple[float, ...], d: Rows = (), extra: int = 0) -> Rows:
    """Compute ``dense`` of the interpolant y + theta (F_0 + (1 - theta) (F_1 + theta (F_2 + (1 - theta) (F_3 + …)))).

    F_0 = sum_i b_i k_i, F_1 = k_1 - F_0, F_2 = 2 F_0 - k_1 - k_(s+1), and F_3, F_4, … have the weights ``d``. The first
    three are the Hermite cubic through both ends with the derivatives there, which the others do not change.

    Source: Hairer, Nørsett & Wanner 1993, II.6, doi:10.1007/978-3-540-78862-1, multiplied out without rounding.
    """
    s = len(b)
    rows = []
    for i in range(s + 1 + extra):
        weight, first, new = Fraction(b[i] if i < s else 0), Fraction(i == 0), Fraction(i == s)
        factors = [weight, first - weight, 2 * weight - first - new, *(Fraction(row[i]) for row in d)]
        row = [Fraction(0)]  # powers of theta from 0 on
        for number in reversed(range(len(factors))):
            row[0] += factors[number]
            up = [Fraction(0), *row]
            row = up if number % 2 == 0 else [p - q for p, q in zip([*row, Fraction(0)], up, strict=True)]
        rows.append(tuple(float(p) for p in row[1:]))
    return tuple(rows)


_HAIRER = "Hairer, Nørsett & Wanner 1993, Solving Ordinary Differential Equations I, doi:10.1007/978-3-540-78862-1"
ROWS = (
    Tableau("euler", (), (1.0,), 1, "Euler 1768, Institutionum calculi integralis I, §650", "teaching only"),
    Tableau("midpoint", ((0.5,),), (0.0, 1.0), 2, "Runge 1895, doi:10.1007/BF01446807", "teaching"),
    Tableau(
        "rk4", ((0.5,), (0.0, 0.5), (0.0, 0.0, 1.0)), (1 / 6, 1 / 3, 1 / 3, 1 / 6), 4,
        "Kutta 1901, Z. Math. Phys. 46, 435", "short runs",
    ),
    Tableau(
        "bogacki-shampine23", tableaus.BOGACKI_SHAMPINE23_A, tableaus.BOGACKI_SHAMPINE23_B, 3,
        "Bogacki & Shampine 1989, Appl. Math. Lett. 2, 321, doi:10.1016/0893-9659(89)90079-7", "low accuracy",
        errors=tableaus.BOGACKI_SHAMPINE23_ERRORS, error_order=2, dense=interpolant(tableaus.BOGACKI_SHAMPINE23_B),
    ),
    Tableau(
        "cash-karp45", tableaus.CASH_KARP45_A, tableaus.CASH_KARP45_B, 5,
        "Cash & Karp 1990, ACM Trans. Math. Softw. 16, 201, doi:10.1145/79505.79507", "medium accuracy",
        errors=tableaus.CASH_KARP45_ERRORS, error_order=4,
    ),
    Tableau(
        "dormand-prince45", tableaus.DORMAND_PRINCE45_A, tableaus.DORMAND_PRINCE45_B, 5,
        "Dormand & Prince 1980, J. Comput. Appl. Math. 6, 19, doi:10.1016/0771-050X(80)90013-3; dense output "
        "Shampine 1986, Math. Comput. 46, 135, doi:10.2307/2008219", "medium accuracy, dense output",
        errors=tableaus.DORMAND_PRINCE45_ERRORS, error_order=4,
        dense=interpolant(tableaus.DORMAND_PRINCE45_B, tableaus.DORMAND_PRINCE45_D),
    ),
    Tableau(
        "dop853", tableaus.DOP853_A, tableaus.DOP853_B, 8, f"{_HAIRER}, II.5 and II.10",
        "high accuracy, close encounters",
        errors=tableaus.DOP853_ERRORS, error_order=7, extra=tableaus.DOP853_EXTRA,
        dense=interpolant(tableaus.DOP853_B, tableaus.DOP853_D, len(tableaus.DOP853_EXTRA)),
    ),
)  # fmt: skip

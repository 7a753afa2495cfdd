"""Rosenbrock methods: linearly implicit, with an embedded error estimate. One Jacobian a step, no iteration."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np

from kickdrift.errors import InputError
from kickdrift.integrators.method import SOLVES, Method
from kickdrift.integrators.runge_kutta.tableaus import Rows, lower
from kickdrift.model.state import Floats

if TYPE_CHECKING:
    from kickdrift.integrators.flows.flow import Flow
    from kickdrift.integrators.options import Options
    from kickdrift.integrators.stepping.stepper import Stepper


@dataclass(frozen=True)
class Rosenbrock(Method):
    """y' = f(t, y), J = df/dy and f_t = df/dt at (t, y):

        (I / (h gamma) - J) u_i = f(t + alpha_i h, y + sum_j a_ij u_j) + sum_j (c_ij / h) u_j + gamma_i h f_t,
        y <- y + sum m_i u_i

    (Hairer & Wanner 1996, eq. IV.7.25, doi:10.1007/978-3-642-05221-7). alpha and gamma_i follow from a and c.

    Attributes
    ----------
    gamma : of the diagonal
    a, c : the rows below the diagonal, from the second stage on
    m : the weights of the step
    errors : weights of the stages in an estimate of the step's error
    order, error_order : powers of the step in the global errors of the solution and of the embedded one
    source : author, year, DOI
    """

    name: str
    gamma: float
    a: Rows
    c: Rows
    m: tuple[float, ...]
    errors: tuple[float, ...]
    order: int
    error_order: int
    source: str
    use: str = ""

    family = "Rosenbrock"
    float64_because = SOLVES
    adaptive = True
    trial_steps = True

    def __post_init__(self) -> None:
        s = len(self.m)
        for key, rows in (("a", self.a), ("c", self.c)):
            if [len(row) for row in rows] != list(range(1, s)):
                raise InputError(f"{self.name}: {key} has rows of 1, 2, … entries below the diagonal")
        if len(self.errors) != s:
            raise InputError(f"{self.name}: errors has {len(self.errors)} entries, not {s}")

    @property
    def evaluations(self) -> int:
        """Evaluations of f per accepted step, without Jacobians."""
        return len(self.m)

    @cached_property
    def sums(self) -> tuple[Floats, Floats]:
        """The sums alpha and gamma_i of the same method in the variables k = Gamma^-1 u (p. 111)."""
        inverse = np.eye(len(self.m)) / self.gamma - lower(self.c)
        unit = np.asarray(np.linalg.solve(inverse, np.ones(len(self.m))), dtype=float)
        return lower(self.a) @ unit, unit

    @property
    def butcher(self) -> tuple[Floats, Floats]:
        """Full tableau A + Gamma and b on y' = lambda y, where the Jacobian is exact (p. 104)."""
        g = np.linalg.inv(np.eye(len(self.m)) / self.gamma - lower(self.c))
        return (lower(self.a) + np.eye(len(self.m))) @ g, np.array(self.m) @ g

    def stepper(self, flow: Flow, options: Options) -> Stepper:
        from kickdrift.integrators.implicit.stepper import RosenbrockStepper

        return RosenbrockStepper(flow, self, options)


_LAST = (1.221224509226641, 6.019134481288629, 12.53708332932087, -0.6878860361058950)
ROWS = (
    Rosenbrock(
        "rosenbrock", 0.25,
        (
            (1.544,),
            (0.9466785280815826, 0.2557011698983284),
            (3.314825187068521, 2.896124015972201, 0.9986419139977817),
            _LAST,
            (*_LAST, 1.0),
        ),
        (
            (-5.6688,),
            (-2.430093356833875, -0.2063599157091915),
            (-0.1073529058151375, -9.594562251023355, -20.47028614809616),
            (7.496443313967647, -10.24680431464352, -33.99990352819905, 11.70890893206160),
            (8.083246795921522, -7.981132988064893, -31.52159432874371, 16.31930543123136, -6.058818238834054),
        ),
        (*_LAST, 1.0, 1.0), (0.0, 0.0, 0.0, 0.0, 0.0, 1.0), 4, 3,
        "RODAS: Hairer & Wanner 1996, Solving Ordinary Differential Equations II, IV.7 and IV.10, "
        "doi:10.1007/978-3-642-05221-7", "stiff, medium accuracy, few unknowns",
    ),
)  # fmt: skip

"""SciPy's methods for stiff problems, step by step. SciPy chooses their steps and errors."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from kickdrift.integrators.method import SOLVES, Method
from kickdrift.integrators.options import ATOL, MAX_STEP, RTOL, Option

if TYPE_CHECKING:
    from kickdrift.integrators.flows.flow import Flow
    from kickdrift.integrators.options import Options
    from kickdrift.integrators.stepping.stepper import Stepper


@dataclass(frozen=True)
class SciPyMethod(Method):
    """A solver class of ``scipy.integrate``. It uses the problem's Jacobian, else its own differences.

    Attributes
    ----------
    solver : the class's name
    order : the highest, where it varies
    """

    name: str
    solver: str
    order: int
    source: str
    use: str = ""

    family = "SciPy"
    float64_because = SOLVES
    adaptive = True
    trial_steps = True

    @property
    def declared(self) -> tuple[Option, ...]:
        return RTOL, ATOL, MAX_STEP

    def stepper(self, flow: Flow, options: Options) -> Stepper:
        from kickdrift.integrators.runge_kutta.scipy_stepper import SciPyStepper

        return SciPyStepper(flow, self.name, self.solver, options)


ROWS = (
    SciPyMethod(
        "bdf", "BDF", 5, "Shampine & Reichelt 1997, doi:10.1137/S1064827594276424; SciPy's BDF",
        "stiff, low accuracy; orders 1 to 5",
    ),
    SciPyMethod(
        "radau", "Radau", 5, "Hairer & Wanner 1996, IV.8, doi:10.1007/978-3-642-05221-7; SciPy's Radau",
        "stiff, high accuracy",
    ),
    SciPyMethod(
        "lsoda", "LSODA", 12, "Petzold 1983, doi:10.1137/0904010; Hindmarsh 1983; SciPy's LSODA",
        "stiff or not, switches automatically; orders 1 to 12, stiff 1 to 5",
    ),
)  # fmt: skip

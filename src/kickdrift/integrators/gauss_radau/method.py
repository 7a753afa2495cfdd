"""Gauss-Radau collocation of order 15. ``tables`` derives its numbers."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

from kickdrift.errors import InputError
from kickdrift.integrators.method import SOLVES, Method
from kickdrift.integrators.options import MAX_STEP, RTOL

if TYPE_CHECKING:
    from kickdrift.integrators.flows.flow import Flow
    from kickdrift.integrators.options import Options
    from kickdrift.integrators.stepping.stepper import Stepper

_EPSILON = "The dimensionless epsilon that sets the steps; errors per step go as its power 15/7."
EPSILON = replace(RTOL, help=_EPSILON, default=1e-9, several=False, written=True)


@dataclass(frozen=True)
class GaussRadau(Method):
    """Gauss-Radau collocation with steps that follow the motion, accurate to round-off.

    ``rtol`` is the dimensionless epsilon of Rein & Spiegel 2015 and sets the steps; the default is 1e-9. Errors per
    step scale as epsilon^(15/7) and are below rounding at the default. The method takes no ``atol``.
    """

    name: str
    order: int
    source: str
    use: str

    family = "Gauss-Radau"
    float64_because = SOLVES
    adaptive = True
    declared = (EPSILON, MAX_STEP)

    def checked(self, given: Options, asked: Options) -> Options:
        if isinstance(given.rtol, tuple):
            raise InputError(f"rtol: {self.name} takes one number, got {len(given.rtol)}")
        return super().checked(given, asked)

    def stepper(self, flow: Flow, options: Options) -> Stepper:
        from kickdrift.integrators.gauss_radau.stepper import GaussRadauStepper

        return GaussRadauStepper(flow, options)


ROWS = (
    GaussRadau(
        "gauss-radau15", 15,
        "Everhart 1985, doi:10.1007/978-94-009-5400-7_17; Rein & Spiegel 2015, doi:10.1093/mnras/stu2164; step: Pham, "
        "Rein & Spiegel 2024, doi:10.21105/astro.2401.02849",
        "orbits to round-off, close encounters, references",
    ),
)  # fmt: skip

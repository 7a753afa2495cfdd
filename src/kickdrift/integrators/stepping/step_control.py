"""Step control, separate from stepping: the error of a step, and the length of the next one.

A controller is a row of numbers. Let err_n be the error of step n over its tolerance, and q the order of
the solution that measures this error. The next step is the last times

    safety * err_n^(-kI/(q+1)) * (err_{n-1} / err_n)^(kP/(q+1)) * (err_{n-1}^2 / (err_n err_{n-2}))^(kD/(q+1)),

which is the elementary (integral) controller for kP = kD = 0 (Hairer, Norsett & Wanner 1993, II.4, eq. 4.13,
doi:10.1007/978-3-540-78862-1), Gustafsson's PI controller (1991, doi:10.1145/210232.210242), and Soderlind's PID
controllers (2003, doi:10.1145/641876.641877).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np

from kickdrift.errors import InputError
from kickdrift.integrators.options import CONTROLLER
from kickdrift.jit.compile import is_finite, jit
from kickdrift.model.checks.values import positive
from kickdrift.model.state import Floats

if TYPE_CHECKING:
    from kickdrift.integrators.flows.flow import Flow
    from kickdrift.integrators.options import Options

EPSILON = float(np.finfo(float).eps)
FLOOR = 1e-4
LEAST_RTOL = 100 * EPSILON  # below, rounding alone fails the test


@dataclass(frozen=True)
class Controller:
    """Rule for the next step from the last errors; see the module's text."""

    name: str
    integral: float
    proportional: float
    derivative: float
    source: str
    safety: float = 0.9
    least: float = 0.2  # fraction of the last step
    most: float = 10.0

    @cached_property
    def numbers(self) -> Floats:
        """The numbers in the form for the compiled loop."""
        return np.array([self.integral, self.proportional, self.derivative, self.safety, self.least, self.most])


CONTROLLERS = {
    row.name: row
    for row in (
        Controller("i", 1.0, 0.0, 0.0, "Hairer, Norsett & Wanner 1993, eq. II.4.13, doi:10.1007/978-3-540-78862-1"),
        Controller("pi", 0.65, 0.2, 0.0, "Gustafsson 1991, doi:10.1145/210232.210242; dopri5's beta = 0.04"),
        Controller("pid", 2 / 9, -2 / 9, 1 / 18, "Soderlind 2003, H312, doi:10.1145/641876.641877"),
    )
}


def controller(name: str | None) -> Controller:
    """Controller of that name; the default one where there is none."""
    return CONTROLLERS[CONTROLLER.default if name is None else name]


def check_tolerances(rtol: Any, atol: Any) -> None:
    """Raise InputError for tolerances that no step can meet."""
    for key, values in (("rtol", rtol), ("atol", atol)):
        for name, value in _named(key, values):
            positive(name, value)
            if key == "rtol" and value < LEAST_RTOL:
                raise InputError(
                    f"{name} must be {LEAST_RTOL:.2g} or more, got {value:g}: smaller errors drown in rounding"
                )


def _named(key: str, values: Any) -> list[tuple[str, Any]]:
    return [(f"{key}[{k}]", v) for k, v in enumerate(values)] if isinstance(values, tuple) else [(key, values)]


def tolerances_of(flow: Flow, options: Options) -> tuple[Floats, Floats]:
    """Return rtol and atol for each component of the flattened y. Raises InputError if their number differs."""
    check_tolerances(*options.tolerances)
    size = flow.array(flow.subject.state).size  # type: ignore[arg-type]
    found = []
    for key, value in zip(("rtol", "atol"), options.tolerances, strict=True):
        if isinstance(value, tuple) and flow.of_particles:
            raise InputError(f"{key}: expected one number for a System; only a Problem takes one for each component")
        if isinstance(value, tuple) and len(value) != size:
            raise InputError(f"{key}: expected one number, or {size} as y has components, got {len(value)}")
        found.append(np.full(size, value, dtype=float))
    if hasattr(flow, "own_tolerances"):
        flow.own_tolerances(found[1])
    return found[0], found[1]


@jit
def step_factor(numbers, exponent, error, before, before2):
    """Factor of the step after an accepted one, from the last three errors over their tolerances.

    A step much better than required says little about later ones: past errors count as at least 1e-4, as in dopri5.
    """
    e0, e1, e2 = max(error, 1e-10), max(before, FLOOR), max(before2, FLOOR)
    factor = e0 ** -(numbers[0] * exponent)
    if numbers[1] != 0.0:
        factor *= (e1 / e0) ** (numbers[1] * exponent)
    if numbers[2] != 0.0:
        factor *= (e1 * e1 / (e0 * e2)) ** (numbers[2] * exponent)
    return min(numbers[5], max(numbers[4], numbers[3] * factor))


@jit
def rejected_factor(numbers, exponent, error):
    """Factor after a rejected step, from that step's error alone. An error that is not finite gives the smallest
    factor."""
    if not is_finite(error):
        return numbers[4]
    return max(numbers[4], numbers[3] * error ** -((numbers[0] + numbers[1] + numbers[2]) * exponent))


def first_step(
    derivative: Callable[[float, Floats], Floats],
    time: float,
    y: Floats,
    f: Floats,
    order: int,
    rtol: Floats,
    atol: Floats,
    end: float = np.inf,
    clip: bool = False,
) -> float | None:
    """First step that is neither far too long nor far too short (Hairer, Norsett & Wanner 1993, II.4, p. 169), with one
    evaluation of f.

    ``order`` is the order of the solution that measures the error. ``rtol`` and ``atol`` have one number for each
    component. Returns None if that evaluation would lie beyond ``end``; with ``clip`` it is made at the end.
    """

    def norm(values: Any) -> float:
        return float(np.sqrt(np.mean(np.square(values))))

    with np.errstate(all="ignore"):  # a scale near zero, or very large numbers, give non-finite results
        scale = (atol + np.abs(y.reshape(-1)) * rtol).reshape(y.shape)
        d0, d1 = norm(y / scale), norm(f / scale)
        h0 = 1e-6 if d0 < 1e-5 or d1 < 1e-5 else 0.01 * d0 / d1
        h0 = h0 if 0.0 < h0 < np.inf else 1e-6
        if time + h0 > end:
            if not clip:
                return None
            h0 = end - time
        d2 = norm((derivative(time + h0, y + h0 * f) - f) / scale) / h0
    if not np.isfinite(d2):
        return h0
    largest = max(d1, d2)
    h1 = max(1e-6, h0 * 1e-3) if largest <= 1e-15 else (0.01 / largest) ** (1.0 / (order + 1))
    return min(100.0 * h0, h1)

"""Zeros of a scalar g inside a step: a quick test that rules most steps out, and a search that isolates every zero.

The quick test evaluates g at four times inside the step. The search represents g by Chebyshev polynomials, and divides
the step until they fit. Between the ends of the step and the turning points of the polynomials, g is monotone. So each
change of sign between two of these points is one zero.
"""

from collections import deque
from collections.abc import Callable, Sequence
from functools import cache
from itertools import pairwise
from typing import Any, NamedTuple

import numpy as np
from numpy.polynomial import chebyshev

from kickdrift.integrators.stepping.step_control import EPSILON
from kickdrift.integrators.stepping.stepper import INNER
from kickdrift.model.state import Floats

DEGREES = 8, 16, 32
FITS = 1e-13  # part of the largest |g|: the last coefficients of a polynomial that fits to rounding
NOISE = 1e-7  # the same, of one that fits to the noise of g
DEPTH = 6  # number of times that the search halves a part that no polynomial fits
REAL = 1e-3  # imaginary part of a turning point that may be real
PAUSE = 64  # most steps without the quick test, after a step far from any zero
ROOM = 4.0  # |g| over its change in a step, for a pause of one step; the pause grows with the square
PAST = 6  # values at ends of steps that a trial of the past goes by

Values = Callable[[Floats], Sequence[float]]  # g at several times
Point = tuple[float, float]  # time, g


# From six values, at 0, INNER and 1, to the coefficients 1 to 5 of their polynomial.
_ROWS = np.linalg.inv(chebyshev.chebvander(2.0 * np.array([0.0, *INNER, 1.0]) - 1.0, 5))[1:]


def clear(values: Sequence[float]) -> bool:
    """Tell whether the signs at the ends tell all zeros: none, or one. Six values, at 0, INNER and 1 of the step.

    The sizes of the polynomial's last coefficients stand for those of all that it lacks, hence their large weights. The
    second line compares slopes."""
    low, high = min(values), max(values)
    alike = low > 0.0 or high < 0.0
    if not (alike or min(values[0], values[5]) < 0.0 < max(values[0], values[5])):
        return False
    one, two, three, four, five = np.abs(_ROWS @ values).tolist()
    if alike:
        return min(abs(low), abs(high)) > two + 8.0 * three + 64.0 * four + 256.0 * five
    return one > 4.0 * two + 32.0 * three + 256.0 * four + 1024.0 * five


class Rough(NamedTuple):
    """States inside a step, at INNER, roughly. ``foretelling``: for a polynomial through the last ends of steps, the
    weights of all but the last value that foretell this one."""

    states: Any
    foretelling: Sequence[float] | None = None


class Quiet:
    """Decides for one g which steps to search, by a quick test of some steps."""

    def __init__(self) -> None:
        self._past: deque[float] = deque(maxlen=PAST)  # at ends of steps
        self._pause, self._low, self._high, self._longest = 0, 0.0, 0.0, 0.0

    def keep(self, value: float) -> None:
        """Keep g at the end of a step."""
        self._past.append(value)

    def rests(self, value: float, length: float) -> bool:
        """Tell whether a step, with g at its end, needs no test: a step shortly before was far from any zero, and
        neither g nor the steps have changed much since. Then g has the same sign at both ends."""
        if self._pause and self._low < value < self._high and length <= self._longest:
            self._pause -= 1
            return True
        return False

    def passes(self, values: Sequence[float], length: float, foretelling: Sequence[float] | None = None) -> bool:
        """Tell whether the signs at the ends of a step tell all zeros; six values as for ``clear``."""
        self._pause = 0
        if not clear(values) or (foretelling and not self._foretold(values, foretelling)):
            return False
        low, high = min(values), max(values)
        if low > 0.0 or high < 0.0:
            least = min(abs(low), abs(high))
            self._pause = int(min(PAUSE**0.5, least / (ROOM * (high - low))) ** 2) if high > low else PAUSE
            self._low, self._high = values[5] - 0.5 * least, values[5] + 0.5 * least
            self._longest = 2.0 * length
        return True

    def _foretold(self, values: Sequence[float], weights: Sequence[float]) -> bool:
        """Tell whether the past foretells g at the step's end, so that its polynomial serves inside the step."""
        *past, value = self._past
        if len(past) < len(weights):
            return False
        missed = abs(value - sum(w * g for w, g in zip(weights, past, strict=True)))
        return 4.0 * missed < min(abs(value) for value in values)


@cache
def _fit(degree: int) -> tuple[Any, Any]:
    """Chebyshev points of a degree, from -1 to 1, and the matrix from values there to coefficients."""
    points = -np.cos(np.linspace(0.0, np.pi, degree + 1))
    return points, np.linalg.inv(chebyshev.chebvander(points, degree))


def _turns(coefficients: Floats) -> Floats:
    """Zeros of a polynomial's derivative between -1 and 1, in order; also zeros that rounding may have made complex."""
    slope = chebyshev.chebder(coefficients)
    large = np.flatnonzero(np.abs(slope) > EPSILON * np.abs(slope).max())
    roots = chebyshev.chebroots(slope[: large[-1] + 1]) if large.size else np.zeros(0)
    return np.unique(roots.real[(np.abs(roots.imag) < REAL) & (np.abs(roots.real) < 1.0)])


def monotone_points(g: Values, first: Point, last: Point, depth: int = DEPTH) -> list[Point]:
    """Points from ``first`` to ``last`` between which g is monotone, as far as polynomials represent g."""
    (begin, _), (end, _) = first, last
    if not 0.0 < abs(end - begin) < np.inf:
        return [first, last]

    def times(parts: Floats) -> Floats:
        return begin + 0.5 * (parts + 1.0) * (end - begin)

    values: Floats = np.zeros(0)
    for degree in DEGREES:
        parts, matrix = _fit(degree)
        found, fresh = np.empty(degree + 1), slice(1, -1)
        found[[0, -1]] = first[1], last[1]
        if values.size:  # every other point is known
            found[::2], fresh = values, slice(1, None, 2)
        found[fresh] = g(times(parts[fresh]))
        values, size = found, np.abs(found).max()
        if not np.isfinite(size) or size == 0.0:
            break
        coefficients = matrix @ values
        tail = np.abs(coefficients[-3:]).max() / size
        if tail <= FITS or (degree == DEGREES[-1] and tail <= NOISE):
            inner = times(_turns(coefficients))
            inner = inner[(inner - begin) * (inner - end) < 0.0]
            return [first, *zip(inner.tolist(), g(inner), strict=True), last]
    inner = times(parts[1:-1])
    if depth == 0 or not np.isfinite(size) or size == 0.0:
        return [first, *zip(inner.tolist(), values[1:-1].tolist(), strict=True), last]
    middle = (float(inner[degree // 2 - 1]), float(values[degree // 2]))
    before = monotone_points(g, first, middle, depth - 1)
    return before[:-1] + monotone_points(g, middle, last, depth - 1)


def changes(points: Sequence[Point]) -> list[tuple[Point, Point]]:
    """Pairs of neighbours with different signs; g = 0 counts at the ends alone. NaN has no sign."""
    kept = [points[0], *(point for point in points[1:-1] if abs(point[1]) > 0.0), points[-1]]
    return [(a, b) for a, b in pairwise(kept) if a[1] <= 0.0 <= b[1] or a[1] >= 0.0 >= b[1]]


def zero(g: Callable[[float], float], begin: float, end: float, least: float) -> float:
    """Zero of g, which has different signs at both times, by Brent's method (1973). Its error is ``least``, or the
    rounding of the time where that is larger."""
    from scipy.optimize import brentq

    smallest = float(np.finfo(float).tiny)
    return float(brentq(g, begin, end, xtol=max(least, smallest), rtol=4 * EPSILON))

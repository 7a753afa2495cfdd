"""Longest stable step of a method, from its coefficients alone.

The test equations are y' = lambda y for Runge-Kutta methods (z = lambda dt) and the oscillator x'' = -omega^2 x for
splittings. The bounds include the edge: a method is stable if |R(z)| <= 1, or |trace| <= 2, at this and all smaller
steps. If |R| or |trace| only touches its bound (to 1e-12, since the weights are rounded), the interval continues.

Sources: Hairer & Wanner 1996, Solving Ordinary Differential Equations II, IV.2-3, doi:10.1007/978-3-642-05221-7; for
splittings Blanes, Casas & Murua 2008, doi:10.1137/070679764 (the stability of the propagation matrix).
"""

import math
from collections.abc import Callable, Sequence
from fractions import Fraction
from operator import mul
from typing import Any, NamedTuple

import numpy as np
from numpy.polynomial import Polynomial

from kickdrift.errors import InputError
from kickdrift.integrators.method import Method
from kickdrift.integrators.splitting.method import Splitting
from kickdrift.integrators.splitting.subflows import DRIFT, KICK
from kickdrift.model.state import Floats

TOUCHING = 1e-12  # largest excess of a curve that only touches the bound
HORNER = 1e-15  # rounding of a cancelling polynomial, relative to the absolute values of its terms
ROUNDING = 1e-13  # a coefficient below this fraction of its terms is zero

Matrix = Sequence[Sequence[float]] | Floats


class StabilityFunction(NamedTuple):
    """Stability function R(z), the factor of a step on y' = lambda y, z = lambda dt: a quotient of two polynomials."""

    numerator: Polynomial
    denominator: Polynomial

    def __call__(self, z: Any) -> Any:
        return self.numerator(z) / self.denominator(z)


def stability_function(method: Method) -> StabilityFunction:
    """Stability function R(z) of a one-step method. Raises InputError for a method without a known one."""
    if method.butcher is None:
        raise InputError(f"{method.name}: no stability function is known for this method")
    return stability_function_of(*method.butcher)


def stability_function_of(a: Matrix, b: Sequence[float] | Floats) -> StabilityFunction:
    """R(z) = det(I - z A + z 1 b^T) / det(I - z A) of a full tableau, ``a`` (s, s) and ``b`` (s,).

    Computed exactly from the rounded coefficients. Source: Hairer & Wanner 1996, (IV.3.3).
    """
    exact = [[Fraction(float(entry)) for entry in row] for row in a]
    weights = [Fraction(float(entry)) for entry in b]
    less = [[entry - weight for entry, weight in zip(row, weights, strict=True)] for row in exact]
    return StabilityFunction(_determinant(less), _determinant(exact))


def real_interval(method: Method | StabilityFunction) -> float:
    """Largest x such that |R| <= 1 from -x to 0; infinite without a bound."""
    numerator, denominator = (p(Polynomial([0.0, -1.0])) for p in _stability_function(method))
    return _reach(numerator, denominator, _sizes(numerator) + _sizes(denominator))


def imaginary_interval(method: Method | StabilityFunction) -> float:
    """Largest y such that |R| <= 1 from -i y to i y; infinite without a bound."""
    (numerator, sizes), (denominator, others) = map(_squared_on_imaginary_axis, _stability_function(method))
    return math.sqrt(_reach(numerator, denominator, sizes + others))


def stability_interval(splitting: Splitting) -> float:
    """Largest omega dt up to which a splitting's steps on the oscillator stay bounded.

    Exactly at the edge, |trace| = 2, they may grow in proportion to time. Multiple time steps resonate if the kicks of
    the slow forces come twice in a fast period, at omega dt = pi (Biesiadecki & Skeel 1993,
    doi:10.1006/jcph.1993.1220). So no word with groups has a larger interval.
    """
    half = half_trace(splitting)
    own = math.sqrt(_reach(half, Polynomial([1.0]), _sizes(half)))
    return min(own, math.pi) if splitting.groups else own


def half_trace(splitting: Splitting) -> Polynomial:
    """Half the trace of the propagation matrix of (x, dt v) on the oscillator, in powers of (omega dt)^2.

    The oscillator's force is in group 0, if the word has groups.

    The eigenvalues lie on the unit circle where its absolute value is below one, as the determinant is one.
    """
    trace = [Fraction(0)]
    for start in (0, 1):  # the columns of the matrix: images of x = 1, v = 0 and of x = 0, v = 1
        x, v = [Fraction(1 - start)], [Fraction(start)]
        for letter, weight in zip(splitting.letters, map(Fraction, splitting.weights), strict=True):
            if letter in (KICK, KICK + "0"):
                v = _add(v, -weight, [Fraction(0), *x])  # dt^2 a = -(omega dt)^2 x
            elif letter == DRIFT:
                x = _add(x, weight, v)
        trace = _add(trace, Fraction(1), v if start else x)
    return Polynomial([float(entry / 2) for entry in trace]).trim()


def _stability_function(method: Method | StabilityFunction) -> StabilityFunction:
    return stability_function(method) if isinstance(method, Method) else method


def _add(p: list[Fraction], factor: Fraction, q: list[Fraction]) -> list[Fraction]:
    """Return p + factor q, as coefficients."""
    size = max(len(p), len(q))
    p, q = p + [Fraction(0)] * (size - len(p)), q + [Fraction(0)] * (size - len(q))
    return [c + factor * d for c, d in zip(p, q, strict=True)]


def _determinant(matrix: list[list[Fraction]]) -> Polynomial:
    """Determinant det(I - z M) by the recurrence of Faddeev and Le Verrier (Gantmacher 1959, IV.5).

    All divisions are exact in integers: every double is an integer over a common power of two.
    """
    scale = math.lcm(*(entry.denominator for row in matrix for entry in row))
    whole = [[int(entry * scale) for entry in row] for row in matrix]
    coefficients = [1]
    product = [[0] * len(whole) for _ in whole]
    for k in range(1, len(whole) + 1):
        for i, row in enumerate(product):
            row[i] += coefficients[-1]
        columns = list(zip(*product, strict=True))
        product = [[sum(map(mul, row, column)) for column in columns] for row in whole]
        coefficients.append(-sum(row[i] for i, row in enumerate(product)) // k)
    return Polynomial([float(Fraction(c, scale**k)) for k, c in enumerate(coefficients)]).trim()


def _squared_on_imaginary_axis(p: Polynomial) -> tuple[Polynomial, Polynomial]:
    """Return |p(i y)|^2 in powers of y^2, and for each coefficient the sum of its terms' absolute values."""
    signs = np.array([1, 1, -1, -1])[np.arange(len(p.coef)) % 4]
    even, odd = np.zeros((2, len(p.coef)))
    even[::2], odd[1::2] = (signs * p.coef)[::2], (signs * p.coef)[1::2]
    square = np.convolve(even, even) + np.convolve(odd, odd)
    sizes = np.convolve(abs(even), abs(even)) + np.convolve(abs(odd), abs(odd))
    return Polynomial(square[::2]), Polynomial(sizes[::2])


def _sizes(p: Polynomial) -> Polynomial:
    return Polynomial(np.abs(p.coef))


def _reach(numerator: Polynomial, denominator: Polynomial, sizes: Polynomial) -> float:
    """First x > 0 beyond which |numerator / denominator|, one at x = 0, exceeds one.

    Between its extremes and poles the quotient is monotone, so only these intervals and the last need a check. At x = 0
    the first coefficient of the difference decides that is larger than the rounding of terms of ``sizes``.
    """
    difference = [float(c) for c in (numerator - denominator).coef]
    clear = [c for c, size in zip(difference, map(float, sizes.coef), strict=False) if abs(c) > ROUNDING * size]
    if not clear:
        return math.inf
    if clear[0] > 0.0:
        return 0.0

    def excess(x: float, rounded: float = 0.0) -> float:
        below = abs(denominator(x))
        return (abs(numerator(x)) - rounded * sizes(x)) / below - 1.0 if below > 0.0 else math.inf

    turning = numerator.deriv() * denominator - numerator * denominator.deriv()
    roots = np.concatenate([turning.trim().roots(), denominator.trim().roots()])
    low = 0.0
    for x in sorted(float(x) for x in roots.real if x > 0.0):  # of complex roots too: an extra point does no harm
        if excess(x, HORNER) > TOUCHING:
            return _crossing(excess, low, x)
        low = x
    degrees = numerator.degree() - denominator.degree()
    if degrees < 0 or (degrees == 0 and abs(numerator.coef[-1]) <= (1.0 + TOUCHING) * abs(denominator.coef[-1])):
        return math.inf
    x = max(2.0 * low, 1.0)
    while excess(x, HORNER) <= TOUCHING:
        x *= 2.0
    return _crossing(excess, low, x)


def _crossing(excess: Callable[[float], float], low: float, high: float) -> float:
    """Point where it becomes positive, to the last bit."""
    while low < (middle := (low + high) / 2) < high:
        low, high = (low, middle) if excess(middle) > 0.0 else (middle, high)
    return low

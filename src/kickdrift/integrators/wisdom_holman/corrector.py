"""Symplectic correctors of the Wisdom-Holman map."""

from fractions import Fraction
from functools import cache
from itertools import pairwise
from math import factorial, sqrt

import numpy as np

from kickdrift.model.state import Floats


@cache
def corrector(order: int, mirrored: bool = False) -> Floats:
    """Drifts, and the kicks after each, of a symplectic corrector (2, 2 K + 1).

    They map a state to one for which leapfrog has an error of order dt^(order + 1) in the terms linear in the planets'
    masses. Backwards, with every sign changed, they undo this.

    To first order in B leapfrog is exp(dt A + (x / 2) / sinh(x / 2) dt B), with x the commutator with dt A. Conjugation
    by exp(W) subtracts [dt A, W], so W = w(x) dt B with w = ((x / 2) / sinh(x / 2) - 1) / x makes it exact. W consists
    of drifts by a, kicks by b and drifts by -a, each of them exp(b e^(a x) dt B), in pairs of (a, b) and (-a, -b). The
    pairs match the odd powers of x: K = (order - 1) / 2 of them by as many pairs with a = k sqrt(7 / 40) (Wisdom,
    Holman & Touma 1996; Wisdom 2006, doi:10.1086/500829).

    The product of these exponentials also has a term quadratic in B. Its energy error of order dt^3 is below those of
    the standard kernel, and above those of the other kernels. ``mirrored`` takes half of each kick, and all of them
    again in reverse order: (2, 4 K). A palindrome has no quadratic term, since -B in place of B inverts it.
    """
    count = (order - 1) // 2
    # sinh(x / 2) / (x / 2), and its inverse, by powers of x^2.
    sinh = [Fraction(1, 4**m * factorial(2 * m + 1)) for m in range(count + 1)]
    inverse = [Fraction(1)]
    for m in range(1, count + 1):
        inverse.append(-sum((sinh[j] * inverse[m - j] for j in range(1, m + 1)), Fraction(0)))
    # sum over k of 2 b_k (k alpha)^(2 m - 1) / (2 m - 1)! = inverse[m], for b_k = c_k / alpha
    rows = [
        [2 * Fraction(k ** (2 * m - 1)) * Fraction(7, 40) ** (m - 1) for k in range(1, count + 1)]
        + [inverse[m] * factorial(2 * m - 1)]
        for m in range(1, count + 1)
    ]
    alpha = sqrt(7 / 40)
    found = [(sign * k * alpha, sign * float(c) / alpha) for k, c in enumerate(_solved(rows), 1) for sign in (1, -1)]
    if mirrored:
        half = [(at, 0.5 * kick) for at, kick in found[:-1]]
        found = [*half, found[-1], *reversed(half)]
    places = [0.0, *(at for at, _ in found), 0.0]
    return np.array([[after - before for before, after in pairwise(places)], [*(kick for _, kick in found), 0.0]])


def _solved(rows: list[list[Fraction]]) -> list[Fraction]:
    """Solution of a square linear system with its right side in the last column, by Gauss-Jordan elimination."""
    count = len(rows)
    for k in range(count):
        rows[k] = [value / rows[k][k] for value in rows[k]]
        for j in range(count):
            if j != k:
                rows[j] = [a - rows[j][k] * b for a, b in zip(rows[j], rows[k], strict=True)]
    return [row[count] for row in rows]


def undone(row: Floats) -> Floats:
    """Drifts and kicks that undo those of ``row`` (2, n), which begins and ends with a drift."""
    return np.array([-row[0, ::-1], [*(-row[1, -2::-1]), 0.0]])

"""Gauss-Radau collocation of order 15: the nodes, and all numbers that follow from them.

Within a step of length h from t on, let s = (t' - t) / h. The acceleration (or the derivative of a first-order problem)
is the polynomial a(s) = c_0 + c_1 s + … + c_7 s^7 through its values at s = 0 and at the seven other nodes of Gauss'
quadrature with one fixed end (Radau 1880, J. Math. Pures Appl. 6, 283). Velocities and positions are its integrals,
exact to order 15 at the step's end (Hairer, Nørsett & Wanner 1993, II.7, theorem 7.9, doi:10.1007/978-3-540-78862-1;
Everhart 1985, doi:10.1007/978-94-009-5400-7_17).
"""

from decimal import Decimal, localcontext
from functools import cache
from math import comb
from typing import NamedTuple

import numpy as np

from kickdrift.model.state import Floats

STAGES = 8  # nodes, including the step's start


DIGITS = 50  # digits of the nodes during their computation


class Tables(NamedTuple):
    """Tables of the compiled loop. Rows belong to nodes 1 to 7 and, as an eighth, to the step's end s = 1.

    Attributes
    ----------
    nodes : (8,) s
    values : (8, 8) weights of c_0 … c_7 in a(s)
    velocities : (8, 8) in the integral of a from 0 to s, over s
    positions : (8, 8) in the second integral, over s^2
    corrections : (7, 8) contribution to c_0 … c_7 of the polynomial's error at a node, which leaves the values at
        earlier nodes unchanged
    values_low, velocities_low, positions_low : rounding errors of those weights
    gains : (2, 7) change of values and positions at the following node per unit of a node's error (after the last
        node comes the first)
    shifts : (8, 8) j over k in row k: (1 + s)^j = sum_k shifts_kj s^k
    """

    nodes: Floats
    values: Floats
    velocities: Floats
    positions: Floats
    values_low: Floats
    velocities_low: Floats
    positions_low: Floats
    corrections: Floats
    gains: Floats
    shifts: Floats


def nodes(digits: int = DIGITS) -> tuple[Decimal, ...]:
    """The eight nodes in [0, 1), the first 0: zeros of the 7th derivative of s^8 (s - 1)^7 (Hairer & Wanner 1996,
    IV.5, Radau I, doi:10.1007/978-3-642-05221-7)."""
    with localcontext() as context:
        context.prec = digits + 20
        # s^8 (s - 1)^7 = sum_k C(7, k) (-1)^(7 - k) s^(8 + k), seven times differentiated, without its zero at s = 0
        factors = [(-1) ** (7 - k) * comb(7, k) * comb(8 + k, 7) for k in range(STAGES)]
        found = []
        for estimate in sorted(np.roots(factors[::-1]).real):
            s = Decimal(float(estimate))
            for _ in range(8):  # Newton's method doubles the digits, from ten
                value = slope = Decimal(0)
                for factor in factors[::-1]:
                    slope = slope * s + value
                    value = value * s + factor
                s -= value / slope
            found.append(s)
        return (Decimal(0), *(+s for s in found))


@cache
def tables() -> Tables:
    """Numbers of the loop, from the nodes in float64. Positions and values at instants 1e-17 apart would make the
    energy drift by 1e-19 a step; the nodes' own rounding does no harm."""
    with localcontext() as context:
        context.prec = DIGITS
        s = [Decimal(float(node)) for node in nodes()]
        ends = (*s[1:], Decimal(1))
        corrections = []
        product = [Decimal(1)]  # coefficients of s (s - s_1) … (s - s_(k - 1)), from the lowest power on
        for k in range(1, STAGES):
            product = [a - s[k - 1] * b for a, b in zip([Decimal(0), *product], [*product, Decimal(0)], strict=True)]
            value = sum(factor * s[k] ** power for power, factor in enumerate(product))
            corrections.append([factor / value for factor in product] + [Decimal(0)] * (STAGES - 1 - k))
        weights = [[[end**j / ways for j, ways in enumerate(row)] for end in ends] for row in _WAYS]
        gains = [
            [_product(table[(k + 1) % (STAGES - 1)], row) for k, row in enumerate(corrections)]
            for table in weights[::2]
        ]
        low = [[[weight - Decimal(float(weight)) for weight in row] for row in table] for table in weights]
    shifts = [[comb(j, k) for j in range(STAGES)] for k in range(STAGES)]
    others = (*weights, *low, corrections, gains, shifts)
    return Tables(np.array(s, float), *(np.array(table, float) for table in others))


def _product(one: list[Decimal], other: list[Decimal]) -> Decimal:
    return sum((a * b for a, b in zip(one, other, strict=True)), Decimal(0))


_WAYS = (
    [1] * STAGES,
    [j + 1 for j in range(STAGES)],
    [(j + 1) * (j + 2) for j in range(STAGES)],
)  # divisors of the single and the double integral of s^j

"""Solution of Kepler's problem: relative position and velocity of two bodies after a given time, for every conic.

The method uses universal variables (Stumpff 1962; Conway & Prussing 1993; Rein & Tamayo 2015, section 2.2,
doi:10.1093/mnras/stv1257): r0 = |x|, eta = x . v, beta = 2 GM / r0 - v^2, zeta = GM - beta r0. X grows by dt / r and is
the root of

    r0 X + eta G2 + zeta G3 = dt,    G_n = X^n c_n(beta X^2),    c_n(z) = sum over k of (-z)^k / (n + 2 k)!

The left side grows with X (its slope is the distance r), so there is one root. All of this works on numbers, ``Lanes``
and duals. Only numbers have the safe way, a bracketed root, if the fast way does not converge.

A term below half a unit of the last place joins the other small terms first. Added alone to a rounded sum, it is lost
every time. So is the rest that the rounded coefficients 1 / 3! and 1 / 4! lose. The energy of a planet then drifts
linearly, not as the root of the steps.
"""

import math
from typing import Any, NamedTuple

import numpy as np
from numba import types

from kickdrift.jit.compile import as_written, in_order, inlined, jit
from kickdrift.jit.inner import by_type
from kickdrift.jit.lanes import law_operators as law_operators  # the product of two vectors
from kickdrift.jit.lanes.functions import inverse_sqrt_estimate, lanes_like, multiply_add
from kickdrift.jit.lanes.masks import any_lane, select
from kickdrift.jit.lanes.vector3 import dot

SERIES = 0.7  # largest |beta X^2| for which eight terms of the series reach round-off; beyond, X is halved
SETTLED = 1e-9  # square of the last correction, relative to the scale of X, that leaves an error below 1e-17
TRIES = 12  # attempts in lanes, before single numbers take over
TRIES_ONE = 200  # attempts for the bracketed root: bisection alone needs some 60

# 1 / 2!, 1 / 4!, … and 1 / 3!, 1 / 5!, …
C2 = tuple(1.0 / math.factorial(2 * k + 2) for k in range(8))
C3 = tuple(1.0 / math.factorial(2 * k + 3) for k in range(8))
LOST3, LOST2 = 2.0**-54 / 6.0, 2.0**-54 / 24.0  # what 1 / 3! and 1 / 4! of the series lose when they are rounded


class Universal(NamedTuple):
    """G0 to G3 at one X."""

    g0: float
    g1: float
    g2: float
    g3: float


@as_written
def stumpff(z):
    """c2 and c3 at a small z = beta x^2, summed in pairs."""
    a, b, z2 = C2, C3, z * z
    c2 = (a[0] - z * a[1]) + z2 * ((a[2] - z * a[3]) + z2 * ((a[4] - z * a[5]) + z2 * (a[6] - z * a[7])))
    c3 = (b[0] - z * b[1]) + z2 * ((b[2] - z * b[3]) + z2 * ((b[4] - z * b[5]) + z2 * (b[6] - z * b[7])))
    return c2, c3


@in_order
def small_g(beta, x, z):
    """G0 to G3 at x for small z = beta x^2."""
    c2, c3 = stumpff(z)
    x2 = x * x
    g2, g3 = x2 * c2, (x2 * x) * c3
    return Universal(1.0 - beta * g2, x - beta * g3, g2, g3)


@inlined
def doubled(beta, g):
    """G0 to G3 at 2 X from their values at X. No two large numbers are subtracted."""
    g2 = 2.0 * g.g1 * g.g1
    return Universal(1.0 - beta * g2, 2.0 * g.g0 * g.g1, g2, 2.0 * (g.g3 + g.g1 * g.g2))


@in_order
def shifted(beta, g, d):
    """G0 to G3 at X + d for a small d, by Taylor's series: dG_n / dX = G_(n-1), dG_0 / dX = -beta G_1."""
    curl = beta * g.g1
    g3 = g.g3 + d * (g.g2 + d * (0.5 * g.g1 + d * ((1.0 / 6.0) * g.g0)))
    g2 = g.g2 + d * (g.g1 + d * (0.5 * g.g0 - d * ((1.0 / 6.0) * curl)))
    g1 = g.g1 + d * (g.g0 - d * (0.5 * curl + d * ((1.0 / 6.0) * (beta * g.g0))))
    return Universal(1.0 - beta * g2, g1, g2, g3)


@inlined
def correction(beta, r0, eta, zeta, dt, x, g):
    """Correction of x from the inverse of the equation's Taylor series about x, to the fourth order. Also its square,
    in units of the length over which the series changes."""
    excess = r0 * x + eta * g.g2 + zeta * g.g3 - dt
    r = r0 + eta * g.g1 + zeta * g.g2
    slope, bend = eta * g.g0 + zeta * g.g1, zeta * g.g0 - beta * eta * g.g1  # dr / dX and its derivative
    inverse = 1.0 / r
    p, a, b = -excess * inverse, 0.5 * slope * inverse, (1.0 / 6.0) * bend * inverse
    d = p * (1.0 - p * (a - p * (2.0 * a * a - b)))
    size = p * p * (4.0 * a * a + abs(bend * inverse) + abs(beta)) + 0.0 * (excess + r)  # nan on overflow
    return d, size


@inlined
def laguerre(r0, eta, zeta, dt, x, g):
    """Correction of x by Laguerre's method of degree 5, which converges from anywhere, though more slowly (Conway 1986,
    doi:10.1007/BF01230852)."""
    excess = r0 * x + eta * g.g2 + zeta * g.g3 - dt
    r, slope = r0 + eta * g.g1 + zeta * g.g2, eta * g.g0 + zeta * g.g1
    return -5.0 * excess / (r + math.sqrt(abs(16.0 * r * r - 20.0 * excess * slope)))


@inlined
def first_guess(beta, r0_inverse, eta, zeta, dt):
    """X to the fourth order in dt."""
    s, a, b = dt * r0_inverse, eta * r0_inverse, zeta * r0_inverse
    a2 = a * a
    c3, c4 = 0.5 * a2 - (1.0 / 6.0) * b, a * ((5.0 / 12.0) * b - 0.625 * a2 + (1.0 / 24.0) * beta)
    return s * (1.0 - s * (0.5 * a - s * (c3 + s * c4)))


@inlined
def lagrange(gm, dt, r0, r0_inverse, eta, zeta, g):
    """f - 1, g, df/dt and dg/dt - 1: the new position is f x + g v, the new velocity df/dt x + dg/dt v."""
    r_inverse = 1.0 / (r0 + eta * g.g1 + zeta * g.g2)
    gm_over_r0 = gm * r0_inverse
    return -gm_over_r0 * g.g2, dt - gm * g.g3, -gm_over_r0 * r_inverse * g.g1, -gm * r_inverse * g.g2


# --- eight at a time ---


@in_order
def small_lanes_g(beta, x, z):
    """G0 to G3 at x for small z = beta x^2, in lanes. Fused sums take what the rounded coefficients lose. After a
    rounded product this rest would be lost every time."""
    c2, c3 = stumpff(z)
    x2 = x * x
    x3 = x2 * x
    g2, g3 = multiply_add(x2, c2, (0.0 - LOST2) * (z * x2)), multiply_add(x3, c3, LOST3 * x3)
    return Universal(1.0 - beta * g2, x - beta * g3, g2, g3)


@as_written
def distances(x):
    """1 / |x| and |x|. The series of (1 - e)^(-1/2), e = 1 - r2 y^2, has one term more than that of ``inverse_sqrt``:
    that term is positive always, and its loss let the energy drift."""
    r2 = dot(x, x)
    y = inverse_sqrt_estimate(r2)
    e = 1.0 - (r2 * y) * y
    inverse = y + (y * e) * ((0.5 + 0.375 * e) + (e * e) * (0.3125 + (35.0 / 128.0) * e))
    return inverse, r2 * inverse


@inlined
def lanes_g(beta, x):
    """G0 to G3 at x, in lanes."""
    z = beta * x * x
    if any_lane(abs(z) > SERIES):
        return halved_lanes_g(beta, x)
    return small_lanes_g(beta, x, z)


@jit
def halved_lanes_g(beta, x):
    """The same for large x, halved as often as each lane needs. A lane's bits do not depend on its neighbours."""
    part, z, halvings = x, beta * x * x, 0
    while any_lane(abs(z) > SERIES) and halvings < 12:
        large = abs(z) > SERIES
        z, part = select(large, 0.25 * z, z), select(large, 0.5 * part, part)
        halvings += 1
    g = small_lanes_g(beta, part, z)
    for _ in range(halvings):
        undone = abs(part) < 0.75 * abs(x)
        part = select(undone, 2.0 * part, part)
        twice = doubled(beta, g)
        g = Universal(
            select(undone, twice.g0, g.g0),
            select(undone, twice.g1, g.g1),
            select(undone, twice.g2, g.g2),
            select(undone, twice.g3, g.g3),
        )
    return g


@inlined
def lanes_solution(gm, beta, r0, r0_inverse, eta, zeta, dt):
    """G0 to G3 at the root, and the mask of the converged lanes. Lanes with steps of half a period or more do not
    converge."""
    x = first_guess(beta, r0_inverse, eta, zeta, dt)
    g = lanes_g(beta, x)
    d, size = correction(beta, r0, eta, zeta, dt, x, g)
    near = size < SETTLED
    if any_lane(size >= SETTLED):
        for _ in range(TRIES):
            x = select(size < SETTLED, x, x + laguerre(r0, eta, zeta, dt, x, g))
            g = lanes_g(beta, x)
            d, size = correction(beta, r0, eta, zeta, dt, x, g)
            near = size < SETTLED
            if not any_lane(size >= SETTLED):
                break
    return shifted(beta, g, d), near & (dt * dt * beta * beta * beta < 9.8 * gm * gm)


# --- one at a time ---


@jit
def one_g(beta, x):
    """G0 to G3 at x."""
    z, part, halvings = beta * x * x, x, 0
    while abs(z) > SERIES and halvings < 2000:
        z, part = 0.25 * z, 0.5 * part
        halvings += 1
    g = small_g(beta, part, z)
    for _ in range(halvings):
        g = doubled(beta, g)
    return g


@jit
def one_solution(gm, beta, r0, eta, zeta, dt):
    """G0 to G3 at the root for dt >= 0, within a bracket."""
    low, high = 0.0, np.inf
    if beta > 0.0:
        high = 2.001 * math.pi / math.sqrt(beta)
    x = dt / r0
    if x * x * (eta * eta / (r0 * r0) + abs(zeta) / r0 + abs(beta)) < 1.0:
        x = first_guess(beta, 1.0 / r0, eta, zeta, dt)
    elif not x < high:
        x = 0.5 * high
    g = one_g(beta, x)
    for k in range(1, TRIES_ONE + 1):
        excess = r0 * x + eta * g.g2 + zeta * g.g3 - dt
        if not excess <= 0.0:  # also nan on overflow
            high = x
        else:
            low = x
        d, size = correction(beta, r0, eta, zeta, dt, x, g)
        if size < SETTLED:
            return shifted(beta, g, d)
        if high < np.inf and high - low <= 4e-16 * high:
            return g
        x += laguerre(r0, eta, zeta, dt, x, g)
        # Far out on a hyperbola the left side is an exponential, and Laguerre's method descends by 5/3 an attempt.
        if not low < x < high or (k % 8 == 0 and high < np.inf):
            x = 0.5 * (low + high) if high < np.inf else 2.0 * max(low, dt / r0)
        g = one_g(beta, x)
    return g


@by_type
def solution(gm, beta, r0, eta, zeta, dt):
    """G0 to G3 at the root for dt >= 0. ``tangent_drift`` has the form for duals."""
    return one_solution.py_func if isinstance(gm, types.Float) else None


@jit
def kepler_increments(gm, dt, x, v):
    """Changes of the relative position x and velocity v of two bodies of G (m1 + m2) = gm over a time dt.

    Takes vectors of numbers or of duals, every conic and any dt of either sign. Returns two vectors. An orbit that ends
    in r = 0 passes through it and returns. The error is some units of rounding times the spread of the motion: a
    position that is one rounding off moves along its orbit.
    """
    r0, eta = math.sqrt(x @ x), x @ v
    beta = 2.0 * gm / r0 - v @ v
    zeta = gm - beta * r0
    ahead: Any = dt
    if beta > 0.0:
        period = 2.0 * math.pi * gm / (beta * math.sqrt(beta))
        if abs(ahead) > 0.5 * period:
            ahead = ahead - period * math.floor(ahead / period + 0.5)
    sign = -1.0 if ahead < 0.0 else 1.0
    ahead, eta = sign * ahead, sign * eta
    g = solution(gm, beta, r0, eta, zeta, ahead)
    f1, g_, fdot, gdot1 = lagrange(gm, ahead, r0, 1.0 / r0, eta, zeta, g)
    return f1 * x + (sign * g_) * v, (sign * fdot) * x + gdot1 * v


@inlined
def lanes_increments(gm, dt, x, v):
    """The same for eight at a time, with ``dt`` a number or eight. Returns the two vectors of changes, beta, and the
    mask of the solved lanes; the other lanes are for ``kepler_increments``."""
    inverse, r0 = distances(x)
    beta, eta = 2.0 * gm * inverse - dot(v, v), dot(x, v)
    zeta = gm - beta * r0
    ahead = lanes_like(dt, r0)
    g, solved = lanes_solution(gm, beta, r0, inverse, eta, zeta, ahead)
    f1, g_, fdot, gdot1 = lagrange(gm, ahead, r0, inverse, eta, zeta, g)
    return f1 * x + g_ * v, fdot * x + gdot1 * v, beta, solved

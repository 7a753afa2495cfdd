"""The orbit of a pair: exact Kepler motion in equal parts of the eccentric anomaly, and kicks by the tides of others.

With the fictitious time X, dX = dt / r, the motion of a pair under tides f is r' = r v, v' = r (Kepler's term + f) and
t' = r. Without f, the end of a step in X is explicit, by the functions of universal variables (Stumpff 1962). So the
step is a splitting into this motion and kicks (McLachlan 1995), and pericentres need no shorter steps. The error
carries the strength of the tides as a factor.
"""

import math

from kickdrift.integrators.hermite.pairs.table import COUNT, PARTS, SINGLE
from kickdrift.integrators.hermite.stepper import JERK, A, V, X
from kickdrift.integrators.wisdom_holman.kepler import kepler_increments, lagrange, one_g, one_solution
from kickdrift.jit.compile import inlined, jit, never_inline
from kickdrift.jit.lanes import law_operators as law_operators  # the product of two vectors
from kickdrift.jit.lanes.vector3 import cross, dot, numbers3, store3, vector3


@inlined
def relative(orbit, p):
    """Place and velocity of the pair's second body from the first."""
    count = orbit.shape[1]
    return numbers3(orbit, p, count), numbers3(orbit, 3 * count + p, count)


@inlined
def keep(orbit, p, r, v):
    """Store the two."""
    count = orbit.shape[1]
    store3(orbit, p, count, r)
    store3(orbit, 3 * count + p, count, v)


@jit
def bound_orbit(gm, r, v):
    """2 |energy| per reduced mass, semi-major axis and eccentricity; the axis is infinite unless the pair is bound."""
    never_inline()
    beta = 2.0 * gm / math.sqrt(dot(r, r)) - dot(v, v)
    if not beta > 0.0:
        return beta, math.inf, 1.0
    spin = cross(r, v)
    return beta, gm / beta, math.sqrt(max(0.0, 1.0 - dot(spin, spin) * beta / (gm * gm)))


@jit
def place(bodies, i, time):
    """Position of a slot by its series, up to the jerk, as `predict` has it."""
    series, n, s = bodies.series, bodies.times.size, time - bodies.times[i]
    a, jerk = numbers3(series, 3 * A * n + i, n), numbers3(series, 3 * JERK * n + i, n)
    return numbers3(series, 3 * X * n + i, n) + s * (
        numbers3(series, 3 * V * n + i, n) + (s / 2.0) * (a + (s / 3.0) * jerk)
    )


@inlined
def difference(d, share, r):
    """Attraction by a unit of G m at a distance d from the pair's centre of mass, on the second body less the first."""
    one, other = d + share * r, d - (1.0 - share) * r
    inverse1, inverse2 = 1.0 / math.sqrt(dot(one, one)), 1.0 / math.sqrt(dot(other, other))
    return (inverse2 * inverse2 * inverse2) * other - (inverse1 * inverse1 * inverse1) * one


@jit
def row_of(pairs, first):
    """Row of the pair with this first body, or SINGLE."""
    row = SINGLE
    if pairs.partner[first] > first:
        for p in range(pairs.tally[COUNT]):
            if pairs.bodies[0, p] == first:
                row = p
    return row


@jit
def tide(bodies, pairs, p, time, r):
    """Acceleration of the second body from the first by the pair's neighbours, of which pairs have two bodies."""
    first, second = pairs.bodies[0, p], pairs.bodies[1, p]
    gm = bodies.sources.gm
    share = pairs.gm[second] / gm[first]
    centre, total = place(bodies, first, time), vector3(0.0, 0.0, 0.0)
    for k in range(pairs.nears[p]):
        b = pairs.near[p, k]
        if gm[b] > 0.0:
            d, q = place(bodies, b, time) - centre, row_of(pairs, b)
            if q == SINGLE:
                total = total + gm[b] * difference(d, share, r)
            else:
                s, v = relative(pairs.orbit, q)
                moved, _ = kepler_increments(gm[b], time - bodies.times[b], s, v)
                s = s + moved
                one = pairs.gm[b]
                other = gm[b] - one
                total = total + one * difference(d - (other / gm[b]) * s, share, r)
                total = total + other * difference(d + (one / gm[b]) * s, share, r)
    return total


@jit
def flow(gm, x, r, v):
    """Kepler's motion over a fictitious time x. Return place, velocity and the time."""
    r0, eta = math.sqrt(dot(r, r)), dot(r, v)
    beta = 2.0 * gm / r0 - dot(v, v)
    zeta = gm - beta * r0
    g = one_g(beta, x)
    dt = r0 * x + eta * g.g2 + zeta * g.g3
    f1, g_, fdot, gdot1 = lagrange(gm, dt, r0, 1.0 / r0, eta, zeta, g)
    return r + f1 * r + g_ * v, v + fdot * r + gdot1 * v, dt


@jit
def fictitious(gm, dt, r, v):
    """Fictitious time of Kepler's motion over a time dt, from zero to less than a period."""
    r0, eta = math.sqrt(dot(r, r)), dot(r, v)
    beta = 2.0 * gm / r0 - dot(v, v)
    g = one_solution(gm, beta, r0, eta, gm - beta * r0, dt)
    return g.g1 + beta * g.g3


@jit
def part(bodies, pairs, p, gm, x, sign, time, r, v):
    """Take a step of the splitting. Return place, velocity and time, which falls with the ``sign`` -1."""
    never_inline()
    drifts, kicks = pairs.drifts, pairs.kicks
    r, v, dt = flow(gm, drifts[0] * x, r, v)
    time += sign * dt
    for k in range(kicks.size):
        v = v + (kicks[k] * x * math.sqrt(dot(r, r))) * tide(bodies, pairs, p, time, r)
        r, v, dt = flow(gm, drifts[k + 1] * x, r, v)
        time += sign * dt
    return r, v, time


@jit
def follow(bodies, pairs, p, end):
    """now <- the pair's orbit at the time ``end``, after the time of the first body's slot or before."""
    never_inline()
    first = pairs.bodies[0, p]
    gm, time = bodies.sources.gm[first], bodies.times[first]
    sign = 1.0 if end >= time else -1.0
    r, v = relative(pairs.orbit, p)
    v = sign * v
    beta, axis, e = bound_orbit(gm, r, v)
    acting = False
    for k in range(pairs.nears[p]):
        acting = acting or bodies.sources.gm[pairs.near[p, k]] > 0.0
    if acting and beta > 0.0:
        x = 2.0 * math.pi / (math.sqrt(beta) * PARTS)
        longest = 1.1 * x * axis * (1.0 + e)  # of the time of a part
        while sign * (end - time) > longest:
            r, v, time = part(bodies, pairs, p, gm, x, sign, time, r, v)
        if sign * (end - time) > 0.0:
            rest = fictitious(gm, sign * (end - time), r, v)
            parts = math.ceil(rest / x)
            for _ in range(parts):
                r, v, time = part(bodies, pairs, p, gm, rest / parts, sign, time, r, v)
    moved, kicked = kepler_increments(gm, sign * (end - time), r, v)  # what tides made of the last time, or all of it
    keep(pairs.now, p, r + moved, sign * (v + kicked))


@jit
def drift(bodies, pairs, p, end):
    """now <- the pair's orbit at a time, by Kepler's motion alone."""
    never_inline()
    first = pairs.bodies[0, p]
    r, v = relative(pairs.orbit, p)
    moved, kicked = kepler_increments(bodies.sources.gm[first], end - bodies.times[first], r, v)
    keep(pairs.now, p, r + moved, v + kicked)

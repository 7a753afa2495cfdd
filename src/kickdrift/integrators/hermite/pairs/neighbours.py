"""Neighbours of a pair, which feel its two bodies, and what these add to the attraction of the centre of mass."""

import math

from kickdrift.integrators.hermite.pairs.orbit import bound_orbit, relative, row_of
from kickdrift.integrators.hermite.pairs.table import FELT, NEAR, SINGLE
from kickdrift.jit.compile import inlined, jit, never_inline
from kickdrift.jit.lanes import law_operators as law_operators  # the product of two vectors
from kickdrift.jit.lanes.vector3 import dot, numbers3, store3


@inlined
def rests(pairs, i):
    """Tell whether a body is the second of a pair."""
    return 0 <= pairs.partner[i] < i


@jit
def strength_of(bodies, pairs, first, second, gm, centre, reach):
    """Sum of 2 m / M (reach / distance)^3 over all bodies but two, from where they are now."""
    never_inline()
    sources, total = bodies.sources, 0.0
    slots = sources.gm.size
    for b in range(bodies.times.size):
        if b != first and b != second and sources.gm[b] > 0.0:
            d = numbers3(sources.x, b, slots) - centre
            near = reach * reach / dot(d, d)
            total += (2.0 * sources.gm[b] / gm) * (near * math.sqrt(near))
    return total


@jit
def find_neighbours(bodies, pairs, p):
    """List the bodies that the pair feels, or that feel its bodies, and sum the pair's strength."""
    never_inline()
    first, second, sources = pairs.bodies[0, p], pairs.bodies[1, p], bodies.sources
    gm, slots = sources.gm[first], sources.gm.size
    r, v = relative(pairs.orbit, p)
    _, axis, e = bound_orbit(gm, r, v)
    reach, centre = axis * (1.0 + e), numbers3(sources.x, first, slots)
    pairs.strength[p] = strength_of(bodies, pairs, first, second, gm, centre, reach)
    limit, count = FELT, NEAR + 1
    while count > NEAR:  # of too many, keep the strongest
        count = 0
        for b in range(bodies.times.size):
            if b != first and b != second and not rests(pairs, b):
                d = numbers3(sources.x, b, slots) - centre
                near = reach * reach / dot(d, d)
                if max(2.0 * sources.gm[b] / gm, 1.0) * (near * math.sqrt(near)) > limit:
                    if count < NEAR:
                        pairs.near[p, count] = b
                    count += 1
        limit *= 2.0
    pairs.nears[p] = count


@jit
def attraction(d, u):
    """Acceleration and jerk by a unit of G m, at a distance d and with a velocity u from it."""
    inverse2 = 1.0 / dot(d, d)
    w = inverse2 * math.sqrt(inverse2)
    return -w * d, w * ((3.0 * inverse2 * dot(d, u)) * d - u)


@inlined
def by_two(pairs, p, gm, d, u):
    """Acceleration and jerk by the two bodies of a pair, at a distance d and with a velocity u from its centre."""
    r, v = relative(pairs.now, p)
    one = pairs.gm[pairs.bodies[0, p]]
    other = gm - one
    a1, slope1 = attraction(d + (other / gm) * r, u + (other / gm) * v)
    a2, slope2 = attraction(d - (one / gm) * r, u - (one / gm) * v)
    return one * a1 + other * a2, one * slope1 + other * slope2


@jit
def is_near(pairs, p, b):
    """Tell whether a body is a neighbour of the pair."""
    near = False
    for k in range(pairs.nears[p]):
        near = near or pairs.near[p, k] == b
    return near


@jit
def resolve(bodies, pairs, p):
    """Add to accelerations and jerks of the moving neighbours what the pair's two bodies make of its centre of mass,
    and to those of the moving pair the reaction. Of two pairs that are neighbours, the first adds what all four bodies
    make of both."""
    never_inline()
    sources, first = bodies.sources, pairs.bodies[0, p]
    slots, n, gm = sources.gm.size, sources.a.shape[1], sources.gm[first]
    centre, motion = numbers3(sources.x, first, slots), numbers3(sources.u, first, slots)
    for k in range(pairs.nears[p]):
        b = pairs.near[p, k]
        if not (pairs.moves[b] or pairs.moves[first]):
            continue
        q = row_of(pairs, b)
        both = q != SINGLE and is_near(pairs, q, first)
        if both and q < p:
            continue
        d, u = numbers3(sources.x, b, slots) - centre, numbers3(sources.u, b, slots) - motion
        whole, slope = attraction(d, u)
        if both:
            r, v = relative(pairs.now, q)
            one = pairs.gm[b] / sources.gm[b]
            other = 1.0 - one
            a1, jerk1 = by_two(pairs, p, gm, d - other * r, u - other * v)
            a2, jerk2 = by_two(pairs, p, gm, d + one * r, u + one * v)
            a, jerk = one * a1 + other * a2 - gm * whole, one * jerk1 + other * jerk2 - gm * slope
        else:
            a, jerk = by_two(pairs, p, gm, d, u)
            a, jerk = a - gm * whole, jerk - gm * slope
        if pairs.moves[b]:
            store3(sources.a, b, n, numbers3(sources.a, b, n) + a)
            store3(sources.slope, b, n, numbers3(sources.slope, b, n) + jerk)
        if pairs.moves[first]:
            share = sources.gm[b] / gm
            store3(sources.a, first, n, numbers3(sources.a, first, n) - share * a)
            store3(sources.slope, first, n, numbers3(sources.slope, first, n) - share * jerk)


@jit
def is_felt(pairs, p):
    """Tell whether the present step moves a neighbour of the pair."""
    felt = False
    for k in range(pairs.nears[p]):
        felt = felt or pairs.moves[pairs.near[p, k]] > 0
    return felt

"""Formation and break-up of pairs at the end of a step."""

import math

import numpy as np

from kickdrift.integrators.hermite.pairs.neighbours import find_neighbours, resolve, rests, strength_of
from kickdrift.integrators.hermite.pairs.orbit import bound_orbit, drift, keep, relative
from kickdrift.integrators.hermite.pairs.table import (
    AXIS,
    BREAK,
    BREAKS,
    BROKEN,
    COUNT,
    DISTANCE,
    ECCENTRICITY,
    FORM,
    FORMED,
    FORMS,
    KIND,
    LOGGED,
    ONE,
    OTHER,
    SEARCHES,
    SINGLE,
    STEP,
    TIME,
)
from kickdrift.integrators.hermite.stepper import JERK, NOW, TAKEN, A, V, X, attract, length, predict
from kickdrift.jit.compile import jit, never_inline
from kickdrift.jit.lanes import law_operators as law_operators  # the product of two vectors
from kickdrift.jit.lanes.vector3 import dot, numbers3, store3


@jit
def note(bodies, pairs, p, clock, kind):
    """Write a change to the log."""
    never_inline()
    row = pairs.log[pairs.tally[LOGGED]]
    pairs.tally[LOGGED] += 1
    pairs.tally[FORMED if kind == FORM else BROKEN] += 1
    first, second = pairs.bodies[0, p], pairs.bodies[1, p]
    gm = pairs.gm[first] + pairs.gm[second]
    r, v = relative(pairs.orbit, p)
    _, axis, e = bound_orbit(gm, r, v)
    row[TIME], row[STEP], row[KIND], row[ONE], row[OTHER] = clock[NOW], clock[TAKEN], kind, first, second
    row[AXIS], row[ECCENTRICITY] = axis, e
    row[DISTANCE] = math.sqrt(dot(r, r))


@jit
def series_of(bodies, i):
    """Position and velocity of a slot at its own time."""
    n = bodies.times.size
    return numbers3(bodies.series, 3 * X * n + i, n), numbers3(bodies.series, 3 * V * n + i, n)


@jit
def put(bodies, i, x, v):
    """Start the series of a slot anew, and put the slot there."""
    never_inline()
    n, slots = bodies.times.size, bodies.sources.gm.size
    bodies.series[:, :, i] = 0.0
    store3(bodies.series, 3 * X * n + i, n, x)
    store3(bodies.series, 3 * V * n + i, n, v)
    store3(bodies.sources.x, i, slots, x)
    store3(bodies.sources.u, i, slots, v)


@jit
def partner_of(bodies, pairs, i, end):
    """Return the body with which body i can form a pair at the time ``end``, or SINGLE: its nearest neighbour, at the
    end of a step too, on a bound orbit that others hardly disturb."""
    never_inline()
    sources = bodies.sources
    slots, least, best = sources.gm.size, np.inf, SINGLE
    at = numbers3(sources.x, i, slots)
    for b in range(bodies.times.size):
        if b != i and not rests(pairs, b):
            d = numbers3(sources.x, b, slots) - at
            if dot(d, d) < least:
                least, best = dot(d, d), b
    if best == SINGLE or pairs.partner[best] != SINGLE or bodies.times[best] != end:
        return SINGLE
    gm = sources.gm[i] + sources.gm[best]
    (x, v), (y, w) = series_of(bodies, i), series_of(bodies, best)
    _, axis, e = bound_orbit(gm, y - x, w - v)
    if not (axis < np.inf and gm > 0.0):
        return SINGLE
    share = sources.gm[best] / gm
    reach = axis * (1.0 + e)
    return best if strength_of(bodies, pairs, i, best, gm, x + share * (y - x), reach) < FORMS else SINGLE


@jit
def may_pair(bodies, pairs, i, time):
    """Tell whether body i searches for a partner at a time: at the end of some of its steps."""
    searches = time / (SEARCHES * bodies.steps[i])
    return bodies.times[i] == time and pairs.partner[i] == SINGLE and searches == math.floor(searches)


@jit
def form(bodies, pairs, i, j, clock):
    """Let two bodies move as a pair."""
    never_inline()
    first, second, p = min(i, j), max(i, j), pairs.tally[COUNT]
    pairs.tally[COUNT] += 1
    pairs.bodies[0, p], pairs.bodies[1, p] = first, second
    pairs.partner[first], pairs.partner[second] = second, first
    (x, v), (y, w) = series_of(bodies, first), series_of(bodies, second)
    keep(pairs.orbit, p, y - x, w - v)
    share = pairs.gm[second] / (pairs.gm[first] + pairs.gm[second])
    x, v = x + share * (y - x), v + share * (w - v)
    put(bodies, first, x, v)
    put(bodies, second, x, v)
    bodies.sources.gm[first], bodies.sources.gm[second] = pairs.gm[first] + pairs.gm[second], 0.0
    bodies.steps[first] = min(bodies.steps[first], bodies.steps[second])
    bodies.steps[second] = np.inf
    note(bodies, pairs, p, clock, FORM)
    pairs.moves[first], pairs.moves[second] = 1, 0


@jit
def break_up(bodies, pairs, p, clock):
    """Let the bodies of a pair move as single bodies."""
    never_inline()
    first, second, last = pairs.bodies[0, p], pairs.bodies[1, p], pairs.tally[COUNT] - 1
    note(bodies, pairs, p, clock, BREAK)
    gm = bodies.sources.gm[first]
    (x, v), (r, w) = series_of(bodies, first), relative(pairs.orbit, p)
    share = pairs.gm[second] / gm
    put(bodies, first, x - share * r, v - share * w)
    put(bodies, second, x + (1.0 - share) * r, v + (1.0 - share) * w)
    for b in (first, second):
        pairs.partner[b], bodies.sources.gm[b], bodies.times[b], pairs.moves[b] = SINGLE, pairs.gm[b], clock[NOW], 1
    bodies.steps[second] = bodies.steps[first]
    pairs.tally[COUNT] = last
    for q in range(p, last):  # in the order of formation
        pairs.bodies[:, q], pairs.orbit[:, q] = pairs.bodies[:, q + 1], pairs.orbit[:, q + 1]
        pairs.nears[q], pairs.near[q] = pairs.nears[q + 1], pairs.near[q + 1]
        pairs.strength[q] = pairs.strength[q + 1]


@jit
def settle(bodies, pairs, end, eta, cursor):
    """Compute accelerations, jerks and steps of the bodies that have just changed, which ``moves`` marks."""
    never_inline()
    sources, count = bodies.sources, 0
    for i in range(bodies.times.size):
        if pairs.moves[i]:
            bodies.due[count] = i
            count += 1
    bodies.moved[0] = count
    attract(bodies, cursor)
    for p in range(pairs.tally[COUNT]):
        find_neighbours(bodies, pairs, p)
        drift(bodies, pairs, p, end)
    for p in range(pairs.tally[COUNT]):
        resolve(bodies, pairs, p)
    for k in range(count):
        i = bodies.due[k]
        bodies.series[A, :, i], bodies.series[JERK, :, i] = sources.a[:, i], sources.slope[:, i]
        a, jerk = length(bodies.series, A, i), length(bodies.series, JERK, i)
        want = eta * min(a / jerk if jerk > 0.0 else np.inf, nearest_time(bodies, pairs, i, a))
        h = bodies.steps[i]
        while h > want:
            h *= 0.5
        while 2.0 * h <= want < np.inf and end / (2.0 * h) == math.floor(end / (2.0 * h)):
            h *= 2.0
        bodies.steps[i] = h


@jit
def nearest_time(bodies, pairs, i, a):
    """Root of the distance to the nearest source over the acceleration a."""
    sources, least = bodies.sources, np.inf
    slots = sources.gm.size
    for b in range(bodies.times.size):
        if b != i and sources.gm[b] > 0.0:
            d = numbers3(sources.x, b, slots) - numbers3(sources.x, i, slots)
            least = min(least, dot(d, d))
    return math.sqrt(math.sqrt(least) / a) if a > 0.0 else np.inf


@jit
def change(bodies, pairs, clock, eta, cursor):
    """Break up and form pairs at a step point, where the steps of some bodies have ended."""
    never_inline()
    count, asked, time = pairs.tally[COUNT], False, clock[NOW]
    for p in range(count):
        asked = asked or (bodies.times[pairs.bodies[0, p]] == time and not pairs.strength[p] < BREAKS)
    for i in range(bodies.times.size):
        asked = asked or may_pair(bodies, pairs, i, time)
    if not asked:
        return
    predict(bodies, time)
    pairs.moves[:] = 0
    changes = pairs.tally[LOGGED]
    for p in range(count - 1, -1, -1):
        if bodies.times[pairs.bodies[0, p]] == time and not pairs.strength[p] < BREAKS:
            break_up(bodies, pairs, p, clock)
    for i in range(bodies.times.size):
        if not pairs.moves[i] and may_pair(bodies, pairs, i, time):
            j = partner_of(bodies, pairs, i, time)
            if j != SINGLE and not pairs.moves[j]:
                form(bodies, pairs, i, j, clock)
    if pairs.tally[LOGGED] > changes:
        settle(bodies, pairs, time, eta, cursor)

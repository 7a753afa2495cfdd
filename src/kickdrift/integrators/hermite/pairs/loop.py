"""The loop of block steps with pairs."""

from kickdrift.forces.seam.kernel import BLOWN_UP, OK
from kickdrift.integrators.hermite.pairs.changes import change
from kickdrift.integrators.hermite.pairs.neighbours import find_neighbours, is_felt, resolve
from kickdrift.integrators.hermite.pairs.orbit import drift, follow, keep, relative
from kickdrift.integrators.hermite.pairs.table import COUNT, LOGGED
from kickdrift.integrators.hermite.stepper import (
    BEFORE,
    NOW,
    START,
    TAKEN,
    are_finite,
    attract,
    block_step,
    choose_due,
    correct,
    next_end,
    predict,
    rounding,
    wanted,
)
from kickdrift.integrators.stepping.loops import STEP
from kickdrift.integrators.stepping.stepper import STOPPED
from kickdrift.jit.compile import driver, jit
from kickdrift.jit.handle import handle
from kickdrift.jit.lanes.vector3 import numbers3, store3


@jit
def limited(bodies, pairs, p, h):
    """The pair's next step: at most that of a massive neighbour, whose motion the pair must know."""
    for k in range(pairs.nears[p]):
        b = pairs.near[p, k]
        if bodies.sources.gm[b] > 0.0:
            while h > bodies.steps[b]:
                h *= 0.5
    return h


@driver
def pairs_loop(bodies, pairs, eta, clock, until, steps, cursor):
    """Move to step points as `hermite_loop` does, with pairs that form and break up. Return a status. Stop early when
    the log is nearly full."""
    bound, known = handle(bodies), handle(pairs)
    n, times, own = bound.times.size, bound.times, bound.steps
    while cursor[STEP] < steps and clock[START] + clock[NOW] < until and known.tally[LOGGED] + n < known.log.shape[0]:
        change(bound, known, clock, eta, cursor)
        end = next_end(bound)
        if not choose_due(bound, end, True) > rounding(clock[START] + clock[NOW]):
            return STOPPED
        known.moves[:] = 0
        for k in range(bound.moved[0]):
            known.moves[bound.due[k]] = 1
        predict(bound, end)
        for p in range(known.tally[COUNT]):
            if known.moves[known.bodies[0, p]]:
                follow(bound, known, p, end)
            elif is_felt(known, p):
                drift(bound, known, p, end)
        attract(bound, cursor)
        for p in range(known.tally[COUNT]):
            if known.nears[p]:
                resolve(bound, known, p)
        if not are_finite(bound):
            return BLOWN_UP
        for k in range(bound.moved[0]):
            i = bound.due[k]
            h = end - times[i]
            correct(bound, i, h)
            times[i] = end
            own[i] = block_step(end, h, wanted(bound, i, h, eta))
        for p in range(known.tally[COUNT]):
            first = known.bodies[0, p]
            if known.moves[first]:
                r, v = relative(known.now, p)
                keep(known.orbit, p, r, v)
                find_neighbours(bound, known, p)
                own[first] = limited(bound, known, p, own[first])
        clock[BEFORE], clock[NOW] = clock[NOW], end
        clock[TAKEN] += 1.0
        cursor[STEP] += 1
    return OK


@driver
def put_members(bodies, pairs, since, y):
    """Put the bodies of pairs, in y (2, 3, n) at a time since the start, on their orbits about the centres of mass."""
    bound, known = handle(bodies), handle(pairs)
    n = bound.times.size
    for p in range(known.tally[COUNT]):
        first, second = known.bodies[0, p], known.bodies[1, p]
        follow(bound, known, p, since)
        r, v = relative(known.now, p)
        share = known.gm[second] / (known.gm[first] + known.gm[second])
        x, u = numbers3(y, first, n), numbers3(y, 3 * n + first, n)
        store3(y, first, n, x - share * r)
        store3(y, 3 * n + first, n, u - share * v)
        store3(y, second, n, x + (1.0 - share) * r)
        store3(y, 3 * n + second, n, u + (1.0 - share) * v)
    return OK

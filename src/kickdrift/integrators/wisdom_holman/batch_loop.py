"""Compiled loop of the Wisdom-Holman map for eight small systems at once, one system in each lane.

The map is that of ``loop``, whose formulas cite their sources. That loop has bodies in lanes and sums
over lanes; this loop sums over bodies with plain loops.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from kickdrift.forces.bound.table import EVALUATIONS
from kickdrift.forces.gravity.batch import LaneBodies, look_in_lanes
from kickdrift.integrators.stepping.batch_loops import copy_in_lanes
from kickdrift.integrators.stepping.loops import FRESH
from kickdrift.integrators.wisdom_holman.bodies import GM, HILL, INSIDE, NEAR, OTHERS, SHARE, SOURCE, UNBOUND, WHICH
from kickdrift.integrators.wisdom_holman.flows import central_part
from kickdrift.integrators.wisdom_holman.kepler import kepler_increments, lanes_increments
from kickdrift.jit.compile import driver, in_order, jit
from kickdrift.jit.handle import handle, unowned
from kickdrift.jit.lanes.functions import inverse_sqrt, splat
from kickdrift.jit.lanes.masks import any_lane, mask_bits, select
from kickdrift.jit.lanes.memory import load, store
from kickdrift.jit.lanes.vector3 import dot, load3, numbers3, select3, store3, thrice
from kickdrift.jit.lanes.vectors import WIDTH

# Vectors of ``work``: positions from the central body, their offset from Jacobi's, the acceleration by the other
# bodies, the kick. WAY has increments solved one by one, and dt.
PLACE, OFFSET, MUTUAL, KICK = range(4)
WORK = 4
WAY = 7


class LaneOrbits(NamedTuple):
    """Eight central bodies and the bodies around them, in the order of the list."""

    orbit: NDArray[np.float64]  # (2, 3, n - 1, 8), see ``loop.Bodies``
    seen: NDArray[np.float64]  # the same, a copy for samples
    centre: NDArray[np.float64]  # (2, 3, 8) position of the centre of mass at step 0, and its velocity
    table: NDArray[np.float64]  # (ROWS, n - 1, 8)
    first: NDArray[np.float64]  # (3, n - 1, 8), infinite until it happens
    work: NDArray[np.float64]  # (WORK, 3, n - 1, 8)
    way: NDArray[np.float64]  # (WAY, 8)
    central: NDArray[np.float64]  # (8,) G m of the central body
    shares: NDArray[np.float64]  # (n - 1, 8) mass over that of all
    bodies: LaneBodies  # the central one first
    jacobi: bool


@in_order
def drift(own, orbit, dt, t, noting):
    """Move every body along its Kepler orbit for a time dt from t on. With ``noting``, record unbound bodies."""
    table, x, v, first = own.table, orbit[0], orbit[1], own.first[UNBOUND]
    stride = x[0].size
    for p in range(0, stride, WIDTH):
        moved, kicked, beta, solved = lanes_increments(load(table[GM], p), dt, load3(x, p, stride), load3(v, p, stride))
        left = mask_bits(beta == beta) & ~mask_bits(solved)  # without lanes that have blown up
        if left:
            way = own.way
            store(way, 6 * WIDTH, dt)
            one_by_one(own, orbit, p // WIDTH, left)
            moved = select3(solved, moved, load3(way, 0, WIDTH))
            kicked = select3(solved, kicked, load3(way, 3 * WIDTH, WIDTH))
        if noting and any_lane(beta <= 0.0):
            known = load(first, p)
            store(first, p, select((beta <= 0.0) & (known > t), t, known))
        add3(x, p, stride, moved)
        add3(v, p, stride, kicked)


@in_order
def add3(array, p, stride, change):
    store3(array, p, stride, load3(array, p, stride) + change)


@jit
def one_by_one(own, orbit, i, left):
    """way <- the increments of body i in the remaining lanes; nan in the others."""
    stride = orbit[0, 0].size
    for k in range(WIDTH):
        if (left >> k) & 1:
            body = i * WIDTH + k
            x, v = numbers3(orbit[0], body, stride), numbers3(orbit[1], body, stride)
            moved, kicked = kepler_increments(own.table[GM, i, k], own.way[6, k], x, v)
            store3(own.way, k, WIDTH, moved)
            store3(own.way, 3 * WIDTH + k, WIDTH, kicked)
        else:
            for row in range(6):
                own.way[row, k] = np.nan


@in_order
def places(own, x):
    """work[PLACE] <- positions from the central body, work[OFFSET] <- their difference from Jacobi's ``x``."""
    share, place, offset = own.table[SHARE], own.work[PLACE], own.work[OFFSET]
    stride = share.size
    before = thrice(splat(0.0))
    for p in range(0, stride, WIDTH):
        xi = load3(x, p, stride)
        store3(offset, p, stride, before)
        store3(place, p, stride, xi + before)
        before = before + load(share, p) * xi


@in_order
def mutual_accelerations(own, place, t):
    """work[MUTUAL] <- the mutual accelerations of the bodies except the central one, each pair once."""
    source, hill, mutual = own.table[SOURCE], own.table[HILL], own.work[MUTUAL]
    stride = source.size
    zero = splat(0.0)
    for p in range(0, mutual.size, WIDTH):
        store(mutual, p, zero)
    for p in range(0, stride - WIDTH, WIDTH):
        xi, ai = load3(place, p, stride), load3(mutual, p, stride)
        gm_i, hill_i = load(source, p), load(hill, p)
        for q in range(p + WIDTH, stride, WIDTH):
            gm_j, hill_j = load(source, q), load(hill, q)
            d = load3(place, q, stride) - xi
            r2 = dot(d, d)
            inverse = inverse_sqrt(r2)
            cube = inverse * inverse * inverse
            ai = ai + gm_j * cube * d
            store3(mutual, q, stride, load3(mutual, q, stride) - gm_i * cube * d)
            if any_lane((r2 < hill_i) | (r2 < hill_j)):
                note_near(own.first, p, q, r2 < hill_j, t)
                note_near(own.first, q, p, r2 < hill_i, t)
        store3(mutual, p, stride, ai)


@in_order
def note_near(first, p, q, near, t):
    """Record that body p came near body q in those lanes."""
    known, which = load(first[NEAR], p), load(first[WHICH], p)
    new = near & (known > t)
    store(first[NEAR], p, select(new, t, known))
    store(first[WHICH], p, select(new, splat(float(q // WIDTH)), which))


@in_order
def kick(own, h):
    """Kick by the mutual accelerations."""
    v, mutual = own.orbit[1], own.work[MUTUAL]
    stride = own.table[GM].size
    for p in range(0, stride, WIDTH):
        add3(v, p, stride, h * load3(mutual, p, stride))


@in_order
def jump(own, h):
    """Move all bodies with the central one, by the sum of the momenta."""
    x, v, share, momentum = own.orbit[0], own.orbit[1], own.table[OTHERS], thrice(splat(0.0))
    stride = share.size
    for p in range(0, stride, WIDTH):
        momentum = momentum + load(share, p) * load3(v, p, stride)
    for p in range(0, stride, WIDTH):
        add3(x, p, stride, h * momentum)


@in_order
def jacobi_kick(own, dt, t):
    """Kick in Jacobi's coordinates."""
    x, v, table, work = own.orbit[0], own.orbit[1], own.table, own.work
    stride = table[GM].size
    central = load(own.central, 0)
    places(own, x)
    mutual_accelerations(own, work[PLACE], t)
    zero = thrice(splat(0.0))
    outside = zero  # the sum of G m_j w_j over the bodies j > i
    for p in range(stride - WIDTH, -WIDTH, -WIDTH):
        w, g = central_part(load3(x, p, stride), load3(work[OFFSET], p, stride))
        gm, others, rest = load(table[GM], p), load(table[OTHERS], p), load(table[INSIDE], p) * central
        store3(work[KICK], p, stride, load3(work[MUTUAL], p, stride) + gm * (g + others * w) - rest * outside)
        outside = outside + load(table[SOURCE], p) * w
    inside = zero  # the sum of G m_j p_j over the bodies j < i
    for p in range(0, stride, WIDTH):
        add3(v, p, stride, dt * (load3(work[KICK], p, stride) - load(table[INSIDE], p) * inside))
        inside = inside + load(table[SOURCE], p) * load3(work[MUTUAL], p, stride)


@in_order
def leave(own, orbit, y, elapsed):
    """y (2, 3, n, 8) <- positions and velocities with the central body first, at a time ``elapsed`` after step 0."""
    n = y.shape[2]
    stride, end = (n - 1) * WIDTH, n * WIDTH
    for half in range(2):
        q, target = orbit[half], y[half]
        centre = load3(own.centre[half], 0, WIDTH)
        if half == 0:
            centre = centre + elapsed * load3(own.centre[1], 0, WIDTH)
        weights = own.table[SHARE] if own.jacobi else own.shares if half == 0 else own.table[OTHERS]
        origin = centre  # the central body
        for p in range(0, stride, WIDTH):
            origin = origin - load(weights, p) * load3(q, p, stride)
        store3(target, 0, end, origin)
        if not own.jacobi and half == 1:
            origin = centre  # these velocities are relative to the centre of mass
        for p in range(0, stride, WIDTH):
            here = load3(q, p, stride)
            store3(target, p + WIDTH, end, here + origin)
            if own.jacobi:
                origin = origin + load(weights, p) * here


@driver
def batch_wisdom_holman_loop(orbits, y, weights, dt, start, done, counts, looks, cursor):
    """Take ``counts`` (k,) steps before each sample, after the ``done`` steps.

    ``weights`` (3, stages + 1) hold the row of drifts, the kick after each (0 after the last) and the elapsed fraction
    of dt. The last drift is joined to the next step's first. For each sample it is done on a copy, in ``y``.
    """
    own = handle(orbits)
    y, weights, counts = unowned(y), unowned(weights), unowned(counts)
    looks, cursor = unowned(looks), unowned(cursor)
    step, begin = load(unowned(dt), 0), load(unowned(start), 0)
    drifts, kicks, passed = weights[0], weights[1], weights[2]
    stages = drifts.size - 1
    for k in range(counts.size):
        for _ in range(counts[k]):
            for stage in range(stages):
                t = begin + (float(done) + passed[stage]) * step
                length = drifts[stage]
                if stage == 0 and cursor[FRESH]:
                    length += drifts[stages]
                drift(own, own.orbit, length * step, t, True)
                if own.jacobi:
                    jacobi_kick(own, kicks[stage] * step, t)
                else:
                    mutual_accelerations(own, own.orbit[0], t)
                    kick(own, kicks[stage] * step)
                    jump(own, kicks[stage] * step)
            cursor[FRESH] = 1
            cursor[EVALUATIONS] += stages
            done += 1
        if cursor[FRESH]:
            copy_in_lanes(own.seen, own.orbit)
            elapsed = float(done) * step
            drift(own, own.seen, drifts[stages] * step, begin + elapsed, False)
            leave(own, own.seen, y, elapsed)
        look_in_lanes(own.bodies, y[0], y[1], looks[k])

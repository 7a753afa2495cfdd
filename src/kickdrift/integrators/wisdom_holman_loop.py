"""Compiled loop of the Wisdom-Holman map: Kepler drifts and interaction kicks, eight bodies at a time.

``y' = A + B``, with A the Kepler motion of every body and B the rest of the Hamiltonian. The rows of drift and kick
weights are as in any splitting. Bodies around the central one are in lanes, massive ones first. The massive and the
massless are each padded to a multiple of eight with massless bodies on distant circles, which feel nothing.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from kickdrift.forces.evaluate import EVALUATIONS, fill_accelerations
from kickdrift.forces.kernel import BLOWN_UP, OK
from kickdrift.integrators.kepler import kepler_increments, lanes_increments
from kickdrift.integrators.loops import FRESH, STAGE, STEP
from kickdrift.jit.compile import driver, inlined, is_finite, jit
from kickdrift.jit.handle import handle, unowned
from kickdrift.jit.lanes import inverse_sqrt, lane_numbers, minus, plus, rotated, splat, sums_before
from kickdrift.jit.masks import any_lane, mask_bits, select
from kickdrift.jit.memory import load, store
from kickdrift.jit.vector3 import dot, lane_sums, load3, numbers3, select3, store3, thrice, vector3
from kickdrift.jit.vectors import WIDTH

# Rows of ``table``: GM of the Kepler motion; G m; the body's share m_i / M_i of the mass up to it; 1 / (G M_(i-1)), for
# the mass inside; the others' share of that mass, 1 - m_0 / M_(i-1) (in heliocentric coordinates m_i / m_0); 1 for a
# body, 0 for padding; Hill radius squared.
GM, SOURCE, SHARE, INSIDE, OTHERS, LIVE, HILL = range(7)
ROWS = 7
# Rows of ``work``: positions from the central body; their offset from Jacobi's; the acceleration by the other bodies;
# the acceleration by the central one per G m_0; the terms of both for the sums; the last three are increments solved
# one by one.
PLACE, OFFSET, PULL, STAR, WAY = 0, 3, 6, 9, 12
WORK = 18
# Rows of ``first``: times when a body was first unbound and first near another, and which other (a slot).
UNBOUND, NEAR, WHICH = range(3)

SELF = 1e300  # a squared distance without attraction


class Bodies(NamedTuple):
    """Central body and the bodies around it.

    ``orbit`` holds three rows of positions and three of velocities. They are Jacobi's (each body from the centre of
    mass of the central one and the massive ones before it), or democratic heliocentric (positions from the central
    body, velocities from the centre of mass).
    """

    orbit: NDArray[np.float64]  # (6, slots)
    carry: NDArray[np.float64]  # (6, slots), carries of compensated sums; (6, 0) for plain sums
    centre: NDArray[np.float64]  # (5, 8) position and velocity of the centre of mass, their rounding errors; work
    table: NDArray[np.float64]  # (ROWS, slots)
    inside: NDArray[np.int64]  # (slots,) number of massive bodies before a massless one
    first: NDArray[np.float64]  # (3, slots)
    work: NDArray[np.float64]  # (WORK, slots)
    massive: int  # slots of bodies with mass
    jacobi: bool
    order: NDArray[np.int64]  # (slots,) particle in each slot; -1 for padding
    central: int  # particle of the central body
    gm: float  # G m of the central body
    shares: NDArray[np.float64]  # (n,) masses of all particles over their sum
    x: NDArray[np.float64]  # (2, 3, n) positions for forces other than gravity, and velocities, always 0
    a: NDArray[np.float64]  # (3, n) accelerations by these forces


# --- sums ---


@inlined
def add_lanes(bodies, p, change):
    """Add change to eight numbers of ``orbit``, compensated if ``carry`` has room (see ``loops.add_compensated``)."""
    orbit, carry = bodies.orbit, bodies.carry
    before = load(orbit, p)
    if carry.size:
        increment = plus(load(carry, p), change)
        after = plus(before, increment)
        store(orbit, p, after)
        store(carry, p, plus(increment, minus(before, after)))
    else:
        store(orbit, p, before + change)


@inlined
def add_vectors(bodies, row, b, change):
    """Add change to eight vectors likewise, in three rows from ``row`` on."""
    n = bodies.orbit.shape[1]
    p = row * n + b
    add_lanes(bodies, p, change.x)
    add_lanes(bodies, p + n, change.y)
    add_lanes(bodies, p + 2 * n, change.z)


@inlined
def sums_before3(vector):
    """Apply ``sums_before`` to each component."""
    return vector3(sums_before(vector.x), sums_before(vector.y), sums_before(vector.z))


@inlined
def add_centre(centre, row, change):
    """Compensated centre[row] += change."""
    position, lost = centre[row], centre[row + 2]
    before = load(position, 0)
    increment = plus(load(lost, 0), change)
    after = plus(before, increment)
    store(position, 0, after)
    store(lost, 0, plus(increment, minus(before, after)))


# --- drifts ---


@inlined
def drift(bodies, dt, t):
    """Move every body along its Kepler orbit for a time dt from t on, and the centre of mass along its line. Return a
    status."""
    orbit, table, work = bodies.orbit, bodies.table, bodies.work
    n = orbit.shape[1]
    for b in range(0, n, WIDTH):
        gm = load(table[GM], b)
        moved, kicked, beta, solved = lanes_increments(gm, dt, load3(orbit, b, n), load3(orbit, 3 * n + b, n))
        done = mask_bits(solved)
        if done != 255:
            if one_by_one(bodies, dt, b, done) != OK:
                return BLOWN_UP
            moved = select3(solved, moved, load3(work, WAY * n + b, n))
            kicked = select3(solved, kicked, load3(work, (WAY + 3) * n + b, n))
        if any_lane(beta <= 0.0):
            note_unbound(bodies, b, mask_bits(beta <= 0.0), t)
        add_vectors(bodies, 0, b, moved)
        add_vectors(bodies, 3, b, kicked)
    add_centre(bodies.centre, 0, dt * load(bodies.centre[1], 0))
    return OK


@jit
def one_by_one(bodies, dt, b, done):
    """Compute the increments of the unsolved lanes in ``work``. Return a status."""
    orbit, work = bodies.orbit, bodies.work
    n = orbit.shape[1]
    for i in range(b, b + WIDTH):
        if not (done >> (i - b)) & 1:
            x, v = numbers3(orbit, i, n), numbers3(orbit, 3 * n + i, n)
            moved, kicked = kepler_increments(bodies.table[GM, i], dt, x, v)
            store3(work, WAY * n + i, n, moved)
            store3(work, (WAY + 3) * n + i, n, kicked)
            total = moved.x + moved.y + moved.z + kicked.x + kicked.y + kicked.z
            if not is_finite(total):
                return BLOWN_UP
    return OK


@jit
def note_unbound(bodies, b, lanes, t):
    first = bodies.first
    for k in range(WIDTH):
        if (lanes >> k) & 1 and np.isnan(first[UNBOUND, b + k]):
            first[UNBOUND, b + k] = t


@jit
def note_near(bodies, place, b, t):
    """Record which of these eight bodies are within the Hill radius of which others."""
    first, hill, n = bodies.first, bodies.table[HILL], bodies.orbit.shape[1]
    for i in range(b, b + WIDTH):
        if bodies.table[LIVE, i] == 0.0 or not np.isnan(first[NEAR, i]):
            continue
        for j in range(bodies.massive):
            d = numbers3(place, j, n) - numbers3(place, i, n)
            if j != i and dot(d, d) < hill[j]:
                first[NEAR, i], first[WHICH, i] = t, j
                break


# --- kicks ---


@inlined
def places(bodies):
    """work[PLACE] <- positions from the central body, work[OFFSET] <- their difference from Jacobi's: the sum of m_j /
    M_j times Jacobi's position over the massive bodies j before."""
    orbit, table, work, inside = bodies.orbit, bodies.table, bodies.work, bodies.inside
    n, before = orbit.shape[1], thrice(0.0)
    for b in range(0, bodies.massive, WIDTH):
        x = load3(orbit, b, n)
        part = load(table[SHARE], b) * x
        offset = sums_before3(part) + before
        store3(work, OFFSET * n + b, n, offset)
        store3(work, PLACE * n + b, n, x + offset)
        if b + WIDTH < bodies.massive or n > bodies.massive:
            before = before + lane_sums(part)
    for i in range(bodies.massive, orbit.shape[1]):
        j = inside[i]
        for k in range(3):
            offset = 0.0
            if j > 0:
                offset = work[OFFSET + k, j - 1] + table[SHARE, j - 1] * orbit[k, j - 1]
            work[OFFSET + k, i], work[PLACE + k, i] = offset, orbit[k, i] + offset


@inlined
def pulls(bodies, place, b, t):
    """Accelerations of eight bodies at ``place`` by the massive bodies other than the central one."""
    if bodies.massive == WIDTH and b == 0:
        a, near = ring_pulls(bodies, place)
    else:
        a, near = pulls_one_by_one(bodies, place, b)
    if any_lane(near):
        note_near(bodies, place, b, t)
    return a


@inlined
def ring_pulls(bodies, place):
    """Mutual accelerations of eight bodies, each pair once, as in ``gravity_kernel.ring``. Also tells whether any pair
    is within a Hill radius."""
    gm_i, hill_i = load(bodies.table[SOURCE], 0), load(bodies.table[HILL], 0)
    here = load3(place, 0, bodies.orbit.shape[1])
    xi, yi, zi = here.x, here.y, here.z
    zero = splat(0.0)
    ax, ay, az, reaction_x, reaction_y, reaction_z = zero, zero, zero, zero, zero, zero
    xj, yj, zj, gm_j, hill_j = xi, yi, zi, gm_i, hill_i
    near = zero > 1.0
    for turn in range(4):
        xj, yj, zj = rotated(xj, 1), rotated(yj, 1), rotated(zj, 1)
        gm_j, hill_j = rotated(gm_j, 1), rotated(hill_j, 1)
        reaction_x, reaction_y, reaction_z = rotated(reaction_x, 1), rotated(reaction_y, 1), rotated(reaction_z, 1)
        dx, dy, dz = xj - xi, yj - yi, zj - zi
        r2 = dx * dx + dy * dy + dz * dz
        near = near | (r2 < hill_i) | (r2 < hill_j)
        inverse = inverse_sqrt(r2)
        cube = inverse * inverse * inverse
        w = gm_j * cube
        ax, ay, az = ax + w * dx, ay + w * dy, az + w * dz
        if turn < 3:
            w = gm_i * cube
            reaction_x, reaction_y, reaction_z = reaction_x - w * dx, reaction_y - w * dy, reaction_z - w * dz
    return vector3(ax + rotated(reaction_x, 4), ay + rotated(reaction_y, 4), az + rotated(reaction_z, 4)), near


@inlined
def pulls_one_by_one(bodies, place, b):
    """Accelerations of any eight, by each massive body."""
    source, hill, n = bodies.table[SOURCE], bodies.table[HILL], bodies.orbit.shape[1]
    x, zero = load3(place, b, n), splat(0.0)
    a, near = thrice(zero), zero > 1.0
    for j in range(bodies.massive):
        d = numbers3(place, j, n) - x
        r2 = select(lane_numbers() == float(j - b), splat(SELF), dot(d, d))
        near = near | (r2 < hill[j])
        inverse = inverse_sqrt(r2)
        a = a + source[j] * inverse * inverse * inverse * d
    return a, near


@inlined
def kick_velocities(bodies, b, dt, a):
    live = load(bodies.table[LIVE], b) > 0.0
    add_vectors(bodies, 3, b, select3(live, dt * a, thrice(splat(0.0))))


@inlined
def jump(bodies, dt):
    """Move every body with the central one, by the sum of the momenta over its mass (Duncan, Levison & Lee 1998,
    doi:10.1086/300541)."""
    orbit, share, move = bodies.orbit, bodies.table[OTHERS], thrice(0.0)
    n = orbit.shape[1]
    for b in range(0, bodies.massive, WIDTH):
        move = move + lane_sums(load(share, b) * load3(orbit, 3 * n + b, n))
    for b in range(0, n, WIDTH):
        add_vectors(bodies, 0, b, splat(dt) * move)


@inlined
def heliocentric_kick(bodies, dt, t):
    """Kick by the other bodies alone; the central one's attraction is in the Kepler motion."""
    for b in range(0, bodies.orbit.shape[1], WIDTH):
        kick_velocities(bodies, b, dt, pulls(bodies, bodies.orbit, b, t))


@inlined
def central_part(place, offset):
    """Parts of the central body's attraction for bodies at r' + offset from it, r' = ``place``.

    Returns w, the attraction there per G m_0, against r'. Also returns r' / r'^3 - r / r^3, the attraction of the mass
    inside from its centre minus that from the central body. It follows from their small quotient by Encke's method
    (Battin 1999, eq. 8.62 ff., doi:10.2514/4.861543).
    """
    there = place + offset
    before2 = dot(place, place)
    before, now = inverse_sqrt(before2), inverse_sqrt(dot(there, there))
    inverse3, star = before * before * before, now * now * now
    ratio = before2 * before * now  # r' / r
    ratio3 = ratio * ratio * ratio
    q = dot(offset, place + there) * (before * before)  # r^2 / r'^2 - 1
    lost = q * (3.0 + q * (3.0 + q)) * (ratio3 * ratio3 / (1.0 + ratio3))  # 1 - (r' / r)^3
    return star * there, inverse3 * lost * place - star * offset


@inlined
def jacobi_kick(bodies, dt, t):
    """Kick in Jacobi's coordinates (Rein & Tamayo 2015, eq. 9, doi:10.1093/mnras/stv1257).

    With w the central body's attraction on a body per G m_0 and p that of the others, body i feels

        G M_i (r' / r'^3 - w_i) + G (M_i - m_0 M_i / M_(i-1)) w_i + p_i - A_i,
        A_i = (m_0 sum over j > i of G m_j w_j + sum over 0 < j < i of m_j p_j) / M_(i-1),

    This is the acceleration from the centre of the mass inside, minus the Kepler motion's, without a difference of two
    large numbers. By Newton's third law the forces within the mass inside cancel, and they are left out.
    """
    orbit, table, work, inside = bodies.orbit, bodies.table, bodies.work, bodies.inside
    slots, massive = orbit.shape[1], bodies.massive
    places(bodies)
    central, total = bodies.gm, thrice(0.0)
    for b in range(0, slots, WIDTH):
        pull = pulls(bodies, work, b, t)
        w, g = central_part(load3(orbit, b, slots), load3(work, OFFSET * slots + b, slots))
        gm, others = load(table[GM], b), load(table[OTHERS], b)
        if b < massive:
            source = load(table[SOURCE], b)
            store3(work, STAR * slots + b, slots, source * (pull - central * w))
            weighted = source * w
            total = total + lane_sums(weighted)
            store3(work, WAY * slots + b, slots, weighted)
        store3(work, PULL * slots + b, slots, pull + gm * (g + others * w))
    total = central * total
    start = total
    for b in range(0, massive, WIDTH):
        star, rest = load3(work, STAR * slots + b, slots), load(table[INSIDE], b)
        felt = sums_before3(star) + total - central * load3(work, WAY * slots + b, slots)
        if slots > massive:  # massless bodies, whose sums also include the last body before them
            store3(work, STAR * slots + b, slots, sums_before3(star) + star + total)
        kick_velocities(bodies, b, dt, load3(work, PULL * slots + b, slots) - rest * felt)
        if b + WIDTH < massive:
            total = total + lane_sums(star)
    for i in range(massive, slots):
        if table[LIVE, i] > 0.0:
            j = inside[i]
            felt = numbers3(work, STAR * slots + j - 1, slots) if j > 0 else start
            place = PULL * slots + i
            store3(work, place, slots, numbers3(work, place, slots) - table[INSIDE, i] * felt)
    for b in range(massive, slots, WIDTH):
        kick_velocities(bodies, b, dt, load3(work, PULL * slots + b, slots))


# --- other forces ---


@jit
def fill_positions(bodies):
    """bodies.x[0] <- the particles' positions."""
    orbit, work, order, x, shares = bodies.orbit, bodies.work, bodies.order, bodies.x[0], bodies.shares
    if bodies.jacobi:
        places(bodies)
    place = work[PLACE : PLACE + 3] if bodies.jacobi else orbit[:3]
    for k in range(3):
        central = bodies.centre[0, k]
        for i in range(bodies.massive):
            if order[i] >= 0:
                central -= shares[order[i]] * place[k, i]
        x[k, bodies.central] = central
        for i in range(orbit.shape[1]):
            if order[i] >= 0:
                x[k, order[i]] = central + place[k, i]


@jit
def add_accelerations(bodies, dt):
    """Kick by the accelerations bodies.a, transformed to the map's coordinates."""
    orbit, work, order, a, shares = bodies.orbit, bodies.work, bodies.order, bodies.a, bodies.shares
    for k in range(3):
        mean = a[k, bodies.central]
        if not bodies.jacobi:
            mean *= shares[bodies.central]
            for i in range(bodies.massive):
                if order[i] >= 0:
                    mean += shares[order[i]] * a[k, order[i]]
        first = mean
        for i in range(orbit.shape[1]):
            if order[i] >= 0:
                if bodies.jacobi and i >= bodies.massive:
                    mean = work[WAY + k, bodies.inside[i] - 1] if bodies.inside[i] > 0 else first
                relative = a[k, order[i]] - mean
                orbit[3 + k, i] += dt * relative
                if bodies.jacobi and i < bodies.massive:
                    mean += bodies.table[SHARE, i] * relative
                    work[WAY + k, i] = mean
        bodies.centre[4, k] = 0.0
        for i in range(shares.size):
            bodies.centre[4, k] += shares[i] * a[k, i]
    add_centre(bodies.centre, 1, dt * load(bodies.centre[4], 0))


@jit
def fill_others(forces, bodies, t, cursor):
    """bodies.a <- the accelerations by forces other than gravity. Return a status."""
    fill_positions(bodies)
    status = fill_accelerations(forces, t, bodies.x[0], bodies.x[1], bodies.a, None, cursor)
    cursor[EVALUATIONS] -= 1  # the kick counts
    return status


# --- steps ---


@driver
def wisdom_holman_loop(forces, bodies, stages, dt, start, first, steps, cursor):
    """Apply the row of drifts (``stages[0]``), each followed by its kick (``stages[1]``), ``steps`` times.
    ``stages[2]`` is the fraction of dt at the kick. ``forces`` are the forces other than gravity; the rest is as in
    ``loops``."""
    bound, others = handle(bodies), handle(forces)
    stages, cursor = unowned(stages), unowned(cursor)
    drifts, kicks, passed = stages[0], stages[1], stages[2]
    with_jump, others_act = not bodies.jacobi, others.table.shape[0] > 0
    while cursor[STEP] < steps:
        for stage in range(cursor[STAGE], kicks.size):
            t = start + (first + cursor[STEP] + passed[stage]) * dt
            h = kicks[stage] * dt
            if not cursor[FRESH]:
                if drifts[stage] != 0.0:
                    status = drift(bound, drifts[stage] * dt, t)
                    if status != OK:
                        cursor[STAGE] = stage
                        return status
                if with_jump and h != 0.0 and others_act:
                    jump(bound, 0.5 * h)
                cursor[FRESH] = 1
            if h != 0.0:
                if others_act:
                    status = fill_others(others, bound, t, cursor)
                    if status != OK:
                        cursor[STAGE] = stage
                        return status
                if with_jump:
                    heliocentric_kick(bound, h, t)
                else:
                    jacobi_kick(bound, h, t)
                if others_act:
                    add_accelerations(bound, h)
                if with_jump:
                    jump(bound, 0.5 * h if others_act else h)
                cursor[EVALUATIONS] += 1
            cursor[FRESH] = 0
        cursor[STAGE] = 0
        cursor[STEP] += 1
    return OK

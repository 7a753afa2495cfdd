"""The compiled loop of the Wisdom-Holman map: Kepler drifts and interaction kicks, eight bodies at a time.

``y' = A + B``, A the Kepler motion of every body and B what is left of the Hamiltonian; the rows of drift and kick
weights are those of any splitting. Bodies around the central one stand in lanes, massive ones first; those with mass
and those without are each filled up to a multiple of eight with massless ones on circles far out, which feel nothing.
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
from kickdrift.jit.lanes import inverse_sqrt, lane_numbers, lane_sum, minus, plus, rotated, splat, sums_before
from kickdrift.jit.masks import any_lane, mask_bits, select
from kickdrift.jit.memory import load, store
from kickdrift.jit.vectors import WIDTH

# Rows of ``table``: GM of the Kepler motion; G m; the body's share m_i / M_i of the mass up to it; 1 / (G M_(i-1)), of
# the mass inside; the others' share of that, 1 - m_0 / M_(i-1) (in
# heliocentric coordinates m_i / m_0); 1 for a body, 0 for what fills up; Hill radius squared.
GM, SOURCE, SHARE, INSIDE, OTHERS, LIVE, HILL = range(7)
ROWS = 7
# Rows of ``work``: positions from the central body; their offset from Jacobi's; the pull of the other bodies; the pull
# of the central one per G m_0; what of both to sum; the next three are increments solved one by one.
PLACE, OFFSET, PULL, STAR, WAY = 0, 3, 6, 9, 12
WORK = 18
# Rows of ``first``: when a body was first unbound, when first near another, and which (a slot).
UNBOUND, NEAR, WHICH = range(3)

SELF = 1e300  # a squared distance at which nothing pulls


class Bodies(NamedTuple):
    """A central body and those around it.

    ``orbit`` holds three rows of positions and three of velocities: Jacobi's (each body from the centre of mass of the
    central one and the massive ones before it), or democratic heliocentric (positions from the central body, velocities
    from the centre of mass).
    """

    orbit: NDArray[np.float64]  # (6, slots)
    carry: NDArray[np.float64]  # (6, slots), of compensated sums; (6, 0) for plain ones
    centre: NDArray[np.float64]  # (5, 8) position, velocity of the centre of mass, what their rounding lost; work
    table: NDArray[np.float64]  # (ROWS, slots)
    inside: NDArray[np.int64]  # (slots,) how many massive bodies stand before a massless one
    first: NDArray[np.float64]  # (3, slots)
    work: NDArray[np.float64]  # (WORK, slots)
    massive: int  # slots of bodies with mass
    jacobi: bool
    order: NDArray[np.int64]  # (slots,) which particle; -1 for what fills up
    central: int  # likewise
    gm: float  # G m of the central body
    shares: NDArray[np.float64]  # (n,) masses of all particles over their sum
    x: NDArray[np.float64]  # (2, 3, n) positions as forces other than gravity take them, and velocities, left at 0
    a: NDArray[np.float64]  # (3, n) what they give


# --- sums ---


@inlined
def add_lanes(bodies, row, b, change):
    """orbit[row] += change in eight lanes, compensated where ``carry`` has room (see ``loops.add_compensated``)."""
    orbit, carry = bodies.orbit[row], bodies.carry[row]
    before = load(orbit, b)
    if carry.size:
        increment = plus(load(carry, b), change)
        after = plus(before, increment)
        store(orbit, b, after)
        store(carry, b, plus(increment, minus(before, after)))
    else:
        store(orbit, b, before + change)


@inlined
def add_centre(centre, row, change):
    """centre[row] += change, compensated."""
    position, lost = centre[row], centre[row + 2]
    before = load(position, 0)
    increment = plus(load(lost, 0), change)
    after = plus(before, increment)
    store(position, 0, after)
    store(lost, 0, plus(increment, minus(before, after)))


# --- drifts ---


@inlined
def drift(bodies, dt, t):
    """Every body along its Kepler orbit for a time dt that begins at t, the centre of mass along its line; a status."""
    orbit, table, work = bodies.orbit, bodies.table, bodies.work
    for b in range(0, orbit.shape[1], WIDTH):
        gm = load(table[GM], b)
        moved, kicked, beta, solved = lanes_increments(
            gm, dt, load(orbit[0], b), load(orbit[1], b), load(orbit[2], b), load(orbit[3], b), load(orbit[4], b),
            load(orbit[5], b),
        )  # fmt: skip
        done = mask_bits(solved)
        if done != 255:
            if one_by_one(bodies, dt, b, done) != OK:
                return BLOWN_UP
            way = work[WAY:]
            moved = (
                select(solved, moved[0], load(way[0], b)),
                select(solved, moved[1], load(way[1], b)),
                select(solved, moved[2], load(way[2], b)),
            )
            kicked = (
                select(solved, kicked[0], load(way[3], b)),
                select(solved, kicked[1], load(way[4], b)),
                select(solved, kicked[2], load(way[5], b)),
            )
        if any_lane(beta <= 0.0):
            note_unbound(bodies, b, mask_bits(beta <= 0.0), t)
        add_lanes(bodies, 0, b, moved[0])
        add_lanes(bodies, 1, b, moved[1])
        add_lanes(bodies, 2, b, moved[2])
        add_lanes(bodies, 3, b, kicked[0])
        add_lanes(bodies, 4, b, kicked[1])
        add_lanes(bodies, 5, b, kicked[2])
    add_centre(bodies.centre, 0, dt * load(bodies.centre[1], 0))
    return OK


@jit
def one_by_one(bodies, dt, b, done):
    """The increments of the lanes that are not done, in ``work``; a status."""
    orbit, table, way = bodies.orbit, bodies.table, bodies.work[WAY:]
    for k in range(WIDTH):
        i = b + k
        if not (done >> k) & 1:
            increments = kepler_increments(
                table[GM, i], dt, orbit[0, i], orbit[1, i], orbit[2, i], orbit[3, i], orbit[4, i], orbit[5, i]
            )
            total = 0.0
            for row in range(6):
                way[row, i] = increments[row]
                total += increments[row]
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
    """Which bodies of these eight are within the Hill radius of which others."""
    first, hill = bodies.first, bodies.table[HILL]
    for i in range(b, b + WIDTH):
        if bodies.table[LIVE, i] == 0.0 or not np.isnan(first[NEAR, i]):
            continue
        for j in range(bodies.massive):
            dx, dy, dz = place[0, j] - place[0, i], place[1, j] - place[1, i], place[2, j] - place[2, i]
            if j != i and dx * dx + dy * dy + dz * dz < hill[j]:
                first[NEAR, i], first[WHICH, i] = t, j
                break


# --- kicks ---


@inlined
def places(bodies):
    """work[PLACE] <- positions from the central body, work[OFFSET] <- what Jacobi's differ from them by, which is the
    sum of m_j / M_j times Jacobi's position over the massive bodies j before."""
    orbit, table, work, inside = bodies.orbit, bodies.table, bodies.work, bodies.inside
    sums_x, sums_y, sums_z = 0.0, 0.0, 0.0
    for b in range(0, bodies.massive, WIDTH):
        share = load(table[SHARE], b)
        x, y, z = load(orbit[0], b), load(orbit[1], b), load(orbit[2], b)
        px, py, pz = share * x, share * y, share * z
        ox, oy, oz = sums_before(px) + sums_x, sums_before(py) + sums_y, sums_before(pz) + sums_z
        store(work[OFFSET], b, ox)
        store(work[OFFSET + 1], b, oy)
        store(work[OFFSET + 2], b, oz)
        store(work[PLACE], b, x + ox)
        store(work[PLACE + 1], b, y + oy)
        store(work[PLACE + 2], b, z + oz)
        if b + WIDTH < bodies.massive or orbit.shape[1] > bodies.massive:
            sums_x, sums_y, sums_z = sums_x + lane_sum(px), sums_y + lane_sum(py), sums_z + lane_sum(pz)
    for i in range(bodies.massive, orbit.shape[1]):
        j = inside[i]
        for k in range(3):
            offset = 0.0
            if j > 0:
                offset = work[OFFSET + k, j - 1] + table[SHARE, j - 1] * orbit[k, j - 1]
            work[OFFSET + k, i], work[PLACE + k, i] = offset, orbit[k, i] + offset


@inlined
def pulls(bodies, place, b, t):
    """The acceleration that the massive bodies other than the central one give to eight bodies at ``place``."""
    if bodies.massive == WIDTH and b == 0:
        ax, ay, az, near = ring_pulls(bodies, place)
    else:
        ax, ay, az, near = pulls_one_by_one(bodies, place, b)
    if any_lane(near):
        note_near(bodies, place, b, t)
    return ax, ay, az


@inlined
def ring_pulls(bodies, place):
    """The same of eight bodies among themselves, each pair once, as in ``gravity_kernel.ring``; and whether a body of a
    pair is within the Hill radius of the other."""
    gm_i, hill_i = load(bodies.table[SOURCE], 0), load(bodies.table[HILL], 0)
    xi, yi, zi = load(place[0], 0), load(place[1], 0), load(place[2], 0)
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
    return ax + rotated(reaction_x, 4), ay + rotated(reaction_y, 4), az + rotated(reaction_z, 4), near


@inlined
def pulls_one_by_one(bodies, place, b):
    """The same of any eight, by each massive body."""
    source, hill = bodies.table[SOURCE], bodies.table[HILL]
    sx, sy, sz = place[0], place[1], place[2]
    x, y, z = load(sx, b), load(sy, b), load(sz, b)
    zero = splat(0.0)
    ax, ay, az = zero, zero, zero
    near = zero > 1.0
    for j in range(bodies.massive):
        dx, dy, dz = sx[j] - x, sy[j] - y, sz[j] - z
        r2 = dx * dx + dy * dy + dz * dz
        r2 = select(lane_numbers() == float(j - b), splat(SELF), r2)
        near = near | (r2 < hill[j])
        inverse = inverse_sqrt(r2)
        w = source[j] * inverse * inverse * inverse
        ax, ay, az = ax + w * dx, ay + w * dy, az + w * dz
    return ax, ay, az, near


@inlined
def kick_velocities(bodies, b, dt, ax, ay, az):
    live = load(bodies.table[LIVE], b) > 0.0
    zero = splat(0.0)
    add_lanes(bodies, 3, b, select(live, dt * ax, zero))
    add_lanes(bodies, 4, b, select(live, dt * ay, zero))
    add_lanes(bodies, 5, b, select(live, dt * az, zero))


@inlined
def jump(bodies, dt):
    """Every body moves with what the central one does, by the sum of the momenta over its mass (Duncan, Levison & Lee
    1998, doi:10.1086/300541)."""
    orbit, share = bodies.orbit, bodies.table[OTHERS]
    jx, jy, jz = 0.0, 0.0, 0.0
    for b in range(0, bodies.massive, WIDTH):
        part = load(share, b)
        jx += lane_sum(part * load(orbit[3], b))
        jy += lane_sum(part * load(orbit[4], b))
        jz += lane_sum(part * load(orbit[5], b))
    for b in range(0, orbit.shape[1], WIDTH):
        add_lanes(bodies, 0, b, splat(dt * jx))
        add_lanes(bodies, 1, b, splat(dt * jy))
        add_lanes(bodies, 2, b, splat(dt * jz))


@inlined
def heliocentric_kick(bodies, dt, t):
    """Kicks by the other bodies alone; the central one's pull is in the Kepler motion."""
    for b in range(0, bodies.orbit.shape[1], WIDTH):
        ax, ay, az = pulls(bodies, bodies.orbit, b, t)
        kick_velocities(bodies, b, dt, ax, ay, az)


@inlined
def central_pull(bodies, b):
    """``central_part`` of eight bodies."""
    orbit, work = bodies.orbit, bodies.work
    place = load(orbit[0], b), load(orbit[1], b), load(orbit[2], b)
    offset = load(work[OFFSET], b), load(work[OFFSET + 1], b), load(work[OFFSET + 2], b)
    (wx, wy, wz), (gx, gy, gz) = central_part(place, offset)
    return wx, wy, wz, gx, gy, gz


@inlined
def central_part(place, offset):
    """For bodies at r' + offset from the central one, r' = ``place``: w, the central body's pull there per G m_0,
    against r', and r' / r'^3 - r / r^3, the pull of the mass inside from its centre less that from the central body,
    from their small quotient as Encke does (Battin 1999, eq. 8.62 ff., doi:10.2514/4.861543)."""
    (x, y, z), (ox, oy, oz) = place, offset
    px, py, pz = x + ox, y + oy, z + oz
    before2 = x * x + y * y + z * z
    before, now = inverse_sqrt(before2), inverse_sqrt(px * px + py * py + pz * pz)
    inverse3, star = before * before * before, now * now * now
    ratio = before2 * before * now  # r' / r
    ratio3 = ratio * ratio * ratio
    q = (ox * (x + px) + oy * (y + py) + oz * (z + pz)) * (before * before)  # r^2 / r'^2 - 1
    lost = q * (3.0 + q * (3.0 + q)) * (ratio3 * ratio3 / (1.0 + ratio3))  # 1 - (r' / r)^3
    kept = inverse3 * lost
    return (star * px, star * py, star * pz), (kept * x - star * ox, kept * y - star * oy, kept * z - star * oz)


@inlined
def jacobi_kick(bodies, dt, t):
    """Kicks in Jacobi's coordinates (Rein & Tamayo 2015, eq. 9, doi:10.1093/mnras/stv1257). With w the central body's
    pull on a body per G m_0 and p that of the others, body i feels

        G M_i (r' / r'^3 - w_i) + G (M_i - m_0 M_i / M_(i-1)) w_i + p_i - A_i,
        A_i = (m_0 sum over j > i of G m_j w_j + sum over 0 < j < i of m_j p_j) / M_(i-1),

    which is the acceleration from the centre of the mass inside, less the Kepler motion's, without a difference of two
    large numbers: by Newton's third law the forces within the mass inside cancel, and have been left out.
    """
    orbit, table, work, inside = bodies.orbit, bodies.table, bodies.work, bodies.inside
    slots, massive = orbit.shape[1], bodies.massive
    places(bodies)
    central = bodies.gm
    total_x, total_y, total_z = 0.0, 0.0, 0.0
    for b in range(0, slots, WIDTH):
        px, py, pz = pulls(bodies, work, b, t)
        wx, wy, wz, gx, gy, gz = central_pull(bodies, b)
        gm, others = load(table[GM], b), load(table[OTHERS], b)
        if b < massive:
            source = load(table[SOURCE], b)
            store(work[STAR], b, source * (px - central * wx))
            store(work[STAR + 1], b, source * (py - central * wy))
            store(work[STAR + 2], b, source * (pz - central * wz))
            sx, sy, sz = source * wx, source * wy, source * wz
            total_x, total_y, total_z = total_x + lane_sum(sx), total_y + lane_sum(sy), total_z + lane_sum(sz)
            store(work[WAY], b, sx)
            store(work[WAY + 1], b, sy)
            store(work[WAY + 2], b, sz)
        store(work[PULL], b, px + gm * (gx + others * wx))
        store(work[PULL + 1], b, py + gm * (gy + others * wy))
        store(work[PULL + 2], b, pz + gm * (gz + others * wz))
    total_x, total_y, total_z = central * total_x, central * total_y, central * total_z
    start_x, start_y, start_z = total_x, total_y, total_z
    for b in range(0, massive, WIDTH):
        cx, cy, cz = load(work[STAR], b), load(work[STAR + 1], b), load(work[STAR + 2], b)
        rest = load(table[INSIDE], b)
        ax = sums_before(cx) + total_x - central * load(work[WAY], b)
        ay = sums_before(cy) + total_y - central * load(work[WAY + 1], b)
        az = sums_before(cz) + total_z - central * load(work[WAY + 2], b)
        if slots > massive:  # for the massless, in whose sums the last body before them counts as well
            store(work[STAR], b, sums_before(cx) + cx + total_x)
            store(work[STAR + 1], b, sums_before(cy) + cy + total_y)
            store(work[STAR + 2], b, sums_before(cz) + cz + total_z)
        ax, ay = load(work[PULL], b) - rest * ax, load(work[PULL + 1], b) - rest * ay
        kick_velocities(bodies, b, dt, ax, ay, load(work[PULL + 2], b) - rest * az)
        if b + WIDTH < massive:
            total_x, total_y, total_z = total_x + lane_sum(cx), total_y + lane_sum(cy), total_z + lane_sum(cz)
    for i in range(massive, slots):
        if table[LIVE, i] > 0.0:
            j = inside[i]
            for k, total in enumerate((start_x, start_y, start_z)):
                felt = work[STAR + k, j - 1] if j > 0 else total
                work[PULL + k, i] -= table[INSIDE, i] * felt
    for b in range(massive, slots, WIDTH):
        kick_velocities(bodies, b, dt, load(work[PULL], b), load(work[PULL + 1], b), load(work[PULL + 2], b))


# --- other forces ---


@jit
def fill_positions(bodies):
    """bodies.x[0] <- where the particles are."""
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
    """Kicks by the accelerations bodies.a, taken to the map's coordinates."""
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
    """bodies.a <- the accelerations by the forces besides gravity; a status."""
    fill_positions(bodies)
    status = fill_accelerations(forces, t, bodies.x[0], bodies.x[1], bodies.a, None, cursor)
    cursor[EVALUATIONS] -= 1  # the kick counts
    return status


# --- steps ---


@driver
def wisdom_holman_loop(forces, bodies, stages, dt, start, first, steps, cursor):
    """``steps`` times the row of drifts (``stages[0]``), each followed by its kick (``stages[1]``); ``stages[2]`` is
    the part of dt that has passed at the kick. ``forces`` are those besides gravity; the rest as in ``loops``."""
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

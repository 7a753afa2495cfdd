"""The flows of the Wisdom-Holman map, eight bodies at a time.

Every body drifts along its Kepler orbit, feels the others as kicks, and in heliocentric coordinates jumps with the
central one. Forces other than gravity join the kicks.
"""

import numpy as np

from kickdrift.forces.bound.table import EVALUATIONS, fill_accelerations
from kickdrift.forces.seam.kernel import BLOWN_UP, OK
from kickdrift.integrators.wisdom_holman import bodies as rows
from kickdrift.integrators.wisdom_holman.bodies import add_centre, add_vectors, exclusive_scan3
from kickdrift.integrators.wisdom_holman.kepler import kepler_increments, lanes_increments
from kickdrift.jit.compile import inlined, is_finite, jit
from kickdrift.jit.lanes.functions import inverse_sqrt, lane_numbers, rotated, splat
from kickdrift.jit.lanes.masks import any_lane, mask_bits, select
from kickdrift.jit.lanes.memory import load
from kickdrift.jit.lanes.vector3 import dot, lane_sums, load3, numbers3, select3, store3, thrice, vector3
from kickdrift.jit.lanes.vectors import WIDTH

SELF = 1e300  # a squared distance without attraction


# --- drift ---


@inlined
def drift(bodies, dt, t):
    """Move every body along its Kepler orbit for a time dt from t on, and the centre of mass along its line. Return a
    status."""
    orbit, table, work = bodies.orbit, bodies.table, bodies.work
    n = orbit.shape[1]
    for b in range(0, n, WIDTH):
        gm = load(table[rows.GM], b)
        moved, kicked, beta, solved = lanes_increments(gm, dt, load3(orbit, b, n), load3(orbit, 3 * n + b, n))
        done = mask_bits(solved)
        if done != 255:
            if one_by_one(bodies, dt, b, done) != OK:
                return BLOWN_UP
            moved = select3(solved, moved, load3(work, rows.WAY * n + b, n))
            kicked = select3(solved, kicked, load3(work, (rows.WAY + 3) * n + b, n))
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
            moved, kicked = kepler_increments(bodies.table[rows.GM, i], dt, x, v)
            store3(work, rows.WAY * n + i, n, moved)
            store3(work, (rows.WAY + 3) * n + i, n, kicked)
            total = moved.x + moved.y + moved.z + kicked.x + kicked.y + kicked.z
            if not is_finite(total):
                return BLOWN_UP
    return OK


@jit
def note_unbound(bodies, b, lanes, t):
    first = bodies.first
    for k in range(WIDTH):
        if (lanes >> k) & 1 and np.isnan(first[rows.UNBOUND, b + k]):
            first[rows.UNBOUND, b + k] = t


# --- kicks and jumps ---


@jit
def note_near(bodies, place, b, t):
    """Record which of these eight bodies are within the Hill radius of which others."""
    first, hill, n = bodies.first, bodies.table[rows.HILL], bodies.orbit.shape[1]
    for i in range(b, b + WIDTH):
        if bodies.table[rows.LIVE, i] == 0.0 or not np.isnan(first[rows.NEAR, i]):
            continue
        for j in range(bodies.massive):
            d = numbers3(place, j, n) - numbers3(place, i, n)
            if j != i and dot(d, d) < hill[j]:
                first[rows.NEAR, i], first[rows.WHICH, i] = t, j
                break


@inlined
def places(bodies):
    """work[PLACE] <- positions from the central body. work[OFFSET] <- their difference from Jacobi's: the sum of m_j /
    M_j times Jacobi's position over the massive bodies j before."""
    orbit, table, work, inside = bodies.orbit, bodies.table, bodies.work, bodies.inside
    n, before = orbit.shape[1], thrice(0.0)
    for b in range(0, bodies.massive, WIDTH):
        x = load3(orbit, b, n)
        part = load(table[rows.SHARE], b) * x
        offset = exclusive_scan3(part) + before
        store3(work, rows.OFFSET * n + b, n, offset)
        store3(work, rows.PLACE * n + b, n, x + offset)
        if b + WIDTH < bodies.massive or n > bodies.massive:
            before = before + lane_sums(part)
    for i in range(bodies.massive, orbit.shape[1]):
        j = inside[i]
        for k in range(3):
            offset = 0.0
            if j > 0:
                offset = work[rows.OFFSET + k, j - 1] + table[rows.SHARE, j - 1] * orbit[k, j - 1]
            work[rows.OFFSET + k, i], work[rows.PLACE + k, i] = offset, orbit[k, i] + offset


@inlined
def mutual_accelerations(bodies, place, b, t):
    """Accelerations of eight bodies at ``place`` by the massive bodies other than the central one."""
    if bodies.massive == WIDTH and b == 0:
        a, near = ring_accelerations(bodies, place)
    else:
        a, near = accelerations_one_by_one(bodies, place, b)
    if any_lane(near):
        note_near(bodies, place, b, t)
    return a


@inlined
def ring_accelerations(bodies, place):
    """Mutual accelerations of eight bodies, each pair once, as in ``gravity.kernel.ring``. Also tells whether any pair
    is within a Hill radius."""
    gm_i, hill_i = load(bodies.table[rows.SOURCE], 0), load(bodies.table[rows.HILL], 0)
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
def accelerations_one_by_one(bodies, place, b):
    """Accelerations of any eight, by each massive body."""
    source, hill, n = bodies.table[rows.SOURCE], bodies.table[rows.HILL], bodies.orbit.shape[1]
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
    live = load(bodies.table[rows.LIVE], b) > 0.0
    add_vectors(bodies, 3, b, select3(live, dt * a, thrice(splat(0.0))))


@inlined
def jump(bodies, dt):
    """Move every body with the central one, by the sum of the momenta over its mass (Duncan, Levison & Lee 1998,
    doi:10.1086/300541)."""
    orbit, share, move = bodies.orbit, bodies.table[rows.OTHERS], thrice(0.0)
    n = orbit.shape[1]
    for b in range(0, bodies.massive, WIDTH):
        move = move + lane_sums(load(share, b) * load3(orbit, 3 * n + b, n))
    for b in range(0, n, WIDTH):
        add_vectors(bodies, 0, b, splat(dt) * move)


@inlined
def heliocentric_kick(bodies, dt, t):
    """Kick by the other bodies alone; the central one's attraction is in the Kepler motion."""
    for b in range(0, bodies.orbit.shape[1], WIDTH):
        kick_velocities(bodies, b, dt, mutual_accelerations(bodies, bodies.orbit, b, t))


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
        mutual = mutual_accelerations(bodies, work, b, t)
        w, g = central_part(load3(orbit, b, slots), load3(work, rows.OFFSET * slots + b, slots))
        gm, others = load(table[rows.GM], b), load(table[rows.OTHERS], b)
        if b < massive:
            source = load(table[rows.SOURCE], b)
            store3(work, rows.STAR * slots + b, slots, source * (mutual - central * w))
            weighted = source * w
            total = total + lane_sums(weighted)
            store3(work, rows.WAY * slots + b, slots, weighted)
        store3(work, rows.MUTUAL * slots + b, slots, mutual + gm * (g + others * w))
    total = central * total
    start = total
    for b in range(0, massive, WIDTH):
        star, rest = load3(work, rows.STAR * slots + b, slots), load(table[rows.INSIDE], b)
        felt = exclusive_scan3(star) + total - central * load3(work, rows.WAY * slots + b, slots)
        if slots > massive:  # massless bodies, whose sums also include the last body before them
            store3(work, rows.STAR * slots + b, slots, exclusive_scan3(star) + star + total)
        kick_velocities(bodies, b, dt, load3(work, rows.MUTUAL * slots + b, slots) - rest * felt)
        if b + WIDTH < massive:
            total = total + lane_sums(star)
    for i in range(massive, slots):
        if table[rows.LIVE, i] > 0.0:
            j = inside[i]
            felt = numbers3(work, rows.STAR * slots + j - 1, slots) if j > 0 else start
            place = rows.MUTUAL * slots + i
            store3(work, place, slots, numbers3(work, place, slots) - table[rows.INSIDE, i] * felt)
    for b in range(massive, slots, WIDTH):
        kick_velocities(bodies, b, dt, load3(work, rows.MUTUAL * slots + b, slots))


# --- other forces ---


@jit
def fill_positions(bodies):
    """bodies.x[0] <- the particles' positions."""
    orbit, work, order, x, shares = bodies.orbit, bodies.work, bodies.order, bodies.x[0], bodies.shares
    if bodies.jacobi:
        places(bodies)
    place = work[rows.PLACE : rows.PLACE + 3] if bodies.jacobi else orbit[:3]
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
                    mean = work[rows.WAY + k, bodies.inside[i] - 1] if bodies.inside[i] > 0 else first
                relative = a[k, order[i]] - mean
                orbit[3 + k, i] += dt * relative
                if bodies.jacobi and i < bodies.massive:
                    mean += bodies.table[rows.SHARE, i] * relative
                    work[rows.WAY + k, i] = mean
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

"""Other forces of the hybrid map on duals: kicks, and accelerations inside encounters and passages.

See ``others`` for what the map does.
"""

import numpy as np

from kickdrift.forces.seam.kernel import BLOWN_UP, OK
from kickdrift.integrators.trace import tangent_state as part
from kickdrift.integrators.trace.others import ROUNDED, STALLED, TURNS
from kickdrift.integrators.trace.state import compiled_hermite
from kickdrift.integrators.wisdom_holman.tangent_columns import feel, to_first_order
from kickdrift.jit.compile import jit, never_inline
from kickdrift.jit.duals.dual import SLOT, as_dual, dual_rows
from kickdrift.jit.duals.operators import dual_vector, put_vector, vector_at


@jit
def inverse_of_whole(masses):
    """One over G times the mass of all bodies."""
    total = as_dual(0.0)
    for i in range(masses.shape[1]):
        total += masses[0, i]
    return as_dual(1.0) / total


@jit
def feel_others(own, rows, t):
    """OWN_A <- the accelerations at OWN_X and OWN_V. Return a status."""
    return feel(
        rows[part.OWN_A], rows[part.OWN_X], rows[part.OWN_V], own.order.size, t, own.others, own.pushes, own.block[0]
    )


@jit
def mean_felt(own, rows):
    """Mean acceleration of all bodies, weighted with their masses."""
    n = own.order.size
    found, masses, mean = dual_rows(rows[part.OWN_A], n), dual_rows(rows[part.MASSES], n), dual_vector((0.0, 0.0, 0.0))
    inverse = inverse_of_whole(masses)
    for i in range(own.massive):
        mean = mean + (masses[0, i] * inverse) * vector_at(found, own.order[i])
    return mean


# --- kicks ---


@jit
def place_orbits(own, rows):
    """OWN_X <- the positions of all bodies."""
    n, order = own.order.size, own.order
    x, masses, places = dual_rows(rows[part.X], n), dual_rows(rows[part.MASSES], n), dual_rows(rows[part.OWN_X], n)
    central, inverse = vector_at(x, 0), inverse_of_whole(masses)
    for i in range(1, own.massive):
        central = central - (masses[0, i] * inverse) * vector_at(x, i)
    put_vector(places, order[0], central)
    for i in range(1, n):
        put_vector(places, order[i], central + vector_at(x, i))


@jit
def speed_halfway(own, rows):
    """OWN_V <- velocities half way between those before the kick and those after."""
    n, order = own.order.size, own.order
    before, after = dual_rows(rows[part.BEFORE_V], n), dual_rows(rows[part.V], n)
    masses, speeds = dual_rows(rows[part.MASSES], n), dual_rows(rows[part.OWN_V], n)
    pace = 0.5 * (vector_at(before, 0) + vector_at(after, 0))
    central = pace
    for i in range(1, n):
        speed = 0.5 * (vector_at(before, i) + vector_at(after, i))
        central = central - masses[2, i] * speed
        put_vector(speeds, order[i], pace + speed)
    put_vector(speeds, order[0], central)


@jit
def kick_from(own, rows, start, h):
    """V <- the velocities of row ``start`` after a kick by OWN_A."""
    n = own.order.size
    v, before, found = dual_rows(rows[part.V], n), dual_rows(rows[start], n), dual_rows(rows[part.OWN_A], n)
    mean = mean_felt(own, rows)
    put_vector(v, 0, vector_at(before, 0) + h * mean)
    for i in range(1, n):
        if not own.met[i]:
            put_vector(v, i, vector_at(before, i) + h * (vector_at(found, own.order[i]) - mean))


@jit
def change_of(rows, latest, n):
    """Change of V since ``latest``, relative to the largest number: that of values, or of a column if it is larger.
    latest <- V."""
    v, worst = rows[part.V], 0.0
    for column in range(SLOT):
        change, largest = 0.0, 0.0
        for i in range(column, 3 * n * SLOT, SLOT):
            change, largest = max(change, abs(v[i] - latest[i])), max(largest, abs(v[i]))
        if not change <= 1e300:
            return np.inf
        worst = max(worst, change / largest if largest > 0.0 else 0.0)
    latest[:] = v
    return worst


@jit
def kick_halfway(own, rows, t, h):
    """Kick by forces of velocity: the implicit midpoint step of ``others``, by iteration. Return a status."""
    never_inline()
    n, before = own.order.size, np.inf
    rows[part.BEFORE_V] = rows[part.V]
    latest = rows[part.V].copy()
    for turn in range(TURNS):
        speed_halfway(own, rows)
        status = feel_others(own, rows, t)
        if status != OK:
            return status
        kick_from(own, rows, part.BEFORE_V, h)
        change = change_of(rows, latest, n)
        if turn > 0:
            if change <= ROUNDED or (change >= before and change <= STALLED):
                return OK
            before = change
        if change == np.inf:
            return BLOWN_UP
    return BLOWN_UP


@to_first_order
@jit
def kick_by_others_duals(rows, own, t, h):
    """Kick by the other forces all bodies that do not move with others. Return a status."""
    never_inline()
    place_orbits(own, rows)
    if own.moving:
        return kick_halfway(own, rows, t, h)
    status = feel_others(own, rows, t)
    if status == OK:
        kick_from(own, rows, part.V, h)
    return status


# --- inside ---


@jit
def place_all_duals(own, rows, members, at, s, h):
    """OWN_X <- positions of the massive bodies, and of those that meet, a time s after the step's start: ``members``
    are at ``at``, other massive bodies on Hermite's cubic between the ends of their drift. OWN_V of those on the cubic
    <- their velocities from the centre of mass."""
    n, order, f = own.order.size, own.order, s / h
    x, v, masses = dual_rows(rows[part.X], n), dual_rows(rows[part.V], n), dual_rows(rows[part.MASSES], n)
    middle_x, middle_v = dual_rows(rows[part.MIDDLE_X], n), dual_rows(rows[part.MIDDLE_V], n)
    places, speeds, inverse = dual_rows(rows[part.OWN_X], n), dual_rows(rows[part.OWN_V], n), inverse_of_whole(masses)
    for i in range(1, own.massive):
        place, speed = compiled_hermite(
            f, vector_at(middle_x, i), h * vector_at(middle_v, i), vector_at(x, i), h * vector_at(v, i)
        )
        put_vector(places, order[i], place)
        if own.moving:
            put_vector(speeds, order[i], (1.0 / h) * speed)
    for i in range(at.shape[1]):
        put_vector(places, order[members[i]], vector_at(at, i))
    central = vector_at(middle_x, 0) + s * vector_at(middle_v, 0)
    for i in range(1, own.massive):
        central = central - (masses[0, i] * inverse) * vector_at(places, order[i])
    put_vector(places, order[0], central)
    for i in range(1, own.massive):
        put_vector(places, order[i], vector_at(places, order[i]) + central)
    for i in range(at.shape[1]):
        if members[i] >= own.massive:
            put_vector(places, order[members[i]], vector_at(places, order[members[i]]) + central)


@jit
def speed_all_duals(own, rows, meeting, n):
    """OWN_V <- velocities of the massive bodies, and of those that meet, after ``place_all_duals``."""
    never_inline()
    count, order, members = own.order.size, own.order, meeting.members
    masses, speeds, v = dual_rows(rows[part.MASSES], count), dual_rows(rows[part.OWN_V], count), dual_rows(meeting.v, n)
    pace, move, mass = vector_at(dual_rows(rows[part.V], count), 0), dual_vector((0.0, 0.0, 0.0)), as_dual(1.0)
    for i in range(n):
        share = masses[2, members[i]]
        move = move + share * vector_at(v, i)
        if meeting.jumps[i]:
            mass += share
    move = (as_dual(1.0) / mass) * move
    for i in range(n):
        speed = vector_at(v, i)
        put_vector(speeds, order[members[i]], speed - move if meeting.jumps[i] else speed)
    central = pace
    for i in range(1, own.massive):
        speed = vector_at(speeds, order[i])
        central = central - masses[2, i] * speed
        put_vector(speeds, order[i], pace + speed)
    put_vector(speeds, order[0], central)
    for i in range(n):
        if members[i] >= own.massive:
            put_vector(speeds, order[members[i]], vector_at(speeds, order[members[i]]) + pace)


@to_first_order
@jit
def add_inside_duals(rows, own, n, t, s, h):
    """Add to a the accelerations of ``others.add_inside``, a time s after the step's start at t. Return a
    status."""
    never_inline()
    meeting = own.meeting
    members, at, a = meeting.members, dual_rows(meeting.x, n), dual_rows(meeting.a, n)
    count = own.order.size
    place_all_duals(own, rows, members, at, s, h)
    if own.moving:
        speed_all_duals(own, rows, meeting, n)
    status = feel_others(own, rows, t + s)
    if status != OK:
        return status
    found, masses = dual_rows(rows[part.OWN_A], count), dual_rows(rows[part.MASSES], count)
    mean, pull = mean_felt(own, rows), dual_vector((0.0, 0.0, 0.0))
    for i in range(n):
        if own.met[members[i]]:
            felt = vector_at(found, own.order[members[i]]) - mean
            put_vector(a, i, vector_at(a, i) + felt)
            pull = pull + masses[2, members[i]] * felt
    for i in range(n):
        if meeting.jumps[i]:
            put_vector(a, i, vector_at(a, i) + pull)
    return OK

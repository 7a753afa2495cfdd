"""Other forces of the hybrid map on duals: kicks, and accelerations inside encounters and passages.

See ``trace_others`` for what the map does. These forces depend on positions and time alone, and masses have no slopes.
"""

from __future__ import annotations

from kickdrift.forces.bound_slopes import call_slopes
from kickdrift.forces.dual_slopes import NO_DUALS
from kickdrift.forces.kernel import OK
from kickdrift.integrators.trace_tangent_rows import (
    MASSES,
    MIDDLE_V,
    MIDDLE_X,
    OWN_A,
    OWN_V,
    OWN_X,
    V,
    X,
)
from kickdrift.jit.compile import jit, never_inline
from kickdrift.jit.dual import dual_rows
from kickdrift.jit.dual_operators import dual_vector, put_vector, vector_at

NO_SLOPES = 101  # status: a force without a formula on duals


@jit
def whole_mass(masses):
    """G times the mass of all bodies."""
    total = 0.0
    for i in range(masses.shape[1]):
        total += masses[0, i].value
    return total


@jit
def feel(own, rows, t):
    """OWN_A <- the accelerations at OWN_X. Return a status."""
    never_inline()
    n, others = own.order.size, own.others
    speeds, found = dual_rows(rows[OWN_V], n), dual_rows(rows[OWN_A], n)
    for i in range(n):
        put_vector(speeds, i, dual_vector((0.0, 0.0, 0.0)))
        put_vector(found, i, dual_vector((0.0, 0.0, 0.0)))
    for k in range(others.shape[0]):
        status = call_slopes(others[k, 0], others[k, 1], n, t, rows[OWN_X], rows[OWN_V], rows[OWN_A])
        if status != OK:
            return NO_SLOPES if status == NO_DUALS else status
    return OK


@jit
def mean_felt(own, rows):
    """Mean acceleration of all bodies, weighted with their masses."""
    n = own.order.size
    found, masses, mean = dual_rows(rows[OWN_A], n), dual_rows(rows[MASSES], n), dual_vector((0.0, 0.0, 0.0))
    total = whole_mass(masses)
    for i in range(own.massive):
        mean = mean + (masses[0, i].value / total) * vector_at(found, own.order[i])
    return mean


@jit
def kick_by_others_duals(own, rows, t, h):
    """Kick by the other forces all bodies that do not move with others. Return a status."""
    never_inline()
    n, order = own.order.size, own.order
    x, v, masses = dual_rows(rows[X], n), dual_rows(rows[V], n), dual_rows(rows[MASSES], n)
    places, found = dual_rows(rows[OWN_X], n), dual_rows(rows[OWN_A], n)
    central, total = vector_at(x, 0), whole_mass(masses)
    for i in range(1, own.massive):
        central = central - (masses[0, i].value / total) * vector_at(x, i)
    put_vector(places, order[0], central)
    for i in range(1, n):
        put_vector(places, order[i], central + vector_at(x, i))
    status = feel(own, rows, t)
    if status != OK:
        return status
    mean = mean_felt(own, rows)
    put_vector(v, 0, vector_at(v, 0) + h * mean)
    for i in range(1, n):
        if not own.met[i]:
            put_vector(v, i, vector_at(v, i) + h * (vector_at(found, order[i]) - mean))
    return OK


@jit
def place_all_duals(own, rows, members, at, s, h):
    """OWN_X <- positions of the massive bodies, and of those that meet, a time s after the step's start: ``members``
    are at ``at``, other massive bodies on Hermite's cubic between the ends of their drift."""
    n, order, f = own.order.size, own.order, s / h
    x, v, masses = dual_rows(rows[X], n), dual_rows(rows[V], n), dual_rows(rows[MASSES], n)
    middle_x, middle_v = dual_rows(rows[MIDDLE_X], n), dual_rows(rows[MIDDLE_V], n)
    places, total = dual_rows(rows[OWN_X], n), whole_mass(masses)
    for i in range(1, own.massive):
        x0, v0, x1, v1 = vector_at(middle_x, i), h * vector_at(middle_v, i), vector_at(x, i), h * vector_at(v, i)
        b, a = 3.0 * (x1 - x0) - 2.0 * v0 - v1, 2.0 * (x0 - x1) + v0 + v1
        put_vector(places, order[i], x0 + f * (v0 + f * (b + f * a)))
    for i in range(at.shape[1]):
        put_vector(places, order[members[i]], vector_at(at, i))
    central = vector_at(middle_x, 0) + s * vector_at(middle_v, 0)
    for i in range(1, own.massive):
        central = central - (masses[0, i].value / total) * vector_at(places, order[i])
    put_vector(places, order[0], central)
    for i in range(1, own.massive):
        put_vector(places, order[i], vector_at(places, order[i]) + central)
    for i in range(at.shape[1]):
        if members[i] >= own.massive:
            put_vector(places, order[members[i]], vector_at(places, order[members[i]]) + central)


@jit
def add_inside_duals(own, rows, meeting, n, t, s, h):
    """Add to a the accelerations of ``trace_others.add_inside``, a time s after the step's start at t. Return a
    status."""
    never_inline()
    members, at, a = meeting.members, dual_rows(meeting.x, n), dual_rows(meeting.a, n)
    count = own.order.size
    place_all_duals(own, rows, members, at, s, h)
    status = feel(own, rows, t + s)
    if status != OK:
        return status
    found, masses = dual_rows(rows[OWN_A], count), dual_rows(rows[MASSES], count)
    mean, pull = mean_felt(own, rows), dual_vector((0.0, 0.0, 0.0))
    for i in range(n):
        if own.met[members[i]]:
            felt = vector_at(found, own.order[members[i]]) - mean
            put_vector(a, i, vector_at(a, i) + felt)
            pull = pull + masses[2, members[i]].value * felt
    for i in range(n):
        if meeting.jumps[i]:
            put_vector(a, i, vector_at(a, i) + pull)
    return OK

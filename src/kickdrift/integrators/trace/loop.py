"""Compiled loop of the hybrid map: kick, jump, drift, jump, kick, with encounters and passages inside the drift.

A step begins with the near pairs and passages that its start shows. If its end shows more of them, the step is done
once more with all of them (Hernandez & Dehnen 2023, MNRAS 522, 4639; Lu, Hernandez & Rein 2024,
doi:10.1093/mnras/stae1982).
"""

from kickdrift.forces.bound.table import EVALUATIONS
from kickdrift.forces.seam.kernel import BLOWN_UP, OK
from kickdrift.integrators.stepping.loops import STEP
from kickdrift.integrators.trace.groups import (
    each_massless,
    groups_of_massive,
    keep,
    passage_of_massive,
)
from kickdrift.integrators.trace.others import kick_by_others, meets_any
from kickdrift.integrators.trace.state import FOUND, FULL, HEAVY, PAIRS, PASSAGES, POINTS, READY, TWICE
from kickdrift.integrators.trace.switch import clear_flags, find_flags, note_used
from kickdrift.integrators.wisdom_holman.bodies import LIVE, MUTUAL, SOURCE
from kickdrift.integrators.wisdom_holman.flows import drift, jump, kick_velocities, mutual_accelerations
from kickdrift.integrators.wisdom_holman.loop import leave_democratic
from kickdrift.jit.compile import driver, inlined, is_finite, jit
from kickdrift.jit.handle import handle, unowned
from kickdrift.jit.lanes.functions import lane_sum, splat
from kickdrift.jit.lanes.memory import load, store
from kickdrift.jit.lanes.vector3 import dot, load3, numbers3, store3, vector3
from kickdrift.jit.lanes.vectors import WIDTH


@jit
def attract_all(hybrid):
    """work[MUTUAL] <- the accelerations of all bodies by the massive ones, whether near or not."""
    bodies = hybrid.bodies
    n = bodies.orbit.shape[1]
    for b in range(0, n, WIDTH):
        store3(bodies.work, MUTUAL * n + b, n, mutual_accelerations(bodies, bodies.orbit, b, 0.0))


@jit
def velocity_after(hybrid, i, h):
    """Velocity of body i after a kick by the massive bodies that are not near it."""
    bodies = hybrid.bodies
    orbit, source = bodies.orbit, bodies.table[SOURCE]
    n, massive = orbit.shape[1], hybrid.group.size
    v = numbers3(orbit, 3 * n + i, n)
    if hybrid.way == FULL and hybrid.counts[HEAVY] > 0:
        return v
    a, x = vector3(0.0, 0.0, 0.0), numbers3(orbit, i, n)
    for j in range(massive):
        if j != i and not hybrid.near[j, i] and source[j] != 0.0:
            d = numbers3(orbit, j, n) - x
            r2 = dot(d, d)
            a = a + (source[j] / (r2 * r2**0.5)) * d
    return v + h * a


@jit
def kick(hybrid, h):
    """Kick each body by the massive bodies that are not near it."""
    bodies, kept, live = hybrid.bodies, hybrid.kept, hybrid.bodies.table[LIVE]
    n, some = bodies.orbit.shape[1], hybrid.counts[PAIRS] + hybrid.counts[PASSAGES] > 0
    if some:
        for i in range(n):
            if live[i] != 0.0 and meets_any(hybrid, i):
                store3(kept, i, n, velocity_after(hybrid, i, h))
    for b in range(0, n, WIDTH):
        kick_velocities(bodies, b, h, load3(bodies.work, MUTUAL * n + b, n))
    if some:
        for i in range(n):
            if live[i] != 0.0 and meets_any(hybrid, i):
                store3(bodies.orbit, 3 * n + i, n, numbers3(kept, i, n))


@jit
def jump_all(hybrid, h):
    """Move all bodies by the central body's way, except massless bodies that pass their pericentre."""
    bodies, kept, passages = hybrid.bodies, hybrid.kept, hybrid.counts[PASSAGES] > 0
    n = bodies.orbit.shape[1]
    if passages:
        for i in range(hybrid.group.size, n):
            if hybrid.passes[i]:
                store3(kept, i, n, numbers3(bodies.orbit, i, n))
    jump(bodies, h)
    if passages:
        for i in range(hybrid.group.size, n):
            if hybrid.passes[i]:
                store3(bodies.orbit, i, n, numbers3(kept, i, n))


@jit
def shift_massless(hybrid, moved):
    """Move massless bodies by half the central body's way, if they meet no massive body and pass no pericentre."""
    orbit = hybrid.bodies.orbit
    for i in range(hybrid.group.size, orbit.shape[1]):
        if not (hybrid.meets[i] or hybrid.passes[i]):
            for k in range(3):
                orbit[k, i] += 0.5 * moved[k]


@jit
def drift_in_passage(hybrid, others, h, t, moved):
    """Drift with a massive body in its pericentre passage: all massive bodies move together. Return a status."""
    bodies = hybrid.bodies
    status = passage_of_massive(hybrid, others, h, moved)
    if status != OK:
        return status
    shift_massless(hybrid, moved)
    status = drift(bodies, h, t)
    if status != OK:
        return status
    keep(hybrid, 0)
    shift_massless(hybrid, moved)
    return each_massless(hybrid, others, h)


@jit
def drift_or_meet(hybrid, others, h, t):
    """Drift: near bodies move together, all others on Kepler orbits. Return a status."""
    bodies, some = hybrid.bodies, hybrid.counts[PAIRS] + hybrid.counts[PASSAGES] > 0
    if some:
        copy_orbits(hybrid.middle, bodies.orbit)
    status = drift(bodies, h, t)
    if status != OK or not some:
        return status
    status = groups_of_massive(hybrid, others, h)
    return each_massless(hybrid, others, h) if status == OK else status


@inlined
def copy_orbits(to, of):
    """Copy an array whose rows are whole lanes."""
    for i in range(0, of.size, WIDTH):
        store(to, i, load(of, i))


@inlined
def finite(bodies):
    """Tell whether all orbits are finite."""
    total = splat(0.0)
    for i in range(0, bodies.orbit.size, WIDTH):
        total = total + 0.0 * load(bodies.orbit, i)
    return is_finite(lane_sum(total))


@jit
def attempt(forces, hybrid, h, t, moved, cursor):
    """Take one step with the pairs and passages noted so far. Return a status."""
    bodies, others_act = hybrid.bodies, forces.table.shape[0] > 0
    hybrid.counts[POINTS], hybrid.meeting.size[FOUND], hybrid.span[0], hybrid.span[1] = 0, 0, t, h
    if others_act:
        status = kick_by_others(forces, hybrid, t, 0.5 * h, cursor)
        if status != OK:
            return status
    kick(hybrid, 0.5 * h)
    if hybrid.counts[HEAVY] > 0:
        copy_orbits(hybrid.middle, bodies.orbit)
        status = drift_in_passage(hybrid, forces, h, t, moved)
    else:
        jump_all(hybrid, 0.5 * h)
        status = drift_or_meet(hybrid, forces, h, t)
        jump_all(hybrid, 0.5 * h)
    if status != OK:
        return status
    attract_all(hybrid)
    kick(hybrid, 0.5 * h)
    if others_act:
        status = kick_by_others(forces, hybrid, t + h, 0.5 * h, cursor)
        if status != OK:
            return status
    cursor[EVALUATIONS] += 1 + hybrid.meeting.size[FOUND]
    return OK if finite(bodies) else BLOWN_UP


@jit
def put_back(hybrid):
    """Return to the step's start."""
    copy_orbits(hybrid.bodies.orbit, hybrid.start)
    copy_orbits(hybrid.bodies.centre, hybrid.centre)


@driver
def trace_loop(forces, given, slots, listed, masses, dt, start, y, first, steps, cursor):
    """Take ``steps`` steps, and y <- the state at the last step point. Return a status.

    The arguments are those of ``loops``. ``slots``, ``listed`` and ``masses`` are for ``leave_democratic``.
    """
    bound, others = handle(given), handle(forces)
    cursor, y = unowned(cursor), unowned(y)
    bodies, counts, moved, status = bound.bodies, bound.counts, bound.kept[5, :3], OK
    while cursor[STEP] < steps and status == OK:
        t = start + (first + cursor[STEP]) * dt
        if not counts[READY]:
            clear_flags(bound)
            find_flags(bound, dt)
            attract_all(bound)
            counts[READY] = 1
        copy_orbits(bound.start, bodies.orbit)
        copy_orbits(bound.centre, bodies.centre)
        status = attempt(others, bound, dt, t, moved, cursor)
        if status == OK:
            flagged = counts[PAIRS] + counts[PASSAGES] > 0
            if find_flags(bound, dt) > 0:
                put_back(bound)
                attract_all(bound)
                counts[TWICE] += 1
                flagged = True
                status = attempt(others, bound, dt, t, moved, cursor)
        if status == OK:
            if flagged:
                note_used(bound)
                clear_flags(bound)
                find_flags(bound, dt)
            cursor[STEP] += 1
        else:
            put_back(bound)
            counts[READY] = 0
    for half in range(2):
        for k in range(3):
            leave_democratic(bodies.orbit, bodies.carry, bodies.centre, slots, listed, masses, half, k, y)
    return status

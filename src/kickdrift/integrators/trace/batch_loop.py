"""Compiled loop of the hybrid map for eight small systems at once, one system in each lane.

All lanes take the Wisdom-Holman step of ``loop``, and find the switches at its end together. A system with a near
pair or a pericentre passage at either end takes this step alone, by the code of ``loop``.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from kickdrift.forces.bound.table import EVALUATIONS
from kickdrift.forces.gravity.batch import look_in_lanes
from kickdrift.forces.seam.kernel import OK
from kickdrift.integrators.stepping.batch_loops import copy_in_lanes
from kickdrift.integrators.stepping.loops import STEP
from kickdrift.integrators.trace.batch_events import Limits, happens, may_happen
from kickdrift.integrators.trace.state import NONE, PAIRS, PASSAGES, READY, Hybrid
from kickdrift.integrators.trace.switch import comes_near, passage
from kickdrift.integrators.wisdom_holman import batch_loop as lanes
from kickdrift.integrators.wisdom_holman import bodies as rows
from kickdrift.jit.compile import driver, in_order, jit
from kickdrift.jit.handle import handle, status_at, unowned
from kickdrift.jit.lanes.functions import splat
from kickdrift.jit.lanes.masks import lowest_bit, mask_bits, select
from kickdrift.jit.lanes.memory import load, store
from kickdrift.jit.lanes.vector3 import dot, load3
from kickdrift.jit.lanes.vectors import WIDTH

ALL = 255  # bits of eight lanes
FAR = 4.0  # empty slots circle this many times as far out as the farthest body, as in ``WisdomHolmanStepper``
# Rows of ``marks``: 1 for a system with a near pair or a passage at the step point; steps of the present sample's that
# are done; 1 for a system that has stopped for good; 1 for a system in whose last step an event may have happened;
# evaluations.
FLAGGED, TAKEN, STILL, LOUD, COST = range(5)
MARKS = 5


class LaneTrace(NamedTuple):
    """Eight systems, their bodies in the order of the list with the central one first."""

    orbits: lanes.LaneOrbits
    start: NDArray[np.float64]  # (2, 3, n - 1, 8) orbits at the step's start
    begun: NDArray[np.float64]  # (3, n - 1, 8) accelerations there
    reach: NDArray[np.float64]  # (n - 1, 8) squared hand-over radii, see ``state.Hybrid``
    slots: NDArray[np.int64]  # (n - 1, 8) place of each body in ``alone``
    marks: NDArray[np.int64]  # (MARKS, 8)
    idle: NDArray[np.float64]  # (8,) 1 for a lane that does not take the step
    ended: NDArray[np.float64]  # (2, 3, n, 8) last states of the systems that have stopped
    limits: Limits
    way: int  # of pericentre passages


class Alone(NamedTuple):
    """Room for a system that takes a step alone, as ``loop`` has it."""

    hybrid: Hybrid
    slots: NDArray[np.int64]  # (n,) arguments of ``wisdom_holman.loop.leave``, whose result is not used
    listed: NDArray[np.int64]  # (n,)
    masses: NDArray[np.float64]  # (3, n)
    y: NDArray[np.float64]  # (2, 3, n)


# --- steps together ---


@in_order
def lanes_flags(own, dt, way):
    """Bits of the lanes with a near pair or a pericentre passage; see ``switch``."""
    x, v, gm, reach = own.orbits.orbit[0], own.orbits.orbit[1], own.orbits.table[rows.GM], own.reach
    stride, half = gm.size, 0.5 * dt
    found = splat(0.0) > 1.0
    for p in range(0, stride, WIDTH):
        xi, vi, far_i = load3(x, p, stride), load3(v, p, stride), load(reach, p)
        if way != NONE:
            found = found | passage(xi, vi, load(gm, p), dt) | (far_i >= 1.0)
        own_i = far_i * dot(xi, xi)
        for q in range(p + WIDTH, stride, WIDTH):
            xj = load3(x, q, stride)
            own_j, d, u = load(reach, q) * dot(xj, xj), xj - xi, load3(v, q, stride) - vi
            found = found | comes_near(d, u, half, select(own_j > own_i, own_j, own_i))
    return mask_bits(found)


@in_order
def go_back(own):
    """Put idle lanes back to the step's start."""
    orbit, start, mutual, begun = own.orbits.orbit, own.start, own.orbits.work[lanes.MUTUAL], own.begun
    idle = load(own.idle, 0) > 0.5
    for p in range(0, orbit.size, WIDTH):
        store(orbit, p, select(idle, load(start, p), load(orbit, p)))
    for p in range(0, begun.size, WIDTH):
        store(mutual, p, select(idle, load(begun, p), load(mutual, p)))


@in_order
def step_together(own, dt):
    """A step of all lanes, without encounters."""
    copy_in_lanes(own.start, own.orbits.orbit)
    copy_in_lanes(own.begun, own.orbits.work[lanes.MUTUAL])
    half, zero = 0.5 * dt, splat(0.0)
    lanes.kick(own.orbits, half)
    lanes.jump(own.orbits, half)
    lanes.drift(own.orbits, own.orbits.orbit, dt, zero, False)
    lanes.jump(own.orbits, half)
    lanes.mutual_accelerations(own.orbits, own.orbits.orbit[0], zero)
    lanes.kick(own.orbits, half)


@jit
def awake(marks, count, idle):
    """Bits of the lanes that go on to ``count`` steps, and how many steps all of them have left."""
    bits, left = 0, count
    for k in range(WIDTH):
        idle[k] = 1.0
        if marks[TAKEN, k] < count and marks[STILL, k] == 0 and marks[LOUD, k] == 0:
            bits |= 1 << k
            idle[k] = 0.0
            left = min(left, count - marks[TAKEN, k])
    return bits, left


@in_order
def steps_together(own, dt, count):
    """Take steps until all lanes that are awake have taken ``count``, or a step needs more. Return the bits of the
    lanes that take this step alone, those in whose step an event may have happened, and whether steps are left."""
    marks, lengths = own.marks, load(dt, 0)
    flagged, some, near = 0, 0, 0
    for k in range(WIDTH):
        flagged |= marks[FLAGGED, k] << k
    bits, left = awake(marks, count, own.idle)
    while bits != 0 and some | near == 0:
        taken = 0
        while taken < left and some | near == 0:
            step_together(own, lengths)
            if bits != ALL:
                go_back(own)
            found = lanes_flags(own, lengths, own.way)
            some = (flagged | found) & bits
            flagged = (found & bits) | (flagged & ~bits)
            if own.limits.watched:
                near = may_happen(own, lengths) & bits & ~some
            taken += 1
        for k in range(WIDTH):
            marks[TAKEN, k] += taken * ((bits >> k) & 1)
            marks[COST, k] += taken * ((bits >> k) & 1) - ((some >> k) & 1)
        if some | near == 0:
            bits, left = awake(marks, count, own.idle)
    for k in range(WIDTH):
        marks[FLAGGED, k] = (flagged >> k) & 1
    return some, near, bits != 0


# --- steps alone ---


@jit
def enter_alone(own, alone, k):
    """Put the bodies of lane k, at the step's start, into the slots of a system alone."""
    room = alone.hybrid
    orbit, table, slots, start = room.bodies.orbit, room.bodies.table, own.slots, own.start
    room.counts[READY] = 0
    central, farthest = own.orbits.central[k], 0.0
    for i in range(slots.shape[0]):
        d2 = 0.0
        for axis in range(3):
            d2 += start[0, axis, i, k] ** 2
        farthest = max(farthest, d2)
    farthest = FAR * np.sqrt(farthest)
    for s in range(orbit.shape[1]):
        table[rows.LIVE, s] = table[rows.SOURCE, s] = table[rows.OTHERS, s] = room.reach[s] = 0.0
        table[rows.GM, s] = central
        for row in range(6):
            orbit[row, s] = 0.0
        orbit[0, s] = farthest * (1.0 + s)
        orbit[4, s] = np.sqrt(central / orbit[0, s])
    for i in range(slots.shape[0]):
        s = slots[i, k]
        table[rows.LIVE, s], table[rows.SOURCE, s] = 1.0, own.orbits.table[rows.SOURCE, i, k]
        table[rows.OTHERS, s], room.reach[s] = own.orbits.table[rows.OTHERS, i, k], own.reach[i, k]
        for half in range(2):
            for axis in range(3):
                orbit[3 * half + axis, s] = start[half, axis, i, k]


@jit
def leave_alone(own, alone, k, fine):
    """Put the bodies back into lane k, with their accelerations; numbers that are not finite after a failure. Return 1
    if the system has a near pair or a passage now, else 0."""
    room = alone.hybrid
    orbit, work, slots, mutual = room.bodies.orbit, room.bodies.work, own.slots, own.orbits.work[lanes.MUTUAL]
    for i in range(slots.shape[0]):
        s = slots[i, k]
        for axis in range(3):
            mutual[axis, i, k] = work[rows.MUTUAL + axis, s]
            for half in range(2):
                own.orbits.orbit[half, axis, i, k] = orbit[3 * half + axis, s] if fine else np.nan
    return 1 if room.counts[PAIRS] + room.counts[PASSAGES] > 0 else 0


# --- the loop ---


@driver
def batch_trace_loop(forces, given, alone, alone_at, quiet_at, y, dt, done, counts, first, looks, cursor):
    """Take ``counts`` (k,) steps before each sample from number ``first`` on, after ``done`` steps. Return the number
    of samples; fewer if events may have happened. A step alone is that of ``loop``, which is at ``alone_at``."""
    own, dt, cursor = handle(given), unowned(dt), unowned(cursor)
    y, counts, looks = unowned(y), unowned(counts), unowned(looks)
    orbits, marks, room = own.orbits, own.marks, handle(alone)
    for sample in range(first, counts.size):
        left, loud = True, 0
        while left and loud == 0:
            some, near, left = steps_together(own, dt, counts[sample])
            while some != 0:
                k = lowest_bit(some)
                some &= some - 1
                enter_alone(own, room, k)
                cursor[STEP], before = 0, cursor[EVALUATIONS]
                status = status_at(
                    alone_at,
                    (forces, alone.hybrid, alone.slots, alone.listed, alone.masses, dt[k], 0.0, alone.y, 0, 1, cursor),
                )
                marks[COST, k] += cursor[EVALUATIONS] - before
                marks[FLAGGED, k] = leave_alone(own, room, k, status == OK)
                if own.limits.watched and happens(own, room.hybrid, quiet_at, k, dt[k], True):
                    loud, marks[LOUD, k] = 1, 1
            while near != 0:
                k = lowest_bit(near)
                near &= near - 1
                if happens(own, room.hybrid, quiet_at, k, dt[k], False):
                    loud, marks[LOUD, k] = 1, 1
        if loud:
            return sample
        done += counts[sample]
        lanes.leave(orbits, orbits.orbit, y, float(done) * load(dt, 0))
        for k in range(WIDTH):
            marks[TAKEN, k] = 0
            if marks[STILL, k]:
                y[..., k] = own.ended[..., k]
        look_in_lanes(orbits.bodies, y[0], y[1], looks[sample])
    return counts.size


@driver
def begin_lanes(given, dt):
    """Accelerations and switches at the start."""
    own = handle(given)
    lanes.mutual_accelerations(own.orbits, own.orbits.orbit[0], splat(0.0))
    found = lanes_flags(own, load(unowned(dt), 0), own.way)
    for k in range(WIDTH):
        own.marks[FLAGGED, k] = (found >> k) & 1

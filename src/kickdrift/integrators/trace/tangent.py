"""Tangent map of the hybrid map: the derivatives of its steps, by duals.

Coordinates are democratic heliocentric. A step is the product of the tangent maps of kick, jump, drift, jump and kick
(Mikkola & Innanen 1999, doi:10.1023/A:1008312912468, for the drift). Bodies that meet take their Gauss-Radau steps on
duals, see `tangent_meeting`. The pairs and passages are constants: between two switches the map is smooth. The
map's own code moves the bodies, so they move as in a run without derivatives. Duals of duals give second derivatives.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from kickdrift.forces.seam.kernel import OK
from kickdrift.integrators.stepping.loops import STEP
from kickdrift.integrators.trace import tangent_state as part
from kickdrift.integrators.trace.state import FULL, POINTS
from kickdrift.integrators.trace.tangent_meeting import enter_meeting, heavy_passes, meet_again
from kickdrift.integrators.trace.tangent_others import kick_by_others_duals
from kickdrift.integrators.trace.tangent_state import DualMeeting, dual_meeting
from kickdrift.integrators.wisdom_holman import tangent_columns
from kickdrift.integrators.wisdom_holman.tangent import pull_of
from kickdrift.integrators.wisdom_holman.tangent_drift import drift_duals, fill_kepler
from kickdrift.jit.compile import driver, jit, never_inline
from kickdrift.jit.duals import functions as functions  # what duals take part in
from kickdrift.jit.duals.dual import as_dual, dual_rows
from kickdrift.jit.duals.operators import dual_vector, put_vector, vector_at
from kickdrift.jit.handle import handle, status_at
from kickdrift.jit.lanes.memory import flat
from kickdrift.jit.lanes.vectors import WIDTH

CROWDED = 100  # status: more points inside a step than the path has rows


class TraceTangents(NamedTuple):
    """A state with derivatives, on its way through the map. The central body comes first, then massive bodies."""

    rows: NDArray[np.float64]  # of `tangent_columns.Blocks`, rows ROWS of n vectors
    columns: NDArray[np.int64]  # (blocks, 2), see there
    slot: NDArray[np.int64]  # (n,) slot of each body; that of the central one has no meaning
    number: NDArray[np.int64]  # (slots,) number of the body in a slot
    met: NDArray[np.uint8]  # (n,) 1: the body moved with others in the last step
    massive: int  # number of massive bodies, with the central one
    order: NDArray[np.int64]  # (n,) row of each body in the system
    others: NDArray[np.int64]  # (other forces, 2) addresses of their slopes and of their parts
    pushes: NDArray[np.int64]  # (p, 3) what masses and parameters do in other forces, see `add_pushes`
    block: NDArray[np.int64]  # (1,) number of the block that moves now
    moving: bool  # other forces depend on velocity
    meeting: DualMeeting


def trace_tangents(
    phase: tangent_columns.Derived,
    gm: tangent_columns.Derived,
    order: NDArray[np.int64],
    slot: NDArray[np.int64],
    slots: int,
    others: NDArray[np.int64],
    pushes: NDArray[np.int64],
    moving: bool,
) -> TraceTangents:
    """Bring a phase (2, 3, n), and G m (n,), to democratic heliocentric coordinates."""
    n, twice = len(gm.values), gm.second.size > 0
    number = np.zeros(slots, np.int64)
    number[slot[1:]] = np.arange(1, n)
    massive, blocks = (
        int(np.count_nonzero(gm.values > 0.0)),
        tangent_columns.blocks_of(gm.slopes.shape[1], part.ROWS, n, twice),
    )
    made = TraceTangents(
        *blocks, slot, number, np.zeros(n, np.uint8), massive,
        order, others, pushes, np.zeros(1, np.int64), moving, dual_meeting(massive + 1, twice),
    )  # fmt: skip
    enter_democratic(*blocks, phase, gm)
    return made


@jit
def centre_of(x, masses):
    """Return the centre of mass."""
    total, sum_x = as_dual(0.0), dual_vector((0.0, 0.0, 0.0))
    for i in range(x.shape[1]):
        total += masses[0, i]
        sum_x = sum_x + masses[0, i] * vector_at(x, i)
    return (as_dual(1.0) / total) * sum_x


@driver
def enter_democratic(blocks, columns, phase, gm):
    """Fill the blocks."""
    n = gm.values.size
    for block in range(blocks.shape[0]):
        masses = dual_rows(blocks[block, part.MASSES], n)
        tangent_columns.enter_masses(masses, gm, columns[block])
        for i in range(n):
            masses[1, i], masses[2, i] = masses[0, 0], masses[0, i] / masses[0, 0]
        for half in range(2):
            x = dual_rows(blocks[block, half], n)
            tangent_columns.enter_phase(x, half, phase, columns[block])
            centre = centre_of(x, masses)
            origin = vector_at(x, 0) if half == 0 else centre
            for i in range(1, n):
                put_vector(x, i, vector_at(x, i) - origin)
            put_vector(x, 0, centre)


@driver
def leave_democratic(blocks, columns, n, phase):
    """phase (2, 3, n) <- positions and velocities."""
    for block in range(blocks.shape[0]):
        masses = dual_rows(blocks[block, part.MASSES], n)
        total = as_dual(0.0)
        for i in range(n):
            total += masses[0, i]
        for half in range(2):
            x, moved = dual_rows(blocks[block, half], n), dual_vector((0.0, 0.0, 0.0))
            for i in range(1, n):
                moved = moved + masses[0, i] * vector_at(x, i)
            central = vector_at(x, 0) - (as_dual(1.0) / (total if half == 0 else masses[0, 0])) * moved
            origin = central if half == 0 else vector_at(x, 0)
            for i in range(n):
                own = central if i == 0 else vector_at(x, i) + origin
                tangent_columns.leave_number(phase, half * 3 * n + i, own.x, columns[block])
                tangent_columns.leave_number(phase, (half * 3 + 1) * n + i, own.y, columns[block])
                tangent_columns.leave_number(phase, (half * 3 + 2) * n + i, own.z, columns[block])


@driver
def put_values(blocks, slot, orbit, centre):
    """Positions and velocities of the blocks <- those of the map's bodies; slopes stay."""
    n = slot.size
    for block in range(blocks.shape[0]):
        for half in range(2):
            numbers = flat(blocks[block, half])
            size = numbers.size // (3 * n)
            for k in range(3):
                numbers[k * n * size] = centre[half, k] + centre[half + 2, k]
                for i in range(1, n):
                    numbers[(k * n + i) * size] = orbit[3 * half + k, slot[i]]


@driver
def trace_tangent_steps(
    loop, forces, hybrid, slots, listed, masses, dt, start, y, first, steps, cursor, tangents
):  # fmt: skip
    """Take ``steps`` steps of ``loop``, at the address ``loop``, and of its tangent map. Return a status.
    ``cursor`` has the steps taken in the last place.
    """
    given, own = handle(hybrid), handle(tangents)
    for step in range(steps):
        hybrid.used[...] = 0
        cursor[STEP] = 0
        status = status_at(loop, (forces, hybrid, slots, listed, masses, dt, start, y, first + step, 1, cursor))
        if status == OK:
            put_values(own.rows, own.slot, hybrid.start, hybrid.centre)
            status = tangent_step(given, own, start + (first + step) * dt, dt)
        if status != OK:
            cursor[STEP] = step
            return status
    cursor[STEP] = steps
    return OK


@jit
def tangent_step(hybrid, own, t, h):
    """Move the derivatives by the last step of the map, which began at t. Return a status."""
    blocks, points, n = own.rows, hybrid.counts[POINTS], own.slot.size
    if points + own.meeting.slots.size > hybrid.path.shape[0]:
        return CROWDED
    own.met[:] = 0
    for row in range(points):
        if hybrid.path[row, 1] >= 0.0:
            own.met[own.number[int(hybrid.path[row, 1])]] = 1
    heavy = heavy_passes(hybrid)
    for block in range(blocks.shape[0]):
        own.block[0] = block
        status = until_drift(hybrid, own, blocks[block], t, h, heavy)
        if status != OK:
            return status
    changes, slopes = np.empty((n, 6)), np.empty(6 * n * WIDTH)
    first = blocks[0]
    fill_kepler(
        dual_rows(first[part.X], n), dual_rows(first[part.V], n), dual_rows(first[part.MASSES], n), h, changes, slopes
    )
    for block in range(blocks.shape[0]):
        rows, own.block[0] = blocks[block], block
        drift_duals(
            dual_rows(rows[part.X], n), dual_rows(rows[part.V], n), dual_rows(rows[part.MASSES], n), h, changes, slopes
        )
        status = from_drift(hybrid, own, rows, t, h, heavy)
        if status != OK:
            return status
    return OK


@jit
def until_drift(hybrid, own, rows, t, h, heavy):
    """Kicks, and the jump or the passage of the massive bodies. Return a status."""
    never_inline()
    if own.others.shape[0] > 0:
        status = kick_by_others_duals(rows, own, t, 0.5 * h)
        if status != OK:
            return status
    kick_duals(hybrid, own, rows, 0.5 * h, heavy)
    if not heavy:
        jump_duals(hybrid, own, rows, 0.5 * h)
        rows[part.LOST_X] = rows[part.LOST_V] = 0.0
    if hybrid.counts[POINTS] > 0:
        rows[part.MIDDLE_X], rows[part.MIDDLE_V] = rows[part.X], rows[part.V]
    if heavy:
        status = pass_duals(hybrid, own, rows)
        if status != OK:
            return status
        shift_duals(own, rows)
    return OK


@jit
def from_drift(hybrid, own, rows, t, h, heavy):
    """Encounters, the jump, and kicks. Return a status."""
    never_inline()
    if heavy:
        keep_duals(own, rows)
        shift_duals(own, rows)
    status = meet_duals(hybrid, own, rows)
    if status != OK:
        return status
    if not heavy:
        jump_duals(hybrid, own, rows, 0.5 * h)
    kick_duals(hybrid, own, rows, 0.5 * h, heavy)
    if own.others.shape[0] > 0:
        return kick_by_others_duals(rows, own, t + h, 0.5 * h)
    return OK


# --- kicks and jumps ---


@jit
def kick_duals(hybrid, own, rows, h, heavy):
    """Kick each body by the massive bodies that are not near it, as ``loop.kick`` does."""
    never_inline()
    n, slot, used = own.slot.size, own.slot, hybrid.used
    x, v, masses = dual_rows(rows[part.X], n), dual_rows(rows[part.V], n), dual_rows(rows[part.MASSES], n)
    together = heavy and hybrid.way == FULL  # bodies that move together feel all attractions there
    for i in range(2, n):
        if together and own.met[i]:
            continue
        speed = vector_at(v, i)
        for j in range(1, min(i, own.massive)):
            if not used[slot[j], slot[i]]:
                pull = h * pull_of(vector_at(x, j) - vector_at(x, i))
                speed = speed + masses[0, j] * pull
                if i < own.massive:
                    put_vector(v, j, vector_at(v, j) - masses[0, i] * pull)
        put_vector(v, i, speed)


@jit
def jump_duals(hybrid, own, rows, h):
    """Move all bodies by the central body's way, except massless bodies that pass their pericentre."""
    never_inline()
    n, move, passes = own.slot.size, dual_vector((0.0, 0.0, 0.0)), hybrid.used.shape[0] - 1
    x, v, masses = dual_rows(rows[part.X], n), dual_rows(rows[part.V], n), dual_rows(rows[part.MASSES], n)
    for i in range(1, own.massive):
        move = move + masses[2, i] * vector_at(v, i)
    move = h * move
    for i in range(1, n):
        if not hybrid.used[passes, own.slot[i]]:
            put_vector(x, i, vector_at(x, i) + move)


@jit
def shift_duals(own, rows):
    """Move massless bodies that meet no other by half the central body's way."""
    n = own.slot.size
    x, moved = dual_rows(rows[part.X], n), 0.5 * vector_at(dual_rows(rows[part.AFTER_X], n), 0)
    for i in range(own.massive, n):
        if not own.met[i]:
            put_vector(x, i, vector_at(x, i) + moved)


# --- bodies that move together ---


@jit
def pass_duals(hybrid, own, rows):
    """AFTER_X and AFTER_V <- the end of the passage of all massive bodies, whose path is the first. Return a status.

    Deviations grow in a passage and shrink after it. So each rounding at a step's end near the pericentre would remain,
    enlarged; the next step takes what rounding has taken."""
    meeting, count = own.meeting, own.slot.size
    lost_x, lost_v = dual_rows(rows[part.LOST_X], count), dual_rows(rows[part.LOST_V], count)
    n = enter_meeting(hybrid, meeting, own.number, 0)
    left_x, left_v = dual_rows(meeting.lost_x, n), dual_rows(meeting.lost_v, n)
    for i in range(n):
        body = meeting.members[i]
        put_vector(left_x, i, vector_at(lost_x, body))
        put_vector(left_v, i, vector_at(lost_v, body))
    status = meet_again(hybrid, own, rows, n, 0, hybrid.counts[POINTS])
    if status != OK:
        return status
    masses, middle = dual_rows(rows[part.MASSES], count), dual_rows(rows[part.MIDDLE_X], count)
    after_x, after_v = dual_rows(rows[part.AFTER_X], count), dual_rows(rows[part.AFTER_V], count)
    x, v = dual_rows(meeting.x, n), dual_rows(meeting.v, n)
    moved, mass = dual_vector((0.0, 0.0, 0.0)), as_dual(1.0)
    for i in range(n):
        body = meeting.members[i]
        put_vector(after_x, body, vector_at(x, i))
        put_vector(after_v, body, vector_at(v, i))
        put_vector(lost_x, body, vector_at(left_x, i))
        put_vector(lost_v, body, vector_at(left_v, i))
        moved = moved + masses[2, body] * (vector_at(x, i) - vector_at(middle, body))
        mass += masses[2, body]
    put_vector(after_x, 0, (as_dual(1.0) / mass) * moved)
    return OK


@jit
def keep_duals(own, rows):
    """Write the end of the passage of the massive bodies."""
    n = own.slot.size
    for half in range(2):
        x, after = dual_rows(rows[part.X + half], n), dual_rows(rows[part.AFTER_X + half], n)
        for i in range(1, own.massive):
            put_vector(x, i, vector_at(after, i))


@jit
def meet_duals(hybrid, own, rows):
    """Move the bodies that meet, one meeting after another, but for the passage of all massive bodies. Return a
    status."""
    never_inline()
    meeting, points, row = own.meeting, hybrid.counts[POINTS], 0
    places, speeds = dual_rows(rows[part.X], own.slot.size), dual_rows(rows[part.V], own.slot.size)
    passed = heavy_passes(hybrid)
    while row < points:
        n = enter_meeting(hybrid, meeting, own.number, row)
        if not passed:
            meeting.lost_x[:] = meeting.lost_v[:] = 0.0
            status = meet_again(hybrid, own, rows, n, row, points)
            if status != OK:
                return status
            x, v = dual_rows(meeting.x, n), dual_rows(meeting.v, n)
            for i in range(0 if meeting.members[n - 1] < own.massive else n - 1, n):
                put_vector(places, meeting.members[i], vector_at(x, i))
                put_vector(speeds, meeting.members[i], vector_at(v, i))
        passed = False
        row += n
        while row < points and hybrid.path[row, 0] > 0.0:
            row += n
    return OK

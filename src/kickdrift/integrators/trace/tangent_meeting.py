"""Bodies that meet, with derivatives: the Gauss-Radau steps of the hybrid map once more, on duals.

The steps have the lengths that the map took. A dual's numbers join the method's state as they are, since the method is
linear in the accelerations.
"""

from __future__ import annotations

import numpy as np

from kickdrift.forces.seam.kernel import BLOWN_UP, OK
from kickdrift.integrators.gauss_radau.series import (
    AHEAD,
    AT_NODE,
    BASE,
    BLOCK,
    GUESS,
    GUESS_LAST,
    LAST,
    LOST_V,
    LOST_X,
    NODES,
    NOW,
    ROWS,
    SCALE,
    V,
    X,
    correct,
    finish,
    place_velocities,
    predict,
    prepare,
)
from kickdrift.integrators.gauss_radau.step import CONVERGED, MOST, PATIENCE, TERMS
from kickdrift.integrators.trace.state import FULL, GAUSS_RADAU
from kickdrift.integrators.trace.tangent_attraction import attract_duals
from kickdrift.integrators.trace.tangent_extrapolation import replay_extrapolation
from kickdrift.integrators.trace.tangent_rows import MASSES, MIDDLE_V, MIDDLE_X
from kickdrift.jit.compile import as_written, is_finite, jit, never_inline
from kickdrift.jit.duals import functions as functions  # what duals take part in
from kickdrift.jit.duals.dual import as_dual, dual_rows
from kickdrift.jit.duals.operators import dual_vector, put_vector, vector_at
from kickdrift.jit.lanes.functions import lane_max, plus, splat
from kickdrift.jit.lanes.memory import flat, load, store
from kickdrift.jit.lanes.vectors import WIDTH

STALLED = 1e-3  # a stalled residual below this is rounding, of places far from the centre in a close encounter
LEAST = 2  # iterations before the first that may be the last: by then the scale of residuals is known


@jit
def set_scales(work, width, size, numbers):
    """Set the scale of residuals: one over the largest coefficients of all bodies, for values and for each column."""
    for column in range(numbers):
        largest = 0.0
        for i in range(column, size, numbers):
            total = 0.0
            for row in range(NOW, NOW + TERMS):
                total += abs(work[row * width + i])
            largest = max(largest, total)
        inverse = 1.0 / largest if largest > 0.0 else 0.0
        for i in range(column, size, numbers):
            work[SCALE * width + i] = inverse


@jit
def iterate_duals(hybrid, own, rows, n, everyone, width, done, h):
    """Correct the step's polynomial until only rounding is left. Return a status.

    The motion itself has converged at this length, and its derivatives converge as fast. So a residual that stops
    falling is rounding."""
    never_inline()
    meeting = own.meeting
    work, x, v, a = meeting.work, flat(meeting.x), flat(meeting.v), flat(meeting.a)
    tables, residual = hybrid.tables, np.inf
    prepare(work, width, tables, 0, h, True)
    for i in range(0, width, WIDTH):
        store(work, AT_NODE * width + i, load(work, AHEAD * width + i))
        store(x, i, plus(load(work, X * width + i), load(work, BASE * width + i)))
    for count in range(MOST):
        if count < LEAST:
            set_scales(work, width, 3 * n * meeting.numbers, meeting.numbers)
        worst = splat(0.0)
        for row in range(NODES):
            following = row + 1 if row + 1 < NODES else 0
            if own.moving:
                place_velocities(work, width, v, 0, tables, row, h)
            status = attract_duals(hybrid, own, rows, n, everyone, done + tables.nodes[row + 1] * h)
            if status != OK:
                return status
            prepare(work, width, tables, following, h, True)
            worst, _ = correct(work, width, a, 0, x, tables, row, following, h, True, worst)
        missed = lane_max(worst)
        if not is_finite(missed):
            return BLOWN_UP
        if count >= LEAST:
            if missed == 0.0 or missed * missed / residual <= CONVERGED:
                return OK
            if count >= PATIENCE and missed >= residual:
                break
        residual = missed
    return OK if missed <= STALLED else BLOWN_UP


@jit
def replay(hybrid, own, rows, n, everyone, first, points):
    """Move the bodies of ``meeting`` over the steps that begin at row ``first`` of the path. Return a status."""
    never_inline()
    meeting = own.meeting
    work, path, tables, h = meeting.work, hybrid.path, hybrid.tables, hybrid.span[1]
    x, v, a, size = flat(meeting.x), flat(meeting.v), flat(meeting.a), 3 * n * meeting.numbers
    width = BLOCK * ((size + BLOCK - 1) // BLOCK)
    for i in range(ROWS * width):
        work[i] = 0.0
    lost_x, lost_v = flat(meeting.lost_x), flat(meeting.lost_v)
    for i in range(size, width):
        x[i] = a[i] = 0.0
    for i in range(size):
        work[X * width + i], work[V * width + i] = x[i], v[i]
        work[LOST_X * width + i], work[LOST_V * width + i] = lost_x[i], lost_v[i]
    at, done, last, before = first + n, 0.0, 0.0, 0.0
    while done < h:
        if at >= points or not path[at, 0] > done:
            return BLOWN_UP
        step = path[at, 0] - done
        for i in range(0, width, WIDTH):
            store(x, i, load(work, X * width + i))
            if own.moving:
                store(v, i, load(work, V * width + i))
        status = attract_duals(hybrid, own, rows, n, everyone, done)
        if status != OK:
            return status
        for i in range(0, width, WIDTH):
            store(work, NOW * width + i, load(a, i))
        ratio = step / last if last > 0.0 else 0.0
        predict(work, width, ratio, before, tables.shifts)
        status = iterate_duals(hybrid, own, rows, n, everyone, width, done, step)
        if status != OK:
            return status
        for i in range(0, TERMS * width, WIDTH):
            store(work, LAST * width + i, load(work, NOW * width + i))
            store(work, GUESS_LAST * width + i, load(work, GUESS * width + i))
        finish(work, width, X, LOST_X, tables.positions, tables.positions_low, step, True)
        finish(work, width, V, LOST_V, tables.velocities, tables.velocities_low, step, False)
        done = path[at, 0]
        last, before, at = step, ratio, at + n
    for i in range(size):
        x[i], v[i] = work[X * width + i], work[V * width + i]
        lost_x[i], lost_v[i] = work[LOST_X * width + i], work[LOST_V * width + i]
    return OK


@as_written
def add_exactly(x, lost, i, change):
    """Add a vector and the lost part to x of body i; the lost part <- the rounding error (Knuth 1969)."""
    before, change = vector_at(x, i), change + vector_at(lost, i)
    after = before + change
    taken = after - before
    put_vector(x, i, after)
    put_vector(lost, i, (before - (after - taken)) + (change - taken))


@jit
def momentum_duals(meeting, masses, n):
    """Sum of m v over m_0 of the bodies that meet."""
    v, total = dual_rows(meeting.v, n), dual_vector((0.0, 0.0, 0.0))
    for i in range(n):
        total = total + masses[2, meeting.members[i]] * vector_at(v, i)
    return total


@jit
def enter_meeting(hybrid, meeting, number, first):
    """members, slots and jumps <- those of the meeting at row ``first`` of the path. Return how many bodies."""
    path, massive = hybrid.path, hybrid.near.shape[0]
    n, heavy = int(path[first, 8]), heavy_passes(hybrid)
    for i in range(n):
        slot = int(path[first + i, 1])
        slot = slot if slot >= 0 else -1 - slot
        meeting.slots[i], meeting.members[i] = slot, number[slot]
        meeting.jumps[i] = heavy or (slot >= massive and hybrid.used[massive, slot] != 0)
    return n


@jit
def heavy_passes(hybrid):
    """Tell whether a massive body passed its pericentre in the last step."""
    massive, found = hybrid.near.shape[0], False
    for i in range(massive):
        found = found or hybrid.used[massive, i] != 0
    return found


@jit
def meet_again(hybrid, own, rows, n, first, points):
    """Move the bodies of ``meeting`` together from their places before the drift, to which the lost parts of
    ``meeting`` belong. Return a status."""
    meeting, count = own.meeting, own.slot.size
    masses = dual_rows(rows[MASSES], count)
    middle_x, middle_v = dual_rows(rows[MIDDLE_X], count), dual_rows(rows[MIDDLE_V], count)
    x, v, lost = dual_rows(meeting.x, n), dual_rows(meeting.v, n), dual_rows(meeting.lost_v, n)
    for i in range(n):
        put_vector(x, i, vector_at(middle_x, meeting.members[i]))
        put_vector(v, i, vector_at(middle_v, meeting.members[i]))
    move = momentum_duals(meeting, masses, n)
    for i in range(n):
        if meeting.jumps[i]:
            add_exactly(v, lost, i, move)
    everyone = hybrid.way == FULL and heavy_passes(hybrid)
    if hybrid.inner == GAUSS_RADAU:
        status = replay(hybrid, own, rows, n, everyone, first, points)
    else:
        status = replay_extrapolation(hybrid, own, rows, n, everyone, first, points)
    if status != OK:
        return status
    mass = as_dual(1.0)
    for i in range(n):
        if meeting.jumps[i]:
            mass += masses[2, meeting.members[i]]
    move = (as_dual(1.0) / mass) * momentum_duals(meeting, masses, n)
    for i in range(n):
        if meeting.jumps[i]:
            add_exactly(v, lost, i, -move)
    return OK

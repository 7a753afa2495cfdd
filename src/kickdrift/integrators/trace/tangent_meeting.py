"""Bodies that meet, with derivatives: the steps of `meeting` or `extrapolation` once more, on duals.

The steps have the lengths, and the rows of the table of extrapolation, that the map took. Both methods are linear in
the accelerations, so a dual's numbers join their state as they are.
"""

from kickdrift.forces.seam.kernel import BLOWN_UP, OK
from kickdrift.integrators.gauss_radau import series
from kickdrift.integrators.gauss_radau.step import AGAIN, CONVERGED, MOST, PATIENCE, TERMS
from kickdrift.integrators.trace import extrapolation
from kickdrift.integrators.trace import tangent_state as part
from kickdrift.integrators.trace.meeting import enter_work, leave_work, stepping, to_start, width_of
from kickdrift.integrators.trace.state import FULL, GAUSS_RADAU
from kickdrift.integrators.trace.tangent_others import add_inside_duals
from kickdrift.integrators.wisdom_holman.tangent import pull_of
from kickdrift.jit.compile import as_written, inlined, is_finite, jit, never_inline
from kickdrift.jit.duals import functions as functions  # what duals take part in
from kickdrift.jit.duals.dual import as_dual, dual_rows
from kickdrift.jit.duals.operators import dual_vector, put_vector, vector_at
from kickdrift.jit.lanes.memory import flat

STALLED = 1e-3  # a stalled residual below this is rounding, of places far from the centre in a close encounter
LEAST = 2  # iterations before the first that may be the last: by then the scale of residuals is known


@jit
def attract_duals(hybrid, own, rows, n, everyone, s):
    """a <- the accelerations of ``meeting.attract`` at x, a time s after the step's start. Return a status."""
    never_inline()
    meeting, masses = own.meeting, dual_rows(rows[part.MASSES], own.slot.size)
    x, a, used = dual_rows(meeting.x, n), dual_rows(meeting.a, n), hybrid.used
    members, slots = meeting.members, meeting.slots
    total = dual_vector((0.0, 0.0, 0.0))
    for i in range(n):
        pull = pull_of(vector_at(x, i))
        total = total + masses[0, members[i]] * pull
        put_vector(a, i, -(masses[0, 0] * pull))
    for i in range(n):
        felt = vector_at(a, i)
        for j in range(i):
            if everyone or used[slots[j], slots[i]]:
                pull = pull_of(vector_at(x, j) - vector_at(x, i))
                felt = felt + masses[0, members[j]] * pull
                put_vector(a, j, vector_at(a, j) - masses[0, members[i]] * pull)
        put_vector(a, i, felt)
    for i in range(n):
        if meeting.jumps[i]:
            put_vector(a, i, vector_at(a, i) - total)
    if own.others.shape[0] == 0:
        return OK
    return add_inside_duals(rows, own, n, hybrid.span[0], s, hybrid.span[1])


@inlined
def accelerate(move, t):
    hybrid, own, rows, n, everyone = move
    return attract_duals(hybrid, own, rows, n, everyone, t)


# --- Gauss-Radau ---


@jit
def set_scales(work, width, size, numbers):
    """Set the scale of residuals: one over the largest coefficients of all bodies, for values and for each column."""
    for column in range(numbers):
        largest = 0.0
        for i in range(column, size, numbers):
            total = 0.0
            for row in range(series.NOW, series.NOW + TERMS):
                total += abs(work[row * width + i])
            largest = max(largest, total)
        inverse = 1.0 / largest if largest > 0.0 else 0.0
        for i in range(column, size, numbers):
            work[series.SCALE * width + i] = inverse


@inlined
def rescale(move, count):
    _, own, _, n, _ = move
    if count < LEAST:
        size = 3 * n * own.meeting.numbers
        set_scales(own.meeting.work, width_of(size), size, own.meeting.numbers)


@inlined
def settled(count, missed, residual):
    """``step.verdict`` for duals. The motion itself has converged at this length, and its derivatives converge as fast.
    So a residual that stops falling is rounding."""
    if not is_finite(missed):
        return BLOWN_UP
    if count >= LEAST and (missed == 0.0 or missed * missed / residual <= CONVERGED):
        return OK
    if count == MOST - 1 or (count >= max(LEAST, PATIENCE) and missed >= residual):
        return OK if missed <= STALLED else BLOWN_UP
    return AGAIN


@inlined
def begin(move, width, h, first):
    """The polynomial begins with 0, and its scale is set in ``rescale``."""


attempt = stepping(accelerate, settled, rescale, begin)


@jit
def replay(hybrid, own, rows, n, everyone, first, points):
    """Move the bodies of ``meeting`` over the steps that begin at row ``first`` of the path. Return a status."""
    never_inline()
    meeting, path, tables, h = own.meeting, hybrid.path, hybrid.tables, hybrid.span[1]
    work, size = meeting.work, 3 * n * meeting.numbers
    width, lost_x, lost_v = width_of(size), flat(meeting.lost_x), flat(meeting.lost_v)
    enter_work(meeting, size, width)
    for i in range(size):
        work[series.LOST_X * width + i], work[series.LOST_V * width + i] = lost_x[i], lost_v[i]
    at, done, last, before = first + n, 0.0, 0.0, 0.0
    while done < h:
        if at >= points or not path[at, 0] > done:
            return BLOWN_UP
        step = path[at, 0] - done
        to_start(meeting, width, own.moving)
        status = attract_duals(hybrid, own, rows, n, everyone, done)
        if status != OK:
            return status
        ratio, move = step / last if last > 0.0 else 0.0, (hybrid, own, rows, n, everyone)
        status = attempt(move, meeting, width, tables, own.moving, done, step, ratio, before)
        if status != OK:
            return status
        series.pass_on(work, width, tables, step, True)
        done = path[at, 0]
        last, before, at = step, ratio, at + n
    leave_work(meeting, size, width)
    for i in range(size):
        lost_x[i], lost_v[i] = work[series.LOST_X * width + i], work[series.LOST_V * width + i]
    return OK


# --- extrapolation ---


leapfrog = extrapolation.leapfrog_of(accelerate)


@jit
def extrapolate(meeting, size, k):
    """Add x and v to the table as row k, and put the extrapolated values in their place."""
    never_inline()
    work = meeting.work
    for half in range(2):
        found = flat(meeting.x) if half == 0 else flat(meeting.v)
        for j in range(k):
            ratio, table = (k + 1.0) / (k - j), (extrapolation.FIRST + 2 * j + half) * size
            weight = 1.0 / (ratio * ratio - 1.0)
            for i in range(size):
                value, before = found[i], work[table + i]
                found[i], work[table + i] = value + weight * (value - before), value
        table = (extrapolation.FIRST + 2 * k + half) * size
        for i in range(size):
            work[table + i] = found[i]


@jit
def replay_extrapolation(hybrid, own, rows, n, everyone, first, points):
    """Move the bodies of ``meeting`` over the steps that begin at row ``first`` of the path. Return a status."""
    never_inline()
    meeting, path, h = own.meeting, hybrid.path, hybrid.span[1]
    work, size, at, done = meeting.work, 3 * n * meeting.numbers, first + n, 0.0
    x, v, a = flat(meeting.x), flat(meeting.v), flat(meeting.a)
    while done < h:
        if at >= points or not path[at, 0] > done:
            return BLOWN_UP
        step = path[at, 0] - done
        for i in range(size):
            work[extrapolation.X0 * size + i], work[extrapolation.V0 * size + i] = x[i], v[i]
        status = attract_duals(hybrid, own, rows, n, everyone, done)
        if status != OK:
            return status
        for i in range(size):
            work[extrapolation.A0 * size + i] = a[i]
        for k in range(int(path[at, 9]) + 1):
            status = leapfrog((hybrid, own, rows, n, everyone), meeting, size, done, step, 2 * (k + 1))
            if status != OK:
                return status
            extrapolate(meeting, size, k)
        done, at = path[at, 0], at + n
    return OK


# --- a meeting ---


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
    masses = dual_rows(rows[part.MASSES], count)
    middle_x, middle_v = dual_rows(rows[part.MIDDLE_X], count), dual_rows(rows[part.MIDDLE_V], count)
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

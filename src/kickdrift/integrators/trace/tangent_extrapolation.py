"""Bodies that meet, with derivatives: the steps of ``extrapolation`` once more, on duals.

The steps have the lengths and the rows of the table that the map took. Leapfrog and extrapolation are linear in the
accelerations, so a dual's numbers take part as they are.
"""

from __future__ import annotations

from kickdrift.forces.seam.kernel import BLOWN_UP, OK
from kickdrift.integrators.trace.extrapolation import A0, FIRST, V0, X0, kick_and_drift, set_out
from kickdrift.integrators.trace.tangent_attraction import attract_duals
from kickdrift.jit.compile import jit, never_inline
from kickdrift.jit.lanes.memory import flat


@jit
def leapfrog_duals(hybrid, own, rows, n, everyone, done, step, count):
    """Move x and v from the step's start, a time ``done`` after that of the map's step, by ``count`` kicks and drifts.
    Return a status."""
    never_inline()
    meeting, part = own.meeting, step / count
    size = 3 * n * meeting.numbers
    work, x, v, a = meeting.work, flat(meeting.x), flat(meeting.v), flat(meeting.a)
    set_out(work, x, v, size, part)
    for k in range(count):
        status = attract_duals(hybrid, own, rows, n, everyone, done + (k + 1) * part)
        if status != OK:
            return status
        kick_and_drift(x, v, a, size, part, k == count - 1)
    return OK


@jit
def extrapolate(meeting, size, k):
    """Add x and v to the table as row k, and put the extrapolated values in their place."""
    never_inline()
    work = meeting.work
    for half in range(2):
        found = flat(meeting.x) if half == 0 else flat(meeting.v)
        for j in range(k):
            ratio, table = (k + 1.0) / (k - j), (FIRST + 2 * j + half) * size
            weight = 1.0 / (ratio * ratio - 1.0)
            for i in range(size):
                value, before = found[i], work[table + i]
                found[i], work[table + i] = value + weight * (value - before), value
        table = (FIRST + 2 * k + half) * size
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
            work[X0 * size + i], work[V0 * size + i] = x[i], v[i]
        status = attract_duals(hybrid, own, rows, n, everyone, done)
        if status != OK:
            return status
        for i in range(size):
            work[A0 * size + i] = a[i]
        for k in range(int(path[at, 9]) + 1):
            status = leapfrog_duals(hybrid, own, rows, n, everyone, done, step, 2 * (k + 1))
            if status != OK:
                return status
            extrapolate(meeting, size, k)
        done, at = path[at, 0], at + n
    return OK

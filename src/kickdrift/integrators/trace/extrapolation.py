"""Motion of bodies that meet, by extrapolation: leapfrog with ever smaller steps, extrapolated to the step 0.

The error of leapfrog has even powers of the step alone, like the error of the modified midpoint rule. For forces of
positions alone, leapfrog needs half as many evaluations for each power (Gragg 1965, doi:10.1137/0702030; Bulirsch &
Stoer 1966, doi:10.1007/BF02165234; Hairer, Norsett & Wanner 1993, II.14, doi:10.1007/978-3-540-78862-1).
"""

import math
from collections.abc import Callable
from typing import Any

from kickdrift.forces.seam.kernel import BLOWN_UP, OK, RAISED
from kickdrift.integrators.trace.meeting import SHORTEST, accelerate, attract, note_path
from kickdrift.integrators.trace.state import NUMBER, TABLE_ROW
from kickdrift.jit.compile import jit
from kickdrift.jit.lanes.memory import flat

COLUMNS = 9  # of the table of extrapolation
TOLERANCE = 1e-11  # relative (Lu, Hernandez & Rein 2024)
AIM = 6  # column in which a step is to converge
X0, V0, A0, FIRST = 0, 1, 2, 3  # parts of the workspace, each of as many numbers as positions; then the table's columns


@jit
def set_out(work, x, v, size, part):
    """Half a kick and a drift of ``size`` numbers from the step's start, whose accelerations are known."""
    for i in range(size):
        v[i] = work[V0 * size + i] + 0.5 * part * work[A0 * size + i]
        x[i] = work[X0 * size + i] + part * v[i]


@jit
def kick_and_drift(x, v, a, size, part, last):
    """A kick and a drift of ``size`` numbers; half a kick alone if it is the ``last``."""
    for i in range(size):
        v[i] += (0.5 * part if last else part) * a[i]
        if not last:
            x[i] += part * v[i]


def leapfrog_of(accelerate: Callable[..., Any]) -> Callable[..., Any]:
    """Compiled leapfrog of bodies that meet, of numbers or duals; ``accelerate`` is as in ``series.iteration``."""

    @jit
    def leapfrog(move, meeting, size, done, step, count):
        """Move x and v from the step's start, a time ``done`` after that of the map's step, by ``count`` kicks and
        drifts. Return a status."""
        work, x, v, a = meeting.work, flat(meeting.x), flat(meeting.v), flat(meeting.a)
        part = step / count
        set_out(work, x, v, size, part)
        for k in range(count):
            status = accelerate(move, done + (k + 1) * part)
            if status != OK:
                return status
            kick_and_drift(x, v, a, size, part, k == count - 1)
        return OK

    return leapfrog


leapfrog = leapfrog_of(accelerate)


@jit
def extrapolated(hybrid, size, k):
    """Add x and v to the table as row k, and put the extrapolated values in their place. Return the error estimate."""
    meeting = hybrid.meeting
    n = meeting.size[NUMBER]
    error = 0.0
    for half in range(2):
        found = meeting.x if half == 0 else meeting.v
        worst = 0.0
        for body in range(n):
            change2, length2 = 0.0, 0.0
            for axis in range(3):
                i = axis * n + body
                value, last = found[i], 0.0
                for j in range(k):
                    at = (FIRST + 2 * j + half) * size + i
                    ratio = (k + 1.0) / (k - j)
                    last = value
                    value += (value - meeting.work[at]) / (ratio * ratio - 1.0)
                    meeting.work[at] = last
                meeting.work[(FIRST + 2 * k + half) * size + i] = value
                found[i] = value
                change2 += (value - last) ** 2
                length2 += value * value
            worst = max(worst, change2 / length2)
        error = max(error, worst)
    return math.sqrt(error)


@jit
def converge(hybrid, others, size, done, step):
    """Try one step from the start in ``work``. Return its last row, COLUMNS if it does not converge, or -1 if a force
    raised an error."""
    before = 1e300
    for k in range(COLUMNS):
        status = leapfrog((hybrid, others), hybrid.meeting, size, done, step, 2 * (k + 1))
        if status != OK:
            return -1 if status == RAISED else COLUMNS
        error = extrapolated(hybrid, size, k)
        if k > 0:
            if error <= TOLERANCE:
                return k
            if not error < 1e300 or (k > 3 and error > before and error > 1e-3):
                return COLUMNS
        before = error
    return COLUMNS


@jit
def follow_by_extrapolation(hybrid, others, h):
    """Move the bodies of ``meeting`` from x and v over a time h. Return a status."""
    meeting = hybrid.meeting
    work, size = meeting.work, 3 * meeting.size[NUMBER]
    done, step = 0.0, h
    while done < h:
        rest = h - done
        parts = math.ceil(rest / step - 1e-9)
        step = rest / parts if parts > 1 else rest
        for i in range(size):
            work[X0 * size + i], work[V0 * size + i] = meeting.x[i], meeting.v[i]
        status = attract(hybrid, others, done)
        if status != OK:
            return status
        for i in range(size):
            work[A0 * size + i] = meeting.a[i]
        k = converge(hybrid, others, size, done, step)
        while k == COLUMNS:
            step *= 0.3
            parts = 2
            if not step > SHORTEST * h:
                return BLOWN_UP
            k = converge(hybrid, others, size, done, step)
        if k < 0:
            return RAISED
        done = h if parts <= 1 else done + step
        meeting.size[TABLE_ROW] = k
        note_path(hybrid, done)
        step *= 1.6 if k < AIM - 1 else (1.2 if k < AIM else (0.9 if k == AIM else 0.7))
    return OK

"""Compiled loop of hermite4: gravity with its time derivative, and predict, evaluate, correct."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from kickdrift.forces.bound.table import EVALUATIONS
from kickdrift.forces.gravity.slope import Sources, acceleration_and_slope
from kickdrift.forces.seam.kernel import BLOWN_UP, OK
from kickdrift.integrators.stepping.loops import STEP
from kickdrift.integrators.stepping.stepper import STOPPED
from kickdrift.jit.compile import driver, is_finite, jit, never_inline
from kickdrift.jit.handle import handle
from kickdrift.jit.threads.chunks import Chunks, chunk_task, each_chunk

# Rows of a body's Taylor series at its own time.
X, V, A, JERK, SNAP, CRACKLE = range(6)
# Slots of the clock: time of the start; time since then of the last step point and of the one before; the next shared
# step; the given length of all steps, else 0; the steps taken since the start.
START, NOW, BEFORE, NEXT, FIXED, TAKEN = range(6)

TASKS = 64  # parts of the work on moving bodies
WORTH_THREADS = 20_000  # pairs; with fewer, waking threads takes longer than the sum
MOST = 2.0  # largest growth of a shared step


class Bodies(NamedTuple):
    """Bodies under gravity, each with its own time."""

    sources: Sources  # at predicted positions, with predicted velocities
    size: float  # the largest coordinate at the start
    series: NDArray[np.float64]  # (6, 3, n) x, v and four more derivatives at each body's own time
    times: NDArray[np.float64]  # (n,) each body's own, since the start
    steps: NDArray[np.float64]  # (n,) each body's own
    due: NDArray[np.int64]  # (n,) begins with the bodies that the present step moves
    moved: NDArray[np.int64]  # (1,) their number
    chunks: Chunks


@chunk_task
def accelerations_and_jerks(bodies, task):
    """Compute acceleration and jerk of every TASKS-th moving body."""
    never_inline()
    for k in range(task, bodies.moved[0], TASKS):
        acceleration_and_slope(bodies.sources, bodies.due[k])


@jit
def evaluate(bodies, time, cursor):
    """Compute acceleration and jerk of the moving bodies, at predicted positions of all. Return a status."""
    n, series, times, sources = bodies.times.size, bodies.series, bodies.times, bodies.sources
    for k in range(3):
        for i in range(n):
            s = time - times[i]
            a, jerk = series[A, k, i], series[JERK, k, i]
            sources.x[k, i] = series[X, k, i] + s * (series[V, k, i] + s / 2 * (a + s / 3 * jerk))
            sources.u[k, i] = series[V, k, i] + s * (a + s / 2 * jerk)
    count = bodies.moved[0]
    if count * n < WORTH_THREADS:
        each_chunk(bodies, Chunks(TASKS, 0), "accelerations_and_jerks")
    else:
        each_chunk(bodies, bodies.chunks, "accelerations_and_jerks")
    cursor[EVALUATIONS] += count
    total = 0.0
    for k in range(count):
        i = bodies.due[k]
        for axis in range(3):
            total += sources.a[axis, i] + sources.slope[axis, i]
    return OK if is_finite(total) else BLOWN_UP


@jit
def correct(bodies, i, h):
    """Compute the end of body i's step, and the derivatives there (Makino & Aarseth 1992, eqs. 5 to 8).

    The acceleration within the step is the cubic through both ends' acceleration and jerk, and the path is its
    integral. So ``series`` at the step's end describes the whole step.
    """
    series, sources = bodies.series, bodies.sources
    for k in range(3):
        before, after = series[A, k, i], sources.a[k, i]
        jerk, jerk_after = series[JERK, k, i], sources.slope[k, i]
        snap = (6.0 * (after - before) - h * (4.0 * jerk + 2.0 * jerk_after)) / (h * h)
        crackle = (12.0 * (before - after) + 6.0 * h * (jerk + jerk_after)) / (h * h * h)
        series[X, k, i] = sources.x[k, i] + h**4 * (snap / 24.0 + h * crackle / 120.0)
        series[V, k, i] = sources.u[k, i] + h**3 * (snap / 6.0 + h * crackle / 24.0)
        series[A, k, i], series[JERK, k, i] = after, jerk_after
        series[SNAP, k, i], series[CRACKLE, k, i] = snap + h * crackle, crackle


@jit
def length(series, row, i):
    """Length of one derivative of body i."""
    return math.sqrt(series[row, 0, i] ** 2 + series[row, 1, i] ** 2 + series[row, 2, i] ** 2)


@jit
def wanted(bodies, i, h, eta):
    """Return Aarseth's step after a step h: sqrt(eta (|a| |a''| + |a'|^2) / (|a'| |a'''| + |a''|^2)) (Aarseth 1985, in
    Brackbill & Cohen, Multiple Time Scales; Makino & Aarseth 1992, eq. 7).

    The step is infinite if rounding hides the body's displacement by its acceleration, as at a centre of symmetry:
    there the derivatives are noise.
    """
    series = bodies.series
    a, jerk, snap = length(series, A, i), length(series, JERK, i), length(series, SNAP, i)
    crackle = length(series, CRACKLE, i)
    below = jerk * crackle + snap * snap
    if below == 0.0 or h * h * a <= 2.0**-52 * bodies.size:
        return np.inf
    return math.sqrt(eta * (a * snap + jerk * jerk) / below)


@jit
def block_step(time, h, want):
    """Return the next step of a body at ``time`` with steps h, all powers of two.

    The step is halved until it is at most the wanted one. It is doubled if that is wanted and ``time`` is a multiple of
    it, so that bodies stay in step (McMillan 1986, in Hut & McMillan, The Use of Supercomputers in Stellar Dynamics,
    doi:10.1007/BFb0116406; Makino 1991, doi:10.1093/pasj/43.6.859).
    """
    while h > want:
        h *= 0.5
    parts = time / (2.0 * h)
    return 2.0 * h if want >= 2.0 * h and parts == math.floor(parts) else h


@driver
def hermite_start(bodies, cursor):
    """Compute the series of all bodies at the start, up to acceleration and jerk. Return a status."""
    bound = handle(bodies)
    n = bound.times.size
    bound.moved[0] = n
    for i in range(n):
        bound.due[i] = i
    status = evaluate(bound, 0.0, cursor)
    bound.series[A], bound.series[JERK] = bound.sources.a, bound.sources.slope
    return status


@driver
def hermite_loop(bodies, eta, individual, clock, until, steps, cursor):
    """Move to step points until the clock has reached ``until``, or ``steps`` of them. Return a status, STOPPED if a
    step fails. With ``individual``, a step point is the next end of any body's step, else the common end of all."""
    bound = handle(bodies)
    n, times, own = bound.times.size, bound.times, bound.steps
    while cursor[STEP] < steps and clock[START] + clock[NOW] < until:
        time = clock[NOW]
        if individual:
            end = np.inf
            for i in range(n):
                end = min(end, times[i] + own[i])
        elif clock[FIXED] > 0.0:
            end = (clock[TAKEN] + 1.0) * clock[FIXED]
        else:
            end = time + clock[NEXT]
        count, shortest = 0, np.inf
        for i in range(n):
            if not individual or times[i] + own[i] == end:
                bound.due[count] = i
                count += 1
                shortest = min(shortest, end - times[i])
        bound.moved[0] = count
        here = abs(clock[START] + time)
        if not shortest > 10.0 * (np.nextafter(here, np.inf) - here):
            return STOPPED
        status = evaluate(bound, end, cursor)
        if status != OK:
            return status
        least = MOST * (end - time)
        for k in range(count):
            i = bound.due[k]
            h = end - times[i]
            correct(bound, i, h)
            times[i] = end
            want = wanted(bound, i, h, eta)
            least = min(least, want)
            if individual:
                own[i] = block_step(end, h, want)
        clock[NEXT] = least
        clock[BEFORE], clock[NOW] = time, end
        clock[TAKEN] += 1.0
        cursor[STEP] += 1
    return OK

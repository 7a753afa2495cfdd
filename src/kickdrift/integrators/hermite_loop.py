"""The compiled loop of hermite4: gravity with its time derivative, and predict, evaluate, correct."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from kickdrift.forces.chunks import Parallel, Serial, chunk_task, each_chunk
from kickdrift.forces.compiling import driver, jit, never_inline
from kickdrift.forces.evaluate import EVALUATIONS
from kickdrift.forces.handle import handle
from kickdrift.forces.kernel import BLOWN_UP, OK
from kickdrift.forces.simd import WIDTH, lane_numbers, lane_sum, load, select, splat
from kickdrift.integrators.loops import STEP
from kickdrift.integrators.stepping import STOPPED

# Rows of a body's Taylor series at its own time.
X, V, A, JERK, SNAP, CRACKLE = range(6)
# Slots of the clock: time of the start; time since then of the last step point and of the one before; the next shared
# step; the length of all steps where it was given, else 0; the steps taken since the start.
START, NOW, BEFORE, NEXT, FIXED, TAKEN = range(6)

TASKS = 64  # that the bodies due are dealt to
WORTH_THREADS = 20_000  # pairs; below, waking threads takes longer than the sum
MOST = 2.0  # that a shared step may grow by


class Bodies(NamedTuple):
    """Bodies under gravity, each with its own time; sources are padded with massless ones to a multiple of eight."""

    softening2: float
    size: float  # the largest coordinate at the start
    gm: NDArray[np.float64]  # (slots,) G m
    x: NDArray[np.float64]  # (3, slots) predicted positions
    v: NDArray[np.float64]  # (3, slots) predicted velocities
    series: NDArray[np.float64]  # (6, 3, n) x, v and four more derivatives at each body's own time
    found: NDArray[np.float64]  # (2, 3, n) acceleration and jerk, as just evaluated
    times: NDArray[np.float64]  # (n,) each body's own, since the start
    steps: NDArray[np.float64]  # (n,) each body's own
    due: NDArray[np.int64]  # (n,) the bodies that the present step moves come first
    count: NDArray[np.int64]  # (1,) how many these are
    threads: Serial | Parallel


@chunk_task
def pulls_and_jerks(bodies, task):
    """Acceleration and jerk of every TASKS-th body due."""
    never_inline()
    for k in range(task, bodies.count[0], TASKS):
        sum_pulls_and_jerks(bodies, bodies.due[k])


@jit
def sum_pulls_and_jerks(bodies, i):
    """a = sum G m d / r^3 and da/dt = sum G m (u - 3 d (d . u) / r^2) / r^3, with d and u the separation and relative
    velocity, r^2 = d^2 + softening^2 (Makino & Aarseth 1992, eqs. 1 and 2)."""
    x, y, z = bodies.x
    vx, vy, vz = bodies.v
    gm, softening2 = bodies.gm, bodies.softening2
    xi, yi, zi = splat(x[i]), splat(y[i]), splat(z[i])
    vxi, vyi, vzi = splat(vx[i]), splat(vy[i]), splat(vz[i])
    zero = splat(0.0)
    ax, ay, az, jx, jy, jz = zero, zero, zero, zero, zero, zero
    for j in range(0, gm.size, WIDTH):
        dx, dy, dz = load(x, j) - xi, load(y, j) - yi, load(z, j) - zi
        ux, uy, uz = load(vx, j) - vxi, load(vy, j) - vyi, load(vz, j) - vzi
        source = select(lane_numbers() == float(i - j), zero, load(gm, j))  # all but the body itself
        pulling = source > 0.0
        inverse = 1.0 / math.sqrt(dx * dx + dy * dy + dz * dz + softening2)
        inverse2 = inverse * inverse
        w = select(pulling, source * inverse * inverse2, zero)
        falling = select(pulling, 3.0 * inverse2 * (dx * ux + dy * uy + dz * uz), zero)
        ax, ay, az = ax + w * dx, ay + w * dy, az + w * dz
        jx, jy, jz = jx + w * (ux - falling * dx), jy + w * (uy - falling * dy), jz + w * (uz - falling * dz)
    found = bodies.found
    found[0, 0, i], found[0, 1, i], found[0, 2, i] = lane_sum(ax), lane_sum(ay), lane_sum(az)
    found[1, 0, i], found[1, 1, i], found[1, 2, i] = lane_sum(jx), lane_sum(jy), lane_sum(jz)


@jit
def evaluate(bodies, time, cursor):
    """``found`` of the bodies due, at predicted places of all; a status."""
    n, series, times = bodies.times.size, bodies.series, bodies.times
    for k in range(3):
        for i in range(n):
            s = time - times[i]
            a, jerk = series[A, k, i], series[JERK, k, i]
            bodies.x[k, i] = series[X, k, i] + s * (series[V, k, i] + s / 2 * (a + s / 3 * jerk))
            bodies.v[k, i] = series[V, k, i] + s * (a + s / 2 * jerk)
    count = bodies.count[0]
    if count * n < WORTH_THREADS:
        each_chunk(bodies, Serial(TASKS), "pulls_and_jerks")
    else:
        each_chunk(bodies, bodies.threads, "pulls_and_jerks")
    cursor[EVALUATIONS] += count
    total = 0.0
    for k in range(count):
        i = bodies.due[k]
        for axis in range(3):
            total += bodies.found[0, axis, i] + bodies.found[1, axis, i]
    return OK if np.isfinite(total) else BLOWN_UP


@jit
def correct(bodies, i, h):
    """The end of body i's step, and the derivatives there (Makino & Aarseth 1992, eqs. 5 to 8).

    The acceleration within the step is the cubic through both ends' acceleration and jerk, and the path its integral:
    ``series`` at the step's end therefore gives the whole step, too."""
    series, found = bodies.series, bodies.found
    for k in range(3):
        before, after = series[A, k, i], found[0, k, i]
        jerk, jerk_after = series[JERK, k, i], found[1, k, i]
        snap = (6.0 * (after - before) - h * (4.0 * jerk + 2.0 * jerk_after)) / (h * h)
        crackle = (12.0 * (before - after) + 6.0 * h * (jerk + jerk_after)) / (h * h * h)
        series[X, k, i] = bodies.x[k, i] + h**4 * (snap / 24.0 + h * crackle / 120.0)
        series[V, k, i] = bodies.v[k, i] + h**3 * (snap / 6.0 + h * crackle / 24.0)
        series[A, k, i], series[JERK, k, i] = after, jerk_after
        series[SNAP, k, i], series[CRACKLE, k, i] = snap + h * crackle, crackle


@jit
def length(series, row, i):
    """Of one derivative of body i."""
    return math.sqrt(series[row, 0, i] ** 2 + series[row, 1, i] ** 2 + series[row, 2, i] ** 2)


@jit
def wanted(bodies, i, h, eta):
    """Aarseth's step, sqrt(eta (|a| |a''| + |a'|^2) / (|a'| |a'''| + |a''|^2)) (Aarseth 1985, in Brackbill & Cohen,
    Multiple Time Scales; Makino & Aarseth 1992, eq. 7), after a step h; infinite where rounding hides what the pull
    moved the body in it, as at a centre of symmetry: there the derivatives are noise."""
    series = bodies.series
    a, jerk, snap, crackle = length(series, A, i), length(series, JERK, i), length(series, SNAP, i), 0.0
    crackle = length(series, CRACKLE, i)
    below = jerk * crackle + snap * snap
    if below == 0.0 or h * h * a <= 2.0**-52 * bodies.size:
        return np.inf
    return math.sqrt(eta * (a * snap + jerk * jerk) / below)


@jit
def block_step(time, h, want):
    """The next step of a body that has come to ``time`` with steps h, all powers of two: halved until it is no longer
    than wanted, doubled where that is wanted and ``time`` is a multiple of it, so that bodies stay in step (McMillan
    1986, in Hut & McMillan, The Use of Supercomputers in Stellar Dynamics, doi:10.1007/BFb0116406; Makino 1991,
    doi:10.1093/pasj/43.6.859)."""
    while h > want:
        h *= 0.5
    parts = time / (2.0 * h)
    return 2.0 * h if want >= 2.0 * h and parts == math.floor(parts) else h


@driver
def hermite_start(bodies, cursor):
    """The series of all bodies at the start as far as acceleration and jerk; a status."""
    bound = handle(bodies)
    n = bound.times.size
    bound.count[0] = n
    for i in range(n):
        bound.due[i] = i
    status = evaluate(bound, 0.0, cursor)
    bound.series[A:SNAP] = bound.found
    return status


@driver
def hermite_loop(bodies, eta, individual, clock, until, steps, cursor):
    """Step points until the clock has reached ``until``, or ``steps`` of them; a status, STOPPED where a step comes to
    nothing. With ``individual``, a step point is where the next bodies end a step of theirs, else where all do."""
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
        bound.count[0] = count
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

"""Bodies that meet: their accelerations, and Gauss-Radau steps through a time h.

A body moves about the central body and feels the bodies near it. In a pericentre passage the velocity u is taken from
the moving central body, so the central body's own acceleration counts too:

    u' = -G m_0 x / r^3 + sum over near j of G m_j (x_j - x) / d^3 - sum over massive j of G m_j x_j / r_j^3,

In this way the drift includes the map's jump. Other forces add to these accelerations (see ``others``).
"""

import math
from collections.abc import Callable
from typing import Any

from kickdrift.forces.seam.kernel import BLOWN_UP, OK, RAISED
from kickdrift.integrators.gauss_radau import series
from kickdrift.integrators.gauss_radau.step import next_step, verdict
from kickdrift.integrators.trace.others import add_inside
from kickdrift.integrators.trace.state import ALL, FIRST_NOTED, FOUND, INSIDE, NUMBER, POINTS, TABLE_ROW
from kickdrift.integrators.wisdom_holman.bodies import GM
from kickdrift.jit.compile import inlined, jit
from kickdrift.jit.lanes.memory import flat, load, store
from kickdrift.jit.lanes.vector3 import dot, numbers3, store3, vector3
from kickdrift.jit.lanes.vectors import WIDTH

EPSILON = 1e-8  # of the length of steps; longer ones do not return to their start to a rounding
SETTLED = 1e-13  # expected residual of another iteration; places then miss less than rounding
ETA = (5040.0 * EPSILON) ** (1.0 / 7.0)
SHORTER = 0.6  # a step is done again if the next would be shorter by this factor
SHORTEST = 1e-13  # of the time h


@inlined
def inverse_cube(d):
    """1 / |d|^3."""
    inverse2 = 1.0 / dot(d, d)
    return inverse2 * math.sqrt(inverse2)


@jit
def attract(hybrid, others, s):
    """Fill the accelerations of the bodies that meet, a time s after the step's start. Return a status."""
    meeting, near, x, a = hybrid.meeting, hybrid.near, hybrid.meeting.x, hybrid.meeting.a
    slots, gm, jumps = meeting.slots, meeting.gm, meeting.jumps
    gm_0, n, everyone = hybrid.bodies.table[GM, slots[0]], meeting.size[NUMBER], meeting.size[ALL]
    pull = vector3(0.0, 0.0, 0.0)
    for i in range(n):
        here = numbers3(x, i, n)
        cube = inverse_cube(here)
        own, pull = (-gm_0 * cube) * here, pull + (gm[i] * cube) * here
        for j in range(i):
            if everyone or near[slots[j], slots[i]]:
                d = numbers3(x, j, n) - here
                cube = inverse_cube(d)
                own = own + (gm[j] * cube) * d
                store3(a, j, n, numbers3(a, j, n) - (gm[i] * cube) * d)
        store3(a, i, n, own)
    for i in range(n):
        if jumps[i]:
            store3(a, i, n, numbers3(a, i, n) - pull)
    meeting.size[FOUND] += 1
    return add_inside(hybrid, others, s, x, a) if hybrid.present[INSIDE] else OK


@jit
def note_path(hybrid, t):
    """Note positions and velocities of the bodies that meet, at a time t since the step's start."""
    meeting, path, counts = hybrid.meeting, hybrid.path, hybrid.counts
    x, v = meeting.x, meeting.v
    n, first = meeting.size[NUMBER], counts[POINTS]
    if first + n > path.shape[0]:
        return
    for i in range(n):
        row, slot = first + i, meeting.slots[i]
        path[row, 0], path[row, 1] = t, slot if i >= meeting.size[FIRST_NOTED] else -1 - slot
        path[row, 8], path[row, 9] = n, meeting.size[TABLE_ROW]
        for k in range(3):
            path[row, 2 + k], path[row, 5 + k] = x[k * n + i], v[k * n + i]
    counts[POINTS] = first + n


@inlined
def rate2(x, v, gm):
    """1 / tau^2 of a Kepler motion; see ``switch.passage``."""
    r2, v2, along = dot(x, x), dot(v, v), dot(x, v)
    sigma2 = along * along / r2
    c = 2.0 * gm / math.sqrt(r2) - 3.0 * v2 + 15.0 * sigma2
    root = math.sqrt(max(0.0, c * c - 12.0 * c * sigma2 + 36.0 * sigma2 * v2))
    return (v2 + 3.0 * sigma2 + root) / (2.0 * r2)


@jit
def shortest_time(hybrid):
    """Shortest time scale at the start: that of a motion about the central body, or of a near pair."""
    meeting, near, gm_0 = hybrid.meeting, hybrid.near, hybrid.bodies.table[GM, hybrid.meeting.slots[0]]
    slots, gm, n, fastest = meeting.slots, meeting.gm, meeting.size[NUMBER], 0.0
    for i in range(n):
        x, v = numbers3(meeting.x, i, n), numbers3(meeting.v, i, n)
        fastest = max(fastest, rate2(x, v, gm_0))
        for j in range(i):
            if meeting.size[ALL] or near[slots[j], slots[i]]:
                d, u = x - numbers3(meeting.x, j, n), v - numbers3(meeting.v, j, n)
                fastest = max(fastest, rate2(d, u, gm[i] + gm[j]))
    return 1.0 / math.sqrt(fastest)


# --- a step, of numbers or duals ---


def stepping(
    accelerate: Callable[..., Any], verdict: Callable[..., Any], rescale: Callable[..., Any], begin: Callable[..., Any]
) -> Callable[..., Any]:
    """Compiled attempt of a Gauss-Radau step of bodies that meet; see ``series.iteration``.

    ``begin(move, width, h, first)`` may change the predicted polynomial, and sets the scale of residuals."""
    iterate = series.iteration(accelerate, verdict, rescale)

    @inlined
    def attempt(move, meeting, width, tables, moving, t, h, ratio, before):
        """Find the polynomial of a step of length h from t on, where the accelerations are known. Return a status.

        ``ratio`` and ``before`` are as in ``series.predict``."""
        work, a = meeting.work, flat(meeting.a)
        for i in range(0, width, WIDTH):
            store(work, series.NOW * width + i, load(a, i))
        series.predict(work, width, ratio, before, tables.shifts)
        begin(move, width, h, ratio == 0.0)
        return iterate(move, t, h, flat(meeting.x), flat(meeting.v), a, 0, work, width, tables, True, moving)

    return attempt


@inlined
def width_of(size):
    """Length of the workspace's rows for so many numbers."""
    return WIDTH * ((size + WIDTH - 1) // WIDTH)


@inlined
def enter_work(meeting, size, width):
    """Begin the workspace with the positions and velocities of ``meeting``."""
    work, x, v, a = meeting.work, flat(meeting.x), flat(meeting.v), flat(meeting.a)
    for i in range(series.ROWS * width):
        work[i] = 0.0
    for i in range(size, width):
        x[i] = a[i] = 0.0
    for i in range(size):
        work[series.X * width + i], work[series.V * width + i] = x[i], v[i]


@inlined
def to_start(meeting, width, moving):
    """Return to the positions at the step's start, and with ``moving`` to the velocities."""
    work, x, v = meeting.work, flat(meeting.x), flat(meeting.v)
    for i in range(0, width, WIDTH):
        store(x, i, load(work, series.X * width + i))
        if moving:
            store(v, i, load(work, series.V * width + i))


@inlined
def leave_work(meeting, size, width):
    """Positions and velocities <- those at the step's end."""
    work, x, v = meeting.work, flat(meeting.x), flat(meeting.v)
    for i in range(size):
        x[i], v[i] = work[series.X * width + i], work[series.V * width + i]


# --- steps ---


@inlined
def slopes(d, u, b, h):
    """Return h times the first and h^2 / 2 times the second time derivative of d / r^3, with u = d' and b = d''."""
    inverse2 = 1.0 / dot(d, d)
    cube, alpha = inverse2 * math.sqrt(inverse2), dot(d, u) * inverse2
    beta = (dot(u, u) + dot(d, b)) * inverse2 + alpha * alpha
    first = cube * u - (3.0 * alpha * cube) * d
    return h * first, (0.5 * h * h) * (cube * b - (6.0 * alpha) * first - (3.0 * beta * cube) * d)


@jit
def guess(hybrid, width, n, h):
    """Begin the first step's polynomial with its c_1 and c_2: the first two time derivatives of the attraction."""
    meeting, near, gm_0 = hybrid.meeting, hybrid.near, hybrid.bodies.table[GM, hybrid.meeting.slots[0]]
    slots, gm, x, v, a, work = meeting.slots, meeting.gm, meeting.x, meeting.v, meeting.a, meeting.work
    one, two = (series.NOW + 1) * width, (series.NOW + 2) * width
    pull, bend = vector3(0.0, 0.0, 0.0), vector3(0.0, 0.0, 0.0)
    for i in range(n):
        first, second = slopes(numbers3(x, i, n), numbers3(v, i, n), numbers3(a, i, n), h)
        pull, bend = pull + gm[i] * first, bend + gm[i] * second
        first, second = -gm_0 * first, -gm_0 * second
        for j in range(n):
            if j != i and (meeting.size[ALL] or near[slots[j], slots[i]]):
                d, u = numbers3(x, j, n) - numbers3(x, i, n), numbers3(v, j, n) - numbers3(v, i, n)
                more, still = slopes(d, u, numbers3(a, j, n) - numbers3(a, i, n), h)
                first, second = first + gm[j] * more, second + gm[j] * still
        store3(work, one + i, n, first)
        store3(work, two + i, n, second)
    for i in range(n):
        if meeting.jumps[i]:
            store3(work, one + i, n, numbers3(work, one + i, n) - pull)
            store3(work, two + i, n, numbers3(work, two + i, n) - bend)


@inlined
def accelerate(move, t):
    hybrid, others = move
    return attract(hybrid, others, t)


@inlined
def settled(count, missed, residual):
    return verdict(count, missed, residual, SETTLED)


@inlined
def begin(move, width, h, first):
    meeting = move[0].meeting
    if first:
        guess(move[0], width, meeting.size[NUMBER], h)
    series.set_scale(meeting.work, width, h, True)


attempt = stepping(accelerate, settled, series.as_before, begin)


@jit
def follow(hybrid, others, h):
    """Move the bodies of ``meeting`` from x and v over a time h by Gauss-Radau steps. Return a status."""
    meeting, tables = hybrid.meeting, hybrid.tables
    work, n = meeting.work, meeting.size[NUMBER]
    width = width_of(3 * n)
    enter_work(meeting, 3 * n, width)
    done, last, before, step = 0.0, 0.0, 0.0, min(h, ETA * shortest_time(hybrid))
    while done < h:
        rest = h - done
        parts = math.ceil(rest / step - 1e-9)
        step = rest / parts if parts > 1 else rest
        to_start(meeting, width, hybrid.moving)
        status = attract(hybrid, others, done)
        if status != OK:
            return status
        ratio = step / last if last > 0.0 else 0.0
        status = attempt((hybrid, others), meeting, width, tables, hybrid.moving, done, step, ratio, before)
        if status == RAISED:
            return status
        wanted = 0.0
        if status == OK:
            wanted = next_step(work, width, series.NOW, series.ENDS, series.V, 3, n, step, ETA)
        if not wanted >= SHORTER * step:
            step = wanted if 0.0 < wanted < SHORTER * step else 0.25 * step
            if not step > SHORTEST * h:
                return BLOWN_UP
            continue
        series.pass_on(work, width, tables, step, True)
        done = h if parts <= 1 else done + step
        last, before, step = step, ratio, min(wanted, 4.0 * step)
        leave_work(meeting, 3 * n, width)
        note_path(hybrid, done)
    return OK

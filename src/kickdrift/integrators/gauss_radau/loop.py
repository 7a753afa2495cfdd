"""Compiled loop of gauss-radau15: prediction, correction, the next step, and compensated sums.

Its sums over the polynomial are in ``series``. Predictor and corrector are Everhart's (1985,
doi:10.1007/978-94-009-5400-7_17). The iteration to round-off and the compensated sums are Rein & Spiegel's (2015,
doi:10.1093/mnras/stu2164).
"""

import numpy as np

from kickdrift.forces.bound.table import fill_last
from kickdrift.forces.seam.kernel import BLOWN_UP, GROW, OK, RAISED
from kickdrift.integrators.gauss_radau import series
from kickdrift.integrators.gauss_radau.step import next_step, verdict
from kickdrift.integrators.stepping.chosen_steps import BEFORE, NEXT, TIME
from kickdrift.integrators.stepping.chosen_steps import LAST as STEP_LAST
from kickdrift.integrators.stepping.loops import FRESH, REJECTED, STEP
from kickdrift.integrators.stepping.stepper import STOPPED
from kickdrift.jit.compile import driver, inlined, strict
from kickdrift.jit.handle import handle, unowned
from kickdrift.jit.lanes.functions import splat
from kickdrift.jit.lanes.masks import mask_bits
from kickdrift.jit.lanes.memory import flat, load, store
from kickdrift.jit.lanes.vectors import WIDTH

# Further slots of the clock: the rounding error of the last step point, the ratio of the last two steps' lengths, and
# the number of consecutive steps that were too long although the shortest possible.
LOST_TIME, RATIO, SHORTEST = range(4, 7)
SHORTEST_MOST = 100  # most consecutive steps of that length
NEAR = 1000.0  # shortest steps before the end: a vanishing step there goes directly to the end
SHORTER = 0.25  # a step is rejected if the next would be shorter by this factor; none grows by more than its inverse


@inlined
def accelerate(move, t):
    bound, trial, dy, cursor = move
    return fill_last(bound, t, trial, dy, cursor)


iterate = series.iteration(accelerate, verdict, series.as_before)


@driver
def gauss_radau_loop(
    forces,
    y,
    trial,
    trial_flat,
    dy,
    dy_flat,
    workspace,
    numbers,
    velocities,
    eta,
    longest,
    end,
    clip,
    clock,
    until,
    steps,
    cursor,
):
    """Take steps until the clock has reached ``until``, or ``steps`` of them. Return a status, STOPPED if a step fails.

    No step is longer than ``longest``. The loop ends before a step beyond ``end``, or cuts that step off there
    (``clip``). y, trial and dy are (2, rows, n) or (1, 1, n). The flat ones are the same memory with some room behind.
    ``velocities`` tells whether the accelerations depend on velocities.
    """
    bound, tables = handle(forces), handle(numbers)
    y, trial, trial_flat, dy, dy_flat = unowned(y), unowned(trial), unowned(trial_flat), unowned(dy), unowned(dy_flat)
    clock, cursor = unowned(clock), unowned(cursor)
    halves, size = y.shape[0], y.shape[1] * y.shape[2]
    offset, width = (halves - 1) * size, workspace.shape[1]
    work, flat_y = flat(workspace), flat(y)
    while cursor[STEP] < steps and clock[TIME] < until:
        t, h = clock[TIME], min(clock[NEXT], longest)
        least = 10.0 * (np.nextafter(abs(t), np.inf) - abs(t))
        near = h <= least and end - t <= NEAR * least  # as before a singularity at the end
        last = t + h > end or near
        if last:
            if not clip:
                return OK
            h = end - t
        for half in range(halves):  # velocities too, for forces that read them
            series.copied(trial_flat, half * size, work, width, series.X if half < halves - 1 else series.V, size)
        if not cursor[FRESH]:
            status = fill_last(bound, t, trial, dy, cursor)
            if status != OK:
                return status
            odd = splat(0.0)
            for i in range(0, width, WIDTH):
                store(work, series.NOW * width + i, load(dy_flat, offset + i))
                odd = odd + 0.0 * load(dy_flat, offset + i)
            if mask_bits(odd >= 0.0) != 255:
                return BLOWN_UP
            cursor[FRESH] = 1
        if not (last or h > least) or clock[SHORTEST] > SHORTEST_MOST:
            return STOPPED
        ratio = h / clock[STEP_LAST] if clock[STEP_LAST] > 0.0 and clock[SHORTEST] == 0.0 else 0.0
        series.predict(work, width, ratio, clock[RATIO], tables.shifts)
        series.set_scale(work, width, h, y.shape[1] > 1)
        status = iterate(
            (bound, trial, dy, cursor), t, h, trial_flat, trial_flat, dy_flat, offset, work, width, tables, halves > 1,
            velocities or halves == 1,
        )  # fmt: skip
        if status in (GROW, RAISED):
            return status
        wanted = SHORTER * h
        if status == OK:
            wanted = next_step(work, width, series.NOW, series.ENDS, series.V, y.shape[1], y.shape[2], h, eta)
        too_long = not wanted >= SHORTER * h
        if status != OK or (too_long and wanted > 4.0 * least and not near):
            if near:
                return STOPPED
            clock[NEXT] = wanted
            cursor[REJECTED] += 1
            continue
        clock[SHORTEST] = clock[SHORTEST] + 1.0 if too_long else 0.0  # lets a shortest step pass a jump
        wanted = max(wanted, 4.0 * least) if too_long else wanted
        for i in range(0, width, WIDTH):
            store(work, series.X_BEFORE * width + i, load(work, series.X * width + i))
            store(work, series.V_BEFORE * width + i, load(work, series.V * width + i))
        series.pass_on(work, width, tables, h, halves > 1)
        if halves > 1:
            series.copied(flat_y, 0, work, width, series.X, size)
        series.copied(flat_y, offset, work, width, series.V, size)
        following = min(wanted, h / SHORTER)
        clock[BEFORE], clock[STEP_LAST], clock[RATIO] = t, h, ratio
        clock[NEXT] = max(following, clock[NEXT]) if last else following
        if last:
            clock[TIME], clock[LOST_TIME] = end, 0.0
        else:
            advance_clock(clock, h)
        cursor[FRESH] = 0
        cursor[STEP] += 1
    return OK


@strict
def advance_clock(clock, h):
    """TIME <- TIME + h, with the rounding error kept, for h longer or shorter (a two-sum)."""
    before = clock[TIME]
    after = before + h
    taken = after - before
    lost = clock[LOST_TIME] + ((before - (after - taken)) + (h - taken))
    clock[TIME] = after + lost
    clock[LOST_TIME] = lost - (clock[TIME] - after)

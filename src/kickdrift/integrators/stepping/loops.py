"""Compiled loops of fixed steps, one for each family. Each is compiled once and cached on disk, whatever the forces.

All loops take the same arguments:

- ``forces``: the table of bound forces;
- ``y``: (2, rows, n) positions and velocities, or (1, 1, n) unknowns of a first-order ODE;
- ``carry``: the rounding errors of compensated summation, in y's shape, or (halves, rows, 0) for plain sums;
- ``work``: the method's workspace;
- ``stages`` or ``word``: the method's coefficients;
- ``dt``: the step;
- ``start``: the time of step 0;
- ``first``: the steps done before this call, so that the clock does not depend on how a run is split into calls;
- ``steps``: the number of steps to take;
- ``cursor``: (int64) the place inside the loop, so that it can stop inside a step (a full pair list) and continue.
"""

from __future__ import annotations

from typing import Any, NamedTuple

from numba import types

from kickdrift.forces.bound.table import EVALUATIONS, fill_accelerations, fill_by, fill_derivative
from kickdrift.forces.pairs.sorted_steps import CODE, DT, EVALUATED, FEWEST_STEPS, HOLDS, NEXT, STEPS, TAKEN
from kickdrift.forces.seam.kernel import OK, TAKE_STEPS, call_force
from kickdrift.integrators.stepping.subflow_code import FRESH as FRESH
from kickdrift.integrators.stepping.subflow_code import REJECTED as REJECTED
from kickdrift.integrators.stepping.subflow_code import STAGE as STAGE
from kickdrift.integrators.stepping.subflow_code import STEP as STEP
from kickdrift.integrators.stepping.subflow_code import call_subflow, evaluate, press
from kickdrift.jit.compile import driver, inlined, jit, never_inline, strict
from kickdrift.jit.handle import handle, unowned
from kickdrift.jit.inner import by_type
from kickdrift.jit.lanes.memory import flat, load, masked_load, masked_store, store
from kickdrift.jit.lanes.vectors import WIDTH
from kickdrift.jit.threads.chunks import Chunks, chunk_task, each_chunk, in_chunks

WORTH_CHUNKS = 20_000  # particles


def sweeps(n: int, threads: int) -> Chunks:
    """Chunks of a kick, a drift or the noise of n particles: one if it takes less time than to wake a thread."""
    return in_chunks(8 if n >= WORTH_CHUNKS else 1, threads)


@inlined
def chunk_numbers(size, c, number):
    """Return the numbers of chunk c, of so many: the first, a multiple of eight, and the last plus 1."""
    eights = (size + WIDTH - 1) // WIDTH
    return WIDTH * (c * eights // number), min(WIDTH * ((c + 1) * eights // number), size)


@inlined
def add_scaled(y, factor, dy):
    """y <- y + factor dy, for (rows, n) arrays."""
    add_scaled_numbers(flat(y), factor, flat(dy), 0, y.size)


@inlined
def add_scaled_numbers(y, factor, dy, begin, end):
    """The same for the numbers from ``begin`` to ``end`` of arrays in one row."""
    whole = end - (end - begin) % WIDTH
    for i in range(begin, whole, WIDTH):
        store(y, i, load(y, i) + factor * load(dy, i))
    rest = end - whole
    masked_store(y, whole, masked_load(y, whole, rest) + factor * masked_load(dy, whole, rest), rest)


@strict
def add_compensated(y, carry, factor, dy):
    """y <- y + factor dy with compensated summation; ``carry`` holds the rounding errors.

    Sources: Kahan 1965, doi:10.1145/363707.363723; Hairer, Lubich & Wanner 2006, VIII.5."""
    add_compensated_numbers(flat(y), flat(carry), factor, flat(dy), 0, y.size)


@strict
def add_compensated_numbers(y, carry, factor, dy, begin, end):
    """The same for the numbers from ``begin`` to ``end`` of arrays in one row."""
    for i in range(begin, end):
        before = y[i]
        increment = carry[i] + factor * dy[i]
        y[i] = before + increment
        carry[i] = increment + (before - y[i])


@inlined
def advance(y, carry, factor, dy):
    """y <- y + factor dy, (rows, n); compensated if ``carry`` is not empty."""
    if carry.size:
        add_compensated(y, carry, factor, dy)
    else:
        add_scaled(y, factor, dy)


class Advance(NamedTuple):
    """What the chunks of an `advance` need."""

    y: Any
    carry: Any
    factor: Any
    dy: Any
    number: Any  # of chunks


@chunk_task
def advance_chunk(given, c):
    """Advance the numbers of chunk c."""
    never_inline()
    y, carry, dy = flat(given.y), flat(given.carry), flat(given.dy)
    begin, end = chunk_numbers(y.size, c, given.number)
    if carry.size:
        add_compensated_numbers(y, carry, given.factor, dy, begin, end)
    else:
        add_scaled_numbers(y, given.factor, dy, begin, end)


@inlined
def advance_by(chunks, y, carry, factor, dy):
    """Like `advance`, in chunks if there are several."""
    if chunks.number > 1:
        each_chunk(handle(Advance(y, carry, factor, dy, chunks.number)), chunks, "advance_chunk")
    else:
        advance(y, carry, factor, dy)


@inlined
def act(further, stage, start, first, dt, x, v, cursor):
    """Apply the further flow of a stage, if the stage has one; return a status."""
    if further is None:
        return OK
    weight, passed = further.stages[0, stage], further.stages[1, stage]
    if weight == 0.0:
        return OK
    flow, done = further.table[int(further.stages[2, stage])], first + cursor[STEP]
    if flow[2]:
        cursor[FRESH] = 0
    return call_subflow(flow[0], flow[1], start + (done + passed) * dt, weight * dt, done, stage, x, v)


@by_type(forceinline=True)
def kick(chunks, groups, barostat, stage, bound, t, x, v, lost, span, work, done, cursor):
    """v <- v + span a, by the forces of the stage; return a status. ``work`` keeps a while positions stay fixed.

    A word with groups of forces has no barostat."""
    if isinstance(groups, types.NoneType):

        def by_all(chunks, groups, barostat, stage, bound, t, x, v, lost, span, work, done, cursor):
            if not cursor[FRESH]:
                status = evaluate(barostat, bound, t, x, v, work, done, cursor)
                if status != OK:
                    return status
                cursor[FRESH] = 1
            advance_by(chunks, v, lost, span, work)
            return OK

        return by_all

    def by_one_group(chunks, groups, barostat, stage, bound, t, x, v, lost, span, work, done, cursor):
        group = groups.kicks[stage]
        a = work[group]
        if not cursor[FRESH] >> group & 1:
            status = fill_by(bound, groups.forces, group, t, x, v, a, None, cursor)
            if status != OK:
                return status
            cursor[FRESH] |= 1 << group
        advance_by(chunks, v, lost, span, a)
        return OK

    return by_one_group


@jit
def take_sorted_steps(bound, plan, dt, steps, x, v, work, cursor):
    """Let the only force take steps while its pair list lasts; the cursor then has the place where the loop goes on."""
    left = steps - cursor[STEP]
    if left < FEWEST_STEPS:
        return
    plan[TAKEN], plan[EVALUATED], plan[NEXT] = 0.0, 0.0, 0.0
    plan[STEPS], plan[DT], plan[HOLDS], plan[CODE] = left, dt, cursor[FRESH], bound.table[0, 0]
    call_force(bound.table[0, 0], bound.table[0, 1], TAKE_STEPS, float(plan.size), x, v, work, plan)
    cursor[STEP] += int(plan[TAKEN])
    cursor[STAGE], cursor[FRESH] = int(plan[NEXT]), int(plan[HOLDS])
    cursor[EVALUATIONS] += int(plan[EVALUATED])


@driver
def splitting_loop(forces, y, carry, work, word, dt, start, first, steps, cursor):
    """Apply the flows of a ``Word`` in turn. ``work`` holds the accelerations until positions change."""
    bound = handle(forces)
    y, carry, work = unowned(y), unowned(carry), unowned(work)
    stages, cursor = unowned(word.stages), unowned(cursor)
    x, v, lost_x, lost_v = y[0], y[1], carry[0], carry[1]
    kicks, drift, passed = stages[0], stages[1], stages[2]
    while cursor[STEP] < steps:
        status = press(word.barostat, bound, start, first + cursor[STEP], dt, x, v, work, cursor)
        if status != OK:
            return status
        if word.plan.size and cursor[STAGE] == 0:
            take_sorted_steps(bound, word.plan, dt, steps, x, v, work, cursor)
            if cursor[STEP] == steps:
                break
        for stage in range(cursor[STAGE], kicks.size):
            if kicks[stage] != 0.0:
                done = first + cursor[STEP]
                t = start + (done + passed[stage]) * dt
                status = kick(
                    word.chunks,
                    word.groups,
                    word.barostat,
                    stage,
                    bound,
                    t,
                    x,
                    v,
                    lost_v,
                    kicks[stage] * dt,
                    work,
                    done,
                    cursor,
                )
                if status != OK:
                    cursor[STAGE] = stage
                    return status
            if drift[stage] != 0.0:
                advance_by(word.chunks, x, lost_x, drift[stage] * dt, v)
                cursor[FRESH] = 0
            status = act(word.further, stage, start, first, dt, x, v, cursor)
            if status != OK:
                return status
        cursor[STAGE] = 0
        cursor[STEP] += 1
    return OK


@jit
def stage_state(target, y, stages, stage, count, dt, k):
    """target <- y + dt * sum over k of the first ``count`` weights in row ``stage``; y (N,), k (stages, N)."""
    for i in range(y.size):
        target[i] = y[i]
    for j in range(count):
        weight = stages[stage, j]
        if weight != 0.0:
            for i in range(y.size):
                target[i] += weight * dt * k[j, i]


@driver
def runge_kutta_loop(forces, y, carry, work, stages, dt, start, first, steps, cursor):
    bound = handle(forces)
    count = stages.shape[1]
    trial, k = work[0], work[1:]
    flat_y, flat_trial, flat_k = y.reshape(-1), trial.reshape(-1), k.reshape((count, -1))
    while cursor[STEP] < steps:
        for stage in range(cursor[STAGE], count):
            stage_state(flat_trial, flat_y, stages, stage, stage, dt, flat_k)
            c = 0.0
            for j in range(stage):
                c += stages[stage, j]
            t = start + (first + cursor[STEP] + c) * dt
            status = fill_derivative(bound, t, trial, k[stage], cursor)
            if status != OK:
                cursor[STAGE] = stage
                return status
        for j in range(count):
            if stages[count, j] != 0.0:
                for half in range(y.shape[0]):
                    advance(y[half], carry[half], stages[count, j] * dt, k[j, half])
        cursor[STAGE] = 0
        cursor[STEP] += 1
    return OK


@strict
def two_positions(x, last, carry, dt2, a):
    """x, last <- 2 x - last + dt^2 a, x; compensated, with the rounding errors of both positions in ``carry``."""
    for k in range(x.shape[0]):
        for i in range(x.shape[1]):
            before = x[k, i]
            if carry.size:
                lost = carry[0, k, i]
                increment = lost + ((before - last[k, i]) + ((lost - carry[1, k, i]) + dt2 * a[k, i]))
                x[k, i] = before + increment
                carry[0, k, i] = increment + (before - x[k, i])
                carry[1, k, i] = lost
            else:
                x[k, i] = (2.0 * before - last[k, i]) + dt2 * a[k, i]
            last[k, i] = before


@driver
def stormer_loop(forces, y, carry, work, stages, dt, start, first, steps, cursor):
    """Störmer-Verlet steps: x(t + dt) = 2 x(t) - x(t - dt) + dt^2 a(t) (Verlet 1967, eqs. 4 and 5).

    ``y[0]`` and ``work[1]`` hold the two positions. The first step uses the velocity: x(dt) = x + dt v + dt^2 a / 2.
    After each step ``y[1]`` holds v(t) = (x(t + dt) - x(t - dt)) / (2 dt), which equals
    (x(t) - x(t - dt)) / dt + dt a(t) / 2."""
    bound = handle(forces)
    a, last = work[0], work[1]
    rows, n = y.shape[1], y.shape[2]
    while cursor[STEP] < steps:
        if not cursor[FRESH]:  # at the start there is no previous position
            status = fill_accelerations(bound, start + (first + cursor[STEP]) * dt, y[0], y[1], a, None, cursor)
            if status != OK:
                return status
            for k in range(rows):
                for i in range(n):
                    last[k, i] = y[0, k, i] - dt * y[1, k, i] + 0.5 * dt * dt * a[k, i]
            cursor[FRESH] = 1
        if cursor[STAGE] == 0:
            two_positions(y[0], last, carry, dt * dt, a)
            cursor[STAGE] = 1
        status = fill_accelerations(bound, start + (first + cursor[STEP] + 1) * dt, y[0], y[1], a, None, cursor)
        if status != OK:
            return status
        for k in range(rows):
            for i in range(n):
                y[1, k, i] = (y[0, k, i] - last[k, i]) / dt + 0.5 * dt * a[k, i]
        cursor[STAGE] = 0
        cursor[STEP] += 1
    return OK

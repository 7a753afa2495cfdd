"""The compiled loop of gauss-radau15: prediction, correction, the next step, and sums that keep what rounding loses.

A step's unknowns are the coefficients c_0 … c_7 of a(s), see ``gauss_radau``; eight numbers of all particles'
components side by side are worked on at a time. Predictor and corrector are Everhart's (1985,
doi:10.1007/978-94-009-5400-7_17), their iteration to round-off and compensated sums Rein & Spiegel's (2015,
doi:10.1093/mnras/stu2164).
"""

from __future__ import annotations

import numpy as np

from kickdrift.forces.compiling import driver, in_order, inlined, strict
from kickdrift.forces.evaluate import fill_last
from kickdrift.forces.handle import handle, unowned
from kickdrift.forces.kernel import BLOWN_UP, GROW, OK, RAISED
from kickdrift.forces.simd import (
    WIDTH,
    flat,
    lane_max,
    load,
    mask_bits,
    minus,
    multiply_add,
    plus,
    select,
    splat,
    store,
    store_first,
)
from kickdrift.integrators.gauss_radau_step import TERMS, next_step
from kickdrift.integrators.loops import FRESH, REJECTED, STEP
from kickdrift.integrators.stepping import BEFORE, NEXT, STOPPED, TIME
from kickdrift.integrators.stepping import LAST as STEP_LAST

# Rows of the workspace, (ROWS, width): position and velocity at the step's start (y of a first-order problem in the
# velocity's place), what rounding has lost of both, both at the start of the step before; the coefficients of this step
# and of the last; what the last step's were and this one's are by the continuation of the polynomial before; what
# residuals are multiplied by; derivatives of a at the step's end; what the polynomial is at a node, less c_0;
# what it would be at the next, and how far positions would have gone, did it not change.
X, V, LOST_X, LOST_V, X_BEFORE, V_BEFORE = range(6)
NOW, LAST, GUESS_LAST, GUESS, SCALE, ENDS = 6, 14, 22, 30, 38, 39
AT_NODE, AHEAD, BASE = (ENDS + TERMS + k for k in range(3))
ROWS = BASE + 1
NODES = TERMS - 1
BLOCK = 2 * WIDTH  # of which a row of the workspace is a multiple
# Further slots of the clock: what rounding lost of the last step point, the last step's length over that of the one
# before; how many steps in a row were too long, but the shortest there are.
LOST_TIME, RATIO, SHORTEST = range(4, 7)
MOST = 25  # iterations
CONVERGED = 2.2e-16  # residual that another iteration would find, over the size of the accelerations
ROUNDED = 1e-9  # a residual that stops shrinking below this is rounding; above, the iteration diverges
LOW = 4  # terms whose weights are taken with what their rounding loses
PATIENCE = 3  # iterations in which residuals may grow, from a first guess
SHORTEST_MOST = 100  # steps that long in a row
SHORTER = 0.25  # a step is rejected if the next one would be shorter by that factor; none is longer by its inverse

# Below, ``work`` is the workspace as one row of numbers, and ``width`` how many of them a row of the workspace has. All
# is made part of the loop: what a step of a few bodies takes is little more than handing over arrays would.


@inlined
def larger(a, b):
    return select(a > b, a, b)


@inlined
def predict(work, width, ratio, before, shifts):
    """The step's polynomial: the last one gone on with, and the term of s^8 that it has not, by what the one before had
    missed of the last. That term grows as the eighth power of the step (Everhart 1985 leaves it as it was). ``ratio``
    is the step's length over the last one's, ``before`` that one's over the one's before; 0 where there was none."""
    first_share = before**8
    growth = ratio / before if before > 0.0 else 0.0
    for i in range(0, width, WIDTH):
        power, share = 1.0, first_share
        for k in range(1, TERMS):
            power *= ratio
            share *= growth
            total = splat(0.0)
            for j in range(k, TERMS):
                total = total + shifts[k, j] * load(work, (LAST + j) * width + i)
            total = power * total
            missed = load(work, (LAST + k) * width + i) - load(work, (GUESS_LAST + k) * width + i)
            store(work, (GUESS + k) * width + i, total)
            store(work, (NOW + k) * width + i, total + share * missed)


@inlined
def set_scale(work, width, h, particles):
    """What residuals are multiplied by: one over the largest acceleration of all particles; for each unknown of a
    Problem one over its own derivative, or over its size where that is larger."""
    largest = splat(0.0)
    for i in range(0, width, WIDTH):
        largest = larger(largest, abs(load(work, NOW * width + i)))
    common = splat(lane_max(largest))
    for i in range(0, width, WIDTH):
        size = common
        if not particles:
            size = larger(abs(load(work, NOW * width + i)), abs(load(work, V * width + i)) / h)
        store(work, SCALE * width + i, select(size > 0.0, 1.0 / size, splat(0.0)))


@in_order
def weighted(work, width, i, first, table, low, row):
    """sum_j weights_j c_j from c_first on, by a row of weights and, of the largest, what their rounding loses: being
    the same in every step that would make the energy drift, by some 1e-20 a step. Smallest first."""
    total = splat(low[row, 1]) * load(work, (NOW + 1) * width + i)
    for j in range(2, LOW):
        total = multiply_add(splat(low[row, j]), load(work, (NOW + j) * width + i), total)
    for j in range(TERMS - 1, first - 1, -1):
        total = multiply_add(splat(table[row, j]), load(work, (NOW + j) * width + i), total)
    return total


@in_order
def two_weighted(work, width, i, tables, row):
    """For the polynomial at a node less c_0 and for positions there, each of two vectors: sums as above, side by side,
    since each by itself waits for its own last addition."""
    values, values_low = tables.values, tables.values_low
    twice, twice_low = tables.positions, tables.positions_low
    c, d = load(work, (NOW + 1) * width + i), load(work, (NOW + 1) * width + i + WIDTH)
    once, low = splat(values_low[row, 1]), splat(twice_low[row, 1])
    value_c, value_d, place_c, place_d = once * c, once * d, low * c, low * d
    for j in range(2, LOW):
        c, d = load(work, (NOW + j) * width + i), load(work, (NOW + j) * width + i + WIDTH)
        once, low = splat(values_low[row, j]), splat(twice_low[row, j])
        value_c, value_d = multiply_add(once, c, value_c), multiply_add(once, d, value_d)
        place_c, place_d = multiply_add(low, c, place_c), multiply_add(low, d, place_d)
    for j in range(TERMS - 1, 0, -1):
        c, d = load(work, (NOW + j) * width + i), load(work, (NOW + j) * width + i + WIDTH)
        once, low = splat(values[row, j]), splat(twice[row, j])
        value_c, value_d = multiply_add(once, c, value_c), multiply_add(once, d, value_d)
        place_c, place_d = multiply_add(low, c, place_c), multiply_add(low, d, place_d)
    c, d, low = load(work, NOW * width + i), load(work, NOW * width + i + WIDTH), splat(twice[row, 0])
    return value_c, value_d, multiply_add(low, c, place_c), multiply_add(low, d, place_d)


@in_order
def prepare(work, width, tables, row, h, positions):
    """What does not hang on the forces at the node before that of a row: AHEAD <- the polynomial there less c_0, BASE
    <- how far positions will have gone, s h (v + s h sum_j weights_j c_j)."""
    factor = splat(tables.nodes[row + 1]) * splat(h)
    rest = multiply_add(splat(tables.nodes[row + 1]), splat(h), -factor)  # what rounding s h loses
    if positions:
        for i in range(0, width, BLOCK):
            j = i + WIDTH
            value_i, value_j, place_i, place_j = two_weighted(work, width, i, tables, row)
            place_i = multiply_add(factor, place_i, load(work, V * width + i))
            place_j = multiply_add(factor, place_j, load(work, V * width + j))
            lost_i = multiply_add(rest, place_i, load(work, LOST_X * width + i))
            lost_j = multiply_add(rest, place_j, load(work, LOST_X * width + j))
            store(work, BASE * width + i, multiply_add(factor, place_i, lost_i))
            store(work, BASE * width + j, multiply_add(factor, place_j, lost_j))
            store(work, AHEAD * width + i, value_i)
            store(work, AHEAD * width + j, value_j)
    else:
        for i in range(0, width, WIDTH):
            store(work, AHEAD * width + i, weighted(work, width, i, 1, tables.values, tables.values_low, row))


@in_order
def correct(work, width, found, offset, trial, tables, row, following, h, positions, worst):
    """Make the polynomial go through ``found[offset:]`` at a node, and take positions and AT_NODE to the following one.
    Returns the larger of ``worst`` and by how much the polynomial had missed on SCALE, in lanes; and 0 in lanes, nan
    where something is not finite."""
    odd = splat(0.0)
    factor = tables.nodes[following + 1] * h
    gain, push = tables.gains[0, row], factor * factor * tables.gains[1, row]
    for i in range(0, width, WIDTH):
        missed = minus(minus(load(found, offset + i), load(work, NOW * width + i)), load(work, AT_NODE * width + i))
        if positions:
            total = multiply_add(splat(push), missed, load(work, BASE * width + i))
            store(trial, i, plus(load(work, X * width + i), total))
        store(work, AT_NODE * width + i, multiply_add(splat(gain), missed, load(work, AHEAD * width + i)))
        for j in range(1, TERMS):
            k = (NOW + j) * width + i
            store(work, k, multiply_add(splat(tables.corrections[row, j]), missed, load(work, k)))
        worst = larger(worst, abs(missed) * load(work, SCALE * width + i))
        odd = multiply_add(splat(0.0), missed, odd)
    return worst, odd


@in_order
def place_velocities(work, width, trial, offset, tables, row, h):
    """trial[offset:] <- velocities at a node, or the unknowns of a first-order problem."""
    factor = splat(tables.nodes[row + 1]) * splat(h)
    rest = multiply_add(splat(tables.nodes[row + 1]), splat(h), -factor)
    for i in range(0, width, WIDTH):
        total = weighted(work, width, i, 0, tables.velocities, tables.velocities_low, row)
        total = multiply_add(factor, total, multiply_add(rest, total, load(work, LOST_V * width + i)))
        store(trial, offset + i, plus(load(work, V * width + i), total))


@in_order
def finish(work, width, x, lost, tables, low, h, positions):
    """x <- x + h (v + h sum_j weights_j c_j) with ``positions``, else x + h sum_j weights_j c_j; x and lost are rows.
    The largest product is taken whole, by a fused multiply-add, and what the sums lose is kept (two-sums: Knuth 1969;
    Dekker 1971, doi:10.1007/BF01397083)."""
    end = TERMS - 1
    for i in range(0, width, WIDTH):
        if positions:
            total = weighted(work, width, i, 0, tables, low, end)
            total = multiply_add(splat(h), total, load(work, LOST_V * width + i))
            main = load(work, V * width + i)
        else:  # weights_0 is 1
            total = weighted(work, width, i, 1, tables, low, end)
            main = load(work, NOW * width + i)
        product = splat(h) * main
        rest = multiply_add(splat(h), main, -product)
        rest = plus(plus(load(work, lost * width + i), rest), splat(h) * total)
        before = load(work, x * width + i)
        for _ in range(2):
            after = plus(before, product)
            taken = minus(after, before)
            error = plus(minus(before, minus(after, taken)), minus(product, taken))
            before, product, rest = after, plus(rest, error), splat(0.0)
        store(work, x * width + i, before)
        store(work, lost * width + i, error)


@inlined
def copied(target, offset, work, width, row, count):
    """target[offset:] <- so many numbers of a row of the workspace."""
    for i in range(0, width, WIDTH):
        store_first(target, offset + i, load(work, row * width + i), count - i)


@inlined
def iterate(bound, t, h, trial, trial_flat, dy, dy_flat, work, width, tables, velocities, cursor):
    """Correct the step's polynomial until what is left is rounding; a status, BLOWN_UP where it does not converge."""
    positions, residual = trial.shape[0] > 1, np.inf
    offset = (trial.shape[0] - 1) * trial.shape[1] * trial.shape[2]
    prepare(work, width, tables, 0, h, positions)
    for i in range(0, width, WIDTH):
        store(work, AT_NODE * width + i, load(work, AHEAD * width + i))
        if positions:
            store(trial_flat, i, plus(load(work, X * width + i), load(work, BASE * width + i)))
    for count in range(MOST):
        worst = splat(0.0)  # at any node
        for row in range(NODES):
            following = row + 1 if row + 1 < NODES else 0
            if velocities or not positions:
                place_velocities(work, width, trial_flat, offset, tables, row, h)
            status = fill_last(bound, t + tables.nodes[row + 1] * h, trial, dy, cursor)
            if status != OK:
                return status
            prepare(work, width, tables, following, h, positions)
            worst, odd = correct(
                work, width, dy_flat, offset, trial_flat, tables, row, following, h, positions, worst
            )  # fmt: skip
            if mask_bits(odd >= 0.0) != 255:
                return BLOWN_UP
        missed = lane_max(worst)
        if missed == 0.0:
            return OK
        if count > 0:
            if missed * missed / residual <= CONVERGED:
                return OK
            if missed >= residual:
                if missed <= ROUNDED:
                    return OK
                if count >= PATIENCE:
                    return BLOWN_UP
        if not np.isfinite(missed):
            return BLOWN_UP
        residual = missed
    return OK if residual <= ROUNDED else BLOWN_UP


@driver
def gauss_radau_loop(
    forces, y, trial, trial_flat, dy, dy_flat, workspace, numbers, velocities, eta, clock, until, steps, cursor
):
    """Steps until the clock has reached ``until``, or ``steps`` of them; a status, STOPPED where the step came to
    nothing.

    y, trial and dy are (2, rows, n) or (1, 1, n), the flat ones the same memory and some room after; ``velocities``
    tells whether the accelerations depend on them."""
    bound, tables = handle(forces), handle(numbers)
    y, trial, trial_flat, dy, dy_flat = unowned(y), unowned(trial), unowned(trial_flat), unowned(dy), unowned(dy_flat)
    clock, cursor = unowned(clock), unowned(cursor)
    halves, size = y.shape[0], y.shape[1] * y.shape[2]
    offset, width = (halves - 1) * size, workspace.shape[1]
    work, flat_y = flat(workspace), flat(y)
    while cursor[STEP] < steps and clock[TIME] < until:
        t, h = clock[TIME], clock[NEXT]
        for half in range(halves):  # velocities for forces that take none but look at them, too
            copied(trial_flat, half * size, work, width, X if half < halves - 1 else V, size)
        if not cursor[FRESH]:
            status = fill_last(bound, t, trial, dy, cursor)
            if status != OK:
                return status
            odd = splat(0.0)
            for i in range(0, width, WIDTH):
                store(work, NOW * width + i, load(dy_flat, offset + i))
                odd = odd + 0.0 * load(dy_flat, offset + i)
            if mask_bits(odd >= 0.0) != 255:
                return BLOWN_UP
            cursor[FRESH] = 1
        least = 10.0 * (np.nextafter(abs(t), np.inf) - abs(t))
        if not h > least or clock[SHORTEST] > SHORTEST_MOST:
            return STOPPED
        ratio = h / clock[STEP_LAST] if clock[STEP_LAST] > 0.0 and clock[SHORTEST] == 0.0 else 0.0
        predict(work, width, ratio, clock[RATIO], tables.shifts)
        set_scale(work, width, h, y.shape[1] > 1)
        status = iterate(bound, t, h, trial, trial_flat, dy, dy_flat, work, width, tables, velocities, cursor)
        if status in (GROW, RAISED):
            return status
        wanted = SHORTER * h
        if status == OK:
            wanted = next_step(work, width, NOW, ENDS, V, y.shape[1], y.shape[2], h, eta)
        too_long = not wanted >= SHORTER * h
        if status != OK or (too_long and wanted > 4.0 * least):
            clock[NEXT] = wanted
            cursor[REJECTED] += 1
            continue
        clock[SHORTEST] = clock[SHORTEST] + 1.0 if too_long else 0.0  # a force that jumps, say: it is passed like that
        wanted = max(wanted, 4.0 * least) if too_long else wanted
        for i in range(0, TERMS * width, WIDTH):
            store(work, LAST * width + i, load(work, NOW * width + i))
            store(work, GUESS_LAST * width + i, load(work, GUESS * width + i))
        for i in range(0, width, WIDTH):
            store(work, X_BEFORE * width + i, load(work, X * width + i))
            store(work, V_BEFORE * width + i, load(work, V * width + i))
        if halves == 2:
            finish(work, width, X, LOST_X, tables.positions, tables.positions_low, h, True)
            copied(flat_y, 0, work, width, X, size)
        finish(work, width, V, LOST_V, tables.velocities, tables.velocities_low, h, False)
        copied(flat_y, offset, work, width, V, size)
        clock[BEFORE], clock[STEP_LAST], clock[RATIO], clock[NEXT] = t, h, ratio, min(wanted, h / SHORTER)
        advance_clock(clock, h)
        cursor[FRESH] = 0
        cursor[STEP] += 1
    return OK


@strict
def advance_clock(clock, h):
    """TIME <- TIME + h, what rounding loses kept, h the longer or not (a two-sum)."""
    before = clock[TIME]
    after = before + h
    taken = after - before
    lost = clock[LOST_TIME] + ((before - (after - taken)) + (h - taken))
    clock[TIME] = after + lost
    clock[LOST_TIME] = lost - (clock[TIME] - after)

"""The compiled loop of gauss-radau15: prediction, correction, the next step, and sums that keep what rounding loses.

A step's unknowns are the coefficients c_0 … c_7 of a(s), see ``gauss_radau``; eight numbers of all particles'
components side by side are worked on at a time. Predictor and corrector are Everhart's (1985,
doi:10.1007/978-94-009-5400-7_17), their iteration to round-off and compensated sums Rein & Spiegel's (2015,
doi:10.1093/mnras/stu2164).
"""

from __future__ import annotations

import numpy as np

from kickdrift.forces.compiling import driver, jit, strict
from kickdrift.forces.evaluate import fill_derivative
from kickdrift.forces.handle import handle
from kickdrift.forces.kernel import BLOWN_UP, GROW, OK, RAISED
from kickdrift.forces.simd import WIDTH, lane_max, load, minus, multiply_add, plus, select, splat, store
from kickdrift.integrators.gauss_radau_step import TERMS, next_step
from kickdrift.integrators.loops import FRESH, REJECTED, STEP
from kickdrift.integrators.stepping import BEFORE, NEXT, STOPPED, TIME
from kickdrift.integrators.stepping import LAST as STEP_LAST

# Rows of the workspace, (ROWS, width): position and velocity at the step's start (y of a first-order problem in the
# velocity's place), what rounding has lost of both, both at the start of the step before; the coefficients of this step
# and of the last; what the last step's were and this one's are by the continuation of the polynomial before; what
# residuals are multiplied by; derivatives of a at the step's end.
X, V, LOST_X, LOST_V, X_BEFORE, V_BEFORE = range(6)
NOW, LAST, GUESS_LAST, GUESS, SCALE, ENDS = 6, 14, 22, 30, 38, 39
ROWS = ENDS + TERMS
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


@jit
def larger(a, b):
    return select(a > b, a, b)


@jit
def predict(work, ratio, before, shifts):
    """The step's polynomial: the last one gone on with, and the term of s^8 that it has not, by what the one before had
    missed of the last. That term grows as the eighth power of the step (Everhart 1985 leaves it as it was). ``ratio``
    is the step's length over the last one's, ``before`` that one's over the one's before; 0 where there was none."""
    width = work.shape[1]
    now, last, guess, guess_last = work[NOW:LAST], work[LAST:GUESS_LAST], work[GUESS:SCALE], work[GUESS_LAST:GUESS]
    power, share = 1.0, before**8
    for k in range(1, TERMS):
        power *= ratio
        share *= ratio / before if before > 0.0 else 0.0
        for i in range(0, width, WIDTH):
            total = splat(0.0)
            for j in range(k, TERMS):
                total = total + shifts[k, j] * load(last, j * width + i)
            total = power * total
            store(guess, k * width + i, total)
            missed = load(last, k * width + i) - load(guess_last, k * width + i)
            store(now, k * width + i, total + share * missed)


@jit
def set_scale(work, h, particles):
    """What residuals are multiplied by: one over the largest acceleration of all particles; for each unknown of a
    Problem one over its own derivative, or over its size where that is larger."""
    width, largest = work.shape[1], splat(0.0)
    for i in range(0, width, WIDTH):
        largest = larger(largest, abs(load(work, NOW * width + i)))
    size = lane_max(largest)
    for i in range(width):
        if not particles:
            size = max(abs(work[NOW, i]), abs(work[V, i]) / h)
        work[SCALE, i] = 1.0 / size if size > 0.0 else 0.0


@strict
def place(target, offset, start, lost, slope, terms, weights, low, s, h):
    """target[offset:] <- start + lost + s h (slope + s h sum_j weights_j terms_j); without the slope, where that is
    None, one s h less.

    What the rounding of s h and of the first weights loses is ``rest`` and ``low``: being the same in every step it
    would make the energy drift, by some 1e-20 a step."""
    width = start.size
    factor = splat(s) * splat(h)
    rest = multiply_add(splat(s), splat(h), -factor)
    for i in range(0, width, WIDTH):
        total = splat(low[1]) * load(terms, width + i)
        for j in range(2, LOW):
            total = multiply_add(splat(low[j]), load(terms, j * width + i), total)
        for j in range(TERMS - 1, -1, -1):
            total = multiply_add(splat(weights[j]), load(terms, j * width + i), total)
        if slope is not None:
            total = multiply_add(factor, total, load(slope, i))
        total = multiply_add(factor, total, multiply_add(rest, total, load(lost, i)))
        store(target, offset + i, plus(load(start, i), total))


@strict
def correct(terms, found, offset, values, low, corrections, node, scale):
    """Make the polynomial go through ``found[offset:]`` at a node; by how much it had missed, at most, on that
    scale."""
    width, worst = scale.size, splat(0.0)
    for i in range(0, width, WIDTH):
        total = splat(low[1]) * load(terms, width + i)
        for j in range(2, LOW):
            total = multiply_add(splat(low[j]), load(terms, j * width + i), total)
        for j in range(TERMS - 1, 0, -1):
            total = multiply_add(splat(values[j]), load(terms, j * width + i), total)
        missed = minus(minus(load(found, offset + i), load(terms, i)), total)
        for j in range(1, node + 1):
            k = j * width + i
            store(terms, k, multiply_add(splat(corrections[j]), missed, load(terms, k)))
        worst = larger(worst, abs(missed) * load(scale, i))
    return lane_max(worst)


@strict
def finish(x, lost, slope, lost_slope, terms, weights, low, h):
    """x <- x + h (slope + h sum_j weights_j terms_j), where the slope is None x + h sum_j weights_j terms_j. The
    largest product is taken whole, by a fused multiply-add, and what the sums lose is kept (two-sums: Knuth 1969;
    Dekker 1971, doi:10.1007/BF01397083)."""
    width = x.size
    for i in range(0, width, WIDTH):
        total = splat(low[1]) * load(terms, width + i)
        for j in range(2, LOW):
            total = multiply_add(splat(low[j]), load(terms, j * width + i), total)
        for j in range(TERMS - 1, 0, -1):
            total = multiply_add(splat(weights[j]), load(terms, j * width + i), total)
        if slope is not None:
            total = multiply_add(splat(weights[0]), load(terms, i), total)
            total = multiply_add(splat(h), total, load(lost_slope, i))
            main = load(slope, i)
        else:  # weights_0 is 1
            main = load(terms, i)
        product = splat(h) * main
        rest = multiply_add(splat(h), main, -product)
        rest = plus(plus(load(lost, i), rest), splat(h) * total)
        before = load(x, i)
        for _ in range(2):
            after = plus(before, product)
            taken = minus(after, before)
            error = plus(minus(before, minus(after, taken)), minus(product, taken))
            before, product, rest = after, plus(rest, error), splat(0.0)
        store(x, i, before)
        store(lost, i, error)


@jit
def iterate(bound, t, h, trial, trial_flat, dy, dy_flat, work, tables, velocities, cursor):
    """Correct the step's polynomial until what is left is rounding; a status, BLOWN_UP where it does not converge."""
    halves, size = trial.shape[0], trial.shape[1] * trial.shape[2]
    now, offset, residual = work[NOW:LAST], (halves - 1) * size, np.inf
    for count in range(MOST):
        missed = 0.0  # at any node
        for node in range(1, TERMS):
            s, row = tables.nodes[node], node - 1
            once, once_low = tables.velocities[row], tables.velocities_low[row]
            if halves == 2:
                twice, twice_low = tables.positions[row], tables.positions_low[row]
                place(trial_flat, 0, work[X], work[LOST_X], work[V], now, twice, twice_low, s, h)
            if halves == 1 or velocities:
                place(trial_flat, offset, work[V], work[LOST_V], None, now, once, once_low, s, h)
            status = fill_derivative(bound, t + s * h, trial, dy, cursor)
            if status != OK:
                return status
            values, low, corrections = tables.values[row], tables.values_low[row], tables.corrections[row]
            at_node = correct(now, dy_flat, offset, values, low, corrections, node, work[SCALE])
            missed = max(missed, at_node)
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
    forces, y, trial, trial_flat, dy, dy_flat, work, tables, velocities, eta, clock, until, steps, cursor
):
    """Steps until the clock has reached ``until``, or ``steps`` of them; a status, STOPPED where the step came to
    nothing.

    y, trial and dy are (2, rows, n) or (1, 1, n), the flat ones the same memory and some room after; ``velocities``
    tells whether the accelerations depend on them."""
    bound = handle(forces)
    halves, size = y.shape[0], y.shape[1] * y.shape[2]
    offset, width = (halves - 1) * size, work.shape[1]
    now, flat_y = work[NOW:LAST], y.reshape(-1)
    while cursor[STEP] < steps and clock[TIME] < until:
        t, h = clock[TIME], clock[NEXT]
        if not cursor[FRESH]:
            for i in range(offset + size):
                trial_flat[i] = flat_y[i]
            status = fill_derivative(bound, t, trial, dy, cursor)
            if status != OK:
                return status
            for i in range(size):
                now[0, i] = dy_flat[offset + i]
            cursor[FRESH] = 1
        least = 10.0 * (np.nextafter(abs(t), np.inf) - abs(t))
        if not h > least or clock[SHORTEST] > SHORTEST_MOST:
            return STOPPED
        for i in range(size):
            trial_flat[offset + i] = work[V, i]  # for forces that take no velocities but look at them
        ratio = h / clock[STEP_LAST] if clock[STEP_LAST] > 0.0 and clock[SHORTEST] == 0.0 else 0.0
        predict(work, ratio, clock[RATIO], tables.shifts)
        set_scale(work, h, y.shape[1] > 1)
        status = iterate(bound, t, h, trial, trial_flat, dy, dy_flat, work, tables, velocities, cursor)
        if status in (GROW, RAISED):
            return status
        wanted = SHORTER * h
        if status == OK:
            wanted = next_step(now, work[ENDS:], work[V], y.shape[1], y.shape[2], h, eta)
        too_long = not wanted >= SHORTER * h
        if status != OK or (too_long and wanted > 4.0 * least):
            clock[NEXT] = wanted
            cursor[REJECTED] += 1
            continue
        clock[SHORTEST] = clock[SHORTEST] + 1.0 if too_long else 0.0  # a force that jumps, say: it is passed like that
        wanted = max(wanted, 4.0 * least) if too_long else wanted
        for row in range(NOW, LAST):
            for i in range(width):
                work[row + LAST - NOW, i] = work[row, i]
                work[row + GUESS_LAST - NOW, i] = work[row + GUESS - NOW, i]
        for i in range(width):
            work[X_BEFORE, i], work[V_BEFORE, i] = work[X, i], work[V, i]
        once, once_low = tables.velocities[TERMS - 1], tables.velocities_low[TERMS - 1]
        if halves == 2:
            twice, twice_low = tables.positions[TERMS - 1], tables.positions_low[TERMS - 1]
            finish(work[X], work[LOST_X], work[V], work[LOST_V], now, twice, twice_low, h)
        finish(work[V], work[LOST_V], None, None, now, once, once_low, h)
        for i in range(size):
            flat_y[offset + i] = work[V, i]
        if halves == 2:
            for i in range(size):
                flat_y[i] = work[X, i]
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

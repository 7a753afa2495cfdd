"""Sums of gauss-radau15 over a step's polynomial: prediction, values at the nodes, correction, the step's end.

A step's unknowns are the coefficients c_0 … c_7 of a(s), see ``method``. The code works on eight numbers at a
time, with all particles' components side by side. ``work`` is the workspace as one row of numbers, and ``width`` the
length of each of its rows. Everything is inlined into the loop: passing arrays would take nearly as long as a step of a
few bodies.
"""

from collections.abc import Callable
from typing import Any

import numpy as np

from kickdrift.forces.seam.kernel import BLOWN_UP, OK
from kickdrift.integrators.gauss_radau.step import AGAIN, MOST, TERMS, larger
from kickdrift.jit.compile import in_order, inlined
from kickdrift.jit.lanes.functions import lane_max, minus, multiply_add, plus, splat
from kickdrift.jit.lanes.masks import mask_bits, select
from kickdrift.jit.lanes.memory import load, masked_store, store
from kickdrift.jit.lanes.vectors import WIDTH

# Rows of the workspace, (ROWS, width): position and velocity at the step's start (y of a first-order problem in the
# velocity's place), the rounding errors of both, both at the start of the previous step. Then the coefficients of this
# step and of the last, the predictions of the last step's and this step's by the previous polynomial, the scale of
# residuals, derivatives of a at the step's end. Then the polynomial at a node less c_0, its prediction at the next
# node, and the predicted displacement.
X, V, LOST_X, LOST_V, X_BEFORE, V_BEFORE = range(6)
NOW, LAST, GUESS_LAST, GUESS, SCALE, ENDS = 6, 14, 22, 30, 38, 39
AT_NODE, AHEAD, BASE = (ENDS + TERMS + k for k in range(3))
ROWS = BASE + 1
NODES = TERMS - 1
BLOCK = 2 * WIDTH  # numbers that ``prepare`` takes at a time; the last WIDTH alone, in a row that is no multiple
LOW = 4  # terms whose weights include their rounding errors


@inlined
def predict(work, width, ratio, before, shifts):
    """Predict the step's polynomial: extrapolate the last one, and estimate its missing s^8 term from the previous
    residual.

    That term grows as the eighth power of the step (Everhart 1985 keeps it constant). ``ratio`` is the step's length
    over the last one's, ``before`` the last one's over its predecessor's; 0 if there was none.
    """
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
    """Set the scale of residuals: one over the largest acceleration of all particles. For each unknown of a Problem,
    one over its own derivative, or over its size if that is larger."""
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
    """Return sum_j weights_j c_j from c_first on, smallest terms first.

    The largest weights include their rounding errors: these are equal in every step and would make the energy drift by
    some 1e-20 a step.
    """
    total = splat(low[row, 1]) * load(work, (NOW + 1) * width + i)
    for j in range(2, LOW):
        total = multiply_add(splat(low[row, j]), load(work, (NOW + j) * width + i), total)
    for j in range(TERMS - 1, first - 1, -1):
        total = multiply_add(splat(table[row, j]), load(work, (NOW + j) * width + i), total)
    return total


@in_order
def two_weighted(work, width, i, tables, row):
    """Return two vectors each of the polynomial at a node less c_0 and of positions there: sums as above, interleaved,
    since each alone would wait for its own last addition."""
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
    """Compute the part of a node that does not depend on the forces at the node before: AHEAD <- the polynomial there
    less c_0, BASE <- the predicted displacement s h (v + s h sum_j weights_j c_j)."""
    factor = splat(tables.nodes[row + 1]) * splat(h)
    rest = multiply_add(splat(tables.nodes[row + 1]), splat(h), -factor)  # rounding error of s h
    if positions:
        if width % BLOCK:
            i = width - WIDTH
            place = weighted(work, width, i, 0, tables.positions, tables.positions_low, row)
            place = multiply_add(factor, place, load(work, V * width + i))
            lost = multiply_add(rest, place, load(work, LOST_X * width + i))
            store(work, BASE * width + i, multiply_add(factor, place, lost))
            store(work, AHEAD * width + i, weighted(work, width, i, 1, tables.values, tables.values_low, row))
        for i in range(0, width - WIDTH, BLOCK):
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
    """Make the polynomial pass through ``found[offset:]`` at a node, and move positions and AT_NODE to the following
    node.

    Returns the larger of ``worst`` and the polynomial's error on SCALE, in lanes; and lanes of 0, or nan if something
    is not finite.
    """
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

    A fused multiply-add keeps the largest product exact, and two-sums keep the rounding errors of sums (Knuth 1969;
    Dekker 1971, doi:10.1007/BF01397083).
    """
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


def iteration(
    accelerate: Callable[..., Any], verdict: Callable[..., Any], rescale: Callable[..., Any]
) -> Callable[..., Any]:
    """Compiled iteration of a step's polynomial, until only rounding is left.

    ``accelerate(move, t)`` fills the accelerations and returns a status, ``verdict`` is as in ``step``, and
    ``rescale(move, count)`` may change the scale of residuals before each iteration."""

    @inlined
    def iterate(move, t, h, x, v, a, offset, work, width, tables, positions, velocities):
        """Correct the polynomial of a step of length h from t on. Positions are at ``x``, velocities and accelerations
        at ``v[offset:]`` and ``a[offset:]``. Return a status, BLOWN_UP without convergence."""
        residual = np.inf
        prepare(work, width, tables, 0, h, positions)
        for i in range(0, width, WIDTH):
            store(work, AT_NODE * width + i, load(work, AHEAD * width + i))
            if positions:
                store(x, i, plus(load(work, X * width + i), load(work, BASE * width + i)))
        for count in range(MOST):
            rescale(move, count)
            worst = splat(0.0)  # over all nodes
            for row in range(NODES):
                following = row + 1 if row + 1 < NODES else 0
                if velocities:
                    place_velocities(work, width, v, offset, tables, row, h)
                status = accelerate(move, t + tables.nodes[row + 1] * h)
                if status != OK:
                    return status
                prepare(work, width, tables, following, h, positions)
                worst, odd = correct(work, width, a, offset, x, tables, row, following, h, positions, worst)
                if mask_bits(odd >= 0.0) != 255:
                    return BLOWN_UP
            missed = lane_max(worst)
            status = verdict(count, missed, residual)
            if status != AGAIN:
                return status
            residual = missed
        return BLOWN_UP

    return iterate


@inlined
def as_before(move, count):
    """Leave the scale of residuals as it is."""


@inlined
def pass_on(work, width, tables, h, positions):
    """Go to the step's end, and make its polynomial the last one."""
    for i in range(0, TERMS * width, WIDTH):
        store(work, LAST * width + i, load(work, NOW * width + i))
        store(work, GUESS_LAST * width + i, load(work, GUESS * width + i))
    if positions:
        finish(work, width, X, LOST_X, tables.positions, tables.positions_low, h, True)
    finish(work, width, V, LOST_V, tables.velocities, tables.velocities_low, h, False)


@inlined
def copied(target, offset, work, width, row, count):
    """target[offset:] <- ``count`` numbers of a row of the workspace."""
    for i in range(0, width, WIDTH):
        masked_store(target, offset + i, load(work, row * width + i), count - i)

"""Autoregression of residuals, in compiled code.

The rows of the regression are 1, perhaps the place, the residual, and the steps of the residuals 1, 2, … samples
before. The step itself comes last. All lie in one memory, where a delayed row begins a number earlier.
"""

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from kickdrift.jit.compile import driver, jit
from kickdrift.jit.handle import handle, unowned
from kickdrift.jit.lanes.functions import lane_sum, splat
from kickdrift.jit.lanes.memory import load, store
from kickdrift.jit.lanes.vectors import WIDTH

INDEPENDENT = 1e-3  # sine of the angle between a row and those before, from which sums of products are exact enough
CONDITION = 1e10  # of a matrix of products, up to which its inverse by elimination is exact enough
TILE = 4  # rows whose products are summed together
NOTHING, PROJECTIONS, INVERSE, DONE = 0, 1, 2, 3  # what is given, or what is still missing


class Room(NamedTuple):
    """Workspace for a series of n numbers and up to R rows. C is R with room for eight more."""

    rows: NDArray[np.float64]  # (4 c,) ones, places, residuals and steps; a row of c numbers each, filled up with zeros
    starts: NDArray[np.int64]  # (R + TILE,) where each row begins
    counts: NDArray[np.int64]  # (2,) rows before the last; lags
    products: NDArray[np.float64]  # (R, C) sums of products of rows
    triangle: NDArray[np.float64]  # (R, C) factor of the products, or their inverse, of rows divided by their norms
    norms: NDArray[np.float64]  # (R,) norms of the rows; 1 for a row of zeros
    projections: NDArray[np.float64]  # (R,) last row on each row without the rows before
    solution: NDArray[np.float64]  # (R,) coefficients of the rows
    deviations: NDArray[np.float64]  # (R,) their standard errors
    rest: NDArray[np.float64]  # (c,) last row less the solution

    def regressors(self, begin: int, end: int) -> NDArray[np.float64]:
        """Numbers ``begin`` to ``end`` of all chosen rows."""
        return np.array([self.rows[start + begin : start + end] for start in self.starts[: self.counts[0] + 1]])


def room_for(n: int, longest: int) -> Room:
    """Workspace for a series of n numbers and up to ``longest`` delays."""
    most, columns = longest + 4, n + longest + 2 * WIDTH
    wide = most + WIDTH
    norms, projections, solution, deviations = np.zeros((4, most))
    return Room(
        np.zeros(4 * columns), np.zeros(most + TILE, np.int64), np.zeros(2, np.int64), np.zeros((most, wide)),
        np.zeros((most, wide)), norms, projections, solution, deviations, np.zeros(columns),
    )  # fmt: skip


@jit
def fill_rows(rest, longest, room):
    """Fill in ``rows`` for the residuals ``rest`` (n,)."""
    rows, n, columns = room.rows, rest.size, room.rest.size
    rows[:] = 0.0
    for i in range(n - 1):
        rows[i], rows[columns + i] = 1.0, i + 1 - 0.5 * (n - 1)
        rows[2 * columns + i], rows[3 * columns + longest + i] = rest[i], rest[i + 1] - rest[i]


@jit
def choose_rows(before, lags, longest, room):
    """Fill in ``starts`` and ``counts`` for so many rows of powers and so many delays."""
    starts, columns = room.starts, room.rest.size
    for r in range(before):
        starts[r] = r * columns
    starts[before] = 2 * columns
    for delay in range(1, lags + 1):
        starts[before + delay] = 3 * columns + longest - delay
    count = before + 1 + lags
    starts[count:] = 3 * columns + longest
    room.counts[0], room.counts[1] = count, lags


@jit
def fill_products(begin, end, room):
    """Fill in ``products`` from the numbers ``begin`` to ``end`` of the rows."""
    rows, starts, count = room.rows, room.starts, room.counts[0] + 1
    whole = begin + (end - begin) // WIDTH * WIDTH
    for r in range(count):
        for s in range(r, count, TILE):
            p, q0, q1, q2, q3 = starts[r], starts[s], starts[s + 1], starts[s + 2], starts[s + 3]
            a, b, c, d = splat(0.0), splat(0.0), splat(0.0), splat(0.0)
            for i in range(begin, whole, WIDTH):
                own = load(rows, p + i)
                a, b = a + own * load(rows, q0 + i), b + own * load(rows, q1 + i)
                c, d = c + own * load(rows, q2 + i), d + own * load(rows, q3 + i)
            found = (lane_sum(a), lane_sum(b), lane_sum(c), lane_sum(d))
            for m in range(min(TILE, count - s)):
                value = found[m]
                for i in range(whole, end):
                    value += rows[p + i] * rows[starts[s + m] + i]
                room.products[r, s + m] = room.products[s + m, r] = value


@jit
def keep_products(before, lags, longest, room):
    """Keep the ``products`` of the rows for fewer delays, and add those of the numbers that longer delays lacked."""
    products, rows, starts, last = room.products, room.rows, room.starts, room.counts[0]
    choose_rows(before, lags, longest, room)
    count = room.counts[0]
    for r in range(count):
        products[r, count] = products[r, last]
    products[count, count] = products[last, last]
    for r in range(count + 1):
        for s in range(r, count + 1):
            value = products[r, s]
            for i in range(lags, longest):
                value += rows[starts[r] + i] * rows[starts[s] + i]
            products[r, s] = products[s, r] = value


@jit
def divide_by_norms(count, room):
    """Fill in ``norms``, and ``triangle`` with the products of rows divided by these."""
    norms, products, triangle = room.norms, room.products, room.triangle
    for r in range(count):
        norms[r] = math.sqrt(products[r, r]) if products[r, r] > 0.0 else 1.0
    for r in range(count):
        for s in range(count):
            triangle[r, s] = products[r, s] / (norms[r] * norms[s])


@jit
def project(room):
    """Fill in ``projections`` by Cholesky's factors. Return whether the rows are independent enough for these."""
    triangle, count = room.triangle, room.counts[0] + 1
    divide_by_norms(count, room)
    for i in range(count):
        if not triangle[i, i] > INDEPENDENT * INDEPENDENT:
            return False
        inverse = 1.0 / math.sqrt(triangle[i, i])
        for j in range(i, count):
            triangle[i, j] *= inverse
        for m in range(i + 1, count):
            factor = triangle[i, m]
            for j in range(m, count):
                triangle[m, j] -= factor * triangle[i, j]
        room.projections[i] = triangle[i, count - 1] * room.norms[count - 1]
    return True


@jit
def best_lags(before, longest, numbers, room):
    """Number of delays by the Bayesian information criterion. Rows are nested: one set of ``projections`` gives the
    residual of every number of delays."""
    whole, best, lags = room.products[room.counts[0], room.counts[0]], math.inf, 0
    left = whole
    if not whole > 0.0:
        return 0
    for r in range(before):
        left -= room.projections[r] ** 2
    for order in range(longest + 1):
        left -= room.projections[before + order] ** 2
        criterion = numbers * math.log(max(left / whole, 1e-30)) + math.log(numbers) * order
        if criterion < best:
            best, lags = criterion, order
    return lags


@jit
def largest_column(matrix, count):
    """Largest sum of moduli of a column."""
    largest = 0.0
    for r in range(count):
        total = 0.0
        for s in range(count):
            total += abs(matrix[s, r])
        largest = max(largest, total)
    return largest


@jit
def invert(room):
    """Put into ``triangle`` the inverse of the products of the rows before the last, divided by their norms. Return
    whether rounding leaves this inverse exact enough."""
    matrix, count = room.triangle, room.counts[0]
    divide_by_norms(count, room)
    size = largest_column(matrix, count)
    for p in range(count):
        if not matrix[p, p] > 0.0:
            return False
        inverse = 1.0 / matrix[p, p]
        matrix[p, p] = 1.0
        for j in range(count):
            matrix[p, j] *= inverse
        for i in range(count):
            if i != p:
                factor = matrix[i, p]
                matrix[i, p] = 0.0
                for j in range(count):
                    matrix[i, j] -= factor * matrix[p, j]
    return size * largest_column(matrix, count) < CONDITION


@jit
def fill_rest(begin, end, room):
    """rest <- the last row less the solution."""
    rows, starts, rest, count = room.rows, room.starts, room.rest, room.counts[0]
    for i in range(begin, end, WIDTH):
        value = load(rows, starts[count] + i)
        for r in range(count):
            value = value - room.solution[r] * load(rows, starts[r] + i)
        store(rest, i, value)
    rest[end:] = 0.0


@jit
def solve(begin, end, room):
    """Fill in ``solution`` and ``deviations`` by the inverse. One refinement compensates for the squared condition
    number."""
    rows, starts, rest, inverse, norms = room.rows, room.starts, room.rest, room.triangle, room.norms
    count, right, solution = room.counts[0], room.projections, room.solution
    for turn in range(2):
        for r in range(count):
            right[r] = room.products[r, count]
            if turn:
                total = splat(0.0)
                for i in range(begin, end, WIDTH):
                    total = total + load(rows, starts[r] + i) * load(rest, i)
                right[r] = lane_sum(total)
            right[r] /= norms[r]
        for r in range(count):
            value = 0.0
            for s in range(count):
                value += inverse[r, s] * right[s]
            solution[r] = value / norms[r] + (solution[r] if turn else 0.0)
        fill_rest(begin, end, room)
    squares = 0.0
    for i in range(begin, end):
        squares += rest[i] * rest[i]
    variance = squares / max(end - begin - count, 1)
    for r in range(count):
        room.deviations[r] = math.sqrt(variance * inverse[r, r]) / norms[r]


@driver
def autoregress(rest, before, longest, given, workspace):
    """Fit an autoregression to the residuals ``rest`` (n,), with ``before`` powers of the place and at most ``longest``
    delays.

    Return DONE, with ``solution`` and ``deviations`` for the best number of delays. Return PROJECTIONS or INVERSE where
    sums of products are too inexact for these numbers. The caller fills them in, an inverse in ``triangle``, and calls
    again with what is then ``given``.
    """
    room, rest = handle(workspace), unowned(rest)
    end = rest.size - 1
    if given < PROJECTIONS:
        fill_rows(rest, longest, room)
        choose_rows(before, longest, longest, room)
        fill_products(longest, end, room)
        if not project(room):
            return PROJECTIONS
    if given < INVERSE:
        keep_products(before, best_lags(before, longest, end - longest, room), longest, room)
        if not invert(room):
            return INVERSE
    solve(room.counts[1], end, room)
    return DONE


@driver
def undo_whitening(frequencies, whitener, cosines, sines):
    """Divide amplitudes (L,) of waves in a whitened series by the whitener's response at their ``frequencies`` (L,)."""
    frequencies, whitener = unowned(frequencies), unowned(whitener)
    cosines, sines = unowned(cosines), unowned(sines)
    last = whitener.size - 1
    for i in range(frequencies.size):
        turn = complex(math.cos(frequencies[i]), -math.sin(frequencies[i]))
        over = complex(whitener[last], 0.0)
        for k in range(last - 1, -1, -1):
            over = over * turn + whitener[k]
        half = 0.5 * last * frequencies[i]
        apart = complex(cosines[i], -sines[i]) / (over * complex(math.cos(half), math.sin(half)))
        cosines[i], sines[i] = apart.real, -apart.imag


@driver
def whiten(y, whitener, white):
    """white (n + 1 - w,) <- sums of w numbers of ``y`` (n,), the last one first, times the ``whitener`` (w,)."""
    y, whitener, white = unowned(y), unowned(whitener), unowned(white)
    last = whitener.size - 1
    for i in range(white.size):
        white[i] = whitener[0] * y[i + last]
    for k in range(1, last + 1):
        weight = whitener[k]
        for i in range(white.size):
            white[i] += weight * y[i + last - k]

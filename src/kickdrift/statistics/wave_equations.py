"""Normal equations of a line and waves, in compiled code: their factors, and steps of the frequencies."""

from __future__ import annotations

import math

from kickdrift.jit.compile import jit
from kickdrift.jit.lanes.memory import load, store
from kickdrift.jit.lanes.vectors import WIDTH

HIDDEN = 1e-10  # squared sine of the angle between a column and those before; rounding hides a column below


@jit
def factor(room, which, count, least):
    """Replace a symmetric matrix by U with U^T U = S matrix S, for the ``scales`` S that make its diagonal 1. A column
    whose square is not above ``least`` is zero but for rounding, as that of the sine with alternating signs."""
    matrix, scales, inverses = room.systems[which], room.scales[which], room.inverses[which]
    columns = scales.size
    for i in range(columns):
        scales[i] = 0.0
        if i < count and matrix[i, i] > least:
            scales[i] = 1.0 / math.sqrt(matrix[i, i])
    for i in range(count):
        for b in range(i // WIDTH * WIDTH, count, 2 * WIDTH):  # two at once, since each sum waits for the one before
            d = b + WIDTH if b + WIDTH < count else b
            row = scales[i] * load(scales, b) * load(matrix, i * columns + b)
            row2 = scales[i] * load(scales, d) * load(matrix, i * columns + d)
            for m in range(i):
                row = row - matrix[m, i] * load(matrix, m * columns + b)
                row2 = row2 - matrix[m, i] * load(matrix, m * columns + d)
            store(matrix, i * columns + b, row)
            store(matrix, i * columns + d, row2)
        inverse = 1.0 / math.sqrt(matrix[i, i]) if matrix[i, i] > HIDDEN else 0.0
        inverses[i] = inverse
        for b in range(i // WIDTH * WIDTH, count, WIDTH):
            store(matrix, i * columns + b, inverse * load(matrix, i * columns + b))


@jit
def forward(room, which, count, right, end):
    """Columns of ``right`` before ``end`` <- U^-T S right."""
    matrix, scales, inverses = room.systems[which], room.scales[which], room.inverses[which]
    columns = scales.size
    for i in range(count):
        for b in range(0, end, 2 * WIDTH):
            d = b + WIDTH if b + WIDTH < end else b
            row, row2 = scales[i] * load(right, i * columns + b), scales[i] * load(right, i * columns + d)
            for m in range(i):
                row = row - matrix[m, i] * load(right, m * columns + b)
                row2 = row2 - matrix[m, i] * load(right, m * columns + d)
            store(right, i * columns + b, inverses[i] * row)
            store(right, i * columns + d, inverses[i] * row2)


@jit
def backward(room, which, count, right, column):
    """Row ``which`` of ``solution`` <- S U^-1 times a column of ``right``."""
    matrix, inverses, found = room.systems[which], room.inverses[which], room.solution[which]
    for i in range(count - 1, -1, -1):
        value = right[i, column]
        for j in range(i + 1, count):
            value -= matrix[i, j] * found[j]
        found[i] = value * inverses[i]
    for i in range(count):
        found[i] *= room.scales[which, i]


@jit
def gauss_newton(n, frequencies, room):
    """Move all ``frequencies`` by one step of at most 1 / n, towards the least squares of the series less line and
    waves. Line and amplitudes are eliminated first."""
    count, columns = frequencies.size, room.scales.shape[1]
    across, slopes, found, solution, changes = room.across, room.slopes, room.found, room.solution, room.systems[2]
    size = columns * columns
    for half in range(2):
        factor(room, half, count + 1, HIDDEN * n)
        right = across[half]
        for i in range(count + 1):
            right[i, count] = found[half, i]
        forward(room, half, count + 1, right, count + 1)
        backward(room, half, count + 1, right, count)
        for i in range(columns):  # aligned with the frequencies
            found[half, i] = (2.0 * half - 1.0) * solution[half, i + 1] if i < count else 0.0
    for i in range(count):  # the series changes with w by k (b cos - a sin), for a wave a cos + b sin
        minus_a, b = found[0, i], found[1, i]
        right_side = minus_a * found[2, i + 1] + b * found[3, i + 1]
        for p in range(i // WIDTH * WIDTH, count, 2 * WIDTH):
            q = p + WIDTH if p + WIDTH < count else p
            by_even, by_odd = minus_a * load(found, p), b * load(found, columns + p)
            by_even2, by_odd2 = minus_a * load(found, q), b * load(found, columns + q)
            of_even, of_odd = load(slopes, size + i * columns + p), load(slopes, i * columns + p)
            of_even2, of_odd2 = load(slopes, size + i * columns + q), load(slopes, i * columns + q)
            for m in range(count + 1):
                even, odd = across[0, m, i], across[1, m, i]
                of_even = of_even - even * load(across, m * columns + p)
                of_odd = of_odd - odd * load(across, size + m * columns + p)
                of_even2 = of_even2 - even * load(across, m * columns + q)
                of_odd2 = of_odd2 - odd * load(across, size + m * columns + q)
            store(changes, i * columns + p, by_even * of_even + by_odd * of_odd)
            store(changes, i * columns + q, by_even2 * of_even2 + by_odd2 * of_odd2)
        for m in range(count + 1):
            right_side -= minus_a * across[0, m, i] * across[0, m, count] + b * across[1, m, i] * across[1, m, count]
        if not changes[i, i] > HIDDEN * (minus_a * minus_a + b * b) * n**3 / 24.0:  # also at alternating signs
            changes[i, i] = 0.0
        found[3, i] = right_side
    factor(room, 2, count, 0.0)
    for i in range(count):
        across[0, i, 0] = found[3, i]
    forward(room, 2, count, across[0], 1)
    backward(room, 2, count, across[0], 0)
    for i in range(count):
        frequencies[i] += min(max(solution[2, i], -1.0 / n), 1.0 / n)

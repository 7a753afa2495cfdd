"""Least squares of a straight line and sine waves, in compiled code.

The places of n evenly spaced numbers are k = -(n - 1) / 2 … (n - 1) / 2. Over these, 1, cos(w k) and k sin(w k) are
even, and k, sin(w k) and k cos(w k) are odd. So the normal equations fall into two systems of half the size. Sums of
products of waves follow from D0(w), the sum of cos(w k), D1, that of k sin(w k), and D2, that of k^2 cos(w k). These
are known: D0 = sin(n w / 2) / sin(w / 2), D1 = -D0' and D2 = -D0''.
"""

from __future__ import annotations

import math
from itertools import accumulate
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from kickdrift.jit.compile import driver, inlined, jit
from kickdrift.jit.handle import handle, unowned
from kickdrift.jit.lanes import lane_numbers, lane_sum, splat
from kickdrift.jit.masks import mask_bits, select
from kickdrift.jit.memory import aligned, load, store
from kickdrift.jit.vectors import WIDTH

HIDDEN = 1e-10  # squared sine of the angle between a column and those before; rounding hides a column below
NEAR = 0.3  # n |sin(w / 2)| below which the closed forms cancel


class Room(NamedTuple):
    """Workspace for a series of n numbers and up to L waves.

    C is L filled up to a multiple of eight, and eight more. Index 0 is the even system, 1 the odd one, and 2 that of
    the changes of the frequencies.
    """

    places: NDArray[np.float64]  # (p,) the places k >= 0, filled up with zeros to a multiple of eight
    halves: NDArray[np.float64]  # (2, p) y(k) + y(-k) and y(k) - y(-k) for k >= 0, but y(0) alone
    turns: NDArray[np.float64]  # (4, C) sines and cosines of w / 2 and n w / 2
    first: NDArray[np.float64]  # (2, 8) cosines and sines of the first eight places
    systems: NDArray[np.float64]  # (3, C, C) sums of products, then their factors
    across: NDArray[np.float64]  # (2, C, C) sums with k sin and k cos, and the right side in the column behind
    slopes: NDArray[np.float64]  # (2, C, C) sums of k cos with each other, and of k sin
    found: NDArray[np.float64]  # (4, C) sums of the series with 1 and cos, k and sin, k sin, k cos
    scales: NDArray[np.float64]  # (3, C) one over the roots of the diagonals
    inverses: NDArray[np.float64]  # (3, C) one over the diagonals of the factors, 0 for hidden columns
    solution: NDArray[np.float64]  # (3, C) coefficients of the columns


def room_for(n: int, waves: int) -> Room:
    """Workspace for a series of n numbers and up to so many waves."""
    places, columns = (-(-count // WIDTH) * WIDTH for count in ((n + 1) // 2, waves + WIDTH))
    shapes = (
        (places,), (2, places), (4, columns), (2, WIDTH), (3, columns, columns), (2, columns, columns),
        (2, columns, columns), (4, columns), (3, columns), (3, columns), (3, columns),
    )  # fmt: skip
    sizes = [math.prod(shape) for shape in shapes]
    whole, ends = aligned((sum(sizes),), None), accumulate(sizes)
    parts = [whole[end - size : end] for size, end in zip(sizes, ends, strict=True)]
    return Room(*(part.reshape(shape) for part, shape in zip(parts, shapes, strict=True)))


@inlined
def sums_of_cosines(n, s, c, sn, cn):
    """D0, D1 and D2 of eight w, from the sines and cosines of w / 2 and n w / 2, and the mask of those that cancel."""
    inverse = 1.0 / s
    d0 = sn * inverse
    slope = (n * cn - d0 * c) * inverse
    return d0, -0.5 * slope, 0.25 * ((n * n - 1.0) * d0 + 2.0 * slope * c * inverse), abs(s) * n < NEAR


@jit
def sums_one_by_one(n, w):
    d0, d1, d2 = 0.0, 0.0, 0.0
    for i in range(n):
        k = i - 0.5 * (n - 1)
        cosine = math.cos(w * k)
        d0, d1, d2 = d0 + cosine, d1 + k * math.sin(w * k), d2 + k * k * cosine
    return d0, d1, d2


@jit
def fill_turns(n, frequencies, room):
    """Fill in ``turns``."""
    for i in range(room.turns.shape[1]):
        half = 0.5 * frequencies[i] if i < frequencies.size else 0.5
        room.turns[0, i], room.turns[1, i] = math.sin(half), math.cos(half)
        room.turns[2, i], room.turns[3, i] = math.sin(n * half), math.cos(n * half)


@jit
def fill_products(n, frequencies, room):
    """Fill in ``systems``, ``across`` and ``slopes``."""
    turns, systems, across, slopes = room.turns, room.systems, room.across, room.slopes
    count, columns = frequencies.size, turns.shape[1]
    size, squares = columns * columns, n * (n * n - 1.0) / 12.0
    systems[0, 0, 0], systems[1, 0, 0] = n, squares
    for i in range(-1, count):  # -1 is the frequency 0, of 1 and k
        si, ci, sni, cni = 0.0, 1.0, 0.0, 1.0
        if i >= 0:
            si, ci, sni, cni = turns[0, i], turns[1, i], turns[2, i], turns[3, i]
        for b in range(0, count, WIDTH):
            s, c = load(turns, b), load(turns, columns + b)
            sn, cn = load(turns, 2 * columns + b), load(turns, 3 * columns + b)
            p0, p1, p2, far = sums_of_cosines(
                n, s * ci + c * si, c * ci - s * si, sn * cni + cn * sni, cn * cni - sn * sni
            )
            m0, m1, m2, near = sums_of_cosines(
                n, s * ci - c * si, c * ci + s * si, sn * cni - cn * sni, cn * cni + sn * sni
            )
            itself = lane_numbers() == float(i - b)
            m0, m1 = select(itself, splat(float(n)), m0), select(itself, splat(0.0), m1)
            m2 = select(itself, splat(squares), m2)
            row = (i + 1) * columns + b
            store(systems, row + 1, 0.5 * (m0 + p0))
            store(across, row, 0.5 * (p1 + m1))
            if i >= 0:
                store(systems, size + row + 1, 0.5 * (m0 - p0))
                store(across, size + row, 0.5 * (p1 - m1))
                store(slopes, i * columns + b, 0.5 * (m2 + p2))
                store(slopes, size + i * columns + b, 0.5 * (m2 - p2))
            else:  # k in place of a sine, and k times 1 in place of k times a sine
                store(systems, size + row + 1, p1)
                store(across, size + row, p2)
            lanes = (mask_bits(near) & ~mask_bits(itself)) | mask_bits(far)
            for j in range(b, min(b + WIDTH, count)):
                if (lanes >> (j - b)) & 1:
                    fill_pair(n, frequencies, room, i, j)


@jit
def fill_pair(n, frequencies, room, i, j):
    """The same for one pair of frequencies, whose sum or difference is so near 0 that the closed forms cancel."""
    systems, across, slopes = room.systems, room.across, room.slopes
    own = frequencies[i] if i >= 0 else 0.0
    p0, p1, p2 = sums_one_by_one(n, frequencies[j] + own)
    m0, m1, m2 = float(n), 0.0, n * (n * n - 1.0) / 12.0
    if j != i:
        m0, m1, m2 = sums_one_by_one(n, frequencies[j] - own)
    systems[0, i + 1, j + 1], across[0, i + 1, j] = 0.5 * (m0 + p0), 0.5 * (p1 + m1)
    if i >= 0:
        systems[1, i + 1, j + 1], across[1, i + 1, j] = 0.5 * (m0 - p0), 0.5 * (p1 - m1)
        slopes[0, i, j], slopes[1, i, j] = 0.5 * (m2 + p2), 0.5 * (m2 - p2)
    else:
        systems[1, 0, j + 1], across[1, 0, j] = p1, p2


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
        for b in range(i // WIDTH * WIDTH, count, WIDTH):
            row = scales[i] * load(scales, b) * load(matrix, i * columns + b)
            for m in range(i):
                row = row - matrix[m, i] * load(matrix, m * columns + b)
            store(matrix, i * columns + b, row)
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
        for b in range(0, end, WIDTH):
            row = scales[i] * load(right, i * columns + b)
            for m in range(i):
                row = row - matrix[m, i] * load(right, m * columns + b)
            store(right, i * columns + b, inverses[i] * row)


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
def fold(y, room):
    """Fill in ``places`` and ``halves``."""
    places, halves, n = room.places, room.halves, y.size
    count = (n + 1) // 2
    for i in range(places.size):
        places[i], halves[0, i], halves[1, i] = 0.0, 0.0, 0.0
        if i < count:
            right, left = y[n - count + i], y[count - 1 - i]
            places[i], halves[0, i], halves[1, i] = i + 0.5 * (1 - n % 2), right + left, right - left
    if n % 2:
        halves[0, 0] = y[n // 2]


@jit
def first_places(w, j, room):
    """Fill in ``first`` for the frequency j, w, and return the cosine and the sine of 8 w."""
    half_sine, half_cosine = room.turns[0, j], room.turns[1, j]
    over_cos, over_sin = 1.0 - 2.0 * half_sine * half_sine, 2.0 * half_sine * half_cosine
    c, s = 1.0, 0.0
    if room.places[0] > 0.0:
        c, s = half_cosine, half_sine
    for i in range(WIDTH):
        room.first[0, i], room.first[1, i] = c, s
        c, s = c * over_cos - s * over_sin, s * over_cos + c * over_sin
    return math.cos(WIDTH * w), math.sin(WIDTH * w)


@jit
def project(frequencies, room):
    """Fill in ``found``."""
    places, halves, found, zero = room.places, room.halves, room.found, splat(0.0)
    one, line = zero, zero
    for p in range(0, places.size, WIDTH):
        one, line = one + load(halves, p), line + load(places, p) * load(halves, places.size + p)
    found[0, 0], found[1, 0] = lane_sum(one), lane_sum(line)
    for j in range(frequencies.size):
        over_cos, over_sin = first_places(frequencies[j], j, room)
        c, s = load(room.first, 0), load(room.first, WIDTH)
        cosine, sine, times_sine, times_cosine = zero, zero, zero, zero
        for p in range(0, places.size, WIDTH):
            of_even, of_odd, k = load(halves, p), load(halves, places.size + p), load(places, p)
            cosine, sine = cosine + c * of_even, sine + s * of_odd
            times_sine, times_cosine = times_sine + s * (k * of_even), times_cosine + c * (k * of_odd)
            c, s = c * over_cos - s * over_sin, s * over_cos + c * over_sin
        found[0, j + 1], found[1, j + 1] = lane_sum(cosine), lane_sum(sine)
        found[2, j + 1], found[3, j + 1] = lane_sum(times_sine), lane_sum(times_cosine)


@jit
def take_off(n, frequencies, room):
    """Subtract the solution from ``halves``."""
    places, halves, solution = room.places, room.halves, room.solution
    size, middle = places.size, halves[0, 0]
    for j in range(frequencies.size + 1):
        a, b = 2.0 * solution[0, j], 2.0 * solution[1, j]
        middle -= solution[0, j]
        if j == 0:
            for p in range(0, size, WIDTH):
                store(halves, p, load(halves, p) - a)
                store(halves, size + p, load(halves, size + p) - b * load(places, p))
            continue
        over_cos, over_sin = first_places(frequencies[j - 1], j - 1, room)
        c, s = load(room.first, 0), load(room.first, WIDTH)
        for p in range(0, size, WIDTH):
            store(halves, p, load(halves, p) - a * c)
            store(halves, size + p, load(halves, size + p) - b * s)
            c, s = c * over_cos - s * over_sin, s * over_cos + c * over_sin
    for i in range((n + 1) // 2, size):
        halves[0, i], halves[1, i] = 0.0, 0.0
    if n % 2:
        halves[0, 0] = middle


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
        for p in range(i // WIDTH * WIDTH, count, WIDTH):
            by_even, by_odd = minus_a * load(found, p), b * load(found, columns + p)
            of_even, of_odd = load(slopes, size + i * columns + p), load(slopes, i * columns + p)
            for m in range(count + 1):
                of_even = of_even - across[0, m, i] * load(across, m * columns + p)
                of_odd = of_odd - across[1, m, i] * load(across, size + m * columns + p)
            store(changes, i * columns + p, by_even * of_even + by_odd * of_odd)
        for m in range(count + 1):
            right_side -= minus_a * across[0, m, i] * across[0, m, count] + b * across[1, m, i] * across[1, m, count]
        before = minus_a * minus_a * slopes[1, i, i] + b * b * slopes[0, i, i]
        if not changes[i, i] > HIDDEN * before:
            changes[i, i] = 0.0
        found[3, i] = right_side
    factor(room, 2, count, 0.0)
    for i in range(count):
        across[0, i, 0] = found[3, i]
    forward(room, 2, count, across[0], 1)
    backward(room, 2, count, across[0], 0)
    for i in range(count):
        frequencies[i] += min(max(solution[2, i], -1.0 / n), 1.0 / n)


@driver
def fit_waves(y, frequencies, steps, coefficients, rest, workspace):
    """Least squares of ``y`` (n,) by 1, k, and the cosine and sine of each of the ``frequencies`` (L,), after so many
    Gauss-Newton ``steps`` of these.

    ``coefficients`` (2 + 2 L,) <- those of 1, k, cosine, sine, … ``rest`` (n,) <- the residuals. Returns the variance
    of the second coefficient for residuals of variance 1.
    """
    room, y, frequencies = handle(workspace), unowned(y), unowned(frequencies)
    coefficients, rest = unowned(coefficients), unowned(rest)
    n, count = y.size, frequencies.size
    fold(y, room)
    for step in range(steps + 1):
        fill_turns(n, frequencies, room)
        fill_products(n, frequencies, room)
        project(frequencies, room)
        if step < steps:
            gauss_newton(n, frequencies, room)
    variance = 0.0
    for half in range(2):
        factor(room, half, count + 1, HIDDEN * n)
    for turn in range(2):  # the second time compensates for the squared condition number
        if turn:
            project(frequencies, room)
        for half in range(2):
            right = room.across[half]
            for i in range(count + 1):
                right[i, 0] = room.found[half, i]
            forward(room, half, count + 1, right, 1)
            backward(room, half, count + 1, right, 0)
            for i in range(count + 1):
                coefficients[2 * i + half] = room.solution[half, i] + (coefficients[2 * i + half] if turn else 0.0)
        take_off(n, frequencies, room)
    right = room.across[1]
    for i in range(count + 1):
        right[i, 0] = 1.0 if i == 0 else 0.0
    forward(room, 1, count + 1, right, 1)
    for i in range(count + 1):
        variance += right[i, 0] * right[i, 0]
    middle = (n + 1) // 2
    for i in range(middle):
        of_even, of_odd = 0.5 * room.halves[0, i], 0.5 * room.halves[1, i]
        rest[n - middle + i], rest[middle - 1 - i] = of_even + of_odd, of_even - of_odd
    if n % 2:
        rest[n // 2] = room.halves[0, 0]
    return variance


@driver
def separate_peaks(power, most, slowest, beside, significance, found):
    """found <- places of at most ``most`` significant peaks of ``power``. Each peak clears its neighbourhood.

    Return the number of peaks, and whether a significant peak is below ``slowest``."""
    power, found = unowned(power), unowned(found)
    count, slow, first = 0, False, power.max()
    while count < most:
        peak, left, total = 0, 0, 0.0
        for i in range(power.size):
            total += power[i]
            left += power[i] != 0.0
            peak = i if power[i] > power[peak] else peak
        if power[peak] <= beside * first or left * (1.0 - power[peak] / total) ** (left - 1) > significance:
            break
        if peak < slowest:
            slow = True
        else:
            found[count] = peak
            count += 1
        for i in range(max(peak - 2, 0), min(peak + 3, power.size)):
            power[i] = 0.0
    return count, slow

"""Least squares of a straight line and sine waves, in compiled code, and the peaks of a spectrum."""

import math

import numpy as np

from kickdrift.jit.compile import driver, jit
from kickdrift.jit.handle import handle, unowned
from kickdrift.jit.lanes.functions import lane_sum, splat
from kickdrift.jit.lanes.memory import load, store
from kickdrift.jit.lanes.vectors import WIDTH
from kickdrift.statistics.wave_sums import fill_products, fill_turns

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


@jit
def fold(y, room):
    """Fill in ``places`` and ``halves``."""
    places, halves, n = room.places, room.halves, y.size
    room.moments[:] = 0.0
    count = (n + 1) // 2
    for i in range(places.size):
        places[i], halves[0, i], halves[1, i] = 0.0, 0.0, 0.0
        if i < count:
            right, left = y[n - count + i], y[count - 1 - i]
            places[i], halves[0, i], halves[1, i] = i + 0.5 * (1 - n % 2), right + left, right - left
    if n % 2:
        halves[0, 0] = y[n // 2]


@jit
def unfold(y, room):
    """y <- the series whose ``halves`` these are."""
    halves, n = room.halves, y.size
    count = (n + 1) // 2
    for i in range(count):
        of_even, of_odd = 0.5 * halves[0, i], 0.5 * halves[1, i]
        y[n - count + i], y[count - 1 - i] = of_even + of_odd, of_even - of_odd
    if n % 2:
        y[n // 2] = halves[0, 0]


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
    last = frequencies.size - 1
    for i in range(0, last + 1, 2):  # two at once, since each rotation waits for the one before
        j = min(i + 1, last)
        over_cos, over_sin = first_places(frequencies[i], i, room)
        c, s = load(room.first, 0), load(room.first, WIDTH)
        over_cos2, over_sin2 = first_places(frequencies[j], j, room)
        c2, s2 = load(room.first, 0), load(room.first, WIDTH)
        cosine, sine, times_sine, times_cosine = zero, zero, zero, zero
        cosine2, sine2, times_sine2, times_cosine2 = zero, zero, zero, zero
        for p in range(0, places.size, WIDTH):
            of_even, of_odd, k = load(halves, p), load(halves, places.size + p), load(places, p)
            k_even, k_odd = k * of_even, k * of_odd
            cosine, sine = cosine + c * of_even, sine + s * of_odd
            times_sine, times_cosine = times_sine + s * k_even, times_cosine + c * k_odd
            cosine2, sine2 = cosine2 + c2 * of_even, sine2 + s2 * of_odd
            times_sine2, times_cosine2 = times_sine2 + s2 * k_even, times_cosine2 + c2 * k_odd
            c, s = c * over_cos - s * over_sin, s * over_cos + c * over_sin
            c2, s2 = c2 * over_cos2 - s2 * over_sin2, s2 * over_cos2 + c2 * over_sin2
        found[0, i + 1], found[1, i + 1] = lane_sum(cosine), lane_sum(sine)
        found[2, i + 1], found[3, i + 1] = lane_sum(times_sine), lane_sum(times_cosine)
        found[0, j + 1], found[1, j + 1] = lane_sum(cosine2), lane_sum(sine2)
        found[2, j + 1], found[3, j + 1] = lane_sum(times_sine2), lane_sum(times_cosine2)


@jit
def take_off(n, frequencies, room):
    """Subtract the solution from ``halves``."""
    places, halves, solution = room.places, room.halves, room.solution
    size, middle, last = places.size, halves[0, 0], frequencies.size - 1
    for i in range(last + 2):
        middle -= solution[0, i]
    a, b = 2.0 * solution[0, 0], 2.0 * solution[1, 0]
    for p in range(0, size, WIDTH):
        store(halves, p, load(halves, p) - a)
        store(halves, size + p, load(halves, size + p) - b * load(places, p))
    for i in range(0, last + 1, 2):  # two at once, as in ``project``
        j = min(i + 1, last)
        a, b = 2.0 * solution[0, i + 1], 2.0 * solution[1, i + 1]
        a2, b2 = (2.0 * solution[0, j + 1], 2.0 * solution[1, j + 1]) if j > i else (0.0, 0.0)
        over_cos, over_sin = first_places(frequencies[i], i, room)
        c, s = load(room.first, 0), load(room.first, WIDTH)
        over_cos2, over_sin2 = first_places(frequencies[j], j, room)
        c2, s2 = load(room.first, 0), load(room.first, WIDTH)
        for p in range(0, size, WIDTH):
            store(halves, p, load(halves, p) - a * c - a2 * c2)
            store(halves, size + p, load(halves, size + p) - b * s - b2 * s2)
            c, s = c * over_cos - s * over_sin, s * over_cos + c * over_sin
            c2, s2 = c2 * over_cos2 - s2 * over_sin2, s2 * over_cos2 + c2 * over_sin2
    for i in range((n + 1) // 2, size):
        halves[0, i], halves[1, i] = 0.0, 0.0
    if n % 2:
        halves[0, 0] = middle


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
    unfold(rest, room)
    return variance


@driver
def take_off_waves(y, frequencies, coefficients, rest, workspace):
    """rest (n,) <- ``y`` (n,) less a line and waves with these ``coefficients``, ordered as in ``fit_waves``."""
    room, y, frequencies = handle(workspace), unowned(y), unowned(frequencies)
    coefficients, rest = unowned(coefficients), unowned(rest)
    fold(y, room)
    fill_turns(y.size, frequencies, room)
    for i in range(frequencies.size + 1):
        room.solution[0, i], room.solution[1, i] = coefficients[2 * i], coefficients[2 * i + 1]
    take_off(y.size, frequencies, room)
    unfold(rest, room)


@driver
def prewhiten(rest, taper, white):
    """white (n - 1,) <- the series ``rest`` (n,) less its predecessors times its correlation with these, unless that
    is negative; then times the ``taper`` (n - 1,). Return the largest modulus of the series."""
    rest, taper, white = unowned(rest), unowned(taper), unowned(white)
    largest, squares, products = abs(rest[0]), rest[0] * rest[0], 0.0
    for i in range(1, rest.size):
        largest = max(largest, abs(rest[i]))
        squares += rest[i] * rest[i]
        products += rest[i] * rest[i - 1]
    redness = products / squares if products > 0.0 else 0.0
    for i in range(white.size):
        white[i] = (rest[i + 1] - redness * rest[i]) * taper[i]
    return largest


@driver
def separate_peaks(spectrum, known, slowest, beside, significance, found):
    """found <- places of significant peaks of a ``spectrum``, as many as it holds. Each peak clears its neighbourhood.

    A residue within a resolution element of the ``known`` places is no other line. Side lobes of the taper (-31 dB)
    beside an unrefined line are no lines either. Return the number of peaks, and whether a significant peak is below
    ``slowest``."""
    spectrum, known, found = unowned(spectrum), unowned(known), unowned(found)
    power, count, slow, first = np.empty(spectrum.size), 0, False, 0.0
    for i in range(power.size):
        power[i] = spectrum[i].real ** 2 + spectrum[i].imag ** 2
    power[0] = 0.0
    for place in known:
        power[max(place, 0) : place + 2] = 0.0
    while count < found.size:
        peak, left, total = 0, 0, 0.0
        for i in range(power.size):
            total += power[i]
            left += power[i] != 0.0
            peak = i if power[i] > power[peak] else peak
        first = max(first, power[peak])
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

"""Least squares of a straight line and sine waves, in compiled code, and the peaks of a spectrum."""

from __future__ import annotations

import math

import numpy as np

from kickdrift.jit.compile import driver, jit
from kickdrift.jit.handle import handle, unowned
from kickdrift.jit.lanes.functions import lane_sum, splat
from kickdrift.jit.lanes.memory import load, store
from kickdrift.jit.lanes.vectors import WIDTH
from kickdrift.statistics.wave_equations import HIDDEN, backward, factor, forward, gauss_newton
from kickdrift.statistics.wave_sums import fill_products, fill_turns


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

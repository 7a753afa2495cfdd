"""Sine waves in an evenly spaced series."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from kickdrift.model.state import Floats
from kickdrift.statistics.regression import inverse_of, least_squares, normal_equations, products

MAX_LINES = 40
MIN_CYCLES = 3.0  # a slower wave cannot be distinguished from a trend
LINE_SIGNIFICANCE = 1e-4


def spectral_lines(y: Floats, trend: Floats, floor: float) -> tuple[Floats, bool]:
    """Cosine and sine columns (n, 2 L) of the significant spectral lines of ``y``, and whether a slow wave remains.

    Each pass whitens a red residual to first order, so that its slow end is no line. Then it tapers the residual, so
    that a slow wave does not leak into one. Then all frequencies move together by Gauss-Newton. Waves of under
    ``MIN_CYCLES`` cycles stay in the series, because trend and wave would share its change arbitrarily. ``floor`` is
    the level of rounding.
    """
    n, index = len(y), trend[:, 1]
    waves = np.empty((n, 0))
    frequencies = np.empty(0)
    for _ in range(MAX_LINES):
        rest = least_squares(np.column_stack((trend, waves)), y)[1]
        if np.abs(rest).max() <= floor:
            break
        redness = max(float(rest[1:] @ rest[:-1]) / float(rest @ rest), 0.0)
        white = rest[1:] - redness * rest[:-1]
        power = np.abs(np.fft.rfft(white * np.hanning(n - 1))) ** 2
        power[0] = 0.0
        bins = (n - 1) / (2.0 * np.pi)
        for known in frequencies * bins:  # a residue within a resolution element of a line is no other line
            power[max(int(known), 0) : int(known) + 2] = 0.0
        slow, first = False, power.max()
        found: list[float] = []
        while len(frequencies) + len(found) < min(MAX_LINES, n // 20):
            peak, m = int(np.argmax(power)), int(np.count_nonzero(power))
            # Side lobes of the taper (-31 dB) beside an unrefined line are no lines.
            if power[peak] <= 1e-3 * first or m * (1.0 - power[peak] / power.sum()) ** (m - 1) > LINE_SIGNIFICANCE:
                break
            slow = slow or peak < MIN_CYCLES
            if peak >= MIN_CYCLES:
                found.append(peak / bins)
            power[max(peak - 2, 0) : peak + 3] = 0.0
        if not found:
            return waves, slow
        frequencies = np.append(frequencies, found)
        for _ in range(4):
            frequencies = frequencies + np.clip(_correction(y, trend, frequencies), -1.0 / n, 1.0 / n)
        waves = _waves(index, frequencies)
    return waves, False


def _correction(y: Floats, trend: Floats, frequencies: Floats) -> Floats:
    """One Gauss-Newton step of all frequencies, with trend and amplitudes fitted at the same time.

    Trend and amplitudes are eliminated from the normal equations first: their inverse is known, and the rest is small.
    """
    index = trend[:, 1]
    waves = _waves(index, frequencies)
    fixed = np.column_stack((trend, waves))
    amplitudes, inverse, norms = normal_equations(fixed, y)
    a, b = (amplitudes / norms)[2::2], (amplitudes / norms)[3::2]
    slopes = index[:, None] * (b * waves[:, 0::2] - a * waves[:, 1::2])
    scales = np.sqrt(np.einsum("ij,ij->j", slopes, slopes)) + 1e-300
    slopes /= scales
    across = products(fixed, slopes) / norms[:, None]
    known = np.hstack([inverse @ half for half in np.array_split(across, 2, axis=1)])
    left = inverse_of(products(slopes, slopes) - across.T @ known)
    return np.asarray(left @ (slopes.T @ y - across.T @ amplitudes) / scales)


def folded(waves: Floats, amplitudes: Floats) -> float:
    """Largest amplitude of a wave that sampling may have folded to the frequency zero.

    If the samples are almost in step with a wave, its harmonics fold to pairs of close lines. One harmonic then folds
    to a wave too slow to be distinguished from a trend. It is no larger than the weaker line of the closest harmonics.
    Two pairs closer than ``MIN_CYCLES`` cycles count as a fold; without them the result is 0.
    """
    if not waves.size:
        return 0.0
    cosine, sine = waves[:2, 0::2], waves[:2, 1::2]
    frequencies = np.abs(np.angle((cosine[1] + 1j * sine[1]) * (cosine[0] - 1j * sine[0])))
    order = np.argsort(frequencies)
    sizes = np.hypot(amplitudes[0::2], amplitudes[1::2])[order]
    close = np.diff(frequencies[order]) < MIN_CYCLES * 2.0 * np.pi / len(waves)
    weaker = np.minimum(sizes[1:], sizes[:-1])[close]
    return float(weaker.max()) if len(weaker) > 1 else 0.0


def _waves(index: Floats, frequencies: Floats) -> Floats:
    """Columns cos(w i), sin(w i), pair by pair, for an ``index`` that rises by one."""
    return turns(index, frequencies).view(np.float64)


def turns(index: Floats, frequencies: Floats) -> NDArray[np.complex128]:
    """Columns exp(i w index), one for each frequency w, for an ``index`` that rises by one. Each is a product of two
    rotations: by a whole number of strides and by the remainder. So few cosines and sines need to be computed."""
    stride = math.isqrt(len(index)) + 1
    found = np.exp(1j * np.multiply.outer(index[::stride], frequencies))[:, None] * np.exp(
        1j * np.multiply.outer(np.arange(stride), frequencies)
    )
    return np.ascontiguousarray(found.reshape(-1, len(frequencies))[: len(index)])

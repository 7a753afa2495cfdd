"""Sine waves in an evenly spaced series."""

import math
from dataclasses import dataclass
from functools import lru_cache
from threading import get_ident
from typing import Any

import numpy as np
from numpy.typing import NDArray

from kickdrift.model.state import Floats

MAX_LINES = 40
MIN_CYCLES = 3.0  # a slower wave cannot be distinguished from a trend
LINE_SIGNIFICANCE = 1e-4
BLOCK = 64  # numbers; series of about one length share a workspace
BESIDE = 1e-3  # power of a peak beside the highest that may be a side lobe


@dataclass
class Waves:
    """A straight line and sine waves, fitted to an evenly spaced series of n numbers by least squares.

    ``frequencies`` (L,) are radians per sample. ``constant``, ``slope``, and the amplitudes ``cosines`` and ``sines``
    (L,) belong to the places -(n - 1) / 2 … (n - 1) / 2. ``rest`` (n,) are the residuals, and ``variance`` that of the
    slope for residuals of variance 1.
    """

    frequencies: Floats
    constant: float
    slope: float
    cosines: Floats
    sines: Floats
    rest: Floats
    variance: float

    def __len__(self) -> int:
        return len(self.frequencies)


class Fits:
    """Fits of Waves to a series ``y`` (n,)."""

    def __init__(self, y: Floats) -> None:
        self._y = np.ascontiguousarray(y)
        self._places = np.arange(len(y)) - 0.5 * (len(y) - 1)

    @property
    def _room(self) -> Any:
        return _room(-(-len(self._y) // BLOCK), get_ident())

    def line(self) -> Waves:
        """Fit of the straight line alone."""
        squares = float(self._places @ self._places)
        constant, slope = float(self._y.mean()), float(self._places @ self._y) / squares
        rest = self._y - constant - slope * self._places
        none = np.empty(0)
        return Waves(none, constant, slope, none, none, rest, 1.0 / squares)

    def waves(self, frequencies: Floats, steps: int = 0) -> Waves:
        """Fit with waves of these frequencies, after so many Gauss-Newton steps of the frequencies."""
        from kickdrift.statistics.wave_kernel import fit_waves  # compiled only for a series with waves

        own, found, rest = frequencies.copy(), np.empty(2 + 2 * len(frequencies)), np.empty(len(self._y))
        variance = fit_waves(self._y, own, steps, found, rest, self._room)
        return Waves(own, float(found[0]), float(found[1]), found[2::2], found[3::2], rest, variance)

    def less(self, frequencies: Floats, cosines: Floats, sines: Floats, slope: float) -> Floats:
        """The series less a line through 0 in the middle and less waves, with these frequencies and amplitudes."""
        from kickdrift.statistics.wave_kernel import take_off_waves

        coefficients, rest = np.zeros(2 + 2 * len(frequencies)), np.empty(len(self._y))
        coefficients[1], coefficients[2::2], coefficients[3::2] = slope, cosines, sines
        take_off_waves(self._y, frequencies, coefficients, rest, self._room)
        return rest


@lru_cache(maxsize=4)
def _room(blocks: int, thread: int) -> Any:
    """Workspace of one thread for series of up to so many blocks of ``BLOCK`` numbers."""
    from kickdrift.statistics.wave_sums import room_for

    return room_for(BLOCK * blocks, MAX_LINES)


def spectral_lines(y: Floats, floor: float) -> tuple[Waves, bool]:
    """Straight line and significant spectral lines of ``y``, and whether a slow wave remains.

    Each pass whitens a red residual to first order, so that its slow end is no line. Then it tapers the residual, so
    that a slow wave does not leak into one. Then all frequencies move together by Gauss-Newton. Waves of under
    ``MIN_CYCLES`` cycles stay in the series, because trend and wave would share its change arbitrarily. ``floor`` is
    the level of rounding.
    """
    from kickdrift.statistics.wave_kernel import prewhiten

    n = len(y)
    most = min(MAX_LINES, n // 20)
    fits, white = Fits(y), np.empty(n - 1)
    waves = fits.line()
    bins = (n - 1) / (2.0 * np.pi)
    for _ in range(MAX_LINES):
        if prewhiten(waves.rest, _taper(n - 1), white) <= floor:
            break
        peaks, slow = _peaks(white, waves.frequencies * bins, most)
        if not len(peaks):
            return waves, slow
        waves = fits.waves(np.concatenate((waves.frequencies, peaks / bins)), 4)
        signs = np.abs(waves.frequencies - np.pi) < 1.0 / n
        if signs.any():  # towards alternating signs, a double root, Gauss-Newton only halves the distance
            there = fits.waves(np.where(signs, np.pi, waves.frequencies))
            waves = there if there.rest @ there.rest < waves.rest @ waves.rest else waves
    return waves, False


def _peaks(white: Floats, known: Floats, most: int) -> tuple[NDArray[np.int64], bool]:
    """Places of new lines in the spectrum of a tapered series, and whether there is a slow wave. ``known`` are the
    places of the known lines, and ``most`` is the largest number of lines."""
    if most <= len(known):
        return np.empty(0, np.int64), False
    spectrum = np.fft.rfft(white)
    if not len(known):
        power = (spectrum.real**2 + spectrum.imag**2)[1:]
        m = int(np.count_nonzero(power))
        if m * (1.0 - power.max() / power.sum()) ** (m - 1) > LINE_SIGNIFICANCE:
            return np.empty(0, np.int64), False
    from kickdrift.statistics.wave_kernel import separate_peaks  # compiled only for a series with waves

    found = np.empty(most - len(known), np.int64)
    count, slow = separate_peaks(spectrum, known.astype(int), MIN_CYCLES, BESIDE, LINE_SIGNIFICANCE, found)
    return found[:count], bool(slow)


@lru_cache(maxsize=8)
def _taper(n: int) -> Floats:
    return np.hanning(n)


def folded(waves: Waves) -> float:
    """Largest amplitude of a wave that sampling may have folded to the frequency zero.

    If the samples are almost in step with a wave, its harmonics fold to pairs of close lines. One harmonic then folds
    to a wave too slow to be distinguished from a trend. It is no larger than the weaker line of the closest harmonics.
    Two pairs closer than ``MIN_CYCLES`` cycles count as a fold; without them the result is 0.
    """
    frequencies = np.abs((waves.frequencies + np.pi) % (2.0 * np.pi) - np.pi)
    order = np.argsort(frequencies)
    sizes = np.hypot(waves.cosines, waves.sines)[order]
    close = np.diff(frequencies[order]) < MIN_CYCLES * 2.0 * np.pi / len(waves.rest)
    weaker = np.minimum(sizes[1:], sizes[:-1])[close]
    return float(weaker.max()) if len(weaker) > 1 else 0.0


def turns(index: Floats, frequencies: Floats) -> NDArray[np.complex128]:
    """Columns exp(i w index), one for each frequency w, for an ``index`` that rises by one. Each is a product of two
    rotations: by a whole number of strides and by the remainder. So few cosines and sines need to be computed."""
    stride = math.isqrt(len(index)) + 1
    found = np.exp(1j * np.multiply.outer(index[::stride], frequencies))[:, None] * np.exp(
        1j * np.multiply.outer(np.arange(stride), frequencies)
    )
    return np.ascontiguousarray(found.reshape(-1, len(frequencies))[: len(index)])

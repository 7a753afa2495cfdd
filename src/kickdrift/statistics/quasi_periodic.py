"""Frequencies of quasi-periodic series: the modified Fourier transform of Laskar, and its corrections.

A windowed Fourier transform of a series z has a maximum near each of its lines a exp(i (w t + p)). The lines are found
one by one. Each line is orthogonal to those before under the window, so that the amplitudes are those of a least
squares fit of all lines (Laskar 1988, A&A 198, 341; Laskar 1993, doi:10.1016/0167-2789(93)90210-R). Every line shifts
the maxima of its neighbours. The corrections apply the same analysis to the sum of the lines that were found, whose
lines are known, and subtract what the analysis got wrong there (Sidlichovsky & Nesvorny 1997, doi:10.1007/BF00048443).
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from kickdrift.errors import InputError
from kickdrift.model.checks.values import numbers, whole_number
from kickdrift.model.state import Floats
from kickdrift.statistics.spectral_lines import turns
from kickdrift.text import shown, suggestion

Complex = NDArray[np.complex128]

WINDOWS = {"box": 0, "hann": 1, "hann2": 2, "hann3": 3}  # power p of (1 + cos)^p
LEAST = 16  # samples
UNEVEN = 1e-6  # largest departure from even spacing, in spacings
PADDED = 4  # points of the spectrum for each resolution element
NEWTON, CONVERGED = 20, 1e-13  # most steps to a maximum, and the last one in resolution elements
CORRECTIONS = 8
SAME = 1e-12  # a smaller singular value, relative, is that of two lines that coincide
NOISE = 1e-15  # a line below this part of the first is rounding


class Spectrum(NamedTuple):
    """Lines of a series, sum of amplitudes * exp(i (frequencies * t + phases)): three arrays (m,).

    The strongest line comes first. Frequencies are in radians per unit of time, and may be negative. Phases in
    (-pi, pi] are those at t = 0.
    """

    frequencies: Floats
    amplitudes: Floats
    phases: Floats

    @property
    def periods(self) -> Floats:
        """2 pi / frequencies: negative for a line that turns clockwise, infinite for a constant."""
        with np.errstate(divide="ignore"):
            return np.asarray(2.0 * math.pi / self.frequencies)


def frequencies(
    series: ArrayLike, times: ArrayLike, count: int = 10, window: str = "hann", corrections: int = CORRECTIONS
) -> Spectrum:
    """Frequencies, amplitudes and phases of a quasi-periodic series, strongest first.

    A resolution element is 2 pi over the length of the series. Lines without noise that are three elements apart or
    more come out to 1e-9 of an element. The plain transform, ``corrections=0``, errs by up to 1e-3 of an element there.

    Parameters
    ----------
    series : (n,) complex or real values, such as e exp(i varpi) of an orbit
        A real wave has two lines, w and -w, each with half its amplitude.
    times : (n,) evenly spaced
    count : most lines. Fewer come back if the rest is rounding. After the true lines come faint lines near them, which
        are errors of the transform
    window : "box", "hann", "hann2" or "hann3", (1 + cos)^p of power p = 0 to 3. A higher power suppresses far lines and
        needs more distance between near ones
    corrections : 0 is the modified Fourier transform, 1 adds the linear correction of Sidlichovsky & Nesvorny, and
        more repeat the correction, which converges for lines that are resolved

    Raises
    ------
    InputError
        For values that are not finite, for times that are not evenly spaced, and for fewer than 16 samples.
    """
    z, t, step = _checked(series, times)
    power = WINDOWS.get(window)
    if power is None:
        raise InputError(
            f"window: expected one of {', '.join(WINDOWS)}, got {shown(window)}{suggestion(window, WINDOWS)}"
        )
    count, corrections = whole_number("count", count, 1), whole_number("corrections", corrections, 0)
    analysis = _Analysis(len(z), power)
    w, c = found = analysis.lines(z, count)
    last = math.inf
    for _ in range(corrections if len(w) else 0):
        again = analysis.lines(analysis.basis(w) @ c, count, w)
        moved = found[0] - again[0]
        size = float(np.abs(moved).max())
        if not size < last:  # lines too near one another to be corrected
            break
        w, c, last = w + moved, c + found[1] - again[1], size
        if size < CONVERGED * analysis.element:
            break
    order = np.argsort(-np.abs(c), kind="stable")
    w, c = w[order], c[order]
    middle = 0.5 * (t[0] + t[-1])
    phases = np.angle(c * np.exp(-1j * (w / step * middle)))
    return Spectrum(w / step, np.abs(c), phases)


def _checked(series: ArrayLike, times: ArrayLike) -> tuple[Complex, Floats, float]:
    """The series, its times and their spacing."""
    try:
        z = np.asarray(series, dtype=complex)
    except (TypeError, ValueError):
        raise InputError("series: expected numbers") from None
    t = numbers("times", times)
    if z.ndim != 1 or t.shape != z.shape:
        raise InputError(f"series and times: expected two arrays of one length, got shapes {z.shape} and {t.shape}")
    if len(z) < LEAST:
        raise InputError(f"series: {len(z)} samples are too few for frequencies; {LEAST} or more are needed")
    for key, values in (("series", z), ("times", t)):
        if not np.isfinite(values).all():
            raise InputError(f"{key}: sample {int(np.flatnonzero(~np.isfinite(values))[0])} is not finite")
    step = float(t[-1] - t[0]) / (len(t) - 1)
    if not step > 0.0:
        raise InputError("times: expected times that increase")
    off = np.abs(t - (t[0] + step * np.arange(len(t)))) / step
    if off.max() > UNEVEN:
        raise InputError(
            f"times: not evenly spaced; the largest departure, at sample {off.argmax()}, is {off.max():.1g} "
            "of the spacing"
        )
    return z, t, step


class _Analysis:
    """Fourier analysis of series of one length under one window. Frequencies are in radians per sample, and time zero
    is the middle of the series."""

    def __init__(self, n: int, power: int) -> None:
        self.index: Floats = np.arange(n, dtype=np.float64) - 0.5 * (n - 1)
        self.element = 2.0 * math.pi / n
        self.window = (1.0 + np.cos(self.element * self.index)) ** power
        self.window /= self.window.sum()
        self.shares = [math.comb(2 * power, k) / math.comb(2 * power, power) for k in range(2 * power + 1)]

    def basis(self, w: ArrayLike) -> Complex:
        """Samples (n, m) of lines of size 1."""
        return turns(self.index, np.array(w, dtype=np.float64, ndmin=1))

    def lines(self, z: Complex, count: int, near: Floats | None = None) -> tuple[Floats, Complex]:
        """Frequencies and complex amplitudes of the strongest lines; or of the lines near given frequencies."""
        w, c, columns, first = np.empty(0), np.empty(0, dtype=complex), np.empty((len(z), 0), dtype=complex), 0.0
        sizes: list[complex] = []
        rest = z
        for k in range(count if near is None else len(near)):
            weighted = self.window * rest
            start = self._highest(weighted, w) if near is None else float(near[k])
            if start is None:
                break
            found = self._maximum(weighted, start)
            column = self.basis(found)
            sizes.append(complex((self.window * z) @ column[:, 0].conj()))
            w, columns = np.append(w, found), np.hstack([columns, column])
            c = self._fitted(w, sizes)
            if near is None and abs(c[-1]) <= NOISE * first:
                return w[:-1], self._fitted(w[:-1], sizes[:-1])
            first = max(first, abs(c[-1]))
            rest = z - columns @ c
        return w, c

    def _fitted(self, w: Floats, sizes: list[complex]) -> Complex:
        """Amplitudes of lines whose products with the series are ``sizes``; lines that coincide share theirs."""
        return np.asarray(np.linalg.lstsq(self._products(w), np.array(sizes), rcond=SAME)[0], dtype=complex)

    def _products(self, w: Floats) -> Floats:
        """Products of lines under the window, in closed form."""
        distance = w[None, :] - w[:, None]
        n, power = len(self.index), len(self.shares) // 2
        total = np.zeros_like(distance)
        for k, share in enumerate(self.shares, -power):
            half = 0.5 * (distance + k * self.element)
            near = np.abs(np.sin(half)) < 1e-12
            total += share * np.where(near, 1.0, np.sin(n * half) / (n * np.where(near, 1.0, np.sin(half))))
        return total

    def _highest(self, weighted: Complex, known: Floats) -> float | None:
        """Frequency of the highest point of a spectrum, a resolution element or more from known lines."""
        size = PADDED << (len(weighted) - 1).bit_length()
        spectrum = np.abs(np.fft.fft(weighted, size))
        at = 2.0 * math.pi * np.fft.fftfreq(size)
        for line in known:
            spectrum[np.abs((at - line + math.pi) % (2.0 * math.pi) - math.pi) < self.element] = 0.0
        peak = int(spectrum.argmax())
        return float(at[peak]) if spectrum[peak] > 0.0 else None

    def _maximum(self, weighted: Complex, start: float) -> float:
        """Frequency of the maximum of |spectrum|^2 by Newton's method, within a resolution element of ``start``."""
        w, moments = start, weighted[:, None] * np.column_stack([np.ones_like(self.index), self.index, self.index**2])
        for _ in range(NEWTON):
            p0, p1, p2 = self.basis(w)[:, 0].conj() @ moments
            slope = 2.0 * (p0.conjugate() * (-1j * p1)).real
            curvature = 2.0 * (abs(p1) ** 2 - (p0.conjugate() * p2).real)
            if not curvature < 0.0:
                break
            move = max(-0.5 * self.element, min(0.5 * self.element, -slope / curvature))
            w = max(start - self.element, min(start + self.element, w + move))
            if abs(move) < CONVERGED * self.element:
                break
        return w

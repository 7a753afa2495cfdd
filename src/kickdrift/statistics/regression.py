"""Least squares, and regression with autoregressive noise."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import lru_cache
from threading import get_ident
from typing import Any, NamedTuple

import numpy as np

from kickdrift.model.state import Floats
from kickdrift.statistics.spectral_lines import Fits, Waves

EPSILON = float(np.finfo(np.float64).eps)


@dataclass(frozen=True)
class Fit:
    """One coefficient of a regression with autoregressive noise."""

    value: float
    deviation: float
    freedom: float
    unit_root_t: float
    inefficiency: float  # spectral density at zero frequency over variance: samples per independent sample


def trend_regression(y: Floats, waves: Waves) -> Fit:
    """Generalised least squares of ``y`` by a straight line and waves with autoregressive noise, for the slope.

    ``waves`` are the fit by ordinary least squares. The model of the noise is du(i) = constant + trend + g u(i-1) + sum
    d(j) du(i-j) for its residuals u. g = 0 is a unit root.
    """
    places = np.asarray(np.arange(len(y)) - 0.5 * (len(y) - 1), np.float64)
    noise = autoregression(waves.rest, y, 2)
    white = noise.white
    # A whitened line is a line, and a whitened wave a wave: their slopes and amplitudes times A, the sum of the
    # whitener's numbers, each turned by its wave.
    found = Fits(white).waves(waves.frequencies) if len(waves) else Fits(white).line()
    left = len(white) - 2 - 2 * len(waves) - noise.lags - 1
    slope = found.slope / noise.sum
    change = slope - waves.slope
    if len(waves):
        last = len(noise.whitener) - 1
        powers = np.tile(np.exp(-1j * waves.frequencies)[:, None], last).cumprod(axis=1)
        over = (noise.whitener[0] + powers @ noise.whitener[1:]) * np.exp(0.5j * last * waves.frequencies)
        apart = (found.cosines - 1j * found.sines) / over
        cosines, sines = apart.real - waves.cosines, -apart.imag - waves.sines
        rest = Fits(waves.rest).less(waves.frequencies, cosines, sines, change)
    else:
        rest = waves.rest - change * places
    return noise.fit(slope, found.rest, found.variance, left, float(np.var(rest)))


def mean_regression(y: Floats) -> Fit:
    """The same for the mean, of a series ``y`` without trend and waves."""
    noise = autoregression(y - y.mean(), y, 1)
    white = noise.white
    left = len(white) - 1 - noise.lags - 1
    return noise.fit(white.mean() / noise.sum, white - white.mean(), 1.0 / len(white), left, float(np.var(y)))


class Noise(NamedTuple):
    """Autoregression of a series.

    ``whitener`` are the weights of a number and those before it, and ``sum`` is their sum. ``white`` is the whitened
    series, and ``unit_root_t`` the Dickey-Fuller t.
    """

    lags: int
    whitener: Floats
    white: Floats
    sum: float
    unit_root_t: float

    def fit(self, value: float, rest: Floats, variance: float, left: int, around: float) -> Fit:
        """Fit of a ``value`` from the whitened series' residuals, with so many degrees of freedom left. ``variance`` is
        that of the whitened value for residuals of variance 1, and ``around`` that of the series about the fit."""
        squares = max(float(rest @ rest) / left, EPSILON**2 * around)  # no noise is below the rounding of the numbers
        # log S(0) = log variance - 2 log |A|: relative variances 2 / left and 4 / t^2, matched to chi^2's 2 / freedom.
        freedom = 1.0 / (1.0 / left + 2.0 / self.unit_root_t**2)
        deviation = math.sqrt(squares * variance) / abs(self.sum)
        return Fit(float(value), deviation, freedom, self.unit_root_t, squares / self.sum**2 / around)


def autoregression(rest: Floats, y: Floats, before: int) -> Noise:
    """Autoregression of the residuals ``rest`` (n,) of a series ``y`` (n,), with a constant, and with a trend for
    ``before`` = 2."""
    from kickdrift.statistics.noise_kernel import INVERSE, NOTHING, PROJECTIONS, autoregress, whiten

    n = len(rest)
    # Schwert 1989 (10.1080/07350015.1989.10509723), fewer for a short series.
    longest = min(int(12.0 * (n / 100.0) ** 0.25), n // 12)
    room = _room(n, longest, get_ident())
    missing = autoregress(rest, before, longest, NOTHING, room)
    if missing == PROJECTIONS:
        rows = room.regressors(longest, n - 1)
        orthogonal: Floats = np.linalg.qr(rows.T, mode="r")  # type: ignore[assignment]
        room.projections[: len(rows) - 1] = orthogonal[:-1, -1]
        missing = autoregress(rest, before, longest, PROJECTIONS, room)
    count, lags = room.counts.tolist()
    if missing == INVERSE:
        norms = room.norms[:count]
        room.triangle[:count, :count] = inverse_of(room.products[:count, :count] / np.outer(norms, norms))
        autoregress(rest, before, longest, INVERSE, room)
    root, deviation = float(room.solution[before]), float(room.deviations[before])
    unit_root_t = root / deviation if deviation else -math.inf  # noise that the numbers before determine

    # Near g = 0 the estimate of g is too negative by (2k + 2) / n for k deterministic columns. With var g = -2 g / n
    # this is a fraction (k + 1) / t^2 of g. In this form it vanishes where the root is well known, at any order.
    root *= max(1.0 - (before + 1.0) / unit_root_t**2, 0.1)
    whitener = np.zeros(lags + 2)
    whitener[0] = 1.0
    whitener[1:-1] = -room.solution[before + 1 : count]
    whitener[1:] -= whitener[:-1].copy()
    whitener[1] -= root
    white = np.empty(n - lags - 1)
    whiten(y, whitener, white)
    return Noise(lags, whitener, white, -root, unit_root_t)


@lru_cache(maxsize=4)
def _room(n: int, longest: int, thread: int) -> Any:
    """Workspace of one thread for series of n numbers."""
    from kickdrift.statistics.noise_kernel import room_for

    return room_for(n, longest)


def inverse_of(gram: Floats) -> Floats:
    """Inverse of a symmetric matrix without negative eigenvalues. Eigenvalues hidden by rounding contribute nothing."""
    try:
        inverse = np.asarray(np.linalg.inv(gram), np.float64)
    except np.linalg.LinAlgError:
        inverse = np.full_like(gram, np.inf)
    if np.abs(gram).sum(axis=0).max() * np.abs(inverse).sum(axis=0).max() < 1e10:  # seven times as fast as below
        return inverse
    values, vectors = np.linalg.eigh(gram)
    return np.asarray((vectors / np.where(values > 1e-12 * values[-1], values, np.inf)) @ vectors.T)

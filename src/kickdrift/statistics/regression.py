"""Least squares with autoregressive noise, and trends that noise, waves and random walks cannot explain.

The tests of trends need no straight line and no fitted wave.
"""

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
        from kickdrift.statistics.noise_kernel import undo_whitening

        cosines, sines = found.cosines.copy(), found.sines.copy()
        undo_whitening(waves.frequencies, noise.whitener, cosines, sines)
        rest = Fits(waves.rest).less(waves.frequencies, cosines - waves.cosines, sines - waves.sines, change)
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


BLOCKS = 16  # blocks whose means show a one-way motion
ONE_WAY = 0.95  # least net motion, from first to last block, over the total motion of the block means
LEAST_WAY = 0.6  # least net motion over the range
SPREAD = 2.2  # least number of blocks that share the motion: a single jump is no trend
BENT = 8.0  # times the faster cosines; reached by one white-noise series in ten thousand
COSINES = 16  # number of cosines: the slow end of the spectrum
OUTSIDE = 0.05  # probability outside the half-width
PRIOR_WHITE = 0.8  # prior probability of noise without a walk
WALKS = np.concatenate(([0.0], np.geomspace(0.3, 3e4, 20)))  # ratio of walk to noise at the first cosine


class Trend(NamedTuple):
    """Change over the whole series, its standard error or half-width, and the two-sided probability without a trend."""

    change: float
    half_width: float
    p_value: float
    walk: float = 1.0  # probability of a walk beside the noise


def goes_one_way(y: Floats) -> bool:
    """Tell whether the means of sixteen blocks only rise, or only fall.

    A few small steps back are allowed if several blocks share the motion. One random walk in a thousand passes. A wave
    passes if the series holds less than about half a cycle.
    """
    n = len(y) // BLOCKS
    steps = np.diff(y[len(y) - n * BLOCKS :].reshape(BLOCKS, n).mean(axis=1))
    total, length = abs(float(steps.sum())), float(np.abs(steps).sum())
    if length == 0.0:
        return False
    shared = length**2 / float(steps @ steps)
    return total >= max(ONE_WAY * length, LEAST_WAY * float(np.ptp(y))) and shared >= SPREAD


def is_bent(y: Floats) -> bool:
    """Tell whether the slowest cosines, without the line, are far above the faster ones."""
    weights, line = cosines(y, min(COSINES, len(y) // 3))
    weights -= line * (weights @ line) / (line @ line)
    half = len(weights) // 2
    return float(np.abs(weights[1:3]).max()) > BENT * float(np.sqrt(np.mean(weights[half:] ** 2)))


def cosines(y: Floats, count: int) -> tuple[Floats, Floats]:
    """Weights of the first ``count`` cosines (type II) in ``y``, and in a line that rises by 1 over the series.

    The cosines are the eigenfunctions of a random walk less its mean, with variances 1 / (pi j)^2. In their weights
    noise and walk are independent (Mueller & Watson 2008, doi:10.1111/j.1468-0262.2008.00884.x).
    """
    basis, line = _basis(len(y), count)
    return basis @ y, line.copy()


@lru_cache(maxsize=4)
def _basis(n: int, count: int) -> tuple[Floats, Floats]:
    """The cosines (count, n), and their weights in the line."""
    angles = np.pi * (np.arange(n) + 0.5) / n
    basis = np.cos(np.multiply.outer(np.arange(1, count + 1), angles)) * np.sqrt(2.0) / n
    return basis, basis @ ((np.arange(n) + 0.5) / n)


def walk_trend(y: Floats) -> Trend:
    """Mean increment of ``y`` with an error from the spread of its slow increments: Student's t over 16 cosines.

    Faster waves, noise and a bend only widen the interval.
    """
    weights, line = cosines(y, min(COSINES, len(y) // 3))
    scale, freedom = np.arange(1, len(weights) + 1), len(weights) - 1
    change, squares, strength = _fitted(weights * scale, line * scale, 1.0)
    deviation = math.sqrt(squares / freedom / strength)
    p_value = 2.0 * student(freedom, -abs(float(change)) / deviation)
    return Trend(float(change), deviation * quantile(freedom), p_value)


def mixed_trend(y: Floats, significance: float) -> Trend:
    """Trend of ``y`` under noise and a walk together, in proportions inferred from the slow end of the spectrum.

    The restricted likelihood weights each proportion. The half-width is nan for a trend whose p-value is below
    ``significance``.
    """
    from scipy.special import stdtr

    weights, line = cosines(y, min(COSINES, len(y) // 3))
    freedom = len(weights) - 1
    spectra, volumes, prior = _mixtures(len(weights))
    change, squares, strength = _fitted(weights, line, spectra)
    log_likelihood = -0.5 * (freedom * np.log(squares) + volumes + np.log(strength))
    share = prior * np.exp(log_likelihood - log_likelihood.max())
    share /= share.sum()
    deviation = np.sqrt(squares / freedom / strength)
    centre = float(share @ change)

    def outside(half_width: float) -> tuple[float, float]:
        """Probability that the change is further from the centre than the half-width, and its derivative."""
        up, down = (centre + half_width - change) / deviation, (centre - half_width - change) / deviation
        density = (1.0 + up * up / freedom) ** power + (1.0 + down * down / freedom) ** power
        return float(share @ (stdtr(freedom, -up) + stdtr(freedom, down))), -peak * float(share @ (density / deviation))

    p_value = float(share @ (2.0 * stdtr(freedom, -np.abs(change) / deviation)))
    if p_value < significance:
        return Trend(centre, math.nan, p_value, float(1.0 - share[0]))
    usual, power = quantile(freedom), -0.5 * (freedom + 1)
    low, high = 0.0, float(np.max(np.abs(change - centre) + deviation * usual))
    peak = math.gamma(-power) / math.gamma(0.5 * freedom) / math.sqrt(math.pi * freedom)
    half_width = min(high, usual * math.sqrt(float(share @ deviation**2)))
    for _ in range(60):  # Newton's method; bisection where Newton's leaves the bracket
        probability, slope = outside(half_width)
        low, high = (half_width, high) if probability > OUTSIDE else (low, half_width)
        before, half_width = half_width, half_width - (probability - OUTSIDE) / slope
        if not low <= half_width <= high:
            half_width = 0.5 * (low + high)
        if abs(half_width - before) <= 1e-13 * before:
            break
    return Trend(centre, half_width, p_value, float(1.0 - share[0]))


def _fitted(weights: Floats, line: Floats, spectra: Floats | float) -> tuple[Floats, Floats, Floats]:
    """Change by least squares weighted with each of the ``spectra`` (…, q), weighted sum of squares of the residuals,
    and one over the change's variance where they are 1."""
    strength = (line**2 / spectra).sum(axis=-1)
    change = (line * weights / spectra).sum(axis=-1) / strength
    squares = ((weights - change[..., None] * line) ** 2 / spectra).sum(axis=-1)
    return change, np.maximum(squares, 1e-300), strength


@lru_cache(maxsize=4)
def _mixtures(count: int) -> tuple[Floats, Floats, Floats]:
    """Spectra (k, count) of noise and walk in each of their proportions, the logarithms of the spectra's products, and
    the proportions' prior probabilities."""
    spectra = 1.0 + np.multiply.outer(WALKS, 1.0 / np.arange(1, count + 1) ** 2)
    prior = np.full(len(WALKS), (1.0 - PRIOR_WHITE) / (len(WALKS) - 1))
    prior[0] = PRIOR_WHITE
    return spectra, np.log(spectra).sum(axis=1), prior


def student(freedom: float, t: float) -> float:
    """Probability that Student's t with so many degrees of freedom is below ``t``."""
    from scipy.special import stdtr  # scipy.stats takes a second to import

    return float(stdtr(freedom, t))


@lru_cache(maxsize=64)
def quantile(freedom: float, inside: float = 1.0 - OUTSIDE) -> float:
    """Half-width that holds so much of Student's t."""
    from scipy.special import stdtrit

    return float(stdtrit(freedom, 0.5 + 0.5 * inside))

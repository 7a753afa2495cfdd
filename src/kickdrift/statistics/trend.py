"""Trends that noise, waves and random walks cannot explain. The tests need no straight line and no fitted wave."""

from __future__ import annotations

import math
from functools import lru_cache
from typing import NamedTuple

import numpy as np

from kickdrift.model.state import Floats

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

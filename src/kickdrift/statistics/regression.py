"""Least squares, and regression with autoregressive noise."""

from __future__ import annotations

import math
from contextlib import suppress
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.lib.stride_tricks import as_strided

from kickdrift.model.state import Floats
from kickdrift.statistics.spectral_lines import Fits, Waves

INDEPENDENT = 1e-3  # sine of the angle between a row and those before, from which sums of products are exact enough


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
    noise = autoregression(waves.rest, np.stack((np.ones(len(y)), places)))
    white = np.convolve(y, noise.whitener, "valid")
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
    noise = autoregression(y - y.mean(), np.ones((1, len(y))))
    white = np.convolve(y, noise.whitener, "valid")
    left = len(white) - 1 - noise.lags - 1
    return noise.fit(white.mean() / noise.sum, white - white.mean(), 1.0 / len(white), left, float(np.var(y)))


class Noise(NamedTuple):
    """Autoregression of a series.

    ``whitener`` are the weights of a number and those before it, ``sum`` is their sum, and ``unit_root_t`` the
    Dickey-Fuller t.
    """

    lags: int
    whitener: Floats
    sum: float
    unit_root_t: float

    def fit(self, value: float, rest: Floats, variance: float, left: int, around: float) -> Fit:
        """Fit of a ``value`` from the whitened series' residuals, with so many degrees of freedom left. ``variance`` is
        that of the whitened value for residuals of variance 1, and ``around`` that of the series about the fit."""
        squares = float(rest @ rest) / left
        # log S(0) = log variance - 2 log |A|: relative variances 2 / left and 4 / t^2, matched to chi^2's 2 / freedom.
        freedom = 1.0 / (1.0 / left + 2.0 / self.unit_root_t**2)
        deviation = math.sqrt(squares * variance) / abs(self.sum)
        return Fit(float(value), deviation, freedom, self.unit_root_t, squares / self.sum**2 / around)


def autoregression(rest: Floats, deterministic: Floats) -> Noise:
    """Autoregression of the residuals ``rest`` (n,), with the rows of ``deterministic`` (1 or 2, n)."""
    before, n = deterministic.shape
    # Schwert 1989 (10.1080/07350015.1989.10509723), fewer for a short series.
    longest = min(int(12.0 * (n / 100.0) ** 0.25), n // 12)
    steps = np.diff(rest)
    padded = np.concatenate((np.zeros(longest), steps))
    # Row j of ``delayed`` are the steps j samples before.
    delayed = as_strided(padded[longest:], (longest + 1, n - 1), (-padded.itemsize, padded.itemsize))
    # Regressors as rows: deterministic ones, the residual, and the earlier steps; then the steps that they explain.
    rows = np.concatenate((deterministic[:, 1:], rest[None, :-1], delayed[1:], delayed[:1]))
    products = rows[:, longest:] @ rows[:, longest:].T

    # Columns are nested, so one orthogonalisation gives the residual of every order.
    projections = along_each(rows[:, longest:], products) ** 2
    squares = (products[-1, -1] - np.cumsum(projections)[before:]) / products[-1, -1]
    count = n - 1 - longest
    criterion = count * np.log(np.maximum(squares, 1e-30)) + np.log(count) * np.arange(longest + 1)
    lags = int(np.argmin(criterion))

    chosen = before + 1 + lags  # fewer steps before, and so more samples
    own = [*range(chosen), -1]
    more = rows[own, lags:longest]
    products = products[np.ix_(own, own)] + more @ more.T
    solution, deviations = least_squares(rows[:chosen, lags:], rows[-1, lags:], products)
    root, differences = solution[before], solution[before + 1 :]
    unit_root_t = float(root / deviations[before])

    # Near g = 0 the estimate of g is too negative by (2k + 2) / n for k deterministic columns. With var g = -2 g / n
    # this is a fraction (k + 1) / t^2 of g. In this form it vanishes where the root is well known, at any order.
    root *= max(1.0 - (before + 1.0) / unit_root_t**2, 0.1)
    whitener = np.convolve([1.0, -1.0], np.concatenate(([1.0], -differences)))
    whitener[1] -= root
    return Noise(lags, whitener, -float(root), unit_root_t)


def along_each(rows: Floats, products: Floats) -> Floats:
    """Projections of the last row on each row without the rows before, of either sign. ``products`` are those of the
    rows with each other."""
    norms = np.sqrt(np.diag(products))
    norms[norms == 0.0] = 1.0
    with suppress(np.linalg.LinAlgError):  # products of rows that are nearly dependent
        triangle = np.linalg.cholesky(products / np.outer(norms, norms))
        if np.diag(triangle).min() > INDEPENDENT:
            return np.asarray(triangle[-1, :-1] * norms[-1])
    orthogonal: Floats = np.linalg.qr(rows.T, mode="r")  # type: ignore[assignment]
    return orthogonal[:-1, -1]


def least_squares(rows: Floats, right: Floats, products: Floats) -> tuple[Floats, Floats]:
    """Coefficients of the ``rows`` and their standard errors. ``products`` are those of rows and right side, which
    comes last."""
    norms = np.sqrt(np.diag(products)[:-1])
    norms[norms == 0.0] = 1.0
    inverse = inverse_of(products[:-1, :-1] / np.outer(norms, norms))
    solution = inverse @ (products[:-1, -1] / norms)
    rest = right - (solution / norms) @ rows
    solution += inverse @ (rows @ rest / norms)  # one refinement compensates for the squared condition number
    rest = right - (solution / norms) @ rows
    variance = rest @ rest / max(len(right) - len(norms), 1)
    return solution / norms, np.sqrt(variance * np.diag(inverse)) / norms


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

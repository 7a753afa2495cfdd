"""Autoregressions of residuals against least squares of the same rows by NumPy, and series without noise."""

import math

import numpy as np
import pytest

from kickdrift.statistics.drift import drift
from kickdrift.statistics.noise_kernel import DONE, INVERSE, NOTHING, PROJECTIONS, autoregress, room_for
from kickdrift.statistics.regression import autoregression, mean_regression, trend_regression
from kickdrift.statistics.spectral_lines import Fits


def longest_delay(n):
    """Schwert's number of delays."""
    return min(int(12.0 * (n / 100.0) ** 0.25), n // 12)


def regression(rest, before, delays, begin):
    """Columns of the regression, from the sample ``begin`` on, and the steps."""
    n = len(rest)
    at = np.arange(begin, n - 1)
    steps = np.diff(rest)
    columns = [np.ones(len(at)), at + 1 - 0.5 * (n - 1)][:before]
    columns.append(rest[at])
    columns += [steps[at - delay] for delay in range(1, delays + 1)]
    return np.column_stack(columns), steps[at]


def oracle(rest, before):
    """Delays, whitener and Dickey-Fuller t, each by `numpy.linalg.lstsq`."""
    longest = longest_delay(len(rest))
    criteria = []
    for delays in range(longest + 1):
        matrix, right = regression(rest, before, delays, longest)
        found = np.linalg.lstsq(matrix, right, rcond=None)[0]
        squares = float(np.sum((right - matrix @ found) ** 2) / np.sum(right**2))
        criteria.append(len(right) * math.log(squares) + math.log(len(right)) * delays)
    delays = int(np.argmin(criteria))
    matrix, right = regression(rest, before, delays, delays)
    found = np.linalg.lstsq(matrix, right, rcond=None)[0]
    variance = np.sum((right - matrix @ found) ** 2) / (len(right) - len(found))
    deviations = np.sqrt(variance * np.diag(np.linalg.inv(matrix.T @ matrix)))
    t = found[before] / deviations[before]
    root = found[before] * max(1.0 - (before + 1.0) / t**2, 0.1)
    whitener = np.convolve([1.0, -1.0], np.concatenate(([1.0], -found[before + 1 :])))
    whitener[1] -= root
    return delays, whitener, t


def series(kind, n):
    noise = np.random.default_rng(n).normal(size=n)
    return {
        "white": noise,
        "walk": np.cumsum(noise),
        "moving average": np.convolve(noise, [1.0, 0.9, 0.5, 0.2], "same"),
        "walk of a walk": np.cumsum(np.cumsum(noise)),
        "nearly a wave": np.sin(0.1 * np.arange(n)) + 1e-4 * noise,
    }[kind]


@pytest.mark.parametrize("n", [40, 61, 100, 333, 1001, 1024])
@pytest.mark.parametrize("before", [1, 2])
@pytest.mark.parametrize("kind", ["white", "walk", "moving average", "walk of a walk", "nearly a wave"])
def test_autoregression_equals_least_squares(kind, before, n):
    y = series(kind, n)
    rest = Fits(y).line().rest if before == 2 else y - y.mean()
    found = autoregression(rest, y, before)
    lags, whitener, t = oracle(rest, before)
    assert found.lags == lags
    assert found.whitener == pytest.approx(whitener, rel=1e-7, abs=1e-9)
    assert found.unit_root_t == pytest.approx(t, rel=1e-6)
    assert found.sum == pytest.approx(found.whitener.sum(), rel=1e-6, abs=1e-12)
    rounding = 1e-15 * np.abs(y).max() * np.abs(found.whitener).sum()
    assert found.white == pytest.approx(np.convolve(y, found.whitener, "valid"), rel=0, abs=4 * rounding)


def test_rows_that_rounding_hides_are_left_to_exact_methods():
    n = 333
    y = series("nearly a wave", n) - 1e-4 * (1 - 1e-4) * np.random.default_rng(n).normal(size=n)  # noise 1e-8
    longest = longest_delay(n)
    room = room_for(n, longest)
    assert autoregress(y, 1, longest, NOTHING, room) == PROJECTIONS
    matrix, right = regression(y, 1, longest, longest)
    room.projections[: longest + 2] = np.linalg.qr(np.column_stack([matrix, right]), mode="r")[:-1, -1]
    assert autoregress(y, 1, longest, PROJECTIONS, room) == INVERSE
    assert autoregress(y, 1, longest, INVERSE, room) == DONE
    assert autoregression(y, y, 1).lags == oracle(y, 1)[0] == room.counts[1]


@pytest.mark.parametrize("n", [40, 100, 1000])
@pytest.mark.parametrize("at", [0, 1, 15, 33, -2, -1])
def test_a_pulse_has_a_finite_fit(at, n):
    y = np.zeros(n)
    y[at] = 1.0
    for fit in (trend_regression(y, Fits(y).line()), mean_regression(y)):
        assert np.isfinite([fit.value, fit.deviation, fit.freedom]).all()
        assert min(fit.deviation, fit.freedom, fit.inefficiency) > 0
        assert abs(fit.value) < 5.0 * fit.deviation or at in (-1, -2)
    assert drift(np.arange(n), y).verdict in ("bounded", "not resolvable")


@pytest.mark.parametrize("factor", [-0.5, -0.9])
def test_a_series_that_its_past_determines_has_the_noise_of_rounding(factor):
    y = factor ** np.arange(200.0)
    fit = trend_regression(y, Fits(y).line())
    assert fit.unit_root_t < -1e6
    assert 0.0 < fit.deviation < 1e-15
    assert abs(fit.value) < 1e-15

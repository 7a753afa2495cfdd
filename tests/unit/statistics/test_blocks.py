"""Standard errors by block averages, for series with an error in closed form."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.signal import lfilter

from kickdrift.errors import InputError
from kickdrift.statistics.blocks import FEWEST, block_average, mean_over_frames


def autoregressive(phi: float, k: int, series: int = 500) -> np.ndarray:
    """Stationary series (k, series) of x(i) = phi x(i - 1) + white noise of unit variance."""
    noise = np.random.default_rng(7).normal(size=(k + 400, series))
    return lfilter([1.0], [1.0, -phi], noise, axis=0)[400:]


def true_error(phi: float, k: int) -> float:
    """Standard error of the mean of k values. Its square is the variance times 1 + 2 sum (1 - j / k) phi^j, over k."""
    j = np.arange(1, k)
    return float(np.sqrt((1 + 2 * np.sum((1 - j / k) * phi**j)) / (1 - phi**2) / k))


@pytest.mark.parametrize(("phi", "k"), [(0.0, 100), (0.0, 4000), (0.5, 200), (0.5, 4000), (0.9, 4000)])
def test_the_error_of_an_autoregressive_series_is_the_known_one(phi, k):
    found = block_average(autoregressive(phi, k))
    assert np.isfinite(found.error).all()
    assert np.sqrt(np.mean(found.error**2)) == pytest.approx(true_error(phi, k), rel=0.07)
    held = np.mean(np.abs(found.value) < 2 * found.error)
    assert 0.90 < held < 0.98  # 0.954 for a Gaussian; few blocks have Student's tails


def test_a_single_row_would_have_misjudged_it():
    x = autoregressive(0.9, 4000)
    naive = x.std(axis=0, ddof=1) / np.sqrt(len(x))
    assert np.sqrt(np.mean(naive**2)) < 0.3 * true_error(0.9, 4000)


def test_a_series_shorter_than_its_correlation_has_no_error():
    walk = np.cumsum(np.random.default_rng(3).normal(size=(200, 300)), axis=0)
    assert np.mean(np.isinf(block_average(walk).error)) > 0.85  # a few blocks agree by chance


def test_blocks_say_what_the_error_rests_on():
    white, red = (block_average(autoregressive(phi, 4000)).blocks for phi in (0.0, 0.9))
    assert red.min() >= FEWEST
    assert np.median(white) > 3 * np.median(red)


@pytest.mark.parametrize("k", [1, 2, 3])
def test_few_rows_have_a_mean_and_no_error(k):
    found = block_average(np.arange(k, dtype=float))
    assert (found.value, found.error, found.blocks) == ((k - 1) / 2, np.inf, 0)


def test_rows_that_do_not_vary_have_no_error():
    found = block_average(np.full((50, 2), 0.1))
    np.testing.assert_allclose(found.value, 0.1, rtol=1e-15)
    assert np.all(found.error < 1e-16)


@settings(max_examples=40, deadline=None)
@given(st.integers(1, 300), st.floats(-1e3, 1e3), st.floats(1e-3, 1e3), st.integers(0, 10**6))
def test_moves_and_scales_with_the_series(k, shift, scale, seed):
    x = np.random.default_rng(seed).normal(size=k)
    one, other = block_average(x), block_average(shift + scale * x)
    assert other.value == pytest.approx(shift + scale * one.value, rel=1e-9, abs=1e-9 * (scale + abs(shift)))
    assert other.error == pytest.approx(scale * one.error, rel=1e-6)
    assert one.blocks == other.blocks


@pytest.mark.parametrize("k", [5, 100, 2048, 5000])
def test_rows_that_come_one_by_one(k):
    x = autoregressive(0.5, k, series=3)
    found = mean_over_frames(k, iter(x), most_rows=100)
    width = -(-k // 100)
    kept = x[: k // width * width].reshape(-1, width, 3).mean(axis=1)
    np.testing.assert_allclose(found.value, x.mean(axis=0), rtol=1e-12, atol=1e-14)
    np.testing.assert_allclose(found.error, block_average(kept).error, rtol=1e-9)


def test_bad_input():
    with pytest.raises(InputError, match="one row or more"):
        block_average([])
    with pytest.raises(InputError, match="row 2 is not finite"):
        block_average([1.0, 2.0, np.nan])

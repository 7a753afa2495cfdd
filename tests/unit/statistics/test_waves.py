"""Least squares of a line and waves: against NumPy's, for waves near each other, near 0 and near alternating signs."""

from __future__ import annotations

import numpy as np
import pytest

from kickdrift.statistics.spectral_lines import Fits


@pytest.mark.parametrize("n", [60, 61])
@pytest.mark.parametrize(
    "frequencies", [[0.3], [0.3, 1.1, 2.9], [1.0, 1.002], [0.01, 3.1, 2.0], list(np.linspace(0.2, 3.0, 9))]
)
def test_fit_is_least_squares(n, frequencies):
    rng = np.random.default_rng(n)
    k, w = np.arange(n) - 0.5 * (n - 1), np.array(frequencies)
    waves = np.stack([np.cos(np.outer(k, w)), np.sin(np.outer(k, w))], axis=2).reshape(n, -1)
    matrix = np.column_stack((np.ones(n), k, waves))
    y = rng.normal(size=n)
    found = Fits(y).waves(w)
    rest = y - matrix @ np.linalg.lstsq(matrix, y, rcond=None)[0]
    np.testing.assert_allclose(found.rest, rest, rtol=0.0, atol=1e-9)
    other = np.delete(matrix, 1, axis=1)
    own = k - other @ np.linalg.lstsq(other, k, rcond=None)[0]
    assert found.variance == pytest.approx(1.0 / (own @ own), rel=1e-6)


def test_gauss_newton_finds_the_frequencies():
    w, k = np.array([0.4, 1.3, 2.2]), np.arange(200)
    y = 0.7 + 0.01 * k + (np.array([1.0, 0.5, 2.0]) * np.cos(np.add(np.outer(k, w), [0.1, 1.0, 2.0]))).sum(axis=1)
    found = Fits(y).waves(np.add(w, [2e-3, -2e-3, 1e-3]), 4)
    np.testing.assert_allclose(found.frequencies, w, rtol=0.0, atol=1e-12)
    np.testing.assert_allclose(np.hypot(found.cosines, found.sines), [1.0, 0.5, 2.0], rtol=1e-11)
    assert found.slope == pytest.approx(0.01, rel=1e-10)


@pytest.mark.parametrize("n", [200, 201])
@pytest.mark.parametrize("apart", [0.5, 0.1, 0.02])  # of the resolution; the closed forms cancel below 0.1
@pytest.mark.parametrize("middle", [1.0, 0.02, np.pi - 0.02])
def test_near_waves_are_least_squares(n, apart, middle):
    k, w = np.arange(n) - 0.5 * (n - 1), middle + np.array([-0.5, 0.5]) * apart * 2.0 * np.pi / n
    y = np.random.default_rng(n).normal(size=n)
    columns = _columns(k, w)
    amplitudes = np.linalg.lstsq(columns, y, rcond=None)[0]
    found = Fits(y).waves(w)
    np.testing.assert_allclose(found.rest, y - columns @ amplitudes, rtol=0.0, atol=2e-11)
    # One Gauss-Newton step is the least squares with the derivatives by the frequencies beside the columns.
    slopes = k[:, None] * (amplitudes[3::2] * np.cos(np.outer(k, w)) - amplitudes[2::2] * np.sin(np.outer(k, w)))
    step = np.linalg.lstsq(np.column_stack((columns, slopes)), y, rcond=None)[0][-2:]
    moved = Fits(y).waves(w, 1).frequencies - w
    np.testing.assert_allclose(moved, np.clip(step, -1.0 / n, 1.0 / n), rtol=1e-5, atol=1e-12)


@pytest.mark.parametrize("n", [300, 301])
@pytest.mark.parametrize("apart", [0.8, 0.5, 0.3])
def test_two_planted_waves_within_the_resolution_are_found(n, apart):
    k, w = np.arange(n) - 0.5 * (n - 1), 1.0 + np.array([-0.5, 0.5]) * apart * 2.0 * np.pi / n
    y = 0.3 + 1e-3 * k + np.cos(np.add(np.outer(k, w), [0.4, 2.0])) @ [1.0, 0.7]
    found = Fits(y).waves(w + np.array([-0.05, 0.05]) * 2.0 * np.pi / n, 12)
    np.testing.assert_allclose(found.frequencies, w, rtol=0.0, atol=1e-9 / n)
    np.testing.assert_allclose(np.hypot(found.cosines, found.sines), [1.0, 0.7], rtol=1e-7)
    assert found.slope == pytest.approx(1e-3, rel=1e-8)


@pytest.mark.parametrize("n", [100, 101])
def test_waves_that_coincide_count_once(n):
    """The columns of the second wave are hidden, and the residuals are those of one wave."""
    y = np.random.default_rng(n).normal(size=n)
    one, two = (Fits(y).waves(np.array(w)).rest for w in ([1.0], [1.0, 1.0]))
    np.testing.assert_allclose(two, one, rtol=0.0, atol=1e-12)


@pytest.mark.parametrize("n", [100, 101])
def test_alternating_signs_stay(n):
    """A wave of frequency pi has one column, which does not change with the frequency where it stands."""
    k, y = np.arange(n) - 0.5 * (n - 1), np.random.default_rng(n).normal(size=n)
    y += 3.0 * (-1.0) ** np.arange(n)
    found = Fits(y).waves(np.array([np.pi, 0.4]), 3)
    assert found.frequencies[0] == np.pi
    columns = np.column_stack((np.ones(n), k, (-1.0) ** np.arange(n), _columns(k, found.frequencies[1:])[:, 2:]))
    rest = y - columns @ np.linalg.lstsq(columns, y, rcond=None)[0]
    np.testing.assert_allclose(found.rest, rest, rtol=0.0, atol=1e-11)


def test_waves_are_taken_off_as_they_were_fitted():
    y, w = np.random.default_rng(1).normal(size=77), np.array([0.3, 1.1, 2.9])
    found = Fits(y).waves(w)
    rest = Fits(y - found.constant).less(w, found.cosines, found.sines, found.slope)
    np.testing.assert_allclose(rest, found.rest, rtol=0.0, atol=1e-13)


def _columns(k, w):
    """Columns 1, k, and cosine and sine of each frequency."""
    waves = np.stack([np.cos(np.outer(k, w)), np.sin(np.outer(k, w))], axis=2)
    return np.column_stack((np.ones(len(k)), k, waves.reshape(len(k), -1)))

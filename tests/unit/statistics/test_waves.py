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

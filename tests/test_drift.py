"""Energy errors, and the slope of a correlated series: exact cases, invariances and a small statistical study."""

import importlib.util
import sys
import time
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy import stats

from kickdrift.analysis.drift import MIN_SAMPLES, drift, energy_error
from kickdrift.errors import InputError

_spec = importlib.util.spec_from_file_location(
    "drift_statistics", Path(__file__).parents[1] / "validation" / "drift_statistics.py"
)
drift_statistics = importlib.util.module_from_spec(_spec)
sys.modules[_spec.name] = drift_statistics  # its dataclasses look their module up here
_spec.loader.exec_module(drift_statistics)

JUDGED = [kind for kind in drift_statistics.CLASSES if kind.judged]
SERIES = 120


# --- energy_error ---


def test_energy_error_is_relative_to_the_initial_energy():
    error = energy_error([-2.0, -2.2, -1.8, -2.1], [1.0, 1.1, 0.9, 1.0])
    assert (error.initial, error.final, error.relative_to) == (-2.0, -2.1, "initial energy")
    assert error.max_relative_error == pytest.approx(0.1, rel=1e-14)
    assert error.rms_relative_error == pytest.approx(np.sqrt((0.01 + 0.01 + 0.0025) / 4), rel=1e-14)


@pytest.mark.parametrize(("initial", "relative_to"), [(0.99, "kinetic energy"), (1.01, "initial energy")])
def test_kinetic_energy_takes_over_under_a_tenth(initial, relative_to):
    error = energy_error([initial, initial + 1.0], [10.0, 3.0])
    assert error.relative_to == relative_to
    assert error.max_relative_error == pytest.approx(1.0 / (10.0 if relative_to == "kinetic energy" else initial))


def test_energy_error_is_absolute_where_there_is_no_energy_at_all():
    error = energy_error([0.0, 0.5], [0.0, 0.0])
    assert (error.relative_to, error.max_relative_error) == ("absolute", 0.5)


def test_conserved_energy_has_no_error():
    error = energy_error([3.0] * 5, 1.0)
    assert (error.rms_relative_error, error.max_relative_error) == (0.0, 0.0)


@pytest.mark.parametrize("total", [[], [1.0, np.nan], [np.inf], [[1.0, 2.0]]])
def test_energy_error_refuses(total):
    with pytest.raises(InputError, match="total"):
        energy_error(total, 1.0)


# --- drift: exact cases ---


@pytest.mark.parametrize("n", [2, MIN_SAMPLES, 5000])
@pytest.mark.parametrize("value", [0.0, -1.25, 1e10])
def test_constant_is_bounded_without_error(n, value):
    result = drift(np.arange(n), np.full(n, value))
    assert (result.slope, result.error, result.verdict) == (0.0, 0.0, "bounded")


@pytest.mark.parametrize("scale", [1e-16, 1.0, 1e10])
@pytest.mark.parametrize("step", [0.01, -0.01, 1e6])
def test_noise_free_line(scale, step):
    times = 3.0 + step * np.arange(500)
    result = drift(times, scale * (2.0 * times - 7.0))
    assert result.verdict == "secular drift"
    assert abs(result.slope - 2.0 * scale) <= result.error < 1e-11 * scale


@pytest.mark.parametrize("period", [2.0, np.pi, 25.0, 123.4])
def test_noise_free_wave_is_bounded(period):
    result = drift(np.arange(1000), np.cos(2.0 * np.pi * np.arange(1000) / period + 0.7))
    assert result.verdict == "bounded"
    assert abs(result.slope) <= result.error < 1e-13


def test_slow_drift_under_a_large_wave():
    rng = np.random.default_rng(1)
    times = 0.02 * np.arange(1500)
    values = 1e-4 * times + np.sin(3.0 * times) + 0.3 * np.sin(6.0 * times + 1.0) + 1e-4 * rng.normal(size=1500)
    result = drift(times, values)
    assert (result.verdict, result.lines) == ("secular drift", 2)
    assert abs(result.slope - 1e-4) <= result.error < 1e-6


def test_sharp_periodic_peaks_are_bounded():
    """A leapfrog energy error on an eccentric orbit peaks at every pericentre: dozens of harmonics."""
    result = drift(np.arange(2000), 1.0 / (1.0 - 0.6 * np.cos(2.0 * np.pi * np.arange(2000) / 77.7)) ** 3)
    assert result.verdict == "bounded"
    assert abs(result.slope) <= result.error


def test_less_than_a_cycle_is_not_resolvable():
    result = drift(np.arange(500), np.sin(2.0 * np.pi * np.arange(500) / 700.0))
    assert (result.verdict, result.error) == ("not resolvable", np.inf)


def test_correlation_time_of_known_noise():
    """AR(1) with coefficient f has integrated autocorrelation time (1 + f) / (2 (1 - f)) samples."""
    values = drift_statistics.autoregressive(np.random.default_rng(2), 2000, 0.8)
    result = drift(0.1 * np.arange(2000), values)
    # log of the estimate has variance 4 / effective samples; four of its standard deviations.
    assert abs(np.log(result.correlation_time / (0.1 * 4.5))) < 4.0 * np.sqrt(4.0 / (2000 / 9.0))
    assert result.effective_samples == pytest.approx(2000 * 0.1 / (2.0 * result.correlation_time))


# --- drift: invariances and limits ---


@settings(max_examples=25, deadline=None)
@given(
    seed=st.integers(0, 10**6),
    kind=st.integers(0, len(JUDGED) - 1),
    scale=st.floats(1e-16, 1e10),
    sign=st.sampled_from([-1.0, 1.0]),
    step=st.floats(1e-6, 1e6),
)
def test_units_do_not_matter(seed, kind, scale, sign, step):
    values, _ = JUDGED[kind].make(np.random.default_rng(seed))
    # Without noise only rounding is left, which does not scale.
    values = values + 1e-6 * np.random.default_rng(seed + 1).normal(size=len(values))
    here = drift(np.arange(len(values)), values)
    there = drift(step * np.arange(len(values)), sign * scale * values)
    unit = scale / step
    assert (there.verdict, there.lines) == (here.verdict, here.lines)
    assert there.error == pytest.approx(here.error * unit, rel=1e-4)
    if np.isfinite(here.error):
        assert abs(there.slope - sign * here.slope * unit) < 1e-3 * there.error


@settings(max_examples=25, deadline=None)
@given(seed=st.integers(0, 10**6), slope=st.floats(-1.0, 1.0))
def test_adding_a_line_adds_its_slope(seed, slope):
    values = drift_statistics.autoregressive(np.random.default_rng(seed), 400, 0.5)
    flat, tilted = drift(np.arange(400), values), drift(np.arange(400), values + slope * np.arange(400))
    assert tilted.error == pytest.approx(flat.error, rel=1e-6)
    assert tilted.slope - flat.slope == pytest.approx(slope, abs=1e-6 * flat.error)


@pytest.mark.parametrize("n", [1, 2, 3, MIN_SAMPLES - 1])
def test_too_short(n):
    result = drift(np.arange(n), np.random.default_rng(n).normal(size=n))
    assert (result.verdict, result.error) == ("not resolvable", np.inf)
    assert np.isfinite(result.slope)


@pytest.mark.parametrize("bad", [np.nan, np.inf, -np.inf])
@pytest.mark.parametrize("where", ["times", "values"])
def test_refuses_what_is_not_finite(bad, where):
    series = {"times": np.arange(50.0), "values": np.arange(50.0)}
    series[where][7] = bad
    with pytest.raises(InputError, match=f"{where}: sample 7"):
        drift(**series)


@pytest.mark.parametrize(
    ("times", "values", "message"),
    [
        ([], [], "non-empty"),
        ([0.0, 1.0], [1.0], "2 times but 1 values"),
        ([0.0, 1.0, 3.0], [1.0, 2.0, 3.0], "evenly spaced"),
        ([1.0, 1.0], [1.0, 2.0], "evenly spaced"),
        ([0.0], [[1.0]], "one-dimensional"),
    ],
)
def test_refuses_what_is_no_series(times, values, message):
    with pytest.raises(InputError, match=message):
        drift(times, values)


def test_long_series_is_quick_and_right():
    rng = np.random.default_rng(3)
    times = 0.001 * np.arange(100_003)
    noise = drift_statistics.autoregressive(rng, len(times), 0.9)
    walk = np.cumsum(rng.normal(size=len(times)))
    begin = time.perf_counter()
    drifting, bounded, walking = drift(times, 0.5 * times + noise), drift(times, noise), drift(times, walk)
    assert time.perf_counter() - begin < 1.5  # three series of at most 0.5 s; some 0.03 s measured
    assert (drifting.verdict, bounded.verdict, walking.verdict) == ("secular drift", "bounded", "random walk")
    # The noise level at zero frequency gives the standard error of the slope, n^(-3/2) sqrt(12) / (1 - f) a sample.
    assert bounded.error == pytest.approx(1.96e3 * np.sqrt(12.0) / 0.1 / len(times) ** 1.5, rel=0.2)
    assert abs(drifting.slope - 0.5) < 2.0 * drifting.error


# --- drift: the statistics, in small (validation/drift_statistics.py runs 1000 series of each class) ---


@pytest.mark.parametrize("kind", JUDGED, ids=lambda kind: kind.name)
def test_coverage_and_verdicts(kind):
    """Fails by chance once in 10^4 where the true coverage is 95 % and the true share of wrong verdicts 2.5 %."""
    outcome = drift_statistics.study(kind, SERIES, seed=20)
    wrong = round(outcome.wrong * SERIES)
    assert wrong <= stats.binom.ppf(1.0 - 1e-4, SERIES, 0.025), outcome.verdicts
    if kind.coverage is not None:
        least, most = stats.binom.ppf([5e-5, 1.0 - 5e-5], SERIES, 0.95)
        covered = round(outcome.coverage * SERIES)
        assert covered >= least
        assert covered <= most or kind.coverage[1] == 1.0


def test_claims_name_every_bound():
    rows = drift_statistics.judged(drift_statistics.study(JUDGED[0], 20, 0))
    assert [set(row) for row in rows] == [{"claim", "value", "bound", "reference", "verdict"}] * 2


def test_rounding_beneath_a_wave_is_no_random_walk():
    """An oscillator's energy error: a wave, and a walk of its rounding that is a billionth of it."""
    rng = np.random.default_rng(5)
    times = np.arange(1000) * 0.5
    wave = 1e-3 * np.sin(1.7 * times)
    walk = np.cumsum(rng.normal(size=1000))
    beneath = drift(times, wave + 1e-15 * walk)
    assert beneath.verdict == "bounded"
    assert beneath.lines == 1
    assert drift(times, wave + 1e-9 * walk).verdict == "random walk"

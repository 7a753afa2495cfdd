"""Energy errors, and the slope of a correlated series: exact cases, invariances and a small statistical study."""

import dataclasses
import time

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy import stats

import kickdrift as kd
from kickdrift.errors import InputError
from kickdrift.model.starts.builders import lattice, maxwell_boltzmann
from kickdrift.odes import kepler
from kickdrift.statistics.drift import MIN_SAMPLES, Growth, drift, energy_error, rounding_of
from kickdrift_validation import drift_statistics, drift_verdicts

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
    values = np.sin(2.0 * np.pi * np.arange(500) / 700.0)
    result = drift(np.arange(500), values)
    assert (result.verdict, result.error) == ("not resolvable", np.ptp(values) / 499)


def test_correlation_time_of_known_noise():
    """AR(1) with coefficient f has integrated autocorrelation time (1 + f) / (2 (1 - f)) samples."""
    values = drift_statistics.autoregressive(np.random.default_rng(2), 2000, 0.8)
    result = drift(0.1 * np.arange(2000), values)
    # The log of the estimate has variance 4 / effective samples; allow four standard deviations.
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
    # Without noise only rounding remains, which does not scale.
    values = values + 1e-6 * np.random.default_rng(seed + 1).normal(size=len(values))
    here = drift(np.arange(len(values)), values)
    there = drift(step * np.arange(len(values)), sign * scale * values)
    unit = scale / step
    assert (there.verdict, there.lines) == (here.verdict, here.lines)
    assert there.error == pytest.approx(here.error * unit, rel=1e-4)
    if np.isfinite(here.error):
        assert abs(there.slope - sign * here.slope * unit) < 1e-3 * there.error


@settings(max_examples=25, deadline=None)
@given(seed=st.integers(0, 10**6), slope=st.floats(-1.0, 1.0), clear=st.floats(0.1, 1.0))
def test_adding_a_line_adds_its_slope(seed, slope, clear):
    values = drift_statistics.autoregressive(np.random.default_rng(seed), 400, 0.5)
    times = np.arange(400)
    added, plain = drift(times, values + slope * times), drift(times, values + clear * times)
    assert added.slope - plain.slope == pytest.approx(slope - clear, abs=1e-6 * plain.error)
    # A small slope may also be a random walk's, which has the larger error. A clear slope has the noise's error.
    assert added.error >= plain.error * (1.0 - 1e-6)
    if abs(slope) >= 0.1:
        assert added.error == pytest.approx(plain.error, rel=1e-6)


@pytest.mark.parametrize("n", [1, 2, 3, MIN_SAMPLES - 1])
def test_too_short(n):
    values = np.random.default_rng(n).normal(size=n)
    result = drift(np.arange(n), values)
    assert (result.verdict, result.error) == ("not resolvable", np.ptp(values) / (n - 1) if n > 1 else np.inf)
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
    # The noise level at zero frequency gives the slope's standard error per sample, n^(-3/2) sqrt(12) / (1 - f).
    assert bounded.error == pytest.approx(1.96e3 * np.sqrt(12.0) / 0.1 / len(times) ** 1.5, rel=0.2)
    assert abs(drifting.slope - 0.5) < 2.0 * drifting.error


# --- drift: bends, losses, walks beneath noise, round-off ---


def rate_of(times, values):
    """Slope by least squares."""
    return np.polyfit(times - times.mean(), values, 1)[0]


S = (np.arange(600) + 0.5) / 600
ONE_WAY = {
    "bent": -(S**2),
    "levels off": -np.sqrt(S),
    "accelerates": -np.exp(5.0 * S),
    "runs away": -np.exp(9.0 * S),
    "stairs": -np.floor(40.0 * S),
    "loss with a chirp": -(S**2) + 0.05 * np.sin(300.0 * (S + 0.2 * S**2)),
    "loss with noise": -(S**3) + 0.01 * np.random.default_rng(8).normal(size=600),
}


@pytest.mark.parametrize("kind", ONE_WAY)
@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_what_goes_one_way_is_a_secular_drift(kind, sign):
    times = 0.3 * np.arange(600)
    values = sign * ONE_WAY[kind]
    result = drift(times, values)
    assert result.verdict == "secular drift"
    assert result.slope == pytest.approx(rate_of(times, values), rel=0.02)
    assert result.error <= np.ptp(values) / (times[-1] - times[0])


@settings(max_examples=30, deadline=None)
@given(
    bend=st.floats(-0.9, 0.9),
    wave=st.floats(0.0, 0.1),
    scale=st.floats(1e-12, 1e10),
    offset=st.floats(-10.0, 10.0),
    step=st.floats(1e-6, 1e6),
    forward=st.booleans(),
)
def test_units_and_offsets_of_a_loss_do_not_matter(bend, wave, scale, offset, step, forward):
    values = S + bend * (S**2 - S) + wave * np.sin(400.0 * S) + 1e-3 * np.random.default_rng(9).normal(size=600)
    here = drift(np.arange(600), values)
    way = 1.0 if forward else -1.0
    there = drift(7.0 + step * np.arange(600), scale * (way * values + offset))
    assert (there.verdict, here.verdict) == ("secular drift", "secular drift")
    assert there.slope == pytest.approx(way * here.slope * scale / step, rel=1e-6)
    assert there.error == pytest.approx(here.error * scale / step, rel=1e-4)
    assert here.error <= np.ptp(values) / 599 * (1 + 1e-12)


@settings(max_examples=30, deadline=None)
@given(seed=st.integers(0, 10**6), n=st.integers(2, 400), power=st.floats(0.0, 6.0), noise=st.floats(0.0, 1.0))
def test_the_interval_is_never_wider_than_the_range(seed, n, power, noise):
    values = np.linspace(0.0, 1.0, n) ** power + noise * np.random.default_rng(seed).normal(size=n)
    assert drift(np.arange(n), values).error <= np.ptp(values) / (n - 1) * (1 + 1e-12)


def test_one_jump_is_no_drift():
    rng = np.random.default_rng(4)
    assert drift(np.arange(600), 1.0 * (S > 0.3) + 1e-9 * rng.normal(size=600)).verdict != "secular drift"


def test_a_walk_beneath_the_noise_is_no_drift():
    """The energy of a liquid with cut-off forces is such a series. A unit-root test alone calls half of these a
    drift."""
    rng = np.random.default_rng(6)
    series = [rng.normal(size=700) + np.cumsum(rng.normal(size=700)) / np.sqrt(700.0) for _ in range(40)]
    verdicts = [drift(np.arange(700), each).verdict for each in series]
    assert verdicts.count("secular drift") <= 6  # 5 % expected; more once in 300 draws


def test_a_folded_wave_is_no_drift():
    """Sharp peaks every 24.02 samples: the 24th harmonic is aliased to 0.35 cycles in the whole series."""
    n = np.arange(420)
    for phase in np.linspace(0.0, 6.0, 7):
        result = drift(n, 1.0 / (1.0 - 0.7 * np.cos(2.0 * np.pi * n / 24.02 + phase)) ** 3)
        assert result.verdict == "bounded"
        assert abs(result.slope) <= 2.0 * result.error


@pytest.mark.parametrize("n", [5, MIN_SAMPLES, 3000])
@pytest.mark.parametrize("roundings", [-60.0, 60.0])
def test_a_drift_of_few_roundings_is_round_off(n, roundings):
    one = rounding_of(-3.0, 10)
    values = -3.0 + np.round(np.linspace(0.0, roundings, n)) * one
    assert drift(np.arange(n), values).verdict == "round-off"
    assert drift(np.arange(n), (values + 3.0) / 3.0, one / 3.0).verdict == "round-off"
    assert drift(np.arange(n), (values + 3.0) / 3.0 * 50.0, one / 3.0).verdict != "round-off"


def test_a_drift_of_one_rounding_beneath_a_wave_is_bounded():
    times = np.arange(1000)
    wave = 1e-12 * np.sin(1.7 * times)
    assert drift(times, wave + 2e-16 * times / 1000, 2.2e-16).verdict == "bounded"
    assert drift(times, wave + 2e-12 * times / 1000, 2.2e-16).verdict == "secular drift"


def test_roundings_walk_over_many_steps():
    assert rounding_of(-2.0, 1) == 2.0 * np.finfo(float).eps
    assert rounding_of(2.0, 10**8) == pytest.approx(1000.0 * rounding_of(2.0, 1))


def test_what_is_not_resolved_foresees_nothing():
    assert Growth(drift=1.0, verdict="not resolvable").factor(1.0, 10.0, 100.0) is None
    assert Growth(drift=0.0, verdict="round-off").factor(1.0, 100.0, 1.0) == pytest.approx(10.0)


def drift_of(sim, steps, every):
    """Energy in a run's report, the slope by least squares and the range over the time."""
    report = sim.run(steps, every=every)
    series = sim.record.series()
    energies = (series.total - series.total[0]) / abs(series.total[0])
    length = series.times[-1] - series.times[0]
    return report.energy, rate_of(series.times, energies), np.ptp(energies) / length


@pytest.mark.parametrize("dt", [0.1, 0.2])
def test_rk4_of_sun_and_jupiter_loses_energy(dt):
    """The energy falls by 8.5e-4 at the longer step, along a curve that a fit of 40 waves could also match."""
    energy, rate, widest = drift_of(kd.Simulation(kd.load("sun-jupiter"), "rk4", dt=dt), 20_000, 20)
    assert energy.verdict == "secular drift"
    assert abs(energy.drift_per_unit_time - rate) <= energy.drift_error <= widest
    assert energy.drift_per_unit_time < 0.0
    if dt == 0.2:
        assert energy.drift_per_unit_time == pytest.approx(-2.13e-7, rel=0.01)


def test_rk4_on_a_kepler_orbit_loses_energy():
    energy, rate, widest = drift_of(kd.Simulation(kepler(0.043), "rk4", dt=0.0814), 20_000, 20)
    assert energy.verdict == "secular drift"
    assert energy.drift_per_unit_time == pytest.approx(rate, rel=0.05)
    assert energy.drift_per_unit_time + energy.drift_error < 0.0
    assert energy.drift_error <= widest


def test_rk4_on_a_liquid_loses_energy():
    positions, edges = lattice("fcc", 108, 0.82)
    force = kd.LennardJones(cutoff=2.3, truncation="switch")
    velocities = maxwell_boltzmann(np.ones(108), 3.0, 1.0, 3)
    system = kd.System(positions, velocities, box=edges, forces=[force], seed=3)
    sim = kd.Simulation(system, "velocity-verlet", dt=0.004)
    sim.run(1000)
    system = kd.System(sim.state.wrapped(), sim.state.velocities, box=edges, forces=[force], seed=3)
    energy, rate, widest = drift_of(kd.Simulation(system, "rk4", dt=0.011), 2000, 4)
    assert 0.05 < energy.max_relative_error < 0.25
    assert energy.verdict == "unreliable"  # more than a tenth of the energy is lost
    assert energy.drift_per_unit_time == pytest.approx(rate, rel=0.05)
    assert energy.drift_error <= widest


# --- drift: the statistics, in small (kickdrift_validation.drift_statistics runs 1000 series of each class) ---


@pytest.mark.parametrize("kind", JUDGED, ids=lambda kind: kind.name)
def test_coverage_and_verdicts(kind):
    """By chance this fails once in 10^4 runs, if the true coverage is 95 % and the true share of wrong verdicts 2.5
    %."""
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


def test_a_wrong_verdict_on_a_genuine_run_fails_its_claim():
    good = drift_verdicts.run("kepler", "rk4", 0)
    assert (good.energy.verdict, good.goes_on, len(good.windows)) == ("secular drift", -1, drift_verdicts.LENGTHS)

    def failed(found, **changes):
        energy = dataclasses.replace(found.energy, **changes)
        found = dataclasses.replace(found, report=dataclasses.replace(found.report, energy=energy))
        return [k for k, row in enumerate(drift_verdicts.judged([found])) if row["verdict"] == "fail"]

    assert failed(good) == []
    assert failed(good, drift_per_unit_time=1e-9) == [0, 1]
    assert failed(good, drift_error=1.0) == [3]
    assert failed(dataclasses.replace(good, windows=(0.0, 1.0, 0.5))) == [1]
    lossy = dataclasses.replace(good, totals=good.totals * np.linspace(1.0, 0.9, len(good.totals)))
    assert 2 in failed(lossy, verdict="not resolvable", max_relative_error=0.1)


def test_windows_end_where_the_energy_has_changed_by_half():
    times = np.linspace(0.0, 8.0, 801)
    assert drift_verdicts.windows(times, 0.01 * times, 1.0) == pytest.approx(0.01 * (np.arange(8) + 0.5))
    assert len(drift_verdicts.windows(times, 0.1 * times, 1.0)) == 5
    assert drift_verdicts.windows(times, times, 1.0) == pytest.approx([1 / 6, 1 / 2, 5 / 6], abs=0.01)


def test_rounding_beneath_a_wave_is_no_random_walk():
    """An oscillator's energy error is a wave, and a random walk of its rounding at a billionth of the wave."""
    rng = np.random.default_rng(5)
    times = np.arange(1000) * 0.5
    wave = 1e-3 * np.sin(1.7 * times)
    walk = np.cumsum(rng.normal(size=1000))
    beneath = drift(times, wave + 1e-15 * walk)
    assert beneath.verdict == "bounded"
    assert beneath.lines == 1
    assert drift(times, wave + 1e-9 * walk).verdict == "random walk"

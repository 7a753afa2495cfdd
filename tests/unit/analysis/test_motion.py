"""Displacements, velocity correlations and diffusion: against MDAnalysis, plain sums and closed forms."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.signal import lfilter
from scipy.special import erfc

import kickdrift as kd
from kickdrift.analysis import Diffusion, mean_squared_displacement, velocity_autocorrelation
from kickdrift.analysis.observables import vectors
from kickdrift.analysis.observables.motion import CUBE
from kickdrift.errors import InputError
from kickdrift.model.state import State
from kickdrift.trajectory.write.h5md import Writer

DT = 0.25


def write(path, positions, velocities=None, steps=None, species=None, masses=1.0):
    """A run's file of these frames."""
    velocities = np.zeros_like(positions) if velocities is None else velocities
    steps = range(0, 10 * len(positions), 10) if steps is None else steps
    system = kd.System(positions[0], velocities[0], masses=masses, box=(9.0, 9.0, 9.0), species=species)
    s = system.state
    with Writer(path, system, method={"integrator": "none", "dt": DT / 10}, every=10) as writer:
        for step, x, v in zip(steps, positions, velocities, strict=True):
            writer.append(State(np.array([x.T, v.T]), s.masses, s.ids, s.box, step * DT / 10, step), {})
    return path


def walk(frames=120, n=20, seed=1) -> np.ndarray:
    """A random walk on numbers that are exact in float32, which MDAnalysis uses."""
    steps = np.random.default_rng(seed).integers(-64, 65, (frames, n, 3)) / 256
    return np.cumsum(steps, axis=0) + np.random.default_rng(seed).integers(0, 9, (n, 3))


def plain(x: np.ndarray, displacements: bool) -> np.ndarray:
    """Sum over every lag and every time origin, one by one."""
    f = len(x)
    if displacements:
        return np.array([np.mean(((x[m:] - x[: f - m]) ** 2).sum(axis=-1)) for m in range(f)])
    return np.array([np.mean((x[m:] * x[: f - m]).sum(axis=-1)) for m in range(f)])


def test_displacements_equal_mdanalysis_on_the_same_file(tmp_path):
    pytest.importorskip("MDAnalysis")
    from MDAnalysis.analysis.msd import EinsteinMSD

    path = write(tmp_path / "run.h5md", walk())
    with kd.open(path) as run:
        ours = mean_squared_displacement(run, lags=len(run))
        universe = run.universe()
    theirs = EinsteinMSD(universe, fft=False).run()
    np.testing.assert_allclose(ours.values, theirs.results.timeseries, rtol=1e-12, atol=1e-14)
    np.testing.assert_allclose(ours.times, [ts.time for ts in universe.trajectory], rtol=1e-6)
    universe.trajectory.close()


@pytest.mark.parametrize("piece", [vectors.PIECE_BYTES, 24 * 120 * 7, 24])
def test_equal_plain_sums_read_in_pieces_of_any_size(tmp_path, monkeypatch, piece):
    monkeypatch.setattr(vectors, "PIECE_BYTES", piece)
    x, v = walk(), np.random.default_rng(2).normal(size=(120, 20, 3))
    path = write(tmp_path / "run.h5md", x, v)
    found = mean_squared_displacement(path, lags=120)
    np.testing.assert_allclose(found.values, plain(x, True), rtol=1e-12, atol=1e-14)
    assert found.values[0] == 0.0
    np.testing.assert_allclose(velocity_autocorrelation(path, lags=120).values, plain(v, False), rtol=1e-10, atol=1e-12)
    centred = mean_squared_displacement(path, lags=120, remove_drift=True)
    np.testing.assert_allclose(centred.values, plain(x - x.mean(axis=1, keepdims=True), True), rtol=1e-11, atol=1e-13)


@settings(max_examples=40, deadline=None)
@given(st.integers(2, 200), st.integers(1, 5), st.floats(-1e4, 1e4), st.integers(0, 10**6), st.data())
def test_any_length_any_place_any_order(frames, n, shift, seed, data):
    lags = data.draw(st.integers(1, frames))
    x = walk(frames, n, seed)
    times = DT * np.arange(frames)
    found = mean_squared_displacement(x, times, lags)
    np.testing.assert_allclose(found.values, plain(x, True)[:lags], rtol=1e-10, atol=1e-12)
    order = np.random.default_rng(seed).permutation(n)
    moved = mean_squared_displacement(x[:, order] + shift, times, lags)
    np.testing.assert_allclose(moved.values, found.values, rtol=1e-7, atol=1e-9)
    np.testing.assert_allclose(velocity_autocorrelation(x, times, lags).values, plain(x, False)[:lags], atol=1e-8)


def test_free_particles_fly():
    v = np.random.default_rng(4).normal(size=(30, 3))
    times = DT * np.arange(400)
    found = mean_squared_displacement(1e3 + v * times[:, None, None], times)
    np.testing.assert_allclose(found.values, np.mean((v**2).sum(axis=1)) * found.times**2, rtol=1e-9, atol=1e-12)
    assert len(found.times) == 100
    np.testing.assert_allclose(found.times, times[:100], rtol=1e-14)


def test_harmonic_oscillators_swing():
    """v = -A w sin(w t + phase), with evenly spread phases: <v v(t)> = A^2 w^2 cos(w t) / 2 on each axis."""
    w, amplitude, times = 2.0, 0.3, 0.05 * np.arange(300)
    phases = 2 * np.pi * np.arange(12) / 12
    v = -amplitude * w * np.sin(w * times[:, None] + phases)
    found = velocity_autocorrelation(np.repeat(v[:, :, None], 3, axis=2), times)
    np.testing.assert_allclose(found.values, 1.5 * (amplitude * w) ** 2 * np.cos(w * found.times), atol=1e-12)
    np.testing.assert_allclose(found.normalised, np.cos(w * found.times), atol=1e-11)
    np.testing.assert_allclose(found.error, 0.0, atol=1e-12)


def test_diffusion_of_random_walks_lies_within_its_error():
    """Steps of variance s^2 along each axis in a time dt have D = s^2 / (2 dt)."""
    truth = 0.5 / DT
    found = []
    for seed in range(40):
        x = np.cumsum(np.random.default_rng(seed).normal(size=(800, 10, 3)), axis=0)
        found.append(mean_squared_displacement(x, DT * np.arange(800)).diffusion(DT, 20 * DT))
    values, errors = np.array([d.value for d in found]), np.array([d.error for d in found])
    assert np.isfinite(errors).all()
    assert values.mean() == pytest.approx(truth, abs=4 * values.std() / math.sqrt(40))
    assert np.sqrt(np.mean(errors**2)) == pytest.approx(values.std(ddof=1), rel=0.35)  # uncertain by 1/sqrt(80)
    assert np.mean(np.abs(values - truth) < 2 * errors) > 0.8
    assert found[0].window == (DT, 20 * DT)


def test_diffusion_as_text_has_a_familiar_unit_or_says_that_its_error_is_unknown():
    """1 angstrom^2/ps is 1e-16 cm^2 in 1e-12 s."""
    found = mean_squared_displacement(
        np.cumsum(np.random.default_rng(1).normal(size=(80, 5, 3)), axis=0), np.arange(80.0), lags=80
    )
    long, short = found.diffusion(60, 79), Diffusion(0.25, 0.01, (1.0, 9.0), "angstrom^2/ps")
    assert str(short) == "0.250 ± 0.010 angstrom^2/ps = 2.5e-05 ± 1.0e-06 cm^2/s"
    assert str(long).endswith("error unknown: the run is too short for times up to 79; errors end at 54")


def test_diffusion_of_langevin_velocities_by_green_and_kubo():
    """v(i) = c v(i - 1) + noise has the correlation c^m, and its trapezoidal sum to infinity is dt (1 + c) / (1 - c) /
    2."""
    c = 0.8
    noise = np.random.default_rng(5).normal(size=(4000, 40, 3)) * math.sqrt(1 - c * c)
    v = lfilter([1.0], [1.0, -c], noise, axis=0)[200:]
    found = velocity_autocorrelation(v, DT * np.arange(len(v)), lags=60)
    assert abs(found.values[1] - 3 * c) < 4 * found.error[1]
    d = found.diffusion(40 * DT)
    truth = DT * (1 + c) / (1 - c) / 2
    assert abs(d.value - truth) < 4 * d.error
    assert 0.005 * truth < d.error < 0.05 * truth


def test_errors_of_displacements_are_those_of_many_runs():
    runs = [
        mean_squared_displacement(
            np.cumsum(np.random.default_rng(seed).normal(size=(1000, 10, 3)), axis=0), np.arange(1000.0)
        )
        for seed in range(40)
    ]
    for lag in (1, 5, 20, 50):
        errors = np.array([run.error[lag] for run in runs])
        known = errors[np.isfinite(errors)]
        assert len(known) > 20
        scatter = np.std([run.values[lag] for run in runs], ddof=1)
        assert np.sqrt(np.mean(known**2)) == pytest.approx(scatter, rel=0.35)
    assert np.isinf(runs[0].error[249]), "a quarter of the run has no error"


def test_the_centre_of_mass_goes_with_the_masses():
    masses = np.array([1.0, 3.0])
    v = np.random.default_rng(6).normal(size=(50, 2, 3))
    times = np.arange(50.0)
    drift = np.sin(times)[:, None, None]
    still = velocity_autocorrelation(v, times, masses=masses, remove_drift=True)
    np.testing.assert_allclose(
        velocity_autocorrelation(v + drift, times, masses=masses, remove_drift=True).values, still.values, atol=1e-12
    )
    centre = np.einsum("n,fnk->fk", masses / 4, v)[:, None]
    np.testing.assert_allclose(still.values, plain(v - centre, False)[:12], rtol=1e-9, atol=1e-12)


def test_species_have_their_own(tmp_path):
    x = walk(n=6)
    path = write(tmp_path / "run.h5md", x, species=["A", "B", "A", "A", "B", "B"], masses=[1, 2, 1, 1, 2, 2])
    found = mean_squared_displacement(path, lags=120, of="B")
    np.testing.assert_allclose(found.values, plain(x[:, [1, 4, 5]], True), rtol=1e-11, atol=1e-13)
    with pytest.raises(InputError, match="no species 'C'; known are A, B"):
        mean_squared_displacement(path, of="C")


def test_a_run_that_ended_between_two_frames(tmp_path):
    x = walk(frames=21)
    path = write(tmp_path / "run.h5md", x, steps=[*range(0, 200, 10), 194])
    found = mean_squared_displacement(path, lags=20)
    assert found.frames == 20
    np.testing.assert_allclose(found.values, plain(x[:20], True), rtol=1e-11, atol=1e-13)
    with pytest.raises(InputError, match=r"not evenly spaced in time: 0\.1 after frame 19, 0\.25 after the first"):
        mean_squared_displacement(kd.open(path)[:])


def test_some_of_the_frames(tmp_path):
    x = walk()
    path = write(tmp_path / "run.h5md", x)
    with kd.open(path) as run:
        found = mean_squared_displacement(run[10::3], lags=20)
        with pytest.raises(InputError, match="a positive step"):
            mean_squared_displacement(run[::-1])
        with pytest.raises(InputError, match="the choice of frames is empty"):
            mean_squared_displacement(run[500:])
    np.testing.assert_allclose(found.values, plain(x[10::3], True)[:20], rtol=1e-11, atol=1e-13)
    assert found.times[1] == pytest.approx(3 * DT)


def test_finite_size():
    """Compare the box's constant with an Ewald sum: the potential of a unit charge's images at the charge."""
    alpha = 2.0
    grid = np.stack(np.meshgrid(*[np.arange(-6, 7)] * 3), axis=-1).reshape(-1, 3)
    r = np.linalg.norm(grid[np.any(grid != 0, axis=1)], axis=1)
    k = 2 * np.pi * r
    far = np.sum(4 * np.pi / k**2 * np.exp(-(k**2) / (4 * alpha**2)))
    madelung = np.sum(erfc(alpha * r) / r) + far - 2 * alpha / math.sqrt(math.pi) - math.pi / alpha**2
    assert pytest.approx(-madelung, rel=1e-6) == CUBE
    d = kd.analysis.Diffusion(0.03, 0.001, (1.0, 2.0)).at_infinite_size(0.8, 2.5, 10.0)
    assert d.value == pytest.approx(0.03 + 0.8 * CUBE / (6 * math.pi * 2.5 * 10.0))
    assert d.error == 0.001
    with pytest.raises(InputError, match="viscosity must be positive, got 0"):
        d.at_infinite_size(1.0, 0.0, 10.0)


def test_a_body_that_left_is_named():
    x = walk(frames=10, n=4)
    x[7, 2, 1] = np.nan
    with pytest.raises(InputError, match="particle 2 of frame 7 is not finite"):
        mean_squared_displacement(x, np.arange(10.0))


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"times": None}, "times: needed for arrays"),
        ({"times": [0.0, 1.0]}, "times: expected 40"),
        ({"times": np.arange(40.0) ** 2}, "not evenly spaced"),
        ({"times": np.zeros(40)}, "not evenly spaced"),
        ({"lags": 41}, "lags: expected 1 to 40"),
        ({"lags": 0}, "lags: expected 1 to 40"),
        ({"masses": [1.0]}, "masses: expected 3"),
        ({"species": ["A"]}, "species: expected 3"),
        ({"source": np.zeros((4, 2))}, r"expected shape \(frames, n, 3\)"),
        ({"source": walk(frames=1, n=3), "times": [0.0]}, "two or more"),
    ],
)
def test_bad_input(change, message):
    given = {"source": walk(frames=40, n=3), "times": np.arange(40.0), **change}
    with pytest.raises(InputError, match=message):
        mean_squared_displacement(**given)


@pytest.mark.parametrize(("start", "stop"), [(0.0, 99.0), (5.0, 5.0), (6.0, 5.0), (-1.0, 5.0)])
def test_a_window_that_is_none(start, stop):
    found = mean_squared_displacement(walk(frames=40, n=3), np.arange(40.0))
    with pytest.raises(InputError, match="diffusion"):
        found.diffusion(start, stop)
    with pytest.raises(InputError, match="until"):
        velocity_autocorrelation(walk(frames=40, n=3), np.arange(40.0)).diffusion(0.1)


def test_a_diffusion_without_an_error_says_where_errors_end():
    x = np.cumsum(np.random.default_rng(1).normal(size=(400, 20, 3)), axis=0)
    found = kd.analysis.mean_squared_displacement(x, np.arange(400.0))
    d = found.diffusion(10.0, 99.0)
    known = np.flatnonzero(np.isfinite(found.error))[-1]
    assert (d.error, d.known_to) == (np.inf, found.times[known])
    assert str(d).endswith(f"the run is too short for times up to 99; errors end at {known}")
    assert "errors end" not in str(found.diffusion(1.0, 5.0))

"""Proper frequencies and librations of orbits: textbook theory, synthetic modes, the outer planets, bad input."""

from __future__ import annotations

import json
import math

import numpy as np
import pytest
from typer.testing import CliRunner

import kickdrift as kd
from kickdrift.analysis.orbits.secular_report import libration, powers, ratios
from kickdrift.analysis.orbits.secular_run import Theory, laplace, modes, theories
from kickdrift.cli.main import app
from kickdrift.model.orbits import Orbits
from kickdrift.model.starts.elements import Elements

YEARS = 60_000.0


@pytest.fixture(scope="module")
def outer(tmp_path_factory):
    """The outer solar system for three librations of Pluto."""
    path = tmp_path_factory.mktemp("outer") / "outer.h5md"
    kd.Simulation(kd.load("outer-solar-system")).run(time=YEARS, every=365, output=path)
    return path


def circles(a, mu=39.5):
    """Orbits of constant elements, (2, m)."""
    a = np.array(a)
    zero = np.zeros((2, len(a)))
    names = tuple(f"b{k}" for k in range(len(a)))
    return Orbits(np.arange(2.0), names, Elements(zero + a, zero, zero, zero, zero, zero), zero + mu)


def test_the_linear_theory_of_jupiter_and_saturn_is_the_textbooks():
    """Murray & Dermott 1999, section 7.4, in degrees a year."""
    np.testing.assert_allclose(laplace(1, 0.544493), 3.17296, rtol=2e-5)
    np.testing.assert_allclose(laplace(2, 0.544493), 2.07110, rtol=2e-5)
    found = theories(circles([5.202545, 9.554841], 4 * math.pi**2), np.array([9.54786e-4, 2.85837e-4]))
    a, b = (np.degrees(theory.matrix) for theory in found)
    np.testing.assert_allclose(a, [[0.00203738, -0.00132987], [-0.00328007, 0.00502513]], rtol=2e-3)
    np.testing.assert_allclose(b, [[-0.00203738, 0.00203738], [0.00502513, -0.00502513]], rtol=2e-3)
    np.testing.assert_allclose(np.sort(np.linalg.eigvals(a)), [9.63435e-4, 6.09908e-3], rtol=2e-3)


def test_modes_have_the_frequencies_of_the_linear_theory():
    """z = sum of modes, so that the third body has the largest line of the first."""
    masses = np.array([1e-3, 3e-4, 1e-5, 0.0])
    theory = theories(circles([5.2, 9.5, 14.0, 20.0]), masses)[0]
    rates, vectors = np.linalg.eig(theory.matrix)
    times = np.linspace(0.0, 40 * 2 * math.pi / np.abs(rates).min(), 4000)
    z = (np.exp(1j * np.outer(times, rates)) * np.array([0.02, 0.03, 0.01, 0.05])) @ vectors.T
    found = modes(z, times, theory, nodes=False)
    np.testing.assert_allclose(np.sort(found.frequencies), np.sort(rates), rtol=1e-9)
    np.testing.assert_allclose(found.frequencies, found.expected, rtol=1e-3)  # the weights are symmetric to m / M
    assert not found.still.any()


def test_a_mode_slower_than_the_series_has_no_frequency():
    theory = Theory(np.diag([1.0, 1e-3]), np.ones(2), np.array([True, True]))
    times = np.linspace(0.0, 100.0, 400)
    found = modes(np.exp(1j * np.outer(times, [1.0, 1e-3])), times, theory, nodes=False)
    assert found.frequencies[0] == pytest.approx(1.0, rel=1e-6)
    assert math.isnan(found.frequencies[1])


def test_powers_keep_dalemberts_rules():
    assert set(powers(1)) == {(1, 0, 0, 0), (0, 1, 0, 0)}
    assert set(powers(2)) == {(2, 0, 0, 0), (1, 1, 0, 0), (0, 2, 0, 0), (0, 0, 2, 0), (0, 0, 1, 1), (0, 0, 0, 2)}
    assert ratios(1.507, 4) == [(3, 2)]
    assert ratios(2.48, 4) == [(5, 2), (10, 4)][:1]
    assert ratios(1.01, 2) == []


def test_only_a_libration_is_a_libration():
    times = np.linspace(0.0, 1000.0, 500)
    centre, amplitude, period = libration(3.0 + 1.2 * np.sin(2 * math.pi * times / 50), times)
    assert (centre, amplitude, period) == pytest.approx((3.0, 1.2, 50.0), rel=1e-3)
    assert libration(0.37 * times, times) is None  # circulates
    assert libration(2 * math.pi / 3 * np.arange(500), times) is None  # circulates in step with the frames
    assert libration(0.002 * times, times) is None  # slower than the series
    assert libration(0.002 * times + 0.05 * np.sin(times), times) is None


def test_pluto_librates_in_the_3_2_resonance_of_neptune(outer):
    """Cohen & Hubbard 1965, doi:10.1086/109674: about 180 degrees, with an amplitude near 76 and a period of 19,670
    years."""
    found = kd.analysis.orbit_report(outer)
    assert {(one.inner, one.outer, one.p, one.q) for one in found.resonances} == {("Neptune", "Pluto", 3, 2)}
    first = found.resonances[0]
    assert first.angle == "3 λ(Pluto) - 2 λ(Neptune) - ϖ(Pluto)"
    assert math.degrees(first.centre) == pytest.approx(180, abs=6)
    assert math.degrees(first.amplitude) == pytest.approx(80, abs=8)
    assert first.period == pytest.approx(19_800, rel=0.02)


def test_saturns_frequencies_are_la2004s_and_slow_ones_are_not_guessed(outer):
    found = kd.analysis.orbit_report(outer)
    arcsec = found.rate[0]
    assert found["Saturn"].g * arcsec == pytest.approx(28.2449, rel=0.01)
    assert found["Saturn"].s * arcsec == pytest.approx(-26.347855, rel=0.01)
    assert found["Jupiter"].s == 0.0
    assert found["Jupiter"].s_period == math.inf
    assert math.isnan(found["Neptune"].g)
    assert found.as_json()["bodies"][3]["g"] is None
    assert "secular period is longer than the run; run for about" in str(found)
    with pytest.raises(kd.InputError, match="no body 'Mars' in this report; expected one of Jupiter"):
        found["Mars"]
    with pytest.raises(kd.InputError, match="36 frames; frequencies need 64"):
        kd.analysis.orbit_report(outer, until="3.5 kyr")
    with pytest.raises(kd.InputError, match="until: expected a time, got nan"):
        kd.analysis.orbit_report(outer, until=math.nan)
    with kd.open(outer) as run:
        assert str(kd.analysis.orbit_report(run)) == str(found)


def test_a_run_back_in_time_is_analysed_too(tmp_path):
    path = tmp_path / "back.h5md"
    kd.Simulation(kd.load("outer-solar-system")).run(time=-YEARS, every=365, output=path)
    found = kd.analysis.orbit_report(path)
    assert found["Saturn"].g * found.rate[0] == pytest.approx(28.2449, rel=0.01)
    assert len(kd.analysis.orbit_report(path, until=-50_000.0).times) == 501


def test_the_command_prints_writes_and_draws(outer, tmp_path):
    runner = CliRunner()
    files = [str(tmp_path / name) for name in ("found.json", "found.png")]
    done = runner.invoke(app, ["analyze", str(outer), "--json", files[0], "--plot", files[1]])
    assert done.exit_code == 0, done.output
    assert "Proper frequencies" in done.output
    assert "Saturn" in done.output
    assert "3:2" in done.output
    content = json.loads((tmp_path / "found.json").read_text(encoding="utf-8"))
    assert content["resonances"][0]["outer"] == "Pluto"
    assert content["frames"] == 601
    assert (tmp_path / "found.png").stat().st_size > 20_000
    again = runner.invoke(app, ["analyze", str(outer), "--json", files[0]])
    assert isinstance(again.exception, kd.InputError)  # nothing is overwritten


@pytest.mark.parametrize(
    ("system", "given", "text"),
    [
        ("lj-1000", {"steps": 2, "every": 1}, "no gravity, so no orbits"),
        ("outer-solar-system", {"steps": 40, "every": 1}, "41 frames; frequencies need 64 or more: lower --every"),
        ("outer-solar-system", {"time": 1.4e6, "every": 70_000}, "74 frames are too few; the fastest secular period"),
        ("figure-eight", {"steps": 100, "every": 1}, "no body has 0.5 of all mass"),
    ],
)
def test_a_run_without_what_it_takes_is_one_line(tmp_path, system, given, text):
    path = tmp_path / "run.h5md"
    kd.Simulation(kd.load(system)).run(output=path, **given)
    with pytest.raises(kd.InputError, match=text):
        kd.analysis.orbit_report(path)


def test_uneven_frames_are_one_line(tmp_path):
    path = tmp_path / "run.h5md"
    sim = kd.Simulation(kd.load("outer-solar-system"))
    sim.run(200, every=1, output=path)
    with pytest.raises(kd.InputError, match="order must be a whole number"):
        kd.analysis.orbit_report(path, order=0)
    kd.Simulation(kd.load("sun-jupiter"), "gauss-radau15").run(time=200.0, output=path, overwrite=True)
    with pytest.raises(kd.InputError, match="not evenly spaced in time"):
        kd.analysis.orbit_report(path)

"""Variational equations against differences of runs, MEGNO and Lyapunov exponents against closed forms."""

from __future__ import annotations

import json
import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import kickdrift as kd
from kickdrift.analysis.chaos import megno as chaos
from kickdrift.analysis.chaos.megno import megno
from kickdrift.analysis.chaos.report import mean_megno, verdict
from kickdrift.analysis.tangents import deviations
from kickdrift.errors import InputError, RunError
from kickdrift.forces.bound.forces import BoundForces
from kickdrift.forces.slopes.variations import varied
from kickdrift_validation.problems import kepler

MASSES = np.array([0.6, 0.4])


def two_bodies(e: float) -> kd.System:
    """Two unequal masses on a Kepler ellipse, from pericentre; G = 1, semi-major axis 1."""
    r, v = kepler(0.0, e)
    shares = np.array([-MASSES[1], MASSES[0]])[:, None]
    return kd.System(shares * r, shares * v, masses=MASSES, forces=[kd.Gravity()], units="nbody")


def triangle() -> kd.System:
    """Lagrange's three equal masses on a circle of radius 1, with period 2 pi."""
    angle = 2 * math.pi * np.arange(3) / 3
    x = np.stack([np.cos(angle), np.sin(angle), 0 * angle], 1)
    v = np.stack([-np.sin(angle), np.cos(angle), 0 * angle], 1)
    return kd.System(x, v, masses=math.sqrt(3.0), forces=[kd.Gravity(G=1.0)], units="nbody")


def cloud(n: int = 11, forces=None, seed: int = 4, massless: int = 3, spread: float = 1.0) -> kd.System:
    rng = np.random.default_rng(seed)
    masses = rng.uniform(0.5, 1.5, n) / n
    masses[n - massless :] = 0.0
    x, v = rng.normal(size=(2, n, 3)) * np.array([spread, 0.5])[:, None, None]
    return kd.System(x, v, masses, forces=forces or [kd.Gravity(softening=0.2)], units="nbody")


def slopes(system: kd.System, deviations: np.ndarray) -> np.ndarray:
    """Change of the accelerations (3, n) along the deviations, by a five-point formula."""
    forces, h = BoundForces(system), 1e-3 / np.abs(deviations).max()
    phase = system.state.phase

    def there(k):
        return forces.measure(0.0, phase + k * h * deviations).accelerations

    return (8 * (there(1) - there(-1)) - (there(2) - there(-2))) / (12 * h)


@given(st.integers(0, 2**32 - 1), st.integers(2, 20), st.floats(1e-6, 1e6))
@settings(max_examples=30, deadline=None)
def test_variations_are_linear(seed, n, factor):
    system = cloud(n, [kd.Gravity(softening=0.3)], seed, massless=0)
    deviations = np.random.default_rng(seed).normal(size=(2, 2, 3, n))

    def variation(d):
        both = varied(system, d)
        return BoundForces(both).measure(0.0, both.state.phase).accelerations[:, n:]

    one, two = (variation(d) for d in deviations)
    together = variation(deviations[0] + factor * deviations[1])
    np.testing.assert_allclose(
        together, one + factor * two, rtol=0, atol=1e-12 * np.abs(one + factor * two).max() + 1e-13 * np.abs(one).max()
    )


def test_mean_megno_of_growth_in_closed_form():
    """ln d = lambda t gives Y = lambda t and <Y> = lambda t / 2; d = t gives Y = <Y> = 2; d constant gives 0."""
    t = np.linspace(0.0, 50.0, 5001)
    np.testing.assert_allclose(mean_megno(t, 0.3 * t), 0.15 * t, atol=1e-12)
    np.testing.assert_allclose(mean_megno(t, 0 * t + 2.0), 0.0, atol=1e-12)
    linear = np.log(np.maximum(t, 1e-3))
    assert mean_megno(t, linear)[-1] == pytest.approx(2.0, abs=0.01)


@pytest.mark.parametrize(
    ("found", "says"),
    [
        (2.0, "regular"),
        (1.91, "regular"),
        (2.11, "undecided"),
        (1.85, "undecided"),
        (4.0, "undecided"),
        (4.1, "chaotic"),
    ],
)
def test_verdict(found, says):
    assert verdict(found) == says


@pytest.mark.parametrize(("name", "dt"), [("velocity-verlet", 0.03), ("yoshida6", 0.1), ("dop853", None)])
@pytest.mark.parametrize("seed", [1, 2])
def test_keplers_orbit_is_regular(name, dt, seed):
    report = megno(two_bodies(0.3), 1500.0, name, dt, seed=seed)
    assert report.verdict == "regular"
    assert report.megno == pytest.approx(2.0, abs=0.05)
    assert abs(report.lyapunov) < 2e-4
    assert report.energy_error < 1e-3


@pytest.mark.parametrize(
    ("name", "dt"), [("velocity-verlet", 0.01), ("yoshida6", 0.05), ("dop853", None), ("gauss-radau15", None)]
)
def test_lagranges_triangle_is_as_unstable_as_in_closed_form(name, dt):
    """The exponents of small deviations are roots of s^4 + s^2 + 27/4 (m1 m2 + m2 m3 + m3 m1) / M^2 = 0 (Gascheau 1843;
    Routh 1875). For equal masses their real part is 1 / sqrt 2 of the angular velocity."""
    report = megno(triangle(), 28.0, name, dt)
    settled = (report.times > 10.0) & (report.times < 26.0)
    slope = np.polyfit(report.times[settled], report.growth[settled], 1)[0]
    assert slope == pytest.approx(1 / math.sqrt(2.0), rel=1e-3)
    assert report.lyapunov == pytest.approx(1 / math.sqrt(2.0), rel=0.02)
    assert report.lyapunov_error < 0.02
    assert report.verdict == "chaotic"  # the orbit itself is periodic, but a run of this length cannot tell


@pytest.mark.parametrize("name", ["wisdom-holman", "saba"])
def test_a_tangent_map_gives_the_same_verdict_and_growth(name):
    system = kd.load("two-planets")
    mapped, exact = megno(system, 2000.0, name, 0.1, seed=3), megno(system, 2000.0, "dop853", seed=3)
    assert mapped.verdict == exact.verdict == "regular"
    assert mapped.megno == pytest.approx(exact.megno, abs=2e-3)
    assert mapped.growth[-1] == pytest.approx(exact.growth[-1], abs=0.05)
    assert mapped.energy_error < 1e-7


def test_an_undecided_motion_says_how_much_longer_to_run():
    """The estimate is right where the answer is known: Kepler's orbit is regular, the triangle unstable."""
    for system, name, dt, time, expected in (
        (two_bodies(0.3), "yoshida6", 0.1, 30.0, "regular"),
        (triangle(), "yoshida6", 0.05, 7.5, "chaotic"),
    ):
        short = megno(system, time, name, dt)
        assert short.verdict == "undecided"
        assert time < short.time_to_decide < 20 * time
        assert short.bound >= abs(short.lyapunov)
        assert short.as_json()["time_to_decide"] == short.time_to_decide
        longer = megno(system, short.time_to_decide, name, dt)
        assert (longer.verdict, longer.time_to_decide) == (expected, None)


def test_an_undecided_exponent_has_no_sign(kickdrift):
    words = ("chaos", "sun-jupiter", "--integrator", "yoshida6", "--dt", 0.5, "--time", "90 yr")
    code, out, _ = kickdrift(*words)
    assert not code
    assert ": undecided over this length" in out
    assert "exponent below " in out
    assert "to decide         run about " in out
    assert " times as long: --time " in out


def test_scaling_back_changes_no_growth(monkeypatch):
    plain = megno(triangle(), 28.0, "yoshida6", 0.05)
    monkeypatch.setattr(chaos, "LARGEST", 4.0)
    scaled = megno(triangle(), 28.0, "yoshida6", 0.05)
    np.testing.assert_allclose(scaled.growth, plain.growth, rtol=1e-10, atol=1e-10)
    assert plain.growth[-1] > 15.0


def test_the_result_does_not_depend_on_units_and_little_on_looks(monkeypatch):
    """The same orbit in AU and years, in metres and seconds, and with a fifth of the looks."""
    AU, YEAR, SUN = 149597870700.0, 365.25 * 86400.0, 1.98840987e30
    masses = np.array([1.0, 1e-3])
    x, v = np.array([[0.0, 0, 0], [5.2, 0, 0]]), np.array([[0.0, 0, 0], [0.0, 2.9, 0]])
    G = kd.System(x, masses=masses, forces=[kd.Gravity()], units="astro").units.gravity
    astro = kd.System(x, v, masses, forces=[kd.Gravity(G)], units="astro")
    si = kd.System(x * AU, v * AU / YEAR, masses * SUN, forces=[kd.Gravity(G * AU**3 / YEAR**2 / SUN)], units="si")
    reports = [megno(astro, 1000.0, "yoshida4", 0.1), megno(si, 1000.0 * YEAR, "yoshida4", 0.1 * YEAR)]
    assert reports[1].megno == pytest.approx(reports[0].megno, rel=1e-6)
    monkeypatch.setattr(deviations, "LOOKS", 2000)
    assert megno(astro, 1000.0, "yoshida4", 0.1).megno == pytest.approx(reports[0].megno, abs=0.02)


def test_a_seed_is_a_deviation():
    reports = [megno(two_bodies(0.3), 100.0, "yoshida4", 0.05, seed=seed) for seed in (3, 3, 4)]
    np.testing.assert_array_equal(reports[0].growth, reports[1].growth)
    assert not np.array_equal(reports[0].growth, reports[2].growth)


def test_defaults_are_the_files(monkeypatch):
    run = {"steps": 500, "dt": 0.05}
    for named, used, dt in (("yoshida4", "yoshida4", 0.05), ("hermite4", "dop853", None), (None, "dop853", None)):
        system = two_bodies(0.3)
        defaults = type(system.run)(integrator=named, **run)
        report = megno(kd.System(*_parts(system), forces=system.forces, units="nbody", run=defaults))
        assert (report.integrator, report.dt) == (used, dt)
        assert report.time == pytest.approx(25.0, rel=0.05)


def _parts(system):
    return system.state.positions, system.state.velocities, system.state.masses


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"time": None}, "time: system 'system' has no time in [run]; give a time"),
        ({"time": -1.0}, "time must be a positive finite time, got -1.0"),
        ({"time": math.inf}, "time must be a positive finite time, got inf"),
        ({"seed": -1}, "seed: expected a whole number, zero or more, got -1"),
        ({"integrator": "hermite4"}, "integrator: hermite4 carries no variations; dop853 does, and yoshida6"),
        ({"integrator": "leapfrog-exact"}, "integrator: leapfrog-exact carries no variations"),
        ({"integrator": "velocity-verlet"}, "dt is needed"),
        ({"integrator": "rk-4"}, "rk-4 is 'rk4' here"),
        ({"integrator": "yoshida4", "dt": 1.0, "time": 2.0}, "time: 2 steps are too few to measure growth"),
    ],
)
def test_what_makes_no_sense_is_said(options, message):
    with pytest.raises(InputError) as caught:
        megno(two_bodies(0.3), **{"time": 10.0, **options})
    assert message in str(caught.value)


def test_another_object_and_a_blow_up_are_said():
    with pytest.raises(InputError, match="megno: takes a System or a Problem, got str"):
        megno("ode-kepler")
    with pytest.raises(RunError, match=r"velocity-verlet, dt = 10: blew up at step \d+ .*particle [01]"):
        megno(
            kd.System(np.eye(2, 3), masses=1.0, forces=[kd.HarmonicTrap(stiffness=9.0)], units="nbody"),
            1e6,
            "velocity-verlet",
            10.0,
        )


def test_command(tmp_path, kickdrift):
    file = tmp_path / "chaos.json"
    words = ["chaos", "two-body", "--integrator", "yoshida4", "--dt", 0.05, "--time", 400, "--json", file]
    code, out, err = kickdrift(*words)
    assert (code or 0, err) == (0, "")
    assert "MEGNO" in out
    assert ": regular over this length" in out
    found = json.loads(file.read_text())
    assert {"system", "integrator", "megno", "verdict", "lyapunov", "lyapunov_error", "times", "means"} <= set(found)
    assert len(found["times"]) == len(found["means"]) <= 500
    assert found["means"][-1] == found["megno"]
    refused = ("chaos", "lj-1000", "--integrator", "hermite4")
    for asked, said in ((words, "exists already"), (refused, "carries no variations")):
        code, _, err = kickdrift(*asked)
        assert code == 2
        assert said in err

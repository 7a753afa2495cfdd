"""Work of body laws: the energy of a run less this work is conserved, in memory, in a file and after a restart."""

from __future__ import annotations

import math

import numpy as np
import pytest

import kickdrift as kd
from kickdrift.run.report.energy import FEWER, POINTS, column_names, cumulative


def two_bodies(*forces, e=0.3, masses=(0.9, 0.1)):
    speed = math.sqrt((1 + e) / (1 - e))
    x, v = np.array([[0.0, 0, 0], [1 - e, 0, 0]]), np.array([[0.0, 0, 0], [0, speed, 0]])
    m = np.array(masses)[:, None]
    return kd.System(
        x - (m * x).sum(axis=0), v - (m * v).sum(axis=0), masses, forces=[kd.Gravity(), *forces], units="nbody"
    )


@pytest.mark.parametrize("points", [2, FEWER, POINTS])
def test_the_integral_of_a_polynomial_is_exact(points):
    rng = np.random.default_rng(3)
    times = np.cumsum(rng.uniform(0.5, 1.5, 40)) - 7.0
    law = np.polynomial.Polynomial(rng.normal(size=points), window=(-1, 1), domain=(times[0], times[-1]))
    whole = law.integ()
    found = cumulative(times, law(times), points)
    np.testing.assert_allclose(found, whole(times) - whole(times[0]), atol=1e-11 * np.abs(whole(times)).max())


def test_few_times():
    assert cumulative(np.array([0.0, 2.0]), np.array([1.0, 3.0]), POINTS).tolist() == [0.0, pytest.approx(4.0)]


@pytest.mark.parametrize(
    "force",
    [
        kd.Tides(0.3, 0.1, 0.01, (0, 0, 0.5)),
        kd.RadiationReaction(c=20.0),
        kd.Migration(1000.0),
        kd.MassChange(-1e-3),
        kd.RadiationPressure([0.0, 1e-3], c=20.0),
    ],
    ids=lambda force: force.name,
)
def test_energy_less_work_is_conserved(force):
    report = kd.Simulation(two_bodies(force), "gauss-radau15").run(until=20.0, interval=0.05)
    energy = report.energy
    change, taken = energy.final - energy.initial, energy.work[force.name]
    assert abs(change) > 3e-6 * abs(energy.initial)
    assert change == pytest.approx(taken, rel=1e-6)
    assert energy.max_relative_error < 1e-11
    assert not energy.verdict.startswith("not conserved")
    assert f"by {force.name}" in str(report)
    assert report.as_json()["energy"]["work"] == energy.work


def test_two_forces_are_told_apart():
    both = [kd.RadiationReaction(c=20.0), kd.Tides(0.3, 0.1, 0.01, (0, 0, 0.5))]
    whole = kd.Simulation(two_bodies(*both), "gauss-radau15").run(until=10.0, interval=0.05).energy
    alone = [
        kd.Simulation(two_bodies(force), "gauss-radau15").run(until=10.0, interval=0.05).energy.work[force.name]
        for force in both
    ]
    assert list(whole.work.values()) == pytest.approx(alone, rel=1e-3)
    assert whole.max_relative_error < 1e-11


def test_looks_too_far_apart():
    report = kd.Simulation(two_bodies(kd.RadiationReaction(c=20.0)), "gauss-radau15").run(until=60.0, interval=2.5)
    assert report.energy.verdict == "not conserved: relativity-2.5pn"
    assert "look more often to count it" in str(report)


def test_drag_is_not_counted():
    system = two_bodies(kd.Migration(1000.0), kd.LinearDrag(1e-4))
    report = kd.Simulation(system, "gauss-radau15").run(until=5.0, interval=0.05)
    assert report.energy.verdict == "not conserved: linear-drag"
    assert list(report.energy.work) == ["migration"]


def test_a_file_and_a_restart(tmp_path):
    path, force = tmp_path / "run.h5md", kd.Tides(0.3, 0.1, 0.01, (0, 0, 0.5))
    kd.Simulation(two_bodies(force), "gauss-radau15").run(until=5.0, interval=0.05, output=path)
    whole = kd.resume(path).run(until=10.0)
    straight = kd.Simulation(two_bodies(force), "gauss-radau15").run(until=10.0, interval=0.05)
    assert whole.energy.work["tides"] == pytest.approx(straight.energy.work["tides"], rel=1e-9)
    with kd.open(path) as run:
        power, _ = (run.observables[name] for name in column_names("tides"))
        assert run.columns["power_tides"] == ((), "energy/time")
        assert power.shape == run.observables["total_energy"].shape
        assert np.isfinite(power).all()


def test_a_body_that_leaves():
    """The work goes on with the bodies that are left."""
    system = kd.System(
        [[0, 0, 0], [1, 0, 0], [3, 0, 0]], [[0, 0, 0], [0, 1, 0], [3, 0, 0]], [1.0, 1e-3, 1e-3],
        forces=[kd.Gravity(), kd.Migration(500.0)], units="nbody", events=[kd.Escape(5.0, action="remove")],
    )  # fmt: skip
    report = kd.Simulation(system, "gauss-radau15").run(until=6.0, interval=0.05)
    assert report.events
    assert math.isfinite(report.energy.work["migration"])

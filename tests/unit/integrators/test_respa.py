"""Multiple time steps: words that kick by groups of forces."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import kickdrift as kd
from kickdrift.integrators import INTEGRATORS
from kickdrift.integrators.splitting.subflows import letters_of, nested

STIFF = """
units = "lj"
[particles]
positions = [[0.0, 0.0, 0.0], [1.1, 0.0, 0.0], [3.0, 1.0, 0.0]]
[velocities]
values = [[0.1, -0.2, 0.1], [0.0, 0.1, -0.1], [-0.1, 0.1, 0.05]]
[[force]]
type = "springs"
pairs = [[0, 1]]
stiffness = 900.0
length = 1.0
[[force]]
type = "harmonic-trap"
stiffness = 1.0
group = 1
[run]
integrator = "respa"
dt = 0.02
"""


@pytest.fixture
def system(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "stiff.toml").write_text(STIFF, encoding="utf-8")
    return kd.load("stiff.toml")


def fast(x):
    """Acceleration by the spring between the first two particles."""
    a, d = np.zeros_like(x), x[1] - x[0]
    r = np.linalg.norm(d)
    a[0] = 900.0 * (r - 1.0) * d / r
    a[1] = -a[0]
    return a


def plain(x, v, dt, steps, substeps):
    """Tuckerman, Berne & Martyna 1992, eq. 2.21, in NumPy."""
    for _ in range(steps):
        v = v - dt / 2 * x
        for _ in range(substeps):
            v = v + dt / substeps / 2 * fast(x)
            x = x + dt / substeps * v
            v = v + dt / substeps / 2 * fast(x)
        v = v - dt / 2 * x
    return x, v


@pytest.mark.parametrize("substeps", [1, 4, 7])
def test_steps_are_those_of_the_paper(system, substeps):
    sim = kd.Simulation(system, substeps=substeps)
    sim.run(100)
    x, v = plain(system.state.positions, system.state.velocities, 0.02, 100, substeps)
    np.testing.assert_allclose(sim.state.positions, x, rtol=0, atol=1e-12)
    np.testing.assert_allclose(sim.state.velocities, v, rtol=0, atol=1e-10)


def test_the_order_is_two(system):
    exact = kd.Simulation(system, "yoshida8", dt=0.001)
    exact.run(until=2.0)
    errors = []
    for dt in (0.02, 0.01, 0.005):
        sim = kd.Simulation(system, dt=dt, substeps=16)
        sim.run(until=2.0)
        errors.append(np.abs(sim.state.positions - exact.state.positions).max())
    assert np.diff(np.log2(errors)) == pytest.approx([-2, -2], abs=0.1)


def test_slow_forces_are_evaluated_once_a_step(system):
    report = kd.Simulation(system, substeps=8).run(100)
    assert report.force_evaluations == 900 + 2


def test_a_run_comes_back(system):
    sim = kd.Simulation(system)
    sim.run(200)
    back = kd.Simulation(system.at(sim.state.phase * np.array([1.0, -1.0])[:, None, None], 0.0))
    back.run(200)
    np.testing.assert_allclose(back.state.positions, system.state.positions, rtol=0, atol=1e-12)


@pytest.mark.parametrize("method", ["respa", "respa-baoab"])
def test_a_restart_has_the_same_bits(system, method):
    options = {} if method == "respa" else {"temperature": 1.0, "friction": 1.0, "seed": 3}
    whole, pieces = (kd.Simulation(system, method, **options) for _ in range(2))
    whole.run(100)
    pieces.run(37)
    pieces.run(13, every=1, output="run.h5md")
    resumed = kd.resume("run.h5md")
    assert [force.group for force in resumed.system.forces] == [0, 1]
    resumed.run(50)
    assert np.array_equal(resumed.state.phase, whole.state.phase)


def test_a_users_word_is_the_shipped_method(system):
    kd.register_splitting("twice", word="B1 (B0 A B0)4 B1", order=2, source="here", check_order=True)
    try:
        mine, shipped = kd.Simulation(system, "twice"), kd.Simulation(system, "respa")
        mine.run(50)
        shipped.run(50)
        assert np.array_equal(mine.state.phase, shipped.state.phase)
    finally:
        from kickdrift.integrators.own.registration import unregister

        unregister("twice")


def test_three_groups_nest():
    found = " ".join(letters_of("x", nested("BAB", 2, 3)))
    assert found == "B2 B1 B0 A B0 B0 A B0 B1 B1 B0 A B0 B0 A B0 B1 B2"
    row = INTEGRATORS["respa"]
    assert row.stages[0] == pytest.approx([0.5, 0.125, 0.25, 0.25, 0.25, 0.125, 0.5])
    assert row.kick_groups.tolist() == [1, 0, 0, 0, 0, 0, 1]
    assert row.symplectic
    assert row.reversible
    assert row.ends_fresh


def test_forces_in_three_groups_run(system):
    three = system.remade(forces=[*system.forces, kd.UniformField((0.1, 0.0, 0.0), group=2)])
    report = kd.Simulation(three, dt=0.01, substeps=2).run(10)
    assert report.force_evaluations == 10 * (1 + 2 + 4) + 3


@pytest.mark.parametrize(
    ("word", "told"),
    [
        ("B1 B", "either by all forces, B, or by groups"),
        ("B2 B0 A", "by group 2, and not by group 1"),
        ("(BAB", "does not close a bracket"),
        ("BAB)2", "closes a bracket that is not open"),
        ("XA", "no flow has the letter 'X'"),
        ("A1 B", "only kicks have groups of forces"),
        ("B9 A", "groups of forces are 0 to 7"),
        ("B-A", "a word is letters such as BAB"),
    ],
)
def test_words_that_make_no_sense_are_refused(word, told):
    with pytest.raises(kd.InputError, match="mine: ") as caught:
        kd.register_splitting("mine", word=word, order=2, source="here")
    assert told in str(caught.value)


def test_a_group_without_kicks_is_refused(system):
    kd.register_splitting("twice", word="B1 B0 A B0 B1", order=2, source="here", overwrite=True)
    three = system.remade(forces=[*system.forces, kd.UniformField((0.1, 0.0, 0.0), group=2)])
    try:
        with pytest.raises(kd.InputError, match="kicks by groups 0 to 1, and force uniform-field has group = 2"):
            kd.Simulation(three, "twice", dt=0.01).run(1)
    finally:
        from kickdrift.integrators.own.registration import unregister

        unregister("twice")
    with pytest.raises(kd.InputError, match="force harmonic-trap: group must be a whole number"):
        kd.Simulation(system.remade(forces=[kd.HarmonicTrap(1.0, group=-1)]), dt=0.01).run(1)


def test_forces_of_one_group_are_told(system):
    report = kd.Simulation(system.remade(forces=[kd.HarmonicTrap(1.0)]), dt=0.01).run(1)
    assert any("no force has group = 1, so its kicks do nothing" in line for line in report.warnings)


def test_a_system_file_keeps_the_group(system):
    assert [force.group for force in system.forces] == [0, 1]
    Path("again.toml").write_text(system.to_toml(), encoding="utf-8")
    assert kd.load("again.toml").forces == system.forces

"""What a report adds for people: where the time went, what a drift means, and that a lattice is melting."""

from dataclasses import asdict, replace
from types import SimpleNamespace

import numpy as np
import pytest

import kickdrift as kd
from kickdrift.looks.columns import TOTAL
from kickdrift.run.report.energy import EnergyReport
from kickdrift.run.report.shown import took_text
from kickdrift.run.report.warnings import has_melted, lattice_spacing, temperature_change
from tests.systems import liquid


def test_the_parts_of_the_time_add_up(tmp_path):
    sim = kd.Simulation(liquid(), dt=0.004)
    seen = []
    report = sim.run(40, every=2, output=tmp_path / "run.h5md", observe=lambda sim: seen.append(sim.time))
    assert list(report.seconds) == ["stepping", "looks", "writing", "observing", "compiling"]
    assert all(seconds >= 0 for seconds in report.seconds.values())
    assert report.seconds["stepping"] + report.seconds["looks"] > 0
    assert report.seconds["writing"] > 0
    assert report.seconds["compiling"] == report.compile_seconds
    assert len(seen) == report.samples


def test_looks_of_compiled_code_count_as_stepping():
    report = kd.Simulation(liquid(), dt=0.004).run(400, every=2)
    assert report.seconds["looks"] is None
    assert report.seconds["stepping"] > 0


@pytest.mark.parametrize(
    ("seconds", "text"),
    [
        ({"stepping": 0.9, "looks": 0.1, "writing": 0.3, "observing": 0.0, "compiling": 0.1},
         "1.4 s: stepping 0.9, 1001 looks 0.1, writing 0.3, compiling 0.1"),
        ({"stepping": 250.3, "looks": None, "writing": 0.0, "observing": 3.0, "compiling": 0.1},
         "253 s: stepping and 1001 looks 250, observing 3"),
    ],
)  # fmt: skip
def test_the_line_about_the_time(seconds, text):
    assert took_text(SimpleNamespace(seconds=seconds, samples=1001)) == text


def test_nanoseconds_per_pair_need_a_pair_list():
    assert kd.Simulation(liquid(), dt=0.004).run(10).ns_per_pair > 0
    assert kd.Simulation(kd.load("two-body")).run(10).ns_per_pair is None


@pytest.mark.parametrize(
    ("truncation", "ending"),
    [
        ("shift", "; the force jumps at the cutoff, see lj-1000-switch"),
        ("switch", "; a shorter dt tells whether the step is too long"),
    ],
)
def test_a_drift_names_its_size_over_the_run_and_its_cause(truncation, ending):
    system = kd.System([[0.0, 0.0, 0.0], [1.1, 0.0, 0.0]], forces=[kd.LennardJones(truncation=truncation)])
    report = kd.Simulation(system, dt=0.001).run(10)
    slope = {"drift_per_unit_time": -1.6e-7, "drift_error": 1e-9, "relative_to": "initial energy"}

    def line(verdict):
        told = replace(
            report, time=500.0, energy=EnergyReport(**{**asdict(report.energy), **slope, "verdict": verdict})
        )
        return next(line for line in str(told).splitlines() if line.startswith("energy drift"))

    assert line("secular drift").endswith(f"secular drift, 8e-05 of the energy over this run{ending}")
    assert line("bounded").endswith(": bounded")


def test_a_drift_below_a_hundred_roundings_is_round_off():
    """A free particle whose energy is given 90 roundings of drift, with other roundings on top, and then 1000."""
    system = kd.System([[0.0, 0.0, 0.0]], [[1.0, 0.0, 0.0]], forces=[kd.UniformField((0.0, 0.0, 0.0))], units="nbody")
    sim = kd.Simulation(system, dt=0.01)
    sim.run(100, every=1)
    rows = sim.record.looks.rows[: len(sim.record.samples)]
    steps = np.arange(len(rows))
    rows[:, TOTAL] = 0.5 * (1.0 + 2.0**-52 * (0.95 * steps + np.where(steps % 100, 0.0, 8.0 * np.sign(steps - 50))))
    assert sim.report().energy.verdict == "round-off"
    rows[:, TOTAL] = 0.5 * (1.0 + 2.0**-52 * 10.0 * steps)
    assert sim.report().energy.verdict == "secular drift"


def test_the_shipped_lattice_melts_and_the_run_says_so():
    report = kd.Simulation(kd.load("lj-1000")).run(1500, every=10)
    assert [line for line in report.warnings if line.startswith("the lattice is melting: the temperature falls from")]


def test_a_melt_and_a_crystal_need_no_word():
    system = kd.load("lj-1000")
    sim = kd.Simulation(system)
    sim.equilibrate(1.33, 2.0)
    assert sim.run(500, every=10).warnings == []
    assert lattice_spacing(system) == pytest.approx(0.8442 ** (-1 / 3))
    assert lattice_spacing(liquid()) is None
    assert not has_melted(system, system.state.positions + np.array([5.0, 0.0, 0.0]))


def test_a_change_of_temperature_is_more_than_fluctuations():
    rng = np.random.default_rng(1)
    steady = 1.3 + 0.02 * rng.normal(size=400)
    assert temperature_change(steady) is None
    assert temperature_change(np.concatenate([[1.6], steady])) == (1.6, pytest.approx(1.3, abs=0.01))
    assert temperature_change(None) is None
    assert temperature_change(np.array([1.6, 1.3])) is None


def pair(**options):
    return kd.LennardJones(**options)


def test_a_cutoff_in_the_minimum_makes_no_jump():
    """The force of Weeks, Chandler and Andersen ends at zero, whatever the truncation says."""
    bottom = 2.0 ** (1 / 6)
    assert not pair(cutoff=bottom, truncation="shift").jumps_at_cutoff(["A"])
    assert not pair(cutoff=1.12246, truncation="shift").jumps_at_cutoff(["A"])
    assert pair(cutoff=2.5, truncation="shift").jumps_at_cutoff(["A"])
    assert pair(cutoff=2.5, truncation="cut").jumps_at_cutoff(["A"])
    assert not pair(cutoff=2.5, truncation="force-shift").jumps_at_cutoff(["A"])
    two = {"A": {"epsilon": 1.0, "sigma": 1.0}, "B": {"epsilon": 1.0, "sigma": 0.8}}
    assert pair(cutoff=bottom, truncation="shift", species=two).jumps_at_cutoff(["A", "B"])


def test_a_bath_that_cools_is_no_melting():
    report = kd.Simulation(kd.load("lj-1000"), "csvr", temperature=0.9, tau=0.1).run(400, every=10)
    (said,) = (line for line in report.warnings if "lattice" in line)
    assert said.startswith("the run starts from a lattice, which it leaves while the bath brings 1.44 to 0.")
    assert "equilibrate first" in said


def test_the_rigid_bonds_of_a_liquid_are_no_lattice():
    assert lattice_spacing(kd.load("water-512")) is None
    assert lattice_spacing(kd.load("rock-salt")) == pytest.approx(2.89, rel=1e-3)  # of two species


def test_no_word_on_a_lattice_after_an_equilibration():
    """The run below begins as a liquid far from its temperature."""
    sim = kd.Simulation(kd.load("lj-1000"))
    sim.equilibrate(3.0, steps=300)
    state = sim.state
    sim.state = kd.State(np.stack([state.phase[0], 0.4 * state.phase[1]]), state.masses, state.ids, state.box)
    report = sim.run(300, every=5)
    assert temperature_change(sim.record.series().temperatures) is not None
    assert has_melted(sim.system, sim.state.positions)
    assert not [line for line in report.warnings if "lattice" in line]


def test_a_verdict_on_slow_velocities_says_whose_error_it_is():
    found = kd.Simulation(liquid(), "baoab", dt=0.004, temperature=1.0, friction=1.0).run(3000, every=10)
    cold = replace(found, temperature=0.9 * found.options["temperature"])
    assert "; a long step makes velocities of this bath too slow, and configurations" in cold.temperature_verdict
    warm = replace(found, temperature=1.5)
    assert warm.temperature_verdict.endswith("standard errors")

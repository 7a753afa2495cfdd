"""Runs with a heat bath: report, equilibration, warnings, refusals, and noise of the members of an ensemble."""

from __future__ import annotations

import numpy as np
import pytest

import kickdrift as kd
from kickdrift.batch import Batch
from kickdrift.ensemble.recipe import Recipe, SystemMaker
from kickdrift.errors import InputError
from kickdrift.looks.report_lines import mean_text
from kickdrift.model.units.quantities import FAMILIAR, quantity, unit_system
from tests.systems import liquid, needed

AT_REST = {
    "units": "lj", "particles": {"positions": [[0, 0, 0], [1.2, 0, 0], [0, 1.2, 0]]},
    "force": [{"type": "lennard-jones", "cutoff": 3.0, "truncation": "shift"}],
    "run": {"integrator": "langevin", "temperature": 1.0, "friction": 1.0, "dt": 0.005},
}  # fmt: skip


def lines_of(report):
    return {line[:17].strip(): line[18:] for line in str(report).splitlines()}


@pytest.fixture(scope="module")
def bathed():
    """A Simulation in a strong bath from equilibrium, and its report."""
    sim = kd.Simulation(liquid(64, 2.0), "baoab", 0.004, temperature=1.5, friction=10.0)
    sim.equilibrate(1.5, 4.0)
    return sim, sim.run(4000, every=10)


def test_report_tells_the_heat_and_what_is_conserved(bathed):
    sim, report = bathed
    assert report.heat == sim.integration.stepper.heat != 0
    assert report.energy_taken is None
    change = report.energy.final - report.energy.initial
    assert change == pytest.approx(report.heat, abs=3 * report.energy.max_relative_error * abs(report.energy.initial))
    lines = lines_of(report)
    assert lines["heat"] == f"{report.heat:.8g} ε from the heat bath"
    assert lines["energy error"].endswith("of initial energy (energy less heat)")
    assert lines["energy drift"].endswith("(energy less heat)")
    assert "heat" not in lines_of(kd.Simulation(liquid(64, 2.0), dt=0.004).run(10))


def test_temperature_has_an_error_and_a_verdict(bathed):
    sim, report = bathed
    found = [sample.temperature for sample in sim.record.samples]
    assert report.temperature_error >= np.std(found, ddof=1) / np.sqrt(len(found)) * 0.9
    assert 0 < report.temperature_error < 0.1
    assert report.temperature_verdict == "agrees"
    assert report.as_json()["temperature_verdict"] == "agrees"
    assert report.as_json()["pressure_error"] == report.pressure_error > 0
    assert "± " in lines_of(report)["temperature"]
    assert lines_of(report)["temperature"].endswith("(mean), asked 1.5 ε/k_B: agrees")


@pytest.mark.parametrize("name", ["baoab", "csvr", "nose-hoover"])
def test_a_field_leaves_no_momentum_conserved(name):
    """In a trap all 3 N velocities are free, for every bath, and the temperature is defined."""
    rng = np.random.default_rng(4)
    trap = kd.System(rng.normal(size=(3, 3)), rng.normal(size=(3, 3)), forces=[kd.HarmonicTrap(1.0)], units="lj")
    sim = kd.Simulation(trap, name, 0.05, **needed(name))
    report = sim.run(10)
    first = sim.record.samples[0]
    assert first.temperature == pytest.approx(2 * first.energies.kinetic / 9)
    assert report.momentum_error is None


def test_a_wrong_temperature_differs_and_a_short_run_says_nothing():
    """Before equilibrium the mean is far from the bath's temperature."""
    x = np.random.default_rng(2).normal(size=(200, 3))
    trap = kd.System(x, np.zeros((200, 3)), forces=[kd.HarmonicTrap(1.0)], units="lj")
    report = kd.Simulation(trap, "baoab", 1.9, temperature=1.0, friction=1.0).run(4000, every=1)
    assert report.temperature_verdict.startswith("differs by ")  # too long a step: the velocities are too slow
    assert report.temperature_verdict.endswith(
        " standard errors; a long step makes velocities of this bath too slow, and configurations hardly at all"
    )
    assert "friction = 1 times dt is 1.9; use 0.5 or less" in report.warnings
    short = kd.Simulation(trap, "baoab", 0.1, temperature=1.0, friction=1.0).run(3)
    assert short.temperature_verdict == "too short to judge"
    assert short.temperature_error is None
    assert not short.warnings


def test_errors_without_a_bath():
    sim = kd.Simulation(liquid(64, 2.0), dt=0.004)
    sim.advance(500)
    report = sim.run(4000, every=10)
    assert report.temperature_verdict is report.heat is None
    assert lines_of(report)["temperature"].endswith("(mean)")
    assert 0 < report.temperature_error < 0.05
    assert 0 < report.pressure_error < 0.5


def test_equilibration_in_the_bath():
    """The bath acts, step 0 begins anew, and the run has other noise than the equilibration."""
    system = liquid(64, 2.0)
    sim = kd.Simulation(system, "csvr", 0.004, temperature=3.0, tau=0.05)
    told = []
    sim.equilibrate(3.0, 1.0, progress=lambda done, of: told.append((done, of)))
    assert told[-1] == (250, 250)
    assert (sim.steps_done, sim.time, sim.integration.stepper.heat) == (0, 0.0, 0.0)
    assert sim.energy().kinetic == pytest.approx(1.5 * 3.0 * 63, rel=0.35)
    free = kd.System(np.eye(3) * 5, np.zeros((3, 3)), units="lj")
    first, second = (kd.Simulation(free, "baoab", 0.01, temperature=1.0, friction=1e3) for _ in range(2))
    first.equilibrate(1.0, 0.05)
    first.advance(5)
    second.advance(5)
    equilibrated = kd.Simulation(free, "baoab", 0.01, temperature=1.0, friction=1e3)
    equilibrated.equilibrate(1.0, 0.05)
    assert (
        np.abs(equilibrated.state.velocities - second.state.velocities).min() > 1e-3
    )  # friction forgets all but noise
    assert np.allclose(first.state.velocities, second.state.velocities, atol=0.02)
    with pytest.raises(InputError, match=r"^equilibrate: temperature = 2 is not the heat bath's temperature = 3; csvr"):
        sim.equilibrate(2.0, 1.0)


@pytest.mark.parametrize(
    ("name", "options", "line"),
    [
        ("csvr", {"tau": 0.02}, "tau = 0.02 is 4 steps; use 10 steps or more"),
        ("nose-hoover", {"tau": 0.04}, "tau = 0.04 is 8 steps; use 10 steps or more"),
        ("andersen", {"collision_rate": 120.0}, "collision_rate = 120 times dt is 0.6; use 0.5 or less"),
    ],
)
def test_baths_that_are_too_strong_for_the_step_warn(name, options, line):
    report = kd.Simulation(liquid(64, 2.0), name, 0.005, **{**needed(name), **options}).run(2)
    assert report.warnings == [line]


def test_what_has_no_bath_refuses_in_one_line():
    system = liquid(64, 2.0)
    with pytest.raises(InputError, match=r"; methods with a heat bath are baoab, csvr and nose-hoover$"):
        kd.Simulation(system, "velocity-verlet", 0.004, temperature=1.0)
    with pytest.raises(InputError, match=r"^csvr: compare couples paths by noise = refine, and csvr does not take it"):
        kd.compare(system, [kd.integrator("csvr", temperature=1.0, tau=1.0)])
    with pytest.raises(InputError, match=r"^integrator: csvr carries no variations"):
        kd.megno(kd.load("sun-jupiter"), 1.0, "csvr", temperature=1.0, tau=1.0)
    with pytest.raises(InputError, match="engine 'rebound': integrator 'baoab': rebound has leapfrog-dkd"):
        kd.Simulation(system, "baoab", 0.004, engine="rebound", temperature=1.0, friction=1.0)
    with pytest.raises(InputError, match="baoab moves one system at a time"):
        Batch([kd.load("sun-jupiter")], "baoab", dt=1.0, temperature=1.0, friction=1.0)
    trap = kd.System(np.eye(3), np.zeros((3, 3)), radii=0.1, forces=[kd.HarmonicTrap(1.0)], units="lj")
    with pytest.raises(InputError, match=r"^events: baoab has a heat bath"):
        kd.Simulation(trap, "baoab", 0.004, events=[kd.CloseApproach(0.5)], temperature=1.0, friction=1.0)


def test_every_member_of_an_ensemble_has_its_own_noise():
    recipe = Recipe(SystemMaker("atoms", kd.load(AT_REST)))
    assert recipe.drawn
    assert not Recipe(SystemMaker("atoms", kd.load(AT_REST)), {"integrator": "velocity-verlet"}).drawn
    assert not Recipe(SystemMaker("atoms", kd.load(AT_REST)), {"seed": 3}).drawn
    seeds = [recipe.subject.system({}, seed).run.options.get("seed") for seed in (5, 6)]
    assert seeds == [5, 6]
    assert kd.load(AT_REST, 7).seed == 7  # no warning: the noise takes the seed


def test_files_tell_the_heat(tmp_path):
    """A file's overview shows the heat and the verdict; without a report, the heat comes from the samples."""
    sim = kd.Simulation(liquid(64, 2.0), "baoab", 0.004, temperature=1.5, friction=10.0)
    report = sim.run(2000, every=5, output=tmp_path / "whole.h5md")
    with kd.open(tmp_path / "whole.h5md") as run:
        lines = lines_of(run)
        assert run.observables["energy_taken"][-1] == -report.heat
        assert np.ptp(run.observables["total_energy"] + run.observables["energy_taken"]) < 1.0
    assert lines["heat"] == f"{report.heat:.8g} ε from the heat bath"
    assert lines["energy drift"].endswith("(energy less heat)")
    assert lines["temperature"] == lines_of(report)["temperature"]

    def stop(sim):
        if sim.steps_done == 1000:
            raise RuntimeError("stopped")

    sim = kd.Simulation(liquid(64, 2.0), "baoab", 0.004, temperature=1.5, friction=10.0)
    with pytest.raises(RuntimeError, match="stopped"):
        sim.run(2000, every=5, output=tmp_path / "part.h5md", observe=stop)
    with kd.open(tmp_path / "part.h5md") as run:
        lines = lines_of(run)
        heat = -run.observables["energy_taken"][-1]
        first, last = run.observables["total_energy"][[0, -1]]
    assert lines["heat"] == f"{heat:.8g} ε from the heat bath"
    assert lines["energy"] == f"{first:.8g} at the start, {last:.8g} ε at the end"
    assert "momentum error" not in lines


@pytest.mark.parametrize("name", ["metal", "real", "gromacs"])
def test_the_familiar_pressure_is_that_of_unit_conversion(name):
    units = unit_system(name)
    scale, familiar = FAMILIAR[f"{units.energy}/{units.length}^3"]
    assert familiar == "bar"
    assert 1 / quantity("1 bar", "pressure", units) == pytest.approx(scale, rel=1e-12)


@pytest.mark.parametrize(
    ("mean", "error", "text"),
    [
        (2.584e-4, 1.2e-5, "0.000258 ± 0.000012 eV/angstrom^3 = 414 ± 19 bar (mean)"),
        (0.0624150907446, None, "0.062415 eV/angstrom^3 = 10 GPa (mean)"),
    ],
)
def test_pressures_have_bar_or_gigapascal_beside_them(mean, error, text):
    """1 eV/angstrom^3 is 160.2176634 GPa, by the exact charge of the electron."""
    assert mean_text(mean, error, "eV/angstrom^3") == text

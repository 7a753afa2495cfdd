"""Checks of ensembles: clean runs pass, planted faults fail, and bad input ends in one line."""

from __future__ import annotations

import json
import math
import sys
from dataclasses import replace
from unittest.mock import patch

import numpy as np
import pytest
from scipy import stats

import kickdrift as kd
from kickdrift.analysis import ensemble_checks
from kickdrift.analysis.certify import canonical
from kickdrift.analysis.certify.canonical import Point, distribution, independent, mean_and_width, ratio
from kickdrift.analysis.certify.certifying import checked, engine_checks
from kickdrift.analysis.certify.sampled_run import SampledRun, kinetic_groups, sampled_run
from kickdrift.errors import InputError
from kickdrift.integrators.splitting.baths import velocity_noise
from tests.refusals import assert_refused
from tests.systems import liquid

N, STEPS, EVERY = 27, 36_000, 20


def fluid():
    """Lennard-Jones particles at a density of 0.7, where energies change fast."""
    dense = liquid(N, 1.5)
    edge = (N / 0.7) ** (1 / 3)
    x = dense.state.positions * edge / dense.box.lengths[0]
    return kd.System(x, dense.state.velocities, box=(edge,) * 3, forces=dense.forces)


def written(path, temperature, friction=5.0, seed=1):
    sim = kd.Simulation(fluid(), "baoab", 0.004, temperature=temperature, friction=friction, seed=seed)
    sim.advance(1000)
    sim.run(STEPS, every=EVERY, output=path)
    return path


@pytest.fixture(scope="module")
def runs(tmp_path_factory):
    """Files of two runs, at T* = 1 and 1.4."""
    folder = tmp_path_factory.mktemp("runs")
    return [written(folder / f"{k}.h5md", temperature, seed=k) for k, temperature in enumerate((1.0, 1.4))]


@pytest.fixture(scope="module")
def cold(runs):
    """The samples of the run at T* = 1."""
    return sampled_run(runs[0])


# --- clean runs and faults ---


def test_two_clean_runs_pass_every_test(runs):
    found = ensemble_checks(runs)
    assert found.passed
    assert not found.failed
    assert [row.test for row in found.rows][3:6] == [f"temperature of axis {axis}" for axis in "xyz"]
    assert [row.run for row in found.rows] == [str(runs[0])] * 6 + [str(runs[1])] * 6 + [""]
    assert found.rows[-1].expected == pytest.approx(1 - 1 / 1.4)
    assert found.rows[-1].measured == pytest.approx(1 - 1 / 1.4, rel=0.5)
    page = str(found)
    assert "all tests passed" in page
    assert "3 N degrees of freedom: baoab changes the total momentum" in page
    assert json.loads(json.dumps(found.as_json()))["passed"]


def test_the_same_verdicts_every_time_and_no_trace_in_numpys_random_numbers(runs):
    before = np.random.get_state()[1].copy()  # noqa: NPY002
    assert ensemble_checks(runs[0]) == ensemble_checks(runs[0])
    assert np.array_equal(before, np.random.get_state()[1])  # noqa: NPY002


def test_a_run_of_another_temperature_fails(runs):
    found = ensemble_checks(runs[0], temperature=1.05)
    assert "temperature from the mean kinetic energy" in [row.test for row in found.failed]


def test_a_doubled_drag_fails(tmp_path):
    """With friction 2 γ, and noise of γ."""
    kept, true = math.exp(-5.0 * 0.004), velocity_noise.bathed
    share = math.sqrt((1 - kept**2) / (1 - kept**4))

    def wrong(*given, **named):
        bath = true(*given, **named)
        return bath._replace(spread=bath.spread * share)

    with patch.object(velocity_noise, "bathed", wrong):
        found = ensemble_checks(written(tmp_path / "run.h5md", 1.0, friction=10.0))
    assert found.rows[0].verdict == "fail"
    assert found.rows[0].measured == pytest.approx(share**2, rel=0.03)


def test_a_removed_centre_of_mass_that_is_not_counted_fails(runs, cold):
    with kd.open(runs[0]) as run:
        velocities = run.velocities - run.velocities.mean(axis=1)[:, np.newaxis]
    for conserved in (False, True):
        groups = kinetic_groups(lambda: [velocities], np.ones(N), np.full(N, "A"), 3, conserved)
        freedom = 3.0 * (N - conserved)
        kinetic = np.sum([each.kinetic for each in groups], axis=0)
        found = checked([replace(cold, groups=groups, kinetic=kinetic, freedom=freedom, potential=None)])
        assert found.passed == conserved


def test_fluctuations_that_are_too_small_fail(cold):
    mean = cold.kinetic.mean()
    found = checked([replace(cold, kinetic=mean + 0.7 * (cold.kinetic - mean))])
    assert "temperature from the width of its distribution" in [row.test for row in found.failed]


def test_one_cold_axis_fails(cold):
    x, *others = cold.groups
    found = checked([replace(cold, groups=(replace(x, kinetic=0.85 * x.kinetic), *others))])
    assert [row.test for row in found.failed] == ["temperature of axis x"]


def test_energies_that_do_not_belong_to_the_forces_fail(runs):
    both = [replace(each, potential=2.5 * each.potential) for each in map(sampled_run, runs)]
    assert [row.run for row in checked(both).failed] == [""]


# --- sources ---


def test_a_simulation_gives_what_its_file_gives(runs):
    sim = kd.Simulation(fluid(), "baoab", 0.004, temperature=1.0, friction=5.0, seed=0)
    sim.advance(1000)
    sim.run(STEPS, every=EVERY)
    found, of_file = ensemble_checks(sim), ensemble_checks(runs[0])
    assert len(found.rows) == 3
    for one, other in zip(found.rows[:2], of_file.rows[:2], strict=True):
        assert one.deviation == pytest.approx(other.deviation, abs=1e-6)


def test_a_universe_gives_what_the_file_gives(tmp_path):
    """Nominal units: a sigma counts as an angstrom, a tau as a ps, and m as u."""
    pytest.importorskip("MDAnalysis")
    path = tmp_path / "run.h5md"
    kd.Simulation(fluid(), "baoab", 0.004, temperature=1.0, friction=5.0).run(200, every=20, output=path)
    with kd.open(path) as run:
        found, of_file = sampled_run(run.universe()), sampled_run(run)
    assert found.boltzmann == pytest.approx(0.831446, rel=1e-6)  # u angstrom^2 / ps^2 / K
    assert found.freedom == of_file.freedom == 3 * N
    for one, other in zip((found, *found.groups), (of_file, *of_file.groups), strict=True):
        assert one.freedom == other.freedom
        assert one.kinetic == pytest.approx(other.kinetic, rel=1e-5)


def test_degrees_of_freedom_of_species():
    """<m v^2> = k_B T (1 - m / M) for a total momentum of zero: exact samples, of masses far apart."""
    rng = np.random.default_rng(2)
    masses, names = np.array([1.0, 1.0, 8.0, 20.0]), np.array(["A", "A", "B", "B"])
    v = rng.normal(size=(20_000, 4, 3)) / np.sqrt(masses)[:, np.newaxis]
    v -= np.einsum("n,fnk->fk", masses / masses.sum(), v)[:, np.newaxis]
    for group in kinetic_groups(lambda: [v[:7000], v[7000:]], masses, names, 3, True):
        assert 2 * group.kinetic.mean() == pytest.approx(group.freedom, rel=0.03)


def test_a_run_at_constant_energy_compares_its_axes():
    found = engine_checks(liquid(64, 2.0), "native", "velocity-verlet", 12_000, 10, dt=0.004)
    assert [row.test for row in found.rows] == [f"temperature of axis {axis}" for axis in "xyz"]
    assert found.passed
    assert found.rows[0].expected == found.rows[2].expected


@pytest.mark.long
def test_two_runs_in_the_bath_of_another_program():
    found = engine_checks(fluid(), "lammps", "csvr", 16_000, 10, dt=0.004, temperature=(1.0, 1.4), tau=0.05)
    assert found.passed
    assert {row.run for row in found.rows} >= {f"{fluid().name} on lammps (1)", f"{fluid().name} on lammps (2)"}
    assert found.rows[-1].expected == pytest.approx(1 - 1 / 1.4)
    assert "3 N - 3 degrees of freedom: csvr conserves the total momentum" in found.notes


def test_a_bath_that_counts_too_many_degrees_of_freedom_fails():
    """ASE's Nosé-Hoover chain counts 3 N; the kinetic energies are drawn from what the chain then samples."""
    rng = np.random.default_rng(3)
    velocities = rng.normal(size=(4000, N, 3)) * math.sqrt(N / (N - 1))
    velocities -= velocities.mean(axis=1, keepdims=True)
    groups = kinetic_groups(lambda: [velocities], np.ones(N), np.array(["A"] * N), 3, True)
    kinetic = 0.5 * (velocities**2).sum(axis=(1, 2))
    run = replace(sampled_run_of(kinetic, 3.0 * N - 3.0), groups=groups)
    assert "temperature from the mean kinetic energy" in [row.test for row in checked([run]).failed]


def sampled_run_of(kinetic, freedom):
    """A run at T* = 1 with these kinetic energies."""
    return SampledRun("run", 1.0, N, freedom, kinetic, (), None, np.full(len(kinetic), 1.0), 1.0, None, True, ("run",))


def test_the_mean_pressure_of_a_barostat():
    rng = np.random.default_rng(4)
    kinetic = stats.gamma(1.5 * N).rvs(2000, random_state=1)
    run = replace(sampled_run_of(kinetic, 3.0 * N), pressure=2.0, pressures=rng.normal(2.0, 0.5, 2000))
    assert [row.test for row in checked([run]).rows][-1] == "mean pressure"
    assert checked([run]).passed
    assert [row.test for row in checked([replace(run, pressure=2.06)]).failed] == ["mean pressure"]
    assert "mean pressure" not in [row.test for row in checked([replace(run, pressures=None)]).rows]


# --- statistics, beside known distributions ---

POINT = Point(2.0, None, 1.0, 30, 1.0)


def test_independent_samples_of_a_correlated_series():
    rng = np.random.default_rng(5)
    noise, series, ratio_ = rng.normal(size=40_000), np.zeros(40_000), 0.9
    for k in range(1, 40_000):
        series[k] = ratio_ * series[k - 1] + noise[k]
    chosen = independent(series, "series")
    spacing = len(series) / len(chosen)
    assert spacing == pytest.approx(math.log(0.05 / 2.05) / math.log(ratio_), rel=0.25)
    assert abs(np.corrcoef(chosen[:-1], chosen[1:])[0, 1]) < 0.1


def test_kinetic_energies_of_a_known_distribution():
    kinetic = stats.gamma(45, scale=2.0).rvs(4000, random_state=1)
    mean, width = mean_and_width(kinetic, 90, POINT)
    assert abs(mean.errors) < 3
    assert abs(width.errors) < 3
    assert mean.errors == pytest.approx((kinetic.mean() / 45 - 2) / (2 * math.sqrt(2 / 90 / 4000)), rel=0.1)
    assert distribution(kinetic, 90, POINT) > 1e-3
    assert mean_and_width(kinetic, 87, POINT)[0].p_value < 1e-9
    assert distribution(kinetic, 87, POINT) < 1e-3


def test_ratios_of_an_ideal_gas_with_a_barostat():
    """P(V) ~ V^N exp(-P V / k_B T), and U = 0: volumes at two pressures, enthalpies at two temperatures."""

    def volumes(temperature, pressure, seed):
        return stats.gamma(31, scale=temperature / pressure).rvs(2000, random_state=seed)

    cold, dense, hot = (Point(*each, 1.0, 30, 60.0) for each in ((2.0, 1.0), (2.0, 1.3), (2.6, 1.0)))
    found = ratio(volumes(2.0, 1.0, 1), volumes(2.0, 1.3, 2), (cold, dense))
    assert found.expected == pytest.approx(-0.15)
    assert abs(found.errors) < 3
    assert found.measured == pytest.approx(-0.15, rel=0.1)
    found = ratio(volumes(2.0, 1.0, 1), volumes(2.6, 1.0, 2), (cold, hot))
    assert found.expected == pytest.approx(1 / 2 - 1 / 2.6)
    assert abs(found.errors) < 3
    assert ratio(volumes(2.0, 1.0, 1), volumes(2.3, 1.0, 2), (cold, hot)).p_value < 1e-4
    with pytest.raises(InputError, match=r"^the two runs hardly overlap: choose pressures that differ by about 0.3"):
        ratio(volumes(2.0, 1.0, 1), volumes(2.0, 9.0, 2), (cold, dense._replace(pressure=9.0)))


# --- bad input ---


@pytest.mark.parametrize(
    ("arguments", "line"),
    [
        ({"temperature": -1.0}, "temperature: expected a positive number, got -1"),
        ({"temperature": [1.0, 2.0]}, "temperature: expected one number for each of 1 runs, got 2"),
        ({"level": 1.5}, "level must lie between 0 and 1, got 1.5"),
        ({"constraints": 90}, "constraints: 90 leave none of 81 degrees of freedom"),
    ],
)
def test_arguments_that_make_no_sense(runs, arguments, line):
    with pytest.raises(InputError, match=f"^{line}"):
        ensemble_checks(runs[0], **arguments)


def test_runs_that_cannot_be_tested(runs, cold):
    with pytest.raises(InputError, match=r"^runs: expected the path .* got float$"):
        ensemble_checks(3.5)
    with pytest.raises(InputError, match=r"^runs: expected one or two, got 3$"):
        ensemble_checks([*runs, runs[0]])
    with pytest.raises(InputError, match=r"0\.h5md: 50 samples; the tests need 100 or more$"), kd.open(runs[0]) as run:
        ensemble_checks(run[:50])
    with pytest.raises(InputError, match=r"independent samples of .* the tests need 100. Run about"):
        checked([cold.from_sample(len(cold.kinetic) - 120)])
    with pytest.raises(InputError, match=r"does not say its temperature; give temperature$"):
        checked([replace(cold, temperature=None)])
    with pytest.raises(InputError, match=r"^both runs have temperature 1: their ratio needs two neighbouring"):
        ensemble_checks([runs[0], runs[0]])
    with pytest.raises(InputError, match=r"are runs of different systems: their ratio needs the same particles"):
        checked([cold, replace(cold, temperature=1.4, likeness=())])
    with pytest.raises(InputError, match=r"^the two runs hardly overlap: choose temperatures that differ by about"):
        checked([cold, replace(cold, temperature=1.4, potential=cold.potential + 500.0)])


def test_universes_that_cannot_be_tested():
    MDAnalysis = pytest.importorskip("MDAnalysis")
    empty = MDAnalysis.Universe.empty(3, trajectory=True)
    with pytest.raises(InputError, match=r"^the Universe has no masses; add them with add_TopologyAttr$"):
        ensemble_checks(empty)
    empty.add_TopologyAttr("masses", [1.0, 0.0, 1.0])
    with pytest.raises(InputError, match=r"^the Universe: atom 1 has mass 0; set the atoms' masses$"):
        ensemble_checks(empty)
    empty.atoms.masses = 1.0
    with pytest.raises(InputError, match=r"^the Universe has no velocities; write them to the trajectory"):
        ensemble_checks(empty)


def test_the_missing_package_is_named(runs, monkeypatch):
    monkeypatch.setitem(sys.modules, "physical_validation", None)
    with pytest.raises(
        InputError, match=r"ensemble checks need physical_validation: pip install 'kickdrift\[certify\]'"
    ):
        canonical.packages()


def test_certify_prints_one_page_and_fails_wrong_runs(runs, tmp_path, kickdrift):
    status, out, err = kickdrift("certify", *runs, "--json", tmp_path / "page.json")
    assert (status, err) == (0, "")
    assert "slope of the logarithm of the ratio of potential energies" in out
    assert len(out.splitlines()) < 40
    page = json.loads((tmp_path / "page.json").read_text())
    assert page["passed"]
    assert len(page["rows"]) == 13
    status, out, _ = kickdrift("certify", runs[0], "--temperature", "1.1")
    assert status == 1
    assert "tests of 6 failed" in out


def test_certify_refuses_bad_input(runs, tmp_path, kickdrift):
    assert_refused(kickdrift("certify", tmp_path / "none.h5md"), "none.h5md: no such file")
    assert_refused(kickdrift("certify", runs[0], "--steps", "5"), "are for --engine: a file has its own")
    assert_refused(kickdrift("certify", *runs, "--engine", "lammps"), "--engine runs one system")
    assert_refused(
        kickdrift("certify", "lj-1000", "--engine", "openmm", "--integrator", "csvr", "--steps", "5"),
        "native, ase, lammps and cuda can",
    )
    several = [word for each in (1, 2, 3) for word in ("--temperature", each)]
    assert_refused(kickdrift("certify", "lj-1000", "--engine", "native", *several), "expected one or two, got 3")

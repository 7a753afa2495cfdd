"""Heat baths of other engines: their scheme against the native word, their heat, their temperature, their refusals."""

from __future__ import annotations

import numpy as np
import pytest

import kickdrift as kd
from kickdrift.engines import ENGINES
from kickdrift.integrators import integrator
from kickdrift.model.starts.builders import lattice, maxwell_boltzmann

OPTIONS = {"friction": 2.0, "tau": 0.2, "collision_rate": 2.0}
BATHS = [
    (engine, name) for engine, row in ENGINES.items() for name in row.baths if engine != "cuda"
]  # see test_cuda.py
EXACT = [  # the engine's step is the native word
    ("ase", "baoab"), *(("openmm", name) for name in ("baoab", "obabo", "aboba", "oabao", "baoa"))
]  # fmt: skip
HOT = ("ase", "nose-hoover")  # counts three degrees of freedom too many
COLD = 1e-24  # a temperature so low that only the drag of a bath acts


def liquid(count: int = 27, density: float = 0.6) -> kd.System:
    positions, edges = lattice("sc", count, density)
    positions += np.random.default_rng(1).uniform(-0.05, 0.05, positions.shape)
    velocities = maxwell_boltzmann(np.ones(count), 1.5, 1.0, 1)
    return kd.System(positions, velocities, box=edges, forces=[kd.LennardJones(cutoff=1.7, truncation="shift")])


def simulation(engine: str, name: str, dt: float = 0.004, temperature: float = 1.5, **more) -> kd.Simulation:
    known = {key: value for key, value in OPTIONS.items() if key in integrator(name).tunable} | more
    return kd.Simulation(liquid(), name, dt, engine=engine, temperature=temperature, **known)


def test_which_engine_has_which_bath():
    assert BATHS == [
        ("ase", "baoab"), ("ase", "csvr"), ("ase", "nose-hoover"), ("ase", "andersen"),
        ("lammps", "baoab"), ("lammps", "csvr"), ("lammps", "nose-hoover"),
        ("openmm", "baoab"), ("openmm", "obabo"), ("openmm", "aboba"), ("openmm", "oabao"), ("openmm", "baoa"),
        ("openmm", "nose-hoover"), ("openmm", "andersen"),
    ]  # fmt: skip


@pytest.mark.parametrize(("engine", "name"), EXACT, ids=lambda each: each)
def test_the_engines_word_is_kickdrifts(engine, name):
    ours, theirs = (simulation(each, name, temperature=COLD) for each in ("native", engine))
    for sim in (ours, theirs):
        sim.run(10)
    for k in range(2):
        assert np.abs(theirs.state.phase[k] - ours.state.phase[k]).max() < 1e-10
    assert np.abs(ours.state.velocities - liquid().state.velocities).max() > 0.1


@pytest.mark.parametrize(("engine", "name"), [each for each in BATHS if each[1] == "nose-hoover"])
def test_the_engines_chain_has_kickdrifts_masses(engine, name):
    """Heat flows at the same rate at first. ASE counts all 81 degrees of freedom, so more flows in."""
    ours, theirs = (simulation(each, name, 0.001).run(100, every=100).heat for each in ("native", engine))
    if (engine, name) == HOT:
        assert theirs - ours > 0.05 * abs(ours)
        return
    assert theirs == pytest.approx(ours, rel=0.03)


def ready(engine: str, name: str) -> kd.Simulation:
    """A Simulation that has equilibrated, with other noise than its run's."""
    sim = simulation(engine, name, **({} if name == "nose-hoover" else {"seed": 7}))
    sim.equilibrate(1.5, 0.1)
    assert (sim.steps_done, sim.report().heat) == (0, 0.0 if ENGINES[engine].baths[name].tells else None)
    return sim


@pytest.mark.parametrize(("engine", "name"), BATHS, ids=lambda each: each)
def test_report_file_heat_and_bits(engine, name, tmp_path):
    path, told = tmp_path / "run.h5md", ENGINES[engine].baths[name].tells
    sim = ready(engine, name)
    report = sim.run(120, every=10, output=path)
    other = ready(engine, name)
    other.run(120, every=120)
    np.testing.assert_array_equal(sim.state.phase, other.state.phase)
    sample, freedom = sim.record.samples[-1], 81 - 3 * (not integrator(name).drags)
    assert sample.temperature == pytest.approx(2 * sample.energies.kinetic / freedom)
    assert (report.momentum_error is None) == integrator(name).drags
    assert report.temperature_verdict
    assert report.warnings == list(filter(None, [ENGINES[engine].baths[name].remark]))
    with kd.open(path) as run:
        assert ("energy_taken" in run.observables) == told == (report.heat is not None)
    if not told:
        assert report.energy.verdict == f"not judged: {engine} does not tell the heat"
        assert report.as_json()["energy"]["max_relative_error"] is None
        assert "does not tell the heat" in str(report)
        return
    again = kd.resume(path)
    again.run(50, every=10)
    samples = [*sim.record.samples, *again.record.samples]
    assert np.ptp([each.energies.total + each.taken.energy for each in samples]) < 0.1 * np.ptp(
        [each.energies.total for each in samples]
    )


@pytest.mark.parametrize(("engine", "name"), [each for each in BATHS if each[0] == "lammps"], ids=lambda each: each)
def test_the_temperature_of_lammps(engine, name):
    sim = simulation(engine, name)
    sim.equilibrate(1.5, 4.0)
    report = sim.run(15_000, every=20)
    assert abs(report.temperature - 1.5) < 4 * report.temperature_error < 0.1


def test_seeds_and_places_of_the_noise():
    one, two = (simulation("lammps", "csvr", seed=seed) for seed in (1, 2))
    one.run(5), two.run(5)
    assert np.abs(one.state.velocities - two.state.velocities).max() > 1e-6
    stepper = one.integration.stepper
    seeds = set()
    for steps in (-5, 0, 5, 10**6):
        stepper.reset(stepper.y, 0.0, steps)
        seeds.add(stepper._seed())
    assert len(seeds) == 4
    assert all(1 <= each < 9e8 for each in seeds)


@pytest.mark.long
def test_two_processes_and_two_dimensions():
    sim = kd.Simulation(
        liquid(), "langevin", 0.004, engine="lammps", processes=2, temperature=1.5, friction=2.0, seed=1
    )
    assert np.isfinite(sim.run(20).heat)
    sites = np.column_stack([*np.indices((3, 3)).reshape(2, -1) * 1.3, np.zeros(9)])
    plane = kd.System(sites, box=(3.9, 3.9), dimensions=2, forces=[kd.LennardJones(cutoff=1.9)])
    sim = kd.Simulation(plane, "langevin", 0.002, engine="lammps", temperature=1.0, friction=5.0, seed=1)
    sim.run(200)
    assert not sim.state.phase[:, 2].any()
    assert sim.state.velocities.any()
    for engine in ("ase", "openmm"):
        with pytest.raises(kd.InputError, match=f"engine '{engine}': two dimensions|engine 'openmm': box"):
            kd.Simulation(plane, "langevin", 0.002, engine=engine, temperature=1.0, friction=5.0)


@pytest.mark.parametrize(
    ("engine", "name", "said"),
    [
        ("openmm", "csvr", "integrator 'csvr': openmm has .*; native, ase, lammps and cuda can"),
        ("ase", "obabo", "integrator 'obabo': ase has .*; native, openmm and cuda can"),
        ("lammps", "andersen", "integrator 'andersen': lammps has .*; native, ase, openmm and cuda can"),
    ],
)
def test_refusals(engine, name, said):
    with pytest.raises(kd.InputError, match=f"^engine '{engine}': {said}$"):
        simulation(engine, name)


def test_an_equilibration_that_the_program_lacks_is_native():
    places = []
    for engine in ("openmm", "native"):
        sim = kd.Simulation(liquid(), "velocity-verlet", 0.004, engine=engine)
        sim.equilibrate(1.5, steps=20, integrator="csvr", tau=0.2)
        places.append(sim.state.positions)
        warned = "equilibrate: openmm has no csvr, so kickdrift itself has equilibrated" in sim.run(1).warnings
        assert warned == (engine == "openmm")
    np.testing.assert_array_equal(*places)


def test_options_and_forces_of_a_bath():
    with pytest.raises(kd.InputError, match="friction is needed"):
        kd.Simulation(liquid(), "langevin", 0.004, engine="lammps", temperature=1.0)
    with pytest.raises(kd.InputError, match="makes no sense under gravity"):
        kd.Simulation(kd.load("outer-solar-system"), "baoab", 0.1, engine="openmm", temperature=1.0, friction=1.0)
    report = simulation("lammps", "csvr", tau=0.01).run(1)
    assert "tau = 0.01 is 2.5 steps; use 10 steps or more" in report.warnings

"""Engines: each against the native one on the same system, their refusals, and their runs.

The engines' own codes are the reference: energies, forces and pressure at a common start must agree to round-off.
"""

from __future__ import annotations

import json
import os
import signal
import sys
from pathlib import Path

import numpy as np
import pytest

import kickdrift as kd
from kickdrift.analysis.compare.stiffness import stiffness
from kickdrift.engines import ENGINES, tables
from kickdrift.model.starts.builders import lattice, maxwell_boltzmann
from kickdrift.run.advance import Integration
from kickdrift.trajectory.read.info import info
from kickdrift_validation.example_forces import crystal, example
from tests.simulated import marked

registry = sys.modules["kickdrift.engines"]  # kd.engines is a function, so take the module here
ALL = [name for name in ENGINES if name != "native"]
FOREIGN = [marked(name) for name in ALL]
ROUND_OFF = 1e-12
SPECIES = {"A": {"sigma": 1.0}, "B": {"sigma": 0.9, "epsilon": 1.5}, "C": {"sigma": 0.8}}
MIXED_LAWS = {"species": SPECIES, "pairs": {("A", "C"): {"sigma": 0.97, "epsilon": 0.3}}}


def liquid(seed: int = 1, scale: float = 1.0, open_space: bool = False, **arguments) -> kd.System:
    """216 particles near a simple cubic lattice, some of them several boxes away."""
    positions, edges = lattice("sc", 216, 0.8442)
    rng = np.random.default_rng(seed)
    positions += rng.uniform(-0.05, 0.05, positions.shape)
    if not open_space:
        positions += np.array(edges) * rng.integers(-2, 3, positions.shape)
    arguments = {"forces": [kd.LennardJones(cutoff=2.5)], **arguments}
    box = None if open_space else scale * np.array(edges)
    return kd.System(scale * positions, scale * maxwell_boltzmann(np.ones(216), 1.44, 1.0, seed), box=box, **arguments)


def of_argon() -> kd.System:
    force = kd.LennardJones(epsilon=0.0104, sigma=3.4, cutoff=8.5)
    return liquid(scale=3.4, masses=39.948, units="metal", forces=[force])


def mixture() -> kd.System:
    return liquid(
        forces=[kd.LennardJones(cutoff=2.2, **MIXED_LAWS)],
        species=["A", "B", "C"] * 72,
        masses=np.where(np.arange(216) % 2, 1.0, 2.5),
    )


def cut(**arguments) -> kd.System:
    return liquid(forces=[kd.LennardJones(cutoff=2.5, truncation="cut", **arguments)])


LEANING = np.array([[8.1, 0, 0], [-4.05, 8.3, 0], [3.3, 4.0, 8.5]])
PLANE, TUBE = (True, True, False), (False, False, True)


def boxed(matrix, periodic=True, **arguments) -> kd.System:
    """512 particles near a lattice in a box of any shape, some of them several boxes away."""
    rng = np.random.default_rng(3)
    box = kd.Box(matrix=matrix, periodic=periodic)
    sites = (np.indices((8, 8, 8)).reshape(3, -1).T + rng.uniform(0.45, 0.55, (512, 3))) / 8
    positions = sites @ matrix + box.cartesian(np.where(box.periodic_axes, rng.integers(-2, 3, (512, 3)), 0))
    arguments = {"forces": [kd.LennardJones(cutoff=2.5)], **arguments}
    return kd.System(positions, maxwell_boltzmann(np.ones(512), 1.0, 1.0, 3), box=box, **arguments)


def leaning() -> kd.System:
    return boxed(LEANING)


def leaning_mixture() -> kd.System:
    force = kd.LennardJones(cutoff=2.2, species=SPECIES, pairs={("A", "C"): {"sigma": 0.97}})
    return boxed(LEANING, forces=[force], species=["A", "B", "C", "A"] * 128)


def slab() -> kd.System:
    matrix = LEANING.copy()
    matrix[2] = [0, 0, 8.5]
    return boxed(matrix, PLANE)


def tube() -> kd.System:
    return boxed(np.diag([8.1, 8.3, 8.5]), TUBE)


def planets() -> kd.System:
    return kd.load("outer-solar-system")


def copper() -> kd.System:
    return crystal(example(kd.EmbeddedAtom))


def silicon() -> kd.System:
    return crystal(kd.StillingerWeber())


def droplet(periodic=True, kinds="A", **law) -> kd.System:
    """27 particles near a lattice, few enough for a simulated device."""
    positions, edges = lattice("sc", 27, 0.8442)
    positions += np.random.default_rng(1).uniform(-0.05, 0.05, positions.shape) + np.array(edges) * [1, -2, 0]
    box, forces = kd.Box(edges, periodic=periodic), [kd.LennardJones(**{"cutoff": 1.4} | law)]
    v = maxwell_boltzmann(np.ones(27), 1.0, 1.0, 1)
    return kd.System(positions, v, box=box, forces=forces, species=list(kinds * 27)[:27])


def silicon_of_tersoff() -> kd.System:
    return crystal(kd.Tersoff(), few=True)


def bonded_silicon() -> kd.System:
    """Silicon with a bond and an angle of the first atoms beside the many-body force."""
    base = silicon()
    near = np.argsort(np.linalg.norm(base.box.minimum_image(base.state.positions - base.state.positions[0]), axis=1))
    forces = [*base.forces, kd.HarmonicBond(3.0, 2.2), kd.HarmonicAngle(1.0, 100.0)]
    bonds = [(0, int(near[1])), (0, int(near[2]))]
    return base.remade(forces=forces, topology=kd.Topology(bonds, True))


def truncated(truncation: str) -> kd.System:
    return liquid(forces=[kd.LennardJones(cutoff=2.5, truncation=truncation)])


def held(*more) -> kd.System:
    """Particles of a liquid that springs hold near other places than their start."""
    base = liquid()
    places = base.state.positions[3:40] + np.random.default_rng(2).normal(0.0, 0.2, (37, 3))
    springs = [kd.Restraint(20.0, range(3, 40), places), kd.Restraint((0.0, 5.0, 5.0)), *more]
    return base.with_forces(*base.forces, *springs)


def walled() -> kd.System:
    """A drop between soft walls."""
    walls = [
        kd.LennardJonesWall((0, 0, 2), 2.5, (0.0, 0.0, -1.0), 1.5, 0.9),
        kd.HarmonicWall(40.0, (-1, 0, 0), (7.0, 0, 0), 2.0),
    ]
    base = liquid(open_space=True)
    return base.with_forces(*base.forces, *walls)


def in_fields() -> kd.System:
    return held(kd.HarmonicTrap((1.0, 2.0, 0.5), (1.0, 2.0, 3.0)), kd.UniformField((0.1, 0.2, -0.3)))


def between_mirrors() -> kd.System:
    base = liquid(open_space=True)
    low = tuple(base.state.positions.min(axis=0) - 0.01)
    mirrors = [kd.ReflectingWall(tuple(row), low) for row in np.eye(3)]
    return base.with_forces(*base.forces, *mirrors)


CRYSTAL = {"integrator": "velocity-verlet", "dt": 0.001}
MD = {"integrator": "velocity-verlet", "dt": 0.002}
CSVR = {"integrator": "csvr", "temperature": 1.0, "tau": 1.0}
CASES = [
    ("ase", liquid, MD),
    ("ase", of_argon, MD),
    ("ase", lambda: liquid(open_space=True), MD),
    ("ase", leaning, MD),
    ("ase", slab, MD),
    ("ase", tube, MD),
    ("ase", silicon_of_tersoff, CRYSTAL),
    ("rebound", planets, {"integrator": "leapfrog-dkd", "dt": 0.01}),
    ("rebound", planets, {"integrator": "forest-ruth", "dt": 0.01}),
    ("rebound", planets, {"integrator": "wisdom-holman", "dt": 0.1, "corrector": 17}),
    ("rebound", planets, {"integrator": "wisdom-holman", "dt": 0.1, "coordinates": "democratic-heliocentric"}),
    ("rebound", planets, {"integrator": "saba", "dt": 0.1, "order": "8,2"}),
    ("rebound", planets, {"integrator": "trace", "dt": 0.1}),
    ("rebound", lambda: kd.load("test-particles-1000"), {"integrator": "leapfrog-dkd", "dt": 0.001}),
    ("lammps", liquid, MD),
    ("lammps", of_argon, MD),
    ("lammps", mixture, MD),
    ("lammps", cut, MD),
    ("lammps", lambda: cut(tail=True), MD),
    ("lammps", lambda: liquid(open_space=True), MD),
    ("lammps", leaning, MD),
    ("lammps", leaning_mixture, MD),
    ("lammps", slab, MD),
    ("lammps", tube, MD),
    ("lammps", leaning_mixture, MD | {"processes": 2}),
    ("lammps", copper, CRYSTAL),
    ("lammps", silicon, CRYSTAL),
    ("lammps", silicon_of_tersoff, CRYSTAL | {"processes": 2}),
    ("lammps", bonded_silicon, CRYSTAL),
    ("lammps", lambda: truncated("force-shift"), MD),
    ("lammps", lambda: liquid(forces=[kd.Mie(n=14.0, m=7.0, cutoff=2.4)]), MD),
    ("lammps", held, MD),
    ("lammps", walled, MD),
    ("lammps", between_mirrors, MD),
    ("openmm", liquid, MD),
    ("openmm", of_argon, MD),
    ("openmm", mixture, MD),
    ("openmm", cut, MD),
    ("openmm", planets, {"integrator": "velocity-verlet", "dt": 0.01}),
    ("openmm", lambda: truncated("force-shift"), MD),
    ("openmm", lambda: truncated("switch"), MD),
    ("openmm", in_fields, MD),
    ("openmm", walled, MD),
    ("cuda", droplet, MD),
    ("cuda", lambda: droplet(truncation="switch"), MD | {"integrator": "yoshida4"}),
    ("cuda", lambda: droplet(truncation="cut", tail=True), MD),
    ("cuda", lambda: droplet(periodic=TUBE), MD | {"integrator": "leapfrog-dkd"}),
    ("cuda", lambda: droplet(kinds="BBAC", **MIXED_LAWS), MD),
    ("cuda", planets, {"integrator": "velocity-verlet", "dt": 0.01}),
]
FIRST = {engine: (make, options) for engine, make, options in reversed(CASES)}


def relative(found, expected) -> float:
    return float(np.abs(np.asarray(found) - expected).max() / (np.abs(expected).max() or 1.0))


def test_every_engine_has_a_case_and_nothing_else():
    assert list(dict.fromkeys(engine for engine, *_ in CASES)) == ALL
    assert kd.engines() == ["native", *ALL]


FURTHER = (27, 30)  # with code of their own: two processes again, and a pair law
MARKED = [marked(engine, k, f"{engine}-{k}") for k, (engine, *_) in enumerate(CASES)]


@pytest.mark.parametrize(
    "k", [pytest.param(k, marks=pytest.mark.long) if k in FURTHER else MARKED[k] for k in range(len(CASES))]
)
def test_same_energies_forces_pressure_and_steps(k):
    engine, make, options = CASES[k]
    system = make()
    ours = kd.Simulation(system, **{key: value for key, value in options.items() if key != "processes"})
    theirs = kd.Simulation(system, engine=engine, **options)
    expected, found = ours.sample(), theirs.sample()
    assert found.energies.potential == pytest.approx(expected.energies.potential, rel=ROUND_OFF)
    assert found.energies.kinetic == pytest.approx(expected.energies.kinetic, rel=ROUND_OFF)
    assert found.pressure == pytest.approx(expected.pressure, rel=ROUND_OFF, nan_ok=True)
    assert np.isnan(expected.pressure) == (not all(system.box.periodic_axes))
    assert relative(theirs.forces(), ours.forces()) < ROUND_OFF
    assert theirs.state.positions.tobytes() == ours.state.positions.tobytes()
    ours.run(10), theirs.run(10)
    assert (theirs.steps_done, theirs.time) == (10, ours.time)
    assert relative(theirs.state.positions, ours.state.positions) < ROUND_OFF
    assert relative(theirs.state.velocities, ours.state.velocities) < ROUND_OFF
    assert relative(theirs.forces(), ours.forces()) < 10 * ROUND_OFF
    assert theirs.energy().total == pytest.approx(ours.energy().total, rel=ROUND_OFF)


@pytest.mark.long
def test_lammps_has_the_switch_by_tables_to_the_error_that_it_states():
    species = {"species": ["A", "B", "C"] * 72}
    force = kd.LennardJones(cutoff=2.2, truncation="switch", species=SPECIES)
    for system in (truncated("switch"), liquid(forces=[force], **species)):
        ours, theirs = (kd.Simulation(system, "velocity-verlet", 0.002, engine=name) for name in ("native", "lammps"))
        expected, found = ours.sample(), theirs.sample()
        assert found.energies.potential == pytest.approx(expected.energies.potential, rel=tables.ERROR)
        assert found.pressure == pytest.approx(expected.pressure, rel=10 * tables.ERROR)
        assert relative(theirs.forces(), ours.forces()) < tables.ERROR
        report = theirs.run(10)
        ours.run(10)
        assert relative(theirs.state.positions, ours.state.positions) < tables.ERROR
        assert [line for line in report.warnings if "tables of 20,000 points" in line]


def test_ias15_is_looked_at_inside_its_steps():
    ours, theirs = (kd.Simulation(planets(), "gauss-radau15", engine=name) for name in ("native", "rebound"))
    seen = {"native": [], "rebound": []}
    for sim in (ours, theirs):
        sim.run(until=30.0, interval=0.5, observe=lambda sim: seen[sim.engine].append((sim.time, sim.state.phase)))
    assert [time for time, _ in seen["rebound"]] == [time for time, _ in seen["native"]]
    for (_, mine), (_, other) in zip(seen["native"], seen["rebound"], strict=True):
        assert relative(other[0], mine[0]) < ROUND_OFF
    assert theirs.report().force_evaluations is None
    assert theirs.report().energy.max_relative_error < 1e-14


@pytest.mark.parametrize("engine", [name for name in ALL if name != "cuda"])  # test_cuda.py looks at every step
def test_looks_change_no_bits(engine):
    make, options = FIRST[engine]
    often, seldom = (kd.Simulation(make(), engine=engine, **options) for _ in range(2))
    often.run(60, every=1)
    seldom.run(60, every=60)
    assert often.state.phase.tobytes() == seldom.state.phase.tobytes()


@pytest.mark.parametrize(
    "options", [options for engine, make, options in CASES if engine == "rebound" and make is planets]
)
def test_looks_change_no_bits_of_rebound(options):
    often, seldom = (kd.Simulation(planets(), engine="rebound", **options) for _ in range(2))
    often.run(500, every=3)
    seldom.run(500, every=500)
    assert often.state.phase.tobytes() == seldom.state.phase.tobytes()


@pytest.mark.parametrize("name", ["whfast", "ias15"])
def test_rebounds_names(name):
    sim = kd.Simulation(planets(), name, 0.1 if name == "whfast" else None, engine="rebound")
    assert sim.integrator == {"whfast": "wisdom-holman", "ias15": "gauss-radau15"}[name]
    with pytest.raises(kd.InputError, match=f"integrator '{name}' is unknown"):
        kd.Simulation(planets(), name, 0.1)


# --- files, looks and interrupts of their runs ---


@pytest.mark.parametrize("engine", FOREIGN)
def test_report_file_and_resumption(engine, tmp_path):
    make, options = FIRST[engine]
    path = tmp_path / "run.h5md"
    sim = kd.Simulation(make(), engine=engine, **options)
    report = sim.run(20, every=5, output=path)
    native = kd.Simulation(make(), **options).run(20, every=5)
    assert list(report.as_json()) == list(native.as_json())
    assert (report.engine, report.engine_version) == (engine, ENGINES[engine].version)
    assert report.force_evaluations == 20 * sim.method.evaluations
    assert report.energy.rms_relative_error == pytest.approx(native.energy.rms_relative_error, rel=1e-3, abs=1e-14)
    found = info(path)["method"]
    assert (found["engine"], found["engine_version"]) == (engine, ENGINES[engine].version)
    with kd.open(path) as run:
        assert [frame.step for frame in run] == [0, 5, 10, 15, 20]
        assert run[-1].positions.tobytes() == sim.state.positions.tobytes()
        assert "pairs" not in run.observables
    taken_up = kd.resume(path)
    assert (taken_up.engine, taken_up.steps_done, taken_up.time) == (engine, 20, sim.time)
    sim.run(20)
    after = taken_up.run(20)
    assert relative(taken_up.state.positions, sim.state.positions) < ROUND_OFF
    assert "bits may differ" in after.warnings[0]
    with kd.open(path) as run:
        assert run[-1].step == 40


@pytest.mark.parametrize("engine", ["lammps", "openmm"])
def test_equilibration_is_the_engines_own(engine):
    sim = kd.Simulation(liquid(), engine=engine, dt=0.004)
    sim.equilibrate(0.9, 0.8)
    assert (sim.steps_done, sim.time) == (0, 0.0)
    assert sim.run(200, every=2).temperature == pytest.approx(0.9, rel=0.15)


def test_stiffness_refuses_another_program():
    sim = kd.Simulation(liquid(), dt=0.002, engine="ase")
    with pytest.raises(kd.InputError, match=r"^stiffness: engine 'ase' gives forces only at its present state"):
        stiffness(sim)


def test_states_are_replaced():
    sim = kd.Simulation(liquid(), engine="lammps", dt=0.002)
    start = sim.state
    sim.run(10)
    energy = sim.energy()
    sim.state = start
    assert (sim.steps_done, sim.time) == (0, 0.0)
    sim.run(10)
    assert sim.energy().total == pytest.approx(energy.total, rel=ROUND_OFF)


def test_lammps_counts_more_edges_than_it_has_bits_for():
    system = kd.System(
        [[0.5, 0.5, 0.5], [3.5, 0.5, 0.5]], [[100.0, -60.0, 0.0]] * 2, box=(6.0, 6.0, 6.0), forces=[kd.LennardJones()]
    )
    sim = kd.Simulation(system, engine="lammps", dt=0.01)
    sim.run(4000, every=4000)
    expected = system.state.positions + 40.0 * system.state.velocities
    assert np.abs(sim.state.positions - expected).max() < 1e-6


def test_a_run_that_blows_up_says_so():
    for engine in ("ase", "lammps", "openmm"):
        sim = kd.Simulation(liquid(), engine=engine, dt=0.5)
        with pytest.raises(kd.RunError, match=r"velocity-verlet, dt = 0.5: stopped at step \d"):
            sim.run(50)
        assert sim.steps_done < 50
        sim.sample()


# --- processes ---


def workers(sim: kd.Simulation) -> list[int]:
    """LAMMPS' processes, found by their folder."""
    told = str(sim.integration.stepper._session._world.folder)
    found = []
    for process in Path("/proc").glob("[0-9]*"):
        try:
            line, environment = (process / "cmdline").read_bytes(), (process / "environ").read_bytes()
        except OSError:
            continue
        if told.encode() in environment and line.split(b"\0")[1:3] == [b"-m", b"kickdrift.engines.lammps_worker"]:
            found.append(int(process.name))
    return found


def test_a_process_that_dies_ends_the_run_and_no_more():
    sim = kd.Simulation(liquid(), engine="lammps", dt=0.002, processes=2)
    sim.run(10)
    there = workers(sim)
    assert len(there) == 2
    os.kill(there[1], signal.SIGKILL)
    with pytest.raises(kd.RunError, match=r"stopped at step \d+ .*: LAMMPS: process \d of 2 died"):
        sim.run(1000)
    assert not any(Path(f"/proc/{worker}").exists() for worker in there)
    assert sim.run(10).steps  # works with new processes
    last = workers(sim)
    sim.integration.stepper._session.close()
    assert len(last) == 2
    assert not any(Path(f"/proc/{worker}").exists() for worker in last)


def test_processes_that_do_not_come_up(monkeypatch):
    from kickdrift.engines import lammps_processes

    monkeypatch.setattr(lammps_processes, "mpiexec", lambda: Path("/bin/false"))
    with pytest.raises(kd.RunError, match="LAMMPS: mpiexec ended with status"):
        kd.Simulation(liquid(), engine="lammps", dt=0.002, processes=2).sample()


def test_processes_that_connect_and_say_nothing(monkeypatch, tmp_path):
    """As if MPI hangs before a worker has started LAMMPS."""
    from kickdrift.engines import lammps_processes

    mute = tmp_path / "mpiexec"
    connect = f"s = socket.socket(socket.AF_UNIX); s.connect(os.environ['{lammps_processes.SOCKET}'])"
    mute.write_text(
        f"#!{sys.executable}\nimport os, socket, time\nold = []\n"
        f"for k in range(2):\n    {connect}; old.append(s)\ntime.sleep(600)\n"
    )
    mute.chmod(0o700)
    monkeypatch.setattr(lammps_processes, "mpiexec", lambda: mute)
    monkeypatch.setattr(lammps_processes, "START_SECONDS", 2.0)
    monkeypatch.setattr(lammps_processes, "END_SECONDS", 0.2)
    monkeypatch.setattr("tempfile.tempdir", str(tmp_path))
    with pytest.raises(RuntimeError, match=r"^0 of 2 processes started within 2 s$"):
        lammps_processes.Processes(2)
    monkeypatch.setattr(lammps_processes, "mpiexec", lambda: tmp_path / "no-such-program")
    with pytest.raises(RuntimeError, match=r"^mpiexec ended with status 1: FileNotFoundError: .*no-such-program'$"):
        lammps_processes.Processes(2)
    assert list(tmp_path.iterdir()) == [mute]


def test_lammps_stops_counting_where_the_energy_is_no_number():
    sim = kd.Simulation(liquid(), engine="lammps", dt=0.002)
    sim.run(1)
    session = sim.integration.stepper._session
    session._blind_steps = 3
    session._world.kinetic_energy = lambda: np.nan
    assert session.advance(10, np.inf) == 3
    assert not session.finite()


# --- refusals ---


def with_event() -> kd.System:
    return planets().watched([kd.CloseApproach(1.0)])


def joined() -> kd.System:
    """Two silicon atoms with a bond beside a many-body force."""
    more = {"units": "metal", "species": ["Si", "Si"], "topology": kd.Topology([(0, 1)])}
    forces = [kd.StillingerWeber(), kd.HarmonicBond(1.0, 2.4)]
    return kd.System(2.4 * np.eye(2, 3), box=(20, 20, 20), forces=forces, **more)


ALONE = "; only native can"
REFUSED = [
    ("ase", planets, MD, "force 'gravity': ASE takes one force alone: .* or tersoff; native, openmm and cuda can"),
    ("ase", joined, {}, "forces 'stillinger-weber' and 'harmonic-bond': ASE takes one .*; native and lammps can"),
    ("ase", cut, {}, "truncation 'cut': possible are 'shift'; native, lammps, openmm and cuda can"),
    ("ase", mixture, {}, "species: ASE's LennardJones has one .*, and A, B, C differ; .*, openmm and cuda can"),
    ("ase", liquid, {"integrator": "rk4"}, f"integrator 'rk4': ase has velocity-verlet .*{ALONE}"),
    ("ase", liquid, {"threads": 2}, f"threads: ase runs on one thread here, not on 2{ALONE}"),
    ("ase", liquid, {"processes": 2}, "processes: ase runs in one process, not in 2; only lammps can"),
    ("ase", liquid, {"compensated": True}, f"compensated: .*{ALONE}"),
    ("rebound", liquid, {"integrator": "leapfrog-dkd"}, "force 'len.*: rebound runs only gravity; native and cuda can"),
    ("rebound", planets, {"integrator": "leapfrog"}, "has leapfrog-dkd \\(leapfrog\\).*; native, openmm and cuda can"),
    ("rebound", planets, {"integrator": "saba", "order": "10,2"}, f"order '10,2': rebound's saba has 4,2.*{ALONE}"),
    ("rebound", planets, {"integrator": "saba", "coordinates": "democratic-heliocentric"}, f"coordinates .*{ALONE}"),
    ("rebound", with_event, {"integrator": "ias15"}, f"event 'close-approach': only a native run .*{ALONE}"),
    ("ase", lambda: truncated("switch"), {}, ".*; native, lammps, openmm and cuda can"),
    ("lammps", lambda: liquid(forces=[]), {}, f"has no force: LAMMPS takes one force of .*{ALONE}"),
    ("lammps", lambda: liquid(forces=[kd.LennardJones(), kd.LennardJones(2)]), {}, f"forces 'l.*s' and 'l.*{ALONE}"),
    ("lammps", lambda: liquid(masses=np.arange(216) + 1.0), {}, "masses: 216 .*; native, ase, openmm and cuda can"),
    ("openmm", leaning, {}, "box: OpenMM: cannot use a leaning box, .*; native, ase and lammps can"),
    ("openmm", tube, {}, "box: OpenMM: needs .* only along z; native, ase, lammps and cuda can"),
    ("openmm", lambda: cut(tail=True, pairs={("A", "A"): {"truncation": "potential-switch"}}), {}, "tail: .*can"),
    ("openmm", lambda: kd.load("test-particles-1000"), {"integrator": "leapfrog"}, "masses: .*; native and cuda can"),
    ("openmm", lambda: kd.Problem(lambda t, y: -y, [1.0]), {}, f"is an ODE; openmm moves particles{ALONE}"),
    ("rebound", planets, {"integrator": "ias15", "processes": 2}, "processes: rebound runs in one process, not in 2"),
    ("cuda", leaning, {}, "box: it leans, .*; native, ase and lammps can"),
    ("cuda", silicon, {}, "force 'stillinger-weber': the device takes one .*; native and lammps can"),
    ("cuda", tube, {"precision": "mixed"}, f"precision: on the device, mixed needs .*{ALONE}"),
    ("cuda", lambda: liquid(open_space=True), CSVR, "integrator .csvr.: on the device, it needs a box .* can"),
    ("cuda", liquid, {"integrator": "baoab", "temperature": 1.0, "friction": 1.0, "noise": "refine"}, "noise: .* can"),
]  # fmt: skip


@pytest.mark.parametrize("k", range(len(REFUSED)), ids=lambda k: f"{REFUSED[k][0]}-{k}")
def test_refusals(k):
    engine, make, options, reason = REFUSED[k]
    with pytest.raises(kd.InputError, match=f"engine '{engine}': .*{reason}$"):
        kd.Simulation(make(), engine=engine, **({"dt": 0.01} | options if "ias15" not in options.values() else options))


def test_units_of_metres_are_refused():
    system = liquid(scale=3.4e-10, masses=6.6e-26, units="si", forces=[kd.LennardJones(1.7e-21, 3.4e-10)])
    with pytest.raises(kd.InputError, match=r"units .si.: float32 has no .*; only native can$"):
        kd.Simulation(system, engine="cuda", dt=1e-15, precision="mixed")
    for engine in ("ase", "lammps", "openmm"):
        with pytest.raises(kd.InputError, match=f"engine '{engine}': units 'si': .*; native and cuda can$"):
            kd.Simulation(system, engine=engine, dt=1e-15)


@pytest.mark.parametrize("engine", FOREIGN)
def test_not_installed(engine, monkeypatch, kickdrift):
    make, options = FIRST[engine]
    missing = ENGINES[engine].needs[-1]
    version = registry._version
    monkeypatch.setattr(registry, "_version", lambda package: None if package == missing else version(package))
    with pytest.raises(kd.InputError, match=rf"needs {missing}: pip install 'kickdrift\[{engine}\]'$"):
        kd.Simulation(make(), engine=engine, **options)
    code, out, _ = kickdrift("list", "engines")
    assert code == 0
    assert f"not installed: pip install 'kickdrift[{engine}]'" in " ".join(out.split())


def test_mpi_is_missing(monkeypatch):
    from kickdrift.forces.external import lammps_library

    monkeypatch.setattr(lammps_library, "_files", lambda package: [])
    monkeypatch.setattr(lammps_library, "LIBRARY", "libno-such-mpi.so")
    with pytest.raises(ImportError, match=r"MPI is missing \(libno-such-mpi.so\): pip install 'kickdrift\[lammps\]'"):
        lammps_library.lammps_class()
    with pytest.raises(ImportError, match="mpiexec is missing: pip install"):
        lammps_library.mpiexec()
    for processes in (1, 2):
        with pytest.raises(kd.InputError, match=r"engine 'lammps': MPI.* is missing"):
            kd.Simulation(liquid(), engine="lammps", dt=0.002, processes=processes).run(1)


@pytest.mark.parametrize("engine", FOREIGN)
def test_other_versions_are_told_of(engine, monkeypatch):
    make, options = FIRST[engine]
    assert kd.Simulation(make(), engine=engine, **options).run(1).warnings == []
    monkeypatch.setattr(registry, "_version", lambda package: "1999.1")
    warning = kd.Simulation(make(), engine=engine, **options).run(1).warnings
    tested = ", ".join(f"{major}.x" for major in ENGINES[engine].tested)
    assert warning == [f"{ENGINES[engine].needs[0]} 1999.1 is not a tested version: {tested}"]


def test_what_another_version_stumbles_over_is_one_line(monkeypatch, kickdrift):
    from kickdrift.engines.rebound import ReboundSession

    monkeypatch.setattr(ReboundSession, "reset", lambda *of: "text".safe_mode)
    with pytest.raises(AttributeError):  # for a tested version, the error is a fault of ours
        kd.Simulation(planets(), "whfast", 0.1, engine="rebound").run(1)
    version = registry._version
    monkeypatch.setattr(registry, "_version", lambda package: "4.4.3" if package == "rebound" else version(package))
    words = ("outer-solar-system", "--engine", "rebound", "--integrator", "whfast", "--steps", 2)
    code, _, err = kickdrift("run", *words)
    warning = "rebound 4.4.3 is not a tested version: 5.x"
    error = f"engine 'rebound': {warning}: AttributeError: 'str' object has no attribute 'safe_mode'"
    assert err.splitlines() == [f"warning: {warning}", f"kickdrift: {error}"]
    assert code == 2


def test_other_versions_are_told_of_once_and_before_the_run(monkeypatch, kickdrift, tmp_path):
    version = registry._version
    monkeypatch.setattr(registry, "_version", lambda package: "1999.1" if package == "ase" else version(package))
    monkeypatch.setattr(Integration, "prepare", lambda run: print("prepared", file=sys.stderr))
    words = ("run", "lj-1000", "--engine", "ase", "--steps", 1, "--json", tmp_path / "run.json")
    code, _, err = kickdrift(*words)
    said = [line for line in err.splitlines() if "1999.1" in line or line == "prepared"]
    assert code == 0
    assert said[0] == "warning: ase 1999.1 is not a tested version: 3.x"
    assert set(said[1:]) == {"prepared"}
    assert "1999.1" in json.loads((tmp_path / "run.json").read_text())["warnings"][0]


@pytest.mark.parametrize(
    ("arguments", "status", "said"),
    [
        (["lj-1000", "--engine", "lammps", "--steps", "2"], 0, "lammps 20"),
        (["lj-1000", "--engine", "lammps", "--processes", "2", "--steps", "2"], 0, "in 2 processes"),
        (["lj-1000", "--engine", "rebound", "--steps", "2"], 2, "engine 'rebound'"),
        (["outer-solar-system", "--engine", "rebound", "--integrator", "whfast", "--steps", "2"], 0, "rebound 5"),
        (["lj-1000", "--engine", "lammps", "--dt", "0.5", "--steps", "9"], 1, "LAMMPS: Lost atoms: original 1000"),
        (["test-particles-1000", "--engine", "openmm", "--integrator", "leapfrog"], 2, "native and cuda can"),
    ],
)
def test_command_line(arguments, status, said, kickdrift):
    code, out, err = kickdrift("run", *arguments)
    assert code == status
    assert said in (out if status == 0 else err)
    assert status == 0 or (out == "" and len(err.splitlines()) == 1)

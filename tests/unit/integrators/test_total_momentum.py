"""A motion of all particles together is no heat: baths, barostats, samples and certificates leave it alone."""

from __future__ import annotations

import numpy as np
import pytest

import kickdrift as kd
from kickdrift.analysis.certify.sampled_run import sampled_run
from kickdrift.model.freedom import DRIFT, NONE, TURN, apart_of, freedom_of, turning, whole_motion

RISE = np.array([0.5, -2.0, 30.0])
SPIN = np.array([0.1, 0.4, -0.3])
CSVR, CHAIN = {"temperature": 1.0, "tau": 0.2}, {"temperature": 1.0, "tau": 0.2, "chain": 2}
PRESSED = {"pressure": 2.0, "pressure_tau": 1.0}
RUNS = [
    ("velocity-verlet", {}),
    ("csvr", CSVR),
    ("nose-hoover", CHAIN),
    ("csvr", {**CSVR, **PRESSED, "compressibility": 0.1}),
    ("csvr", {**CSVR, **PRESSED, "compressibility": 0.1, "coupling": "per-axis"}),
    ("nose-hoover", {**CHAIN, **PRESSED, "barostat": "mtk"}),
]


def moved(system, rise=RISE, **changed):
    """The same system seen from a frame in motion."""
    state = system.state
    given = {"masses": state.masses, "box": system.box, "forces": system.forces, "units": system.units, **changed}
    return kd.System(state.positions, state.velocities + rise, **given)


@pytest.fixture(scope="module")
def liquid():
    """125 particles of two masses, near a lattice."""
    rng = np.random.default_rng(5)
    axis = np.arange(5) * 1.09
    x = np.stack(np.meshgrid(axis, axis, axis), -1).reshape(-1, 3) + rng.normal(scale=0.03, size=(125, 3))
    masses, v = np.where(np.arange(125) % 3, 1.0, 2.5), rng.normal(size=(125, 3))
    v -= masses @ v / masses.sum()
    return kd.System(x, v, masses=masses, box=[5.45] * 3, forces=[kd.LennardJones(cutoff=2.5, truncation="shift")])


@pytest.fixture(scope="module")
def cluster():
    """13 cold particles in open space: one and its twelve neighbours."""
    sites = np.array([[i, j, k] for i in (-1, 0, 1) for j in (-1, 0, 1) for k in (-1, 0, 1)])
    x = sites[np.isin((sites**2).sum(axis=1), (0, 2))] * (1.09 / np.sqrt(2.0))
    v = np.random.default_rng(2).normal(scale=0.15, size=x.shape)
    return kd.System(x, v - v.mean(axis=0), forces=[kd.LennardJones(cutoff=8.0)])


@pytest.mark.parametrize(("method", "options"), RUNS, ids=lambda value: str(value)[:12])
def test_a_run_is_the_same_in_a_frame_in_motion(liquid, method, options):
    """Galilei: temperatures, pressures and volumes are equal, and the motion stays."""
    found = []
    for system in (liquid, moved(liquid)):
        sim = kd.Simulation(system, method, dt=0.004, **options)
        sim.equilibrate(1.0, steps=20)
        report = sim.run(60, every=10)
        assert report.energy.rms_relative_error < 1e-3
        found.append([(each.temperature, each.pressure, each.volume) for each in sim.record.samples])
        assert ("the particles move as a whole" in str(report.warnings)) == (system is not liquid)
        last = sim.record.samples[-1]
    assert np.allclose(found[0], found[1], rtol=1e-9, equal_nan=True)
    assert np.allclose(last.centre_of_mass_velocity, RISE, rtol=1e-12)
    heat = 0.5 * last.temperature * (3 * 125 - 3)
    assert last.energies.kinetic == pytest.approx(heat + 0.5 * liquid.state.masses.sum() * RISE @ RISE, rel=1e-12)


@pytest.mark.parametrize(("method", "options"), RUNS[:3], ids=lambda value: str(value)[:12])
def test_a_cluster_in_open_space_goes_on_turning(cluster, method, options):
    x = cluster.state.positions
    system = moved(cluster, RISE + np.cross(SPIN, x))
    options = {**options, "temperature": 0.05} if options else {}
    sim = kd.Simulation(system, method, dt=0.005, **options)
    sim.equilibrate(0.05, steps=20)
    report = sim.run(400, every=100)
    first, last = sim.record.samples[0], sim.record.samples[-1]
    own = [each.angular_momentum - np.cross(each.centre_of_mass, each.momentum) for each in (first, last)]
    spun = np.cross(x, system.state.velocities - RISE).sum(axis=0)
    assert np.allclose(own, spun, rtol=1e-8)
    assert report.energy.max_relative_error < 1e-3
    places, v = sim.state.phase
    heat = 0.5 * ((v - whole_motion(np.ones(13), places, v, TURN)) ** 2).sum()
    assert last.temperature == pytest.approx(2.0 * heat / (3 * 13 - 6), rel=1e-10)


def test_degrees_of_freedom_are_counted_in_one_place(liquid, cluster):
    trap, gravity = kd.HarmonicTrap(1.0), kd.UniformField((0.0, 0.0, -1.0))
    pair = kd.LennardJones(cutoff=8.0)
    assert (apart_of(liquid), freedom_of(liquid)) == (DRIFT, 3 * 125 - 3)
    assert (apart_of(liquid, drags=True), freedom_of(liquid, drags=True)) == (NONE, 3 * 125)
    assert (apart_of(cluster), cluster.degrees_of_freedom) == (TURN, 3 * 13 - 6)
    assert apart_of(moved(cluster, forces=[pair, trap])) == NONE
    assert moved(cluster, forces=[pair, trap]).degrees_of_freedom == 3 * 13
    assert apart_of(moved(cluster, forces=[pair, gravity])) == TURN
    places = [[0.0, 0.0, 0.0], [1.2, 0.0, 0.0], [0.0, 1.2, 0.0]]
    plane, two = kd.System(places, forces=[pair], dimensions=2), kd.System(places[:2], forces=[pair])
    assert (freedom_of(plane), freedom_of(two), freedom_of(kd.System(places[:1], forces=[]))) == (3, 1, 0)


def test_rotation_takes_three_degrees_of_freedom_and_two_from_a_line(cluster):
    x = cluster.state.positions.T
    assert turning(np.ones(13), x).sum() == pytest.approx(3.0)
    line = np.array([[0.0, 1.0], [0.0, 2.0], [0.0, -1.0]])
    assert turning(np.array([1.0, 3.0]), line).sum() == pytest.approx(2.0)
    v = np.array([[1.0, -1.0], [0.5, 2.0], [0.0, 0.3]])
    motion = whole_motion(np.array([1.0, 3.0]), line, v, TURN)
    along = line[:, 1] / np.linalg.norm(line[:, 1])
    rest = (v - motion).T @ along  # only the vibration along the line is left
    assert np.allclose((v - motion).T, rest[:, None] * along)
    assert whole_motion(np.ones(2), line, np.zeros((3, 2)), TURN) is None


def test_langevin_takes_all_motion_for_heat(liquid):
    sim = kd.Simulation(moved(liquid, [1.0, 0.0, 0.0]), "baoab", dt=0.004, temperature=1.0, friction=1.0)
    sample = sim.integration.sample()
    assert sample.temperature == pytest.approx(2.0 * sample.energies.kinetic / (3 * 125), rel=1e-12)


def test_a_certificate_of_a_run_in_motion_is_that_of_the_run_at_rest(liquid, tmp_path):
    found = []
    for name, system in (("rest", liquid), ("motion", moved(liquid))):
        path = tmp_path / f"{name}.h5md"
        kd.Simulation(system, "csvr", dt=0.004, **CSVR).run(40, every=4, output=path)
        with kd.open(path) as run:
            found.append(sampled_run(run))
            tensor = kd.analysis.pressure_tensor(run)
            assert tensor.pressure == pytest.approx(run.observables["pressure"].mean(), rel=1e-9)
    rest, motion = found
    assert motion.freedom == rest.freedom == 3 * 125 - 3
    assert np.allclose(motion.kinetic, rest.kinetic, rtol=1e-9)
    for one, other in zip(motion.groups, rest.groups, strict=True):
        assert np.allclose(one.kinetic, other.kinetic, rtol=1e-9)


def test_a_certificate_of_a_cluster_leaves_its_rotation_out(cluster, tmp_path):
    path = tmp_path / "cluster.h5md"
    spun = moved(cluster, RISE + np.cross(SPIN, cluster.state.positions))
    sim = kd.Simulation(spun, "csvr", dt=0.005, temperature=0.05, tau=0.2)
    sim.run(40, every=4, output=path)
    with kd.open(path) as run:
        found = sampled_run(run)
    assert found.freedom == pytest.approx(3 * 13 - 6)
    assert np.allclose(found.kinetic, sampled_run(sim).kinetic, rtol=1e-9)


def test_atoms_of_ase_with_a_total_momentum(tmp_path):
    """A slab, periodic in the plane, whose momenta are drawn without care for their sum."""
    ase = pytest.importorskip("ase.build")
    slab = ase.fcc100("Ar", (3, 3, 3), a=5.3, vacuum=20.0)
    slab.set_momenta(np.random.default_rng(1).normal([3.0, 0.0, 1.0], size=(27, 3)))
    pair = kd.LennardJones(epsilon=0.0104, sigma=3.4, cutoff=5.5)
    system = kd.System.from_ase(slab, forces=[pair])
    sim = kd.Simulation(system, "csvr", dt=0.002, temperature=20.0, tau=0.05)
    sim.run(400, every=400)
    v, m = sim.state.velocities, system.coherent_masses
    v = v - m @ v / m.sum()
    atoms = (m @ (v**2).sum(axis=1)) / (3 * 26 * system.units.boltzmann)
    assert sim.record.samples[-1].temperature == pytest.approx(atoms, rel=1e-10)
    assert 10.0 < atoms < 35.0

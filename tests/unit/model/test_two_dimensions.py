"""Two-dimensional systems: the plane, lattices, degrees of freedom, pressure, tails and g(r)."""

from __future__ import annotations

import math

import numpy as np
import pytest

import kickdrift as kd
from kickdrift.analysis.observables.structure import radial_distribution
from kickdrift.errors import InputError
from kickdrift.looks.pressure import instantaneous_pressure
from kickdrift.model.starts.builders import maxwell_boltzmann, plane_lattice
from kickdrift.systemfile.reading import loads

FILE = """
units = "lj"
dimensions = 2
particles = {{lattice = "{lattice}", count = {count}, density = 0.8}}
velocities = {{temperature = 1.0, seed = 3}}
box.periodic = true
force = [{{type = "lennard-jones", cutoff = 2.5, truncation = "{truncation}", tail = {tail}}}]
"""


def liquid(lattice="hexagonal", count=480, truncation="switch", tail="false"):
    return loads(FILE.format(lattice=lattice, count=count, truncation=truncation, tail=tail))


def plane_sums(system, x):
    """Energy, virial and pairs, summed over all pairs in the plane by the formula of the law."""
    edges = np.array(system.box.lengths[:2])
    i, j = np.triu_indices(len(x), 1)
    apart = (x[i] - x[j])[:, :2]
    apart -= edges * np.round(apart / edges)
    r = np.linalg.norm(apart, axis=1)
    r = r[r < 2.5]
    return (4 * (r**-12 - r**-6)).sum(), (24 * (2 * r**-12 - r**-6)).sum(), len(r)


def test_a_plane_s_sums_temperature_and_pressure():
    system = liquid(truncation="cut")
    sim = kd.Simulation(system, "velocity-verlet", 0.002)
    sim.run(steps=300)
    x, v = sim.state.positions, sim.state.velocities
    sample = sim.sample()
    energy, virial, pairs = plane_sums(system, x)
    kinetic = 0.5 * (v**2).sum()
    assert sample.pairs == pairs
    assert sample.energies.potential == pytest.approx(energy, rel=1e-11)
    assert system.degrees_of_freedom == 2 * 480 - 2
    assert sample.temperature == pytest.approx(2 * kinetic / 958, rel=1e-12)
    lx, ly, _ = system.box.lengths
    assert system.volume == pytest.approx(lx * ly)
    assert sample.pressure == pytest.approx((2 * kinetic + virial) / (2 * lx * ly), rel=1e-11)
    tensor = instantaneous_pressure(system, x, v)
    assert np.trace(tensor) / 2 == pytest.approx(sample.pressure, rel=1e-11)
    assert not tensor[2].any()
    assert not tensor[:, 2].any()


@pytest.mark.parametrize("precision", ["double", "mixed"])
def test_particles_stay_in_the_plane_and_keep_their_energy(precision):
    system = liquid()
    sim = kd.Simulation(system, "velocity-verlet", 0.002, precision=precision)
    report = sim.run(steps=500, every=10)
    phase = sim.state.phase
    assert not phase[:, 2].any()
    assert np.abs(phase[0, :2] - system.state.phase[0, :2]).max() > 0.1
    assert report.energy.rms_relative_error < 1e-4
    assert report.pressure is not None


def test_the_tail_is_that_of_a_uniform_plane():
    """Per particle, pi rho times the integrals of U r and of -U' r^2 beyond the cutoff."""
    system = liquid(truncation="cut", tail="true")
    without = liquid(truncation="cut")
    energy, virial = system.forces[0].tail_corrections(system)
    rho, rc, n = 480 / system.volume, 2.5, 480
    assert energy == pytest.approx(n * math.pi * rho * 4 * (rc**-10 / 10 - rc**-4 / 4), rel=1e-10)
    assert virial == pytest.approx(n * math.pi * rho * 24 * (2 * rc**-10 / 10 - rc**-4 / 4), rel=1e-10)
    with_tail, plain = (kd.Simulation(s, "velocity-verlet", 0.002).sample() for s in (system, without))
    assert with_tail.energies.potential - plain.energies.potential == pytest.approx(energy, rel=1e-10)


def test_equilibration_reaches_the_temperature_of_a_plane():
    sim = kd.Simulation(liquid(), "velocity-verlet", 0.004)
    sim.equilibrate(0.7, 4.0)
    assert sim.sample().temperature == pytest.approx(0.7, abs=0.05)


def test_drawn_velocities_lie_in_the_plane():
    system = liquid()
    v = system.state.velocities
    assert not v[:, 2].any()
    assert np.abs(v.sum(axis=0)).max() < 1e-11
    assert (v**2).sum() == pytest.approx(2 * 479 * 1.0, rel=1e-12)
    masses = np.random.default_rng(1).uniform(1, 5, 50)
    drawn = maxwell_boltzmann(masses, 2.0, 1.0, 1, dimensions=2)
    assert (masses[:, None] * drawn**2).sum() == pytest.approx(2 * 49 * 2.0, rel=1e-12)


@pytest.mark.parametrize(
    ("kind", "count", "neighbours"), [("square", 100, 4), ("hexagonal", 120, 6), ("hexagonal", 480, 6)]
)
def test_lattices_go_on_across_the_edges(kind, count, neighbours):
    x, edges = plane_lattice(kind, count, 0.7)
    assert len(x) == count
    assert count / (edges[0] * edges[1]) == pytest.approx(0.7)
    assert max(edges) / min(edges) <= 1.5
    assert x[:, 2].tolist() == [0.0] * count
    apart = (x[:, None] - x)[..., :2]
    apart -= np.array(edges) * np.round(apart / edges)
    r = np.linalg.norm(apart, axis=-1)
    nearest = r[r > 0].min()
    assert (np.count_nonzero((r > 0) & (r < 1.01 * nearest), axis=1) == neighbours).all()
    expected = math.sqrt(1 / 0.7) if kind == "square" else math.sqrt(2 / (math.sqrt(3) * 0.7))
    assert nearest == pytest.approx(expected)


@pytest.mark.parametrize(
    ("kind", "count", "message"),
    [
        ("square", 99, "count: 99 does not fill a square lattice; the nearest counts are 81 and 100"),
        ("hexagonal", 101, "count: 101 does not fill a hexagonal lattice; the nearest counts are 100 and 108"),
        ("hexagonal", 1, "count: 1 does not fill a hexagonal lattice; the nearest count is 4"),
        ("triangle", 9, "lattice: expected one of square, hexagonal, got 'triangle'"),
    ],
)
def test_bad_lattices(kind, count, message):
    with pytest.raises(InputError) as refused:
        plane_lattice(kind, count, 0.8)
    assert str(refused.value).startswith(message)


def test_a_lattice_in_a_leaning_plane():
    text = FILE.format(lattice="square", count=100, truncation="shift", tail="false")
    leaning = loads(text.replace(", density = 0.8", "").replace("periodic = true", "matrix = [[11.0, 0], [5.5, 10.0]]"))
    assert leaning.box == kd.Box([[11.0, 0], [5.5, 10.0]])
    inside = leaning.box.fractional(leaning.state.positions)
    np.testing.assert_allclose(np.sort(inside[:, 0]), np.repeat(np.arange(10) / 10 + 0.05, 10))
    sample = kd.Simulation(leaning, "velocity-verlet", 0.002).sample()
    copies = leaning.state.positions[None] + np.array([[0.0, 0, 0], [5.5, 10.0, 0]])[:, None]
    upright = kd.System(copies.reshape(-1, 3), box=(11.0, 20.0), forces=leaning.forces, dimensions=2)
    twice = kd.Simulation(upright, "velocity-verlet", 0.002).sample()
    assert twice.energies.potential / 2 == pytest.approx(sample.energies.potential, rel=1e-12)


def test_g_of_r_in_the_plane():
    rng = np.random.default_rng(4)
    gas = np.zeros((40, 300, 3))
    gas[..., :2] = rng.uniform(0, [9.0, 12.0], (40, 300, 2))
    g = radial_distribution(gas, (9.0, 12.0), bins=20)
    assert np.abs(g.g[2:] - 1).max() < 0.05
    assert g.r[-1] == pytest.approx(4.5 * (1 - 1 / 40))
    crystal, edges = plane_lattice("hexagonal", 480, 0.8)
    g = radial_distribution(crystal, edges, bins=300)
    first = math.sqrt(2 / (math.sqrt(3) * 0.8))
    assert g.coordination[np.searchsorted(g.r, 1.2 * first)] == pytest.approx(6.0)
    slab = radial_distribution(rng.random((40, 300, 3)) * [9.0, 12.0, 4.0], (9.0, 12.0), bins=20)
    assert np.abs(slab.g[2:] - 1).max() < 0.1


X = np.array([[1.0, 1.0, 0.5], [4.0, 4.0, 0.5], [7.0, 7.0, 0.5]])


@pytest.mark.parametrize(
    ("given", "message"),
    [
        ({"positions": X + np.diag([0, 0, 0.25])}, "positions: particle 2 has z = 0.75; expected z = 0.5, as"),
        ({"velocities": np.diag([0, 0.5, -2.0])}, "velocities: particle 2 has vz = -2; expected vz = 0"),
        ({"box": (9.0, 9.0, 9.0)}, "box: expected two edge lengths, since a two-dimensional system"),
        ({"dimensions": 4}, "dimensions must be a whole number, from 2 to 3, got 4"),
        ({"dimensions": 3, "box": (9.0, 9.0)}, "box: expected three edge lengths or None, got 2; two go"),
        ({"dimensions": 3, "box": [[9.0, 0.0], [0.0]]}, "box: expected three edge lengths or None, got 2"),
        ({"box": [[9.0, 0.0], [0.0]]}, "box: expected a matrix of three rows of three numbers"),
        ({"forces": [kd.UniformField((0, 0, -1.0))]}, "uniform-field: acceleration has a z component of -1"),
        ({"forces": [kd.DrivenField((0, 0, 1.0), 2.0)]}, "driven-field: amplitude has a z component of 1"),
        ({"forces": [kd.HarmonicTrap(1.0)]}, "harmonic-trap: centre has z = 0, but the particles of this two-dimens"),
        ({"forces": [kd.HarmonicTrap(1.0, (0, 0, 1.0))]}, "harmonic-trap: centre has z = 1, but the particles of"),
        ({"forces": [kd.Oblateness(0.1, 0.2, pole=(1.0, 0, 1.0), G=1.0)]}, "j2: pole: expected a vector along z or in"),
    ],
)  # fmt: skip
def test_what_leaves_the_plane_is_refused(given, message):
    with pytest.raises(InputError) as refused:
        kd.System(**{"positions": X, "dimensions": 2, **given})
    assert str(refused.value).startswith(message)


class Unchecked(kd.UniformField):
    """A field that takes any system, as a force of the user's may."""

    def check(self, system):
        pass


def test_a_force_out_of_the_plane_is_refused_before_the_run():
    system = kd.System(X, dimensions=2, forces=[Unchecked((0.0, 0.0, 1.0))])
    with pytest.raises(InputError, match="dimensions: the forces push particle 0 out of the system's two dimensions"):
        kd.Simulation(system, "velocity-verlet", 0.01)


@pytest.mark.parametrize(
    "force",
    [
        kd.HarmonicTrap((1.0, 2.0, 0.0)),
        kd.HarmonicTrap(1.0, (1.0, 2.0, 0.5)),
        kd.UniformField((1.0, -2.0, 0.0)),
        kd.DrivenField((1.0, 0.5, 0.0), 2.0),
        kd.Springs([(0, 1)], 3.0, 1.0),
        kd.Oblateness(0.1, 0.2, G=1.0),
        kd.Oblateness(0.1, 0.2, pole=(3.0, -1.0, 0.0), G=1.0),
        kd.Gravity(G=1.0),
        kd.GravityTree(G=1.0),
    ],
    ids=str,
)
def test_forces_in_the_plane_keep_particles_there(force):
    in_plane = kd.System(X, dimensions=2, forces=[force])
    sim = kd.Simulation(in_plane, "velocity-verlet", 0.01)
    sim.run(steps=10)
    assert sim.state.phase[:, 2].tolist() == [[0.5] * 3, [0.0] * 3]


def test_a_state_out_of_the_plane_is_refused():
    sim = kd.Simulation(liquid(), "velocity-verlet", 0.002)
    state = sim.state.copy()
    state.phase[1, 2, 7] = 0.125
    with pytest.raises(InputError, match=r"velocities: particle 7 has vz = 0\.125"):
        sim.state = state


def test_two_coordinates_are_enough():
    flat = kd.System(X[:, :2], np.ones((3, 2)), box=[[9.0, 0.0], [4.5, 9.0]], dimensions=2)
    assert flat.state.positions.tolist() == [[1, 1, 0], [4, 4, 0], [7, 7, 0]]
    assert flat.volume == 81.0
    with pytest.raises(InputError, match=r"positions: expected shape \(n, 3\)"):
        kd.System(X[:, :2])


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("dimensions = 2", "dimensions = 4", "dimensions: expected 2 or 3, got 4"),
        ("dimensions = 2", "", "particles.lattice: expected sc or bcc or fcc or"),
        ('"hexagonal"', '"fcc"', "particles.lattice: expected square or hexagonal in 2 dimensions, got 'fcc'"),
        ("density = 0.8", 'density = "1 g/cm3"', "particles.density: expected a number of particles per area"),
        ("periodic = true", "lengths = [40.0]", "box.lengths: expected 2 items, got 1"),
    ],
)
def test_bad_files(old, new, message):
    text = FILE.format(lattice="hexagonal", count=480, truncation="shift", tail="false")
    with pytest.raises(InputError) as refused:
        loads(text.replace(old, new))
    assert message in str(refused.value)

"""Forces on listed particles, and pair forces that leave out or scale pairs, against plain NumPy."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
import pytest

import kickdrift as kd
from kickdrift.forces.bound.forces import BoundForces
from kickdrift.forces.lists.row_lanes import Narrow, NarrowSingle, WideSingle
from kickdrift.forces.pairs import binding as pair_binding
from kickdrift.trajectory.read.info import describe, info
from kickdrift_validation.molecules import OwnCosine, OwnFene

CUTOFF = 2.5
BOX = kd.Box([[7.3, 0.0, 0.0], [1.1, 7.2, 0.0], [-0.8, 1.7, 7.4]])
FACTORS = (0.0, 0.3, 0.75)
IMPROPERS = [(10 * k + 4, 10 * k + 3, 10 * k + 5, 10 * k + 7) for k in range(30)]


def snake(chains: int, length: int, seed: int = 3) -> np.ndarray:
    """Chains on a shaken lattice of 7^3 sites, whose neighbours along the chain are neighbours on the lattice."""
    sites = [
        (a, b if a % 2 == 0 else 6 - b, c if (a + b) % 2 == 0 else 6 - c)
        for a in range(7)
        for b in range(7)
        for c in range(7)
    ]
    rng = np.random.default_rng(seed)
    return 1.03 * np.array(sites[: chains * length]) + rng.uniform(-0.1, 0.1, (chains * length, 3))


def melt(forces=(), box=BOX, factors=FACTORS, chains=30, length=10, mixture=False, **more) -> kd.System:
    """Chains with a Lennard-Jones force and others."""
    lists = {"angles": True, "dihedrals": True, "impropers": IMPROPERS, "exclusions": [(0, 77)]}
    topology = kd.Topology.chains(chains, length, factors=factors, **lists)
    sizes = {"species": {"A": {}, "B": {"sigma": 0.9, "epsilon": 0.6}, "C": {"sigma": 0.95}}} if mixture else {}
    species = ["ABC"[k % 3] for k in range(chains * length)] if mixture else None
    pair = kd.LennardJones(cutoff=CUTOFF, **sizes)
    x = snake(chains, length)
    return kd.System(x, box=box, forces=[pair, *forces], species=species, topology=topology, **more)


def pair_sums(system: kd.System) -> tuple[np.ndarray, float, float, int]:
    """Forces, energy, virial and number of pairs of the first force, pair by pair."""
    x, force = system.state.positions, system.forces[0]
    i, j = np.triu_indices(len(x), 1)
    apart = system.box.minimum_image(x[i] - x[j])
    r2 = (apart**2).sum(axis=1)
    factor = system.topology.factor_of(i, j)
    found, energy, virial, count = np.zeros_like(x), 0.0, 0.0, 0
    for k in np.flatnonzero((r2 < CUTOFF**2) & (factor > 0)):
        law = force.pair_law(*(system.species[system.species_index[each[k]]] for each in (i, j)))
        u, over_r = law.law(r2[k])
        energy += factor[k] * (u - law.law(CUTOFF**2)[0])
        virial += factor[k] * over_r * r2[k]
        found[i[k]] += factor[k] * over_r * apart[k]
        found[j[k]] -= factor[k] * over_r * apart[k]
        count += 1
    return found, energy, virial, count


@pytest.mark.parametrize("mixture", [False, True])
@pytest.mark.parametrize("box", [BOX, None])
def test_pair_forces_leave_out_and_scale(box, mixture):
    system = melt(box=box, mixture=mixture)
    forces, energy, virial, count = pair_sums(system)
    for threads in (1, 2):
        found = BoundForces(system, threads).measure(0.0, system.state.phase)
        np.testing.assert_allclose(found.accelerations.T, forces, atol=1e-12 * np.abs(forces).max(), rtol=0)
        assert found.potential == pytest.approx(energy, rel=1e-12)
        assert found.virial == pytest.approx(virial, rel=1e-12)
        assert found.pairs == count


@pytest.mark.parametrize("mixed", [False, pytest.param(True, marks=pytest.mark.long)])
def test_chunks_that_share_memory_give_the_bits_of_chunks_on_threads(mixed):
    """More than 4000 particles have four chunks, which share the memory of their forces on one thread."""
    side = 16
    x = 1.1 * np.indices((side,) * 3).reshape(3, -1).T + np.random.default_rng(3).uniform(-0.1, 0.1, (side**3, 3))
    topology = kd.Topology.chains(side**2, side, factors=FACTORS)
    pair = kd.LennardJones(cutoff=CUTOFF)
    system = kd.System(x, box=(1.1 * side,) * 3, forces=[pair], topology=topology)
    shared, own = (BoundForces(system, threads, mixed=mixed) for threads in (1, 2))
    for shift in (0.0, 0.02, 2.0):  # the list stays, is pruned, and is made again
        phase = np.array(system.state.phase)
        phase[0, 0, ::7] += shift
        with_shared, with_own = (bound.measure(0.0, phase) for bound in (shared, own))
        np.testing.assert_array_equal(with_shared.accelerations, with_own.accelerations)
        assert with_shared.potential == with_own.potential


@pytest.mark.long
@pytest.mark.parametrize("lanes", [Narrow(), WideSingle(), NarrowSingle()], ids=lambda lanes: type(lanes).__name__)
def test_exclusions_with_other_widths_of_lanes(monkeypatch, lanes):
    monkeypatch.setattr(pair_binding, "row_lanes", lambda mixed: lanes)
    system, single = melt(), not isinstance(lanes, Narrow)
    forces, energy, *_ = pair_sums(system)
    found = BoundForces(system, mixed=single).measure(0.0, system.state.phase)
    off = 1e-5 if single else 1e-12
    np.testing.assert_allclose(found.accelerations.T, forces, atol=off * np.abs(forces).max(), rtol=0)
    assert found.potential == pytest.approx(energy, rel=off)


def test_factors_of_one_change_no_bit():
    """A list without special pairs is the list of a system without a topology."""
    plain, ones = melt(), melt(factors=(1.0, 1.0, 1.0))
    free = plain.remade(topology=None)
    ones = ones.remade(topology=kd.Topology.chains(30, 10, factors=(1.0, 1.0, 1.0)))
    bits = [BoundForces(each).measure(0.0, each.state.phase).accelerations.tobytes() for each in (free, ones, plain)]
    assert bits[0] == bits[1] != bits[2]


def test_excluded_particles_may_overlap():
    x = [[0.0, 0.0, 0.0], [0.1, 0.0, 0.0], [2.0, 0.0, 0.0]]
    text = """
        units = "lj"
        [particles]
        positions = [[0, 0, 0], [0.1, 0, 0], [2, 0, 0]]
        [topology]
        bonds = [[0, 1]]
        factors = [{}, 1, 1]
        [[force]]
        type = "lennard-jones"
    """
    from kickdrift.systemfile.reading import loads

    system = loads(text.format(0))
    np.testing.assert_array_equal(system.state.positions, x)
    found = kd.Simulation(system, dt=0.001).forces()
    assert np.abs(found).max() < 1.0
    with pytest.raises(kd.InputError, match="particles 0 and 1 overlap"):
        loads(text.format(1))


# --- bonds, angles, dihedrals, impropers ---

FORCES = [
    kd.HarmonicBond(100.0, 1.0),
    kd.HarmonicAngle(10.0, 109.5),
    kd.PeriodicDihedral(2.0, 3.0, 30.0),
    kd.HarmonicImproper(4.0, 35.0),
    kd.PeriodicImproper(1.5, 2.0, 180.0),
]


def test_energies_are_the_laws_at_the_values_of_mdanalysis():
    """Distances, angles and dihedrals from MDAnalysis, the laws in plain Python."""
    from MDAnalysis.lib.distances import calc_angles, calc_bonds, calc_dihedrals

    system = melt().with_forces(*FORCES)
    x, topology = system.state.positions, system.topology
    for force, calculate in zip(FORCES, (calc_bonds, calc_angles, *[calc_dihedrals] * 3), strict=True):
        items = getattr(topology, force.kind)
        values = calculate(*(x[items[:, k]] for k in range(items.shape[1])))  # chains are whole here
        energy = sum(force.law.law(float(value))[0] for value in values)
        found = BoundForces(system.under([force])).measure(0.0, system.state.phase)
        assert found.potential == pytest.approx(energy, rel=1e-6)  # MDAnalysis has float32
        if force.kind != "bonds":
            assert found.virial == 0.0


def test_bonded_forces_go_to_nearest_images():
    """Particles moved by whole edges have the same forces; without a torque on a whole molecule in open space."""
    system = melt(FORCES)
    whole = np.random.default_rng(5).integers(-2, 3, (len(system), 3)) @ BOX.matrix
    moved = system.remade(positions=system.state.positions + whole)
    first, second = (BoundForces(each).measure(0.0, each.state.phase) for each in (system, moved))
    scale = np.abs(first.accelerations).max()
    np.testing.assert_allclose(second.accelerations, first.accelerations, atol=1e-12 * scale, rtol=0)
    assert second.potential == pytest.approx(first.potential, rel=1e-12)
    free = melt(box=None).with_forces(*FORCES)
    forces = kd.Simulation(free, dt=0.001).forces()
    gross = np.abs(forces).sum()
    assert np.abs(forces.sum(axis=0)).max() < 1e-13 * gross
    assert np.abs(np.cross(free.state.positions, forces).sum(axis=0)).max() < 1e-12 * gross


def test_an_improper_is_the_height_of_its_first_particle_over_the_plane_of_the_others():
    """Four particles, the first in the middle of a triangle and lifted: the angle by trigonometry, for both signs."""
    force = kd.HarmonicImproper(3.0, 10.0)
    for height in (0.4, -0.4):
        corners = [[math.cos(a), math.sin(a), 0.0] for a in (0.0, 2 * math.pi / 3, 4 * math.pi / 3)]
        topology = kd.Topology(impropers=[(0, 1, 2, 3)])
        system = kd.System([[0.0, 0.0, height], *corners], forces=[force], topology=topology)
        bend = math.atan2(abs(height), 0.5) - math.radians(10.0)  # the side of the triangle is 1/2 from its centre
        sim = kd.Simulation(system, dt=0.01)
        assert sim.energy().potential == pytest.approx(1.5 * bend**2, rel=1e-12)
        lifts = -3.0 * bend * 0.5 / (height**2 + 0.25) * math.copysign(1.0, height)  # -U' d(angle)/d(height)
        assert sim.forces()[0, 2] == pytest.approx(lifts, rel=1e-12)


def test_types_have_parameters_of_their_own():
    x = snake(1, 6)
    topology = kd.Topology.chains(1, 6, bond_types=["a", "b", "a", "c", "a"])
    force = kd.HarmonicBond(50.0, 1.0, types={"a": {}, "c": {"length": 1.2, "stiffness": 7.0}})
    system = kd.System(x, forces=[force], topology=topology)
    r = np.linalg.norm(np.diff(x, axis=0), axis=1)
    wanted = 25.0 * ((r[[0, 2, 4]] - 1.0) ** 2).sum() + 3.5 * (r[3] - 1.2) ** 2
    assert kd.Simulation(system, dt=0.01).energy().potential == pytest.approx(wanted, rel=1e-13)


@pytest.mark.long
def test_a_users_law_has_the_bits_of_ours_and_comes_back_from_a_file(tmp_path):
    phases = []
    for forces in ([kd.Fene(), kd.CosineAngle(1.5)], [OwnFene(), OwnCosine(1.5)]):
        system = melt(forces, factors=(0.0, 1.0, 1.0))
        sim = kd.Simulation(system, dt=0.002)
        path = tmp_path / f"{len(phases)}.h5md"
        sim.run(20, every=10, output=path)
        resumed = kd.resume(path)
        resumed.run(20)
        sim.run(20)
        np.testing.assert_array_equal(resumed.state.phase, sim.state.phase)
        assert resumed.system.topology == system.topology
        phases.append(sim.state.phase)
    np.testing.assert_array_equal(*phases)
    run = kd.open(tmp_path / "0.h5md")
    assert "270 bonds, 240 angles, 210 dihedrals, 30 impropers, 1 exclusion" in describe(info(tmp_path / "0.h5md"))
    np.testing.assert_array_equal(run.universe().bonds.indices, system.topology.bonds)
    import h5py

    with h5py.File(tmp_path / "0.h5md") as file:
        np.testing.assert_array_equal(file["connectivity/dihedrals"][()], system.topology.dihedrals)


def test_fene_with_its_core_is_fene_and_the_repulsion_of_the_pair():
    """The two forms of Kremer and Grest's bond: the core in the bond, or in a pair force that leaves nothing out."""
    pair = kd.LennardJones(1.2, 0.9, cutoff=0.9 * 2 ** (1 / 6), truncation="shift")
    whole = kd.System(snake(1, 2), topology=kd.Topology([(0, 1)]), forces=[kd.Fene(epsilon=1.2, sigma=0.9)])
    apart = whole.remade(forces=[kd.Fene(), pair])
    for length in (0.8, 0.95, 1.0, 1.02, 1.3):  # the core ends at 1.0102
        x = [[0.0, 0.0, 0.0], [0.0, length, 0.0]]
        first, second = (kd.Simulation(each.remade(positions=x), dt=0.01) for each in (whole, apart))
        np.testing.assert_allclose(first.forces(), second.forces(), rtol=1e-12, atol=1e-12)
        assert first.energy().potential == pytest.approx(second.energy().potential, rel=1e-12)


def test_the_pressure_tensor_has_bonds_and_factors():
    from kickdrift.looks.pressure import instantaneous_pressure

    system = melt([kd.HarmonicBond(100.0, 0.9)])
    state = system.state
    tensor = instantaneous_pressure(system, state.positions, state.velocities)
    assert np.trace(tensor) / 3 == pytest.approx(kd.Simulation(system, dt=0.001).sample().pressure, rel=1e-12)


# --- what is refused ---

LINE = [[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [2.0, 0.0, 0.0], [3.0, 0.3, 0.0]]


@pytest.mark.parametrize(
    ("bonds", "force", "more", "message"),
    [
        ([(0, 3)], kd.Fene(), {}, "bond 0 of particles 0 and 3 has the length 3.01496, where the law has no"),
        ([(0, 2)], kd.HarmonicBond(1.0, 1.0), {"box": (4, 4, 4)}, "2 long; it must be under 0.49 of the shortest"),
        ([(0, 1)], kd.HarmonicAngle(1.0, 90.0), {}, "harmonic-angle: the system lists no angles"),
        ([(0, 1)], kd.Fene(types={"b": {}}), {}, "fene: types: the system has no bonds of type b; its types are 1"),
        ([(0, 1)], kd.Fene(), {"masses": [0, 1, 1, 1]}, "fene: particle 0 has no mass"),
    ],
)  # fmt: skip
def test_a_system_that_does_not_fit_a_force_is_refused(bonds, force, more, message):
    with pytest.raises(kd.InputError, match=message):
        kd.System(LINE, topology=kd.Topology(bonds), forces=[force], **more)


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: kd.HarmonicBond(1.0, -1.0), "harmonic-bond: length must be a length, zero or more, got -1.0"),
        (lambda: kd.HarmonicBond(math.inf, 1.0), "harmonic-bond: stiffness: expected a finite number"),
        (lambda: kd.Fene(sigma=0.9), "fene: sigma is 0.9 and epsilon 0: the core has no strength; give epsilon too"),
        (lambda: kd.Fene(types={}), "fene: types: expected a table of types"),
        (lambda: kd.HarmonicBond(-1.0, 1.0), "harmonic-bond: stiffness must be zero or more, got -1.0"),
        (lambda: kd.Fene(stiffness=-30.0), "fene: stiffness must be zero or more, got -30.0"),
        (lambda: kd.Fene(epsilon=-1.0), "fene: epsilon must be zero or more, got -1.0"),
        (lambda: kd.Fene(length=0.0), "fene: length must be positive, got 0"),
        (lambda: kd.MorseBond(-1.0, 1.0, 1.0), "morse-bond: depth must be zero or more, got -1.0"),
        (lambda: kd.MorseBond(1.0, -1.0, 1.0), "morse-bond: width must be zero or more, got -1.0"),
        (lambda: kd.HarmonicAngle(1.0, 181.0), "harmonic-angle: rest must be 0 to 180 degrees, got 181: no angle"),
        (lambda: kd.HarmonicAngle(1.0, 90.0, types={"a": {"rest": -1.0}}), "type a: rest must be 0 to 180 degrees"),
        (lambda: kd.HarmonicImproper(1.0, 181.0), "harmonic-improper: rest must be 0 to 180 degrees, got 181: the"),
        (lambda: kd.HarmonicImproper(1.0, -200.0), "harmonic-improper: rest must be 0 to 180 degrees, got -200"),
        (lambda: kd.PeriodicDihedral(10.0, 1.5, 45.0), "multiplicity must be a whole number, zero or more, got 1.5"),
        (lambda: kd.PeriodicDihedral(10.0, -2.0), "multiplicity must be a whole number, zero or more, got -2"),
        (lambda: kd.PeriodicImproper(10.0, 2.5), "periodic-improper: multiplicity must be a whole number"),
        (lambda: kd.Fene(types={"a": {"stiffnes": 1.0}}), "unknown parameter 'stiffnes'; did you mean 'stiffness'"),
    ],
)
def test_wrong_parameters_are_refused(make, message):
    with pytest.raises(kd.InputError, match=message):
        make()


def test_wrong_laws_are_refused():
    class NoSlope(NamedTuple):
        k: float = 1.0

        def law(p, r):
            return p.k * r * r, p.k * r

    class OneValue(NamedTuple):
        def law(p, r):
            return r

    class ThreeArguments(NamedTuple):
        def law(p, r, q):
            return r, 1.0

    class Jumping(NamedTuple):
        k: float = 1.0

        def law(p, angle):
            return p.k * angle, p.k

    with pytest.raises(kd.InputError, match=r"same at -180 and 180 degrees, .* it jumps from -3\.14159 to 3\.14159"):
        kd.dihedral_law(Jumping)()
    for cls, message in (
        (NoSlope, r"law must return the energy and its slope dU/d\(r\); at r = 1.31 it returns 1.31"),
        (OneValue, "must return two numbers, energy and slope"),
        (ThreeArguments, r"law must take \(p, r\); it takes \(p, r, q\)"),
    ):
        with pytest.raises(kd.InputError, match=message):
            kd.bond_law(cls)()


@pytest.mark.parametrize(
    ("force", "box", "message"),
    [
        (kd.Fene(), None, r"at step 3 .*: fene: bond 1 of particles 0 and 1 has the length 1.\d+, where"),
        (kd.HarmonicBond(0.1, 1.0), (3.8, 4, 4), r"step \d+ .*-bond: bond 1 of particles 0 and 1 is 1.8\d+ long"),
    ],
)  # fmt: skip
def test_a_bond_that_is_too_long_at_a_step_is_named(force, box, message):
    x, v = [[0, 0, 0], [1.2, 0, 0], [0, 2, 0], [0.9, 2, 0]], [[-15, 0, 0], [15, 0, 0], [0, 0, 0], [0, 0, 0]]
    system = kd.System(x, v, box=box, topology=kd.Topology([(2, 3), (0, 1)]), forces=[force])
    with pytest.raises(kd.RunError, match=message):
        kd.Simulation(system, dt=0.005).run(100)


CHAIN = np.column_stack([np.arange(8.0), np.zeros(8), np.zeros(8)])


@pytest.mark.parametrize(
    ("given", "edge", "pair", "apart"),
    [
        ({"factors": (0, 0, 0.5)}, 6.1, (0, 3), 3),
        ({"factors": (0, 0, 1)}, 4.05, (0, 2), 2),
        ({"exclusions": [(1, 3)]}, 4.05, (1, 3), 2),
        ({"exclusions": [(1, 7)]}, 12.2, (1, 7), 6),
    ],
)
@pytest.mark.parametrize("leans", [False, True])
def test_a_box_too_short_for_the_bonded_image_of_a_special_pair_is_refused(given, edge, pair, apart, leans):
    """In such a box the nearest image of the pair is not the one that the bonds join, and its factor goes there."""

    def system(edge):
        box = kd.Box([[edge, 0, 0], [0.3, edge, 0], [0, 0.2, edge]]) if leans else (edge, edge, edge)
        topology = kd.Topology.chains(1, 8, **given)
        return kd.System(CHAIN + 0.5, box=box, topology=topology, forces=[kd.LennardJones(cutoff=2.0)])

    first, last = pair
    message = f"lennard-jones: particles {first} and {last}, which .* are {apart} apart along their bonds; they must be"
    with pytest.raises(kd.InputError, match=message):
        system(edge)
    system(edge * 1.05)


def test_exclusions_of_particles_that_no_bonds_join_mean_the_nearest_image():
    topology = kd.Topology([(0, 1)], exclusions=[(0, 4)])
    kd.System(CHAIN, box=(8.5, 4.5, 4.5), topology=topology, forces=[kd.LennardJones(cutoff=2.0)])


def test_a_chain_through_the_box_is_measured_along_its_shortest_path():
    """Particles 0 and 4 of a ring through the box are bonded, not four bonds apart."""
    bonds = [(k, (k + 1) % 5) for k in range(5)]
    topology = kd.Topology(bonds, factors=(0, 0, 1))
    kd.System(CHAIN[:5], box=(5, 5, 5), topology=topology, forces=[kd.LennardJones(cutoff=2.0)])


def test_a_run_that_stretches_a_special_pair_too_far_says_so():
    topology = kd.Topology.chains(1, 4, factors=(0, 0, 0))
    v = [[-10.0, 0, 1], [0, 1, 0], [0, -1, 0], [10.0, 0, -1]]
    system = kd.System(CHAIN[:4], v, box=(8, 8, 8), topology=topology, forces=[kd.LennardJones(cutoff=2.0)])
    assert not kd.Simulation(system, dt=0.001).run(10).warnings
    (warning,) = kd.Simulation(system, dt=0.001).run(60).warnings
    assert warning.startswith("particles 0 and 3, which the topology leaves out or scales, are 4.2")


def test_joined_particles_neither_merge_nor_leave():
    topology = kd.Topology([(0, 1)])
    with pytest.raises(kd.InputError, match="cannot act on bodies joined by fene, bonds"):
        kd.System(LINE, topology=topology, forces=[kd.Fene()], radii=0.1, events=[kd.Collision(action="merge")])

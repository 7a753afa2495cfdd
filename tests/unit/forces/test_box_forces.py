"""Forces in leaning boxes, and in boxes that are open along some axes, against plain sums over images."""

from __future__ import annotations

import itertools
import json

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import kickdrift as kd
from kickdrift.forces.bound.forces import BoundForces
from kickdrift.forces.lists.clusters import N_CLUSTERS, SHIFT_BITS
from kickdrift.looks.pressure import instantaneous_pressure
from kickdrift.model.box.box import Box
from kickdrift.systemfile.reading import loads
from kickdrift_validation.folders import DATA
from tests.long import rest
from tests.oracle.agreement import assert_right
from tests.oracle.forces import pair_oracle
from tests.systems import SPECIES, on_grid

NIST = DATA / "nist-lj"
LEANING = np.array([[10.0, 0.0, 0.0], [-5.0, 9.0, 0.0], [4.0, 4.5, 8.0]])
AXES = [axes for axes in itertools.product((True, False), repeat=3) if any(axes)]

tilts = st.sampled_from([-0.5, 0.0, 0.5]) | st.floats(-0.5, 0.5)
edges = st.floats(2.0, 30.0)


def liquid(matrix, n, seed, stretch=1.0):
    """A System of n shaken particles in a box, some of them displaced by whole edges."""
    rng = np.random.default_rng(seed)
    cells = int(np.ceil(n ** (1 / 3)))
    sites = rng.permutation(np.indices((cells,) * 3).reshape(3, -1).T)[:n]
    fractions = (sites + rng.uniform(-0.2, 0.2, (n, 3))) / cells + rng.integers(-2, 3, (n, 3))
    return on_grid(fractions @ matrix)


@pytest.mark.long
@settings(max_examples=60, deadline=None)
@given(
    st.tuples(edges, edges, edges), st.tuples(tilts, tilts, tilts), st.sampled_from([(True,) * 3] * 3 + AXES),
    st.integers(1, 300), st.floats(0.3, 1.0), st.integers(0, 2**32 - 1),
)  # fmt: skip
def test_forces_are_sums_over_nearest_images(lengths, leans, axes, n, share, seed):
    """Boxes up to the largest tilt, flat and long ones, with cutoffs up to half the least height."""
    a, b, c = (2 * float(on_grid(edge / 2)) for edge in lengths)  # half an edge is on the grid too
    matrix = on_grid([[a, 0, 0], [leans[0] * a, b, 0], [leans[1] * a, leans[2] * b, c]])
    both = np.array(axes)
    matrix = np.where(np.outer(both, both), matrix, np.diag(np.diag(matrix)))
    box = Box(matrix=matrix, periodic=axes)
    cutoff = share * 0.5 * float(box.heights.min())
    x = liquid(matrix, n, seed)
    force = kd.LennardJones(sigma=0.25 * cutoff, cutoff=cutoff)
    assert_right(kd.System(x, box=box, forces=[force]))


@pytest.mark.parametrize(
    ("truncation", "mixture"),
    [
        ("cut", False), ("shift", True), rest("force-shift", False), rest("switch", True),
        rest("cut", True), rest("shift", False), rest("force-shift", True), rest("switch", False),
    ],
)  # fmt: skip
def test_every_truncation_and_mixture(truncation, mixture):
    x = liquid(LEANING, 500, 3)
    species = list("ABAC" * 125) if mixture else None
    force = kd.LennardJones(cutoff=2.5, truncation=truncation, species=SPECIES if mixture else None)
    assert_right(kd.System(x, box=LEANING, forces=[force], species=species))


def test_springs_go_to_the_nearest_image():
    x = liquid(LEANING, 60, 5)
    pairs = [(i, i + 1) for i in range(59)]
    system = kd.System(x, box=LEANING, forces=[kd.Springs(pairs, 3.0, 0.5)])
    measured = BoundForces(system).measure(0.0, system.state.phase)
    forces, energy, virial, _ = pair_oracle(system)
    np.testing.assert_allclose(measured.accelerations.T, forces, atol=1e-12 * np.abs(forces).max())
    assert measured.potential == pytest.approx(energy, rel=1e-12)
    assert measured.virial == pytest.approx(virial, rel=1e-12)
    flat = np.array([[10.0, 0.0, 0.0], [0.0, 8.0, 0.0], [3.0, 1.0, 0.75]])  # whole edges miss the nearest
    shifted = liquid(flat, 60, 6)
    system = kd.System(shifted, box=flat, forces=[kd.Springs(pairs, 3.0)])
    i, j = np.array(pairs).T
    steps = np.array(list(itertools.product(range(-9, 10), repeat=3))) @ flat
    begun = Box(flat).wrap(shifted)
    apart = begun[i] - begun[j]
    expected = 1.5 * sum(((d + steps) ** 2).sum(axis=1).min() for d in apart)
    measured = BoundForces(system).measure(0.0, system.state.phase)
    assert measured.potential == pytest.approx(expected, rel=1e-12)


def supercell(matrix, times):
    """Whole-number combinations (m, 3) of edge vectors, one for each copy of the box in a larger one."""
    return np.array(list(itertools.product(*map(range, times)))) @ matrix


def test_a_leaning_box_equals_its_orthorhombic_supercell():
    """Tilts of half an edge: 4 c - 2 b - a and 2 b - a are perpendicular, so eight copies fill a rectangular box."""
    matrix = np.array([[9.0, 0, 0], [4.5, 8.0, 0], [4.5, 4.0, 8.5]])
    x = liquid(matrix, 500, 7)
    copies = supercell(matrix, (1, 2, 4))
    upright = (9.0, 16.0, 34.0)
    assert np.allclose(2 * matrix[1] - matrix[0], [0, 16, 0])
    assert np.allclose(4 * matrix[2] - 2 * matrix[1] - matrix[0], [0, 0, 34])
    for force in (kd.LennardJones(cutoff=2.5, truncation="force-shift"), kd.LennardJones(cutoff=3.0, truncation="cut")):
        one = kd.System(x, box=matrix, forces=[force])
        all_of_them = kd.System((x[None] + copies[:, None]).reshape(-1, 3), box=upright, forces=[force])
        small, large = (BoundForces(s).measure(0.0, s.state.phase) for s in (one, all_of_them))
        assert large.pairs == 8 * small.pairs
        assert large.potential / 8 == pytest.approx(small.potential, rel=1e-12)
        assert large.virial / 8 == pytest.approx(small.virial, rel=1e-12)
        theirs, ours = large.accelerations.reshape(3, 8, 500), small.accelerations
        assert np.abs(theirs - ours[:, None]).max() <= 1e-12 * np.abs(ours).max()
        v = np.random.default_rng(1).normal(size=x.shape)
        tensors = [
            instantaneous_pressure(one, x, v),
            instantaneous_pressure(all_of_them, all_of_them.state.positions, np.tile(v, (8, 1))),
        ]
        np.testing.assert_allclose(*tensors, rtol=1e-11, atol=1e-11 * np.abs(tensors[0]).max())
        masses = one.state.masses
        diagonal = (2 * 0.5 * (masses @ (v**2).sum(axis=1)) + small.virial) / (3 * one.box.volume)
        assert np.trace(tensors[0]) / 3 == pytest.approx(diagonal, rel=1e-11)


@pytest.mark.parametrize("number", ["2", "4"])
@pytest.mark.parametrize("signs", [(1, 1, 1), (-1, 1, -1), (1, -1, 1)])
def test_nist_configurations_in_a_sheared_cell_keep_their_energies(number, signs):
    """Four copies of the cube in a cell with every tilt at its limit; the cell's lattice is part of the cube's."""
    lines = (NIST / f"lj_sample_config_periodic{number}.txt").read_text().splitlines()
    x = np.array([[float(v) for v in line.split()[1:4]] for line in lines[2:] if line.strip()])
    expected = json.loads((NIST / "reference.json").read_text())[number]
    s, t, u = signs
    matrix = np.array([[16.0, 0, 0], [8.0 * s, 16.0, 0], [8.0 * t, 8.0 * u, 8.0]])
    four = (x[None] + supercell(np.diag([8.0] * 3), (2, 2, 1))[:, None]).reshape(-1, 3)
    for cutoff in (3, 4):
        for truncation, key in (("cut", "cut"), ("shift", "shift"), ("force-shift", "lfs")):
            force = kd.LennardJones(cutoff=float(cutoff), truncation=truncation)
            system = kd.System(four, box=matrix, forces=[force])
            measured = BoundForces(system).measure(0.0, system.state.phase)
            right = expected[f"{key}{cutoff}"]
            assert measured.pairs == 4 * right["npairs"]
            assert measured.potential == pytest.approx(4 * right["U"], rel=1e-12)
            assert measured.virial == pytest.approx(4 * right["W"], rel=1e-12)


@settings(max_examples=15, deadline=None)
@given(st.tuples(tilts, tilts, tilts), st.sampled_from(AXES), st.integers(2, 400), st.integers(0, 2**32 - 1))
def test_the_list_holds_every_pair_within_its_skin_once(leans, axes, n, seed):
    a, b, c = 12.0, 10.0, 11.0
    matrix = on_grid([[a, 0, 0], [leans[0] * a, b, 0], [leans[1] * a, leans[2] * b, c]])
    both = np.array(axes)
    matrix = np.where(np.outer(both, both), matrix, np.diag(np.diag(matrix)))
    x = liquid(matrix, n, seed)
    system = kd.System(x, box=Box(matrix, periodic=axes), forces=[kd.LennardJones(cutoff=2.0)])
    forces = BoundForces(system)
    forces.measure(0.0, system.state.phase)
    (bound,) = forces.forces
    found, expected = listed(bound.pairs, n), images_within(bound.pairs, system)
    np.testing.assert_allclose(found, expected, atol=1e-9)


def listed(pairs, n):
    """Sorted distances of all pairs of images in the outer list that are within its reach."""
    clusters, chunks = int(pairs.counts[N_CLUSTERS]), len(pairs.near)
    slots = pairs.x.reshape(-1, 3, 8).transpose(0, 2, 1)  # cluster, lane, axis
    reach, found = pairs.cutoff + pairs.outer_skin, []
    for chunk in range(chunks):
        for cluster in range(chunk * clusters // chunks, (chunk + 1) * clusters // chunks):
            mine = slots[cluster, : pairs.filled[cluster]]
            i, j = np.triu_indices(len(mine), 1)
            found.append(np.linalg.norm(mine[i] - mine[j], axis=1))
            for entry in pairs.near[chunk, slice(*pairs.near_span[cluster])]:
                other, shift = entry >> SHIFT_BITS, entry & 31
                theirs = slots[other, : pairs.filled[other]] + pairs.shifts[:, shift]
                found.append(np.linalg.norm(mine[:, None] - theirs, axis=-1).ravel())
    distances = np.concatenate(found)
    return np.sort(distances[distances < reach])


def images_within(pairs, system):
    """The same distances, computed from the lattice."""
    rows = system.box.matrix * np.array(system.box.periodic_axes)[:, None]
    x = system.state.positions - pairs.offset[pairs.place[:, None] + 8 * np.arange(3)]
    i, j = np.triu_indices(len(x), 1)
    steps = np.array([n for n in itertools.product(range(-3, 4), repeat=3) if not (np.array(n) @ rows == 0).all()])
    steps = np.unique(steps @ rows, axis=0)
    apart = np.concatenate([np.zeros((1, 3)), steps])
    all_pairs = np.linalg.norm((x[i] - x[j])[:, None] + apart, axis=-1).ravel()
    own = np.repeat(np.linalg.norm(steps, axis=1), len(x)) if len(steps) else np.zeros(0)
    reach = pairs.cutoff + pairs.outer_skin
    return np.sort(np.concatenate([all_pairs[all_pairs < reach], np.sort(own[own < reach])[::2]]))


LIQUID = """
units = "lj"
particles = {lattice = "fcc", count = 864}
box.matrix = [[10.0, 0, 0], [5.0, 10.0, 0], [-5.0, 5.0, 10.0]]
velocities = {temperature = 1.5, seed = 1}
force = [{type = "lennard-jones", cutoff = 2.5, truncation = "switch"}]
"""


@pytest.mark.parametrize("precision", ["double", "mixed"])
def test_a_run_in_a_leaning_box_keeps_its_energy_and_its_bits(precision):
    system, ends = loads(LIQUID), []
    for threads, parts in ((1, (400,)), (2, (400,)), (1, (177, 223))):
        sim = kd.Simulation(system, "velocity-verlet", 0.001, threads=threads, precision=precision)
        for steps in parts:
            report = sim.run(steps=steps, every=10)
        ends.append(sim.state.phase.tobytes())
        assert report.energy.rms_relative_error < 2e-4  # 9e-5 with steps of 0.001, nine times that with 0.003
        assert report.momentum_error < 1e-12
    assert len(set(ends)) == 1


def test_mixed_precision_agrees_with_double():
    x = liquid(LEANING, 500, 3)
    shaken = kd.System(x, box=LEANING, forces=[kd.LennardJones(cutoff=2.5, truncation="switch")])
    double, mixed = (BoundForces(shaken, mixed=m).measure(0.0, shaken.state.phase) for m in (False, True))
    size = np.sqrt((double.accelerations**2).mean())
    assert np.sqrt(((double.accelerations - mixed.accelerations) ** 2).mean()) < 1e-5 * size


def test_leapfrog_exact_refuses_a_leaning_box():
    with pytest.raises(kd.InputError, match=r"leapfrog-exact: cannot use a leaning box, .*\[5, 10, 0\]"):
        kd.Simulation(loads(LIQUID), "leapfrog-exact", 0.004)


def test_gravity_by_a_tree_refuses_any_periodic_box():
    with pytest.raises(kd.InputError, match=r"gravity-tree: .*the box is periodic"):
        kd.System([[0.0] * 3, [1.0] * 3], box=LEANING, forces=[kd.GravityTree(G=1.0)], units="nbody")

"""Structure files whose cell has any shape, in system files; distances are those that ASE finds in the file."""

from __future__ import annotations

import ase
import ase.io
import numpy as np
import pytest
from ase.build import bulk

import kickdrift as kd

MATRIX = np.array([[15.0, 0.0, 0.0], [-4.0, 16.0, 0.0], [5.0, 7.5, 17.5]])
TEXT = """
units = "metal"
particles = {{file = "{name}"}}
force = [{{type = "lennard-jones", epsilon = 0.0103, sigma = 3.4, cutoff = {cutoff}}}]
"""
CELLS = {
    "leaning.extxyz": (MATRIX, True),
    "left-handed.extxyz": (MATRIX[::-1], True),
    "rolled.xyz": (np.roll(np.diag([15.0, 16.0, 17.0]), 1, axis=0), True),
    "far.traj": (np.array([[15.0, 0, 0], [14.0, 15.0, 0], [33.0, -11.0, 15.0]]), True),
    "slab.extxyz": (np.array([[15.0, 3, 0], [0, 16.0, 0], [0, 0, 30.0]]), [True, True, False]),
    "tube.extxyz": (np.diag([0.0, 0.0, 15.0]), [False, False, True]),
    "upright.extxyz": (np.diag([15.0, 16.0, 17.0]), True),
}


def atoms_in(cell, pbc) -> ase.Atoms:
    """27 moving atoms near a lattice that fills the cell, 15 angstrom along its open axes, some of them cells away."""
    rng = np.random.default_rng(5)
    whole = np.where(np.broadcast_to(pbc, 3)[:, None], cell, np.diag([15.0] * 3))
    sites = (np.indices((3, 3, 3)).reshape(3, -1).T + rng.uniform(0.45, 0.55, (27, 3))) / 3
    away = np.where(pbc, rng.integers(-1, 2, (27, 3)), 0)
    atoms = ase.Atoms("Ar27", (sites + away) @ whole, cell=cell, pbc=pbc)
    atoms.set_momenta(rng.normal(size=(27, 3)))
    return atoms


def loaded(folder, name, more="", cutoff=5.5) -> kd.System:
    (folder / "system.toml").write_text(TEXT.format(name=name, cutoff=cutoff) + more)
    return kd.load(folder / "system.toml")


@pytest.mark.parametrize("name", CELLS)
def test_a_cell_of_any_shape_becomes_the_box(name, tmp_path):
    cell, pbc = CELLS[name]
    ase.io.write(tmp_path / name, atoms_in(cell, pbc))
    system, found = loaded(tmp_path, name), ase.io.read(tmp_path / name)
    assert system.box.periodic_axes == tuple(np.broadcast_to(pbc, 3))
    x, v = system.state.positions, system.state.velocities
    i, j = np.triu_indices(27, 1)
    ours = np.linalg.norm(system.box.minimum_image(x[i] - x[j]), axis=1)
    np.testing.assert_allclose(ours, found.get_all_distances(mic=True)[i, j], rtol=1e-12)
    along = found.get_velocities()
    scale = np.linalg.norm(v) / np.linalg.norm(along)
    np.testing.assert_allclose(v @ x.T, scale * along @ found.positions.T, rtol=0, atol=1e-11 * np.abs(v @ x.T).max())
    if pbc is True:
        assert system.volume == pytest.approx(found.get_volume(), rel=1e-12)
    if name.startswith(("leaning", "upright", "tube")):  # these have the form of a Box
        np.testing.assert_array_equal(x, found.positions)


def test_the_energy_is_ases(tmp_path):
    from ase.calculators.lj import LennardJones

    atoms = bulk("Ar", "fcc", a=5.26) * (5, 5, 5)
    atoms.rattle(0.1, seed=1)
    ase.io.write(tmp_path / "solid.extxyz", atoms)
    system, found = loaded(tmp_path, "solid.extxyz", cutoff=7.0), ase.io.read(tmp_path / "solid.extxyz")
    assert system.box.tilts
    found.calc = LennardJones(epsilon=0.0103, sigma=3.4, rc=7.0)
    energy = kd.Simulation(system, "velocity-verlet", 0.001).energy().potential
    assert energy == pytest.approx(found.get_potential_energy(), rel=1e-12)


def test_a_plane_comes_from_a_file(tmp_path):
    atoms = ase.Atoms("Ar4", [[1, 1, 2], [8, 1, 2], [1, 8, 2], [8, 8, 2]], cell=[[14, 0, 0], [7, 14, 0], [0, 0, 0]])
    atoms.pbc = [True, True, False]
    ase.io.write(tmp_path / "plane.extxyz", atoms)
    system = loaded(tmp_path, "plane.extxyz", "dimensions = 2")
    assert system.box == kd.Box([[14.0, 0.0], [7.0, 14.0]])


@pytest.mark.parametrize(
    ("more", "box"),
    [
        ("box.periodic = false", kd.Box()),
        ("box.lengths = [40.0, 41.0, 42.0]", kd.Box((40.0, 41.0, 42.0))),
        ("box.matrix = [[40.0, 0, 0], [5, 41.0, 0], [0, 0, 42.0]]", kd.Box([[40.0, 0, 0], [5, 41.0, 0], [0, 0, 42.0]])),
    ],
)  # fmt: skip
def test_another_box_leaves_the_atoms_where_they_are(more, box, tmp_path):
    ase.io.write(tmp_path / "rolled.extxyz", atoms_in(*CELLS["rolled.xyz"]))
    system = loaded(tmp_path, "rolled.extxyz", more)
    assert system.box == box
    np.testing.assert_array_equal(system.state.positions, ase.io.read(tmp_path / "rolled.extxyz").positions)


def test_a_leaning_axis_may_be_opened(tmp_path):
    """The cell's third vector is then replaced by its part perpendicular to the others."""
    ase.io.write(tmp_path / "leaning.extxyz", atoms_in(MATRIX, True))
    system = loaded(tmp_path, "leaning.extxyz", "box.periodic = [true, true, false]")
    assert system.box == kd.Box([[15.0, 0, 0], [-4.0, 16.0, 0], [0, 0, 17.5]], periodic=(True, True, False))


@pytest.mark.parametrize(
    ("cell", "pbc", "more", "message"),
    [
        ([[9, 0, 0], [9, 0, 0], [0, 0, 9]], True, "", "particles.file: box: the edge vectors are singular (no volume)"),
        ([9, 9, 0], [True, True, False], "box.periodic = true", "box: edge z must be a positive finite length, got 0"),
        (None, False, "box.periodic = true", "box.lengths: required key is missing"),
        ([60, 60, 60], True, "box.lengths = [50.0, 70.0, 70.0]", "box.lengths[0]: expected at least 60"),
    ],
)
def test_cells_that_make_no_box(cell, pbc, more, message, tmp_path):
    ase.io.write(tmp_path / "start.traj", ase.Atoms("Ar2", [[1, 1, 1], [5, 5, 1]], cell=cell, pbc=pbc))
    with pytest.raises(kd.InputError) as refused:
        loaded(tmp_path, "start.traj", more)
    assert message in str(refused.value)
    assert "\n" not in str(refused.value)


@pytest.mark.parametrize("name", CELLS)
def test_a_structure_file_alone_has_the_same_box(name, tmp_path):
    suffix = name.replace(".traj", ".extxyz")
    ase.io.write(tmp_path / suffix, atoms_in(*CELLS[name]))
    alone, system = kd.load(tmp_path / suffix), loaded(tmp_path, suffix)
    assert alone.box == system.box
    np.testing.assert_array_equal(alone.state.phase, system.state.phase)


def test_a_periodic_structure_without_a_cell_is_refused(tmp_path):
    path = tmp_path / "start.extxyz"
    path.write_text('1\nProperties=species:S:1:pos:R:3 pbc="T T T"\nAr 1.0 1.0 1.0\n')
    with pytest.raises(kd.InputError, match=r"start\.extxyz: is periodic, but has no cell$"):
        kd.load(path)
    with pytest.raises(kd.InputError, match=r"box\.lengths: required key is missing"):
        loaded(tmp_path, path.name)

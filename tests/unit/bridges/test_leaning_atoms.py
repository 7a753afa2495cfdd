"""Cells of any shape, periodic along any axes, to ASE and back; our forces in such cells against ASE's own."""

from __future__ import annotations

import itertools

import ase
import ase.io
import numpy as np
import pytest
from ase.build import bulk, fcc111
from ase.calculators.lj import LennardJones
from hypothesis import assume, given, settings
from hypothesis import strategies as st

import kickdrift as kd
from kickdrift.bridges.ase import Calculator

EPSILON, SIGMA, RC = 0.0103, 3.4, 8.0  # values for argon in eV and angstrom
ARGON = kd.LennardJones(epsilon=EPSILON, sigma=SIGMA, cutoff=RC)
MATRIX = np.array([[15.0, 0.0, 0.0], [-4.0, 16.0, 0.0], [5.0, 7.5, 17.5]])
AXES = [axes for axes in itertools.product((True, False), repeat=3) if any(axes)]


def shaken(atoms, seed=2) -> ase.Atoms:
    rng = np.random.default_rng(seed)
    atoms.positions += rng.normal(scale=0.1, size=(len(atoms), 3))
    atoms.set_momenta(rng.normal(size=(len(atoms), 3)))
    return atoms


def distances(atoms) -> np.ndarray:
    return atoms.get_all_distances(mic=bool(atoms.pbc.any()))[np.triu_indices(len(atoms), 1)]


@pytest.mark.parametrize("units", ["metal", "lj", "si"])
@pytest.mark.parametrize("axes", AXES)
def test_a_box_goes_to_ase_and_back(axes, units):
    both = np.array(axes)
    length = 1e-10 if units == "si" else 1.0
    matrix = np.where(np.outer(both, both), MATRIX, np.diag(np.diag(MATRIX) * [1.0, 0.0, 1.0])) * length
    box = kd.Box(matrix=matrix, periodic=axes)
    rng = np.random.default_rng(1)
    system = kd.System(rng.uniform(-30, 30, (9, 3)) * length, np.eye(9, 3), box=box, units=units)
    atoms = system.to_ase()
    np.testing.assert_allclose(atoms.cell[:], matrix / length, rtol=1e-15)
    assert tuple(atoms.pbc) == axes
    back = kd.System.from_ase(atoms, [], units)
    assert back.box.periodic_axes == axes
    np.testing.assert_allclose(back.box.matrix, box.matrix, rtol=1e-15)
    np.testing.assert_allclose(back.state.phase, system.state.phase, rtol=1e-14)


def scattered(cell, pbc=True) -> ase.Atoms:
    return ase.Atoms("Ar9", positions=np.random.default_rng(4).uniform(0, 20, (9, 3)), cell=cell, pbc=pbc)


CELLS = {
    "primitive": bulk("Ar", "fcc", a=5.26) * (3, 3, 3),
    "left-handed": scattered(MATRIX[::-1]),
    "leaning far": scattered([[9, 0, 0], [8, 9, 0], [20, -7, 9]]),
    "upside down": scattered([20, 20, -20]),
    "rolled": scattered(np.roll(np.diag([9.0, 10.0, 11.0]), 1, axis=0)),
    "surface": fcc111("Ar", (4, 4, 2), a=5.26, vacuum=10.0),
    "wire": scattered([[0, 0, 0], [3, 3, 9], [0, 0, 0]], [False, True, False]),
    "open vector that leans": scattered([[9, 3, 0], [0, 9, 0], [4, 1, 8]], [True, True, False]),
}


@pytest.mark.parametrize("name", CELLS)
def test_distances_and_motion_are_those_of_the_atoms(name):
    """The Box may have other axes; quantities that do not depend on axes are the same."""
    atoms = shaken(CELLS[name].copy())
    system = kd.System.from_ase(atoms, [])
    x, v = system.state.positions, system.state.velocities
    i, j = np.triu_indices(len(atoms), 1)
    ours = np.linalg.norm(system.box.minimum_image(x[i] - x[j]), axis=1)
    np.testing.assert_allclose(ours, distances(atoms), rtol=1e-12)
    if atoms.pbc.all():
        assert system.box.volume == pytest.approx(atoms.get_volume(), rel=1e-13)
    plain = kd.System.from_ase(ase.Atoms(atoms.symbols, atoms.positions, momenta=atoms.get_momenta()), [])
    np.testing.assert_allclose(v @ v.T, plain.state.velocities @ plain.state.velocities.T, rtol=1e-12, atol=1e-12)
    np.testing.assert_allclose(v @ x.T, plain.state.velocities @ plain.state.positions.T, rtol=1e-11, atol=1e-10)
    assert tuple(system.to_ase().pbc) == tuple(atoms.pbc)


@settings(max_examples=60, deadline=None)
@given(
    st.lists(st.floats(-20.0, 20.0), min_size=9, max_size=9).map(lambda rows: np.reshape(rows, (3, 3))),
    st.sampled_from(AXES),
)
def test_any_cell_is_taken(cell, axes):
    atoms = ase.Atoms("Ar6", positions=np.random.default_rng(4).uniform(0, 20, (6, 3)), cell=cell, pbc=axes)
    sound = cell[np.array(axes)]
    assume(np.linalg.svd(sound)[1].min() > 1e-3)
    system = kd.System.from_ase(atoms, [])
    x = system.state.positions
    i, j = np.triu_indices(6, 1)
    np.testing.assert_allclose(
        np.linalg.norm(x[i] - x[j], axis=1), np.linalg.norm(atoms.positions[i] - atoms.positions[j], axis=1), rtol=1e-12
    )
    there = np.array(axes)
    # Whole multiples of our edges make the cell's periodic vectors, rotated with the atoms.
    turned = np.linalg.lstsq(atoms.positions - atoms.positions[0], x - x[0], rcond=None)[0]
    whole = np.linalg.lstsq(system.box.matrix[there].T, (cell @ turned)[there].T, rcond=None)[0]
    np.testing.assert_allclose(whole, np.rint(whole), atol=1e-6 * (1 + np.abs(whole).max()))


def check_same(atoms, calculator) -> None:
    """Check that energy, forces and stress equal ASE's own, to round-off."""
    other = atoms.copy()
    other.calc, atoms.calc = LennardJones(epsilon=EPSILON, sigma=SIGMA, rc=RC), calculator
    scale = np.abs(other.get_forces()).max()
    np.testing.assert_allclose(atoms.get_forces(), other.get_forces(), rtol=0, atol=1e-12 * scale)
    size = np.abs(other.get_potential_energies()).sum()
    assert atoms.get_potential_energy() == pytest.approx(other.get_potential_energy(), rel=0, abs=1e-12 * size)
    if atoms.pbc.all():
        stress = other.get_stress()
        np.testing.assert_allclose(atoms.get_stress(), stress, rtol=0, atol=1e-12 * np.abs(stress).max())


def test_an_open_vector_in_the_plane_of_others_has_no_height():
    system = kd.System.from_ase(scattered([[9, 3, 0], [0, 9, 0], [1, 1, 0]], [True, True, False]), [])
    assert system.box.matrix[2].tolist() == [0, 0, 0]
    assert system.box.area == pytest.approx(81)


SOLID = bulk("Ar", "fcc", a=5.26)


@pytest.mark.parametrize(
    "atoms",
    [
        SOLID * (6, 6, 6),  # a primitive cell: no vector lies along an axis
        bulk("Ar", "hcp", a=3.7, c=6.0) * (6, 6, 4),
        fcc111("Ar", (6, 6, 3), a=5.26, vacuum=10.0),
        ase.Atoms(SOLID * (6, 6, 6), pbc=[False, True, True]),
    ],
    ids=["primitive", "hexagonal", "surface", "open along a"],
)
def test_the_calculator_agrees_with_ases(atoms):
    check_same(shaken(atoms.copy()), Calculator([ARGON]))


PLANES = {
    "upright": kd.Box((18.0, 20.0)),
    "leaning": kd.Box([[18.0, 0.0], [-9.0, 20.0]]),
    "open": None,
    "open along y": kd.Box((18.0, 20.0), periodic=(True, False, False)),
}


def plane(box, units="metal") -> kd.System:
    """16 atoms that move in the plane z = 0.5."""
    rng = np.random.default_rng(7)
    x = np.column_stack([4.0 * np.indices((4, 4)).reshape(2, -1).T + rng.uniform(-0.2, 0.2, (16, 2)), np.full(16, 0.5)])
    v = rng.normal(size=(16, 2))
    return kd.System(x, v, 39.948, box, [ARGON], units, dimensions=2, species=["Ar"] * 16)


@pytest.mark.parametrize("units", ["metal", "lj"])
@pytest.mark.parametrize("name", PLANES)
def test_a_plane_goes_to_ase_and_back(name, units, tmp_path):
    system = plane(PLANES[name], units)
    atoms = system.to_ase()
    assert atoms.info["dimensions"] == 2
    ase.io.write(tmp_path / "plane.extxyz", atoms)
    for found in (atoms, ase.io.read(tmp_path / "plane.extxyz")):
        back = kd.System.from_ase(found, [ARGON], units)
        assert (back.dimensions, back.degrees_of_freedom) == (2, 29 if name == "open" else 30)
        assert back.volume == pytest.approx(system.volume)
        np.testing.assert_allclose(back.state.phase, system.state.phase, rtol=0, atol=2e-7)
    energy = kd.Simulation(system, "velocity-verlet", 0.001).energy().potential
    assert atoms.get_potential_energy() == pytest.approx(energy, rel=1e-12)
    with pytest.raises(kd.InputError, match=r"^(stress: .* in two dimensions it is a force over a length|pressure: )"):
        atoms.get_stress()


def test_a_turned_plane_is_still_one():
    system = plane(PLANES["leaning"])
    atoms = system.to_ase()
    atoms.rotate(33.0, "z", rotate_cell=True)
    back = kd.System.from_ase(atoms, [])
    assert back.dimensions == 2
    np.testing.assert_allclose(back.box.matrix, system.box.matrix, rtol=1e-13, atol=1e-13)
    np.testing.assert_allclose(back.state.positions, system.state.positions, rtol=0, atol=1e-12)


def test_other_dimensions_of_atoms_say_nothing():
    assert "dimensions" not in kd.System(np.eye(3)).to_ase().info
    for given_there in ("2", [2, 2], 3, 2.5, np.array([2.0, 2.0])):
        atoms = ase.Atoms("Ar", info={"dimensions": given_there})
        assert kd.System.from_ase(atoms, []).dimensions == 3


def test_atoms_that_left_their_plane_are_refused():
    atoms = plane(None).to_ase()
    atoms.positions[3, 2] += 1.0
    with pytest.raises(kd.InputError, match=r"^positions: particle 3 has z = 1\.5; expected z = 0\.5"):
        kd.System.from_ase(atoms)

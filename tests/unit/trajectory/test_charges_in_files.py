"""Charges of particles in system files, run files, ASE, MDAnalysis and LAMMPS' data files."""

from __future__ import annotations

import numpy as np
import pytest

import kickdrift as kd
from kickdrift.errors import InputError
from kickdrift.systemfile.reading import loads
from tests.folders import DATA

SALT = """
units = "metal"
[particles]
lattice = "rock-salt"
count = 64
density = 0.04
species = { Na = 0.5, Cl = 0.5 }
mass = 20.0
charge = { Na = 1.0, Cl = "-1 e" }
[[force]]
type = "lennard-jones"
epsilon = 0.01
sigma = 2.5
cutoff = 5.0
[[force]]
type = "coulomb"
[run]
dt = 0.001
"""
CHARGES = np.tile([1.0] * 4 + [-1.0] * 4, 8)


def test_charges_of_a_system_file():
    system = loads(SALT)
    np.testing.assert_array_equal(system.charges, CHARGES)
    assert system[5].charge == -1.0
    assert {system.species[k] for k in system.species_index[CHARGES > 0]} == {"Na"}
    listed = loads(system.to_toml())
    np.testing.assert_array_equal(listed.charges, CHARGES)
    assert loads(SALT.replace('{ Na = 1.0, Cl = "-1 e" }', "0.5")).charges.tolist() == [0.5] * 64


@pytest.mark.parametrize(
    ("old", "new", "line"),
    [
        ("Na = 1.0, Cl", "K = 1.0, Cl", "particles.charge: species 'Na' has no charge"),
        ('"-1 e"', '"-1 eV"', "particles.charge: expected a charge such as "),
        ('charge = { Na = 1.0, Cl = "-1 e" }', "", "coulomb: the particles have no charges"),
        ("Na = 0.5, Cl = 0.5", "Na = 0.4, Cl = 0.6", "particles.species: a rock-salt lattice has two species in equal"),
    ],
)
def test_bad_charges(old, new, line):
    with pytest.raises(InputError) as error:
        loads(SALT.replace(old, new))
    assert line in str(error.value)


def test_charges_of_a_runs_file(tmp_path):
    pytest.importorskip("MDAnalysis")
    system, path = loads(SALT), tmp_path / "salt.h5md"
    sim = kd.Simulation(system)
    sim.run(4, output=path)
    run = kd.open(path)
    np.testing.assert_array_equal(run.charges, CHARGES)
    np.testing.assert_array_equal(run[-1].system.charges, CHARGES)
    np.testing.assert_array_equal(run.universe().atoms.charges, CHARGES)
    for suffix in ("data", "extxyz"):
        kd.export(path, tmp_path / f"salt.{suffix}")
        text = SALT[: SALT.index("lattice")] + f'file = "salt.{suffix}"\n' + SALT[SALT.index("[[force]]") :]
        np.testing.assert_array_equal(loads(text, folder=tmp_path).charges, CHARGES)


def test_a_run_with_charges_goes_on_from_its_file(tmp_path):
    path, whole = tmp_path / "salt.h5md", kd.Simulation(loads(SALT))
    kd.Simulation(loads(SALT)).run(4, output=path)
    more = kd.resume(path)
    more.run(3)
    whole.run(7)
    assert more.state.phase.tobytes() == whole.state.phase.tobytes()


def test_a_changed_charge_is_noticed(tmp_path):
    import h5py

    path = tmp_path / "salt.h5md"
    kd.Simulation(loads(SALT)).run(2, output=path)
    with h5py.File(path, "r+") as file:
        file["particles/trajectory/charge"][0] = 2.0
    with pytest.raises(InputError, match="was changed"):
        kd.resume(path)


def test_charges_through_ase():
    pytest.importorskip("ase")
    system = loads(SALT)
    atoms = system.to_ase()
    np.testing.assert_array_equal(atoms.get_initial_charges(), CHARGES)
    back = kd.System.from_ase(atoms, forces=system.forces)
    np.testing.assert_array_equal(back.charges, CHARGES)
    energy = kd.Simulation(system).energy().potential
    assert atoms.get_potential_energy() == pytest.approx(energy, rel=1e-9)
    atoms.set_initial_charges(0.5 * CHARGES)
    assert atoms.get_potential_energy() > energy


def test_an_older_file_has_no_charges():
    found = sorted((DATA / "v0.1.0").glob("*.h5md"))
    assert found
    assert all(kd.open(path).charges is None for path in found if "frames" in repr(kd.open(path)))

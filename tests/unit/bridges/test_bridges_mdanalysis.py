"""Systems from MDAnalysis' Universes, and packed files of structures."""

import bz2
import gzip

import numpy as np
import pytest

import kickdrift as kd

MDAnalysis = pytest.importorskip("MDAnalysis")


def universe(**attributes):
    made = MDAnalysis.Universe.empty(3, trajectory=True, velocities=True)
    for name, values in {"masses": [15.9994, 1.008, 1.008], "types": ["O", "H", "H"], **attributes}.items():
        made.add_TopologyAttr(name, values)
    made.atoms.positions = [[1.0, 1.0, 1.0], [2.0, 1.0, 1.0], [1.0, 2.0, 1.0]]
    made.trajectory.ts.velocities = [[1.0, 0.0, 0.0], [0.0, 2.0, 0.0], [0.0, 0.0, 3.0]]
    made.dimensions = [20.0, 21.0, 22.0, 90.0, 90.0, 60.0]
    return made


def test_a_frame_becomes_a_system_in_any_units():
    bonds = {"bonds": [(0, 1), (0, 2)], "charges": [-0.8, 0.4, 0.4]}
    real = kd.System.from_mdanalysis(
        universe(**bonds), [kd.Coulomb(method="reaction-field", cutoff=5.0)], factors=(0, 0, 1)
    )
    np.testing.assert_allclose(real.state.velocities[1], [0.0, 2e-3, 0.0])
    np.testing.assert_allclose(real.box.matrix[1], [10.5 - 20.0, 21 * np.sqrt(0.75), 0.0], atol=1e-5)
    assert real.species == ("O", "H")
    assert real.topology.bonds.tolist() == [[0, 1], [0, 2]]
    assert real.topology.factors == (0.0, 0.0, 1.0)
    np.testing.assert_allclose(real.charges, [-0.8, 0.4, 0.4])
    nm = kd.System.from_mdanalysis(universe(), units="gromacs")
    np.testing.assert_allclose(nm.state.positions, real.state.positions / 10.0)
    np.testing.assert_allclose(nm.state.velocities[1], [0.0, 0.2, 0.0])
    si = kd.System.from_mdanalysis(universe(), units="si")
    np.testing.assert_allclose(si.state.masses, real.state.masses * 1.66053906892e-27, rtol=1e-9)


def test_what_a_universe_lacks_is_named():
    with pytest.raises(kd.InputError, match="has no masses"):
        kd.System.from_mdanalysis(MDAnalysis.Universe.empty(2, trajectory=True))
    with pytest.raises(kd.InputError, match=r"expected MDAnalysis\.Universe, got list"):
        kd.System.from_mdanalysis([])


@pytest.mark.parametrize(
    ("suffix", "pack", "column"), [(".gz", gzip.compress, "initial_charges"), (".bz2", bz2.compress, "charge")]
)
def test_packed_structures_load(suffix, pack, column, tmp_path):
    text = f'2\nLattice="9 0 0 0 9 0 0 0 9" Properties=species:S:1:pos:R:3:{column}:R:1 pbc="T T T"\n'
    text += "Na 1 1 1 1.0\nCl 4 4 4 -1.0\n"
    path = tmp_path / f"salt.extxyz{suffix}"
    path.write_bytes(pack(text.encode()))
    system = kd.load(path)
    assert (system.species, system.charges.tolist()) == (("Na", "Cl"), [1.0, -1.0])
    path.write_bytes(pack(text.encode())[:-12])
    with pytest.raises(kd.InputError, match=rf"salt\.extxyz\{suffix}: cannot be unpacked"):
        kd.load(path)

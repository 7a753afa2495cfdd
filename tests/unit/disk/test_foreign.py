"""Files of other programs: one line says what they are, and what that line advises works."""

from __future__ import annotations

import bz2
import gzip

import numpy as np
import pytest

import kickdrift as kd
from kickdrift.errors import InputError
from kickdrift.systemfile.files import PARAMETERS, STRUCTURES
from kickdrift_validation.fuzzing.lammps_data import CHAIN

PSF = """PSF

       1 !NTITLE
 REMARKS three atoms

       3 !NATOM
       1 A    1    ALA  C    C      0.000000       12.0110           0
       2 A    1    ALA  C    C      0.000000       12.0110           0
       3 A    1    ALA  C    C      0.000000       12.0110           0

       2 !NBOND: bonds
       1       2       2       3

       0 !NTHETA: angles

       0 !NPHI: dihedrals

       0 !NIMPHI: impropers

       0 !NDON: donors

       0 !NACC: acceptors
"""
PDB = "HEADER    X\nATOM      1  AR  AR      1       1.000   1.000   1.000  1.00  0.00          AR\nEND\n"
GRO = "Water t= 0.0\n    1\n    1SOL     OW    1   0.230   0.628   0.113\n   1.8   1.8   1.8\n"
DUMP = "ITEM: TIMESTEP\n0\nITEM: NUMBER OF ATOMS\n1\nITEM: BOX BOUNDS pp pp pp\n0 9\n0 9\n0 9\n"
DUMP += "ITEM: ATOMS id type x y z\n1 18 1 2 3\n"
FILES = {
    "data.chain": (CHAIN, 'a data file of LAMMPS; a system file reads it with particles = {file = "data.chain"}'),
    "melt.dump": (DUMP, "a dump of LAMMPS; ase convert -i lammps-dump-text melt.dump start.extxyz"),
    "x.prmtop": ("%VERSION  VERSION_STAMP = V0001.000\n%FLAG TITLE\n", "a topology of AMBER"),
    "x.psf": (PSF, 'a topology of CHARMM (psf); a system file takes its bonds with topology = {file = "x.psf"}'),
    "x.top": ('; water\n#include "oplsaa.ff/forcefield.itp"\n', "a topology of GROMACS"),
    "y.top": ("[ moleculetype ]\nSOL 2\n", "a topology of GROMACS"),
    "x.mdp": ("; run\nintegrator = md\nnsteps = 10\n", "a file of parameters of GROMACS"),
    "x.tpr": (b"\0\0\0\x12\0\0\0\x0eVERSION 2022.5\0\0", "a run input of GROMACS"),
    "x.xtc": ((1995).to_bytes(4, "big") + bytes(50), "a trajectory of GROMACS (xtc)"),
    "x.trr": ((1993).to_bytes(4, "big") + bytes(50), "a trajectory of GROMACS (trr)"),
    "x.dcd": (b"\x54\0\0\0CORD" + bytes(80), "a trajectory of CHARMM or NAMD"),
    "x.nc": (b"CDF\x02" + bytes(40), "a trajectory of AMBER"),
    "argon": (PDB, "a structure in the format of PDB; kickdrift reads it if its name ends in .pdb"),
    "water": (GRO, "a structure of GROMACS (gro); kickdrift reads it if its name ends in .gro"),
    "atom": ("1\n\nAr 0 0 0\n", "a structure in the format xyz; kickdrift reads it if its name ends in .xyz"),
    "POSCAR": ("Cu\n3.6\n1 0 0\n0 1 0\n0 0 1\nCu\n1\nDirect\n0 0 0\n", "a structure of VASP"),
    "x.toml.gz": (gzip.compress(b"units = 'lj'"), "a file packed by gzip; unpack it first: gunzip x.toml.gz"),
    "x.bz2": (bz2.compress(b"units = 'lj'"), "a file packed by bzip2"),
    "x.npy": (b"\x93NUMPY\x01\0" + bytes(20), "pickled Python or NumPy's array"),
    "x.json": ('{"units": "lj"}', "a file in JSON"),
    "run.py": ("import kickdrift as kd\n", "a Python program; kickdrift run run.py runs it"),
}


@pytest.fixture
def folder(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    for name, (content, _) in FILES.items():
        (tmp_path / name).write_bytes(content if isinstance(content, bytes) else content.encode())
    return tmp_path


def test_a_file_of_another_program_is_named_whatever_its_ending(folder):
    for name, (_, what) in FILES.items():
        for other in (name, f"renamed-{name.partition('.')[0]}"):
            if name == "run.py" and other != name:
                continue  # its name alone says what it is
            (folder / name).rename(folder / other)
            with pytest.raises(InputError) as refused:
                kd.load(other)
            (folder / other).rename(folder / name)
            needs = (
                "give --coordinates FILE (coordinates in Python and in [particles]); it "
                if other.endswith(PARAMETERS)
                else ""
            )
            assert str(refused.value).startswith(f"{other}: {needs}is {what.replace(name, other)}"), name
            assert "\n" not in str(refused.value)
            assert len(str(refused.value)) < 250
    with pytest.raises(InputError, match="is not an HDF5 file: it is a trajectory of CHARMM or NAMD"):
        kd.open("x.dcd")


def test_a_large_file_of_another_program_is_named_too(folder):
    with open("x.xtc", "r+b") as file:
        file.truncate(2**25)
    with pytest.raises(InputError, match=r"x\.xtc: is a trajectory of GROMACS"):
        kd.load("x.xtc")


def test_a_faulty_system_file_is_still_one(folder):
    for text in ("units = 'lj'\n[particles\n", "units lj\n[particles]\n", "# a\n\xff"):
        (folder / "s.toml").write_text(text, encoding="latin-1")
        with pytest.raises(InputError, match=r"s\.toml: not "):
            kd.load("s.toml")


def test_what_the_lines_advise_works(folder):
    pytest.importorskip("ase")
    pytest.importorskip("MDAnalysis")
    system = kd.load(
        {"units": "lj", "particles": {"file": "data.chain"}, "topology": {"file": "data.chain"}, "force": []}
    )
    np.testing.assert_allclose(system.state.positions, [[1, 1, 1], [2, 1, 1], [3, 1, 1]], rtol=1e-15)
    assert system.topology.bonds.tolist() == [[0, 1], [1, 2]]
    again = kd.load({"units": "lj", "particles": {"positions": np.eye(3)}, "topology": {"file": "x.psf"}, "force": []})
    assert again.topology.bonds.tolist() == [[0, 1], [1, 2]]
    for name, suffix in (("argon", ".pdb"), ("water", ".gro"), ("atom", ".xyz"), ("POSCAR", ".vasp")):
        assert suffix in STRUCTURES
        (folder / name).rename(f"{name}{suffix}")
        assert len(kd.load(f"{name}{suffix}")) == 1
    from ase.cli.main import main

    main(args=["convert", "-i", "lammps-dump-text", "melt.dump", "start.extxyz"])
    assert len(kd.load("start.extxyz")) == 1

"""Files of other programs, recognised by their content: what they are, and what to do with them."""

import os
import re
from collections.abc import Callable
from typing import NamedTuple

from kickdrift.disk.files import opened
from kickdrift.errors import InputError

HEAD = 16 * 1024  # bytes that are examined
LAMMPS_DATA = (".data", ".lmp", ".lammps-data")
_BESIDE = (
    'a system file reads it with particles = {{file = "{name}"}}; kd.System.from_lammps takes its coefficients, too'
)
_BONDS = 'a system file takes its bonds with topology = {{file = "{name}"}}; '
_FRAMES = "it holds frames alone; MDAnalysis or ASE write one of them as .extxyz or .pdb, which kickdrift reads"
_CONVERT = "ase convert writes it as .extxyz, which kickdrift reads"
_FLOATS = rb"(?:[ \t]*-?\d+\.\d+){3}"
_TOP = rb'^[ \t]*(\[ *(moleculetype|defaults|atomtypes|molecules) *\]|#include ")'
_MDP = rb"^[ \t]*(integrator *= *(md|sd|steep|cg|bd)\b|coulombtype *=)"
_POSCAR = rb"\A.*\n[ \t]*-?[\d.]+[ \t]*\r?\n(?:(?:[ \t]*-?[\d.]+){3}[ \t]*\r?\n){3}"


class Foreign(NamedTuple):
    """A kind of file: its name, whether a file with this head and name is one, and what to do with the file."""

    noun: str
    known: Callable[[bytes, str], object]
    advice: str


def _begins(*marks: bytes) -> Callable[[bytes, str], object]:
    return lambda head, name: head.startswith(marks)


def _has(pattern: bytes) -> Callable[[bytes, str], object]:
    found = re.compile(pattern, re.MULTILINE)
    return lambda head, name: found.search(head)


def _renamed(suffix: str) -> str:
    return f"kickdrift reads it if its name ends in {suffix}"


def _with_coordinates(suffix: str) -> str:
    return f"kickdrift run reads all of it with --coordinates FILE, if its name ends in {suffix}"


def _packed(tool: str) -> str:
    return f"unpack it first: {tool} {{name}}"


FOREIGN = (
    Foreign("a file packed by gzip", _begins(b"\x1f\x8b"), _packed("gunzip")),
    Foreign("a file packed by bzip2", _begins(b"BZh"), _packed("bunzip2")),
    Foreign("a file packed by xz", _begins(b"\xfd7zXZ\0"), _packed("unxz")),
    Foreign("a file packed by zstd", _begins(b"\x28\xb5\x2f\xfd"), _packed("unzstd")),
    Foreign("a ZIP archive", _begins(b"PK\3\4"), _packed("unzip")),
    Foreign("an HDF5 file", _begins(b"\x89HDF\r\n\x1a\n"), "kd.open and kickdrift info read it, if kickdrift wrote it"),
    Foreign("a trajectory of CHARMM or NAMD (dcd)", lambda head, name: head[4:8] == b"CORD", _FRAMES),
    Foreign("a trajectory of GROMACS (xtc)", _begins(b"\0\0\x07\xcb", b"\0\0\x07\xe7"), _FRAMES),
    Foreign("a trajectory of GROMACS (trr)", _begins(b"\0\0\x07\xc9"), _FRAMES),
    Foreign("a trajectory of AMBER or another netCDF file", _begins(b"CDF\1", b"CDF\2", b"CDF\5"), _FRAMES),
    Foreign("a run input of GROMACS (tpr)", lambda head, name: b"VERSION " in head[:64] and b"\0" in head[:64],
            "gmx editconf -f {name} -o start.gro writes its places, which kickdrift reads"),
    Foreign("a topology of AMBER (prmtop)", _has(rb"\A%(VERSION|FLAG)"),
            _BONDS + _with_coordinates(".prmtop")),
    Foreign("a topology of CHARMM (psf)", _has(rb"\APSF( |\r?$)"), _BONDS + _with_coordinates(".psf")),
    Foreign("a topology of GROMACS (top)", _has(_TOP), _with_coordinates(".top")),
    Foreign("a file of parameters of GROMACS (mdp)", _has(_MDP),
            "kickdrift takes these in the table [run] of a system file"),
    Foreign("a data file of LAMMPS", _has(rb"^[ \t]*\d+[ \t]+atoms[ \t]*(#.*)?\r?$"), _BESIDE),
    Foreign("a dump of LAMMPS", _has(rb"\AITEM: TIMESTEP"),
            "ase convert -i lammps-dump-text {name} start.extxyz writes a file that kickdrift reads"),
    Foreign("an input of LAMMPS", _has(rb"^(pair_style|atom_style|read_data|create_atoms)[ \t]"),
            "kickdrift run {name} runs its system"),
    Foreign("a structure in the format of PDB", _has(rb"\A(HEADER|TITLE |REMARK|CRYST1|MODEL |ATOM  |HETATM)"),
            _renamed(".pdb")),
    Foreign("a structure of GROMACS (gro)", _has(rb"\A.*\r?\n[ \t]*\d+\r?\n.{15}[ \d]{5}" + _FLOATS),
            _renamed(".gro")),
    Foreign("a structure in the format xyz", _has(rb"\A[ \t]*\d+[ \t]*\r?\n.*\r?\n[ \t]*[A-Z][a-z]?[ \t]+-?\d"),
            _renamed(".xyz")),
    Foreign("a structure in the format CIF", _has(rb"\A\s*data_\S*\s(?s:.*)^_cell_length_a"),
            _renamed(".cif")),
    Foreign("a structure of VASP", _has(_POSCAR), _renamed(".vasp")),
    Foreign("a trajectory of ASE", _begins(b"- of Ulm"), _renamed(".traj")),
    Foreign("a molecule in the format mol2", _has(rb"\A(#.*\n|\s)*@<TRIPOS>"), _CONVERT),
    Foreign("a restart of AMBER (inpcrd)", _has(rb"\A.*\r?\n *\d+( +[\d.Ee+-]+)?\r?\n( *-?\d+\.\d{7}){3}"),
            "MDAnalysis writes it with its topology as .pdb, which kickdrift reads"),
    Foreign("a Python program", lambda head, name: name.endswith(".py"), "kickdrift run {name} runs it"),
    Foreign("a picture", _begins(b"\x89PNG", b"\xff\xd8\xff", b"GIF8", b"%PDF"), "kickdrift reads no pictures"),
    Foreign("pickled Python or NumPy's array", _begins(b"\x80\3", b"\x80\4", b"\x80\5", b"\x93NUMPY"),
            "kickdrift reads none; kd.System takes arrays"),
    Foreign("a Parquet table", _begins(b"PAR1"), "kd.open and kickdrift info read those of ensembles and Problems"),
    Foreign("a file in XML", _begins(b"<?xml", b"<"), "kickdrift reads none"),
    Foreign("a file in JSON", _begins(b"{"), "kd.load of the dict in it reads a system in JSON"),
)  # fmt: skip


def foreign(path: str | os.PathLike[str]) -> str:
    """Text "is a data file of LAMMPS; …" that says what a file of another program is and what to do with it; "" if the
    file is not recognised."""
    name = os.path.basename(os.fspath(path))
    try:
        with opened(path) as file:
            head = file.read(HEAD)
    except InputError:
        return ""
    found = next((each for each in FOREIGN if each.known(head, name)), None)
    return f"is {found.noun}; {found.advice.format(name=name)}" if found else ""


def is_lammps_data(path: str | os.PathLike[str]) -> bool:
    """Tell whether a file is a data file of LAMMPS, by its ending or its content."""
    if os.path.splitext(path)[1].lower() in LAMMPS_DATA:
        return True
    return foreign(path).startswith("is a data file of LAMMPS")


def is_lammps_input(path: str | os.PathLike[str]) -> bool:
    """Tell whether a file is an input of LAMMPS, by its content, or by its name in.NAME where the content tells
    nothing."""
    if os.path.splitext(path)[1].lower() == ".toml":
        return False
    what = foreign(path)
    named = os.path.basename(os.fspath(path)).startswith("in.") and os.path.isfile(path)
    return what.startswith("is an input of LAMMPS") or (named and not what)

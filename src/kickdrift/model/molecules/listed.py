"""Bonds, angles, dihedrals and impropers from the objects and files of other programs, as arguments of a Topology."""

import re
import warnings
from pathlib import Path
from typing import Any

from kickdrift.disk.files import unfit
from kickdrift.disk.foreign import is_lammps_data
from kickdrift.errors import InputError
from kickdrift.text import shown

KINDS = ("bonds", "angles", "dihedrals", "impropers")
_ASE = re.compile(r"(\d+(?:-\d+)*)\((\w+)\)")  # such as "3(1),4(2)" for bonds, "2-4(1)" for angles


def from_universe(universe: Any) -> dict[str, Any]:
    """Arguments of a Topology from an MDAnalysis Universe: its lists of bonds and so on, with their types."""
    found: dict[str, Any] = {}
    for kind in KINDS:
        items = getattr(universe, kind, None)  # MDAnalysis raises an AttributeError of its own for a missing list
        if items is None or not len(items):
            continue
        found[kind] = items.indices.tolist()
        if types := [_name(item) for item in items]:
            found[f"{kind[:-1]}_types"] = types if all(types) else "1"
    return found


def _name(item: Any) -> str:
    """Return the type of an item, or the types of its atoms; "" without any."""
    kind = getattr(item, "type", "")  # MDAnalysis raises an AttributeError of its own where atoms have no types
    return "-".join(map(str, min(kind, kind[::-1]))) if isinstance(kind, tuple) else str(kind)


def replaced(found: dict[str, Any], more: dict[str, Any]) -> dict[str, Any]:
    """Return arguments of a Topology with other ones in their place; other lists do not keep the types of the old."""
    old = {f"{kind[:-1]}_types" for kind in KINDS if kind in more}
    return {key: value for key, value in found.items() if key not in old} | more


def from_atoms(atoms: Any) -> dict[str, Any]:
    """Arguments of a Topology from an ase.Atoms with the arrays of ASE's reader of LAMMPS data files."""
    found: dict[str, Any] = {}
    arrays = getattr(atoms, "arrays", None)
    if not isinstance(arrays, dict):
        raise InputError(f"Topology.from_ase: expected an ase.Atoms, got {shown(atoms)}")
    for kind in KINDS:
        items, types = [], []
        for i, text in enumerate(map(str, arrays.get(kind, ()))):
            for others, name in _ASE.findall(text):
                rest = [int(each) for each in others.split("-")]
                items.append([rest[0], i, *rest[1:]] if kind == "angles" else [i, *rest])
                types.append(name)
        if items:
            found[kind], found[f"{kind[:-1]}_types"] = items, types
    return found


def from_file(path: Path) -> dict[str, Any]:
    """Arguments of a Topology from any file whose topology MDAnalysis reads: LAMMPS data, PSF, PRMTOP, PDB, MOL2 …"""
    if why := unfit(path):
        raise InputError(f"{why}: {path}")
    try:
        from MDAnalysis import Universe
    except ImportError:
        raise InputError("reading topologies needs MDAnalysis: pip install 'kickdrift[mdanalysis]'") from None
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # MDAnalysis warns of attributes that are not used here
            form = {"topology_format": "DATA"} if is_lammps_data(path) else {}
            universe = Universe(str(path), to_guess=(), **form)
    except Exception as error:  # each of MDAnalysis' parsers raises errors of its own
        text = " ".join((str(error) or type(error).__name__).split())
        raise InputError(f"MDAnalysis cannot read a topology from {path}: {shown(text)}") from None
    found = from_universe(universe)
    if not found:
        raise InputError(f"{path} holds no bonds, angles, dihedrals or impropers")
    return found

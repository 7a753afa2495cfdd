"""Topology of molecules from the table [topology] of a system file."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from pydantic import PositiveInt

from kickdrift.errors import InputError
from kickdrift.model.molecules.listed import from_file, replaced
from kickdrift.model.molecules.topology import SIZES, Topology
from kickdrift.systemfile.schema_base import Table


class ChainsTable(Table):
    count: PositiveInt
    length: PositiveInt


class TopologyTable(Table):
    chains: ChainsTable | None = None
    file: str | None = None
    bonds: Any = None
    angles: Any = None
    dihedrals: Any = None
    impropers: Any = None
    bond_types: Any = None
    angle_types: Any = None
    dihedral_types: Any = None
    improper_types: Any = None
    factors: list[float] | None = None
    exclusions: Any = None


def topology_of(table: TopologyTable, folder: Path) -> Topology:
    """Topology of a checked table. Names of files are relative to ``folder``."""
    given = table.model_dump(exclude_none=True)
    sources = [key for key in ("chains", "file", "bonds") if key in given]
    listed = any(isinstance(given.get(kind), list) for kind in (*SIZES, "exclusions"))
    if len(sources) > 1 or not (sources or listed):
        raise InputError(
            f"topology: expected exactly one of chains, file and bonds, got {' and '.join(sources) or 'none'}"
        )
    if (chains := given.pop("chains", None)) is not None:
        if chains["length"] < 2:
            raise InputError("topology.chains.length: expected 2 particles or more")
        return Topology.chains(**chains, **given)
    if (name := given.pop("file", None)) is not None:
        if "\0" in name:
            raise InputError("topology.file: expected the name of a file")
        try:
            found = from_file(folder / name)
        except InputError as error:
            raise InputError(f"topology.file: {error}") from None
        return Topology(**replaced(found, given))
    return Topology(**given)

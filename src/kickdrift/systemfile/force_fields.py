"""Systems of files of force fields, by the arguments of `kickdrift.load` and by the tables of a system file."""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from kickdrift.disk.foreign import foreign
from kickdrift.errors import InputError
from kickdrift.model.bridged import bridge
from kickdrift.model.checks.values import is_number
from kickdrift.model.system import System
from kickdrift.model.units.quantities import quantity
from kickdrift.model.units.unit_systems import UnitSystem, unit_system
from kickdrift.systemfile.converting import MOLECULAR
from kickdrift.systemfile.files import PARAMETERS, WHOLE, prefixed
from kickdrift.systemfile.schema import FileTable, SystemTable
from kickdrift.text import choices, shown

BARE = (".pdb", ".cif")  # files without parameters, which take a force field


def refuse_files(what: str | os.PathLike[str], given: Mapping[str, Any]) -> None:
    """Refuse arguments for files of force fields that are given with another system, which ``what`` names."""
    for key, value in given.items():
        if value is not None:
            bare = os.path.splitext(what)[1].lower() in BARE
            alone = "which is not given" if bare else f"and {what} is none of these"
            raise InputError(
                f"{key}: is for files of force fields ({choices(PARAMETERS)}), and for .pdb and .cif with force_field, "
                f"{alone}"
            )


def force_field_system(
    path: Path,
    coordinates: str | os.PathLike[str] | None,
    force_field: str | Sequence[str] | None,
    cutoff: float | str | None,
    rigid: str | None,
) -> System:
    """System of files of a force field, in gromacs units; see `kickdrift.load`."""
    kind = path.suffix.lower()
    if coordinates is None and kind in PARAMETERS:
        what = foreign(path)
        if what and not what.startswith("is a topology"):
            raise InputError(f"{path}: {what}")
        what = what.rpartition("; ")[0]  # without the advice that it needs coordinates
        raise InputError(
            f"{path}: give --coordinates FILE (coordinates in Python and in [particles]){what and f'; it {what}'}"
        )
    if coordinates is not None and kind not in PARAMETERS:
        raise InputError(f"coordinates: {path} has its own; only {choices(PARAMETERS)} take others")
    if force_field is not None and kind in WHOLE:
        takers = [each for each in (*PARAMETERS, *BARE) if each not in WHOLE]
        raise InputError(f"force_field: {path} holds its force field; only {choices(takers)} take another")
    files = [force_field] if isinstance(force_field, str) else list(force_field or ())
    reach = quantity(cutoff, "length", unit_system("gromacs"), "cutoff") if isinstance(cutoff, str) else cutoff
    if reach is not None and not (is_number(reach) and 0 < reach < np.inf):
        raise InputError(f"cutoff: expected a length above zero, got {shown(cutoff)}")
    reader = bridge("openmm", f"{path}: a file of a force field")
    with prefixed(f"{path}: "):
        found: System = reader.file_system(path, reader.Asked(coordinates, files, reach, rigid))
    return found


def told_system(table: SystemTable, units: UnitSystem, folder: Path) -> System | None:
    """System of the files that ``[particles]`` and ``[force_field]`` name, in the units of the system file; None for
    other particles."""
    particles, told = table.particles, table.force_field
    named = particles.file if isinstance(particles, FileTable) else ""
    kind = Path(named).suffix.lower()
    if kind not in PARAMETERS and not (told is not None and kind in BARE):
        if told is not None:
            raise InputError(
                f"force_field: goes with particles.file, a file that ends in {choices((*PARAMETERS, *BARE))}"
            )
        if isinstance(particles, FileTable) and particles.coordinates is not None:
            raise InputError(f"particles.coordinates: goes with a file that ends in {choices(PARAMETERS)}")
        return None
    assert isinstance(particles, FileTable)
    if units.name not in MOLECULAR:
        raise InputError(f"units: a force field has units {', '.join(MOLECULAR)}, got {units.name!r}")
    files = [_beside(folder, each) for each in told.files] if told is not None else []
    reach = None if told is None or told.cutoff is None else f"{told.cutoff!r} {units.length}"
    start = None if particles.coordinates is None else folder / particles.coordinates
    with prefixed("particles.file: "):
        found = force_field_system(folder / named, start, files or None, reach, None if told is None else told.rigid)
    return found.in_units(units.name)


def _beside(folder: Path, name: str) -> str:
    """A file of a force field beside the system file, else the name of one that OpenMM ships."""
    return str(folder / name) if (folder / name).exists() else name

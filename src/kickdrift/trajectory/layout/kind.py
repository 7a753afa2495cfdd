"""Check that an HDF5 file is the file of a run, in a schema that this version reads."""

from __future__ import annotations

from pathlib import Path

import h5py

from kickdrift.errors import InputError
from kickdrift.trajectory.layout.names import SCHEMA


def check_kind(path: Path, file: h5py.File) -> None:
    """Raise InputError if this is not the file of a run, or has another schema; the error names the kind of file."""
    if "kickdrift/problem" in file:
        raise InputError(f"{path}: is the file of a Problem's run, which has no particles")
    if "table" in file and "columns" in file.attrs:
        raise InputError(f"{path}: is the table of an ensemble, which kd.Ensemble.read opens")
    if "h5md" not in file:
        raise InputError(f"{path}: is an HDF5 file but not H5MD: it has no group 'h5md'")
    if "kickdrift" not in file:
        creator = file.get("h5md/creator")
        name = creator.attrs.get("name", "another program") if creator is not None else "another program"
        name = name.decode() if isinstance(name, bytes) else name
        raise InputError(
            f"{path}: is an H5MD file written by {name}; it has no group 'kickdrift' to tell forces, units and method"
        )
    check_schema(path, file)


def check_schema(path: Path, file: h5py.File) -> None:
    """Raise InputError if the file has another schema."""
    schema = int(file["kickdrift"].attrs["schema"])
    if schema > SCHEMA:
        raise InputError(f"{path}: was written by a newer kickdrift (schema {schema}; this one reads {SCHEMA})")
    if schema < SCHEMA:
        raise InputError(f"{path}: was written by an older kickdrift (schema {schema}; this one reads {SCHEMA})")

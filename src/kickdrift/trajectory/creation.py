"""A run's file comes into being whole or not at all, and an old one is replaced only by a whole new one."""

from __future__ import annotations

import contextlib
import os
from pathlib import Path

import h5py

from kickdrift.errors import InputError
from kickdrift.trajectory.layout import SUFFIX


def create(path: Path, image: bytes, *, overwrite: bool) -> Path:
    """Write ``image`` to a new file; an InputError says why that cannot be, and then nothing has changed."""
    folder = path.parent
    if path.suffix != SUFFIX:
        raise InputError(f"{path}: the name of a run's file must end in {SUFFIX}, not {path.suffix or 'nothing'!r}")
    if not folder.is_dir():
        raise InputError(f"{path}: there is no folder {folder}")
    if path.is_dir():
        raise InputError(f"{path}: is a folder")
    if path.exists():
        if not overwrite:
            raise InputError(f"{path}: exists already; pass --overwrite (overwrite=True) to replace it")
        open_to_write(path, cache_bytes=0, only_try=True)
    temporary = folder / f".{path.name}.{os.getpid()}.part"
    try:
        temporary.write_bytes(image)
        if overwrite:
            os.replace(temporary, path)
        else:
            _link(temporary, path)
    except FileExistsError:
        raise InputError(f"{path}: exists already; pass --overwrite (overwrite=True) to replace it") from None
    except OSError as error:
        raise InputError(f"{path}: cannot be written: {(error.strerror or str(error)).lower()}") from None
    finally:
        with contextlib.suppress(OSError):
            temporary.unlink(missing_ok=True)
    return path


def _link(temporary: Path, path: Path) -> None:
    """Give the file its name unless another has it, in one act where the file system has hard links."""
    try:
        os.link(temporary, path)
    except FileExistsError:
        raise
    except OSError:
        if path.exists():
            raise FileExistsError from None
        os.replace(temporary, path)


def open_to_write(path: Path, *, cache_bytes: int, only_try: bool = False) -> h5py.File:
    """The file, open and locked; an InputError if another program has it. ``only_try`` closes it again at once."""
    try:
        file = h5py.File(path, "r+", libver="earliest", locking="best-effort", rdcc_nbytes=cache_bytes)
    except BlockingIOError:
        raise in_use(path) from None
    except OSError as error:
        if only_try:  # not HDF5, or broken: nothing that a run could be writing to
            return None
        raise InputError(f"{path}: cannot be opened for writing: {error}") from None
    if only_try:
        file.close()
    return file


def in_use(path: Path) -> InputError:
    return InputError(f"{path}: is open in another program or run; it cannot be written to until that lets go")

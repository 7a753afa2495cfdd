"""A run's file comes into being whole or not at all, and an old one is replaced only by a whole new one."""

from __future__ import annotations

import contextlib
import os
from pathlib import Path

from kickdrift.errors import InputError
from kickdrift.trajectory.layout import SUFFIX
from kickdrift.trajectory.storage import PagedFile, in_use


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
        _refuse_in_use(path)
    temporary = part_of(path)
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


def part_of(path: Path) -> Path:
    """Where a file of that name comes into being."""
    return path.with_name(f".{path.name}.{os.getpid()}.part")


def _refuse_in_use(path: Path) -> None:
    try:
        PagedFile(path).close()
    except BlockingIOError:
        raise in_use(path) from None
    except OSError:  # no permission to write to it, say: whether it can be replaced is the folder's affair
        pass


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

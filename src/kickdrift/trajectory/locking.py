"""A file open for writing: locked, no symbolic link followed, and with no name but its own."""

from __future__ import annotations

import os
import shutil
from pathlib import Path
from typing import Any

from kickdrift.disk.files import descriptor
from kickdrift.disk.parts import private_place
from kickdrift.errors import InputError

try:
    import fcntl
except ImportError:  # Windows, where HDF5 locks nothing either
    fcntl = None  # type: ignore[assignment]


def lock(raw: Any) -> None:
    """The lock that HDF5 itself takes and looks for; some file systems have none."""
    if fcntl is None:
        return
    try:
        fcntl.flock(raw.fileno(), fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError:
        raise
    except OSError:
        pass


def locked(path: str | os.PathLike[str]) -> Any:
    """A regular file, open for writing and locked, no symbolic link followed."""
    flags = os.O_RDWR | getattr(os, "O_NOFOLLOW", 0)
    raw = open(path, "r+b", buffering=0, opener=lambda name, _: descriptor(name, flags))  # noqa: SIM115
    try:
        if not os.fstat(raw.fileno()).st_mode & 0o222:  # which would not stop an administrator's process
            raise InputError(f"{path}: is read-only; it cannot be written to")
        lock(raw)
    except BaseException:
        raw.close()
        raise
    return raw


def detached(path: Path, raw: Any) -> Any:
    """A file of its own under that name, where there are hard links: what stands under the other names stays."""
    with raw, private_place(path) as part:
        copy(raw, part)
        os.replace(part, path)
    return locked(path)


def copy(raw: Any, path: Path) -> None:
    """Write an open file's content to a new file, with the same permissions."""
    with open(path, "xb") as target:
        os.chmod(path, os.fstat(raw.fileno()).st_mode & 0o777)
        raw.seek(0)
        shutil.copyfileobj(raw, target, 2**20)

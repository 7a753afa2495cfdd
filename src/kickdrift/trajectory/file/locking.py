"""A file open for writing: locked, never through a symbolic link, and with a single name."""

import os
import shutil
from pathlib import Path
from typing import Any

from kickdrift.disk import posix
from kickdrift.disk.files import descriptor
from kickdrift.disk.outputs import private_place
from kickdrift.errors import InputError


def lock(raw: Any) -> None:
    """Take the lock that HDF5 itself uses. Some file systems have no locks, and HDF5 does not lock on Windows."""
    try:
        posix.lock(raw.fileno())
    except BlockingIOError:
        raise
    except OSError:
        pass


def locked(path: str | os.PathLike[str]) -> Any:
    """Open a regular file for writing and lock it. A symbolic link is refused."""
    flags = os.O_RDWR | posix.flags("O_NOFOLLOW")
    raw = open(path, "r+b", buffering=0, opener=lambda name, _: descriptor(name, flags))  # noqa: SIM115
    try:
        if not os.fstat(raw.fileno()).st_mode & 0o222:  # permissions alone would not stop an administrator
            raise InputError(f"{path}: is read-only; it cannot be written to")
        lock(raw)
    except BaseException:
        raw.close()
        raise
    return raw


def detached(path: Path, raw: Any) -> Any:
    """Replace one of several hard links by a copy and open the copy. The file under the other names stays unchanged."""
    with raw, private_place(path) as part:
        copy(raw, part)
        os.replace(part, path)
    return locked(path)


def copy(raw: Any, path: Path) -> None:
    """Copy an open file's content and permissions to a new file."""
    with open(path, "xb") as target:
        os.chmod(path, os.fstat(raw.fileno()).st_mode & 0o777)
        raw.seek(0)
        shutil.copyfileobj(raw, target, 2**20)

"""Room on the disk, made sure of before HDF5 needs it: after a write that fails, HDF5 crashes at close."""

from __future__ import annotations

import errno
import os
import shutil
from pathlib import Path

from kickdrift.errors import RunError

_FULL = (errno.ENOSPC, errno.EDQUOT, errno.EFBIG)


def reserve(path: Path, descriptor: int, start: int, size: int) -> None:
    """Make sure that ``size`` bytes from ``start`` on can be written; a RunError where they cannot.

    The free space is looked up first; then, where the system can, the blocks are allocated, so that neither another
    program nor a quota can take them away between this check and the write.
    """
    free = shutil.disk_usage(path.parent).free
    if free < size:
        raise full(path, size, free)
    if not hasattr(os, "posix_fallocate"):
        return
    try:
        os.posix_fallocate(descriptor, start, size)
    except OSError as error:
        release(descriptor, start)
        if error.errno in _FULL:
            raise full(path, size, shutil.disk_usage(path.parent).free) from None
        # Anything else means that this file system does not reserve; the look-up above then has to do.


def release(descriptor: int, end: int) -> None:
    """Give back what was reserved behind ``end``, the end of the file as HDF5 knows it."""
    if os.fstat(descriptor).st_size > end:
        os.ftruncate(descriptor, end)


def full(path: Path, needed: int, free: int) -> RunError:
    return RunError(f"{path}: disk full: {needed:,} bytes needed for the next frames, {free:,} free")

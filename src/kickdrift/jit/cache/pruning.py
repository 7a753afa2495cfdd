"""Removal of old compiled code: files unused for `DAYS` days, and the least recently used beyond `BYTES`.

Every edit of a source, and every new version of numba, leaves code that no process will load again. A file's
modification time is its last use by a process, to the nearest `STEP`.
"""

from __future__ import annotations

import os
import time
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

from kickdrift.jit.cache.code_files import SUFFIX, UNFINISHED

DAYS = 60
BYTES = 500_000_000
DAY = 86_400.0  # seconds
STEP = 0.1 * DAY

_used: set[str] = set()  # files used by this process, which removes none of them


class _File(NamedTuple):
    path: str
    bytes: int
    age: float  # seconds


def use(path: Path) -> None:
    """Record that this process uses a file."""
    _used.add(str(path))
    try:
        if time.time() - os.stat(path).st_mtime > STEP:
            os.utime(path)
    except OSError:  # another user's file, or already removed
        return


def prune(folder: Path) -> None:
    """Remove old code from a folder. Files that cannot be removed stay: other processes may prune at the same time."""
    try:
        files = sorted(_files(str(folder), time.time()), key=lambda file: file.age)
    except OSError:
        return
    total = 0
    for file in files:
        total += file.bytes
        if file.path in _used:
            continue
        unfinished = UNFINISHED in os.path.basename(file.path)
        if total > BYTES or file.age > (DAY if unfinished else DAYS * DAY):
            try:
                os.unlink(file.path)
                total -= file.bytes
            except OSError:
                continue


def _files(folder: str, now: float) -> Iterator[_File]:
    """Files of compiled code in a folder. Earlier versions kept them in subfolders, which are removed when empty."""
    with os.scandir(folder) as entries:
        for entry in entries:
            try:
                if entry.is_dir(follow_symlinks=False):
                    yield from _files(entry.path, now)
                    os.rmdir(entry.path)
                elif entry.name.endswith((SUFFIX, ".nbi")) or UNFINISHED in entry.name:
                    found = entry.stat(follow_symlinks=False)
                    yield _File(entry.path, found.st_size, now - found.st_mtime)
            except OSError:  # already removed, or a folder that is not empty
                continue

"""Temporary place of a file before it gets its name: a private folder beside it."""

from __future__ import annotations

import contextlib
import os
import shutil
import stat
import tempfile
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from kickdrift.disk.interrupt import tidy

PREFIX, SUFFIX = ".kickdrift-", ".part"
STALE = 3600.0  # seconds without changes after which a folder counts as left by a kill


@contextmanager
def private_place(path: Path) -> Iterator[Path]:
    """Yield a path of the same name in a new private folder beside ``path``, with a name that cannot be guessed. The
    folder and its content are removed at the end, also after SIGTERM. So are old folders left by a kill."""
    _remove_stale(path.parent)
    with tidy():
        folder = Path(tempfile.mkdtemp(SUFFIX, PREFIX, path.parent))  # mode 0700
        try:
            yield folder / path.name
        finally:
            shutil.rmtree(folder, ignore_errors=True)


def _remove_stale(folder: Path) -> None:
    """Remove folders of this kind, of this user, that have not changed for a long time."""
    with contextlib.suppress(OSError), os.scandir(folder) as found:
        for entry in found:
            if entry.name.startswith(PREFIX) and entry.name.endswith(SUFFIX):
                with contextlib.suppress(OSError):
                    _remove_if_stale(entry)


def _remove_if_stale(entry: os.DirEntry[str]) -> None:
    status = entry.stat(follow_symlinks=False)
    if not stat.S_ISDIR(status.st_mode) or status.st_uid != getattr(os, "getuid", lambda: status.st_uid)():
        return
    with os.scandir(entry.path) as inside:
        latest = max([status.st_mtime, *(each.stat(follow_symlinks=False).st_mtime for each in inside)])
    if latest < time.time() - STALE:
        shutil.rmtree(entry.path, ignore_errors=True)

"""Files of compiled code: read, written and, when old, removed. Damaged files and those of other users do not count.

Every edit of a source, and every new version of numba, leaves code that no process will load again. So files unused for
`DAYS` days go, and the least recently used beyond `BYTES`. A file's modification time is its last use by a process, to
the nearest `STEP`.
"""

import hashlib
import os
import pickle
import secrets
import stat
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any, NamedTuple

from kickdrift.jit.numba_private import dumps

DIGEST = hashlib.sha256().digest_size
SUFFIX, UNFINISHED = ".nbc", ".tmp"


def load(path: Path, key: str) -> Any:
    """Return the content saved under a key, or None if there is none.

    A file is a pickle with machine code, so loading the file runs it. Therefore a file counts only if it belongs to
    this user or root, and only if it is whole: LLVM ends the process on truncated code. The first bytes are a checksum.
    """
    try:
        with open(path, "rb", opener=_opened) as file:
            found = os.fstat(file.fileno())
            if not stat.S_ISREG(found.st_mode) or not _ours(found):
                return None
            digest, data = file.read(DIGEST), file.read()
        if hashlib.sha256(data).digest() != digest:
            return None
        saved, content = pickle.loads(data)
    except (OSError, ArithmeticError, AttributeError, EOFError, ImportError, LookupError, TypeError, ValueError):
        return None  # the content may refer to a user's module that this process cannot import
    except pickle.UnpicklingError:
        return None
    return content if saved == key else None


def save(path: Path, key: str, content: Any) -> None:
    """Write a file whole or not at all, whatever other processes write there. Raises OSError if the write fails."""
    data = dumps((key, content))
    unfinished = f"{path}{UNFINISHED}{secrets.token_hex(8)}"
    try:
        with open(unfinished, "xb", opener=_made) as file:
            file.write(hashlib.sha256(data).digest() + data)
        os.replace(unfinished, path)
    except OSError:
        Path(unfinished).unlink(missing_ok=True)
        raise


def _opened(path: str, flags: int) -> int:
    return os.open(path, flags | getattr(os, "O_NOFOLLOW", 0) | getattr(os, "O_NONBLOCK", 0))


def _made(path: str, flags: int) -> int:
    return os.open(path, flags, 0o644)  # a file that others can write to does not count


def _ours(found: os.stat_result) -> bool:
    return not hasattr(os, "getuid") or (found.st_uid in (0, os.getuid()) and not found.st_mode & 0o022)


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

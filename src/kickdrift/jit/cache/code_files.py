"""Files of compiled code. A damaged file, or a file of another user, counts as missing."""

from __future__ import annotations

import hashlib
import os
import pickle
import secrets
import stat
from pathlib import Path
from typing import Any

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

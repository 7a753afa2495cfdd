"""numba's files of compiled code. A damaged file, or one of another user, counts as missing."""

from __future__ import annotations

import hashlib
import os
import pickle
import stat
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

from kickdrift.jit.numba_private import IndexDataCacheFile

DIGEST = hashlib.sha256().digest_size


class CodeFiles(IndexDataCacheFile):
    """The index and the code of one function, each file with a checksum before its content.

    Both are pickles and machine code: to load one is to run it. A file is taken only from this user or root, and only
    whole; LLVM ends the process where code is cut short.
    """

    def _load_index(self) -> dict[Any, str]:
        content = self._read(self._index_path)
        version, stamp, overloads = content if isinstance(content, tuple) and len(content) == 3 else (None, None, {})
        return overloads if (version, stamp) == (self._version, self._source_stamp) else {}

    def _save_index(self, overloads: dict[Any, str]) -> None:
        self._write(self._index_path, (self._version, self._source_stamp, overloads))

    def _load_data(self, name: str) -> Any:
        content = self._read(self._data_path(name))
        if content is None:
            raise FileNotFoundError(name)  # then numba compiles anew
        return content

    def _save_data(self, name: str, data: Any) -> None:
        self._write(self._data_path(name), data)

    def _write(self, path: str, content: Any) -> None:
        data = self._dump(content)
        with self._open_for_write(path) as file:
            file.write(hashlib.sha256(data).digest() + data)

    def _read(self, path: str) -> Any:
        """What was written; None where that is not there."""
        try:
            with open(path, "rb", opener=_opened) as file:
                found = os.fstat(file.fileno())
                if not stat.S_ISREG(found.st_mode) or not _ours(found):
                    return None
                digest, data = file.read(DIGEST), file.read()
            return pickle.loads(data) if hashlib.sha256(data).digest() == digest else None
        except (OSError, ArithmeticError, AttributeError, EOFError, ImportError, LookupError, TypeError, ValueError):
            return None
        except pickle.UnpicklingError:
            return None


def _opened(path: str, flags: int) -> int:
    return os.open(path, flags | getattr(os, "O_NOFOLLOW", 0) | getattr(os, "O_NONBLOCK", 0))


def _ours(found: os.stat_result) -> bool:
    return not hasattr(os, "getuid") or (found.st_uid in (0, os.getuid()) and not found.st_mode & 0o022)


@contextmanager
def at_leisure() -> Iterator[None]:
    """What is saved for later: a full disk, or one that cannot be written, is no error of the run."""
    try:
        yield
    except OSError:
        return

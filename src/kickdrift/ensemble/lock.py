"""Lock against two processes that write the same table of an ensemble."""

from __future__ import annotations

import fcntl
import os
from pathlib import Path

from kickdrift.disk.files import descriptor
from kickdrift.disk.outputs import reason
from kickdrift.errors import InputError

TRIES = 10  # attempts, if another process removes the lock meanwhile


class Lock:
    """Empty file, locked by this process until `release`, which removes the file. Raises InputError if another process
    has the lock, or if a file of that name is not a lock. Such a file is never changed."""

    def __init__(self, path: Path, output: Path) -> None:
        self.path = path
        for _ in range(TRIES):
            try:
                self._number = self._opened()
            except OSError as error:
                raise InputError(f"{path}: cannot be written: {reason(error)}") from None
            try:
                fcntl.flock(self._number, fcntl.LOCK_EX | fcntl.LOCK_NB)
            except OSError:
                os.close(self._number)
                raise InputError(f"{output}: another process is at work on it") from None
            if os.fstat(self._number).st_size:
                os.close(self._number)
                raise InputError(f"{path}: is not a lock file, and {output} needs this name for its lock")
            if self._named():
                return
            os.close(self._number)
        raise InputError(f"{output}: another process is at work on it")

    def _opened(self) -> int:
        try:
            return os.open(self.path, os.O_RDWR | os.O_CREAT | os.O_EXCL | os.O_CLOEXEC, 0o666)
        except FileExistsError:
            if os.path.islink(self.path):
                raise InputError(f"{self.path}: is a symbolic link, not a lock file") from None
            return descriptor(self.path, os.O_RDWR | os.O_NOFOLLOW)

    def _named(self) -> bool:
        """Tell whether the name still belongs to the locked file."""
        try:
            return os.path.samestat(os.lstat(self.path), os.fstat(self._number))
        except OSError:
            return False

    def release(self) -> None:
        """Remove the file and release the lock."""
        if self._named():
            self.path.unlink(missing_ok=True)
        os.close(self._number)

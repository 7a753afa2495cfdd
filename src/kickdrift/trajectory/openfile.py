"""A run's file while it is written to: changed in place where that is safe, and replaced by a copy where it is not."""

from __future__ import annotations

import os
from collections.abc import Callable
from pathlib import Path

import h5py

from kickdrift.disk.parts import private_place
from kickdrift.errors import RunError
from kickdrift.trajectory.storage import PagedFile, in_use, open_to_write, write_error

_writing: set[tuple[int, int]] = set()  # device and inode, since some systems' locks do not hold within one process


class OpenFile:
    """A file open for writing and locked.

    Attributes
    ----------
    path : Path
    h5 : h5py.File
        What is written to it reaches the disk with `commit`; another object after `replace` and `extend`.
    key : (int, int)
        Device and inode.
    failed : bool
        Whether a write has failed, after which there must be no other.
    """

    def __init__(self, path: Path, cache_bytes: int, own: tuple[int, int] | None = None) -> None:
        self.path, self._cache_bytes = path, cache_bytes
        self.failed = False
        self._connect(own)

    def _connect(self, own: tuple[int, int] | None) -> None:
        refuse_second(self.path)
        self._storage: PagedFile
        self._storage, self.h5 = open_to_write(self.path, cache_bytes=self._cache_bytes, own=own)
        self._datasets: dict[str, h5py.Dataset] = {}
        self.key = self._storage.key
        _writing.add(self.key)

    def dataset(self, name: str) -> h5py.Dataset:
        """The dataset of that name; to find one takes longer than to write a few rows."""
        if name not in self._datasets:
            self._datasets[name] = self.h5[name]
        return self._datasets[name]

    def commit(self, *, cut: bool = False) -> None:
        """Bring what was written to the disk; the OSError of a full one leaves the file as it was."""
        self.h5.flush()
        self._storage.commit(cut=cut)

    def close(self) -> None:
        """Let go of the file as the last commit left it."""
        try:
            self.h5.close()
        finally:
            self._storage.close()
            _writing.discard(self.key)

    def reopen(self) -> None:
        """HDF5 forgets by it which places in the file have become free, and does not use them again."""
        self.close()
        self._connect(self.key)

    def check_there(self) -> None:
        """A RunError where the name is no longer that of the file that is open."""
        try:
            found = self.path.stat()
            if (found.st_dev, found.st_ino) == self.key:
                return
        except (FileNotFoundError, NotADirectoryError):
            pass
        raise RunError(f"{self.path}: was removed or replaced while the run was writing to it")

    def writing(self, write: Callable[[], object], kept: Callable[[], str]) -> None:
        """Do what writes to the file. After an error there, a RunError that says what is ``kept``, nothing more may be
        written."""
        try:
            self.check_there()
            write()
        except RunError:
            self.failed = True
            raise
        except OSError as error:
            self.failed = True
            raise RunError(f"{write_error(self.path, error)}; the file is whole and {kept()}") from None
        except RuntimeError as error:  # HDF5's
            self.failed = True
            raise RunError(f"{self.path}: writing failed: {error}") from None

    def extend(self, make: Callable[[h5py.File], None]) -> None:
        """Let ``make`` add groups and datasets: in a copy, which then takes the file's place, since no order of writes
        would let the file survive a kill meanwhile. It costs as much as the file is long."""
        with private_place(self.path) as part:
            self._storage.copy_to(part)
            storage, file = open_to_write(part, own=identity(part))
            try:
                make(file)
                file.close()
                storage.commit()
            finally:
                file.close()
                storage.close()
            self.replace(part)

    def replace(self, part: Path) -> None:
        """Give the file's name to another, and go on in that one."""
        self.close()
        own = identity(part)
        try:
            os.replace(part, self.path)
        finally:
            self._connect(own)


def identity(path: Path) -> tuple[int, int]:
    """Device and inode of a file."""
    status = path.stat()
    return status.st_dev, status.st_ino


def refuse_second(path: Path) -> None:
    """An InputError where this process is writing to the file already."""
    if identity(path) in _writing:
        raise in_use(path)

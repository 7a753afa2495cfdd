"""A run's file while it is made, whole or not at all, and during writing.

Safe changes are made in place. For all others a copy replaces the file.
"""

import os
from collections.abc import Callable
from pathlib import Path
from threading import RLock

import h5py

from kickdrift.disk import kinds
from kickdrift.disk.files import shown_path
from kickdrift.disk.kinds import Kind
from kickdrift.disk.outputs import checked_target, private_place, reason, settle
from kickdrift.errors import InputError, KickdriftError, RunError
from kickdrift.trajectory.file.storage import PagedFile, in_use, open_to_write, refuse_in_use, write_error

opening = RLock()  # held by the thread that makes or opens a file
_writing: set[tuple[int, int]] = set()  # device and inode; some systems' locks do not hold within one process


class OpenFile:
    """A file open for writing and locked.

    Attributes
    ----------
    path : Path
    h5 : h5py.File
        The open file. `commit` brings writes to the disk. `replace` and `extend` change this object.
    key : (int, int)
        Device and inode.
    failed : bool
        Whether a write has failed; no other write may follow.
    """

    def __init__(self, path: Path, cache_bytes: int, own: tuple[int, int] | None = None) -> None:
        self.path, self._cache_bytes = path, cache_bytes
        self.failed = False
        self._connect(own)

    def _connect(self, own: tuple[int, int] | None) -> None:
        with opening:
            refuse_second(self.path)
            self._storage: PagedFile
            self._storage, self.h5 = open_to_write(self.path, cache_bytes=self._cache_bytes, own=own)
            self._datasets: dict[str, h5py.Dataset] = {}
            self.key = self._storage.key
            _writing.add(self.key)

    def dataset(self, name: str) -> h5py.Dataset:
        """Dataset with this name. Datasets are kept: finding one takes longer than writing a few rows."""
        if name not in self._datasets:
            self._datasets[name] = self.h5[name]
        return self._datasets[name]

    def commit(self, *, cut: bool = False) -> None:
        """Bring all writes to the disk. A full disk raises OSError and leaves the file as it was."""
        self.h5.flush()
        self._storage.commit(cut=cut)

    def close(self) -> None:
        """Close the file as the last commit left it."""
        try:
            self.h5.close()
        finally:
            self._storage.close()
            _writing.discard(self.key)

    def reopen(self) -> None:
        """Close and open the file again, so that HDF5 forgets which places have become free and does not use them
        again."""
        with opening:
            self.close()
            self._connect(self.key)

    def check_there(self) -> None:
        """Raise RunError if the file's name now belongs to another file."""
        try:
            found = self.path.stat()
            if (found.st_dev, found.st_ino) == self.key:
                return
        except (FileNotFoundError, NotADirectoryError):
            pass
        raise RunError(f"{self.path}: was removed or replaced while the run was writing to it")

    def writing(self, write: Callable[[], object], kept: Callable[[], str]) -> None:
        """Call ``write``, which writes to the file. An error becomes a RunError that says what is ``kept``, and no
        other write may follow."""
        try:
            self.check_there()
            write()
        except KickdriftError:
            self.failed = True
            raise
        except OSError as error:
            self.failed = True
            raise RunError(f"{write_error(self.path, error)}; the file is whole and {kept()}") from None
        except RuntimeError as error:  # from HDF5
            self.failed = True
            raise RunError(f"{self.path}: writing failed: {error}") from None

    def extend(self, make: Callable[[h5py.File], None]) -> None:
        """Let ``make`` add groups and datasets to a copy, which then replaces the file.

        No order of writes in place would survive a kill. The cost is that of copying the whole file."""
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
        """Give the file's name to another file and continue in that file."""
        with opening:  # no other thread takes the file between two of these steps
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
    """Raise InputError if this process already writes to the file."""
    if identity(path) in _writing:
        raise in_use(path)


def create(path: Path, image: bytes, *, overwrite: bool, kind: Kind = kinds.RUN) -> tuple[int, int]:
    """Write ``image`` to a new file and return its device and inode. Raises an InputError with the reason if that
    fails; then nothing has changed."""
    checked_target(path, kind, overwrite)
    try:
        if overwrite:
            refuse_in_use(path)
        with private_place(path) as part:
            part.write_bytes(image)
            own = identity(part)
            settle(part, path, kind, overwrite=overwrite)
    except OSError as error:
        raise InputError(f"{shown_path(path)}: cannot be written: {reason(error)}") from None
    return own

"""The file under HDF5. Writes of HDF5 wait in memory for `PagedFile.commit`, which brings them to the disk in an order
that a kill may cut anywhere: every beginning of the order is a whole file.

HDF5's own order is not safe. HDF5 writes the superblock, which says where the file ends, last. HDF5 cuts a full index
node in half before the other half can be found. A kill between two such writes leaves frames that no program can reach,
although they were written long before. When a write fails, as on a full disk, HDF5 crashes at close; here HDF5 never
sees a failed write.

The order of a commit, and why each beginning of the order keeps all earlier commits:

1. New data beyond the end that the superblock on the disk names. Nothing refers to them yet.
2. Beyond these data, a journal of the changes in place. It is cut off when the commit is done.
3. The superblock. The file is longer now, and holds nothing new.
4. Nodes of the chunk indices (B-trees), from the top down. A node that splits has given the second half of its entries
to a new node, written in 1. Once the parent node names the new node, the old one may lose these entries.
5. All other changes, from the end of the file to its beginning: rows after the last whole row in chunks with room, then
the object headers with the number of rows. Headers lie first in the file.

When rows are removed, headers come before indices, from the beginning of the file on. When the file becomes shorter,
the superblock comes last.

A file that a kill leaves inside this order can be read, but HDF5 must not add to an index that is partly old: HDF5
would lose entries. So whoever opens the file to write first finishes the commit from the journal.

Every write from 3 on lies inside one page of 4096 bytes, and a kill does not cut pages: index nodes, 2 to 4 kB each,
begin on a page (`ALIGNMENT`). New objects and links would break the order, since a group's table of names is sorted in
place: `OpenFile.extend` makes them in a copy. The format: HDF5 File Format Specification 3.0, II.A (superblock version
0), III.A.1 (version 1 B-trees).
"""

import errno
import os
import shutil
import zlib
from collections.abc import Iterator
from itertools import pairwise
from pathlib import Path
from typing import Any

import h5py
import numpy as np

from kickdrift.disk.files import descriptor
from kickdrift.errors import InputError, RunError
from kickdrift.trajectory.file.locking import copy, detached, lock, locked
from kickdrift.trajectory.file.opening import open_stored

PAGE = 4096
_ZEROS = bytes(PAGE)
ALIGNMENT = {"alignment_threshold": 2048, "alignment_interval": PAGE}  # below the smallest index node, 2096 bytes
_SUPERBLOCK = 96
_END = slice(40, 48)  # bytes of the superblock that hold the end of the file
_SIGNATURE = b"\x89HDF\r\n\x1a\n"
_JOURNAL = b"kd redo\0"  # first bytes; then length and CRC-32 (int64 each) and the pieces
_HEAD = len(_JOURNAL) + 16
_CHUNK_INDEX = b"TREE\x01"  # first bytes of a node; the next byte is its level
_FULL = (errno.ENOSPC, errno.EDQUOT)


class PagedFile:
    """A file for h5py's file-object driver, locked against other programs while it is open.

    Raises BlockingIOError if another program has locked the file. Only `commit` changes the disk, and may raise
    OSError. A symbolic link is not followed. A file with hard links is copied first, so that no other name's file
    changes.
    """

    def __init__(self, path: str | os.PathLike[str]) -> None:
        self._raw = locked(path)
        if os.fstat(self._raw.fileno()).st_nlink > 1:
            self._raw = detached(Path(path), self._raw)
        status = os.fstat(self._raw.fileno())
        self.key, self._on_disk = (status.st_dev, status.st_ino), status.st_size
        self._end = self._end_on_disk()
        self._finish()
        self._size = self._on_disk
        self._at = 0
        self._forget()

    def _forget(self) -> None:
        """Forget the waiting writes: changed pages of the file on disk, and all data beyond its end."""
        self._pages: dict[int, bytearray] = {}
        self._base, self._tail = self._end, bytearray()

    # --- what h5py calls ---

    def seek(self, offset: int, whence: int = os.SEEK_SET) -> int:
        self._at = offset + {os.SEEK_SET: 0, os.SEEK_CUR: self._at, os.SEEK_END: self._size}[whence]
        return self._at

    def tell(self) -> int:
        return self._at

    def read(self, size: int = -1) -> bytes:
        found = bytearray(self._size - self._at if size < 0 else size)
        self.readinto(found)
        return bytes(found)

    def readinto(self, buffer: Any) -> int:
        view = memoryview(buffer).cast("B")
        begin, end = self._at, self._at + len(view)
        known = self._base + len(self._tail)
        if begin < self._base or end > known:
            view[:] = self._read(begin, len(view))
            for page in range(begin // PAGE, -(-min(end, self._base) // PAGE)):
                if page in self._pages:
                    start = page * PAGE
                    low, high = max(begin, start), min(end, start + PAGE, self._base)
                    view[low - begin : high - begin] = self._pages[page][low - start : high - start]
        low, high = max(begin, self._base), min(end, known)
        if low < high:
            with memoryview(self._tail) as tail:
                view[low - begin : high - begin] = tail[low - self._base : high - self._base]
        self._at = end
        return len(view)

    def write(self, data: Any) -> int:
        view = memoryview(data).cast("B")
        known = min(max(self._base - self._at, 0), len(view))
        self._write_pages(view[:known])
        if known < len(view):
            self._write_tail(self._at + known, view[known:])
        self._at += len(view)
        self._size = max(self._size, self._at)
        return len(view)

    def _write_pages(self, view: memoryview) -> None:
        """Write to pages inside the file on disk."""
        done = 0
        while done < len(view):
            page, offset = divmod(self._at + done, PAGE)
            piece = view[done : done + PAGE - offset]
            if page not in self._pages:
                whole = len(piece) == PAGE
                self._pages[page] = bytearray(PAGE) if whole else bytearray(self._read(page * PAGE, PAGE))
            self._pages[page][offset : offset + len(piece)] = piece
            done += len(piece)

    def _write_tail(self, place: int, view: memoryview) -> None:
        """Write beyond the end of the file on disk. The tail waits as one piece, since single pages would be too
        slow."""
        known = self._base + len(self._tail)
        if known < place:
            self._tail += self._read(known, place - known)
        start = place - self._base
        again = min(len(self._tail) - start, len(view))
        with memoryview(self._tail) as tail:
            tail[start : start + again] = view[:again]
        self._tail += view[again:]

    def truncate(self, size: int | None = None) -> int:
        self._size = self._at if size is None else size
        for page in [page for page in self._pages if page * PAGE >= self._size]:
            del self._pages[page]
        del self._tail[max(self._size - self._base, 0) :]
        return self._size

    def flush(self) -> None:
        """Do nothing: HDF5 must not meet a full disk."""

    # --- what the writer calls ---

    def commit(self, *, cut: bool = False) -> None:
        """Bring HDF5's writes to the disk; ``cut`` says that rows were removed. Call right after ``h5py.File.flush``.

        If the disk is full, the OSError comes before anything important has changed.
        """
        fresh, placed = self._pieces(cut)
        end = max(self._end, self._size)
        try:
            for offset, data in fresh:
                self._put(offset, data)
            if self._on_disk < self._size:
                self._resize(self._size)
            if len(placed) > 1:
                self._put(end, _journal(placed))
        except OSError:
            self._resize(self._end)
            raise
        self._place(placed)
        self._forget()

    def _place(self, pieces: list[tuple[int, bytes]]) -> None:
        """Change existing bytes in place, and cut off what lies beyond the file's end."""
        for offset, data in pieces:
            self._put(offset, data)
        self._end = self._end_on_disk()
        if self._end < self._on_disk:
            self._resize(self._end)

    def _finish(self) -> None:
        """Finish a commit that a kill cut short, if its journal is complete."""
        if self._read(0, len(_SIGNATURE)) != _SIGNATURE or self._end > self._on_disk:
            return
        head = self._read(self._end, _HEAD)
        if not head.startswith(_JOURNAL):
            return
        size, check = (int.from_bytes(head[k : k + 8], "little") for k in (8, 16))
        if self._end + _HEAD + size > self._on_disk:
            return
        data = self._read(self._end + _HEAD, size)
        if zlib.crc32(data) != check:
            return
        pieces = _journalled(data)
        if all(offset + len(piece) <= self._end for offset, piece in pieces):
            self._place(pieces)

    def _end_on_disk(self) -> int:
        return int.from_bytes(self._read(0, _SUPERBLOCK)[_END], "little")

    def copy_to(self, path: Path) -> None:
        """Write the content of the disk to another file with the same permissions."""
        copy(self._raw, path)

    def close(self) -> None:
        """Close the file and forget uncommitted writes."""
        self._forget()
        self._raw.close()

    def _pieces(self, cut: bool) -> tuple[list[tuple[int, memoryview]], list[tuple[int, bytes]]]:
        """Pieces beyond the end, and changes before the end, each in the order of a commit."""
        placed: list[tuple[tuple[int, ...], int, bytes]] = []
        for first, last in _runs(sorted(self._pages)):
            begin, end = first * PAGE, min(last * PAGE, self._base)
            old = memoryview(self._read(begin, end - begin))
            for page in range(first, last):
                start, known = page * PAGE, min(end - page * PAGE, PAGE)
                before = old[start - begin : start - begin + known]
                placed += _changes(start, before, self._pages[page][:known], cut, self._size < self._base)
        placed.sort(key=lambda piece: piece[0])
        return list(_filled(self._base, self._tail)), [(offset, data) for _, offset, data in placed]

    def _read(self, offset: int, size: int) -> bytes:
        """Read from the disk, with zeros beyond its end."""
        self._raw.seek(offset)
        found = b""
        while len(found) < size and (more := self._raw.read(size - len(found))):
            found += more
        return found.ljust(size, b"\0")

    def _put(self, offset: int, data: bytes | memoryview) -> None:
        self._raw.seek(offset)
        done = 0
        with memoryview(data) as view:
            while done < len(view):
                done += self._raw.write(view[done:])
        self._on_disk = max(self._on_disk, offset + len(data))

    def _resize(self, size: int) -> None:
        self._raw.truncate(size)
        self._on_disk = size


def _runs(pages: list[int]) -> Iterator[tuple[int, int]]:
    """First page of each run of consecutive pages, and the page after its last."""
    begins = [k for k, page in enumerate(pages) if not k or pages[k - 1] + 1 < page]
    for begin, end in pairwise([*begins, len(pages)]):
        yield pages[begin], pages[end - 1] + 1


def _filled(base: int, tail: bytearray) -> Iterator[tuple[int, memoryview]]:
    """Pieces of the tail that begins at ``base``, without pages of zeros: these stay holes, which take no disk
    space."""
    view, begin = memoryview(tail), 0
    for page in range(-(base % PAGE), len(tail), PAGE):
        low, high = max(page, 0), min(page + PAGE, len(tail))
        if tail.startswith(_ZEROS[: high - low], low):
            if begin < low:
                yield base + begin, view[begin:low]
            begin = high
    if begin < len(tail):
        yield base + begin, view[begin:]


def _changes(
    start: int, old: memoryview, new: bytearray, cut: bool, shrinks: bool
) -> list[tuple[tuple[int, ...], int, bytes]]:
    """Differing pieces of a page, each with its rank in the order of a commit and its offset."""
    found = []
    for low, high in ((0, _SUPERBLOCK), (_SUPERBLOCK, len(new))) if start == 0 else ((0, len(new)),):
        differing = np.flatnonzero(np.frombuffer(old, "u1")[low:high] != np.frombuffer(new, "u1")[low:high])
        if not differing.size:
            continue
        first, last = low + int(differing[0]), low + int(differing[-1])
        if start == low == 0:
            rank: tuple[int, ...] = (3 if shrinks else 0,)  # the superblock on the disk says where the journal is
        elif new.startswith(_CHUNK_INDEX):
            rank = (2 if cut else 1, -new[len(_CHUNK_INDEX)], start)
        else:
            rank = (1, start) if cut else (2, -start)
        found.append((rank, start + first, bytes(new[first : last + 1])))
    return found


def _journal(pieces: list[tuple[int, bytes]]) -> bytes:
    """Bytes of a journal (see `_JOURNAL`). A piece is its offset and its size (int64 each), then its bytes."""
    data = b"".join(b"".join((_int64(offset), _int64(len(piece)), piece)) for offset, piece in pieces)
    return _JOURNAL + _int64(len(data)) + _int64(zlib.crc32(data)) + data


def _journalled(data: bytes) -> list[tuple[int, bytes]]:
    """Pieces from the bytes of a journal."""
    pieces, at = [], 0
    while at < len(data):
        offset, size = (int.from_bytes(data[k : k + 8], "little") for k in (at, at + 8))
        pieces.append((offset, data[at + 16 : at + 16 + size]))
        at += 16 + size
    return pieces


def _int64(number: int) -> bytes:
    return number.to_bytes(8, "little")


def open_to_write(
    path: Path, *, cache_bytes: int = 2**20, own: tuple[int, int] | None = None
) -> tuple[PagedFile, h5py.File]:
    """Open the file for writing and lock it. Raises InputError if another program has it, or if it is no HDF5 file or
    has links out of itself. ``own`` is the device and inode of a file that this process made and need not check."""
    try:
        storage = PagedFile(path)
    except BlockingIOError:
        raise in_use(path) from None
    except InputError:
        raise
    except OSError as error:
        raise InputError(f"{path}: cannot be opened for writing: {unwritable(error)}") from None
    try:
        return storage, open_stored(storage, path, own=storage.key == own, rdcc_nbytes=cache_bytes, **ALIGNMENT)
    except InputError:
        storage.close()
        raise
    except (OSError, RuntimeError, ValueError) as error:
        storage.close()
        raise InputError(f"{path}: cannot be opened for writing: {' '.join(str(error).split())}") from None


def unwritable(error: OSError) -> str:
    """Reason why the system refused to open a file for writing."""
    if error.errno == errno.ELOOP:
        return "a symbolic link has taken its place"
    return (error.strerror or str(error)).lower()


def refuse_in_use(path: Path) -> None:
    """Raise InputError if another program has locked the file."""
    try:
        raw = open(path, "rb", opener=lambda name, _: descriptor(name))  # noqa: SIM115
    except (OSError, InputError):  # the folder decides whether the file can be replaced
        return
    with raw:
        try:
            lock(raw)
        except BlockingIOError:
            raise in_use(path) from None


def in_use(path: Path) -> InputError:
    return InputError(f"{path}: is open in another program or run; close it there first")


def write_error(path: Path, error: OSError) -> RunError:
    """RunError with the reason why a commit failed, in one line."""
    if error.errno in _FULL:
        return RunError(f"{path}: disk full: no room for the next frames, {free_bytes(path):,} bytes free")
    if error.errno == errno.EFBIG:
        return RunError(f"{path}: may not grow further: a limit on the size of a file is reached (see ulimit -f)")
    return RunError(f"{path}: writing failed: {(error.strerror or str(error)).lower()}")


def free_bytes(path: Path) -> int:
    return shutil.disk_usage(path.parent).free

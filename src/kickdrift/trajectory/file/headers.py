"""Sizes in object headers and in the heaps of groups' names, checked before HDF5 reads them.

HDF5 allocates what a header claims, up to 4 GiB, before it looks whether the file is that long. A damaged list of free
places in a heap of names makes HDF5 allocate without end. The format: HDF5 File Format Specification 3.0, II.A
(superblock), III.D (local heap), IV.A.1 (object headers), IV.A.2.q and r (continuation, names of a group).
"""

import os
from collections.abc import Iterator
from struct import unpack_from
from typing import Any

SIGNATURE = b"\x89HDF\r\n\x1a\n"
_NEW, _MORE = b"OHDR", b"OCHK"  # first bytes of a header of version 2, and of its further pieces
_CONTINUED, _NAMES = 0x10, 0x11  # messages of a header: place and size of the next piece; places of tree and heap
_HEAP = b"HEAP\0"
_NO_PLACE, _UNDEFINED = 1, 2**64 - 1  # ends of a list of free places
_MOST = 1000  # pieces of a header
_SUPERBLOCK = 76  # bytes up to the end of the root's address


class Headers:
    """Object headers of a file. Files with addresses or sizes of other than eight bytes are left to HDF5.

    Parameters
    ----------
    source : a binary file object with the file's bytes
    """

    def __init__(self, source: Any) -> None:
        self._source, self._bytes = source, source.seek(0, os.SEEK_END)
        head, self._base, self._root = b"", 0, None
        place = 0
        while place + 64 <= self._bytes:  # before the file proper there may be other data
            if (head := self._read(place, 96)).startswith(SIGNATURE):
                break
            place = 2 * place or 512
        if head.startswith(SIGNATURE) and len(head) >= _SUPERBLOCK:
            self._begin(head)

    def _begin(self, head: bytes) -> None:
        """Find the header of the root group from the superblock."""
        version = head[8]
        old = version < 2
        base, root = (24 if version == 0 else 28, 64 if version == 0 else 68) if old else (12, 36)
        if (head[13:15] if old else head[9:11]) == b"\x08\x08" and version <= 3:
            (self._base,), (self._root,) = unpack_from("<Q", head, base), unpack_from("<Q", head, root)

    def check_root(self) -> None:
        """Check the root group's header. Raises ValueError as ``check`` does."""
        if self._root is not None:
            self.check(self._root)

    def check(self, address: int) -> None:
        """Check the header at an address, and the heap of a group's names. Raises ValueError if one of their parts
        claims to reach beyond its end."""
        if self._root is None:
            return
        head = self._read(self._base + address, 32)
        if head.startswith(_NEW):
            flags, at = head[5], 6 + (16 if len(head) > 5 and head[5] & 0x20 else 0) + (4 if head[5] & 0x10 else 0)
            width = 1 << (flags & 3)
            pieces = [(address + at + width, int.from_bytes(head[at : at + width], "little"), 0)]
            ahead = 6 if flags & 0x04 else 4  # bytes before a message's body
        elif head[:1] == b"\x01":
            pieces, flags, ahead = [(address + 16, int.from_bytes(head[8:12], "little"), 0)], -1, 8
        else:
            return
        for place, size, skipped in pieces:  # the list grows during this loop
            if self._base + place + size > self._bytes:
                raise ValueError(f"its header claims {size:,} bytes at {place}, beyond the file's end")
            if len(pieces) > _MOST:
                raise ValueError(f"its header has more than {_MOST:,} pieces")
            block = self._read(self._base + place, size)[skipped:]
            for kind, first, second in _messages(block, ahead):
                if kind == _CONTINUED:
                    pieces.append((first, second, 0 if flags < 0 else len(_MORE)))
                elif kind == _NAMES:
                    self._check_names(self._base + second)

    def _check_names(self, place: int) -> None:
        """Check the heap of a group's names."""
        head = self._read(place, 32)
        if len(head) < 32 or not head.startswith(_HEAP):
            raise ValueError(f"there is no heap of names at {place}")
        size, free, data = unpack_from("<QQQ", head, 8)
        if self._base + data + size > self._bytes:
            raise ValueError(f"its heap of names claims {size:,} bytes at {data}, beyond the file's end")
        names, seen = self._read(self._base + data, size), set[int]()
        while free not in (_NO_PLACE, _UNDEFINED):
            if free in seen or free + 16 > size or free + unpack_from("<Q", names, free + 8)[0] > size:
                raise ValueError("its heap of names is damaged")
            seen.add(free)
            (free,) = unpack_from("<Q", names, free)

    def _read(self, place: int, size: int) -> bytes:
        self._source.seek(place)
        found: bytes = self._source.read(size)
        return found


def _messages(block: bytes, ahead: int) -> Iterator[tuple[int, int, int]]:
    """Kind and first two numbers of the messages of one piece that say where something lies."""
    at = 0
    while at + ahead <= len(block):
        kind, long = unpack_from("<HH", block, at) if ahead == 8 else (block[at], unpack_from("<H", block, at + 1)[0])
        at += ahead
        if kind in (_CONTINUED, _NAMES) and at + 16 <= len(block):
            yield kind, *unpack_from("<QQ", block, at)
        at += long

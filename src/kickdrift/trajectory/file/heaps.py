"""Checks of values with variable length, done before HDF5 reads them.

Such a value refers to an object in a global heap. HDF5 loops for ever on a damaged heap, and allocates any length that
a reference claims. So kickdrift follows every reference in its own files first. Other programs store references in
other places, so in their files every heap is walked. The format: HDF5 File Format Specification 3.0, III.E (global
heap), IV.A.1.a (object header, version 1), IV.A.2.m (attribute message).
"""

import os
from collections.abc import Iterator
from struct import iter_unpack, unpack_from
from typing import Any

import h5py
from h5py import h5a, h5d, h5t

REFERENCE = 16  # bytes: length, address of the heap, index in it
HEAP = b"GCOL\x01\0\0\0"  # first bytes of a heap; its size follows
_PIECE = 16 * 2**20
_FILL_OLD, _FILL, _ATTRIBUTE, _CONTINUED = 0x04, 0x05, 0x0C, 0x10  # messages of an object header
_KIND_OF_VARIABLE, _LIST = 3, 0  # place in an encoded type, and its value there
_SHARED = 2  # flag: the message's body is elsewhere
_MOST = 1000  # most pieces of an object header


class Heaps:
    """Global heaps of an open file. Raises ValueError that says what is wrong with a heap.

    Parameters
    ----------
    file : the open file
    source : a binary file object with the same bytes
    """

    def __init__(self, file: h5py.File, source: Any) -> None:
        self._source, self.bytes = source, source.seek(0, os.SEEK_END)
        made = file.id.get_create_plist()
        self._plain = made.get_version()[0] == 0 and made.get_sizes() == (8, 8) and not made.get_userblock()
        self._known: dict[int, dict[int, int]] = {}  # sizes of each heap's objects, by index
        self._all_walked = False

    def check_attributes(self, address: int, attributes: list[h5a.AttrID]) -> None:
        """Check the attributes of the object at an address."""
        variable = {}
        for each in attributes:
            kind, count = each.get_type(), each.get_space().get_simple_extent_npoints()
            if kind.get_size() * count > self.bytes:
                raise ValueError(f"attribute {each.name!r} claims more than the file's {self.bytes:,} bytes hold")
            if is_variable(kind):
                _check_type(kind)
                variable[each.name] = kind, count
        if not variable:
            return
        found = set()
        for message, body in self._messages(address):
            if message != _ATTRIBUTE:
                continue
            name, value = _attribute(body)
            if name in variable:
                found.add(name)
                kind, count = variable[name]
                self._follow(kind, value, count)
        if len(found) < len(variable):
            self._walk_all()

    def check_dataset(self, address: int, data: h5d.DatasetID) -> None:
        """Check a dataset's fill value, which may have variable length. Call this before any other use of the
        dataset."""
        kind = data.get_type()
        if not is_variable(kind):
            return
        _check_type(kind)
        if not self._plain:
            self._walk_all()
            return
        for message, body in self._messages(address):
            if value := _fill(message, body):
                self._follow(kind, value, 1)
        place, count = data.get_offset(), data.get_space().get_simple_extent_npoints()
        if data.get_create_plist().get_layout() != h5d.CONTIGUOUS:
            self._walk_all()
        elif place is not None:
            self._follow(kind, self._read(place, count * REFERENCE), count)

    def _follow(self, kind: h5t.TypeID, raw: bytes, count: int) -> None:
        """Check references to values of a type."""
        inner = kind.get_super() if isinstance(kind, h5t.TypeVlenID) else None
        if not isinstance(kind, h5t.TypeVlenID | h5t.TypeStringID) or (inner is not None and is_variable(inner)):
            self._walk_all()
            return
        if len(raw) < count * REFERENCE:
            raise ValueError(f"claims {count} values, but has {len(raw)} bytes")
        size, total = 1 if inner is None else inner.get_size(), 0
        for length, heap, index in iter_unpack("<IQI", raw[: count * REFERENCE]):
            total += length * size if heap else 0
            if total > self.bytes:
                raise ValueError(f"claims {total:,} bytes of text, more than the file's {self.bytes:,} bytes hold")
            if heap and (index == 0 or self._walk(heap).get(index) != length * size):
                raise ValueError(f"its text of {length * size:,} bytes is missing from its place")

    def _walk(self, address: int) -> dict[int, int]:
        """Sizes of a heap's objects by index, read in HDF5's way."""
        if address in self._known:
            return self._known[address]
        head = self._read(address, REFERENCE)
        whole = _number(head[8:])
        if not head.startswith(HEAP) or whole < REFERENCE:
            raise ValueError(f"there is no heap of texts at {address}")
        data, at, found = self._read(address, whole), REFERENCE, {}
        while at + 16 <= whole:
            index, size = unpack_from("<H6xQ", data, at)
            needed = 16 + _padded(size) if index else size  # object 0 is the free space, with its header
            if index in found or not 16 <= needed <= whole - at:
                raise ValueError(f"the heap of texts at {address} is damaged")
            found[index] = size
            at += needed
        self._known[address] = found
        return found

    def _walk_all(self) -> None:
        """Walk every heap in the file."""
        if self._all_walked:
            return
        for start in range(0, self.bytes, _PIECE):
            piece = self._read(start, min(_PIECE + len(HEAP) - 1, self.bytes - start))
            at = piece.find(HEAP)
            while at >= 0:
                self._walk(start + at)
                at = piece.find(HEAP, at + 1)
        self._all_walked = True

    def _messages(self, address: int) -> Iterator[tuple[int, bytes]]:
        """Yield type and body of each message in an object header of version 1; nothing for other versions."""
        head = self._read(address, 16) if self._plain else b"\0"
        if head[0] != 1:
            return
        pieces = [(address + 16, _number(head[8:12]))]
        for place, size in pieces:  # the list grows during this loop
            block, at = self._read(place, size), 0
            while at + 8 <= len(block):
                kind, long, flags = unpack_from("<HHB", block, at)
                body, at = block[at + 8 : at + 8 + long], at + 8 + long
                if kind == _CONTINUED and len(pieces) < _MOST:
                    pieces.append((_number(body[:8]), _number(body[8:16])))
                elif not flags & _SHARED:
                    yield kind, body

    def _read(self, place: int, size: int) -> bytes:
        if place + size > self.bytes:
            raise ValueError(f"{size:,} bytes at {place} are beyond the file's end")
        self._source.seek(place)
        found: bytes = self._source.read(size)
        if len(found) < size:
            raise ValueError(f"{size:,} bytes at {place} cannot be read")
        return found


def is_variable(kind: h5t.TypeID) -> bool:
    """Tell whether values of a type, or parts of them, have variable length."""
    if isinstance(kind, h5t.TypeStringID):
        return bool(kind.is_variable_str())
    if isinstance(kind, h5t.TypeCompoundID):
        return any(is_variable(kind.get_member_type(k)) for k in range(kind.get_nmembers()))
    return isinstance(kind, h5t.TypeVlenID) or (isinstance(kind, h5t.TypeArrayID) and is_variable(kind.get_super()))


def _check_type(kind: h5t.TypeID) -> None:
    """Refuse a type of variable length that is neither a list nor a text: HDF5 crashes when it reads one."""
    if isinstance(kind, h5t.TypeCompoundID):
        for k in range(kind.get_nmembers()):
            _check_type(kind.get_member_type(k))
    elif isinstance(kind, h5t.TypeVlenID | h5t.TypeArrayID):
        if isinstance(kind, h5t.TypeVlenID) and kind.encode()[_KIND_OF_VARIABLE] & 0x0F != _LIST:
            raise ValueError("its type is damaged")
        _check_type(kind.get_super())


def _attribute(body: bytes) -> tuple[bytes, bytes]:
    """Name and raw value of an attribute message."""
    if len(body) < 8:
        raise ValueError("an attribute is damaged")
    sizes = unpack_from("<3H", body, 2)  # sizes of name, type and shape
    at = 9 if body[0] == 3 else 8
    name = body[at : at + sizes[0]].partition(b"\0")[0]
    return name, body[at + sum(_padded(size) if body[0] == 1 else size for size in sizes) :]


def _fill(message: int, body: bytes) -> bytes:
    """Fill value of a dataset; empty if the value is zero or the message has none."""
    if message == _FILL_OLD:
        place = 0
    elif message == _FILL and body[:1] == b"\3":
        place = 2 if body[1] & 0x20 else len(body)
    elif message == _FILL:
        place = 4
    else:
        return b""
    size = _number(body[place : place + 4])
    return body[place + 4 : place + 4 + size]


def _padded(size: int) -> int:
    return -(-size // 8) * 8


def _number(data: bytes) -> int:
    return int.from_bytes(data, "little")

"""Memory of a page: copies of the arrays and tuples that compiled code works on, at addresses of WebAssembly."""

import ctypes
from collections.abc import Iterator
from typing import Any

import numpy as np
from llvmlite import ir
from numba import typeof, types
from numpy.typing import NDArray

from kickdrift.jit.numba_private import cpu_target
from kickdrift.pages.linking import BASE
from kickdrift.pages.lowering import target_data

ALIGNMENT = 64  # bytes
LONGEST_GAP = 64  # bytes of zeros inside a filled piece
POINTER = 4  # bytes


class Image:
    """The memory of a page, from the address BASE on.

    Attributes
    ----------
    places : whole numbers that stand for addresses -> what is there on the page: a function's name, or bound parts
    calls : (offset, name of a function) of each whole number in this memory that is a function's address
    """

    def __init__(self) -> None:
        self.bytes = bytearray()
        self.places: dict[int, Any] = {}
        self.calls: list[tuple[int, str]] = []
        self._arrays: dict[int, tuple[NDArray[Any], int]] = {}
        self._pending: list[tuple[int, int]] = []  # (address, whole number) that may be in ``places``

    def room(self, size: int) -> int:
        """Address of so many new bytes of zeros."""
        begin = -(-len(self.bytes) // ALIGNMENT) * ALIGNMENT
        self.bytes.extend(bytes(begin + max(size, 1) - len(self.bytes)))
        return BASE + begin

    def array(self, array: NDArray[Any]) -> int:
        """Address of the array's copy. Arrays that share memory here share it there."""
        whole = array
        while isinstance(whole.base, np.ndarray):
            whole = whole.base
        first = np.lib.array_utils.byte_bounds(whole)[0]
        if first not in self._arrays or self._arrays[first][0].nbytes < whole.nbytes:
            begin, end = np.lib.array_utils.byte_bounds(whole)
            place = self.room(end - begin)
            self._write(place, ctypes.string_at(begin, end - begin))
            self._arrays[first] = whole, place
            if whole.dtype == np.int64:
                self._pending += [(place + 8 * k, value) for k, value in enumerate(whole.reshape(-1).tolist())]
        return self._arrays[first][1] + array.__array_interface__["data"][0] - first

    def value(self, value: Any) -> int:
        """Address of a NamedTuple's copy, in the layout of compiled code."""
        kind = typeof(value)
        shape = cpu_target.target_context.get_value_type(kind)
        place = self.room(shape.get_abi_size(target_data()))
        self._put(value, kind, shape, place)
        return place

    def _put(self, value: Any, kind: types.Type, shape: Any, place: int) -> None:
        if isinstance(value, tuple):
            for k, (part, inner) in enumerate(zip(value, kind, strict=True)):
                step = (
                    shape.element.get_abi_size(target_data()) * k
                    if isinstance(shape, ir.ArrayType)
                    else (shape.get_element_offset(target_data(), k))
                )
                own = shape.element if isinstance(shape, ir.ArrayType) else shape.elements[k]
                self._put(part, inner, own, place + step)
        elif isinstance(value, np.ndarray):
            inside = [shape.get_element_offset(target_data(), k) for k in range(len(shape.elements))]
            whole = (0, 0, value.size, value.itemsize, self.array(value))
            for number, offset, element in zip(whole, inside, shape.elements, strict=False):
                self._number(place + offset, number, POINTER if isinstance(element, ir.PointerType) else 8)
            for k, number in enumerate(value.shape):
                self._number(place + inside[5] + 8 * k, number, 8)
            for k, number in enumerate(value.strides):
                self._number(place + inside[6] + 8 * k, number, 8)
        elif isinstance(value, float):
            self._write(place, np.float64(value).tobytes())
        elif value is not None:
            size = shape.get_abi_size(target_data())
            self._number(place, int(value), size)
            self._pending.append((place, int(value)))

    def arguments(self, value: Any) -> Iterator[Any]:
        """Numbers that stand for a value among the arguments of compiled code."""
        if isinstance(value, tuple):
            for part in value:
                yield from self.arguments(part)
        elif isinstance(value, np.ndarray):
            yield from (0, 0, value.size, value.itemsize, self.array(value), *value.shape, *value.strides)
        elif value is None:
            yield 0
        else:
            yield self.places.get(value, value)

    def settle(self) -> None:
        """Write what the numbers in `places` are on the page, once all places are known."""
        known: dict[int, int] = {}
        while self._pending:
            place, value = self._pending.pop()
            found = self.places.get(value)
            if isinstance(found, str):
                self.calls.append((place, found))
            elif found is not None:
                known.setdefault(value, 0)
                known[value] = known[value] or self.value(found)
                self._number(place, known[value], 8)

    def _number(self, place: int, number: int, size: int) -> None:
        self._write(place, int(number).to_bytes(size, "little", signed=number < 0))

    def _write(self, place: int, data: bytes) -> None:
        self.bytes[place - BASE : place - BASE + len(data)] = data

    def pieces(self) -> list[tuple[int, bytes]]:
        """The parts of the memory that are not zero: offset and bytes."""
        filled = np.flatnonzero(np.frombuffer(self.bytes, np.uint8))
        if not filled.size:
            return []
        ends = np.flatnonzero(np.diff(filled) > LONGEST_GAP)
        begins = filled[np.r_[0, ends + 1]].tolist()
        return [
            (begin, bytes(self.bytes[begin : end + 1]))
            for begin, end in zip(begins, filled[np.r_[ends, filled.size - 1]].tolist(), strict=True)
        ]

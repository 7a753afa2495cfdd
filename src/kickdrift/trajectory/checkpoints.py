"""Checkpoints in a run's file: all that the next step's bits depend on, as bytes that no other program needs to read.

A checkpoint (`Simulation.checkpoint`) is a dictionary of arrays, numbers, texts, and lists and dictionaries of these.
Its bytes are the length of a JSON text as a little-endian int64, the text, and the arrays one after the other, as C
lays them out and little-endian. In the text an array is ``{"array": [dtype, shape, first byte]}``, counted from behind
the text. Nothing in it is code.
"""

from __future__ import annotations

import json
import zlib
from collections.abc import Callable
from typing import Any, NamedTuple

import h5py
import numpy as np
from numpy.typing import NDArray

from kickdrift.errors import InputError

CHECKPOINTS = "kickdrift/checkpoints"
BYTES_CHUNK = 64 * 1024
ROWS_CHUNK = 128
ROW_BYTES = 32  # of step, time, end and checksum

Checkpoint = dict[str, Any]


class Stored(NamedTuple):
    """A checkpoint as bytes, with the step and the time that it is of."""

    step: int
    time: float
    data: bytes

    @property
    def size(self) -> int:
        """The bytes that it takes in a file, tables left out."""
        return len(self.data) + ROW_BYTES


def encoded(checkpoint: Checkpoint) -> bytes:
    """See the module. A TypeError where there is something in it that cannot be kept."""
    arrays: list[bytes] = []
    text = json.dumps(_put(checkpoint, arrays)).encode()
    return b"".join([len(text).to_bytes(8, "little"), text, *arrays])


def decoded(data: bytes) -> Checkpoint:
    """The checkpoint that `encoded` was given, bit by bit; arrays are writable."""
    end = 8 + int.from_bytes(data[:8], "little")
    return _take(json.loads(data[8:end]), memoryview(data)[end:])


def _put(value: Any, arrays: list[bytes]) -> Any:
    if isinstance(value, np.ndarray):
        start = sum(map(len, arrays))
        little = np.ascontiguousarray(value).astype(value.dtype.newbyteorder("<"), copy=False)
        arrays.append(little.tobytes())
        return {"array": [little.dtype.str, list(value.shape), start]}
    if isinstance(value, dict):
        if not all(isinstance(key, str) for key in value) or "array" in value:
            raise TypeError(f"a checkpoint's keys are texts, and not 'array'; got {list(value)}")
        return {key: _put(inner, arrays) for key, inner in value.items()}
    if isinstance(value, (list, tuple)):
        return [_put(inner, arrays) for inner in value]
    if isinstance(value, np.generic):
        return value.item()
    if value is None or isinstance(value, (bool, int, float, str)):
        return value
    raise TypeError(f"a checkpoint cannot hold a {type(value).__name__}")


def _take(value: Any, arrays: memoryview) -> Any:
    if isinstance(value, list):
        return [_take(inner, arrays) for inner in value]
    if not isinstance(value, dict):
        return value
    if "array" not in value:
        return {key: _take(inner, arrays) for key, inner in value.items()}
    kind, shape, start = value["array"]
    count = int(np.prod(shape, dtype=int))
    flat: NDArray = np.frombuffer(arrays, kind, count, start)
    return flat.reshape(shape).astype(flat.dtype.newbyteorder("="))  # a copy


class Table:
    """The checkpoints of an open file.

    Attributes
    ----------
    rows : int
        Checkpoints that are whole.
    """

    def __init__(self, file: h5py.File, path: Any) -> None:
        self._group: h5py.Group = file[CHECKPOINTS]
        self._path = path
        self.rows = int(self._group["committed"][0])

    @property
    def steps(self) -> NDArray[np.int64]:
        """(rows,)"""
        return self._group["step"][: self.rows]

    @property
    def times(self) -> NDArray[np.float64]:
        """(rows,) in the system's unit."""
        return self._group["time"][: self.rows]

    def __getitem__(self, row: int) -> Checkpoint:
        """One checkpoint; an InputError where its bytes are not those that were written."""
        ends = self._group["end"][: self.rows]
        begin, end = (int(ends[row - 1]) if row else 0), int(ends[row])
        data = self._group["data"][begin:end].tobytes()
        if zlib.crc32(data) != int(self._group["crc32"][row]):
            raise InputError(f"{self._path}: damaged: the checkpoint of step {self._group['step'][row]} has changed")
        return decoded(data)

    def add(self, stored: Stored, commit: Callable[[], None]) -> None:
        """Write one more; ``commit`` brings to the disk what was written so far. Doing it again after an interrupt does
        no harm."""
        group, row = self._group, self.rows
        begin = int(group["end"][row - 1]) if row else 0
        end = begin + len(stored.data)
        for name, size in (("data", end), ("end", row + 1), ("step", row + 1), ("time", row + 1), ("crc32", row + 1)):
            group[name].resize(size, axis=0)
        group["data"][begin:end] = np.frombuffer(stored.data, "u1")
        group["end"][row], group["crc32"][row] = end, zlib.crc32(stored.data)
        group["step"][row], group["time"][row] = stored.step, stored.time
        commit()
        group["committed"][0] = row + 1
        commit()
        self.rows += 1

    def cut(self) -> bool:
        """Drop what a kill left behind the last whole one; whether there was any. See `Rows.cut`."""
        group, found = self._group, False
        size = int(group["end"][self.rows - 1]) if self.rows else 0
        for name in ("data", "end", "step", "time", "crc32"):
            wanted = size if name == "data" else self.rows
            if group[name].shape[0] > wanted:
                group[name].resize(wanted, axis=0)
                found = True
        return found


def new_table(file: h5py.File) -> None:
    """The group of a file in the making."""
    group = file.create_group(CHECKPOINTS)
    for name, kind, chunk in (
        ("data", "u1", BYTES_CHUNK),
        ("end", "i8", ROWS_CHUNK),
        ("step", "i8", ROWS_CHUNK),
        ("time", "f8", ROWS_CHUNK),
        ("crc32", "u4", ROWS_CHUNK),
    ):
        group.create_dataset(name, (0,), kind, maxshape=(None,), chunks=(chunk,), track_times=False)
    group.create_dataset("committed", data=np.zeros(1, "i8"), track_times=False)

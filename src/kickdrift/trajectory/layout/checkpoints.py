"""Checkpoints in a run's file: everything that determines the bits of the next step, as bytes for kickdrift alone.

A checkpoint (`Simulation.checkpoint`) is a dictionary of arrays, numbers, texts, and lists and dictionaries of these.
Its bytes are the length of a JSON text as a little-endian int64, then the text, then the arrays in turn, little-endian
and in C order. In the text an array is ``{"array": [dtype, shape, first byte]}``. The first byte counts from the end of
the text. No part of a checkpoint is code. A point of a run is a step and a time.
"""

import json
import math
import zlib
from collections.abc import Callable
from typing import Any, NamedTuple

import h5py
import numpy as np
from numpy.typing import NDArray

from kickdrift.errors import InputError
from kickdrift.trajectory.layout.contents import Contents, too_deep

ROUNDING = 1e-12  # relative, for times that were converted between units
CHECKPOINTS = "kickdrift/checkpoints"
BYTES_CHUNK = 64 * 1024
ROWS_CHUNK = 128
COLUMNS = {"data": "u1", "end": "i8", "step": "i8", "time": "f8", "crc32": "u4"}
ROW_BYTES = 32  # step, time, end and checksum
Checkpoint = dict[str, Any]


def same(point: tuple[int, float] | None, step: int, time: float) -> bool:
    """Tell whether a point is at this step and time. An adaptive run may have looks at several times inside one
    step."""
    return point is not None and point[0] == step and math.isclose(point[1], time, rel_tol=ROUNDING)


def before(time: float, other: float) -> bool:
    """Tell whether a time is earlier than another by more than rounding."""
    return time < other and not math.isclose(time, other, rel_tol=ROUNDING)


def behind(point: tuple[int, float], last: tuple[int, float]) -> bool:
    """Tell whether a (step, time) is earlier than the last one."""
    return point[0] < last[0] or (point[0] == last[0] and before(point[1], last[1]))


class Stored(NamedTuple):
    """A checkpoint as bytes, with its step and its time."""

    step: int
    time: float
    data: bytes

    @property
    def size(self) -> int:
        """Bytes that the checkpoint takes in a file, without the tables."""
        return len(self.data) + ROW_BYTES


def encoded(checkpoint: Checkpoint) -> bytes:
    """Return a checkpoint as bytes (see the module). Raises TypeError for a value that cannot be stored."""
    arrays: list[bytes] = []
    text = json.dumps(_put(checkpoint, arrays)).encode()
    return b"".join([len(text).to_bytes(8, "little"), text, *arrays])


def decoded(data: bytes) -> Checkpoint:
    """Return the checkpoint that `encoded` was given, bit by bit, with writable arrays. Raises ValueError if the bytes
    are not from `encoded`."""
    end = 8 + int.from_bytes(data[:8], "little")
    if end > len(data):
        raise ValueError(f"its text needs {end - 8} bytes, but only {len(data)} are stored")
    try:
        text = json.loads(data[8:end].decode())
        if not isinstance(text, dict) or too_deep(text):
            raise ValueError("its text is not a table of values")
        return _take(text, memoryview(data)[end:])
    except (RecursionError, TypeError, OverflowError, MemoryError) as error:
        raise ValueError(str(error)) from None


def _put(value: Any, arrays: list[bytes]) -> Any:
    if isinstance(value, np.ndarray):
        start = sum(map(len, arrays))
        little = np.ascontiguousarray(value).astype(value.dtype.newbyteorder("<"), copy=False)
        arrays.append(little.tobytes())
        return {"array": [little.dtype.str, list(value.shape), start]}
    if isinstance(value, dict):
        if not all(isinstance(key, str) for key in value) or "array" in value:
            raise TypeError(f"a checkpoint's keys must be texts other than 'array', got {list(value)}")
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
    dtype = np.dtype(kind)
    if dtype.hasobject or not isinstance(start, int) or not all(isinstance(n, int) and n >= 0 for n in shape):
        raise ValueError(f"an array of {dtype}, shape {shape}, from byte {start} on")
    size = math.prod(shape) * dtype.itemsize
    if not 0 <= start <= start + size <= len(arrays):
        raise ValueError(f"an array of {size} bytes from byte {start} on, of {len(arrays)}")
    flat: NDArray = np.frombuffer(arrays[start : start + size], dtype)
    return flat.reshape(shape).astype(flat.dtype.newbyteorder("="))


class Table:
    """The checkpoints of an open file.

    Attributes
    ----------
    file : h5py.File
    rows : int
        Number of whole checkpoints, by the table alone. A row with an impossible end is not whole, nor are later rows.
    """

    def __init__(self, file: h5py.File, path: Any) -> None:
        self.file = file
        self._contents = contents = Contents(file, path)
        self._group = contents.group(CHECKPOINTS)
        rows = int(contents.array(f"{CHECKPOINTS}/committed", "i8", (1,))[0])
        if rows < 0:
            raise contents.damaged(f"{CHECKPOINTS}/committed: expected a count, got {rows}")
        self._data = {
            name: contents.series(f"{CHECKPOINTS}/{name}", kind, 0 if name == "data" else rows)
            for name, kind in COLUMNS.items()
        }
        ends = contents.read(self._data["end"], slice(rows))
        wrong = (np.diff(ends, prepend=0) < 0) | (ends > self._data["data"].shape[0])
        self.rows = int(np.argmax(wrong)) if wrong.any() else rows

    @property
    def steps(self) -> NDArray[np.int64]:
        """Step of each checkpoint, shape (rows,)."""
        return self._contents.read(self._data["step"], slice(self.rows))

    @property
    def times(self) -> NDArray[np.float64]:
        """Time of each checkpoint in the system's unit, shape (rows,)."""
        return self._contents.read(self._data["time"], slice(self.rows))

    def __getitem__(self, row: int) -> Checkpoint:
        """Return one checkpoint. Raises InputError if its bytes are not what was written."""
        step = self.steps[row]
        ends = self._contents.read(self._data["end"], slice(self.rows))
        begin, end = (int(ends[row - 1]) if row else 0), int(ends[row])
        data = self._contents.read(self._data["data"], slice(begin, end)).tobytes()
        if zlib.crc32(data) != int(self._contents.read(self._data["crc32"], row)):
            raise self._contents.damaged(f"the checkpoint of step {step} has changed")
        try:
            found = decoded(data)
        except ValueError as error:
            raise self._contents.damaged(f"the checkpoint of step {step} cannot be read: {error}") from None
        if (found.get("step"), found.get("time")) != (step, self.times[row]):
            raise self._contents.damaged(f"the checkpoint of step {step} is of another step or time")
        return found

    def damaged(self) -> list[int]:
        """Steps of the checkpoints that cannot be read."""
        found = []
        for row, step in enumerate(self.steps.tolist()):
            try:
                self[row]
            except InputError:
                found.append(step)
        return found

    def add(self, stored: Stored, commit: Callable[[], None]) -> None:
        """Add a checkpoint. ``commit`` flushes earlier writes to disk. A second call after an interrupt does no
        harm."""
        row = self.rows
        begin = int(self._data["end"][row - 1]) if row else 0
        for name, values in _columns(stored, begin).items():
            data, start = self._data[name], begin if name == "data" else row
            data.resize(start + len(values), axis=0)
            data[start:] = values
        commit()
        self._group["committed"][0] = row + 1
        commit()
        self.rows += 1

    def cut(self) -> bool:
        """Drop incomplete rows at the end and tell whether there were any. See `Rows.cut`."""
        group, found = self._group, False
        if group["committed"][0] > self.rows:
            group["committed"][0] = self.rows
        size = int(group["end"][self.rows - 1]) if self.rows else 0
        for name in ("data", "end", "step", "time", "crc32"):
            wanted = size if name == "data" else self.rows
            if group[name].shape[0] > wanted:
                group[name].resize(wanted, axis=0)
                found = True
        return found


def _columns(stored: Stored, begin: int) -> dict[str, NDArray]:
    """Values of each column for a checkpoint whose bytes start at ``begin``."""
    row = {
        "end": begin + len(stored.data), "step": stored.step, "time": stored.time, "crc32": zlib.crc32(stored.data)
    }  # fmt: skip
    return {"data": np.frombuffer(stored.data, "u1")} | {k: np.array([row[k]], COLUMNS[k]) for k in row}


def new_table(file: h5py.File, first: Stored | None = None) -> None:
    """Create the group in a new file, with a ``first`` checkpoint if given."""
    group = file.create_group(CHECKPOINTS)
    columns = _columns(first, 0) if first else {}
    for name, kind in COLUMNS.items():
        chunk = BYTES_CHUNK if name == "data" else ROWS_CHUNK
        data = columns.get(name, np.zeros(0, kind))
        group.create_dataset(name, data=data, maxshape=(None,), chunks=(chunk,), track_times=False)
    group.create_dataset("committed", data=np.full(1, int(first is not None), "i8"), track_times=False)

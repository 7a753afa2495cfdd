"""Checksums of the rows of a run's file, which show whether a row is as it was written.

The checksum of a row of bytes takes them as little-endian 64-bit words w_0, w_1, … (filled up with zeros) and is
1 + sum of k_i w_i modulo 2^64, where z = (i + 1) 0x9E3779B97F4A7C15 modulo 2^64 and k_i = (z xor (z >> 32)) or 1.
The weights k_i are odd, so the checksum always changes when one word changes. When two words change places, the
checksum stays the same with a chance of about 2^-60. NumPy sums ten times as fast as zlib computes CRC-32.
"""

from collections.abc import Sequence
from functools import lru_cache

import h5py
import numpy as np
from numpy.typing import NDArray

CHECKSUMS = "kickdrift/checksums"
VECTORS = ("position", "velocity", "force", "image")  # in the order of their checksums in a row
CLOCK, OBSERVABLES, FIRST_VECTOR = 0, 1, 2  # columns in the row of a frame
ROW_BYTES = 8192  # row length in a checksum of a whole array
_CHUNK_BYTES = 16 * 1024
_GOLDEN = 0x9E3779B97F4A7C15

Sums = NDArray[np.uint64]


@lru_cache(maxsize=32)
def _weights(count: int) -> Sums:
    z = np.arange(1, count + 1, dtype="u8") * np.uint64(_GOLDEN)
    return (z ^ (z >> np.uint64(32))) | np.uint64(1)


def sums(rows: NDArray) -> Sums:
    """Checksums of an array's rows along its last axis, in the array's shape without that axis."""
    little = rows.astype(rows.dtype.newbyteorder("<"), copy=False)
    size = little.shape[-1] * little.itemsize
    if little.strides[-1] != little.itemsize:
        little = np.ascontiguousarray(little)
    if size % 8:
        filled = np.zeros((*little.shape[:-1], -(-size // 8) * 8), "u1")
        filled[..., :size] = little.view("u1")
        little = filled
    words = little.view("<u8").astype("u8", copy=False)
    return np.einsum("...i,i->...", words, _weights(words.shape[-1])) + np.uint64(1)


def sums_of_columns(columns: Sequence[NDArray]) -> Sums:
    """Checksums (rows,) of rows whose parts lie in several arrays, one after the other."""
    return sums(np.concatenate([_raw(each) for each in columns], axis=1))


def _raw(column: NDArray) -> NDArray[np.uint8]:
    """Bytes of each row, little-endian, shape (rows, bytes)."""
    size = column.itemsize * int(np.prod(column.shape[1:], dtype=int))
    little = np.ascontiguousarray(column, column.dtype.newbyteorder("<"))
    return little.reshape(-1).view("u1").reshape(len(column), size)


def sums_of_vectors(vectors: NDArray, block: int) -> Sums:
    """Checksums (frames, blocks) of vectors (frames, n, 3) in blocks of ``block`` particles. The last block may be
    shorter."""
    frames, n, _ = vectors.shape
    flat = np.ascontiguousarray(vectors).reshape(frames, 3 * n)
    blocks = [flat[:, at : at + 3 * block] for at in range(0, 3 * n, 3 * block)]  # views: copies would take longest
    return np.stack([sums(each) for each in blocks], axis=1)


def sums_of_array(array: NDArray) -> Sums:
    """Checksums (rows,) of an array's bytes in C order, cut into rows of ROW_BYTES. Zeros fill up the last row."""
    raw = np.ascontiguousarray(array, array.dtype.newbyteorder("<")).reshape(-1).view("u1")
    whole = len(raw) // ROW_BYTES * ROW_BYTES
    found = sums(raw[:whole].reshape(-1, ROW_BYTES))
    if whole == len(raw):
        return found
    last = np.zeros((1, ROW_BYTES), "u1")
    last[0, : len(raw) - whole] = raw[whole:]
    return np.concatenate([found, sums(last)])


def new_group(file: h5py.File, n: int, block: int, vectors: Sequence[str]) -> None:
    """Create the group in a new file, for frames of n particles with these ``vectors``."""
    group = file.create_group(CHECKSUMS)
    group.attrs["particles"] = block
    columns = FIRST_VECTOR + len(vectors) * -(-n // block)
    for name, shape in (("frame", (columns,)), ("sample", ()), ("event", ())):
        rows = max(1, min(512, _CHUNK_BYTES // (8 * columns))) if shape else 512
        group.create_dataset(name, (0, *shape), "u8", maxshape=(None, *shape), chunks=(rows, *shape), track_times=False)


def name_observables(file: h5py.File, names: Sequence[str]) -> None:
    """Store which observables the checksums of frames and samples cover, and in which order."""
    file[CHECKSUMS].attrs["observables"] = np.array(list(names), dtype=h5py.string_dtype())

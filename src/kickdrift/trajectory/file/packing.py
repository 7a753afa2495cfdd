"""A whole run's file written anew, compressed on all cores or not compressed.

Chunks that change size cannot be replaced safely in place."""

import contextlib
import os
import zlib
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from functools import partial
from itertools import product
from pathlib import Path
from typing import Any

import h5py
import numpy as np
from numpy.typing import NDArray

from kickdrift.disk.outputs import private_place
from kickdrift.display.pace import PARTS
from kickdrift.display.showing import stage
from kickdrift.model.checks.limits import cores
from kickdrift.trajectory.file.opening import created
from kickdrift.trajectory.file.storage import ALIGNMENT, PagedFile

_LEVEL = 4
_FILTERS = {"compression": "gzip", "compression_opts": _LEVEL, "shuffle": True}
_COMMIT_BYTES = 8 * 2**20
Move = Callable[[h5py.Dataset, int, NDArray[Any]], None]  # writes rows to a dataset, from a row on
_POSITIONS = "particles/trajectory/position/value"


def is_packed(file: h5py.File) -> bool:
    """Tell whether the file's frames are compressed."""
    return _POSITIONS in file and file[_POSITIONS].compression is not None


@contextmanager
def rewritten(file: h5py.File, path: Path, *, compress: bool) -> Iterator[Path]:
    """Yield a copy of an open file beside ``path``, with all growing datasets compressed or all plain. The caller
    renames the copy, else it is removed. An OSError leaves no copy."""
    with private_place(path) as part:
        part.write_bytes(b"")
        storage = PagedFile(part)
        try:
            with created(storage, libver="earliest", **ALIGNMENT) as copy:
                # These must begin in the first page: see `layout`.
                names = ("kickdrift/committed", *(f"particles/trajectory/position/{key}" for key in ("step", "value")))
                items = [file[name] for name in names]
                filters = _FILTERS if compress else {}
                first = {_address(item): _like(item, None, copy, filters) for item in items}
                with ThreadPoolExecutor(cores(), "compressing") as threads:
                    move = _move_compressed(threads) if compress else _move
                    _copy(file, copy, {}, first, filters, move, _committing(file, storage, compress))
            storage.commit()
        finally:
            storage.close()
        os.chmod(part, path.stat().st_mode)
        yield part


def _committing(file: h5py.File, storage: PagedFile, compress: bool) -> Callable[[int], None]:
    """Function that commits what was copied, and shows how much of the file that is."""
    move, done = stage("compressing" if compress else "unpacking"), 0
    sizes: list[int] = []
    file.visititems(lambda name, item: sizes.append(item.nbytes) if isinstance(item, h5py.Dataset) else None)
    total = max(1, sum(sizes))

    def commit(bytes_copied: int) -> None:
        nonlocal done
        storage.commit()
        done += bytes_copied
        move(min(PARTS, PARTS * done // total), PARTS)

    return commit


def _address(item: Any) -> int:
    return int(h5py.h5o.get_info(item.id).addr)


def _like(item: h5py.Dataset, name: str | None, group: h5py.Group, filters: dict[str, Any]) -> h5py.Dataset:
    """Create a copy of a dataset, without rows if the dataset can grow."""
    if item.chunks is None:
        return group.create_dataset(name, data=item[()], dtype=item.dtype, track_times=False)
    return group.create_dataset(
        name, (0, *item.shape[1:]), item.dtype, maxshape=item.maxshape, chunks=item.chunks, fillvalue=item.fillvalue,
        track_times=False, **filters,
    )  # fmt: skip


def _copy(
    source: h5py.Group,
    target: h5py.Group,
    made: dict[int, str],
    first: dict[int, h5py.Dataset],
    filters: dict[str, Any],
    move: Move,
    commit: Callable[[int], None],
) -> None:
    """Copy everything inside a group. An object with several names keeps them. Datasets in ``first`` exist already,
    without names."""
    for name, item in source.items():
        address = _address(item)
        if address in made:
            target[name] = target.file[made[address]]
            continue
        if isinstance(item, h5py.Group):
            _copy(item, target.create_group(name), made, first, filters, move, commit)
        else:
            if address in first:
                target[name] = first[address]
            else:
                _like(item, name, target, filters)
            if item.chunks:
                _copy_rows(item, target[name], move, commit)
        for key in item.attrs:
            target[name].attrs.create(key, item.attrs[key], dtype=item.attrs.get_id(key).dtype)
        made[address] = f"{target.name}/{name}"


def _copy_rows(item: h5py.Dataset, new: h5py.Dataset, move: Move, commit: Callable[[int], None]) -> None:
    """Copy rows in whole chunks, a few megabytes at a time. ``commit`` gets the bytes of each part."""
    row = max(1, item.dtype.itemsize * int(item.size // max(1, item.shape[0])))
    block = item.chunks[0] * max(1, _COMMIT_BYTES // (row * item.chunks[0]))
    new.resize(item.shape[0], axis=0)
    rows = min(item.shape[0], _stored_rows(item))
    for start in range(0, rows, block):
        try:
            move(new, start, item[start : start + block])
        except OSError:  # a damaged chunk
            _copy_readable(item, new, start, min(start + block, rows))
        new.file.flush()
        commit(row * (min(start + block, rows) - start))


def _move(new: h5py.Dataset, start: int, rows: NDArray[Any]) -> None:
    """Write rows through HDF5."""
    new[start : start + len(rows)] = rows


def _move_compressed(threads: ThreadPoolExecutor) -> Move:
    """Return a function that compresses chunks on threads, as HDF5's own filters would on one."""

    def move(new: h5py.Dataset, start: int, rows: NDArray[Any]) -> None:
        if rows.dtype.hasobject:  # text of any length
            _move(new, start, rows)
            return
        places = list(product(*(range(0, end, step) for end, step in zip(rows.shape, new.chunks, strict=True))))
        parts = [rows[tuple(map(slice, at, np.add(at, new.chunks)))] for at in places]
        for at, packed in zip(places, threads.map(partial(_compressed, new.chunks, new.fillvalue), parts), strict=True):
            new.id.write_direct_chunk((start + at[0], *at[1:]), packed)

    return move


def _compressed(shape: tuple[int, ...], fill: Any, part: NDArray[Any]) -> bytes:
    """Return a chunk of this shape after the filters shuffle and gzip. Fill values complete a chunk at an edge."""
    if part.shape != shape:
        whole = np.full(shape, fill, part.dtype)
        whole[tuple(map(slice, part.shape))] = part
        part = whole
    lanes = np.ascontiguousarray(part).reshape(-1).view(np.uint8).reshape(-1, part.dtype.itemsize)
    return zlib.compress(lanes.T.tobytes(), _LEVEL)


def _stored_rows(item: h5py.Dataset) -> int:
    """Number of rows up to the end of the last chunk. A file may claim more rows than it stores."""
    ends = [0]
    item.id.chunk_iter(lambda chunk: ends.append(chunk.chunk_offset[0] + item.chunks[0]))
    return int(max(ends))


def _copy_readable(item: h5py.Dataset, new: h5py.Dataset, start: int, stop: int) -> None:
    """Copy the rows that HDF5 can read. Other rows keep the fill value, so their checksums show the damage."""
    for row in range(start, stop):
        with contextlib.suppress(OSError):
            new[row] = item[row]

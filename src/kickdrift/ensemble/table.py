"""Table of an ensemble on disk: a journal while members run, then one Parquet or HDF5 file with all provenance. After a
kill, at most the last line of the journal is damaged."""

from __future__ import annotations

import hashlib
import json
import os
import tempfile
from collections.abc import Iterable
from pathlib import Path
from typing import Any

import numpy as np

from kickdrift.disk import kinds
from kickdrift.disk.files import descriptor, opened, refuse_unfit
from kickdrift.disk.outputs import checked_target, reason, written_whole
from kickdrift.disk.posix import flags, lock
from kickdrift.ensemble.rows import DONE, FAILED, LAST, LOST, MEMBER, STOPPED_BY, DataFrame, Row
from kickdrift.errors import InputError, RunError
from kickdrift.text import CELL, clean

SUFFIXES = kinds.TABLE.suffixes
CHECKSUM = "checksum"  # its name in a file
SEAL, SEAL_BYTES = b"kickdrift seal: ", 32  # before a checksum of all bytes of an HDF5 file
PROVENANCE = "kickdrift"  # its name in a file, and in a table's ``attrs``
# Columns of texts, empty if missing.
TEXTS = ("status", "error", "integrator", "energy_verdict", "verdict", "stopped", STOPPED_BY, "warnings")
SCALARS = (bool, int, float, str, list, type(None))  # types of a cell
STATUSES = (DONE, FAILED, LOST)
WHOLE = 2**63  # larger numbers are floats


def frame(rows: Iterable[Row], provenance: dict[str, Any]) -> DataFrame:
    """Rows as a table, by member. Missing numbers are NaN."""
    from kickdrift.ensemble.shown import Table

    ordered = sorted(rows, key=lambda row: row[MEMBER])
    names = dict.fromkeys(name for row in ordered for name in row)
    names = dict.fromkeys([*(name for name in names if name not in LAST), *(name for name in LAST if name in names)])
    table = Table({name: _column(name, [row.get(name) for row in ordered]) for name in names})
    table.attrs[PROVENANCE] = provenance
    return table


def _column(name: str, values: list[Any]) -> Any:
    """Values of one type, as a column of a Parquet file must be: numbers, booleans, lists of numbers, or texts."""
    values = [value.item() if isinstance(value, np.generic) else value for value in values]
    known = [value for value in values if value is not None]
    kinds = {type(value) for value in known}
    if name in TEXTS and kinds <= {str}:
        return [value or "" for value in values]
    if kinds == {bool} and len(known) == len(values):
        return np.array(values)
    if kinds <= {bool, int, float}:
        if kinds == {int} and len(known) == len(values) and all(-WHOLE <= value < WHOLE for value in values):
            return np.array(values, dtype=np.int64)
        return np.array([np.nan if value is None else float(value) for value in values])
    if kinds == {list}:
        flat = all(type(number) in (int, float) for value in known for number in value)
        return values if flat else [value and json.dumps(value) for value in values]
    return [value if value is None else str(value) for value in values]


def records(table: DataFrame) -> list[Row]:
    """Rows of a table, as before it became a table."""
    rows = table.to_dict("records")
    texts = [name for name in table.columns if table[name].dtype.kind not in "if"]
    for row in rows:
        for name in texts:
            value = row[name]
            if isinstance(value, np.ndarray):
                row[name] = value.tolist()
            elif isinstance(value, float):  # NaN stands for a missing value
                row[name] = None
    return rows


def _is_row(row: Any) -> bool:
    """Tell whether this is a member's row, as far as the ensemble reads it."""
    if not (isinstance(row, dict) and all(isinstance(value, SCALARS) for value in row.values())):
        return False
    return type(row.get(MEMBER)) is int and row[MEMBER] >= 0 and row.get("status") in STATUSES


def journal_of(output: Path) -> Path:
    """Path of a table's journal."""
    return output.with_name(f"{output.name}.journal")


class Journal:
    """Rows of finished members, a line each, in a file beside the output. As a context, it locks both files against
    other processes."""

    def __init__(self, output: Path, provenance: dict[str, Any]) -> None:
        self.output, self.provenance = output, provenance
        self.path = journal_of(output)
        self._file: Any = None
        self._lock: Any = None

    def __enter__(self) -> Journal:
        self._lock = Lock(self.path.with_suffix(".lock"), self.output)
        return self

    def __exit__(self, *_: object) -> None:
        try:
            if self._file:
                self._file.close()
        finally:
            self._lock.release()

    def known(self) -> dict[int, Row]:
        """Finished members by number, from the journal or the output, without members whose workers died. Raises
        InputError if they belong to another ensemble."""
        began, found = self._read()
        if began is None and self.output.exists():
            table = read(self.output)
            began, found = table.attrs[PROVENANCE], records(table)
            if not all(map(_is_row, found)):
                raise InputError(f"{self.output}: is no table of an ensemble, or was damaged")
        if began is None:
            return {}
        then = began.get("identity")
        for key, here in self.provenance["identity"].items():
            if not isinstance(then, dict) or then.get(key) != here:
                raise InputError(f"{self.output}: holds an ensemble with another {key}; use --overwrite to replace it")
        known = {row[MEMBER]: row for row in found if row["status"] != LOST}
        count = self.provenance["members"]
        if known and max(known) >= count:
            raise InputError(
                f"{self.output}: holds {len(known)} members of this ensemble, more than the requested {count}"
            )
        grown = {key: self.provenance[key] for key in ("members", "replicas")}
        self.provenance = {**began, **grown}  # the rest belongs to the first rows
        return known

    def _read(self) -> tuple[dict[str, Any] | None, list[Row]]:
        """Provenance of the ensemble in the journal, and its rows. A line cut short by a kill is left out."""
        if not os.path.lexists(self.path):
            return None, []
        with opened(self.path) as file:
            lines = file.read().split(b"\n")[:-1]
        try:
            first, *rows = [json.loads(line) for line in lines]
        except (ValueError, RecursionError):
            first, rows = None, []
        if not isinstance(first, dict) or not all(map(_is_row, rows)):
            raise InputError(f"{self.path}: is no journal of an ensemble, or was damaged; remove it")
        return first, rows

    def begin(self, rows: Iterable[Row]) -> None:
        """Open the journal with these rows."""
        with written_whole(self.path, kinds.JOURNAL, overwrite=True) as part:
            part.write_text("".join(json.dumps(each) + "\n" for each in (self.provenance, *rows)), encoding="utf-8")
        flags = os.O_WRONLY | os.O_APPEND | getattr(os, "O_NOFOLLOW", 0)
        self._file = open(self.path, "ab", buffering=0, opener=lambda name, _: descriptor(name, flags))  # noqa: SIM115

    def append(self, rows: Iterable[Row]) -> None:
        """Append rows. After the return, a kill of the process does not lose them."""
        try:
            lines = memoryview("".join(json.dumps(row) + "\n" for row in rows).encode())
            while lines:
                lines = lines[self._file.write(lines) :]
        except OSError as error:
            raise RunError(f"{self.path}: cannot be written: {reason(error)}") from None

    def finish(self, table: DataFrame) -> None:
        write(table, self.output)
        self.path.unlink(missing_ok=True)


def write(table: DataFrame, output: Path) -> None:
    """Write the table to a file, whole or not at all, replacing an existing file."""
    with written_whole(output, kinds.TABLE, overwrite=True) as part:
        if output.suffix.lower() == ".parquet":
            _write_parquet(table, part)
        else:
            _write_hdf5(table, part)


def read(path: str | os.PathLike[str]) -> DataFrame:
    """Read the table of an ensemble's file; its provenance is ``table.attrs["kickdrift"]``."""
    path = Path(path)
    if path.suffix.lower() not in SUFFIXES:
        raise InputError(f"{path}: the name of an ensemble's table must end in {' or '.join(SUFFIXES)}")
    refuse_unfit(path)
    try:
        table = _read_parquet(path) if path.suffix.lower() == ".parquet" else _read_hdf5(path)
        if table.attrs.pop(CHECKSUM, None) not in (None, checksum(table)):
            raise InputError(f"{path}: was damaged: the table is not the one that was written")
    except InputError:
        raise
    except Exception as error:  # a damaged file can end in any error of the libraries that read it
        raise InputError(f"{path}: cannot be read: {clean(str(error), CELL)}") from None
    if not isinstance(table.attrs.get(PROVENANCE), dict) or not {MEMBER, "status"} <= set(table.columns):
        raise InputError(f"{path}: is no table of an ensemble")
    from kickdrift.ensemble.shown import Table

    shown = Table(table)
    shown.attrs.update(table.attrs)
    return shown


def checked_output(output: str | os.PathLike[str]) -> Path:
    """Checked path of a table to write or to continue."""
    path = checked_target(output, kinds.TABLE, overwrite=True)
    checked_target(journal_of(path), kinds.JOURNAL._replace(ours=lambda head, tail: True), overwrite=True)
    try:
        with tempfile.TemporaryFile(dir=path.parent):
            return path
    except OSError as error:
        raise InputError(f"{path}: cannot be written: {reason(error)}") from None


def checksum(table: DataFrame) -> str:
    """Checksum of a table's columns, values and provenance, whatever file it is in. Tables of version 0.2 have none."""
    text = json.dumps([{name: [_bare(value) for value in table[name].tolist()] for name in table.columns},
                       table.attrs.get(PROVENANCE)])  # fmt: skip
    return hashlib.sha256(text.encode()).hexdigest()


def _bare(value: Any) -> Any:
    """A cell's value without what differs between files: numbers in lists are floats, and nothing is None."""
    if isinstance(value, list | tuple | np.ndarray):
        return [float(number) for number in value] or None
    return None if isinstance(value, float) and np.isnan(value) else value


def _read_parquet(path: Path) -> DataFrame:
    import pandas as pd

    with opened(path) as file:
        return pd.read_parquet(file)


def _write_parquet(table: DataFrame, path: Path) -> None:
    import pandas as pd

    table.to_parquet(path, index=False)
    stored = pd.read_parquet(path)
    stored.attrs[CHECKSUM] = checksum(stored)
    stored.to_parquet(path, index=False)


def _write_hdf5(table: DataFrame, path: Path) -> None:
    import h5py

    from kickdrift.trajectory.file.opening import created

    with created(path) as file:
        file.attrs[PROVENANCE] = json.dumps(table.attrs[PROVENANCE])
        file.attrs["columns"] = list(table.columns)
        for name in table.columns:
            values = table[name].tolist()
            if table[name].dtype.kind in "ifb":
                stored, kind = table[name].to_numpy(), None
            elif any(isinstance(value, list | np.ndarray) for value in values):
                stored, kind = np.empty(len(values), dtype=object), h5py.vlen_dtype(np.float64)
                stored[:] = [np.array([] if value is None else value, dtype=float) for value in values]
            else:
                stored, kind = [json.dumps(value) for value in values], h5py.string_dtype()
            file.create_dataset(_dataset(name), data=stored, dtype=kind, track_times=False)
        file.attrs[CHECKSUM] = checksum(_of_hdf5(file))
    with path.open("r+b") as raw:  # behind HDF5's end, and checked before HDF5 reads a byte
        whole = raw.read()
        raw.write(SEAL + hashlib.sha256(whole).digest())


def _dataset(name: str) -> str:
    """Path of a column inside a file."""
    return f"table/{name.replace('/', '|')}"


def _read_hdf5(path: Path) -> DataFrame:
    from kickdrift.trajectory.file.opening import open_to_read

    with opened(path) as raw:
        whole, mark, seal = raw.read().rpartition(SEAL)
    if mark and len(seal) == SEAL_BYTES and hashlib.sha256(whole).digest() != seal:
        raise InputError(f"{path}: was damaged: its bytes are not those that were written")
    with open_to_read(path) as file:
        return _of_hdf5(file)


def _of_hdf5(file: Any) -> DataFrame:
    """The table in an open file, with its checksum."""
    import h5py
    import pandas as pd

    columns: dict[str, Any] = {}
    for name in file.attrs["columns"]:
        dataset = file[_dataset(name)]
        if dataset.size * max(1, dataset.dtype.itemsize) > file.id.get_filesize():
            raise ValueError(f"column {name!r} claims {dataset.size:,} values, more than the file can hold")
        if h5py.check_string_dtype(dataset.dtype):
            columns[name] = [json.loads(text) for text in dataset.asstr()[()]]
        elif h5py.check_vlen_dtype(dataset.dtype):
            columns[name] = [value if len(value) else None for value in dataset[()]]
        else:
            columns[name] = dataset[()]
    table = pd.DataFrame(columns)
    table.attrs[PROVENANCE] = json.loads(file.attrs[PROVENANCE])
    if CHECKSUM in file.attrs:
        table.attrs[CHECKSUM] = str(file.attrs[CHECKSUM])
    return table


TRIES = 10  # attempts, if another process removes the lock meanwhile


class Lock:
    """Empty file, locked by this process until `release`, which removes the file. Raises InputError if another process
    has the lock, or if a file of that name is not a lock. Such a file is never changed."""

    def __init__(self, path: Path, output: Path) -> None:
        self.path = path
        for _ in range(TRIES):
            try:
                self._number = self._opened()
            except OSError as error:
                raise InputError(f"{path}: cannot be written: {reason(error)}") from None
            try:
                lock(self._number)
            except OSError:
                os.close(self._number)
                raise InputError(f"{output}: another process is at work on it") from None
            if os.fstat(self._number).st_size:
                os.close(self._number)
                raise InputError(f"{path}: is not a lock file, and {output} needs this name for its lock")
            if self._named():
                return
            os.close(self._number)
        raise InputError(f"{output}: another process is at work on it")

    def _opened(self) -> int:
        try:
            return os.open(self.path, os.O_RDWR | os.O_CREAT | os.O_EXCL | flags("O_CLOEXEC"), 0o666)
        except FileExistsError:
            if os.path.islink(self.path):
                raise InputError(f"{self.path}: is a symbolic link, not a lock file") from None
            return descriptor(self.path, os.O_RDWR | flags("O_NOFOLLOW"))

    def _named(self) -> bool:
        """Tell whether the name still belongs to the locked file."""
        try:
            return os.path.samestat(os.lstat(self.path), os.fstat(self._number))
        except OSError:
            return False

    def release(self) -> None:
        """Remove the file and release the lock."""
        if self._named():
            self.path.unlink(missing_ok=True)
        os.close(self._number)

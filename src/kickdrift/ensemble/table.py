"""An ensemble's table on disk: a journal while members run, which a kill leaves whole but for its last line, and at the
end one Parquet or HDF5 file with all provenance."""

from __future__ import annotations

import json
import os
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from kickdrift.errors import InputError
from kickdrift.outputs import checked_target, written_whole

if TYPE_CHECKING:
    from pandas import DataFrame

    from kickdrift.ensemble.rows import Row

SUFFIXES = (".parquet", ".h5")
PROVENANCE = "kickdrift"  # the name under which it stands in a file, and in a table's ``attrs``
MEMBER, TEXTS = "member", ("status", "error", "integrator", "energy_verdict", "verdict", "stopped", "warnings")
LAST = ("wall_seconds", "last_step", "last_time", "last_y", "last_positions", "last_velocities")  # columns


def frame(rows: Iterable[Row], provenance: dict[str, Any]) -> DataFrame:
    """The rows as a table, by member; numbers that a member has not are NaN."""
    import pandas as pd

    ordered = sorted(rows, key=lambda row: row[MEMBER])
    names = dict.fromkeys(name for row in ordered for name in row)
    names = dict.fromkeys([*(name for name in names if name not in LAST), *(name for name in LAST if name in names)])
    table = pd.DataFrame({name: _column(name, [row.get(name) for row in ordered]) for name in names})
    table.attrs[PROVENANCE] = provenance
    return table


def _column(name: str, values: list[Any]) -> Any:
    if name in TEXTS:
        return [value or "" for value in values]
    if all(value is None or (isinstance(value, int | float) and not isinstance(value, bool)) for value in values):
        if all(isinstance(value, int) for value in values):
            return np.array(values, dtype=np.int64)
        return np.array([np.nan if value is None else value for value in values], dtype=float)
    if any(isinstance(value, str) for value in values):  # a column of a Parquet file is of one kind
        return [value if value is None else str(value) for value in values]
    return values


class Journal:
    """The rows of the members that are done, a line each, beside the file that they will be in."""

    def __init__(self, output: Path, provenance: dict[str, Any]) -> None:
        self.path = output.with_name(f"{output.name}.journal")
        self._provenance = provenance
        self._file: Any = None

    def read(self) -> tuple[dict[str, Any] | None, list[Row]]:
        """The provenance of the ensemble that was begun here, and its rows; what a kill cut short is left out."""
        try:
            lines = self.path.read_bytes().split(b"\n")[:-1]
        except FileNotFoundError:
            return None, []
        try:
            first, *rows = [json.loads(line) for line in lines]
        except ValueError:
            raise InputError(f"{self.path}: is no journal of an ensemble, or was damaged") from None
        return first, rows

    def begin(self, rows: Sequence[Row]) -> None:
        """Open it, with these rows in it."""
        with written_whole(self.path) as part:
            part.write_text("".join(self._line(each) for each in (self._provenance, *rows)), encoding="utf-8")
        self._file = self.path.open("a", encoding="utf-8")

    def append(self, rows: Sequence[Row]) -> None:
        """Add rows; once this returns a kill of the process does not lose them."""
        self._file.write("".join(map(self._line, rows)))
        self._file.flush()

    @staticmethod
    def _line(content: Any) -> str:
        return json.dumps(content) + "\n"

    def close(self, done: bool) -> None:
        """Close it; it goes where the table stands in its file."""
        if self._file:
            self._file.close()
        if done:
            self.path.unlink(missing_ok=True)


def write(table: DataFrame, output: Path) -> None:
    """Write the table in a file, whole or not at all; what is there is replaced."""
    with written_whole(output) as part:
        if output.suffix == ".parquet":
            table.to_parquet(part, index=False)
        else:
            _write_hdf5(table, part)


def read(path: str | os.PathLike[str]) -> DataFrame:
    """The table in a file that an ensemble wrote; its provenance is ``table.attrs["kickdrift"]``."""
    path = Path(path)
    if path.suffix not in SUFFIXES:
        raise InputError(f"{path}: the table of an ensemble ends in {' or '.join(SUFFIXES)}")
    if not path.is_file():
        raise InputError(f"{path}: no such file")
    try:
        table = _read_parquet(path) if path.suffix == ".parquet" else _read_hdf5(path)
    except (OSError, ValueError, KeyError) as error:
        raise InputError(f"{path}: cannot be read: {' '.join(str(error).split())}") from None
    if PROVENANCE not in table.attrs:
        raise InputError(f"{path}: is no table of an ensemble")
    return table


def checked_output(output: str | os.PathLike[str]) -> Path:
    """The path of a table to be written or gone on with."""
    return checked_target(output, "the table of an ensemble", SUFFIXES, overwrite=True)


def _read_parquet(path: Path) -> DataFrame:
    import pandas as pd

    return pd.read_parquet(path)


def _write_hdf5(table: DataFrame, path: Path) -> None:
    import h5py

    with h5py.File(path, "w") as file:
        file.attrs[PROVENANCE] = json.dumps(table.attrs[PROVENANCE])
        file.attrs["columns"] = list(table.columns)
        for name in table.columns:
            values = table[name].tolist()
            if table[name].dtype.kind in "if":
                stored, kind = table[name].to_numpy(), None
            elif any(isinstance(value, list | np.ndarray) for value in values):
                stored, kind = np.empty(len(values), dtype=object), h5py.vlen_dtype(np.float64)
                stored[:] = [np.array([] if value is None else value, dtype=float) for value in values]
            else:
                stored, kind = [json.dumps(value) for value in values], h5py.string_dtype()
            file.create_dataset(_dataset(name), data=stored, dtype=kind, track_times=False)


def _dataset(name: str) -> str:
    """Where a column is in a file."""
    return f"table/{name.replace('/', '|')}"


def _read_hdf5(path: Path) -> DataFrame:
    import h5py
    import pandas as pd

    with h5py.File(path, "r") as file:
        columns: dict[str, Any] = {}
        for name in file.attrs["columns"]:
            dataset = file[_dataset(name)]
            if h5py.check_string_dtype(dataset.dtype):
                columns[name] = [json.loads(text) for text in dataset.asstr()[()]]
            elif h5py.check_vlen_dtype(dataset.dtype):
                columns[name] = [value if len(value) else None for value in dataset[()]]
            else:
                columns[name] = dataset[()]
        table = pd.DataFrame(columns)
        table.attrs[PROVENANCE] = json.loads(file.attrs[PROVENANCE])
    return table

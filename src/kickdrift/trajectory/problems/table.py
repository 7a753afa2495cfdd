"""A Problem's run as a table: a CSV or Parquet file with time, y0, y1, …, energy, written whole at the run's end."""

import csv
import os
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Self

import numpy as np

from kickdrift.disk import kinds
from kickdrift.disk.files import opened, shown_path
from kickdrift.disk.outputs import written_whole
from kickdrift.errors import InputError
from kickdrift.looks.columns import parts
from kickdrift.model.state import Floats
from kickdrift.trajectory.layout.problem_header import ENERGY
from kickdrift.trajectory.read.tables import ShownProblemRun, library

SUFFIXES = kinds.SERIES.suffixes
TIME = "time"
NEEDS = "pandas and pyarrow: pip install 'kickdrift[ensemble]'"


@dataclass(frozen=True)
class ProblemTable(ShownProblemRun):
    """The table of a Problem's run, read from a CSV or Parquet file. A run cannot be resumed from a table.

    Attributes
    ----------
    path : Path
    times : (s,)
    y : (s, n)
    energies : (s,), or None where the Problem has none
    columns : the user's own columns, each (s,), by name
    report : what the run reported at its end; None in a CSV file
    name : of the Problem
    method : integrator, options and versions; empty in a CSV file
    """

    path: Path
    times: Floats
    y: Floats
    energies: Floats | None = None
    columns: Mapping[str, Floats] = field(default_factory=dict)
    report: dict[str, Any] | None = None
    name: str = ""
    method: Mapping[str, Any] = field(default_factory=dict)
    separable: bool = False

    def __len__(self) -> int:
        return len(self.times)

    def series(self) -> dict[str, Floats]:
        """The columns of the table, each (s,), by name."""
        return series(self.times, self.y, self.energies, self.columns)

    def to_pandas(self) -> Any:
        """A pandas DataFrame of the table; an InputError where pandas is not installed."""
        return data_frame(self.series())

    def close(self) -> None:
        """Nothing: the file is closed already."""

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()


def series(times: Floats, y: Floats, energies: Floats | None, columns: Mapping[str, Floats]) -> dict[str, Floats]:
    """The columns of a table, by name."""
    found = {TIME: times} | {f"y{k}": values for k, values in enumerate(y.T)}
    if energies is not None:
        found[ENERGY] = energies
    for name, values in columns.items():
        labels = parts(name, values.shape[1:])
        found |= dict(zip(labels, values.reshape(len(values), len(labels)).T, strict=True))
    return found


def data_frame(columns: Mapping[str, Floats]) -> Any:
    return library("pandas", "to_pandas()").DataFrame(dict(columns))


def check(path: str | os.PathLike[str]) -> None:
    """An InputError where a library is missing that a table of this suffix needs."""
    if Path(path).suffix.lower() == ".parquet":
        for name in ("pandas", "pyarrow"):
            library(name, "a .parquet file", NEEDS)


def write(path: Path, columns: Mapping[str, Floats], about: Mapping[str, Any], *, overwrite: bool) -> None:
    """Write a table, whole or not at all.

    Parameters
    ----------
    columns : each (s,), by name
    about : name, separable, method and report of the run; a Parquet file keeps these
    """
    with written_whole(path, kinds.SERIES, overwrite=overwrite) as part:
        if path.suffix.lower() == ".parquet":
            table = data_frame(columns)
            table.attrs[kinds.SERIES_MARK] = dict(about)
            table.to_parquet(part, index=False)
            return
        with part.open("w", newline="", encoding="utf-8") as file:
            rows = csv.writer(file, lineterminator="\n")
            rows.writerow(columns)
            rows.writerows(zip(*(values.tolist() for values in columns.values()), strict=True))


def read(path: str | os.PathLike[str]) -> ProblemTable:
    """The table of a Problem's run; an InputError where the file is none."""
    path = Path(path)
    try:
        columns, about = _read_parquet(path) if path.suffix.lower() == ".parquet" else (_read_csv(path), {})
        if about is None or [*columns][:2] != [TIME, "y0"]:
            raise InputError(f"{shown_path(path)}: is not the table of a Problem's run")
        return _table(path, columns, about)
    except InputError:
        raise
    except (OSError, ArithmeticError, LookupError, NotImplementedError, TypeError, ValueError, csv.Error) as error:
        raise InputError(f"{shown_path(path)}: cannot be read: {' '.join(str(error).split())[:200]}") from None


def is_series(path: str | os.PathLike[str]) -> bool:
    """Whether the file is the table of a Problem's run."""
    return kinds.is_ours(path, kinds.SERIES)


def _read_csv(path: Path) -> dict[str, Floats]:
    with opened(path) as file:
        rows = csv.reader(file.read().decode("utf-8").splitlines())
    names = next(rows, [])
    values = np.array([[float(value) for value in row] for row in rows]).reshape(-1, len(names))
    return dict(zip(names, values.T, strict=True))


def _read_parquet(path: Path) -> tuple[dict[str, Floats], dict[str, Any] | None]:
    check(path)
    import pandas

    with opened(path) as file:
        table = pandas.read_parquet(file)
    about = table.attrs.get(kinds.SERIES_MARK)
    if not isinstance(about, dict):
        return {}, None
    return {name: table[name].to_numpy(dtype=float) for name in table.columns}, about


def _table(path: Path, columns: dict[str, Floats], about: dict[str, Any]) -> ProblemTable:
    n = next((k for k in range(len(columns)) if f"y{k}" not in columns), len(columns))
    known = {TIME, ENERGY, *(f"y{k}" for k in range(n))}
    return ProblemTable(
        path=path,
        times=columns[TIME],
        y=np.array([columns[f"y{k}"] for k in range(n)]).T,
        energies=columns.get(ENERGY),
        columns={name: values for name, values in columns.items() if name not in known},
        report=about.get("report"),
        name=str(about.get("name", "")),
        method=about.get("method", {}),
        separable=bool(about.get("separable", False)),
    )

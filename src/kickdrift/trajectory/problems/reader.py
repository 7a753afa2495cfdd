"""Reading the file of a Problem's run: its contents as arrays, as a dictionary and as text."""

from pathlib import Path
from typing import Any

import h5py
import numpy as np
from numpy.typing import NDArray

from kickdrift.errors import InputError
from kickdrift.model.problem import Problem
from kickdrift.model.state import Floats
from kickdrift.text import shown
from kickdrift.trajectory.layout import problem_header as header
from kickdrift.trajectory.layout.names import check_schema
from kickdrift.trajectory.layout.problem_header import ENERGY, Y
from kickdrift.trajectory.problems import table
from kickdrift.trajectory.problems.record import problem_hash, problem_of
from kickdrift.trajectory.problems.table import ProblemTable
from kickdrift.trajectory.read.info import laid_out, method_rows, shared_content, short, with_end
from kickdrift.trajectory.read.recorded import Recorded
from kickdrift.trajectory.read.tables import ShownProblemRun

CHANGED = "its Problem was changed after the run began (kickdrift/problem, method or versions)"
MOST = 8  # numbers of y that are shown


class ProblemRun(Recorded, ShownProblemRun):
    """The file of a Problem's run, open for reading: a context manager.

    Attributes
    ----------
    path : Path
    run_id : str
    every : int
        Steps between samples; 0 where time sets the samples.
    y0 : (n,)
        At the start.
    source : str
        The text of the system file, empty where there was none.
    problem_record, method, versions : dict
    report : dict or None
        What the run reported at its end; None if the run did not reach its end.
    """

    own_names = frozenset((Y, ENERGY))

    def _check_kind(self, file: h5py.File) -> None:
        if header.PROBLEM not in file:
            raise InputError(f"{self.path}: is not the file of a Problem's run: it has no group {header.PROBLEM!r}")
        check_schema(self.path, file)

    def _hash(self, file: h5py.File) -> str:
        return problem_hash(file)

    def _read_header(self) -> None:
        found = header.read(self._contents)
        self.run_id, self.every, self.units = found.run_id, found.every, found.units
        self.problem_record, self.source, self.y0 = found.record, found.source, found.y0
        self.method, self.versions = found.method, found.versions
        self.report, self.half_written, self.options = found.report, found.half_written, found.options
        self.ids, self.names = found.ids, ()
        self._read_rows(found)

    def __repr__(self) -> str:
        return f"<ProblemRun {self.path}: {len(self)} samples of {len(self.y0)} unknowns>"

    def __len__(self) -> int:
        return self._samples

    @property
    def name(self) -> str:
        """The Problem's name."""
        return str(self.problem_record["name"])

    @property
    def separable(self) -> bool:
        """Whether y is positions and then their velocities."""
        return bool(self.problem_record["separable"])

    @property
    def steps(self) -> NDArray[np.int64]:
        """(s,) steps of the samples."""
        return self.sample_steps

    @property
    def times(self) -> Floats:
        """(s,) times of the samples."""
        return self.sample_times

    @property
    def y(self) -> Floats:
        """(s, n) solution at `times`."""
        return self._sampled(Y) if self._samples else np.zeros((0, len(self.y0)))

    @property
    def energies(self) -> Floats | None:
        """(s,) the Problem's ``energy`` at `times`, or None for a Problem without energy."""
        return self._sampled(ENERGY) if ENERGY in self._observables else None

    def problem(self) -> Problem:
        """The Problem that was solved, where kickdrift ships its equation; an InputError for functions made in
        Python, which a file cannot hold."""
        if not self.unchanged:
            raise InputError(f"{self.path}: damaged: {CHANGED}")
        return problem_of(self)

    def series(self) -> dict[str, Floats]:
        """The columns of a table: time, y0, y1, …, energy, and the user's columns, each (s,)."""
        own = {name: values for name, values in self.observables.items() if name not in self.own_names}
        return table.series(self.times, self.y, self.energies, own)

    def to_pandas(self) -> Any:
        """A pandas DataFrame: a row for each sample, with time, y0, y1, …, energy and the user's columns.

        An InputError where pandas is not installed.
        """
        return table.data_frame(self.series())


def is_problem_run(path: str | Path) -> bool:
    """Whether an HDF5 file is that of a Problem's run; an InputError where it cannot be read."""
    from kickdrift.trajectory.file.opening import open_to_read

    with open_to_read(path) as file:
        return header.PROBLEM in file


def info(run: ProblemRun) -> dict[str, Any]:
    """The content of the file in numbers."""
    record = run.problem_record
    return shared_content(run) | {
        "problem": run.name,
        "equation": record.get("equation", ""),
        "parameters": record.get("parameters", {}),
        "unknowns": len(run.y0),
        "separable": run.separable,
        "units": {"time": ""},
        "frames": 0,
    }


def describe(run: ProblemRun) -> str:
    """Results of `info`, for a reader."""
    found = info(run)
    given = ", ".join(f"{key} = {short(value)}" for key, value in found["parameters"].items())
    equation = f"{found['equation']}{': ' * bool(given)}{given}" if found["equation"] else "made in Python"
    rows = [
        ("problem", f"{found['problem']}, {found['unknowns']} unknowns"),
        ("equation", shown(equation)[1:-1]),
        *method_rows(found["method"]),
        ("samples", f"{found['samples']:,} of y"),
    ]
    if found["time"]:
        first, last = found["time"]
        rows.append(("time", f"{first:g} to {last:g}, steps {found['steps'][0]} to {found['steps'][1]}"))
    rows += [(name, f"{_short(ends['first'])} → {_short(ends['last'])}") for name, ends in found["observables"].items()]
    return laid_out(found, with_end(found, rows))


def describe_any(run: ProblemRun | ProblemTable) -> str:
    """Contents of a Problem's run or table, for a reader."""
    return describe(run) if isinstance(run, ProblemRun) else describe_table(run)


def describe_table(table: ProblemTable) -> str:
    """Contents of the table of a Problem's run, for a reader."""
    return "\n".join([str(table.path), *(f"  {key:<10}  {value}" for key, value in table_rows(table))])


def table_rows(table: ProblemTable) -> list[tuple[str, str]]:
    """The same in lines of key and text."""
    rows = [("problem", table.name), ("unknowns", str(table.y.shape[1])), ("rows", f"{len(table):,}")]
    rows += [(key, short(table.method[key])) for key in ("integrator", "dt") if table.method.get(key) is not None]
    if len(table):
        rows.append(("time", f"{table.times[0]:g} to {table.times[-1]:g}"))
        rows += [(name, f"{values[0]:.8g} → {values[-1]:.8g}") for name, values in table.series().items()][1:]
    return [(key, value) for key, value in rows if value]


def _short(value: Any) -> str:
    """A value as text; of a long list its first numbers."""
    long = isinstance(value, list) and len(value) > MOST
    return f"{short(value[:MOST])[:-1]}, …)" if long else short(value)

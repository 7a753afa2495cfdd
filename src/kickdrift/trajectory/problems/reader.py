"""Reading the file of a Problem's run."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import h5py
import numpy as np
from numpy.typing import NDArray

from kickdrift.errors import InputError
from kickdrift.model.problem import Problem
from kickdrift.model.state import Floats
from kickdrift.trajectory.layout import problem_header as header
from kickdrift.trajectory.layout.kind import check_schema
from kickdrift.trajectory.layout.problem_header import ENERGY, Y
from kickdrift.trajectory.problems import table
from kickdrift.trajectory.problems.layout import problem_hash
from kickdrift.trajectory.problems.record import problem_of
from kickdrift.trajectory.read.recorded import Recorded
from kickdrift.trajectory.read.shown import ShownProblemRun

CHANGED = "its Problem was changed after the run began (kickdrift/problem, method or versions)"


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

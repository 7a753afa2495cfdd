"""Files of a Problem's run: a file that can be resumed, or a table."""

from __future__ import annotations

import os
import re
from collections.abc import Iterable, Mapping
from contextlib import suppress
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from kickdrift.disk import kinds
from kickdrift.disk.outputs import checked_target, plain
from kickdrift.errors import InputError, KickdriftError
from kickdrift.looks.record import WRITING
from kickdrift.model.problem import Problem, ProblemState
from kickdrift.model.state import Floats
from kickdrift.model.system import System
from kickdrift.run.watcher import Watcher
from kickdrift.run.watchers.file import File

if TYPE_CHECKING:
    from kickdrift.looks.observers import Looks, Sample
    from kickdrift.run.advance import Integration
    from kickdrift.run.report.report import Report
    from kickdrift.trajectory.layout.options import FileOptions

SPECIES_BYTES = 64_000  # HDF5 keeps the names of species in a message of at most 65,535 bytes
_OWN_COLUMN = re.compile(r"y\d*|energy")


def check_suffix(system: System | Problem, output: str) -> None:
    """Refuse a name whose suffix is that of another kind of run, and more species than a file can name."""
    kind = kinds.RUN if isinstance(system, System) else kinds.PROBLEM
    suffixes = kind.suffixes if isinstance(system, System) else (*kind.suffixes, *kinds.SERIES.suffixes)
    if Path(output).suffix.lower() not in suffixes:
        noun = kind.noun if isinstance(system, System) else "a Problem's run"
        raise InputError(f"{output}: the name of {noun} {kinds.wrong_ending(output, suffixes)}")
    if isinstance(system, System):
        size = sum(len(name.encode()) // 8 * 8 + 12 for name in system.species)
        if size > SPECIES_BYTES:
            raise InputError(f"{output}: cannot hold {len(system.species):,} species, whose names take {size:,} bytes")


def is_table(output: str) -> bool:
    """Whether a Problem's output is a table."""
    return Path(output).suffix.lower() in kinds.SERIES.suffixes


def check_columns(names: Iterable[str]) -> None:
    """Refuse columns whose names a Problem's file uses."""
    for name in names:
        if _OWN_COLUMN.fullmatch(name):
            raise InputError(f"column {name!r}: a Problem's file uses this name itself; choose another")


def check_options(options: FileOptions | None) -> None:
    """Refuse options that are about frames of particles."""
    from kickdrift.trajectory.layout.options import FileOptions

    for key in ("store", "compress", "write"):
        if options is not None and getattr(options, key) != getattr(FileOptions(), key):
            raise InputError(f"{key}: is for the frames of particles; a Problem's file takes flush alone")


def slopes_of(run: Integration) -> list[Floats]:
    """f at the states by which a file tells a Problem's f from another; nan where f is not defined."""
    from kickdrift.trajectory.problems.record import states_to_compare

    problem = run.system
    assert isinstance(problem, Problem)
    flow: Any = run.flow
    found = []
    for y in states_to_compare(problem):
        slope = np.full(len(problem), np.nan)
        with suppress(Exception), np.errstate(all="ignore"):  # whatever a user's function raises
            slope = np.array(flow.derivative(problem.t0, flow.array(ProblemState(y)))).reshape(-1)
        flow.forget_errors()
        found.append(slope)
    return found


class ProblemFile(File):
    """Writes a Problem's looks and events to a file; see `File`."""

    takes_series = False

    def _append(self, looks: Looks, columns: dict[str, Any]) -> None:
        energy = looks.total if self._run.system.energy is not None else None  # type: ignore[union-attr]
        self._writer.append_look(self._run.state, columns, energy)


class ProblemTableFile(Watcher):
    """Keeps a Problem's looks, and writes them as a table when the run ends.

    Parameters
    ----------
    run : the Integration to sample
    output : a name that ends in .csv or .parquet
    overwrite : replace a table of that name
    method : what the Simulation says of itself
    columns : names of the user's columns to write
    """

    part = WRITING

    def __init__(
        self, run: Integration, output: str, overwrite: bool, method: Mapping[str, Any], columns: Iterable[str]
    ) -> None:
        self._run, self._path, self._overwrite = run, Path(output), overwrite
        self._method, self._columns = method, tuple(columns)

    def begin(self) -> None:
        """Check that the table can be written."""
        from kickdrift.trajectory.problems import table

        table.check(self._path)
        checked_target(self._path, kinds.SERIES, self._overwrite)
        self._rows: list[tuple[float, Floats, Sample]] = []

    def look(self) -> None:
        """Keep the current sample."""
        self._rows.append((self._run.time, self._run.state.y, self._run.record.samples[-1]))

    def close(self, report: Report | None) -> None:
        """Write the table, also that of a run which failed."""
        if report is not None:
            self._write(report.as_json())
            return
        with suppress(KickdriftError):  # the error that ended the run is raised instead
            self._write(None)

    def _write(self, report: dict[str, Any] | None) -> None:
        from kickdrift.trajectory.layout.names import versions
        from kickdrift.trajectory.problems import table

        if not self._rows:
            return
        problem = self._run.system
        assert isinstance(problem, Problem)
        times, states, samples = zip(*self._rows, strict=True)
        energies = np.array([each.energies.total for each in samples]) if problem.energy is not None else None
        own = {name: np.array([each.columns[name] for each in samples]) for name in self._columns}
        about = {
            "name": problem.name,
            "separable": problem.separable,
            "method": plain(dict(self._method)),
            "versions": versions(),
            "report": plain(report),
        }
        columns = table.series(np.array(times), np.array(states), energies, own)
        table.write(Path(os.path.abspath(self._path)), columns, about, overwrite=self._overwrite)

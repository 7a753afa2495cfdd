"""A run's file of any kind, opened by its content, and the frame at which a new run begins."""

from __future__ import annotations

import os
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from kickdrift.errors import InputError
from kickdrift.model.checks.values import path_text
from kickdrift.model.system import System
from kickdrift.trajectory.layout.record import system_of
from kickdrift.trajectory.problems import table
from kickdrift.trajectory.problems.reader import ProblemRun, is_problem_run
from kickdrift.trajectory.problems.table import ProblemTable
from kickdrift.trajectory.read import reader
from kickdrift.trajectory.read.frames import Frame

SUFFIX = ".h5md"  # of runs of particles


def open(path: str | os.PathLike[str]) -> Any:
    """Open a run's file.

    Parameters
    ----------
    path : path of a file that `Simulation.run` wrote

    Returns
    -------
    A `Run`, the sequence of its frames, for particles (``.h5md``). A `ProblemRun` for a Problem (``.h5``), with times,
    y and energies. A `ProblemTable` for the table of a Problem's run (``.csv``, ``.parquet``).

    Raises
    ------
    InputError
        For a file of another kind; the message says what it is.
    """
    found = Path(path_text("path", path))
    problem = problem_of(found)
    return reader.open(found) if problem is None else problem


def is_problem(path: str | os.PathLike[str]) -> bool:
    """Whether a file is that of a Problem's run, or its table, by its content; False for what cannot be read."""
    found = Path(path)
    if found.suffix.lower() in table.SUFFIXES:
        return table.is_series(found)
    try:
        return is_problem_run(found)
    except InputError:
        return False


def problem_of(path: Path) -> ProblemRun | ProblemTable | None:
    """The run of a Problem in a file, open for reading; None for the file of a run of particles."""
    suffix = path.suffix.lower()
    if suffix == SUFFIX:
        return None
    if suffix in table.SUFFIXES:
        return table.read(path)
    return ProblemRun(path) if is_problem_run(path) else None


@contextmanager
def opened_at(path: str | os.PathLike[str], number: int | None = None) -> Iterator[Frame]:
    """A frame of a run's file, which stays open: counted from 0, or from -1 backwards; the last one by default."""
    with reader.open(path) as run:
        k = -1 if number is None else number
        if not -len(run) <= k < len(run):
            raise InputError(f"{path}: has no frame {k}; it holds {len(run)}")
        yield run[k]


def start_at(path: str | os.PathLike[str], number: int | None = None) -> System:
    """The bodies of the System at a frame, without its forces and events."""
    with opened_at(path, number) as frame:
        frame._run.refuse_changed()
        return system_of(frame._run, frame.index, forces=(), events=())

"""Protocols of a Run for the modules of this layer: its header, its record and its numbers."""

from __future__ import annotations

from pathlib import Path
from typing import Any, Protocol

from numpy.typing import NDArray

from kickdrift.model.box.box import Box
from kickdrift.model.state import Floats
from kickdrift.model.subject import Particles
from kickdrift.trajectory.layout.options import FileOptions


class RunHeader(Particles, Protocol):
    """Particles and units of a run's file; see ``Run``."""

    @property
    def path(self) -> Path: ...

    @property
    def run_id(self) -> str: ...

    @property
    def every(self) -> int: ...

    @property
    def nominal_units(self) -> bool: ...

    @property
    def masses(self) -> Floats: ...

    @property
    def ids(self) -> NDArray[Any]: ...

    @property
    def system_record(self) -> dict[str, Any]: ...

    @property
    def method(self) -> dict[str, Any]: ...

    @property
    def options(self) -> FileOptions: ...

    @property
    def box_varies(self) -> bool:
        """Whether any frame has another box than the run's System."""

    def unit_of(self, observable: str) -> str:
        """Unit of an observable, as text."""


class RunClock(RunHeader, Protocol):
    """Header with the steps and times of a run's frames; see ``Run``."""

    @property
    def steps(self) -> NDArray[Any]: ...

    @property
    def times(self) -> Floats: ...

    def __len__(self) -> int: ...


class Instant(Protocol):
    """One frame, as needed to make a System; see ``Frame``."""

    @property
    def index(self) -> int: ...

    @property
    def time(self) -> float: ...

    @property
    def positions(self) -> Floats: ...

    @property
    def velocities(self) -> Floats: ...

    @property
    def box(self) -> Box: ...


class RunRecord(RunHeader, Protocol):
    """Record of the System in a run's file; see ``Run``."""

    @property
    def system_record(self) -> dict[str, Any]: ...

    @property
    def system_source(self) -> str: ...

    @property
    def initial_phase(self) -> Floats: ...

    @property
    def events(self) -> list[dict[str, Any]]: ...

    def __getitem__(self, index: int) -> Instant: ...


class Series(Protocol):
    """Some frames, as needed for tables; see ``Frames``."""

    @property
    def steps(self) -> NDArray[Any]: ...

    @property
    def times(self) -> Floats: ...

    @property
    def positions(self) -> Floats: ...

    @property
    def velocities(self) -> Floats: ...

    @property
    def boxes(self) -> list[Box]: ...


class RunNumbers(RunRecord, RunClock, Protocol):
    """All that frames read from a run's file; see ``Run``."""

    @property
    def all_steps(self) -> NDArray[Any]: ...

    @property
    def all_times(self) -> Floats: ...

    def check_clock(self, rows: range) -> None:
        """Refuse a damaged step or time of one of these frames."""

    def refuse_changed(self) -> None:
        """Refuse a file whose system was changed."""

    def vectors(self, what: str, frames: slice, particles: slice = slice(None)) -> Floats:
        """Positions, velocities or forces, shape (f, n, 3)."""

    def framed(self, frames: slice) -> dict[str, Floats]:
        """Every observable at some frames."""

    def boxes_of(self, rows: range) -> list[Box]:
        """Box of each of some frames, in ascending order."""

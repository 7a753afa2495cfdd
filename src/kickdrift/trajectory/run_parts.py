"""What the modules of this room see of a Run: the protocols of its header, its record and its numbers."""

from __future__ import annotations

from pathlib import Path
from typing import Any, Protocol

from numpy.typing import NDArray

from kickdrift.model.box import Box
from kickdrift.model.state import Floats
from kickdrift.model.subject import Particles
from kickdrift.trajectory.options import FileOptions


class RunHeader(Particles, Protocol):
    """What a run's file says once of its particles and units; see ``Run``."""

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
    def method(self) -> dict[str, Any]: ...

    @property
    def options(self) -> FileOptions: ...

    def unit_of(self, observable: str) -> str:
        """Unit of an observable, in words."""


class RunClock(RunHeader, Protocol):
    """The steps and times of a run's frames beside its header; see ``Run``."""

    @property
    def steps(self) -> NDArray[Any]: ...

    @property
    def times(self) -> Floats: ...

    def __len__(self) -> int: ...


class Instant(Protocol):
    """One frame, as a System is made of it; see ``Frame``."""

    @property
    def index(self) -> int: ...

    @property
    def time(self) -> float: ...

    @property
    def positions(self) -> Floats: ...

    @property
    def velocities(self) -> Floats: ...


class RunRecord(RunHeader, Protocol):
    """What a run's file says of its System; see ``Run``."""

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
    """Some frames, as tables have them; see ``Frames``."""

    @property
    def steps(self) -> NDArray[Any]: ...

    @property
    def times(self) -> Floats: ...

    @property
    def positions(self) -> Floats: ...

    @property
    def velocities(self) -> Floats: ...


class RunNumbers(RunRecord, RunClock, Protocol):
    """What frames read from a run's file; see ``Run``."""

    @property
    def all_steps(self) -> NDArray[Any]: ...

    @property
    def all_times(self) -> Floats: ...

    def check_clock(self, rows: range) -> None:
        """Refuse a damaged step or time of one of these frames."""

    def refuse_changed(self) -> None:
        """Refuse a file whose system was changed."""

    def vectors(self, what: str, frames: slice, particles: slice = slice(None)) -> Floats:
        """(f, n, 3) positions, velocities or forces."""

    def framed(self, frames: slice) -> dict[str, Floats]:
        """Every observable at some frames."""

    def boxes_of(self, rows: range) -> list[Box]:
        """The box of each of some frames, in ascending order."""

"""A run's file as the other modules of this layer see it."""

from __future__ import annotations

from pathlib import Path
from typing import Any, Protocol

from numpy.typing import NDArray

from kickdrift.model.box.box import Box
from kickdrift.model.state import Floats
from kickdrift.model.subject import Particles
from kickdrift.trajectory.layout.options import FileOptions


class RunFile(Particles, Protocol):
    """Particles, record, steps and vectors of a run's file; see ``Run``. An item is a ``Frame``."""

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
    def charges(self) -> Floats | None: ...

    @property
    def ids(self) -> NDArray[Any]: ...

    @property
    def system_record(self) -> dict[str, Any]: ...

    @property
    def system_source(self) -> str: ...

    @property
    def initial_phase(self) -> Floats: ...

    @property
    def events(self) -> list[dict[str, Any]]: ...

    @property
    def method(self) -> dict[str, Any]: ...

    @property
    def options(self) -> FileOptions: ...

    @property
    def box_varies(self) -> bool: ...

    @property
    def steps(self) -> NDArray[Any]: ...

    @property
    def times(self) -> Floats: ...

    @property
    def all_steps(self) -> NDArray[Any]: ...

    @property
    def all_times(self) -> Floats: ...

    def __len__(self) -> int: ...

    def __getitem__(self, index: int) -> Any: ...

    def unit_of(self, observable: str) -> str: ...

    def check_clock(self, rows: range) -> None: ...

    def refuse_changed(self) -> None: ...

    def vectors(self, what: str, frames: slice, particles: slice = slice(None)) -> Floats: ...

    def framed(self, frames: slice) -> dict[str, Floats]: ...

    def boxes_of(self, rows: range) -> list[Box]: ...

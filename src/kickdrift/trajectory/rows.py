"""The growing datasets of a run's file: how rows are added so that a kill at any moment leaves whole ones."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

import h5py
import numpy as np
from numpy.typing import ArrayLike, NDArray

from kickdrift.state import Floats
from kickdrift.trajectory import reader
from kickdrift.trajectory.layout import (
    EVENT_WIDTH,
    EVENTS,
    SAMPLES,
    SERIES_CHUNK,
    TRAJECTORY,
    FileUnits,
    new_events,
    new_series,
    observable_unit,
)

_MARGIN = 256 * 1024  # for HDF5's own tables, over and above the rows

Observables = dict[str, NDArray[np.float64]]


class SampleRow(NamedTuple):
    """Observables at one time, in the system's units."""

    step: int
    time: float
    observables: Observables


class FrameRow(NamedTuple):
    """Positions and velocities (n, 3) at one time, in the system's units, with the observables there."""

    step: int
    time: float
    positions: Floats
    velocities: Floats
    box: tuple[float, float, float] | None
    observables: Observables


class EventRow(NamedTuple):
    """An event, in the system's units; ids are -1 and numbers nan where it has none."""

    time: float
    step: int
    ids: tuple[int, int]
    distance: float
    energy: float
    kind: str
    done: str

    @classmethod
    def of(cls, event: Mapping[str, Any]) -> EventRow:
        """The row of an entry of `Simulation.events`."""
        ids = (*event["ids"], -1, -1)[:2]
        distance, energy = (np.nan if event[key] is None else float(event[key]) for key in ("distance", "energy"))
        return cls(event["time"], event["step"], ids, distance, energy, event["kind"], event["done"])


class Rows:
    """Frames, samples and events of an open file.

    Attributes
    ----------
    frames, samples, events : int
        Rows that are whole.
    shapes : dict of name -> shape
        Of the observables; empty until the first sample.
    ids : (n,) int64
        The order of the particles in every frame.
    """

    def __init__(self, file: h5py.File) -> None:
        self._file = file
        own = file["kickdrift"]
        self._units = reader.unit_system_of(own)
        self._factors = FileUnits.of(self._units)
        self.ids: NDArray[np.int64] = file[TRAJECTORY]["id"][()]
        self.frames, self.samples = (int(rows) for rows in own["committed"][()])
        self.events = int(file[EVENTS]["committed"][0]) if EVENTS in file else 0
        names = [name for name in file[SAMPLES] if name not in ("step", "time")]
        self.shapes: dict[str, tuple[int, ...]] = {name: file[SAMPLES][name].shape[1:] for name in names}
        self._shapes_known = self.samples > 0
        self._cut()

    def _cut(self) -> None:
        """Take away what was left half written."""
        file = self._file
        per_frame = [f"{TRAJECTORY}/position", f"{TRAJECTORY}/velocity", f"{TRAJECTORY}/box/edges"]
        per_frame += [f"observables/{name}" for name in file["observables"]]
        grown = [*((name, self.frames) for name in per_frame if name in file), (SAMPLES, self.samples)]
        grown += [(EVENTS, self.events)] if EVENTS in file else []
        for group, rows in grown:
            for name, data in file[group].items():
                if name != "committed" and data.shape[0] > rows:
                    data.resize(rows, axis=0)

    @property
    def last_frame(self) -> tuple[int, float] | None:
        """Step and time."""
        place = self._file[TRAJECTORY]["position"]
        return self._last(place, self.frames, self._factors.time)

    @property
    def last_sample(self) -> tuple[int, float] | None:
        """Step and time."""
        return self._last(self._file[SAMPLES], self.samples, 1.0)

    def _last(self, group: h5py.Group, rows: int, factor: float) -> tuple[int, float] | None:
        return (int(group["step"][rows - 1]), float(group["time"][rows - 1]) / factor) if rows else None

    def room(self, size: int, samples: int, events: int) -> int:
        """The most bytes that ``size`` bytes of rows can take: rounded up to whole chunks, and HDF5's tables."""
        frames, particles, _ = self._file[f"{TRAJECTORY}/position/value"].chunks
        chunk = frames * particles * 24
        row = chunk * -(-len(self.ids) // particles)
        columns = 8 + 2 * sum(int(np.prod(shape, dtype=int)) for shape in self.shapes.values())
        chunks = columns * (samples // SERIES_CHUNK + 2) + (EVENT_WIDTH * (events // SERIES_CHUNK + 2) if events else 0)
        return size + 2 * row + chunks * SERIES_CHUNK * 8 + 128 * (size // chunk + chunks) + _MARGIN

    def add(self, frames: Sequence[FrameRow], samples: Sequence[SampleRow], events: Sequence[EventRow] = ()) -> None:
        """Write the rows and flush. Doing it again after an interrupt does no harm."""
        file, factors = self._file, self._factors
        self._new_observables()
        self._put(f"{SAMPLES}/step", self.samples, [row.step for row in samples])
        self._put(f"{SAMPLES}/time", self.samples, [row.time for row in samples])
        for name in self.shapes:
            self._put(f"{SAMPLES}/{name}", self.samples, [row.observables[name] for row in samples])
            self._put(f"observables/{name}/value", self.frames, [row.observables[name] for row in frames])
        self._put(f"{TRAJECTORY}/position/time", self.frames, [row.time * factors.time for row in frames])
        self._put(f"{TRAJECTORY}/velocity/value", self.frames, [row.velocities * factors.velocity for row in frames])
        if f"{TRAJECTORY}/box/edges" in file:
            edges = [np.array(row.box) * factors.length for row in frames]
            self._put(f"{TRAJECTORY}/box/edges/value", self.frames, edges)
        file.flush()
        # Positions and their steps grow last and in a flush of their own: MDAnalysis counts frames by the first and
        # ends a loop by the second, so that it finds everything else there after a kill.
        self._put(f"{TRAJECTORY}/position/step", self.frames, [row.step for row in frames])
        self._put(f"{TRAJECTORY}/position/value", self.frames, [row.positions * factors.length for row in frames])
        file.flush()
        total = self.frames + len(frames), self.samples + len(samples)
        file["kickdrift/committed"][...] = total
        file.flush()
        self.frames, self.samples = total
        self._add_events(events)

    def _add_events(self, events: Sequence[EventRow]) -> None:
        if not events:
            return
        file = self._file
        if EVENTS not in file:
            new_events(file)
        for name in EventRow._fields:
            values = [getattr(row, name) for row in events]
            texts = name in ("kind", "done")
            self._put(f"{EVENTS}/{name}", self.events, [text.encode() for text in values] if texts else values)
        file.flush()
        file[EVENTS]["committed"][0] = self.events + len(events)
        file.flush()
        self.events += len(events)

    def check(self, observables: Mapping[str, NDArray[np.float64]]) -> str | None:
        """What is wrong with these observables, if anything; the first ones say what the others must be."""
        shapes = {name: value.shape for name, value in observables.items()}
        if clash := shapes.keys() & {"step", "time"}:
            return f"observables: {min(clash)!r} is a reserved name"
        if not self._shapes_known:
            self.shapes, self._shapes_known = shapes, True
        if shapes != self.shapes:
            return f"observables: expected {self.shapes} as before, got {shapes}"
        return None

    def _new_observables(self) -> None:
        file = self._file
        for name, shape in self.shapes.items():
            unit = observable_unit(name, self._units)
            element = file["observables"].require_group(name)
            for group, key in ((file[SAMPLES], name), (element, "value")):
                if key not in group:
                    new_series(group, key, shape, "f8").attrs["unit"] = unit
            for key in ("step", "time"):
                if key not in element:
                    element[key] = file[f"{TRAJECTORY}/position/{key}"]

    def _put(self, name: str, start: int, rows: Sequence[ArrayLike]) -> None:
        if rows:
            data = self._file[name]
            data.resize(start + len(rows), axis=0)
            data[start:] = np.asarray(rows)

"""The growing datasets of a run's file: how rows are added so that a kill at any moment leaves whole ones."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

import h5py
import numpy as np
from numpy.typing import ArrayLike, NDArray

from kickdrift.box import Box
from kickdrift.state import Floats
from kickdrift.trajectory import reader
from kickdrift.trajectory.layout import (
    EVENTS,
    SAMPLES,
    TRAJECTORY,
    FileUnits,
    new_series,
    observable_unit,
)
from kickdrift.trajectory.openfile import OpenFile

Observables = dict[str, NDArray[np.float64]]


class SampleRow(NamedTuple):
    """Observables at one time, in the system's units."""

    step: int
    time: float
    observables: Observables


class FrameRow(NamedTuple):
    """Positions, velocities and forces (n, 3) at one time, in the system's units, with the observables there."""

    step: int
    time: float
    positions: Floats
    velocities: Floats
    box: Box
    observables: Observables
    forces: Floats | None = None


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
    complete : bool
        Whether the file has a dataset for each of them; else `make_observables` comes first.
    ids : (n,) int64
        The order of the particles in every frame.
    write : tuple of str
        Which of "forces" and "images" the frames have.
    """

    def __init__(self, out: OpenFile) -> None:
        self._out = out
        file = self._file
        own = file["kickdrift"]
        self._units = reader.unit_system_of(own)
        self._factors = FileUnits.of(self._units)
        self.ids: NDArray[np.int64] = file[TRAJECTORY]["id"][()]
        self.frames, self.samples, self.events = (int(rows) for rows in own["committed"][()])
        names = [name for name in file[SAMPLES] if name not in ("step", "time")]
        self.shapes: dict[str, tuple[int, ...]] = {name: file[SAMPLES][name].shape[1:] for name in names}
        self.complete = True
        self._shapes_known = self.samples > 0 or bool(self.shapes)
        extras = {"forces": "force", "images": "image"}
        self.write = tuple(name for name, group in extras.items() if f"{TRAJECTORY}/{group}" in file)

    @property
    def _file(self) -> h5py.File:
        return self._out.h5

    def cut(self) -> bool:
        """Take away what was left half written; whether there was any.

        Chunks become free by it, and HDF5 would put new ones there: commit and open the file anew, which forgets them.
        """
        file, found = self._file, False
        per_frame = [*(f"{TRAJECTORY}/{name}" for name in ("position", "velocity", "force", "image", "box/edges"))]
        per_frame += [f"observables/{name}" for name in file["observables"]]
        grown = [*((name, self.frames) for name in per_frame if name in file), (SAMPLES, self.samples)]
        for group, rows in [*grown, (EVENTS, self.events)]:
            for data in file[group].values():
                if data.shape[0] > rows:
                    data.resize(rows, axis=0)
                    found = True
        return found

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

    def add(self, frames: Sequence[FrameRow], samples: Sequence[SampleRow], events: Sequence[EventRow] = ()) -> None:
        """Write the rows and bring them to the disk. Doing it again after an interrupt does no harm."""
        file, factors = self._file, self._factors
        self._put(f"{SAMPLES}/step", self.samples, [row.step for row in samples])
        self._put(f"{SAMPLES}/time", self.samples, [row.time for row in samples])
        for name in self.shapes:
            self._put(f"{SAMPLES}/{name}", self.samples, [row.observables[name] for row in samples])
            self._put(f"observables/{name}/value", self.frames, [row.observables[name] for row in frames])
        self._put(f"{TRAJECTORY}/position/time", self.frames, [row.time * factors.time for row in frames])
        self._put(f"{TRAJECTORY}/velocity/value", self.frames, [row.velocities * factors.velocity for row in frames])
        if "forces" in self.write:
            forces = [row.forces * factors.force for row in frames if row.forces is not None]
            self._put(f"{TRAJECTORY}/force/value", self.frames, forces)
        positions = [row.positions for row in frames]
        if "images" in self.write:
            inside = [row.box.wrap(row.positions) for row in frames]
            images = [images_of(row.positions, within, row.box) for row, within in zip(frames, inside, strict=True)]
            self._put(f"{TRAJECTORY}/image/value", self.frames, images)
            positions = inside
        if f"{TRAJECTORY}/box/edges" in file:
            edges = [np.array(row.box.lengths) * factors.length for row in frames]
            self._put(f"{TRAJECTORY}/box/edges/value", self.frames, edges)
        for name in EventRow._fields:
            values = [getattr(row, name) for row in events]
            texts = name in ("kind", "done")
            self._put(f"{EVENTS}/{name}", self.events, [text.encode() for text in values] if texts else values)
        self._out.commit()
        # Positions and their steps grow last and in one write: MDAnalysis counts frames by the first and ends a loop by
        # the second, and so finds everything else there after a kill.
        self._put(f"{TRAJECTORY}/position/step", self.frames, [row.step for row in frames])
        self._put(f"{TRAJECTORY}/position/value", self.frames, [each * factors.length for each in positions])
        self._out.commit()
        total = self.frames + len(frames), self.samples + len(samples), self.events + len(events)
        file["kickdrift/committed"][...] = total  # in one page: the three are of one moment
        self._out.commit()
        self.frames, self.samples, self.events = total

    def check(self, observables: Mapping[str, NDArray[np.float64]]) -> str | None:
        """What is wrong with these observables, if anything; the first ones say what the others must be."""
        shapes = {name: value.shape for name, value in observables.items()}
        if clash := shapes.keys() & {"step", "time"}:
            return f"observables: {min(clash)!r} is a reserved name"
        if not self._shapes_known:
            self.shapes, self._shapes_known = shapes, True
            self.complete = not shapes
        if shapes != self.shapes:
            return f"observables: expected {self.shapes} as before, got {shapes}"
        return None

    def make_observables(self, file: h5py.File) -> None:
        """Datasets for the observables, in a copy of the file: see `h5md.Writer.extend`."""
        for name, shape in self.shapes.items():
            unit = observable_unit(name, self._units)
            element = file["observables"].create_group(name)
            for group, key in ((file[SAMPLES], name), (element, "value")):
                new_series(group, key, shape, "f8").attrs["unit"] = unit
            for key in ("step", "time"):
                element[key] = file[f"{TRAJECTORY}/position/{key}"]
        self.complete = True

    def _put(self, name: str, start: int, rows: Sequence[ArrayLike]) -> None:
        if rows:
            data = self._file[name]
            data.resize(start + len(rows), axis=0)
            data[start:] = np.asarray(rows)


def images_of(positions: Floats, within: Floats, box: Box) -> NDArray[np.int32]:
    """How many edges lie between positions (n, 3) and the same inside the box; 0 for bodies that are gone."""
    return np.nan_to_num(np.rint((positions - within) / np.array(box.lengths))).astype(np.int32)


ROUNDING = 1e-12  # relative, of times that went through the file's units


def same(point: tuple[int, float] | None, step: int, time: float) -> bool:
    """Whether a (step, time) is the one given; an adaptive run may look at several times inside one step."""
    return point is not None and point[0] == step and math.isclose(point[1], time, rel_tol=ROUNDING)


def before(time: float, other: float) -> bool:
    """Whether a time lies before another by more than rounding."""
    return time < other and not math.isclose(time, other, rel_tol=ROUNDING)

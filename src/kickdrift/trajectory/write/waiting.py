"""Rows of a run's file that wait in memory for the next write, column by column in their stored form.

Columns keep their memory when their rows are written, so a frame takes one pass over its positions and velocities.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from math import prod
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from kickdrift.model.box.box import Box
from kickdrift.model.state import Floats
from kickdrift.trajectory.layout.names import EVENT_WIDTH

Shapes = Mapping[str, tuple[int, ...]]


class EventRow(NamedTuple):
    """An event, in the system's units. A missing id is -1, a missing number nan."""

    time: float
    step: int
    ids: tuple[int, int]
    distance: float
    energy: float
    kind: str
    done: str

    @classmethod
    def of(cls, event: Mapping[str, Any]) -> EventRow:
        """Row of an entry of `Simulation.events`."""
        ids = (*event["ids"], -1, -1)[:2]
        distance, energy = (np.nan if event[key] is None else float(event[key]) for key in ("distance", "energy"))
        return cls(event["time"], event["step"], ids, distance, energy, event["kind"], event["done"])


class Column:
    """Rows of one shape and type, in memory that grows."""

    def __init__(self, shape: tuple[int, ...], dtype: str | np.dtype) -> None:
        self._rows: NDArray = np.empty((0, *shape), dtype)

    def next(self, first: int, count: int = 1) -> NDArray:
        """Memory of ``count`` rows after the ``first`` ones."""
        there, end = self._rows, first + count
        if end > len(there):
            self._rows = np.empty((max(end, 2 * first), *there.shape[1:]), there.dtype)
            self._rows[:first] = there[:first]
        return self._rows[first:end]

    def first(self, count: int) -> NDArray:
        """The first rows; a view."""
        return self._rows[:count]


class Looks:
    """Step, time and observables of samples or of frames.

    Attributes
    ----------
    steps, times : one number for each row
    """

    def __init__(self, shapes: Shapes) -> None:
        self.steps: list[int] = []
        self.times: list[float] = []
        self._shapes = shapes
        self._values = Column((sum(map(prod, shapes.values())),), "f8")

    def __len__(self) -> int:
        return len(self.steps)

    def add(self, steps: Sequence[int], times: Sequence[float], values: Floats) -> None:
        """Add rows of all observables' numbers, as `Waiting.row` makes them."""
        self._values.next(len(self), len(steps))[...] = values
        self.times[len(self) :] = times
        self.steps += steps

    def observables(self) -> dict[str, NDArray[np.float64]]:
        """Values (rows, …) of each observable."""
        there = self._values.first(len(self))
        found, first = {}, 0
        for name, shape in self._shapes.items():
            last = first + prod(shape)
            found[name] = there[:, first:last].reshape(len(there), *shape)
            first = last
        return found

    def clear(self) -> None:
        """Forget the rows and keep their memory."""
        self.steps, self.times = [], []


class Waiting:
    """Frames, samples and events that wait to be written.

    Parameters
    ----------
    vectors : type of each vector of the frames in the file, by its name
    factors : from each vector's unit in the system to its unit in the file
    n : number of particles

    Attributes
    ----------
    samples, frames : Looks
    boxes : a Box for each frame
    events : list of EventRow
    bytes : memory of the rows
    """

    def __init__(self, vectors: Mapping[str, np.dtype], factors: Mapping[str, float], n: int) -> None:
        self.samples, self.frames = Looks({}), Looks({})
        self._names: tuple[str, ...] = ()
        self.boxes: list[Box] = []
        self.events: list[EventRow] = []
        self._vectors = {name: Column((n, 3), dtype) for name, dtype in vectors.items()}
        self._factors = factors
        self.bytes, self._sample_bytes = 0, 16
        self._frame_bytes = sum(24 * n for name in vectors if name != "image")

    def __bool__(self) -> bool:
        return bool(self.samples or self.frames or self.events)

    def shape(self, shapes: Shapes) -> None:
        """Make room for observables of these shapes, before the first row."""
        self.samples, self.frames, self._names = Looks(shapes), Looks(shapes), tuple(shapes)
        self._sample_bytes = 16 + 8 * sum(map(prod, shapes.values()))

    def row(self, values: Mapping[str, Any]) -> Floats:
        """Numbers of all observables side by side, from a float or an array for each."""
        found: list[float] = []
        for name in self._names:
            value = values[name]
            if type(value) is float:
                found.append(value)
            else:
                found += value.tolist() if value.ndim == 1 else value.ravel().tolist()
        return np.array(found)

    def add_sample(self, step: int, time: float, values: Floats) -> None:
        """Add a sample with a `row` of observables."""
        self.samples.add([step], [time], values)
        self.bytes += self._sample_bytes

    def add_frame(self, step: int, time: float, values: Floats, box: Box, vectors: Mapping[str, NDArray]) -> None:
        """Add a frame with a `row` of observables, and vectors (n, 3) in the system's units. If frames have images,
        positions are stored inside the box."""
        if "image" in self._vectors:
            within = box.wrap(vectors["position"])
            vectors = {**vectors, "image": images_of(vectors["position"], within, box), "position": within}
        self._add_vectors(vectors, box, 1)
        self.frames.add([step], [time], values)

    def add_series(
        self, steps: Sequence[int], times: Sequence[float], values: Floats, box: Box, phases: Floats
    ) -> None:
        """Add samples, and frames of positions and velocities alone: ``phases`` (looks, 2, 3, n)."""
        x, v = phases[:, 0].transpose(0, 2, 1), phases[:, 1].transpose(0, 2, 1)
        self._add_vectors({"position": x, "velocity": v}, box, len(steps))
        for looks in (self.frames, self.samples):
            looks.add(steps, times, values)
        self.bytes += self._sample_bytes * len(steps)

    def _add_vectors(self, vectors: Mapping[str, NDArray], box: Box, count: int) -> None:
        """Add the vectors of ``count`` frames, before their observables."""
        k = len(self.frames)
        with np.errstate(over="ignore"):  # overflow of float32
            for name, column in self._vectors.items():
                factor, rows = self._factors[name], column.next(k, count)
                if factor == 1:
                    rows[...] = vectors[name]
                else:
                    np.multiply(vectors[name], factor, out=rows, casting="same_kind")
        self.boxes[k:] = [box] * count
        self.bytes += self._frame_bytes * count

    def vectors(self) -> dict[str, NDArray]:
        """Stored form (frames, n, 3) of each vector of the frames."""
        return {name: column.first(len(self.frames)) for name, column in self._vectors.items()}

    def add_events(self, rows: list[EventRow]) -> None:
        self.events += rows
        self.bytes += 8 * EVENT_WIDTH * len(rows)

    def clear(self) -> None:
        """Forget all rows."""
        self.samples.clear()
        self.frames.clear()
        self.boxes, self.events, self.bytes = [], [], 0


def images_of(positions: Floats, within: Floats, box: Box) -> NDArray[np.int32]:
    """Numbers of box edges between positions (n, 3) and the same positions inside the box; 0 for removed bodies."""
    return np.nan_to_num(np.rint(box.fractional(positions - within))).astype(np.int32)

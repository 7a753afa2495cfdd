"""Growing datasets of a run's file. Rows are added so that a kill at any moment leaves whole rows."""

from collections.abc import Mapping, Sequence
from typing import Any

import h5py
import numpy as np
from numpy.typing import ArrayLike, NDArray

from kickdrift.errors import InputError
from kickdrift.looks.columns import OWN
from kickdrift.model.box.box import Box
from kickdrift.model.state import Floats
from kickdrift.trajectory.file.openfile import OpenFile
from kickdrift.trajectory.layout import checksums, header
from kickdrift.trajectory.layout import problem_header as problem_header
from kickdrift.trajectory.layout.checksums import CHECKSUMS
from kickdrift.trajectory.layout.contents import Contents
from kickdrift.trajectory.layout.edges import EDGES, shape_in, shape_of, stored
from kickdrift.trajectory.layout.names import (
    EVENTS,
    KIND_BYTES,
    NEW_NAMES,
    SAMPLES,
    TRAJECTORY,
    FileUnits,
    new_series,
    observable_unit,
)
from kickdrift.trajectory.write.waiting import EventRow, Looks, Waiting

FACTORS = {"position": "length", "velocity": "velocity", "force": "force"}  # of vectors, to the file's units
Columns = Mapping[str, Sequence[Any] | NDArray]
VECTORS_NDIM = 3  # dimensions of vectors (frames, n, 3)


def in_order(
    vectors: Mapping[str, Floats], ids: NDArray[np.int64], wanted: NDArray[np.int64], absorbed: Mapping[int, int]
) -> Mapping[str, Floats] | None:
    """Vectors (n, 3) of the particles ``ids`` in the order ``wanted``; None if particles are too many or lacking.

    An absorbed body has the values of the body that absorbed it, a removed body nan. ``absorbed`` has the id of the
    former, and a negative number for the latter."""
    if ids is wanted or np.array_equal(ids, wanted):
        return vectors
    row_of = {int(each): row for row, each in enumerate(ids)}
    order = np.array([row_of.get(_survivor(int(each), absorbed), -1) for each in wanted])
    missing = order < 0
    if len(ids) > len(wanted) or any(int(each) not in absorbed for each in wanted[missing]):
        return None
    found = {name: vector[order] for name, vector in vectors.items()}
    for vector in found.values():
        vector[missing] = np.nan
    return found


def _survivor(body: int, absorbed: Mapping[int, int]) -> int:
    """The id of the body that now contains this body."""
    while body in absorbed:
        body = absorbed[body]
    return body


class Rows:
    """Frames, samples and events of an open file.

    Attributes
    ----------
    frames, samples, events : int
        Number of whole rows.
    shapes : dict of name -> shape
        Shapes of the observables; empty until the first sample.
    complete : bool
        Whether the file has a dataset for each observable; else `make_observables` comes first.
    ids : (n,) int64
        The order of the particles in every frame.
    write : tuple of str
        Which of "forces" and "images" the frames have.
    columns : dict of name -> unit
        The user's own observables.
    """

    def __init__(self, out: OpenFile, made: header.Outline | None = None) -> None:
        """``made`` is the file's content if this process has just created the file."""
        self._out = out
        contents = Contents(self._file, out.path)
        found = made or outline_of(contents)
        self._units = found.units
        self._factors = FileUnits.of(self._units)
        self.ids = found.ids
        self.frames, self.samples, self.events = found.committed
        self.shapes = {name: header.shape_of(contents, name) for name in found.observables}
        self.complete = True
        self._shapes_known = self.samples > 0 or bool(self.shapes)
        self._begun = bool(self.shapes)  # before this process
        self.write = found.options.write
        self.columns: Mapping[str, str] = {}
        self._growing, self._vectors, self._block = found.growing, found.vectors, 0
        self._box = found.box
        self._free = found.box.periodic and len(shape_in(contents, found.box)) == 2
        self._look_for_checksums()

    @property
    def _file(self) -> h5py.File:
        return self._out.h5

    def _look_for_checksums(self) -> None:
        """Write checksums if the file has them for all its rows. A file to which an older kickdrift has written gets no
        more."""
        if CHECKSUMS in self._file:
            rows = (("frame", self.frames), ("sample", self.samples), ("event", self.events))
            if all(self._out.dataset(f"{CHECKSUMS}/{name}").shape[0] >= count for name, count in rows):
                self._block = int(self._file[CHECKSUMS].attrs["particles"])

    def keep(self, rows: header.Committed) -> None:
        """Count no more than these rows; `cut` removes the others."""
        self._file["kickdrift/committed"][...] = rows
        self._out.commit()
        self.frames, self.samples, self.events = rows

    def cut(self) -> bool:
        """Remove incomplete rows and tell whether there were any.

        This frees chunks, which HDF5 would reuse: commit and reopen the file, so that HDF5 forgets the free chunks.
        """
        file, found = self._file, False
        rows = {"frame": self.frames, "sample": self.samples, "event": self.events}
        for table, names in self._growing.items():
            for name in (*names, f"{CHECKSUMS}/{table}"):
                if name in file and (data := self._out.dataset(name)).shape[0] > rows[table]:
                    data.resize(rows[table], axis=0)
                    found = True
        return found

    @property
    def last_frame(self) -> tuple[int, float] | None:
        """Step and time of the last frame."""
        return self._last(f"{TRAJECTORY}/position", self.frames, self._factors.time)

    @property
    def last_sample(self) -> tuple[int, float] | None:
        """Step and time of the last sample."""
        return self._last(SAMPLES, self.samples, 1.0)

    def _last(self, name: str, rows: int, factor: float) -> tuple[int, float] | None:
        if not rows:
            return None
        group = self._file[name]
        return int(group["step"][rows - 1]), float(group["time"][rows - 1]) / factor

    def name(self, number: int, names: Sequence[str]) -> None:
        """Write the names of new bodies, from this number on, counted from 0."""
        found = np.array([name.encode()[:KIND_BYTES] for name in names], f"S{KIND_BYTES}")
        self._out.dataset(f"kickdrift/system/{NEW_NAMES}")[number : number + len(found)] = found
        self._out.commit()

    def waiting(self) -> Waiting:
        """Room in memory for rows of this file."""
        factors = {name: getattr(self._factors, key) for name, key in FACTORS.items()}
        kinds = {name: self._file[place(name)].dtype for name in self._vectors}
        made = Waiting(kinds, factors | {"image": 1}, len(self.ids))
        made.shape(self.shapes)
        return made

    def add(self, waiting: Waiting) -> None:
        """Write the rows to the disk. A second call after an interrupt does no harm."""
        factors, frames, samples = self._factors, waiting.frames, waiting.samples
        self._put_all(self._checked("sample", self._sample_columns(samples)), self.samples)
        self._put_all(self._checked("event", self._event_columns(waiting.events)), self.events)
        named = {f"observables/{name}/value": values for name, values in frames.observables().items()}
        observables = self._columns(named)
        edges: dict[str, Sequence[ArrayLike]] = {}
        if self._box.periodic:
            boxes = {id(box): box for box in waiting.boxes}  # most frames share one
            made = {key: stored(box, self._free) * factors.length for key, box in boxes.items()}
            edges[EDGES] = [made[id(box)] for box in waiting.boxes]
        step, time = f"{TRAJECTORY}/position/step", f"{TRAJECTORY}/position/time"
        clock = self._columns({step: frames.steps, time: [time * factors.time for time in frames.times], **edges})
        vectors = {place(name): values for name, values in waiting.vectors().items() if len(frames)}
        columns = observables | clock | vectors
        if self._block and len(frames):
            columns[f"{CHECKSUMS}/frame"] = self._frame_sums(clock, observables, vectors)
        last = {name: columns.pop(name) for name in (step, place("position")) if name in columns}
        self._put_all(columns, self.frames)
        self._out.commit()
        # Positions and their steps grow last and in one write: MDAnalysis counts frames by the positions and ends a
        # loop by the steps. So after a kill MDAnalysis finds everything else in place.
        self._put_all(last, self.frames)
        self._out.commit()
        total = self.frames + len(frames), self.samples + len(samples), self.events + len(waiting.events)
        self._out.dataset("kickdrift/committed")[...] = total  # one page holds all three, so they change together
        self._out.commit()
        self.frames, self.samples, self.events = total

    def _sample_columns(self, samples: Looks) -> Columns:
        columns = {f"{SAMPLES}/{name}": values for name, values in samples.observables().items()}
        return {f"{SAMPLES}/step": samples.steps, f"{SAMPLES}/time": samples.times, **columns}

    def _event_columns(self, events: Sequence[EventRow]) -> Columns:
        columns: dict[str, Sequence[Any]] = {name: [getattr(row, name) for row in events] for name in EventRow._fields}
        texts = {name: [text.encode() for text in columns[name]] for name in ("kind", "done")}
        return {f"{EVENTS}/{name}": column for name, column in (columns | texts).items()}

    def _columns(self, given: Columns) -> dict[str, NDArray]:
        """Stored form of columns."""
        with np.errstate(over="ignore"):  # overflow of float32
            return {name: np.asarray(rows, self._out.dataset(name).dtype) for name, rows in given.items() if len(rows)}

    def _checked(self, table: str, given: Columns) -> dict[str, NDArray]:
        """Stored form of columns, with the column of their checksums."""
        columns = self._columns(given)
        if self._block and columns:
            columns[f"{CHECKSUMS}/{table}"] = checksums.sums_of_columns(list(columns.values()))
        return columns

    def _frame_sums(
        self, clock: Mapping[str, NDArray], observables: Mapping[str, NDArray], vectors: Mapping[str, NDArray]
    ) -> checksums.Sums:
        """Checksums (frames, columns): see `checksums`."""
        tables = [list(clock.values()), list(observables.values())]
        frames = len(tables[0][0])
        found = [checksums.sums_of_columns(t)[:, None] if t else np.zeros((frames, 1), "u8") for t in tables]
        values = (vectors[place(name)] for name in self._vectors)
        return np.concatenate([*found, *(checksums.sums_of_vectors(each, self._block) for each in values)], axis=1)

    def held(self, observables: dict[str, Any]) -> dict[str, Any]:
        """Observables without those of kickdrift's own that the file's first version did not write."""
        newer = {own.name for own in OWN} - self.shapes.keys() if self._begun else set()
        return {name: value for name, value in observables.items() if name not in newer} if newer else observables

    def check(self, observables: Mapping[str, Any]) -> str | None:
        """Say what is wrong with these observables, floats or arrays; None if nothing is. The first observables set
        the names and shapes."""
        shapes = {name: () if type(value) is float else value.shape for name, value in observables.items()}
        if shapes == self.shapes and self._shapes_known:
            return None
        if clash := shapes.keys() & {"step", "time"}:
            return f"observables: {min(clash)!r} is a reserved name"
        if self._shapes_known:
            return f"observables: expected {self.shapes} as before, got {shapes}"
        self.shapes, self._shapes_known = shapes, True
        self.complete = not shapes
        return None

    def check_box(self, box: Box) -> None:
        """Raise InputError for a box that does not fit the form of the file's edges."""
        if box is self._box:
            return
        if box.periodic_axes != self._box.periodic_axes or (shape_of(box) != shape_of(self._box) and not self._free):
            unit = self._units.symbol("length")
            raise InputError(
                f"{self._out.path}: its frames have a box like {self._box.described(unit)}, but this state's is "
                f"{box.described(unit)}"
            )

    def make_observables(self, file: h5py.File) -> None:
        """Make datasets for the observables in a copy of the file: see `h5md.Writer.extend`."""
        known = self.columns
        for name, shape in self.shapes.items():
            unit = known[name] if name in known else observable_unit(name, self._units)
            new_series(file[SAMPLES], name, shape, "f8").attrs["unit"] = unit
            if self._vectors:
                element = file["observables"].create_group(name)
                new_series(element, "value", shape, "f8").attrs["unit"] = unit
                for key in ("step", "time"):
                    element[key] = file[f"{TRAJECTORY}/position/{key}"]
        if self._block:
            checksums.name_observables(file, list(self.shapes))
        self.complete = True

    def _put_all(self, columns: Mapping[str, NDArray], start: int) -> None:
        for name, rows in columns.items():
            self._put(name, start, rows)

    def _put(self, name: str, start: int, rows: NDArray) -> None:
        # A dataset that stays open keeps chunks in memory: megabytes of vectors.
        data = (self._out.dataset(name) if rows.ndim < VECTORS_NDIM else self._file[name]).id
        data.set_extent((start + len(rows), *rows.shape[1:]))  # h5py's high-level calls take three times as long
        place = data.get_space()
        place.select_hyperslab((start, *(0 for _ in rows.shape[1:])), rows.shape)
        data.write(h5py.h5s.create_simple(rows.shape), place, np.ascontiguousarray(rows))


def outline_of(contents: Contents) -> header.Outline:
    """Outline of a file, of particles or of a Problem."""
    if contents.has(problem_header.PROBLEM):
        return problem_header.read(contents)
    return header.read(contents)


def place(vector: str) -> str:
    """Dataset of a vector of the frames."""
    return f"{TRAJECTORY}/{vector}/value"

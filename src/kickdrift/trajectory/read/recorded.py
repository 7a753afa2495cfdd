"""Contents of every run's file, of particles or of a Problem: samples, events, checkpoints, the plan and the report."""

import os
from collections.abc import Sequence
from functools import cached_property
from pathlib import Path
from types import TracebackType
from typing import Any, NamedTuple, Self

import h5py
import numpy as np
from numpy.typing import NDArray

from kickdrift.errors import InputError
from kickdrift.model.state import Floats
from kickdrift.model.units.unit_systems import UnitSystem
from kickdrift.trajectory.file.opening import open_to_read
from kickdrift.trajectory.layout import header
from kickdrift.trajectory.layout.checkpoints import CHECKPOINTS, COLUMNS, Table
from kickdrift.trajectory.layout.contents import Contents
from kickdrift.trajectory.layout.header import EVENT_COLUMNS, Committed, Outline
from kickdrift.trajectory.layout.options import FileOptions
from kickdrift.trajectory.read.damage import Checks, Damage


def event_rows(
    contents: Contents, count: int, whole: Sequence[int], ids: NDArray[np.int64], names: Sequence[str]
) -> list[dict[str, Any]]:
    """Events in the rows ``whole`` of a file with ``count`` events. Bodies have these ids (n,) and names, if any."""
    columns = {
        name: contents.read(header.event_column(contents, name, count), slice(count)).tolist() for name in EVENT_COLUMNS
    }
    found = []
    for k in whole:
        row = {name: values[k] for name, values in columns.items()}
        there = [each for each in row["ids"] if each >= 0]
        found.append(
            {
                "kind": row["kind"].decode(errors="ignore"),
                "time": row["time"],
                "step": row["step"],
                "bodies": [body_name(each, ids, names) for each in there],
                "ids": there,
                "distance": None if np.isnan(row["distance"]) else row["distance"],
                "energy": None if np.isnan(row["energy"]) else row["energy"],
                "done": row["done"].decode(errors="ignore"),
            }
        )
    return found


def body_name(id_: int, ids: NDArray[np.int64], names: Sequence[str]) -> str:
    """Name of the body with an id, or a text for a body without a name."""
    place = np.flatnonzero(ids == id_)
    return names[int(place[0])] if names and place.size else f"particle {id_}"


class Samples(NamedTuple):
    """Numbers, steps, times and observables of some samples."""

    rows: NDArray[np.int64]
    steps: NDArray[np.int64]
    times: Floats
    observables: dict[str, Floats]


class Recorded:
    """A run's file, open for reading, without what it holds beside samples, events and checkpoints.

    A class of such files says what kind of file it reads (``_begin``), what its header is (``_read_header``, which ends
    with `_read_rows`), and what its hash covers (``_hash``).
    """

    run_id: str
    every: int
    units: UnitSystem
    method: dict[str, Any]
    versions: dict[str, Any]
    report: dict[str, Any] | None
    half_written: dict[str, int]
    options: FileOptions
    ids: NDArray[np.int64]
    names: tuple[str, ...]
    own_names = frozenset(header.SHAPES)  # of the observables that kickdrift itself writes

    def __init__(self, path: str | os.PathLike[str]) -> None:
        self.path = Path(path)
        self._handle = open_to_read(self.path)
        try:
            self._contents = Contents(self._handle, self.path)
            with self._contents.guarded("its beginning"):
                self._check_kind(self._handle)
            self._read_header()
        except BaseException:
            self.close()
            raise

    def _check_kind(self, file: h5py.File) -> None:
        """An InputError where this is another kind of file."""
        raise NotImplementedError

    def _read_header(self) -> None:
        raise NotImplementedError

    def _hash(self, file: h5py.File) -> str:
        """Hash of all that the file says but once of its run."""
        raise NotImplementedError

    def _read_rows(self, found: Outline) -> None:
        """Read which rows exist, and which of them are damaged."""
        self.committed = found.committed
        self._samples = found.committed.samples
        self._observables = found.observables
        self._checks = Checks(self._contents, found)
        self._growing = found.growing

    @property
    def _file(self) -> h5py.File:
        return self._contents.file

    @property
    def closed(self) -> bool:
        """Whether the run came to its end, so that there is a report."""
        return self.report is not None

    # --- the run ---

    @property
    def plan(self) -> list[float]:
        """Numbers of the `run.plan.Plan` of the last run into this file; empty if unknown."""
        return header.plan_numbers(self._contents)

    @property
    def checkpoints(self) -> Table | None:
        """Checkpoints for a restart; None if the file has none."""
        if not self._contents.has(CHECKPOINTS):
            return None
        return Table(self._file, self.path)

    @property
    def events(self) -> list[dict[str, Any]]:
        """Events of the run, as in `Simulation.events`: kind, time, step, bodies, ids, distance, energy, done.

        Close approaches that were still going on at the run's end come last."""
        wrong = self._checks.events
        if wrong.any():
            raise self._damaged("event", int(np.argmax(wrong)))
        return self.whole_events()

    def whole_events(self) -> list[dict[str, Any]]:
        """The `events` that are not damaged."""
        whole = np.flatnonzero(~self._checks.events).tolist()
        found = event_rows(self._contents, self.committed.events, whole, self.ids, self.names)
        return found + list((self.report or {}).get("events", ()))

    # --- samples ---

    @property
    def observables(self) -> dict[str, Floats]:
        """Every observable at `sample_steps` and `sample_times`, shape (s,) or (s, …)."""
        return {name: self._sampled(name) for name in self._observables if self._samples}

    @property
    def columns(self) -> dict[str, tuple[tuple[int, ...], str]]:
        """Shape and unit of each of the user's columns, by name; ``observables`` has the values."""
        own = [name for name in self._observables if name not in self.own_names]
        return {name: (header.shape_of(self._contents, name), self.unit_of(name)) for name in own}

    def unit_of(self, observable: str) -> str:
        """Unit of an observable as text; "" for a plain number."""
        return header.unit_of(self._contents, observable, self.units)

    @property
    def sample_steps(self) -> NDArray[np.int64]:
        return self._sampled("step")

    @property
    def sample_times(self) -> Floats:
        return self._sampled("time")

    def whole_samples(self) -> Samples:
        """Samples that are not damaged."""
        kept = np.flatnonzero(~self._checks.samples)
        observables = {name: self._series(name)[kept] for name in self._observables}
        return Samples(kept, self._series("step")[kept], self._series("time")[kept], observables)

    def _sampled(self, name: str) -> NDArray:
        """Series of the samples. Raises an InputError that names the first damaged sample."""
        wrong = self._checks.samples
        if wrong.any():
            raise self._damaged("sample", int(np.argmax(wrong)))
        return self._series(name)

    def _series(self, name: str) -> NDArray:
        return self._contents.read(header.sampled(self._contents, name, self._samples), slice(self._samples))

    # --- damage, and going on ---

    @cached_property
    def _as_given(self) -> bool:
        """Whether everything that was written once is unchanged, by the file's hash. True without a hash."""
        with self._contents.guarded("kickdrift"):
            return bool(self._file["kickdrift"].attrs.get("sha256") in (None, self._hash(self._file)))

    @property
    def unchanged(self) -> bool:
        """Whether everything that is written once is unchanged since the run began, by the file's hash."""
        return self._as_given

    def damage(self) -> Damage:
        """Damaged frames, samples, events and checkpoints. Reads the whole file."""
        table = self.checkpoints
        checks = self._checks
        rows = [np.flatnonzero(wrong).tolist() for wrong in (checks.frames, checks.samples, checks.events)]
        unchecked = self.committed.frames - checks.checked
        return Damage(rows[0], rows[1], rows[2], table.damaged() if table else [], unchecked)

    def _damaged(self, what: str, row: int, steps: NDArray | None = None) -> InputError:
        step = "" if steps is None else f" (step {steps[row]})"
        return InputError(f"{self.path}: damaged: {what} {row}{step} is not what was written")

    @cached_property
    def kept(self) -> Committed:
        """Rows after which a resumed run continues: all but those of a damaged end."""
        frames, samples, events = self.committed
        while samples and self._checks.samples[samples - 1]:
            samples -= 1
        return Committed(frames, samples, events)

    @property
    def last_point(self) -> tuple[int, float] | None:
        """Step and time of the last sample among those `kept`."""
        row = self.kept.samples - 1
        return None if row < 0 else (int(self._series("step")[row]), float(self._series("time")[row]))

    def check_growing(self) -> None:
        """Raise InputError if rows cannot be added because another program has rewritten the file."""
        contents, (frames, samples, events) = self._contents, self.committed
        for name in self._observables:
            if self._growing["frame"]:
                header.framed(contents, name, frames)
            header.sampled(contents, name, samples)
        for name in EVENT_COLUMNS:
            header.event_column(contents, name, events)
        contents.dataset("kickdrift/report", "u1", (None,))
        checkpoints = [f"{CHECKPOINTS}/{name}" for name in COLUMNS] if self._contents.has(CHECKPOINTS) else []
        with self._contents.guarded("its beginning"):
            layout = self._file.id.get_create_plist()
            if layout.get_version()[0] or layout.get_sizes() != (8, 8) or layout.get_userblock():
                raise InputError(f"{self.path}: was rewritten by another program, so the run cannot continue it")
        for name in (*(name for names in self._growing.values() for name in names), "kickdrift/report", *checkpoints):
            with self._contents.guarded(name):
                data = self._file[name]
                if data.chunks is None or data.maxshape[0] is not None:
                    raise InputError(f"{self.path}: {name} has a fixed size, so the run cannot continue this file")

    def close(self) -> None:
        self._handle.close()

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

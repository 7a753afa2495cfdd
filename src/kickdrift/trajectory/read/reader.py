"""Reader of a run's file: `open` returns a Run, the sequence of its frames."""

import os
from collections.abc import Iterable, Sequence
from functools import cached_property
from typing import Any

import h5py
import numpy as np
from numpy.typing import NDArray

from kickdrift.errors import InputError
from kickdrift.looks.columns import BODY_MASSES
from kickdrift.model.box.box import Box
from kickdrift.model.checks.values import path_text
from kickdrift.model.state import Floats
from kickdrift.model.system import System
from kickdrift.model.units.file_units import FileUnits
from kickdrift.trajectory.layout import edges, header
from kickdrift.trajectory.layout.checkpoints import behind
from kickdrift.trajectory.layout.header import CLOCK, Committed
from kickdrift.trajectory.layout.names import TRAJECTORY, check_kind, run_hash, system_hash
from kickdrift.trajectory.read.frames import EnergySeries, Frames, as_slice, energies_of
from kickdrift.trajectory.read.recorded import Recorded
from kickdrift.trajectory.read.tables import ShownRun

CHANGED = "its system was changed after the run began (kickdrift/system, units, method, masses, ids or species)"


class Run(Recorded, Frames, ShownRun):
    """A run's file, open for reading: a context manager, and the sequence of all its frames.

    All values are in the system's own units, although the file may name other units for other programs. Observables are
    those of the samples, which are at least as dense as the frames; ``run[:]`` has the observables at the frames.

    Attributes
    ----------
    path : Path
    run_id : str
    every : int
        Steps between samples.
    units : UnitSystem
    nominal_units : bool
        Whether the file uses angstrom and ps as stand-ins for units that other programs do not know.
    box : Box
        Box of the System that the run began with. A barostat changes the box: each frame has its own.
    species : tuple of str
    species_index : (n,) int32 into `species`
    names : tuple of str
        Names of the bodies, if any.
    masses : (n,) float64
    charges : (n,) float64; None if the particles have no charges
    ids : (n,) int64
    system_source : str
        Text of the system file; empty if there was none.
    system_record, method, versions : dict
    options : FileOptions
        How the file is written, without ``flush``.
    packed : bool
        Whether frames are compressed. Compression happens at the end of a run.
    report : dict or None
        The run's report; None if the run did not finish.
    """

    def _check_kind(self, file: h5py.File) -> None:
        check_kind(self.path, file)

    def _hash(self, file: h5py.File) -> str:
        return run_hash(file)

    def _read_header(self) -> None:
        found = header.read(self._contents)
        self.run_id, self.every, self.units, self.box = found.run_id, found.every, found.units, found.box
        self._factors = FileUnits.of(self.units)
        self.nominal_units = self._factors.nominal
        self.species, self.species_index = found.species, found.species_index
        self.masses, self.charges, self.ids = found.masses, found.charges, found.ids
        self.system_source, self.system_record = found.source, found.record
        self.names: tuple[str, ...] = found.names
        self.method, self.versions = found.method, found.versions
        self.options, self.packed = found.options, found.packed
        self.report, self.half_written = found.report, found.half_written
        # Rows after the last commit may be incomplete after a kill; they do not count.
        Frames.__init__(self, None, range(found.committed.frames))
        self._read_rows(found)
        self._written = found.vectors
        clock = (self._contents.series(f"{TRAJECTORY}/position/{key}", kind, len(self)) for key, kind in CLOCK)
        self.all_steps, times = (self._contents.read(series, slice(len(self))) for series in clock)
        self.all_times: Floats = times / self._factors.time
        self._wrong_clock = self._checks.clock
        self._checks.refuse_uncounted()

    def __repr__(self) -> str:
        return f"<Run {self.path}: {len(self)} frames of {len(self.ids)} particles>"

    def vectors(self, what: str, frames: slice, particles: slice = slice(None)) -> Floats:
        """Unwrapped "positions", "velocities" or "forces" of some frames and particles, shape (f, n, 3), in one read.
        Raises InputError if the run did not write forces."""
        name, factor = {
            "positions": ("position", self._factors.length),
            "velocities": ("velocity", self._factors.velocity),
            "forces": ("force", self._factors.force),
        }[what]
        if name not in self._written:
            raise InputError(f"{self.path}: holds no {what}; a run writes these only on request")
        self.refuse_changed()
        rows = range(*frames.indices(len(self)))
        values: Floats = self._checked(name, rows, particles).astype(np.float64, copy=False)
        if factor != 1.0:
            values = values / factor
        if what == "positions" and self.box.periodic and "images" in self.options.write:
            values += edges.crossed(self._checked("image", rows, particles), self.box, self.boxes_of(rows))
        return values

    def boxes_of(self, rows: range) -> list[Box]:
        """Box of each of these frames, in ascending order: that very `box` where nothing has changed it."""
        if not rows or not self.box.periodic:
            return [self.box] * len(rows)
        self.check_clock(rows)
        return edges.boxes(self._contents, self.box, self._factors.length, as_slice(rows))

    @cached_property
    def box_varies(self) -> bool:
        """Whether any frame has another box than the System that the run began with."""
        return any(box is not self.box for box in self.whole_boxes()[2])

    def whole_boxes(self) -> tuple[NDArray[np.int64], Floats, list[Box]]:
        """Steps, times and boxes of the frames that are not damaged."""
        whole, found = ~self._wrong_clock, [self.box] * len(self)
        if self.box.periodic:
            found = edges.boxes(self._contents, self.box, self._factors.length, slice(len(self)), whole)
        return self.all_steps[whole], self.all_times[whole], [found[k] for k in np.flatnonzero(whole)]

    def _checked(self, name: str, rows: range, particles: slice) -> NDArray:
        """Stored vectors (f, k, 3) of frames. Raises an InputError that names the first damaged frame."""
        self.check_clock(rows)
        block, n = self._checks.block, len(self.ids)
        low, high, step = particles.indices(n)
        begin, end = low // block * block, min(n, -(-high // block) * block)
        data = self._contents.anything(f"{TRAJECTORY}/{name}/value")
        chosen = slice(rows.start, rows[-1] + 1 if rows else rows.start, rows.step), slice(begin, end)
        try:
            found = self._contents.read(data, chosen)
        except InputError:
            if len(rows) == 1:
                raise self._damaged("frame", rows[0], self.all_steps) from None
            for row in rows:
                self._checked(name, range(row, row + 1), particles)  # raises an error that names the frame
            raise
        wrong = self._checks.vectors(name, rows, found, begin // block)
        if wrong.any():
            raise self._damaged("frame", rows[int(np.argmax(wrong))], self.all_steps)
        return found[:, low - begin : high - begin : step]

    def framed(self, frames: slice) -> dict[str, Floats]:
        """Every observable at some frames, shape (f,) or (f, …)."""
        rows = range(*frames.indices(len(self)))
        wrong = self._checks.observables(rows)
        if wrong.any():
            raise self._damaged("frame", rows[int(np.argmax(wrong))], self.all_steps)
        series = {name: header.framed(self._contents, name, len(self)) for name in self._observables if len(self)}
        return {name: self._contents.read(data, frames) for name, data in series.items()}

    def check_clock(self, rows: range) -> None:
        """Raise InputError if the step or time of one of these frames is damaged."""
        wrong = self._wrong_clock[as_slice(rows)]
        if wrong.any():
            raise self._damaged("frame", rows[int(np.argmax(wrong))])

    def damaged_frames(self, frames: Iterable[int] | None = None) -> list[int]:
        """Numbers of the damaged frames, of all or of these ones. Reads them whole."""
        if frames is None:
            return np.flatnonzero(self._checks.frames).tolist()
        return [int(k) for k in frames if self._checks.frame(int(k))]

    def refuse_changed(self) -> None:
        """Raise InputError if anything that gives the numbers their meaning has changed, by the file's hash."""
        if not self._as_given:
            raise InputError(f"{self.path}: damaged: {CHANGED}")

    @property
    def unchanged(self) -> bool:
        """Whether the system in the file is unchanged since the run began, by its hash."""
        with self._contents.guarded("kickdrift/system"):
            then = self._file["kickdrift/system"].attrs.get("sha256")
            return bool(self._as_given and then == system_hash(self._file))

    @property
    def exact(self) -> bool:
        """Whether stored positions and velocities are exact to the last bit."""
        real = self._factors.length == self._factors.time == 1.0
        return real and self.options.store == "float64" and "images" not in self.options.write

    @property
    def energies(self) -> EnergySeries:
        """Kinetic, potential and total energy at `sample_times`. Raises InputError if they were not written."""
        return energies_of(self, self.sample_times, self.observables)

    def to_pandas(self) -> Any:
        """A pandas DataFrame with a row for each sample: step, time and every observable (``momentum_x``, …).

        The unit of each column is in ``attrs["units"]``. Raises InputError if pandas is not installed.
        """
        from kickdrift.trajectory.read.tables import data_frame

        return data_frame(self, self.sample_steps, self.sample_times, self.observables)

    def to_xarray(self) -> Any:
        """An xarray Dataset of everything that was written over time, with units as attributes.

        Positions and velocities have dimensions (frame, particle, axis), masses and species (particle), and observables
        (sample, …). Samples have coordinates sample_step and sample_time. Raises InputError if xarray is not installed.
        """
        from kickdrift.trajectory.read.tables import dataset

        series = {name: ("sample", values) for name, values in self.observables.items()}
        clock = {"sample_step": self.sample_steps, "sample_time": self.sample_times}
        return dataset(self, self, series, clock)

    def system(self) -> System:
        """The System that the run began with, from the file alone. ``run[k].system`` is the System at a frame."""
        from kickdrift.trajectory.layout.record import system_of

        self.refuse_changed()
        return system_of(self)

    @cached_property
    def kept(self) -> Committed:
        """Rows after which a resumed run continues: all but those of a damaged end."""
        frames, samples, events = self.committed
        while frames and (self._checks.clock[frames - 1] or self._checks.frame(frames - 1)):
            frames -= 1
        while samples and self._checks.samples[samples - 1]:
            samples -= 1
        if (frames, samples) == self.committed[:2]:
            return self.committed
        at = list(zip(self._series("step").tolist(), self._series("time").tolist(), strict=True))
        there = list(zip(self.all_steps.tolist(), self.all_times.tolist(), strict=True))
        if frames < len(self):  # a damaged frame comes after the last whole frame
            last = there[frames - 1] if frames else (-1, 0.0)
            while samples and behind(last, at[samples - 1]):
                samples -= 1
        while frames and not (samples and not behind(at[samples - 1], there[frames - 1])):
            frames -= 1
        return Committed(frames, samples, events)

    @property
    def initial_phase(self) -> Floats:
        """Positions and velocities (2, 3, n) of the System at the start of the run."""
        return self._contents.array("kickdrift/system/phase", "f8", (2, 3, len(self.ids)))

    def universe(self) -> Any:
        """An MDAnalysis Universe of this file, with names, types and masses; its units are nominal if the file's
        are."""
        from kickdrift.trajectory.read.universe import universe

        return universe(self)


def open(path: str | os.PathLike[str]) -> Run:
    """Open a run's file as a Run. For another file, raises an InputError that says what the file is instead."""
    return Run(path_text("path", path))


def masses_held(run: Run, frames: Sequence[int] | Any, x: Floats, v: Floats) -> Floats:
    """Masses (k, n) at frames, in order, with positions and velocities (k, n, 3), which become nan for absent bodies.

    The mass of an absent body is 0. A file in which collisions may change bodies has the masses; in other
    files they follow from the positions.
    """
    first, last = int(frames[0]), int(frames[-1])
    recorded = run[first : last + 1].observables.get(BODY_MASSES)
    if recorded is None:
        return _from_positions(x, v, run.masses)
    masses = np.asarray(recorded)[np.asarray(frames) - first]
    gone = np.isnan(masses)
    x[gone] = v[gone] = np.nan
    return np.nan_to_num(masses)


def _from_positions(x: Floats, v: Floats, masses: Floats) -> Floats:
    """Masses (k, n) at each frame. In a file, an absorbed body has its survivor's position; here x and v of absorbed
    and removed bodies become nan."""
    there = np.isfinite(x[:, :, 0])
    found = np.where(there, masses, 0.0)
    last = len(x) - 1 - np.argmax(there[::-1], axis=0)
    phase = np.concatenate([x, v], axis=2)
    _, which, sizes = np.unique(phase[last, np.arange(len(masses))], axis=0, return_inverse=True, return_counts=True)
    for group in np.flatnonzero(sizes > 1):
        members = np.flatnonzero(which.ravel() == group)
        members = members[np.argsort(-masses[members], kind="stable")]
        for rank, body in enumerate(members):
            for heavier in members[:rank]:
                absorbed = np.all(phase[:, body] == phase[:, heavier], axis=1) & (found[:, heavier] > 0)
                found[absorbed, heavier] += found[absorbed, body]
                found[absorbed, body] = 0.0
                x[absorbed, body] = v[absorbed, body] = np.nan
    return found

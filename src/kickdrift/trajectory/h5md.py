"""A run's file: H5MD 1.1 that MDAnalysis opens with no topology and no keyword, and that survives a kill.

Layout (n particles, f frames, s samples)::

    h5md                        version [1, 1]; author/name; creator/name, version
    particles/trajectory        position/value  (f, n, 3) float64, unwrapped, unit "Angstrom"
                                velocity/value  (f, n, 3) float64, unit "Angstrom ps-1"
                                position/step (f,) int64, position/time (f,) float64, unit "ps"; velocity and
                                box/edges link to both
                                box             dimension, boundary; edges/value (f, 3) where it is periodic
                                species (n,) enumeration, mass (n,) float64, id (n,) int64
    observables/NAME            value (f, …), one row for each frame; step and time link to position's
    kickdrift                   schema, run_id, every; committed [frames, samples]; closed
             /units             the true units and constants, the factors to stored ones, whether these are nominal
             /method /versions  JSON
             /system            source (the system file's text), record (JSON), phase (2, 3, n) at the start
             /samples           step, time, NAME: (s, …), in true units; at least as dense as the frames
             /events            where there were any, e of them: time (e,), step (e,), ids (e, 2), distance (e,), energy
                                taken out (e,), kind and done (e,) text, in true units; committed
             /report            JSON, written when a run ends
             /plan (7,)         how far the last `Simulation.run` was to go, and how often it looks (`run_plan.Plan`)
             /checkpoints       what a run is taken up again from (`kickdrift.trajectory.checkpoints`); committed

Frames have n rows whatever happens: a body that another has absorbed is written at that one's place and velocity from
then on, and one that was removed as NaN. Masses are those at the start.

The rows of ``observables`` belong to the frames, since MDAnalysis indexes them by frame; the denser series is under
``kickdrift/samples``. ``committed`` says how many rows are whole: it is written after the rows themselves are flushed.
Positions and times are those of the run times the factors in ``kickdrift/units``, which are exactly 1 but for ``si``.
"""

from __future__ import annotations

import math
import os
import time
import uuid
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from types import TracebackType
from typing import Any, Self

import h5py
import numpy as np
from numpy.typing import ArrayLike

from kickdrift.errors import InputError, RunError
from kickdrift.state import Floats, State
from kickdrift.system import System
from kickdrift.trajectory import creation, diskspace, reader
from kickdrift.trajectory.checkpoints import Checkpoint, Stored, Table, encoded
from kickdrift.trajectory.layout import EVENT_WIDTH, header_image, text
from kickdrift.trajectory.record import to_json
from kickdrift.trajectory.rows import EventRow, FrameRow, Rows, SampleRow

FLUSH_BYTES = 8 * 2**20
FLUSH_SECONDS = 10.0
CHECKPOINT_SHARE = 0.25  # of what is written may be checkpoints, but for the first and the last of a run
CHECKPOINT_SECONDS = 60.0  # after which there is one all the same
_writing: set[tuple[int, int]] = set()  # device and inode; HDF5's lock does not hold between two writers in one process


class Writer:
    """Writes one run's file; a context manager.

    Samples and frames are kept in memory until there are ``flush_bytes`` of them or ``flush_seconds`` have passed, so
    that is what a kill can cost. A disk that fills up is a RunError, after which the file holds all that was flushed.

    Parameters
    ----------
    path : a new file with the suffix .h5md, in a folder that exists
    system : System
    method : what the Simulation says of itself (integrator, dt, threads, seed, …), stored as JSON
    every : steps between samples, stored for a later continuation
    overwrite : replace a file of that name, once the new one stands
    checkpoint : gives a `Checkpoint` of the state appended last, or before the first of the start; one is written into
        the new file at once, then with some of the flushes, and when the file is closed
    plan : how far the run is to go (`run_plan.Plan.numbers`)

    Attributes
    ----------
    run_id : str
        Names this run; whoever knows it may continue the file (`append_to`).
    report : dict or None
        Set it before the file is closed, and it is stored as JSON; a file without one is that of an unfinished run.
    last_sample, last_frame : (step, time) or None
        Steps of the last sample and of the last frame appended.
    absorbed : dict of id -> id
        Of bodies that states may lack: who took them up, or a negative number where they were removed.
    """

    def __init__(
        self,
        path: str | os.PathLike[str],
        system: System,
        *,
        method: Mapping[str, Any],
        every: int,
        overwrite: bool = False,
        flush_bytes: int = FLUSH_BYTES,
        flush_seconds: float = FLUSH_SECONDS,
        author: str = "N/A",
        checkpoint: Callable[[], Checkpoint] | None = None,
        plan: Sequence[float] = (),
    ) -> None:
        image = header_image(
            system,
            method=dict(method),
            every=every,
            run_id=uuid.uuid4().hex,
            author=author,
            flush_frames=max(1, flush_bytes // (48 * len(system))),
            plan=plan,
            start=_stored(checkpoint()) if checkpoint else None,
        )
        self._open(creation.create(Path(path), image, overwrite=overwrite), flush_bytes, flush_seconds, checkpoint)

    @classmethod
    def append_to(
        cls,
        path: str | os.PathLike[str],
        run_id: str,
        *,
        flush_bytes: int = FLUSH_BYTES,
        flush_seconds: float = FLUSH_SECONDS,
        checkpoint: Callable[[], Checkpoint] | None = None,
        plan: Sequence[float] = (),
    ) -> Self:
        """Open a file to continue it; the InputError of a file that is not this run's names the other.

        Rows that a kill left half written are cut off.
        """
        path = Path(path)
        with reader.open(path) as run:
            if run.run_id != run_id:
                raise InputError(f"{path}: is the file of another run; give another name, or overwrite it")
        writer = cls.__new__(cls)
        writer._open(path, flush_bytes, flush_seconds, checkpoint)
        if plan:
            assert writer._file is not None
            writer._file["kickdrift/plan"][...] = plan
            writer._file.flush()
        return writer

    def _open(
        self,
        path: Path,
        flush_bytes: int,
        flush_seconds: float,
        checkpoint: Callable[[], Checkpoint] | None,
    ) -> None:
        self.path, self.flush_bytes, self.flush_seconds = path, flush_bytes, flush_seconds
        self.report: dict[str, Any] | None = None
        self.absorbed: Mapping[int, int] = {}
        status = path.stat()
        self._key = (status.st_dev, status.st_ino)
        if self._key in _writing:
            raise creation.in_use(path)
        self._file: h5py.File | None = creation.open_to_write(path, cache_bytes=flush_bytes + 2 * 2**20)
        self._descriptor = os.open(path, os.O_RDWR)
        _writing.add(self._key)
        self._failed = False
        own = self._file["kickdrift"]
        self.run_id: str = own.attrs["run_id"]
        self._rows = Rows(self._file)
        self._checkpoint, self._checkpoints = checkpoint, Table(self._file, path)
        self._checkpoints.cut()
        self._checkpointed_at, self._since_checkpoint, self._checkpoint_size = time.monotonic(), 0, 0
        own["closed"][0] = 0
        self._file.flush()
        self.last_sample, self.last_frame = self._rows.last_sample, self._rows.last_frame
        self._clear()

    def append(self, state: State, observables: Mapping[str, ArrayLike] | None = None, *, frame: bool = True) -> None:
        """Add a sample of the observables at the state's time and, if ``frame``, positions and velocities.

        Observables are numbers or arrays in the system's units, the same names each time. A step and time
        that the file already ends with are not written twice; what lies before is an InputError.
        """
        if self._file is None:
            raise RunError(f"{self.path}: the file is closed")
        step, values = state.steps_done, {name: np.array(v, "f8") for name, v in (observables or {}).items()}
        last = self.last_sample
        if last is not None and (step < last[0] or (step == last[0] and before(state.time, last[1]))):
            raise InputError(f"{self.path}: ends at step {last[0]}; step {step} cannot follow it")
        if wrong := self._rows.check(values):
            raise InputError(wrong)
        if frame and not same(self.last_frame, step, state.time):
            x, v = self._in_order(state)
            self._frames.append(FrameRow(step, state.time, x, v, state.box.lengths, values))
            self._buffered += x.nbytes + v.nbytes
            self.last_frame = step, state.time
        if not same(last, step, state.time):
            self._samples.append(SampleRow(step, state.time, values))
            self._buffered += 16 + sum(value.nbytes for value in values.values())
            self.last_sample = step, state.time
        if self._buffered >= self.flush_bytes or time.monotonic() - self._flushed_at >= self.flush_seconds:
            self.flush()

    def append_event(self, event: Mapping[str, Any]) -> None:
        """Add an entry of `Simulation.events`; it is written with the rows of the next flush."""
        self._events.append(EventRow.of(event))
        self._buffered += 8 * EVENT_WIDTH

    def _in_order(self, state: State) -> tuple[Floats, Floats]:
        """Positions and velocities in the file's order of the particles, those of bodies that are gone filled in."""
        ids = self._rows.ids
        if np.array_equal(state.ids, ids):
            return state.positions, state.velocities
        row_of = {int(each): row for row, each in enumerate(state.ids)}
        order = np.array([row_of.get(self._survivor(int(each)), -1) for each in ids])
        missing = order < 0
        if len(state) > len(ids) or any(int(each) not in self.absorbed for each in ids[missing]):
            raise InputError(f"{self.path}: holds {len(ids)} particles; this state has {len(state)}")
        x, v = state.positions[order], state.velocities[order]
        x[missing] = v[missing] = np.nan
        return x, v

    def _survivor(self, body: int) -> int:
        """Who a body is part of now."""
        while body in self.absorbed:
            body = self.absorbed[body]
        return body

    def _clear(self) -> None:
        self._samples: list[SampleRow] = []
        self._frames: list[FrameRow] = []
        self._events: list[EventRow] = []
        self._buffered = 0
        self._flushed_at = time.monotonic()

    def flush(self, *, final: bool = False) -> None:
        """Bring everything appended so far to the file, where a kill cannot reach it; ``final`` with a checkpoint."""
        if self._file is None:
            raise RunError(f"{self.path}: the file is closed")
        if self._failed:
            raise RunError(f"{self.path}: an earlier write failed; nothing more can be written")
        self._since_checkpoint += self._buffered
        stored = self._due(final)
        if self._samples or self._frames or self._events or stored:
            room = self._rows.room(self._buffered, len(self._samples), len(self._events))
            self._reserve(self._file, room + (stored.room if stored else 0))
            try:
                self._rows.add(self._frames, self._samples, self._events)
                if stored:
                    self._checkpoints.add(stored)
            except (OSError, RuntimeError) as error:
                self._failed = True
                raise RunError(f"{self.path}: writing failed: {error}") from None
            diskspace.release(self._descriptor, self._file.id.get_filesize())
        self._clear()

    def _due(self, final: bool) -> Stored | None:
        """A checkpoint of what was appended last, where it is time for one."""
        steps, times = self._checkpoints.steps, self._checkpoints.times
        last = (int(steps[-1]), float(times[-1])) if len(steps) else None
        if self._checkpoint is None or self.last_sample is None or same(last, *self.last_sample):
            return None
        grown = CHECKPOINT_SHARE * self._since_checkpoint >= self._checkpoint_size
        if not (final or grown or time.monotonic() - self._checkpointed_at >= CHECKPOINT_SECONDS):
            return None
        stored = _stored(self._checkpoint())
        self._checkpointed_at, self._since_checkpoint, self._checkpoint_size = time.monotonic(), 0, stored.size
        return stored

    def _reserve(self, file: h5py.File, size: int) -> None:
        """Make sure of the room for ``size`` more bytes, in the very file that is open."""
        try:
            found = self.path.stat()
            if (found.st_dev, found.st_ino) != self._key:
                raise FileNotFoundError
            diskspace.reserve(self.path, self._descriptor, file.id.get_filesize(), size)
        except FileNotFoundError:
            self._failed = True
            raise RunError(f"{self.path}: was removed or replaced while the run was writing to it") from None
        except RunError as error:
            self._failed = True
            frames, last = self._rows.frames, self._rows.last_frame
            kept = "holds no frame yet" if last is None else f"holds {frames} frames, up to step {last[0]}"
            raise RunError(f"{error}; the file is whole and {kept}") from None

    def close(self, *, whole: bool = True) -> None:
        """Flush, store the report if there is one, and close; a second call does nothing. A run that came to its end
        is ``whole``: it is given a last checkpoint."""
        if self._file is None:
            return
        file = self._file
        try:
            if not self._failed:
                self.flush(final=whole)
                if self.report is not None:
                    self._put_report(file, to_json(self.report))
        finally:
            self._file = None
            file.close()
            os.close(self._descriptor)
            _writing.discard(self._key)

    def _put_report(self, file: h5py.File, report: str) -> None:
        self._reserve(file, len(report) + 64 * 1024)
        text(file["kickdrift"], "report", report)
        file.flush()
        file["kickdrift/closed"][0] = 1
        file.flush()
        diskspace.release(self._descriptor, file.id.get_filesize())

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        try:
            self.close(whole=error is None)
        except RunError:
            if error is None:  # else the first error is the one to tell
                raise


def _stored(checkpoint: Checkpoint) -> Stored:
    return Stored(checkpoint["step"], checkpoint["time"], encoded(checkpoint))


ROUNDING = 1e-12  # relative, of times that went through the file's units


def same(point: tuple[int, float] | None, step: int, time: float) -> bool:
    """Whether a (step, time) is the one given; an adaptive run may look at several times inside one step."""
    return point is not None and point[0] == step and math.isclose(point[1], time, rel_tol=ROUNDING)


def before(time: float, other: float) -> bool:
    """Whether a time lies before another by more than rounding."""
    return time < other and not math.isclose(time, other, rel_tol=ROUNDING)

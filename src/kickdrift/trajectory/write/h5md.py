"""A run's file in H5MD 1.1, which MDAnalysis opens without topology or keyword and which survives a kill.

``docs/file-format.md`` describes its content. Every frame has n rows. After a merger, the rows of an absorbed body hold
the position and velocity of the body that absorbed it. Rows of a removed body are NaN, and so are the rows of a body
before a collision has made it.
"""

import os
import signal
import time
import uuid
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from types import TracebackType
from typing import Any, ClassVar, Self

import h5py
import numpy as np
from numpy.typing import ArrayLike

from kickdrift.disk.interrupt import interruptible
from kickdrift.errors import InputError, RunError
from kickdrift.model.state import Floats, State
from kickdrift.model.system import System
from kickdrift.trajectory.file import packing
from kickdrift.trajectory.file.openfile import OpenFile, create, opening, refuse_second
from kickdrift.trajectory.layout.checkpoints import Checkpoint, Stored, Table, behind, same
from kickdrift.trajectory.layout.contents import Contents
from kickdrift.trajectory.layout.header import Committed, Outline, outline_of
from kickdrift.trajectory.layout.names import add_plan, header_image
from kickdrift.trajectory.layout.options import FileOptions
from kickdrift.trajectory.layout.record import to_json
from kickdrift.trajectory.read import reader
from kickdrift.trajectory.read.recorded import Recorded
from kickdrift.trajectory.write.continued import Cadence, Described, check_continued, units_of
from kickdrift.trajectory.write.rows import Rows, in_order
from kickdrift.trajectory.write.waiting import EventRow

FLUSH_BYTES = 8 * 2**20


class Writer:
    """Writer of one run's file; a context manager.

    Samples and frames stay in memory until they take ``flush_bytes`` or ``options.flush`` seconds have passed. A kill
    loses at most these. A full disk raises RunError; the file then holds everything up to the last flush.

    Parameters
    ----------
    path : a new file with the suffix .h5md, in a folder that exists
    system : System
    method : the Simulation's own description (integrator, dt, threads, seed, …), stored as JSON
    every : steps between samples, stored for a later continuation
    overwrite : replace a file of this name once the new file is complete
    options : FileOptions
    checkpoint : returns a `Checkpoint` of the state appended last, or of the start if nothing was appended. A new file
        begins with a checkpoint; more are written with some of the flushes and at the end
    plan : the planned length of the run (`run.plan.Plan.numbers`)
    columns : the user's own columns among the observables, with the shape and the unit of each

    Attributes
    ----------
    run_id : str
        Identity of this run; it is needed to continue the file (`append_to`).
    report : dict or None
        Stored as JSON when the file is closed. A file without a report is of an unfinished run.
    last_sample, last_frame : (step, time) or None
        Steps of the last sample and of the last frame appended.
    absorbed : dict of id -> id
        Bodies that states may lack: the id of the body that absorbed each, or a negative number for a body that was
        removed or does not exist yet.
    """

    units: ClassVar[dict[str, str]] = {}  # of observables of kickdrift's own that no unit system knows

    def __init__(
        self,
        path: str | os.PathLike[str],
        system: System,
        *,
        method: Mapping[str, Any],
        every: int,
        overwrite: bool = False,
        options: FileOptions | None = None,
        flush_bytes: int = FLUSH_BYTES,
        author: str = "N/A",
        checkpoint: Callable[[], Checkpoint] | None = None,
        plan: Sequence[float] = (),
        columns: Mapping[str, Described] | None = None,
    ) -> None:
        options, run_id = options or FileOptions(), uuid.uuid4().hex
        image = header_image(
            system,
            method=dict(method),
            every=every,
            run_id=run_id,
            author=author,
            flush_frames=max(1, flush_bytes // (48 * len(system))),
            options=options,
            plan=plan,
            start=Cadence(checkpoint).take(),
        )
        with opening:
            made = create(Path(path), image, overwrite=overwrite), outline_of(system, options)
            self._open(Path(path), flush_bytes, options.flush, checkpoint, run_id, made=made)
        self._rows.columns = self.units | units_of(columns)

    @staticmethod
    def _reading(path: Path) -> Recorded:
        return reader.open(path)

    @classmethod
    def append_to(
        cls,
        path: str | os.PathLike[str],
        run_id: str,
        *,
        options: FileOptions | None = None,
        flush_bytes: int = FLUSH_BYTES,
        checkpoint: Callable[[], Checkpoint] | None = None,
        plan: Sequence[float] = (),
        at: tuple[int, float] | None = None,
        events: int = 0,
        columns: Mapping[str, Described] | None = None,
    ) -> Self:
        """Open a file to continue it. Raises InputError if the file belongs to another run.

        Half-written rows of a killed run are cut off. The file's options stay; only ``flush`` may differ. The next
        sample is ``at`` that step and time; a file that already goes further is refused and stays unchanged. If the
        file's end is damaged, rows from there on are cut off, and all events but the first ``events``. Then the last
        whole sample must be ``at`` that point. The user's ``columns``, if given, must be the file's.
        """
        path = Path(path)
        if path.exists():
            refuse_second(path)
        with cls._reading(path) as run:
            check_continued(run, run_id, at, options, columns)
            cut = run.kept != run.committed
        writer = cls.__new__(cls)
        keep = run.kept._replace(events=min(events, run.committed.events)) if cut else None
        writer._open(path, flush_bytes, (options or FileOptions()).flush, checkpoint, run_id, keep)
        writer._rows.columns = cls.units | units_of(columns)
        if plan:
            writer._put_plan(plan)
        return writer

    def _put_plan(self, plan: Sequence[float]) -> None:
        """Store another plan. One with another number of times needs another place in the file."""
        if self._out.h5["kickdrift/plan"].shape == (len(plan),):
            self._out.h5["kickdrift/plan"][...] = plan
            self._out.commit()
        else:
            self.extend(lambda file: add_plan(file["kickdrift"], plan))

    def _open(
        self,
        path: Path,
        flush_bytes: int,
        flush_seconds: float,
        checkpoint: Callable[[], Checkpoint] | None,
        run_id: str | None = None,
        keep: Committed | None = None,
        made: tuple[tuple[int, int], Outline] | None = None,
    ) -> None:
        self.path, self.flush_bytes, self.flush_seconds = path, flush_bytes, flush_seconds
        self.report: dict[str, Any] | None = None
        self.absorbed: Mapping[int, int] = {}
        self._cadence = Cadence(checkpoint)
        self._table: Table | None = None
        self._out = OpenFile(path, flush_bytes + 2 * 2**20, made[0] if made else None)
        self._closed = False
        try:
            with Contents(self._out.h5, path).guarded("its structure"):
                if run_id is not None and self._out.h5["kickdrift"].attrs["run_id"] != run_id:
                    raise InputError(f"{path}: another file has taken its place")
                self._begin(keep, made[1] if made and made[0] == self._out.key else None)
        except BaseException:
            self._out.close()
            raise
        self._seen: list[EventRow] = []
        self._waiting = self._rows.waiting()
        self._clear()

    def _begin(self, keep: Committed | None, made: Outline | None) -> None:
        """Find the end of the file; ``made`` is its content if this process has just created the file."""
        self._rows = Rows(self._out, made)
        if not made:
            self._cut_off(keep)
        self.run_id: str = self._out.h5["kickdrift"].attrs["run_id"]
        self.last_sample, self.last_frame = self._rows.last_sample, self._rows.last_frame

    def _cut_off(self, keep: Committed | None) -> None:
        """Cut off incomplete rows and, with ``keep``, whole rows beyond it. Mark the run as unfinished."""
        if keep:
            self._rows.keep(keep)
        if packing.is_packed(self._out.h5):
            self._write(self._unpack)
        if self._rows.cut() | self._checkpoints.cut():
            self._out.commit(cut=True)
            self._out.reopen()
        self._out.h5["kickdrift/closed"][0] = 0
        self._out.commit()

    @property
    def _checkpoints(self) -> Table:
        if self._table is None or self._table.file is not self._out.h5:
            self._table = Table(self._out.h5, self.path)
        return self._table

    def extend(self, make: Callable[[h5py.File], None]) -> None:
        """Let ``make`` add groups and datasets to the file; see `OpenFile.extend`."""
        self._write(lambda: self._out.extend(make))

    def _write(self, write: Callable[[], object]) -> None:
        self._out.writing(write, self._kept)

    def _kept(self) -> str:
        last = self._rows.last_frame
        return "holds no frame yet" if last is None else f"holds {self._rows.frames} frames, up to step {last[0]}"

    def _check_open(self) -> None:
        if self._closed:
            raise RunError(f"{self.path}: the file is closed")

    def append(
        self,
        state: State,
        observables: Mapping[str, ArrayLike] | None = None,
        *,
        frame: bool = True,
        forces: Floats | None = None,
        flush: bool = True,
    ) -> None:
        """Append a sample of the observables at the state's time and, if ``frame``, a frame.

        A frame holds positions and velocities, and the forces (n, 3) on the state's particles if the file has forces
        (`writes`). Observables are numbers or arrays in the system's units, with the same names each time. A step and
        time at which the file already ends are not written twice. An earlier step raises InputError. Without ``flush``
        the caller says `flush_if_full` later: a checkpoint is of the run's present state.
        """
        self._check_open()
        step, time, waiting = state.steps_done, state.time, self._waiting
        values = {name: v if type(v) is float else np.asarray(v, "f8") for name, v in (observables or {}).items()}
        last = self.last_sample
        if last is not None and behind((step, time), last):
            raise InputError(f"{self.path}: ends at step {last[0]}; step {step} cannot follow it")
        values = self._rows.held(values)
        if wrong := self._rows.check(values):
            raise InputError(wrong)
        if not self._rows.complete:
            self.extend(self._rows.make_observables)
            waiting.shape(self._rows.shapes)
        row = waiting.row(values)
        if self._seen:
            waiting.add_events(self._seen)  # a resumed run would find again the events after the last sample
            self._seen = []
        if frame and not same(self.last_frame, step, time):
            if "forces" in self.writes and forces is None:
                raise InputError(f"{self.path}: its frames hold forces, so each frame must have forces")
            vectors = self._in_order(state, forces)
            self._rows.check_box(state.box)
            waiting.add_frame(step, time, row, state.box, vectors)
            self.last_frame = step, time
        if not same(last, step, time):
            waiting.add_sample(step, time, row)
            self.last_sample = step, time
        if flush:
            self.flush_if_full()

    def append_series(
        self, steps: list[int], times: list[float], observables: Mapping[str, Floats], phases: Floats, like: State
    ) -> bool:
        """Append looks with frames, without a flush; or append nothing and return False. ``observables`` and ``phases``
        (looks, 2, 3, n) have a row for each look; ``like`` has the ids and the box."""
        self._check_open()
        rows, last = self._rows, (steps[0], times[0])
        names = {name: each[0] for name, each in observables.items()}
        new = not any(at and (same(at, *last) or behind(last, at)) for at in (self.last_sample, self.last_frame))
        plain = not (self._seen or self.writes) and np.array_equal(like.ids, rows.ids) and rows.complete
        if not (new and plain) or rows.held(names) is not names or rows.check(names):
            return False
        rows.check_box(like.box)
        values = np.concatenate([observables[name].reshape(len(steps), -1) for name in rows.shapes], axis=1)
        self._waiting.add_series(steps, times, values, like.box, phases)
        self.last_sample = self.last_frame = steps[-1], times[-1]
        return True

    def flush_if_full(self) -> None:
        """Flush if much data wait, or data have waited for ``flush_seconds``."""
        if self._waiting.bytes >= self.flush_bytes or self._waited:
            self.flush()

    def append_event(self, event: Mapping[str, Any]) -> None:
        """Add an entry of `Simulation.events`, which is written with the next sample."""
        self._seen.append(EventRow.of(event))

    def name(self, number: int, names: Sequence[str]) -> None:
        self._write(lambda: self._rows.name(number, names))

    @property
    def writes(self) -> tuple[str, ...]:
        """Names among "forces" and "images" that the frames hold besides positions and velocities."""
        return self._rows.write

    def _in_order(self, state: State, forces: Floats | None) -> Mapping[str, Floats]:
        """Vectors (n, 3) of a frame in the file's order of particles."""
        vectors: dict[str, Floats] = {"position": state.phase[0].T, "velocity": state.phase[1].T}
        if forces is not None:
            vectors["force"] = forces
        found = in_order(vectors, state.ids, self._rows.ids, self.absorbed)
        if found is None:
            raise InputError(f"{self.path}: holds {len(self._rows.ids)} particles; this state has {len(state)}")
        return found

    def _clear(self) -> None:
        self._waiting.clear()
        self._flushed_at = time.monotonic()

    @property
    def _waited(self) -> bool:
        return time.monotonic() - self._flushed_at >= self.flush_seconds

    def flush_if_due(self) -> None:
        """Flush if data have waited for ``flush_seconds``, without a checkpoint: a run may call this between looks."""
        if self._waiting.samples and self._waited:
            self._flush(lambda: None)

    def flush(self, *, final: bool = False, anew: bool = False) -> None:
        """Write everything appended so far to the file, safe from a kill.

        ``final`` adds a checkpoint; ``anew`` adds one although the file has a checkpoint of that step. Ctrl-C waits for
        the end of this call."""
        self._flush(lambda: self._cadence.due(self._checkpoints, self.last_sample, final, anew))

    def _flush(self, checkpoint: Callable[[], Stored | None]) -> None:
        self._check_open()
        if self._out.failed:
            raise RunError(f"{self.path}: an earlier write failed; nothing more can be written")
        with interruptible() as interrupted:
            self._cadence.written += self._waiting.bytes
            stored = checkpoint()
            if self._waiting or stored:
                self._write(lambda: self._add(stored))
            self._clear()
        if interrupted():  # now Ctrl-C may interrupt
            signal.raise_signal(signal.SIGINT)

    def _add(self, stored: Stored | None) -> None:
        self._rows.add(self._waiting)
        if stored:
            self._checkpoints.add(stored, self._out.commit)

    def close(self, *, whole: bool = True) -> None:
        """Flush, store the report if there is one, and close. A second call does nothing. A finished run is ``whole``
        and gets a last checkpoint."""
        if self._closed:
            return
        try:
            if not self._out.failed:
                self.flush(final=whole)
                if self.report is not None:
                    self._write(self._finish)
        finally:
            self._closed = True
            self._out.close()

    def _finish(self) -> None:
        """Write the report, then mark the file as whole."""
        own = self._out.h5["kickdrift"]
        report = np.frombuffer(to_json(self.report).encode(), "u1")
        own["report"].resize(len(report), axis=0)
        own["report"][...] = report
        self._out.commit()
        own["closed"][0] = 1
        self._out.commit()
        if own.attrs["compress"]:
            with packing.rewritten(self._out.h5, self.path, compress=True) as part:
                os.replace(part, self.path)

    def _unpack(self) -> None:
        with packing.rewritten(self._out.h5, self.path, compress=False) as part:
            self._out.replace(part)

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        try:
            self.close(whole=error is None)
        except RunError:
            if error is None:  # else report the first error
                raise

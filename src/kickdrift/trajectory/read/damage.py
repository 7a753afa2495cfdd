"""Damaged rows of a run's file: wrong checksums, and steps and times that make no sense."""

from functools import cached_property
from typing import NamedTuple

import h5py
import numpy as np
from numpy.typing import NDArray

from kickdrift.errors import InputError
from kickdrift.trajectory.layout import checksums
from kickdrift.trajectory.layout.contents import Contents
from kickdrift.trajectory.layout.edges import EDGES, shape_in
from kickdrift.trajectory.layout.header import CLOCK as CLOCK_SERIES
from kickdrift.trajectory.layout.header import EVENT_COLUMNS, Outline, event_column, framed, plan_numbers, sampled
from kickdrift.trajectory.layout.names import TRAJECTORY

PIECE_BYTES = 64 * 2**20  # vectors that are checked together
PARTS = 1000  # most parts in which a series that HDF5 cannot read is searched

Mask = NDArray[np.bool_]


class Damage(NamedTuple):
    """Numbers of the damaged rows, steps of the damaged checkpoints, and the number of frames without a checksum."""

    frames: list[int]
    samples: list[int]
    events: list[int]
    checkpoints: list[int]
    unchecked: int

    def __bool__(self) -> bool:
        return bool(self.frames or self.samples or self.events or self.checkpoints)


class Checks:
    """Checksums of an open file, compared with its rows. Older files have no checksums.

    Attributes
    ----------
    block : int
        Particles that one checksum of a frame covers.
    checked : int
        Frames that have checksums.
    """

    def __init__(self, contents: Contents, header: Outline) -> None:
        self._contents, self._header = contents, header
        self.block, self.checked = 1, 0
        self._sums: dict[str, h5py.Dataset] = {}
        if not contents.has(checksums.CHECKSUMS):
            return
        n = len(header.ids)
        self.block = contents.attribute(checksums.CHECKSUMS, "particles", int)
        if not 1 <= self.block <= max(n, 1):
            raise contents.damaged(f"{checksums.CHECKSUMS}: {self.block} particles to a checksum, but the file has {n}")
        self._blocks = -(-n // self.block)
        columns = checksums.FIRST_VECTOR + self._blocks * len(header.vectors)
        self._sums = {
            name: contents.dataset(f"{checksums.CHECKSUMS}/{name}", "u8", (None, *shape))
            for name, shape in (("frame", (columns,)), ("sample", ()), ("event", ()))
        }
        self.checked = min(header.committed.frames, self._sums["frame"].shape[0])

    def refuse_uncounted(self) -> None:
        """Raise InputError if a whole but uncounted frame is no later than the last counted sample: a commit counts
        both."""
        frames, samples, _ = self._header.committed
        series = self._clock_series(0)
        if not self._sums or not samples or any(len(data) <= frames for data in (*series, self._sums["frame"])):
            return
        row = range(frames, frames + 1)
        last = self._contents.read(sampled(self._contents, "step", samples), slice(samples - 1, samples))
        step = self._contents.read(series[0], slice(frames, frames + 1))
        if step <= last and not self._wrong_columns("frame", series, row, checksums.CLOCK).any():
            raise self._contents.damaged(f"kickdrift/committed: counts {frames} frames, but there are more")

    def vectors(self, name: str, frames: range, values: NDArray, first: int) -> Mask:
        """Mask (frames,): frames in which these stored vectors differ from what was written. The vectors are of whole
        blocks of particles, from block ``first`` on."""
        if not self._sums:
            return np.zeros(len(frames), bool)
        begin = checksums.FIRST_VECTOR + self._header.vectors.index(name) * self._blocks + first
        found = checksums.sums_of_vectors(values, self.block)
        return self._differ(frames, slice(begin, begin + found.shape[1]), found)

    def observables(self, frames: range) -> Mask:
        """Mask (frames,): those of these frames whose observables differ from what was written."""
        count = self._header.committed.frames
        series = [framed(self._contents, name, count) for name in self._header.observables]
        return (
            self._wrong_columns("frame", series, frames, checksums.OBSERVABLES)
            if series
            else np.zeros(len(frames), bool)
        )

    @cached_property
    def clock(self) -> Mask:
        """Mask (all frames,): frames whose step, time or box differs from what was written, or makes no sense."""
        count = self._header.committed.frames
        if not self._header.vectors:  # no frame at all
            return np.zeros(0, bool)
        return self._wrong_columns("frame", self._clock_series(count), range(count), checksums.CLOCK)

    def _clock_series(self, rows: int) -> list[h5py.Dataset]:
        contents = self._contents
        series = [contents.series(f"{TRAJECTORY}/position/{key}", kind, rows) for key, kind in CLOCK_SERIES]
        if self._header.box.periodic:
            series.append(contents.series(EDGES, "f8", rows, shape_in(contents, self._header.box)))
        return series

    @cached_property
    def samples(self) -> Mask:
        """Mask (all samples,): samples that differ from what was written, or make no sense."""
        count = self._header.committed.samples
        names = (*dict(CLOCK_SERIES), *self._header.observables)
        return self._wrong_columns("sample", [sampled(self._contents, name, count) for name in names], range(count))

    @cached_property
    def events(self) -> Mask:
        """Mask (all events,): events that differ from what was written."""
        count = self._header.committed.events
        return self._wrong_columns(
            "event", [event_column(self._contents, name, count) for name in EVENT_COLUMNS], range(count)
        )

    @cached_property
    def frames(self) -> Mask:
        """Mask (all frames,): damaged frames. Reads the whole file."""
        count = self._header.committed.frames
        if not count:
            return np.zeros(0, bool)
        found = self.clock | self.observables(range(count))
        at_once = max(1, PIECE_BYTES // (24 * len(self._header.ids)))
        for start in range(0, count, at_once):
            piece = range(start, min(start + at_once, count))
            for name in self._header.vectors:
                found[piece.start : piece.stop] |= self._wrong_vectors(name, piece)
        return found

    def frame(self, number: int) -> bool:
        one = range(number, number + 1)
        found = self.clock[number] or self.observables(one)[0]
        return bool(found or any(self._wrong_vectors(name, one)[0] for name in self._header.vectors))

    def _wrong_vectors(self, name: str, frames: range) -> Mask:
        data = self._contents.file[f"{TRAJECTORY}/{name}/value"]
        try:
            return self.vectors(name, frames, self._contents.read(data, slice(frames.start, frames.stop)), 0)
        except InputError:
            if len(frames) == 1:
                return np.ones(1, bool)
            return np.concatenate([self._wrong_vectors(name, range(k, k + 1)) for k in frames])

    def _wrong_columns(self, table: str, series: list[h5py.Dataset], rows: range, column: int | None = None) -> Mask:
        """Mask of rows that differ from what was written, cannot be read, or have steps and times that make no
        sense."""
        if not rows:
            return np.zeros(0, bool)
        found = [self._readable(data, rows) for data in series]
        wrong = np.any([bad for _, bad in found], axis=0)
        values = [values for values, _ in found]
        if self._sums:
            wrong |= self._differ(rows, column, checksums.sums_of_columns(values), table)
        if table == "sample" or column == checksums.CLOCK:
            wrong |= self._senseless(values[0], values[1], last=table == "sample" and not self._sums)
        return wrong

    def _differ(self, rows: range, column: int | slice | None, found: checksums.Sums, table: str = "frame") -> Mask:
        """Mask of rows whose stored checksums differ from those ``found``; False for rows without a checksum."""
        wrong = np.zeros(len(rows), bool)
        if not self._sums or not rows:
            return wrong
        data = self._sums[table]
        known = min(len(rows), len(range(rows.start, min(rows.stop, data.shape[0]), rows.step)))
        if known:
            chosen = slice(rows.start, rows[known - 1] + 1, rows.step)
            there = self._contents.read(data, chosen if column is None else (chosen, column))
            differing = there != found[:known]
            wrong[:known] = differing if differing.ndim == 1 else differing.any(axis=1)
        return wrong

    def _readable(self, data: h5py.Dataset, rows: range) -> tuple[NDArray, Mask]:
        """Rows of a series, with zeros for rows that HDF5 cannot read, and a mask of these."""
        chosen, bad = slice(rows.start, rows.stop, rows.step), np.zeros(len(rows), bool)
        try:
            return self._contents.read(data, chosen), bad
        except InputError:
            values = np.zeros((len(rows), *data.shape[1:]), data.dtype)
            size = max(1, -(-len(rows) // PARTS))
            for k in range(0, len(rows), size):
                part = rows[k : k + size]
                try:
                    values[k : k + size] = self._contents.read(data, slice(part.start, part.stop, part.step))
                except InputError:
                    bad[k : k + size] = True
            return values, bad

    def _senseless(self, steps: NDArray, times: NDArray, last: bool) -> Mask:
        """Mask of rows whose time is not finite, or whose step is negative or out of order. With ``last``, rows beyond
        the end of the last plan count too, if no checksum tells."""
        wrong = ~np.isfinite(times) | (steps < 0)
        if len(steps) > 1:
            falls, rises = np.zeros((2, len(steps)), bool)
            falls[1:] = steps[1:] < np.maximum.accumulate(steps)[:-1]
            rises[:-1] = steps[:-1] > np.minimum.accumulate(steps[::-1])[::-1][1:]
            wrong |= min(falls, rises, key=np.count_nonzero)
        if last and (plan := plan_numbers(self._contents)):
            _, begin, end_step, end, *_ = plan
            ahead = times - end if end >= begin else end - times  # beyond the end, also of a run back in time
            wrong |= (steps > end_step) | (ahead > 1e-9 * abs(end))
        return wrong

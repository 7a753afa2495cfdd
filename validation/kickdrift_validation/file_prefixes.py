"""Is a run's file whole wherever a kill falls between two writes to it?

Every write that a run makes to its file is recorded: the first flush, ordinary ones in which the index of the frames'
chunks grows to three levels, events, the report, the close, the same file taken up again, and taken up after a kill.
Then the writes are done again one by one, each cut wherever it crosses a page of 4096 bytes, which is where the system
may stop one when its process is killed. After each piece plain h5py must read every frame that a flush had brought
whole; so must `kickdrift.open` after every fifth, and after every twentieth MDAnalysis every frame that it finds.
Chunks are a thousand times smaller than a run's, so that the index grows as it would in a long run.

For comparison the order of the writes is left to HDF5: that loses frames, which is what kickdrift's own order is for,
and shows that these tests see it.
"""

import os
import tempfile
import warnings
from collections import Counter
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from importlib.util import find_spec
from pathlib import Path
from unittest import mock

import h5py
import numpy as np

from kickdrift.model.state import State
from kickdrift.model.system import System
from kickdrift.trajectory.file import openfile, storage
from kickdrift.trajectory.layout import names as layout
from kickdrift.trajectory.layout.options import FileOptions
from kickdrift.trajectory.read import reader
from kickdrift.trajectory.write.h5md import Writer
from kickdrift_validation.claim import Claim, claim, main, not_run

SHORT, LONG = (20, 2), (70, 40)  # frames, kills that are resumed
N = 100
EDGE = 10.0
Checks = dict[Callable[[Path, int], None], int]  # each, and at every how many-th place it looks
Write = tuple[str, int, bytes]  # "whole": the file is another; "put": bytes at a place; "size": it has that size now


def system() -> System:
    return System(np.zeros((N, 3)), box=(EDGE,) * 3, name="prefixes")


def positions(step: int) -> np.ndarray:
    """(n, 3); exact in float32, in the box and out of it."""
    return np.arange(3 * N).reshape(N, 3) / 8 + step / 2 - 40


def append(writer: Writer, start: System, step: int) -> None:
    """A frame, and now and then an event that comes before it."""
    s = start.state
    if step % 7 == 0:
        writer.append_event(
            {"time": step / 2, "step": step, "ids": [1], "distance": None, "energy": None, "kind": "escape", "done": ""}
        )
    phase = np.array([positions(step).T, -positions(step).T])
    writer.append(
        State(phase, s.masses, s.ids, s.box, step / 2, step),
        {"total_energy": step, "momentum": np.full(3, step)},
        forces=2 * positions(step) if "forces" in writer.writes else None,
    )


@contextmanager
def small_chunks(particles: int = 10) -> Iterator[None]:
    """Chunks of a few particles of one frame, and of two rows of a series."""
    with mock.patch.object(layout, "CHUNK_BYTES", 24 * particles), mock.patch.object(layout, "SERIES_CHUNK", 2):
        yield


@contextmanager
def hdf5s_own_order() -> Iterator[None]:
    """Writes go to the disk when HDF5 makes them."""

    def write(self: storage.PagedFile, data: memoryview) -> int:
        data = bytes(data)
        self._put(self._at, data)
        self._at += len(data)
        self._size = max(self._size, self._at)
        return len(data)

    def truncate(self: storage.PagedFile, size: int) -> int:
        self._size = size
        self._resize(size)
        return size

    with (
        mock.patch.object(storage.PagedFile, "write", write),
        mock.patch.object(storage.PagedFile, "truncate", truncate),
        mock.patch.object(storage, "ALIGNMENT", {}),
    ):
        yield


class Recorder:
    """Keeps every write to the file of that path, and the count of frames that were whole before it."""

    def __init__(self, path: Path) -> None:
        self.path = path
        self.writes: list[tuple[Write, int]] = []
        self.whole = 0

    @contextmanager
    def recording(self) -> Iterator[None]:
        put, resize, connect = storage.PagedFile._put, storage.PagedFile._resize, openfile.OpenFile._connect

        def is_it(file: storage.PagedFile) -> bool:
            return str(file._raw.name) == str(self.path)

        def recorded_put(file: storage.PagedFile, offset: int, data: bytes) -> None:
            if is_it(file):
                self.writes.append((("put", offset, bytes(data)), self.whole))
            put(file, offset, data)

        def recorded_resize(file: storage.PagedFile, size: int) -> None:
            if is_it(file):
                self.writes.append((("size", size, b""), self.whole))
            resize(file, size)

        def recorded_connect(out: openfile.OpenFile, own: tuple[int, int] | None) -> None:
            if out.path == self.path:
                self.writes.append((("whole", 0, self.path.read_bytes()), self.whole))
            connect(out, own)

        with (
            mock.patch.object(storage.PagedFile, "_put", recorded_put),
            mock.patch.object(storage.PagedFile, "_resize", recorded_resize),
            mock.patch.object(openfile.OpenFile, "_connect", recorded_connect),
        ):
            yield

    def run(self, frames: range, options: FileOptions | None = None) -> None:
        """Write these frames, each with a flush of its own, to a new file or to that which is there."""
        start = system()
        with self.recording():
            if frames.start == 0:
                self.path.unlink(missing_ok=True)
                writer = Writer(self.path, start, method={}, every=1, options=options, flush_bytes=1)
            else:
                with reader.open(self.path) as run:
                    run_id = run.run_id
                writer = Writer.append_to(self.path, run_id, flush_bytes=1)
            with writer:
                for step in frames:
                    append(writer, start, step)
                    self.whole = step + 1
                writer.report = {"last": frames.stop, "text": "x" * frames.stop}


def pieces(write: Write) -> Iterator[Write]:
    """A write cut at the pages."""
    kind, offset, data = write
    if kind != "put":
        yield write
        return
    while data:
        room = storage.PAGE - offset % storage.PAGE
        yield kind, offset, data[:room]
        offset, data = offset + room, data[room:]


def replay(writes: list[tuple[Write, int]], path: Path) -> Iterator[tuple[int, int]]:
    """Do the writes again, piece by piece; after each the number of the write, and of frames that must be whole."""
    for index, (write, whole) in enumerate(writes):
        for kind, offset, data in pieces(write):
            if kind == "whole":
                path.write_bytes(data)
            elif kind == "size":
                os.truncate(path, offset)
            else:
                with open(path, "r+b", buffering=0) as file:
                    file.seek(offset)
                    file.write(data)
            yield index, whole


def check_h5py(path: Path, whole: int) -> None:
    """Every frame that was whole, and all else that the file names, can be read and is right."""
    with h5py.File(path) as file:
        frames = int(file["kickdrift/committed"][0])
        assert frames >= whole, f"{frames} frames, {whole} had been whole"
        _check_vectors(file["particles/trajectory"], frames)
        steps = np.arange(frames)
        assert np.array_equal(file["particles/trajectory/position/step"][:frames], steps)
        assert np.array_equal(file["observables/total_energy/value"][:frames], steps) if frames else True
        file.visititems(lambda name, item: item[-1:] if getattr(item, "ndim", 0) else None)


def _check_vectors(group: h5py.Group, frames: int) -> None:
    if not frames:
        return
    truth = np.array([positions(step) for step in range(frames)])
    found = group["position/value"][:frames]
    if "image" in group:
        found = found + EDGE * group["image/value"][:frames]
    assert np.array_equal(found, truth), "positions"
    assert np.array_equal(group["velocity/value"][:frames], -truth), "velocities"
    if "force" in group:
        assert np.array_equal(group["force/value"][:frames], 2 * truth), "forces"


def check_kickdrift(path: Path, whole: int) -> None:
    """The same through our own reader."""
    with reader.open(path) as run:
        assert len(run) >= whole
        assert np.array_equal(run.sample_steps, np.arange(len(run.sample_steps)))
        assert len(run.events) == -(-len(run) // 7)  # events and frames are counted in one write
        assert run.report is None or run.report["last"] == len(run)
        for frame in (run[k] for k in {0, len(run) // 2, len(run) - 1} if len(run)):
            assert np.array_equal(frame.positions, positions(frame.step))
            assert np.array_equal(frame.velocities, -positions(frame.step))


def check_mdanalysis(path: Path, whole: int) -> None:
    """Every frame that MDAnalysis finds is right, whether a flush had come to its end or not."""
    import MDAnalysis

    with h5py.File(path) as file:
        if not len(file["particles/trajectory/position/value"]):
            return  # MDAnalysis opens no file without a frame
    universe = MDAnalysis.Universe(str(path), to_guess=())
    try:
        assert len(universe.trajectory) >= whole
        for frame in universe.trajectory[-3:]:
            inside = positions(frame.frame)
            images = "image" in universe.trajectory._particle_group
            assert np.array_equal(frame.positions, inside - EDGE * np.floor(inside / EDGE) if images else inside)
            assert np.array_equal(frame.velocities, -inside)
            assert frame.data["total_energy"] == frame.frame
    finally:
        universe.trajectory.close()


def failures(writes: list[tuple[Write, int]], path: Path, checks: Checks) -> tuple[int, Counter[str]]:
    """How many places there are to be killed at, and what was found wrong at how many of them."""
    places, wrong = 0, Counter[str]()
    for places, (_, whole) in enumerate(replay(writes, path), 1):
        try:
            for check, every in checks.items():
                if places % every == 0:
                    check(path, whole)
        except Exception as error:
            wrong[f"{type(error).__name__}: {str(error)[:90]}"] += 1
    return places, wrong


def resumed(writes: list[tuple[Write, int]], at: int, path: Path, more: int) -> Recorder:
    """The file as a kill after that write leaves it, taken up again and brought ``more`` frames further."""
    for index, _ in replay(writes, path):
        if index == at:
            break
    with reader.open(path) as run:
        begin = len(run)
    recorder = Recorder(path)
    recorder.whole = begin
    recorder.run(range(begin, begin + more))
    return recorder


def lost(recorder: Recorder, path: Path) -> tuple[int, int]:
    """How many places there are to be killed at, and how many of them lose a frame."""
    checks: Checks = {check_h5py: 1, check_kickdrift: 5} | ({check_mdanalysis: 20} if find_spec("MDAnalysis") else {})
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # MDAnalysis guesses, and says so
        places, wrong = failures(recorder.writes, path, checks)
    for text, count in wrong.most_common(5):
        print(f"  {count:6} times {text}")
    return places, sum(wrong.values())


def recorded(path: Path, frames: int, options: FileOptions) -> Recorder:
    """A run into a file, taken up again for ten frames more."""
    recorder = Recorder(path)
    recorder.run(range(frames), options)
    recorder.run(range(frames, frames + 10))
    return recorder


def claims(long: bool = False) -> Iterator[Claim]:
    """One for each kind of file, and one for all that was resumed."""
    frames, kills = LONG if long else SHORT
    reference = "every write, cut at pages of 4096 bytes"
    with tempfile.TemporaryDirectory() as folder, small_chunks(3):
        path, copy = Path(folder) / "run.h5md", Path(folder) / "copy.h5md"
        every = FileOptions(10, "float32", True, ("forces", "images"))
        others = recorded(path, 15, every)
        first = recorded(path, frames, FileOptions())
        with h5py.File(path) as file:
            chunks = file["particles/trajectory/position/value"].id.get_num_chunks()
        print(f"float64: {chunks:,} chunks; an index node has up to 64 entries")
        for kind, recorder in {"float64": first, "float32, forces, images, compressed": others}.items():
            places, count = lost(recorder, copy)
            text = f"{kind}: places to be killed at, of {places}, that lose a frame"
            yield claim(text, count, "0", count == 0, reference)
        all_places = all_lost = 0
        for at in np.linspace(len(first.writes) - 200, len(first.writes) - 5, kills).astype(int):
            places, count = lost(resumed(first.writes, int(at), path, 3), copy)
            all_places, all_lost = all_places + places, all_lost + count
        text = f"taken up after each of {kills} kills: places, of {all_places}, that lose a frame"
        yield claim(text, all_lost, "0", all_lost == 0, "the same, of the files that the kills left")
        with hdf5s_own_order():
            places, count = lost(recorded(path, 15, FileOptions()), copy)
        text = f"HDF5's own order of writes, for comparison: places, of {places}, that lose a frame"
        yield claim(text, count, "more than 0", count > 0, reference)
    if not find_spec("MDAnalysis"):
        yield not_run("MDAnalysis reads these files too", "0 that lose a frame", "MDAnalysis")


if __name__ == "__main__":
    main(claims, __doc__)

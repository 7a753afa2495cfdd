"""Cost of writing a trajectory, size of its file, and time of reading.

    python -m kickdrift_validation.performance.trajectory [--steps 40000] [--turns 3]

The run is `lj-1000` with a frame every 100 steps. The cost of writing is the processor time in the writer over that of
the run without a file. The writer makes the file, writes every sample and frame, flushes with checkpoints, and closes
the file. The same Simulation takes turns with and without a file (A B B A …), and the median over the turns counts. The
script also prints how much longer the whole run takes; on a machine with other work this is mostly noise.

Sizes: 1000 frames of one run in every form of our file, and through MDAnalysis' writers as DCD and XTC (no velocities;
float32 and 0.01 Angstrom of positions), and TRR (float32, both). Reading: one frame in the middle, and one particle's
path through all frames, medians; DCD, XTC and TRR through MDAnalysis. The files lie in the system's cache.
"""

from __future__ import annotations

import argparse
import statistics
import sys
import tempfile
import warnings
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from importlib.util import find_spec
from pathlib import Path
from time import perf_counter, process_time
from typing import Any
from unittest import mock

import numpy as np

import kickdrift as kd
from kickdrift.trajectory.write.h5md import Writer
from kickdrift_validation.claim import Claim, claim, show, where

EVERY, FRAMES = 100, 1000
BOUND = 0.05
FORMS = {
    "h5md": None,
    "h5md, float32": kd.FileOptions(store="float32"),
    "h5md, compressed": kd.FileOptions(compress=True),
    "h5md, float32, compressed": kd.FileOptions(store="float32", compress=True),
    "h5md, forces and images": kd.FileOptions(write=("forces", "images")),
}


def seconds(work: Callable[[], Any]) -> float:
    began = perf_counter()
    work()
    return perf_counter() - began


@contextmanager
def timed(methods: dict[str, Any], spent: list[float]) -> Iterator[None]:
    """Add up the processor time of the Writer's ``methods`` inside the context."""

    def added(method: Any) -> Any:
        def inner(*arguments: Any, **options: Any) -> Any:
            began = process_time()
            try:
                return method(*arguments, **options)
            finally:
                spent[0] += process_time() - began

        return inner

    with ExitStack() as stack:
        for name in methods:
            stack.enter_context(mock.patch.object(Writer, name, added(methods[name])))
        yield


def write_cost(folder: Path, steps: int, turns: int, options: kd.FileOptions | None) -> list[tuple[float, float]]:
    """For each turn, the writer's processor time and the run's additional time, over the run without a file."""
    sim = kd.Simulation(kd.load("lj-1000"), dt=0.004)
    sim.run(2000, every=EVERY, output=folder / "first.h5md")  # loads all modules
    methods = {name: getattr(Writer, name) for name in ("__init__", "append", "flush_if_due", "close")}

    def times(path: Path | None) -> tuple[float, float]:
        spent = [0.0]
        with timed(methods, spent):
            began = process_time()
            sim.run(steps, every=EVERY, output=path, file=options if path else None)
            whole = process_time() - began
        if path:
            path.unlink()
        return spent[0], whole

    found = []
    for turn in range(turns):
        path = folder / f"cost{turn}.h5md"
        spent = {file: times(file) for file in ((path, None) if turn % 2 else (None, path))}
        without = spent[None][1]
        found.append((spent[path][0] / without, spent[path][1] / without - 1))
    (folder / "first.h5md").unlink()
    return found


def files(folder: Path) -> dict[str, Path]:
    """One run's frames in every form."""
    made = {}
    for name, options in FORMS.items():
        path = made[name] = folder / f"{name.replace(' ', '')}.h5md"
        kd.Simulation(kd.load("lj-1000"), dt=0.004).run(FRAMES * 5 - 5, every=5, output=path, file=options)
    if find_spec("MDAnalysis"):
        import MDAnalysis

        with kd.open(made["h5md"]) as run:
            universe = run.universe()
        for form in ("dcd", "xtc", "trr"):
            path = made[form] = folder / f"run.{form}"
            with MDAnalysis.Writer(str(path), len(universe.atoms)) as writer:
                for _ in universe.trajectory:
                    writer.write(universe.atoms)
        universe.trajectory.close()
    return made


def read_times(name: str, path: Path, turns: int) -> tuple[float, float]:
    """Seconds for one frame and for one particle's path, in an open file."""
    if name.startswith("h5md"):
        with kd.open(path) as run:
            frame = statistics.median(seconds(lambda k=k: run[k].positions) for k in _places(turns))
            return frame, statistics.median(seconds(lambda k=k: run.path_of(k)) for k in _places(turns))
    import MDAnalysis

    universe = MDAnalysis.Universe.empty(1000, trajectory=False)
    universe.load_new(str(path))

    def path_of(particle: int) -> np.ndarray:
        return np.array([frame.positions[particle] for frame in universe.trajectory])

    frame = statistics.median(seconds(lambda k=k: universe.trajectory[k].positions.copy()) for k in _places(turns))
    return frame, statistics.median(seconds(lambda k=k: path_of(k)) for k in _places(3))


def _places(turns: int) -> list[int]:
    return np.random.default_rng(1).integers(100, 900, turns).tolist()


def claims(steps: int, turns: int) -> Iterator[Claim]:
    """Cost of writing, and a table of sizes and times."""
    with tempfile.TemporaryDirectory() as text:
        folder = Path(text)
        for name, options in FORMS.items():
            found = write_cost(folder, steps, turns, options)
            cost, longer = (statistics.median(turn[k] for turn in found) for k in range(2))
            least, most = (100 * f(turn[1] for turn in found) for f in (min, max))
            print(f"  {name:28} costs {100 * cost:5.2f} %; longer by {100 * longer:.1f} % ({least:.1f} to {most:.1f})")
            if options is None or (options.store == "float32" and not options.compress):
                text = f"writing lj-1000 every {EVERY} steps, {name}: share of its processor time"
                yield claim(text, cost, f"below {BOUND:g}", cost < BOUND, "the same run without a file")
        made = files(folder)
        bare = 24 * 1000 * FRAMES
        print(f"  {'file':28} {'MB':>7} {'of float64 x':>13} {'frame, ms':>10} {'path, ms':>9}")
        for name, path in made.items():
            frame, one = read_times(name, path, 25)
            size = path.stat().st_size
            print(f"  {name:28} {size / 1e6:7.2f} {size / bare:13.2f} {1e3 * frame:10.3f} {1e3 * one:9.2f}")
        size = made["h5md"].stat().st_size / (2 * bare)
        yield claim(
            "size over the bare numbers, float64 positions and velocities",
            size,
            "below 1.05",
            size < 1.05,
            "48 n f bytes",
        )


def main() -> int:
    """Measure and print. The exit status is 1 where a bound is missed."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--steps", type=int, default=40000)
    parser.add_argument("--turns", type=int, default=3)
    given = parser.parse_args()
    warnings.simplefilter("ignore")
    print(where("h5py", *(["MDAnalysis"] if find_spec("MDAnalysis") else [])))
    return show(claims(given.steps, given.turns))


if __name__ == "__main__":
    sys.exit(main())

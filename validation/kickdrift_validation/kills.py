"""Does a run that is killed at any moment leave a file that opens and goes on to the same bits?

    python -m kickdrift_validation.kills [--long]

A child process runs a small liquid into a file, a flush for every frame, and is killed by SIGKILL: while its file is
being made, between flushes, inside a flush, and while the file is being closed. The child says through a byte of shared
memory where it is; the parent waits for the place that was drawn and a random time after it. A kill inside a flush
counts as one if the byte says so after the child has died. Then plain h5py and `kickdrift.open` must open the file, its
frames must be those of the run that was not killed, to the last bit, and `kickdrift.resume` must finish the run to the
bits of that one: every frame, every observable, the report's energies.

A kill while the file is being made may come before there is one; that is counted by itself.
"""

from __future__ import annotations

import mmap
import multiprocessing
import sys
import tempfile
from collections import Counter
from collections.abc import Callable, Iterator
from pathlib import Path
from time import perf_counter, sleep
from typing import Any

import h5py
import numpy as np

import kickdrift as kd
from kickdrift_validation.claim import Claim, claim, main

PHASES = ("starting", "creation", "running", "flush", "close", "over")
STEPS, EVERY, CELLS, PAUSE = 1600, 20, 6, 2e-3
SHORT, LONG, SEED = 20, 200, 1  # kills
LEAST_INSIDE = 20  # of the long set
SHARE = {"creation": 0.2, "running": 0.25, "flush": 0.4, "close": 0.15}


def liquid() -> kd.System:
    """216 particles."""
    grid = np.mgrid[0:CELLS, 0:CELLS, 0:CELLS].reshape(3, -1).T + 0.5
    rng = np.random.default_rng(5)
    edge = CELLS * 1.06
    force = kd.LennardJones(cutoff=2.5, truncation="shift")
    return kd.System(grid * 1.06, rng.normal(size=grid.shape), box=(edge,) * 3, forces=[force])


def run(path: str | None, observe: Callable[[Any], None] | None = None) -> Any:
    """The run that all children begin; its report."""
    sim = kd.Simulation(liquid(), dt=0.004)
    file = kd.FileOptions(flush=1e-9, write=("images",)) if path else None
    return sim.run(STEPS, every=EVERY, output=path, file=file, observe=observe)


def child(path: str, where_it_is: mmap.mmap) -> None:
    """Run, and say all the time in which phase."""
    from kickdrift.trajectory import h5md, openfile, storage

    def phased(function: Callable[..., Any], phase: str, after: str) -> Callable[..., Any]:
        def inner(*arguments: Any, **options: Any) -> Any:
            where_it_is[0] = PHASES.index(phase)
            try:
                return function(*arguments, **options)
            finally:
                where_it_is[0] = PHASES.index(after)

        return inner

    h5md.Writer.__init__ = phased(h5md.Writer.__init__, "creation", "running")  # type: ignore[method-assign]
    openfile.OpenFile.extend = phased(openfile.OpenFile.extend, "creation", "running")  # type: ignore[method-assign]
    h5md.Writer._add = phased(h5md.Writer._add, "flush", "running")  # type: ignore[method-assign]
    h5md.Writer._finish = phased(h5md.Writer._finish, "close", "close")  # type: ignore[method-assign]
    put = storage.PagedFile._put

    def slow_put(self: storage.PagedFile, offset: int, data: bytes) -> None:
        put(self, offset, data)  # in a fifth of them so slowly that kills find every place between two
        if where_it_is[0] in (PHASES.index("flush"), PHASES.index("close")) and where_it_is[1]:
            sleep(PAUSE)

    storage.PagedFile._put = slow_put  # type: ignore[method-assign]
    run(path)
    where_it_is[0] = PHASES.index("over")


def killed(path: Path, phase: str, rng: np.random.Generator) -> str:
    """Begin a run into the file and kill it there; the phase that it died in."""
    with mmap.mmap(-1, 2) as where_it_is:
        where_it_is[1] = int(rng.random() < 0.2)
        process = multiprocessing.get_context("fork").Process(target=child, args=(str(path), where_it_is))
        process.start()
        wanted = PHASES.index(phase)
        flushes = int(rng.integers(1, 60)) if phase in ("running", "flush") else 1
        wait = float(rng.exponential({"creation": 5e-2, "running": 2e-3, "flush": 1e-3, "close": 2e-3}[phase]))
        seen, inside = 0, False
        while process.is_alive() and seen < flushes and where_it_is[0] != PHASES.index("over"):
            now = where_it_is[0] == wanted
            seen += now and not inside
            inside = now
        until = perf_counter() + wait
        while perf_counter() < until:
            pass
        process.kill()  # does nothing to a child that has ended
        process.join()
        return PHASES[where_it_is[0]]


def content(path: Path) -> dict[str, Any]:
    """All that a run's file says of the run, to the last bit."""
    with kd.open(path) as found:
        own = {name: values.tobytes() for name, values in found.observables.items()}
        return {
            "steps": found.steps.tolist(),
            "positions": found.positions.tobytes(),
            "velocities": found.velocities.tobytes(),
            "observables": own,
            "energy": (found.report or {}).get("energy"),
        }


def same_beginning(path: Path, truth: kd.trajectory.reader.Run) -> int:  # type: ignore[name-defined]
    """How many frames the file has; an AssertionError where they are not the truth's first ones."""
    with h5py.File(path) as raw:
        raw.visititems(lambda name, item: item[()] if hasattr(item, "dtype") else None)
        frames = len(raw["particles/trajectory/position/value"])
    with kd.open(path) as found:
        assert len(found) <= frames
        for k in range(len(found)):
            assert found[k].step == truth[k].step
            assert found[k].positions.tobytes() == truth[k].positions.tobytes()
            assert found[k].velocities.tobytes() == truth[k].velocities.tobytes()
        return len(found)


def claims(long: bool = False) -> Iterator[Claim]:
    """Counts of what the kills left."""
    rng, kills = np.random.default_rng(SEED), LONG if long else SHORT
    phases = [phase for phase, share in SHARE.items() for _ in range(round(share * kills))]
    died: Counter[str] = Counter()
    opened = resumed = none = frames = 0
    wrong: Counter[str] = Counter()
    with tempfile.TemporaryDirectory() as folder:
        whole, path = Path(folder) / "whole.h5md", Path(folder) / "run.h5md"
        run(str(whole))  # compiles, too: children are forked from here
        truth = content(whole)
        with kd.open(whole) as reference:
            for phase in rng.permutation(phases):
                for old in Path(folder).glob("*run.h5md*"):
                    old.unlink()
                died[killed(path, str(phase), rng)] += 1
                if not path.exists():
                    none += 1
                    continue
                try:
                    frames += same_beginning(path, reference)
                    opened += 1
                    sim = kd.resume(path)
                    sim.run()  # also where nothing is left but the report
                    assert content(path) == truth, "other bits"
                    resumed += 1
                except Exception as error:
                    wrong[f"{type(error).__name__}: {error}"] += 1
    print("  died in: " + ", ".join(f"{phase} {died[phase]}" for phase in PHASES if died[phase]))
    print(f"  no file yet: {none}; frames read after the kills: {frames}")
    for text, count in wrong.most_common(5):
        print(f"  {count} times {text}", file=sys.stderr)
    inside = died["flush"]
    least = LEAST_INSIDE * kills // LONG
    yield claim("kills inside a flush", inside, f"at least {least}", inside >= least, "the child's own word")
    files = sum(died.values()) - none
    yield claim(f"files that open, of {files}", opened, f"all {files}", opened == files, "the run that was not killed")
    text = f"resumes that end in the same bits, of {files}"
    yield claim(text, resumed, f"all {files}", resumed == files, "the run that was not killed")


if __name__ == "__main__":
    sys.exit(main(claims, __doc__))

"""Does a run that is killed at any moment leave a file that opens and goes on to the same bits?

A child process runs a small liquid into a file, a flush for every frame, and is killed by SIGKILL: while its file is
being made, between flushes, inside a flush, and while the file is being closed. The child says through a byte of shared
memory where it is; the parent waits for the place that was drawn and a random time after it. A kill inside a flush
counts as one if the byte says so after the child has died. Then plain h5py and `kickdrift.open` must open the file, its
frames must be those of the run that was not killed, to the last bit, and `kickdrift.resume` must finish the run to the
bits of that one: every frame, every observable, the report's energies.

A kill while the file is being made may come before there is one; that is counted by itself.

Most runs are at constant energy. As many as 50 have heat baths in turn: their noise, and the state of a chain, must go
on as well.
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
BATHS: dict[str, dict[str, float]] = {
    "baoab": {"friction": 1.0}, "csvr": {"tau": 0.5}, "nose-hoover": {"tau": 0.5}, "andersen": {"collision_rate": 1.0},
}  # fmt: skip
IN_BATHS, PLAIN = 50, "velocity-verlet"
LEAST_INSIDE = 20  # of the long set
SHARE = {"creation": 0.2, "running": 0.25, "flush": 0.4, "close": 0.15}


def liquid() -> kd.System:
    grid = np.mgrid[0:CELLS, 0:CELLS, 0:CELLS].reshape(3, -1).T + 0.5
    rng = np.random.default_rng(5)
    edge = CELLS * 1.06
    force = kd.LennardJones(cutoff=2.5, truncation="shift")
    return kd.System(grid * 1.06, rng.normal(size=grid.shape), box=(edge,) * 3, forces=[force])


def run(path: str | None, observe: Callable[[Any], None] | None = None, method: str = PLAIN) -> Any:
    """The run that all children begin; its report."""
    options = {"temperature": 1.0, **BATHS[method]} if method in BATHS else {}
    sim = kd.Simulation(liquid(), method, 0.004, **options)  # type: ignore[arg-type]
    file = kd.FileOptions(flush=1e-9, write=("images",)) if path else None
    return sim.run(STEPS, every=EVERY, output=path, file=file, observe=observe)


def child(path: str, where_it_is: mmap.mmap, method: str = PLAIN) -> None:
    """Run, and say all the time in which phase."""
    from kickdrift.trajectory.file import openfile, storage
    from kickdrift.trajectory.write import h5md

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
    run(path, method=method)
    where_it_is[0] = PHASES.index("over")


def killed(path: Path, phase: str, rng: np.random.Generator, method: str = PLAIN) -> str:
    """Begin a run into the file and kill it there; the phase that it died in."""
    with mmap.mmap(-1, 2) as where_it_is:
        where_it_is[1] = int(rng.random() < 0.2)
        process = multiprocessing.get_context("fork").Process(target=child, args=(str(path), where_it_is, method))
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


class Kills:
    """Kills of runs with one method, and what they left."""

    def __init__(self, folder: Path, method: str) -> None:
        self.method, self.path, whole = method, folder / "run.h5md", folder / f"whole-{method}.h5md"
        run(str(whole), method=method)  # compiles, too: children are forked from here
        self.truth, self.reference = content(whole), kd.open(whole)
        self.died, self.wrong = Counter[str](), Counter[str]()
        self.opened = self.resumed = self.none = self.frames = 0

    def kill(self, phase: str, rng: np.random.Generator) -> None:
        """Begin a run, kill it in that phase, and resume it."""
        path = self.path
        for old in path.parent.glob("*run.h5md*"):
            old.unlink()
        self.died[killed(path, phase, rng, self.method)] += 1
        if not path.exists():
            self.none += 1
            return
        try:
            self.frames += same_beginning(path, self.reference)
            self.opened += 1
            sim = kd.resume(path)
            sim.run()  # also where nothing is left but the report
            assert content(path) == self.truth, "other bits"
            self.resumed += 1
        except Exception as error:
            self.wrong[f"{type(error).__name__}: {error}"] += 1

    @property
    def files(self) -> int:
        """How many kills left a file."""
        return self.died.total() - self.none

    def tell(self) -> None:
        """Print where runs died, and what went wrong."""
        died = ", ".join(f"{phase} {self.died[phase]}" for phase in PHASES if self.died[phase])
        print(f"  {self.method} died in: {died}; no file yet: {self.none}; frames read: {self.frames}", flush=True)
        for text, count in self.wrong.most_common(5):
            print(f"  {count} times {text}", file=sys.stderr)


def claims(long: bool = False) -> Iterator[Claim]:
    """Counts of what the kills left."""
    rng, kills = np.random.default_rng(SEED), LONG if long else SHORT
    phases = [phase for phase, share in SHARE.items() for _ in range(round(share * kills))]
    truth = "the run that was not killed"
    with tempfile.TemporaryDirectory() as folder:
        plain = Kills(Path(folder), PLAIN)
        for phase in rng.permutation(phases):
            plain.kill(str(phase), rng)
        plain.tell()
        inside, files = plain.died["flush"], plain.files
        least = LEAST_INSIDE * kills // LONG
        yield claim("kills inside a flush", inside, f"at least {least}", inside >= least, "the child's own word")
        yield claim(f"files that open, of {files}", plain.opened, f"all {files}", plain.opened == files, truth)
        text = f"resumes that end in the same bits, of {files}"
        yield claim(text, plain.resumed, f"all {files}", plain.resumed == files, truth)
        baths = [Kills(Path(folder), method) for method in BATHS]
        for k, phase in enumerate(rng.choice([*SHARE], IN_BATHS, p=[*SHARE.values()])):
            baths[k % len(baths)].kill(str(phase), rng)
        for each in baths:
            each.tell()
        files, resumed = sum(each.files for each in baths), sum(each.resumed for each in baths)
        text = f"resumes of runs in heat baths that end in the same bits, of {files}"
        yield claim(text, resumed, f"all {files}", 0 < files == resumed, f"{truth}; {', '.join(BATHS)}")


if __name__ == "__main__":
    main(claims, __doc__)

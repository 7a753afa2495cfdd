"""Cases on several workers at a time, all forked by one zygote."""

import json
import os
import pickle
import socket
import subprocess
import sys
import tempfile
from collections.abc import Callable, Iterable, Iterator
from contextlib import ExitStack, contextmanager, suppress
from dataclasses import asdict
from pathlib import Path
from queue import Empty, Queue
from threading import Thread
from typing import Any

from kickdrift_validation.fuzzing.case import Case
from kickdrift_validation.fuzzing.watch import Limits
from kickdrift_validation.fuzzing.zygote import READY

Make = Callable[[int, int], Case]
Tried = Callable[..., Iterator[dict[str, Any]]]
ENVIRONMENT = {"OPENBLAS_NUM_THREADS": "1", "COLUMNS": "100", "MPLBACKEND": "agg"}


class Worker:
    """The near end of a worker's socket: give it a case, take what came of it."""

    def __init__(self, near: socket.socket) -> None:
        self._near, self._file = near, near.makefile("rwb")

    def answer(self) -> Any:
        line = self._file.readline()
        if not line:
            raise RuntimeError("a worker ended")
        return json.loads(line)

    def tried(self, make: Make, number: int, seed: int) -> dict[str, Any]:
        pickle.dump((make, number, seed), self._file)
        self._file.flush()
        return self.answer()

    def close(self) -> None:
        with self._near, suppress(OSError):
            self._file.close()


def results(workers: list[Worker], jobs: Iterable[tuple[Make, int]], seed: int) -> Iterator[dict[str, Any]]:
    """What came of each job, as it ends."""
    waiting: Queue[tuple[Make, int]] = Queue()
    done: Queue[dict[str, Any] | Exception | None] = Queue()
    for job in jobs:
        waiting.put(job)

    def work(worker: Worker) -> None:
        try:
            while True:
                make, number = waiting.get_nowait()
                done.put(worker.tried(make, number, seed))
        except Empty:
            done.put(None)
        except Exception as error:
            done.put(error)

    for worker in workers:
        Thread(target=work, args=(worker,), daemon=True).start()
    left = len(workers)
    while left:
        result = done.get()
        if isinstance(result, Exception):
            raise result
        if result is None:
            left -= 1
        else:
            yield result


@contextmanager
def session(count: int = 2, limits: Limits | None = None, warm: bool = True) -> Iterator[Tried]:
    """A function that tries jobs, each a generator and a number, and yields what came of each.

    Without ``warm`` there are no run files, and every child loads kickdrift by itself.
    """
    with ExitStack() as stack:
        scratch = Path(stack.enter_context(tempfile.TemporaryDirectory(prefix="kickdrift-fuzzing-")))
        pairs = [socket.socketpair() for _ in range(count)]
        fds = [far.fileno() for _, far in pairs]
        settings = {"fds": fds, "limits": asdict(limits or Limits()), "warm": warm}
        zygote = subprocess.Popen(
            [sys.executable, "-m", "kickdrift_validation.fuzzing.zygote", str(scratch), json.dumps(settings)],
            env=os.environ | ENVIRONMENT, cwd=scratch, pass_fds=fds, stdin=subprocess.DEVNULL,
        )  # fmt: skip
        stack.callback(zygote.wait)
        workers = []
        for near, far in pairs:
            far.close()
            workers.append(Worker(near))
            stack.callback(workers[-1].close)
        for worker in workers:
            if worker.answer() != READY:
                raise RuntimeError("a worker does not start")
        os.environ["KICKDRIFT_FUZZ_BASE"] = str(scratch / "base")
        stack.callback(os.environ.pop, "KICKDRIFT_FUZZ_BASE", None)
        yield lambda jobs, seed=0: results(workers, jobs, seed)

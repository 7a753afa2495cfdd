"""A model of a step on many threads, from the chunks of a step on one thread.

One thread runs all chunks of a real run and logs the time of each. The rest of the step is serial. The model gives the
logged chunks to p threads as kickdrift does: a thread that is free takes a chunk. A helper begins late. This delay is
measured with chunks that only wait. Tasks after a longer serial part find the helpers asleep, which has its own delay.
The k-th helper begins after k delays, because one lock wakes all.

A step also takes at least the time in which memory delivers its bytes, where its arrays exceed the last cache.
No number is fitted to a run on several threads.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Iterator
from contextlib import contextmanager
from heapq import heapreplace
from time import perf_counter, sleep
from typing import Any, NamedTuple

import numpy as np
from numba import types

import kickdrift as kd
from docs.studies.peaks import MEMORY, caches
from docs.studies.peaks import read as sum_of
from kickdrift.forces.bound.forces import most_threads
from kickdrift.forces.lists.clusters import N_CLUSTERS
from kickdrift.jit.compile import jit
from kickdrift.jit.handle import callback, handle
from kickdrift.jit.lanes.memory import aligned
from kickdrift.jit.lanes.vectors import WIDTH
from kickdrift.jit.threads.atomic import nanoseconds, read, write
from kickdrift.jit.threads.chunks import (
    AWAKE,
    CODE,
    CROWDED,
    TASK_PLACE,
    Chunks,
    Team,
    chunk_task,
    each_chunk,
    in_chunks,
    team_of,
)
from kickdrift.jit.threads.numba_threads import call_task
from kickdrift_validation.performance.turns import Missing

ENTRIES = 2**20  # room of the log
TESTS = ((2_000, 20_000), (200_000, 500_000))  # nanoseconds: a serial part, and a chunk that then waits
TRIES, ENOUGH, LONGEST = 100, 300, 5.0  # tasks in a round of a test, those that count; seconds at most


class Task(NamedTuple):
    """A task of a step: how often in a step, nanoseconds of its chunks (chunks,), and of the serial part before."""

    often: float
    chunks: np.ndarray
    before: float


class Log(NamedTuple):
    """A step on one thread, as its tasks. Each time is a median over the steps of a run."""

    tasks: list[Task]

    @property
    def serial(self) -> float:
        """Nanoseconds of a step outside of tasks."""
        return sum(task.often * task.before for task in self.tasks)

    @property
    def whole(self) -> float:
        """Nanoseconds of a step."""
        return self.serial + sum(task.often * float(task.chunks.sum()) for task in self.tasks)

    def scaled(self, whole: float) -> Log:
        """The same step in another time."""
        by = whole / self.whole
        return Log([Task(task.often, by * task.chunks, by * task.before) for task in self.tasks])


class Delays(NamedTuple):
    """Nanoseconds: from the call of a task to the master's first chunk, to a helper's first chunk if the helper is
    awake or asleep, and from the end of the last chunk to the end of the call."""

    master: float
    awake: float
    asleep: float
    end: float


class Memory(NamedTuple):
    """Bytes that a step streams, those of its arrays, and bytes a nanosecond from memory on all threads."""

    streamed: float
    arrays: float
    rate: float

    @property
    def least(self) -> float:
        """Nanoseconds of a step at least; 0 where the arrays fit in the last cache."""
        return self.streamed / self.rate if self.arrays > max(caches().values()) else 0.0


def logged(team, code, place, count):
    """Run a task's chunks in turn; log its code, their number, the time since the last task, and each chunk's time."""
    log = read(team + TASK_PLACE)
    k, began = read(log), nanoseconds()
    room = k + 3 + count < ENTRIES
    if room:
        write(log, k + 3 + count)
        write(log + 8 * k, code)
        write(log + 8 * (k + 1), count)
        write(log + 8 * (k + 2), began - read(log + 8))
    for c in range(count):
        call_task(code, place, c, 0)
        now = nanoseconds()
        if room:
            write(log + 8 * (k + 3 + c), now - began)
        began = now
    write(log + 8, began)


@contextmanager
def logging() -> Iterator[np.ndarray]:
    """A log into which all tasks of runs on two threads go. One thread then runs all their chunks."""
    team = team_of(2)
    if most_threads() < 2 or not isinstance(team, Team):
        raise Missing("needs two threads, on Linux")
    memory, log = team._memory, aligned((ENTRIES,), 0, np.int64)
    before, own = int(memory[CODE // 8]), callback(logged, types.void(*4 * [types.intp]), types.none)
    log[0] = 2
    memory[TASK_PLACE // 8], memory[CODE // 8] = log.ctypes.data, own.address
    try:
        yield log
    finally:
        memory[CODE // 8] = before


def log_of(sim: kd.Simulation, steps: int) -> Log:
    """Log of the next steps of a Simulation on two threads. A log that is full leaves out the last steps."""
    sim.run(2, every=sim.steps_done + 2)
    with logging() as log:
        sim.run(steps, every=sim.steps_done + steps)
    found, k = dict[tuple[int, int], list[np.ndarray]](), 2
    while k < log[0]:
        code, count = int(log[k]), int(log[k + 1])
        found.setdefault((code, count), []).append(log[k + 2 : k + 3 + count])
        k += 3 + count
    if 100 * int(log[0]) > 99 * ENTRIES:
        raise RuntimeError("the log is full: log fewer steps")
    typical = {key: np.median(rows, axis=0) for key, rows in found.items()}
    return Log([Task(len(found[key]) / steps, row[1:], float(row[0])) for key, row in typical.items()])


class Waiting(NamedTuple):
    """Chunks that wait, and note when they begin and end."""

    begun: Any
    ended: Any
    length: Any  # (1,) nanoseconds


@chunk_task
def wait_chunk(waiting, c):
    began = nanoseconds()
    waiting.begun[c] = began
    while nanoseconds() - began < waiting.length[0]:
        pass
    waiting.ended[c] = nanoseconds()


@jit
def delay_rows(waiting: Any, chunks: Chunks, pause: int, rows: Any) -> None:
    """Delays of tasks of two chunks, each after a serial part of this length: see ``Delays``."""
    bound = handle(waiting)
    for k in range(rows.shape[0]):
        since = nanoseconds()
        while nanoseconds() - since < pause:
            pass
        began = nanoseconds()
        each_chunk(bound, chunks, "wait_chunk")
        ended = nanoseconds()
        rows[k, 0] = min(bound.begun[0], bound.begun[1]) - began
        rows[k, 1] = max(bound.begun[0], bound.begun[1]) - began
        rows[k, 2] = ended - max(bound.ended[0], bound.ended[1])


def delays() -> Delays:
    """Medians over those tasks of two chunks in which a helper ran one. Raises Missing on a machine too busy for it."""
    team_of(2).start()
    found = []
    for pause, length in TESTS:
        helped, began = np.zeros((0, 3), np.int64), perf_counter()
        while len(helped) < ENOUGH and perf_counter() - began < LONGEST:
            rows, waiting = np.zeros((TRIES, 3), np.int64), Waiting(*aligned((2, 2), 0, np.int64), np.array([length]))
            delay_rows(waiting, in_chunks(2, 2), pause, rows)
            helped = np.vstack([helped, rows[rows[:, 1] < length]])
            sleep(2e-9 * CROWDED)  # the master may work alone for so long
        if len(helped) < TRIES // 4:
            raise Missing("needs two cores that are free: the second thread seldom came in time")
        found.append(np.median(helped, axis=0))
    awake, asleep = found
    return Delays(float(awake[0]), float(awake[1]), float(max(asleep[1], awake[1])), float(awake[2]))


class Streams(NamedTuple):
    """Arrays that threads read, one a chunk."""

    arrays: Any  # (chunks, size)
    sums: Any  # (chunks, 8)


@chunk_task
def stream_chunk(streams, c):
    streams.sums[c, 0] = sum_of(streams.arrays[c], 1)


@jit
def stream(streams: Any, chunks: Chunks) -> None:
    each_chunk(handle(streams), chunks, "stream_chunk")


def memory_rate(threads: int, turns: int = 5) -> float:
    """Bytes a nanosecond from memory on so many threads, the best of the turns."""
    arrays = aligned((threads, MEMORY // 8 // threads // (8 * WIDTH) * 8 * WIDTH), 1.0)
    streams, chunks, best = Streams(arrays, aligned((threads, 8))), in_chunks(threads, threads), 0.0
    if threads > 1:
        team_of(threads).start()
    for _ in range(turns + 1):  # the first compiles
        began = perf_counter()
        stream(streams, chunks)
        best = max(best, 1e-9 * arrays.nbytes / (perf_counter() - began))
    return best


def memory_of(sim: kd.Simulation, rate: float) -> Memory:
    """Memory of a step of a Lennard-Jones liquid by velocity Verlet, counted by hand from its arrays.

    Bytes a particle: positions to clusters 24 + 24, and 8 for the place. Forces in clusters written and read 48.
    Accelerations added 8 + 48, cleared 24, checked 24. Two kicks 2 (48 + 24), the drift 48 + 24. The rows come
    on top."""
    pairs: Any = sim.integration.flow.forces.forces[0].pairs
    n, clusters = len(sim.system), int(pairs.counts[N_CLUSTERS])
    rows = 8.0 * float(pairs.row_start[:, clusters * WIDTH // pairs.per_row].sum())
    return Memory((56 + 48 + 56 + 48 + 144 + 72) * n + rows, (3 * 24 + 8 + 2 * 24) * n + rows, rate)


def makespan(task: Task, threads: int, delay: Delays) -> float:
    """Nanoseconds of a task. A free thread takes a chunk: the calling thread the first one left, helpers the last."""
    late = delay.asleep if task.before > AWAKE else delay.awake
    free = [(delay.master, 0), *((late * k, k) for k in range(1, min(threads, len(task.chunks))))]
    left, end = deque(task.chunks.tolist()), 0.0
    while left:
        begin, thread = free[0]
        done = begin + (left.pop() if thread else left.popleft())
        end = max(end, done)
        heapreplace(free, (done, thread))
    return end + delay.end


def predicted(log: Log, threads: int, delay: Delays, memory: Memory | None = None) -> float:
    """Nanoseconds of a step on so many threads."""
    if threads == 1:
        return log.whole
    tasks = sum(task.often * makespan(task, threads, delay) for task in log.tasks)
    return max(log.serial + tasks, memory.least if memory else 0.0)

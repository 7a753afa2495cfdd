"""numba's threads, which share the chunks on systems without sleeping threads: the same bits, and threads that meet."""

from __future__ import annotations

import ctypes
import hashlib
import os
import sys
from threading import Thread
from typing import NamedTuple

import numpy as np
import pytest

import kickdrift as kd
from kickdrift.jit.compile import driver
from kickdrift.jit.handle import handle
from kickdrift.jit.threads import chunks
from kickdrift.jit.threads.atomic import add, read
from kickdrift.jit.threads.chunks import Chunks, Team, chunk_task, each_chunk, in_chunks, team_of
from kickdrift.jit.threads.numba_threads import NumbaTeam
from kickdrift.model.starts.builders import lattice, maxwell_boltzmann
from tests.processes import python

CHUNKS, PATIENCE = 37, 10**9
pytestmark = pytest.mark.skipif(sys.platform != "linux", reason="counts threads by Linux's numbers")
number_of_thread = ctypes.CDLL(None).gettid
number_of_thread.argtypes = []


class Row(NamedTuple):
    runs: np.ndarray  # (chunks,) how often each chunk was run


class Tally(NamedTuple):
    runs: np.ndarray  # (chunks,)
    inside: np.ndarray  # (chunks, chunks) runs of the tasks that each chunk shared out itself
    within: Chunks


class Meeting(NamedTuple):
    come: np.ndarray  # (1,) chunks that have begun
    by: np.ndarray  # (chunks,) the thread that ran each chunk, by the system's number
    threads: np.ndarray  # (chunks,) the same by the team's number
    patience: int


@chunk_task
def count_row(row, c):
    row.runs[c] += 1


@chunk_task
def count_runs(bound, c):
    bound.runs[c] += 1
    each_chunk(handle(Row(bound.inside[c])), bound.within, "count_row")


@chunk_task
def meet(meeting, c, thread):
    """Wait until all chunks have begun: each then has a thread of its own."""
    meeting.by[c] = number_of_thread()
    meeting.threads[c] = thread
    place = np.intp(meeting.come.ctypes.data)
    add(place, 1)
    for _ in range(meeting.patience):
        if read(place) >= meeting.by.size:
            break


@driver
def counted(whole, chunks):
    each_chunk(handle(whole), chunks, "count_runs")
    return 0


@driver
def held(whole, chunks):
    each_chunk(handle(whole), chunks, "meet")
    return 0


def run(threads: int) -> None:
    """Run all chunks, each of which shares out others."""
    chunks = in_chunks(CHUNKS, threads)
    tally = Tally(np.zeros(CHUNKS, np.int64), np.zeros((CHUNKS, CHUNKS), np.int64), chunks)
    counted(tally, chunks)
    assert (tally.runs == 1).all()
    assert (tally.inside == 1).all()


def met(threads: int, patience: int = PATIENCE) -> int:
    """Return the number of threads that run as many chunks at once."""
    meeting = Meeting(np.zeros(1, np.int64), *np.zeros((2, threads), np.int64), patience)
    held(meeting, in_chunks(threads, threads))
    found = len({*meeting.by.tolist()})
    assert len({*meeting.threads.tolist()}) == found
    assert (meeting.threads < threads).all()
    return found


def motion(threads: int) -> str:
    """Digest of a liquid after some steps on so many threads; its list is made several times."""
    positions, edges = lattice("sc", 1000, 0.8442)
    velocities = maxwell_boltzmann(np.ones(1000), 3.0, 1.0, seed=1)
    system = kd.System(positions, velocities, box=edges, forces=[kd.LennardJones(cutoff=2.5)])
    sim = kd.Simulation(system, dt=0.005, threads=threads)
    sim.run(40)
    assert sim.integration.flow.forces.list_builds[0] > 1
    return hashlib.sha256(sim.state.phase.tobytes()).hexdigest()


def all_by_numba() -> None:
    """Print what a process with numba's threads finds."""
    chunks.SLEEPING = False
    assert isinstance(team_of(2), NumbaTeam)
    digests = [motion(threads) for threads in (1, 2)]
    print("helped:", team_of(2).helped > 0)
    print("threads:", met(2), met(3))
    callers = [Thread(target=run, args=(threads,)) for threads in (2, 3, 2, 3)]
    for each in callers:
        each.start()
    for each in callers:
        each.join()
    child = os.fork()
    if not child:
        run(2)
        os._exit(0 if met(2, patience=1) == 1 else 1)
    print("child:", os.waitpid(child, 0)[1])
    print("bits:", *digests)


@pytest.mark.parametrize("layer", ["workqueue", pytest.param("default", marks=pytest.mark.long)])
def test_chunks_on_threads_of_numba(layer):
    run = python(f"from {__name__} import all_by_numba as f; f()", NUMBA_NUM_THREADS="3", NUMBA_THREADING_LAYER=layer)
    one = motion(1)
    expected = ["helped: True", "threads: 2 3", "child: 0", f"bits: {one} {one}"]
    assert run.stdout.splitlines() == expected, run.stderr


@pytest.mark.parametrize(("sleeping", "kind"), [(True, Team), (False, NumbaTeam)])
def test_the_team_of_a_system(monkeypatch, sleeping, kind):
    monkeypatch.setattr(chunks, "SLEEPING", sleeping)
    made = team_of.__wrapped__(2)
    assert isinstance(made, kind)
    assert made.address

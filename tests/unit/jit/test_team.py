"""Threads that share chunks: each chunk runs once, whoever asks, and threads without work do no harm."""

from __future__ import annotations

import ctypes
import os
import signal
import warnings
from pathlib import Path
from threading import Thread, get_native_id
from typing import NamedTuple

import numpy as np
import pytest

import kickdrift as kd
from kickdrift.forces.bound.forces import most_threads
from kickdrift.jit.compile import driver
from kickdrift.jit.handle import handle
from kickdrift.jit.threads.chunks import Chunks, chunk_task, each_chunk, in_chunks, team_of
from kickdrift.model.starts.builders import lattice, maxwell_boltzmann

CHUNKS, TURNS = 37, 200
number_of_thread = ctypes.CDLL(None).gettid
number_of_thread.argtypes = []


class Tally(NamedTuple):
    runs: np.ndarray  # (chunks,) how often each chunk was run
    inside: np.ndarray  # (chunks, chunks) the same for the tasks that each chunk shared out itself
    within: Chunks


class Row(NamedTuple):
    runs: np.ndarray


@chunk_task
def tally_row(row, c):
    row.runs[c] += 1


@chunk_task
def tally(bound, c):
    bound.runs[c] += 1
    each_chunk(handle(Row(bound.inside[c])), bound.within, "tally_row")


@driver
def tallied(whole, chunks, turns):
    bound = handle(whole)
    for _ in range(turns):
        each_chunk(bound, chunks, "tally")
    return 0


class Owners(NamedTuple):
    by: np.ndarray  # (chunks,) the thread that ran each chunk, by the system's number
    threads: np.ndarray  # (chunks,) the same by the team's number


@chunk_task
def own(owners, c, thread):
    owners.by[c] = number_of_thread()
    owners.threads[c] = thread


@driver
def owned(whole, chunks):
    each_chunk(handle(whole), chunks, "own")
    return 0


def run(threads: int, turns: int = TURNS) -> bool:
    """Run the task so many times; tell whether each chunk ran once in each, and the chunks within it as well."""
    chunks = in_chunks(CHUNKS, threads)
    whole = Tally(np.zeros(CHUNKS, np.int64), np.zeros((CHUNKS, CHUNKS), np.int64), chunks)
    tallied(whole, chunks, turns)
    return bool((whole.runs == turns).all() and (whole.inside == turns).all())


@pytest.mark.parametrize("threads", [1, 2, 3, 8])
def test_each_chunk_runs_once(threads):
    team_of(threads).start()
    assert run(threads)


def test_a_team_without_helpers_does_all_chunks():
    assert run(7)
    assert team_of(7).helped == 0


@pytest.mark.skipif(len(os.sched_getaffinity(0)) < 2, reason="one core: helpers get none")
def test_helpers_help():
    team_of(2).insist()
    team_of(2).start()
    before = team_of(2).helped
    for _ in range(2000):
        assert run(2)
        if team_of(2).helped > before:
            return
    pytest.fail("no chunk was run by a helper")


@pytest.mark.skipif(len(os.sched_getaffinity(0)) < 2, reason="one core: helpers get none")
def test_the_caller_runs_the_first_chunks_and_the_helper_the_last():
    team_of(2).insist()
    team_of(2).start()
    owners, shared = Owners(*np.zeros((2, CHUNKS), np.int64)), 0
    for _ in range(20_000):
        owned(owners, in_chunks(CHUNKS, 2))
        callers = owners.by == get_native_id()
        assert (callers == np.sort(callers)[::-1]).all()
        assert (owners.threads == ~callers).all()
        shared += not callers.all()
        if shared == 10:
            return
    pytest.fail("the helper ran chunks in fewer than 10 turns")


@pytest.mark.parametrize("count", [10**3, 28**3])
def test_helpers_change_no_bit_of_a_liquid(count):
    """Chunks of forces, positions, the list and its sort; with many particles those of kicks and drifts as well."""
    if most_threads() < 2:
        pytest.skip("NUMBA_NUM_THREADS allows one thread")
    positions, edges = lattice("sc", count, 0.8442)
    velocities = maxwell_boltzmann(np.ones(count), 3.0, 1.0, seed=1)
    force, ends = kd.LennardJones(cutoff=2.5), []
    team_of(2).insist()
    before = team_of(2).helped
    for threads in (1, 2):
        sim = kd.Simulation(kd.System(positions, velocities, box=edges, forces=[force]), dt=0.005, threads=threads)
        sim.run(40)
        assert sim.integration.flow.forces.list_builds[0] > 1
        ends.append(sim.state.phase.tobytes())
    assert ends[0] == ends[1]
    assert len(os.sched_getaffinity(0)) < 2 or team_of(2).helped > before


def test_two_threads_of_python_may_ask_at_once():
    team_of(3).start()
    found: list[bool] = []
    callers = [Thread(target=lambda: found.append(run(3))) for _ in range(4)]
    for each in callers:
        each.start()
    for each in callers:
        each.join()
    assert found == [True] * 4


def test_a_forked_process_begins_with_helpers_of_its_own():
    team_of(2).start()
    assert run(2)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", DeprecationWarning)  # Python warns of forks where threads run
        child = os.fork()
    if not child:
        alone = run(2) and team_of(2).helped == 0
        team_of(2).start()
        os._exit(0 if alone and run(2) and len(os.listdir("/proc/self/task")) == 2 else 1)
    assert os.waitpid(child, 0)[1] == 0
    assert run(2)


def test_signals_go_to_the_threads_of_python():
    tasks = Path("/proc/self/task")
    before = {each.name for each in tasks.iterdir()}
    team_of(5).start()
    new = [each for each in tasks.iterdir() if each.name not in before]
    assert len(new) == 4
    for each in new:
        status = dict(line.split(":", 1) for line in (each / "status").read_text().splitlines())
        assert int(status["SigBlk"], 16) >> (signal.SIGINT - 1) & 1
    assert signal.SIGINT not in signal.pthread_sigmask(signal.SIG_BLOCK, ())

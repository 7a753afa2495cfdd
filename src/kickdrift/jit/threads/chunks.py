"""Work in chunks, serial or on threads that sleep when there is none, by the same code and with the same bits.

A *task* is a jitted function ``task(bound, c)`` of a handle and a chunk's number. ``each_chunk(bound, chunks, task
name)`` runs the task for every chunk. A task may also be ``task(bound, c, thread)``: threads that run chunks of a task
at the same time have different numbers, which begin with 0. Tasks are named, not passed, since numba cannot cache a
function that takes functions. Both ways of running call the task by its address. So the compiler makes one copy of a
task, and no second copy can round differently.

A *team* is a thread that asks, the master, and threads that help. The master publishes a task and its number of chunks.
Each thread takes the next chunk until none is left, so a slow core takes fewer. The master takes chunks too, and waits
only for chunks that helpers have begun. So helpers that get no core cost nothing.

The two halves of one number, the *ticket*, are the first chunk that is left and the last chunk plus 1. The master takes
the first chunk, a helper the last. So a core mostly gets the same chunks in each task, and finds their memory in its
cache. A thread takes a chunk by changing the ticket, if the ticket is still as the thread has read it. So each chunk
has one thread. A ticket of a later task may be equal; the thread then takes a chunk of that task.

A helper without work looks out for the next task for a short time, then sleeps. Two things happen on a busy machine,
and after both the master works alone for some milliseconds. The system may put a helper on the master's own core. The
helper then sleeps at once. Or a helper may lose its core within a chunk, and the master waits until it runs again.

Only Linux has these teams. Elsewhere `team_of` returns a team of numba's threads.
"""

import ctypes
import os
import signal
import sys
from collections.abc import Callable
from functools import cache
from inspect import signature
from threading import Lock
from typing import Any, NamedTuple

import numpy as np
from llvmlite import ir
from numba import types
from numba.extending import intrinsic
from numpy.typing import NDArray

from kickdrift.jit.compile import as_written, jit
from kickdrift.jit.handle import Handle, address, callback
from kickdrift.jit.inner import by_type
from kickdrift.jit.lanes.memory import LINE, aligned
from kickdrift.jit.threads.atomic import add, core, lock, nanoseconds, pause, read, replace, sleep, unlock, wake, write
from kickdrift.jit.threads.numba_threads import TASK, NumbaTeam, call_task

SLEEPING = sys.platform == "linux"  # whether teams are of sleeping threads; the others are of numba's threads

(  # places in a team's memory. Cores exchange whole cache lines, so numbers of different threads lie apart
    CODE,
    TICKET,
    DONE,
    TASK_CODE,
    TASK_PLACE,
    TASK_CHUNKS,
    BUSY,
    ASLEEP,
    WAITS,
    ALONE_UNTIL,
    MASTERS_CORE,
    HELPED,
    INSISTS,
    HELPERS,
) = (LINE * k for k in range(14))
HELPERS_LOCK, HELPERS_WAKE, MASTER_LOCK, MASTER_WAKE, SIZE = (LINE * (14 + 4 * k) for k in range(5))

HALF = 32  # bits of a ticket for each end of the chunks that are left
FIRST, LAST = 1 << HALF, 1  # units of the ticket's halves: the first chunk, the last plus 1
NOWHERE = -2  # core of a master that sleeps; no system answers so
AWAKE = 50_000  # nanoseconds that a thread waits awake; between two tasks of 1000 particles 10,000 pass
LATE = 3  # mean times of the master's own chunks: a helper that takes longer has lost its core
REST = 8  # lengths of this wait for which the master then works alone
CROWDED = 10_000_000  # nanoseconds in which the master works alone after a helper was on its core


class Team:
    """A number of threads: the caller and its helpers. ``address`` is the team's memory for compiled code."""

    def __init__(self, threads: int) -> None:
        self._helpers = threads - 1
        self._memory: NDArray[np.int64] = aligned((SIZE // 8,), 0, np.int64)
        self._memory[CODE // 8] = _kept(_share, types.void(*4 * [types.intp])).address
        self.address = int(self._memory.ctypes.data)
        os.register_at_fork(after_in_child=self._begin)
        self._begin()

    def _begin(self) -> None:
        """Begin without helpers, as in a forked process. A master without helpers works alone, with the same bits."""
        self._lock, self._started = Lock(), False
        self._memory[TICKET // 8 :] = 0

    def start(self) -> None:
        """Start the helpers, unless they run."""
        with self._lock:
            if self._started:
                return
            library, name = ctypes.CDLL(None), ctypes.c_ulong()
            serve = ctypes.c_void_p(_kept(_serve, types.intp(types.intp)).address)
            for place in (HELPERS_LOCK, MASTER_LOCK):
                library.pthread_mutex_init(ctypes.c_void_p(self.address + place), None)
            for place in (HELPERS_WAKE, MASTER_WAKE):
                library.pthread_cond_init(ctypes.c_void_p(self.address + place), None)
            # helpers inherit blocked signals, so that Ctrl-C reaches a thread of Python
            before = signal.pthread_sigmask(signal.SIG_BLOCK, signal.valid_signals())
            try:
                for _ in range(self._helpers):
                    library.pthread_create(ctypes.byref(name), None, serve, ctypes.c_void_p(self.address))
            finally:
                signal.pthread_sigmask(signal.SIG_SETMASK, before)
            self._started = True

    def insist(self) -> None:
        """Use the helpers on a busy machine too, for tests: they then run beside the master, however slowly."""
        self._memory[INSISTS // 8] = 1

    @property
    def helped(self) -> int:
        """Number of chunks that helpers have run."""
        return int(self._memory[HELPED // 8])


@cache
def team_of(threads: int) -> Team | NumbaTeam:
    """Return the team of this number of threads, which all runs of the process share."""
    return Team(threads) if SLEEPING else NumbaTeam(threads)


@cache
def _kept(function: Callable[..., Any], of: Any) -> Any:
    """Machine code for the life of the process."""
    return callback(function, of, types.none)


def _share(team, code, place, count):
    share(team, code, place, count)


def _serve(team):
    serve(team)
    return 0


@jit
def share(team, code, place, count):
    """Run a task on all chunks, with those helpers that come in time."""
    if not taken(team):
        for c in range(count):
            call_task(code, place, c, 0)
        return
    write(team + TASK_CODE, code)
    write(team + TASK_PLACE, place)
    write(team + TASK_CHUNKS, count)
    write(team + MASTERS_CORE, core())
    write(team + DONE, 0)
    begin = nanoseconds()
    write(team + TICKET, count)
    asleep = read(team + ASLEEP)
    if asleep:
        lock(team + HELPERS_LOCK)
        for _ in range(min(asleep, count - 1)):
            wake(team + HELPERS_WAKE)
        unlock(team + HELPERS_LOCK)
    own = 0
    while take_chunk(team, FIRST, 0):
        own += 1
    if read(team + DONE) != count:
        wait(team, count, begin, own)
    write(team + BUSY, 0)


@jit
def taken(team):
    """Take the team, and tell whether this succeeds.

    The team may be another thread's that called from Python, or that of a task that called this one."""
    until = read(team + ALONE_UNTIL)
    if until:
        if nanoseconds() < until and not read(team + INSISTS):
            return False
        write(team + ALONE_UNTIL, 0)
    return replace(team + BUSY, 0, 1)


@jit
def chunks_left(ticket):
    """Return the number of chunks that no thread has taken."""
    return (ticket & FIRST - 1) - (ticket >> HALF)


@jit
def take_chunk(team, end, thread):
    """Run the ``FIRST`` or the ``LAST`` chunk that is left on this thread; tell whether there was one."""
    while True:
        ticket = read(team + TICKET)
        if chunks_left(ticket) == 0:
            return False
        if replace(team + TICKET, ticket, ticket + FIRST if end == FIRST else ticket - LAST):
            break
    chunk = ticket >> HALF if end == FIRST else (ticket & FIRST - 1) - 1
    count = read(team + TASK_CHUNKS)  # the task lasts until this chunk is done
    call_task(read(team + TASK_CODE), read(team + TASK_PLACE), chunk, thread)
    if add(team + DONE, 1) == count and read(team + WAITS):
        lock(team + MASTER_LOCK)
        wake(team + MASTER_WAKE)
        unlock(team + MASTER_LOCK)
    return True


@jit
def wait(team, count, begin, own):
    """Wait for the helpers' chunks. The master has run ``own`` chunks since ``begin``."""
    since = now = nanoseconds()
    while read(team + DONE) != count:
        for _ in range(8):
            pause()
        now = nanoseconds()
        if now - since > AWAKE:
            lock(team + MASTER_LOCK)
            write(team + MASTERS_CORE, NOWHERE)
            write(team + WAITS, 1)
            while read(team + DONE) != count:
                sleep(team + MASTER_WAKE, team + MASTER_LOCK)
            write(team + WAITS, 0)
            unlock(team + MASTER_LOCK)
            now = nanoseconds()
    if own and now - since > AWAKE + LATE * (since - begin) // own:
        write(team + ALONE_UNTIL, now + REST * (now - since))


@jit
def serve(team):
    """Help with all tasks, for ever. The master is thread 0, and helpers count on."""
    thread = add(team + HELPERS, 1)
    while True:
        since = nanoseconds()
        while chunks_left(read(team + TICKET)) == 0:
            for _ in range(8):
                pause()
            if nanoseconds() - since > AWAKE or on_masters_core(team):
                sleep_until_woken(team)
                since = nanoseconds()
        while not on_masters_core(team) and take_chunk(team, LAST, thread):
            add(team + HELPED, 1)
        if on_masters_core(team):
            write(team + ALONE_UNTIL, nanoseconds() + CROWDED)
            sleep_until_woken(team)


@jit
def on_masters_core(team):
    """Tell whether this helper keeps the master from running."""
    return read(team + MASTERS_CORE) == core() and not read(team + INSISTS)


@jit
def sleep_until_woken(team):
    """Sleep until the master publishes a task. A task of just now goes on without this helper."""
    lock(team + HELPERS_LOCK)
    add(team + ASLEEP, 1)
    sleep(team + HELPERS_WAKE, team + HELPERS_LOCK)
    add(team + ASLEEP, -1)
    unlock(team + HELPERS_LOCK)


TASKS: dict[str, Any] = {}
_WHOLE = ir.IntType(64)
_LOOP = ir.FunctionType(ir.VoidType(), [_WHOLE] * 4)  # type of the loop on threads: team, task, handle, chunks


class Chunks(NamedTuple):
    """Number of chunks, and how they run."""

    number: int
    team: int  # address of the team of threads that shares the chunks; 0: serial


def in_chunks(count: int, threads: int) -> Chunks:
    """Chunks on threads, or serial if there is only one chunk or one thread."""
    return Chunks(count, team_of(threads).address if threads > 1 and count > 1 else 0)


def chunk_task(function: Any) -> Any:
    """Register a task under its function's name, which no other task may have."""
    assert function.__name__ not in TASKS, f"two tasks are named {function.__name__}"
    TASKS[function.__name__] = as_written(function)
    return TASKS[function.__name__]


@by_type(prefer_literal=True)
def each_chunk(bound, chunks, name):
    """Run the named task on every chunk."""
    if not isinstance(name, types.StringLiteral) or not isinstance(bound, Handle):
        return None

    def run(bound, chunks, name):
        code, place = _task_code(bound, name), address(bound)
        if chunks.team == 0:
            for c in range(chunks.number):
                call_task(code, place, c, 0)
        else:
            _call_team(chunks.team, code, place, chunks.number)

    return run


@intrinsic(prefer_literal=True)
def _task_code(typingctx, bound, name):
    """Address of a task for this type of handle, as a function of three whole numbers."""
    if not isinstance(name, types.StringLiteral):  # tried after the literal failed; the literal's error is clearer
        return None
    task = TASKS[name.literal_value]
    numbers = len(signature(task.py_func).parameters) - 1  # the chunk, and perhaps the thread
    own = typingctx.resolve_function_type(types.Dispatcher(task), (bound, *numbers * [types.intp]), {})

    def codegen(context, builder, sig, args):
        compiled = task.overloads[own.args]
        entry_name = f"{compiled.fndesc.llvm_func_name}.entry"
        entry = builder.module.globals.get(entry_name)
        if entry is None:
            entry = ir.Function(builder.module, TASK, entry_name)
            entry.linkage = "internal"
            inside = ir.IRBuilder(entry.append_basic_block())
            handle = inside.inttoptr(entry.args[0], context.get_value_type(bound))
            context.add_linking_libs([compiled.library])
            context.call_internal_no_propagate(inside, compiled.fndesc, own, [handle, *entry.args[1 : 1 + numbers]])
            inside.ret_void()
        return builder.ptrtoint(entry, _WHOLE)

    return types.intp(bound, name), codegen


@intrinsic
def _call_team(typingctx, team, code, place, count):
    """Run the task at an address on all chunks, by the code whose address the team's memory begins with."""

    def codegen(context, builder, sig, args):
        loop = builder.load(builder.inttoptr(args[0], _LOOP.as_pointer().as_pointer()))
        builder.call(loop, args)
        return context.get_dummy_value()

    return types.void(types.intp, types.intp, types.intp, types.intp), codegen

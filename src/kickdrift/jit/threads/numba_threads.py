"""Threads of numba that share the chunks of compiled code, for systems without the sleeping threads of `chunks`.

Each thread takes the next chunk until none is left. One loop of numba runs at a time, since some of numba's threads
allow no more: a second caller works alone.
"""

import os
from functools import cache
from typing import Any

import numpy as np
from llvmlite import ir
from numba import get_num_threads, njit, prange, types
from numba.extending import intrinsic
from numpy.typing import NDArray

from kickdrift.jit.handle import callback
from kickdrift.jit.lanes.memory import LINE, aligned
from kickdrift.jit.threads.atomic import add, read, replace, write

_WHOLE = ir.IntType(64)
TASK = ir.FunctionType(ir.VoidType(), 3 * [_WHOLE])  # type of a task: address of its handle, chunk, thread


@intrinsic
def call_task(typingctx, code, place, c, thread):
    """Run the task at an address on chunk c, on the thread of this number."""

    def codegen(context, builder, sig, args):
        builder.call(builder.inttoptr(args[0], TASK.as_pointer()), args[1:])
        return context.get_dummy_value()

    return types.void(*4 * [types.intp]), codegen


CODE, TURNS, THREADS, LEFT, HELPED = (LINE * k for k in range(5))  # numbers of different threads lie apart
_TURNS: NDArray[np.int64] = aligned((LINE // 8,), 0, np.int64)  # 1 while a loop of any team runs


def _work_alone() -> None:
    """Use no other thread from now on: a forked process has none of numba's threads."""
    _TURNS[0] = 1


if hasattr(os, "register_at_fork"):
    os.register_at_fork(after_in_child=_work_alone)


class NumbaTeam:
    """A number of numba's threads, with the face of a `Team`."""

    def __init__(self, threads: int) -> None:
        self._memory: NDArray[np.int64] = aligned((5 * LINE // 8,), 0, np.int64)
        self.address = int(self._memory.ctypes.data)
        self._memory[[CODE // 8, TURNS // 8, THREADS // 8]] = _code().address, _TURNS.ctypes.data, threads

    def start(self) -> None:
        """Start the threads, which have run since this team was made."""

    def insist(self) -> None:
        """Use all threads on a busy machine too, as numba always does."""

    @property
    def helped(self) -> int:
        """Number of chunks that all threads but one have run."""
        return int(self._memory[HELPED // 8])


@cache
def _code() -> Any:
    """Machine code for the life of the process."""
    get_num_threads()  # starts numba's threads, which machine code from disk needs
    return callback(_share, types.void(*4 * [types.intp]), types.none)


def _share(team, code, place, count):
    if not replace(read(team + TURNS), 0, 1):
        for c in range(count):
            call_task(code, place, c, 0)
        return
    write(team + LEFT, count)
    _share_out(team, code, place, count, min(read(team + THREADS), count))
    write(read(team + TURNS), 0)


@njit(error_model="numpy", parallel=True)
def _share_out(team, code, place, count, threads):
    for thread in prange(threads):
        left = add(team + LEFT, -1)
        while left >= 0:
            call_task(code, place, count - 1 - left, thread)
            if thread > 0:
                add(team + HELPED, 1)
            left = add(team + LEFT, -1)

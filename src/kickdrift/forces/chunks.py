"""Work in chunks: one after the other or on threads, with the same machine code and so the same bits.

A *task* is a jitted function ``task(bound, c)`` of a handle and a chunk's number; ``each_chunk(bound, task name)`` runs
it for every chunk. Tasks are named, not passed, since a function that takes functions could not be cached.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numba import njit, prange, types

from kickdrift.forces.compiling import FAST_MATH, jit
from kickdrift.forces.handle import Handle, address, handle_at
from kickdrift.forces.inner import overload

TASKS: dict[str, Any] = {}


class Serial(NamedTuple):
    """Chunks one after the other."""

    chunks: int


class Parallel(NamedTuple):
    """Chunks on as many threads as numba is set to."""

    chunks: int


def chunk_task(function: Any) -> Any:
    """Register a task under its function's name."""
    TASKS[function.__name__] = jit(function)
    return TASKS[function.__name__]


def each_chunk(bound: Any, threads: Serial | Parallel, name: str) -> None:
    """Run the task of that name on every chunk."""
    raise NotImplementedError("for compiled code")


@overload(each_chunk, prefer_literal=True)
def _each_chunk(bound, threads, name):
    if not isinstance(name, types.StringLiteral) or not isinstance(bound, Handle):
        return None
    task = TASKS[name.literal_value]
    if threads.instance_class is Serial:

        def serial(bound, threads, name):
            for c in range(threads.chunks):
                task(bound, c)

        return serial
    restore = handle_at(bound)

    @njit(error_model="numpy", fastmath=FAST_MATH, parallel=True)
    def on_threads(number, chunks):
        for c in prange(chunks):
            task(restore(number), np.intp(c))  # c is unsigned here, for which the task would be compiled anew

    return lambda bound, threads, name: on_threads(address(bound), threads.chunks)

"""Work in chunks, serial or on threads, by the same machine code and with the same bits.

A *task* is a jitted function ``task(bound, c)`` of a handle and a chunk's number. ``each_chunk(bound, chunks, task
name)`` runs the task for every chunk. Tasks are named, not passed, since numba cannot cache a function that takes
functions. Both ways of running call the task by its address. So the compiler makes one copy of a task, and no second
copy can round differently.
"""

from __future__ import annotations

from functools import cache
from typing import Any, NamedTuple

import numpy as np
from llvmlite import ir
from numba import get_num_threads, njit, prange, types
from numba.extending import intrinsic

from kickdrift.jit.callback import callback
from kickdrift.jit.compile import as_written
from kickdrift.jit.handle import Handle, address
from kickdrift.jit.inner import overload

TASKS: dict[str, Any] = {}
_WHOLE = ir.IntType(64)
_CODE = ir.FunctionType(ir.VoidType(), [_WHOLE, _WHOLE])  # type of a task: address of its handle, chunk
_LOOP = ir.FunctionType(ir.VoidType(), [_WHOLE, _WHOLE, _WHOLE])  # type of the threads' loop: task, handle, chunks


class Chunks(NamedTuple):
    """Number of chunks, and how they run."""

    number: int
    loop: int  # address of the loop that shares chunks among threads; 0: serial


def in_chunks(count: int, threads: int) -> Chunks:
    """Chunks on threads, or serial if there is only one chunk or one thread."""
    return Chunks(count, _loop_on_threads() if threads > 1 and count > 1 else 0)


@cache
def _loop_on_threads() -> int:
    get_num_threads()  # starts numba's threads, which machine code from disk needs
    return int(callback(_on_threads, types.void(types.intp, types.intp, types.intp), types.none).address)


def _on_threads(code, place, count):
    _shared_out(code, place, count)


@njit(error_model="numpy", parallel=True)
def _shared_out(code, place, count):
    for c in prange(count):
        _call_task(code, place, np.intp(c))  # c is unsigned in this loop


def chunk_task(function: Any) -> Any:
    """Register a task under its function's name."""
    TASKS[function.__name__] = as_written(function)
    return TASKS[function.__name__]


def each_chunk(bound: Any, chunks: Chunks, name: str) -> None:
    """Run the named task on every chunk."""
    raise NotImplementedError("for compiled code")


@overload(each_chunk, prefer_literal=True)
def _each_chunk(bound, chunks, name):
    if not isinstance(name, types.StringLiteral) or not isinstance(bound, Handle):
        return None

    def run(bound, chunks, name):
        code, place = _task_code(bound, name), address(bound)
        if chunks.loop == 0:
            for c in range(chunks.number):
                _call_task(code, place, c)
        else:
            _call_loop(chunks.loop, code, place, chunks.number)

    return run


@intrinsic(prefer_literal=True)
def _task_code(typingctx, bound, name):
    """Address of a task for this type of handle, as a function of two whole numbers."""
    if not isinstance(name, types.StringLiteral):  # tried after the literal failed; the literal's error is clearer
        return None
    task = TASKS[name.literal_value]
    own = typingctx.resolve_function_type(types.Dispatcher(task), (bound, types.intp), {})

    def codegen(context, builder, sig, args):
        compiled = task.overloads[own.args]
        entry_name = f"{compiled.fndesc.llvm_func_name}.entry"
        entry = builder.module.globals.get(entry_name)
        if entry is None:
            entry = ir.Function(builder.module, _CODE, entry_name)
            entry.linkage = "internal"
            inside = ir.IRBuilder(entry.append_basic_block())
            handle = inside.inttoptr(entry.args[0], context.get_value_type(bound))
            context.add_linking_libs([compiled.library])
            context.call_internal_no_propagate(inside, compiled.fndesc, own, [handle, entry.args[1]])
            inside.ret_void()
        return builder.ptrtoint(entry, _WHOLE)

    return types.intp(bound, name), codegen


@intrinsic
def _call_task(typingctx, code, place, c):
    """Run the task at an address on chunk c."""

    def codegen(context, builder, sig, args):
        builder.call(builder.inttoptr(args[0], _CODE.as_pointer()), args[1:])
        return context.get_dummy_value()

    return types.void(types.intp, types.intp, types.intp), codegen


@intrinsic
def _call_loop(typingctx, loop, code, place, count):
    """Run the task at an address on all chunks, by the loop at another address."""

    def codegen(context, builder, sig, args):
        builder.call(builder.inttoptr(args[0], _LOOP.as_pointer()), args[1:])
        return context.get_dummy_value()

    return types.void(types.intp, types.intp, types.intp, types.intp), codegen

"""Work in chunks, serial or on threads, by the same machine code and with the same bits.

A *task* is a jitted function ``task(bound, c)`` of a handle and a chunk's number. ``each_chunk(bound, chunks, task
name)`` runs the task for every chunk. A task may also be ``task(bound, c, thread)``: threads that run chunks of a task
at the same time have different numbers, which begin with 0. Tasks are named, not passed, since numba cannot cache a
function that takes functions. Both ways of running call the task by its address. So the compiler makes one copy of a
task, and no second copy can round differently.
"""

from __future__ import annotations

from inspect import signature
from typing import Any, NamedTuple

from llvmlite import ir
from numba import types
from numba.extending import intrinsic

from kickdrift.jit.compile import as_written
from kickdrift.jit.handle import Handle, address
from kickdrift.jit.inner import overload
from kickdrift.jit.threads.numba_threads import TASK, call_task
from kickdrift.jit.threads.team import team_of

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

"""Tasks by their addresses: what threads call for each chunk."""

from __future__ import annotations

from llvmlite import ir
from numba import types
from numba.extending import intrinsic

_WHOLE = ir.IntType(64)
TASK = ir.FunctionType(ir.VoidType(), 3 * [_WHOLE])  # type of a task: address of its handle, chunk, thread


@intrinsic
def call_task(typingctx, code, place, c, thread):
    """Run the task at an address on chunk c, on the thread of this number."""

    def codegen(context, builder, sig, args):
        builder.call(builder.inttoptr(args[0], TASK.as_pointer()), args[1:])
        return context.get_dummy_value()

    return types.void(*4 * [types.intp]), codegen

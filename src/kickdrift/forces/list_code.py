"""The pair list's machine code: compiled once for all pair forces, which call it by its address.

It is most of what a pair force takes to compile, and knows neither laws nor truncations nor species.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from llvmlite import ir
from numba import carray, typeof, types
from numba.extending import intrinsic

from kickdrift.forces import pairlist
from kickdrift.forces.clusters import ClusterList
from kickdrift.forces.kernel import OK
from kickdrift.jit.callback import callback
from kickdrift.jit.chunks import Chunks
from kickdrift.jit.compile import jit
from kickdrift.jit.handle import Handle, address, handle_at

REFRESH, PRUNE = range(2)  # what the code is asked for
_CODE: dict[Any, Any] = {}  # by the type of list
_SIGNATURE = types.int64(*5 * [types.int64], types.CPointer(types.float64))


def list_code(pairs: ClusterList) -> int:
    """The address of the code for a list of that type; compiled if need be."""
    kind = typeof(pairs)
    if kind not in _CODE:
        _CODE[kind] = callback(_upkeep_for(kind), _SIGNATURE, kind)
    return int(_CODE[kind].address)


def _upkeep_for(kind: types.BaseTuple) -> Callable[..., int]:
    restore = handle_at(Handle(kind))

    def upkeep(place, count, loop, what, n, x):
        pairs, chunks = restore(place), Chunks(count, loop)
        if what == PRUNE:
            pairlist.prune(pairs, chunks)
            return OK
        return pairlist.refresh(pairs, carray(x, (3, n)), chunks)

    return upkeep


@intrinsic
def _call(typingctx, code, place, count, loop, what, x):
    """Call the code at that address."""

    def codegen(context, builder, sig, args):
        whole, number = ir.IntType(64), ir.DoubleType().as_pointer()
        kind = ir.FunctionType(whole, [*5 * [whole], number])
        array = context.make_array(sig.args[5])(context, builder, args[5])
        pointer = builder.inttoptr(args[0], kind.as_pointer())
        return builder.call(pointer, [*args[1:5], builder.extract_value(array.shape, 1), array.data])

    return types.int64(code, place, types.int64, types.int64, types.int64, x), codegen


@jit
def refresh(pairs, x, chunks):
    """Bring the list up to date with positions x (3, n), contiguous; a status."""
    return _call(pairs.code, address(pairs), chunks.number, chunks.loop, REFRESH, x)


@jit
def prune(pairs, chunks):
    """Make the inner list from the outer one."""
    _call(pairs.code, address(pairs), chunks.number, chunks.loop, PRUNE, pairs.built_at)

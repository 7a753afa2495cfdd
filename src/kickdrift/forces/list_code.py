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
from kickdrift.forces.chunks import Parallel, Serial
from kickdrift.forces.clusters import ClusterList
from kickdrift.forces.compiling import callback, jit
from kickdrift.forces.handle import Handle, address, handle_at
from kickdrift.forces.kernel import OK

REFRESH, PRUNE = range(2)  # what the code is asked for
_CODE: dict[Any, Any] = {}  # by the types of list and threads
_SIGNATURE = types.int64(types.intp, types.int64, types.int64, types.int64, types.CPointer(types.float64))


def list_code(pairs: ClusterList, threads: Serial | Parallel) -> int:
    """The address of the code for a list of that type, on threads or not; compiled if need be."""
    kind = typeof((pairs, threads))
    if kind not in _CODE:
        _CODE[kind] = callback(_upkeep_for(kind[0], type(threads)), _SIGNATURE, kind)
    return int(_CODE[kind].address)


def _upkeep_for(kind: types.BaseTuple, threads: type[Serial] | type[Parallel]) -> Callable[..., int]:
    restore = handle_at(Handle(kind))

    def upkeep(place, chunks, what, n, x):
        pairs = restore(place)
        if what == PRUNE:
            pairlist.prune(pairs, threads(chunks))
            return OK
        return pairlist.refresh(pairs, carray(x, (3, n)), threads(chunks))

    return upkeep


@intrinsic
def _call(typingctx, code, place, chunks, what, x):
    """Call the code at that address."""

    def codegen(context, builder, sig, args):
        whole, number = ir.IntType(64), ir.DoubleType().as_pointer()
        kind = ir.FunctionType(whole, [whole, whole, whole, whole, number])
        array = context.make_array(sig.args[4])(context, builder, args[4])
        pointer = builder.inttoptr(args[0], kind.as_pointer())
        return builder.call(pointer, [*args[1:4], builder.extract_value(array.shape, 1), array.data])

    return types.int64(code, place, types.int64, types.int64, x), codegen


@jit
def refresh(pairs, x, threads):
    """Bring the list up to date with positions x (3, n), contiguous; a status."""
    return _call(pairs.code, address(pairs), threads.chunks, REFRESH, x)


@jit
def prune(pairs, threads):
    """Make the inner list from the outer one."""
    _call(pairs.code, address(pairs), threads.chunks, PRUNE, pairs.built_at)

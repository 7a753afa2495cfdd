"""Machine code of the pair list, compiled once for all pair forces, which call it by its address.

The pair list takes most of a pair force's time to compile. It does not depend on laws, truncations or species.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from llvmlite import ir
from numba import carray, typeof, types
from numba.extending import intrinsic

from kickdrift.forces.lists import pairlist
from kickdrift.forces.lists.clusters import ClusterList
from kickdrift.forces.seam.kernel import OK
from kickdrift.jit.compile import jit
from kickdrift.jit.handle import Handle, address, callback, handle_at
from kickdrift.jit.threads.chunks import Chunks

REFRESH, PRUNE, OUTLAST, ADOPT = range(4)  # tasks of the code
_CODE: dict[Any, Any] = {}  # addresses, by the type of list
_SIGNATURE = types.int64(*5 * [types.int64], types.CPointer(types.float64))


def list_code(pairs: ClusterList) -> int:
    """Return the address of the code for this type of list, compiled on first use."""
    kind = typeof(pairs)
    if kind not in _CODE:
        _CODE[kind] = callback(_upkeep_for(kind), _SIGNATURE, kind)
    return int(_CODE[kind].address)


def _upkeep_for(kind: types.BaseTuple) -> Callable[..., int]:
    restore = handle_at(Handle(kind))

    def upkeep(place, count, team, what, n, x):
        pairs, chunks = restore(place), Chunks(count, team)
        if what == REFRESH:
            return pairlist.refresh(pairs, carray(x, (3, n)), chunks)
        if what == OUTLAST:
            return pairlist.outlasts(pairs, chunks)
        pairlist.adopt(pairs)
        if what == PRUNE:
            pairlist.prune(pairs, chunks)
        return OK

    return upkeep


@intrinsic
def _call(typingctx, code, place, count, team, what, x):
    """Call the code at an address; return its status."""

    def codegen(context, builder, sig, args):
        whole, number = ir.IntType(64), ir.DoubleType().as_pointer()
        kind = ir.FunctionType(whole, [*5 * [whole], number])
        array = context.make_array(sig.args[5])(context, builder, args[5])
        pointer = builder.inttoptr(args[0], kind.as_pointer())
        return builder.call(pointer, [*args[1:5], builder.extract_value(array.shape, 1), array.data])

    return types.int64(code, place, types.int64, types.int64, types.int64, x), codegen


@jit
def refresh(pairs, x, chunks):
    """Update the list for positions x (3, n), contiguous; return a status."""
    return _call(pairs.code, address(pairs), chunks.number, chunks.team, REFRESH, x)


@jit
def prune(pairs, chunks):
    """Prune the outer list to make the inner list."""
    _call(pairs.code, address(pairs), chunks.number, chunks.team, PRUNE, pairs.built_at)


@jit
def outlasts(pairs, chunks):
    """Prune the outer list if the noted moves need it; return OK, or another status if the list must be made anew."""
    return _call(pairs.code, address(pairs), chunks.number, chunks.team, OUTLAST, pairs.built_at)


@jit
def adopt(pairs, chunks):
    """Bring the box of the list to the edge lengths of now; see `load.adopt`."""
    _call(pairs.code, address(pairs), chunks.number, chunks.team, ADOPT, pairs.built_at)

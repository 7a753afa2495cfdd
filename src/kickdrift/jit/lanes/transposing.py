"""Transposition of eight by eight numbers in registers."""

from __future__ import annotations

from functools import partial
from typing import Any

from llvmlite import ir
from numba import types
from numba.extending import intrinsic

from kickdrift.jit.lanes.vectors import F64X8, I32, WIDTH, lanes_type
from kickdrift.jit.numba_private import cgutils

EIGHT = types.UniTuple(lanes_type, WIDTH)
LOW, HIGH = [0, 8, 2, 10, 4, 12, 6, 14], [1, 9, 3, 11, 5, 13, 7, 15]  # of each two rows
FIRST, LAST = [0, 1, 8, 9, 4, 5, 12, 13], [2, 3, 10, 11, 6, 7, 14, 15]  # of each two pairs of rows
_FRONT, _BACK = [0, 1, 2, 3, 8, 9, 10, 11], [4, 5, 6, 7, 12, 13, 14, 15]  # of both halves


def shuffle(builder: ir.IRBuilder, a: ir.Value, b: ir.Value, order: list[int]) -> ir.Value:
    """Emit eight of the numbers of a, counted from 0, and of b, counted on."""
    return builder.shuffle_vector(a, b, ir.Constant(ir.VectorType(I32, WIDTH), order))


def _transposed(builder: ir.IRBuilder, rows: list[Any]) -> list[Any]:
    shuffled = partial(shuffle, builder)
    pairs = [[shuffled(rows[k], rows[k + 1], order) for k in range(0, WIDTH, 2)] for order in (LOW, HIGH)]
    made: list[Any] = [None] * WIDTH
    for odd, pair in enumerate(pairs):
        for second, order in enumerate((FIRST, LAST)):
            halves = shuffled(pair[0], pair[1], order), shuffled(pair[2], pair[3], order)
            made[odd + 2 * second] = shuffled(*halves, _FRONT)
            made[odd + 2 * second + 4] = shuffled(*halves, _BACK)
    return made


@intrinsic
def transposed(typingctx, rows):
    """Eight lanes whose lane k has the numbers of row k, for a tuple of eight rows."""

    def codegen(context, builder, sig, args):
        return context.make_tuple(
            builder, sig.return_type, _transposed(builder, cgutils.unpack_tuple(builder, args[0]))
        )

    return (EIGHT(EIGHT), codegen) if rows == EIGHT else None


def _steps(builder: ir.IRBuilder, place: Any, stride: Any, count: Any) -> list[tuple[Any, Any]]:
    """For each lane: whether it is one of ``count``, and its index, the last one's for further lanes."""
    made = [(ir.Constant(ir.IntType(1), 1), place)]
    for lane in range(1, WIDTH):
        within = builder.icmp_signed("<", count.type(lane), count)
        made.append((within, builder.select(within, builder.add(made[-1][1], stride), made[-1][1])))
    return made


@intrinsic
def strided(typingctx, array, place, stride, count):
    """Lanes of the ``count`` numbers at ``place``, ``place + stride``, …; the last one fills further lanes."""

    def codegen(context, builder, sig, args):
        data = context.make_array(sig.args[0])(context, builder, args[0]).data
        made = ir.Constant(F64X8, ir.Undefined)
        for lane, (_, at) in enumerate(_steps(builder, *args[1:])):
            made = builder.insert_element(made, builder.load(builder.gep(data, [at])), I32(lane))
        return made

    return (lanes_type(array, *3 * (types.intp,)), codegen) if _plain(array) else None


@intrinsic
def add_strided(typingctx, array, place, stride, count, lanes):
    """Add the first lanes to the ``count`` numbers at ``place``, ``place + stride``, …"""

    def codegen(context, builder, sig, args):
        data = context.make_array(sig.args[0])(context, builder, args[0]).data
        steps = [(within, builder.gep(data, [at])) for within, at in _steps(builder, *args[1:4])]
        before, total = [builder.load(pointer) for _, pointer in steps], None
        for lane, (within, pointer) in enumerate(steps):  # further lanes store the last sum once more
            more = builder.fadd(before[lane], builder.extract_element(args[4], I32(lane)))
            total = more if total is None else builder.select(within, more, total)
            builder.store(total, pointer)
        return context.get_dummy_value()

    known = _plain(array) and lanes == lanes_type
    return (types.void(array, *3 * (types.intp,), lanes), codegen) if known else None


def _plain(array: types.Type) -> bool:
    return isinstance(array, types.Array) and array.layout == "C" and array.dtype == types.float64

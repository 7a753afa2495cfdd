"""Mixed precision beside the arithmetic of `lanes`: 16 lanes of float32 from eight float64, and back."""

from __future__ import annotations

from llvmlite import ir
from numba import types
from numba.extending import intrinsic

from kickdrift.jit.memory import loading
from kickdrift.jit.numba_private import cgutils
from kickdrift.jit.vectors import F32X8, F32X16, F64X8, I32, WIDTH, Lanes, as_lanes, lanes_type, pointer_to, single_type


def _joined(builder: ir.IRBuilder, low: ir.Value, high: ir.Value) -> ir.Value:
    order = ir.Constant(ir.VectorType(I32, 2 * WIDTH), list(range(2 * WIDTH)))
    return builder.shuffle_vector(low, high, order)


def _half(builder: ir.IRBuilder, value: ir.Value, which: int) -> ir.Value:
    order = ir.Constant(ir.VectorType(I32, WIDTH), list(range(which * WIDTH, (which + 1) * WIDTH)))
    return builder.fpext(builder.shuffle_vector(value, value, order), F64X8)


@intrinsic
def joined(typingctx, low, high):
    """Join two halves to 16 lanes of float32. Each half is eight float64, or one number for all eight; ``low`` comes
    first."""

    def codegen(context, builder, sig, args):
        halves = [
            builder.fptrunc(as_lanes(builder, value, kind, F64X8), F32X8)
            for value, kind in zip(args, sig.args, strict=True)
        ]
        return _joined(builder, *halves)

    return single_type(*(kind if isinstance(kind, Lanes) else types.float64 for kind in (low, high))), codegen


@intrinsic(prefer_literal=True)
def two_of(typingctx, value, pair):
    """Lanes 2 ``pair`` and 2 ``pair`` + 1 of eight float64, eight times each, as float32. ``pair`` is a literal."""
    first = 2 * pair.literal_value

    def codegen(context, builder, sig, args):
        narrow = builder.fptrunc(args[0], F32X8)
        order = ir.Constant(ir.VectorType(I32, 2 * WIDTH), [first] * WIDTH + [first + 1] * WIDTH)
        return builder.shuffle_vector(narrow, narrow, order)

    return single_type(lanes_type, pair), codegen


@intrinsic
def halves(typingctx, value):
    """Lower and upper eight of 16 lanes, as float64."""

    def codegen(context, builder, sig, args):
        parts = [_half(builder, args[0], which) for which in range(2)]
        return context.make_tuple(builder, sig.return_type, parts)

    return types.UniTuple(lanes_type, 2)(single_type), codegen


@intrinsic
def load_twice(typingctx, array, index):
    """Load eight adjacent numbers of a contiguous float32 array into both halves."""

    def codegen(context, builder, sig, args):
        value = builder.load(pointer_to(context, builder, sig, args, F32X8))
        value.align = 4
        order = ir.Constant(ir.VectorType(I32, 2 * WIDTH), 2 * list(range(WIDTH)))
        return builder.shuffle_vector(value, value, order)

    return single_type(array, types.intp), codegen


@intrinsic
def load_single(typingctx, array, index):
    """Load 16 adjacent numbers of a contiguous float32 array."""
    return single_type(array, types.intp), loading(F32X16)


@intrinsic
def store_narrow(typingctx, array, index, value):
    """Store eight float64 as float32."""

    def codegen(context, builder, sig, args):
        narrow = builder.fptrunc(args[2], F32X8)
        written = builder.store(narrow, pointer_to(context, builder, sig, args, F32X8))
        written.align = 4
        return context.get_dummy_value()

    return types.void(array, types.intp, lanes_type), codegen


@intrinsic
def named_lanes_single(typingctx, like, table, row, next_row, index):
    """Like `memory.named_lanes`, with ``row`` in the lower eight lanes and ``next_row`` in the upper eight."""
    result = types.NamedTuple([single_type] * len(like), like.instance_class)

    def codegen(context, builder, sig, args):
        array = context.make_array(sig.args[1])(context, builder, args[1])
        shape = cgutils.unpack_tuple(builder, array.shape)
        fields = []
        for k in range(len(sig.args[0])):
            parts = []
            for number in args[2:4]:
                offset = builder.add(builder.mul(context.get_constant(types.intp, k), shape[1]), number)
                offset = builder.add(builder.mul(offset, shape[2]), args[4])
                eight = builder.load(builder.bitcast(builder.gep(array.data, [offset]), F64X8.as_pointer()))
                eight.align = 8
                parts.append(builder.fptrunc(eight, F32X8))
            fields.append(_joined(builder, *parts))
        return context.make_tuple(builder, sig.return_type, fields)

    return result(like, table, types.intp, types.intp, types.intp), codegen

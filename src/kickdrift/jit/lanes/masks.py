"""Masks of lanes: and, or, not, selection, and bits as a whole number."""

import operator

from llvmlite import ir
from numba import types
from numba.extending import intrinsic, lower_builtin

from kickdrift.jit.lanes.vectors import MASKS, Lanes, Mask, as_lanes, mask_type, register
from kickdrift.jit.numba_private import signature

register(operator.and_, [signature(mask, mask, mask) for mask in MASKS])
register(operator.or_, [signature(mask, mask, mask) for mask in MASKS])
register(operator.invert, [signature(mask, mask) for mask in MASKS])


@lower_builtin(operator.and_, Mask, Mask)
def _and(context, builder, sig, args):
    return builder.and_(*args)


@lower_builtin(operator.or_, Mask, Mask)
def _or(context, builder, sig, args):
    return builder.or_(*args)


@lower_builtin(operator.invert, Mask)
def _invert(context, builder, sig, args):
    return builder.not_(args[0])


@intrinsic
def select(typingctx, mask, yes, no):
    """Select ``yes`` for set lanes of the mask, else ``no`` (lanes or a number). The unselected value has no effect,
    even if NaN."""

    def codegen(context, builder, sig, args):
        return builder.select(args[0], args[1], as_lanes(builder, args[2], sig.args[2], sig.args[1].vector))

    return yes(yes.mask, yes, no if isinstance(no, Lanes) else types.float64), codegen


@intrinsic
def mask_bits(typingctx, mask):
    """The mask as a whole number: lane k is bit k."""

    def codegen(context, builder, sig, args):
        return builder.zext(builder.bitcast(args[0], ir.IntType(sig.args[0].count)), ir.IntType(64))

    return types.int64(mask), codegen


@intrinsic
def less_than_next(typingctx, array, index):
    """Tell of eight adjacent whole numbers of 64 bits, from ``index`` on, which are less than the number after them."""
    eight = ir.VectorType(ir.IntType(64), mask_type.count)

    def codegen(context, builder, sig, args):
        data = context.make_array(sig.args[0])(context, builder, args[0]).data
        pair = []
        for next_one in range(2):
            pointer = builder.gep(data, [builder.add(args[1], context.get_constant(types.intp, next_one))])
            pair.append(builder.load(builder.bitcast(pointer, eight.as_pointer())))
            pair[-1].align = 8
        return builder.icmp_signed("<", *pair)

    return mask_type(array, types.intp), codegen


@intrinsic
def any_lane(typingctx, mask):
    """Tell whether any lane of the mask is set."""

    def codegen(context, builder, sig, args):
        return builder.icmp_unsigned("!=", builder.bitcast(args[0], ir.IntType(8)), ir.IntType(8)(0))

    return types.boolean(mask_type), codegen


@intrinsic
def all_lanes(typingctx, mask):
    """Tell whether all lanes of the mask are set."""

    def codegen(context, builder, sig, args):
        return builder.icmp_unsigned("==", builder.bitcast(args[0], ir.IntType(8)), ir.IntType(8)(255))

    return types.boolean(mask_type), codegen


@intrinsic
def lowest_bit(typingctx, bits):
    """Index of the lowest set bit. At least one bit must be set."""

    def codegen(context, builder, sig, args):
        return builder.cttz(args[0], ir.IntType(1)(1))

    return types.int64(types.int64), codegen


@intrinsic
def count_ones(typingctx, bits):
    """Number of set bits."""

    def codegen(context, builder, sig, args):
        return builder.ctpop(args[0])

    return types.int64(types.int64), codegen


@intrinsic
def bytes_with_bits(typingctx, bits):
    """The bytes of a whole number that are not zero, as bits: byte k is bit k."""

    def codegen(context, builder, sig, args):
        several = builder.bitcast(args[0], ir.VectorType(ir.IntType(8), 8))
        some = builder.icmp_unsigned("!=", several, ir.Constant(several.type, [0] * 8))
        return builder.zext(builder.bitcast(some, ir.IntType(8)), ir.IntType(64))

    return types.int64(types.int64), codegen

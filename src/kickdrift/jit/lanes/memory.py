"""Memory of arrays and lanes: loads, stores and layout."""

from collections.abc import Callable
from typing import Any

import numpy as np
from llvmlite import ir
from numba import types
from numba.extending import intrinsic

from kickdrift.jit.compile import as_written, inlined
from kickdrift.jit.lanes.functions import splat
from kickdrift.jit.lanes.vectors import (
    F64,
    F64X8,
    I1X8,
    I32,
    WIDTH,
    bytes_of,
    constant,
    copied,
    first_lanes,
    lanes_type,
    pointer_to,
)
from kickdrift.jit.numba_private import cgutils

LINE = 64  # bytes of a cache line


def aligned(shape: tuple[int, ...], fill: float | None = 0.0, dtype: Any = np.float64) -> np.ndarray:
    """Array that begins on a 64-byte boundary, so that eight lanes never straddle two cache lines.

    Without ``fill`` its memory is not touched, so the system does not allocate it before its first use.
    """
    count, line = int(np.prod(shape)), 64 // np.dtype(dtype).itemsize
    raw = (np.empty if fill is None else np.zeros)(count + line, dtype)
    skip = (-raw.ctypes.data % 64) // raw.itemsize
    array = raw[skip : skip + count].reshape(shape)
    if fill:
        array[...] = fill
    return array


def loading(vector: ir.VectorType) -> Callable[..., ir.Value]:
    """Emitter of a load of adjacent numbers. The first two arguments are an array and an index."""

    def codegen(context: Any, builder: Any, sig: Any, args: Any) -> ir.Value:
        value = builder.load(pointer_to(context, builder, sig, args, vector))
        value.align = bytes_of(vector.element)
        return value

    return codegen


@intrinsic
def _address(typingctx, array):
    """Address of an array's first number."""

    def codegen(context, builder, sig, args):
        return builder.ptrtoint(context.make_array(sig.args[0])(context, builder, args[0]).data, ir.IntType(64))

    return types.int64(array), codegen


@as_written
def line_aligned(array):
    """Return the part of a row of numbers, less than a cache line shorter, that begins on a 64-byte boundary."""
    return array[(-_address(array) & (LINE - 1)) // array.itemsize :]


def _fetching(write: int, size: Any) -> Callable[..., Any] | None:
    """Emitter of prefetches, if ``size`` is a literal. Nothing is loaded, so the numbers may lie outside the array."""
    if not isinstance(size, types.IntegerLiteral):
        return None

    def codegen(context: Any, builder: Any, sig: Any, args: Any) -> ir.Value:
        array = context.make_array(sig.args[0])(context, builder, args[0])
        byte = ir.IntType(8).as_pointer()
        begin = builder.bitcast(builder.gep(array.data, [args[1]]), byte)
        kind = ir.FunctionType(ir.VoidType(), [byte, I32, I32, I32])
        ask = cgutils.get_or_insert_function(builder.module, kind, "llvm.prefetch.p0")
        for at in range(0, size.literal_value * sig.args[0].dtype.bitwidth // 8, LINE):
            builder.call(ask, [builder.gep(begin, [I32(at)]), I32(write), I32(3), I32(1)])  # to the first cache
        return context.get_dummy_value()

    return codegen


@intrinsic(prefer_literal=True)
def fetch_to_read(typingctx, array, index, size):
    """Ask for the cache lines of ``size`` adjacent numbers, from ``index`` on, to load them soon. ``size`` is a
    literal."""
    return types.void(array, types.intp, size), _fetching(0, size)


@intrinsic(prefer_literal=True)
def fetch_to_write(typingctx, array, index, size):
    """Ask for the cache lines of ``size`` adjacent numbers, from ``index`` on, to change them soon. ``size`` is a
    literal."""
    return types.void(array, types.intp, size), _fetching(1, size)


@intrinsic
def load(typingctx, array, index):
    """Load eight adjacent numbers of a contiguous float64 array, from ``index`` on."""
    return lanes_type(array, types.intp), loading(F64X8)


@intrinsic
def load_like(typingctx, array, index, like):
    """Load adjacent numbers of a contiguous array, as many as ``like`` has lanes. ``like`` and the array must have the
    same precision."""
    return like(array, types.intp, like), loading(like.vector)


@intrinsic
def store(typingctx, array, index, value):
    """Store all lanes of the value to adjacent numbers. The value must have the array's precision."""

    def codegen(context, builder, sig, args):
        written = builder.store(args[2], pointer_to(context, builder, sig, args, value.vector))
        written.align = bytes_of(value.vector.element)
        return context.get_dummy_value()

    return types.void(array, types.intp, value), codegen


@intrinsic
def masked_load(typingctx, array, index, count):
    """Load the first ``count`` of eight adjacent numbers. The other lanes are zero, and their memory is not touched."""

    def codegen(context, builder, sig, args):
        pointer = pointer_to(context, builder, sig, args)
        kind = ir.FunctionType(F64X8, [pointer.type, I32, I1X8, F64X8])
        masked = cgutils.get_or_insert_function(builder.module, kind, "llvm.masked.load.v8f64.p0")
        return builder.call(masked, [pointer, I32(8), first_lanes(builder, args[2]), constant(0.0)])

    return lanes_type(array, types.intp, types.intp), codegen


@intrinsic
def masked_store(typingctx, array, index, value, count):
    """Store the first ``count`` of eight lanes to adjacent numbers."""

    def codegen(context, builder, sig, args):
        pointer = pointer_to(context, builder, sig, args)
        kind = ir.FunctionType(ir.VoidType(), [F64X8, pointer.type, I32, I1X8])
        masked = cgutils.get_or_insert_function(builder.module, kind, "llvm.masked.store.v8f64.p0")
        builder.call(masked, [args[2], pointer, I32(8), first_lanes(builder, args[3])])
        return context.get_dummy_value()

    return types.void(array, types.intp, lanes_type, types.intp), codegen


@intrinsic
def flat(typingctx, array):
    """All numbers of a contiguous float64 array in one row. The result shares the memory and keeps nothing alive."""
    row = types.Array(types.float64, 1, "C")

    def codegen(context, builder, sig, args):
        whole = context.make_array(sig.args[0])(context, builder, args[0])
        view = context.make_array(row)(context, builder)
        size = [whole.nitems]
        context.populate_array(
            view, data=whole.data, shape=size, strides=[whole.itemsize], itemsize=whole.itemsize, meminfo=None
        )
        return view._getvalue()

    return row(array) if array.layout == "C" else None, codegen


@intrinsic
def broadcast(typingctx, array, index, like):
    """Broadcast the number at ``index`` of a contiguous array to as many lanes as ``like`` has. ``index`` must not be
    negative."""

    def codegen(context, builder, sig, args):
        array = context.make_array(sig.args[0])(context, builder, args[0])
        return copied(builder, builder.load(builder.gep(array.data, [args[1]])), like.vector)

    return like(array, types.intp, like), codegen


@intrinsic
def zero_unless_same(typingctx, value, change):
    """Return the lanes if ``change`` is 0, and zeros if it is 1 to 7. A mask from a table is quicker than a branch."""
    whole = ir.IntType(64)

    def codegen(context, builder, sig, args):
        masks = ir.Constant(ir.ArrayType(whole, WIDTH), [-1] + (WIDTH - 1) * [0])
        table = cgutils.global_constant(builder, "kept_or_zero", masks)
        mask = builder.load(builder.gep(table, [whole(0), args[1]]))
        bits = ir.VectorType(whole, args[0].type.count * bytes_of(value.vector.element) // 8)
        one = builder.insert_element(ir.Constant(bits, ir.Undefined), mask, I32(0))
        zeros = ir.Constant(ir.VectorType(I32, bits.count), [0] * bits.count)
        every = builder.shuffle_vector(one, ir.Constant(bits, ir.Undefined), zeros)
        return builder.bitcast(builder.and_(builder.bitcast(args[0], bits), every), args[0].type)

    return value(value, types.int64), codegen


@intrinsic
def entry(typingctx, array, row, column):
    """Return ``array[row, column]`` of a contiguous matrix of int32. Neither index may be negative."""

    def codegen(context, builder, sig, args):
        array = context.make_array(sig.args[0])(context, builder, args[0])
        width = cgutils.unpack_tuple(builder, array.shape)[1]
        number = builder.load(builder.gep(array.data, [builder.add(builder.mul(args[1], width), args[2])]))
        return builder.sext(number, ir.IntType(64))

    return types.int64(array, types.intp, types.intp), codegen


@intrinsic
def sums_of_rows(typingctx, array, index, stride):
    """Sum eight rows of eight float64 numbers, from ``index`` on and ``stride`` apart: lane k is the sum of row k."""

    def codegen(context, builder, sig, args):
        data = context.make_array(sig.args[0])(context, builder, args[0]).data
        rows = []
        for k in range(WIDTH):
            offset = builder.add(args[1], builder.mul(args[2], context.get_constant(types.intp, k)))
            rows.append(builder.load(builder.bitcast(builder.gep(data, [offset]), F64X8.as_pointer())))
            rows[-1].align = 8

        def added(a, b, low, high):
            chosen = (ir.Constant(ir.VectorType(I32, WIDTH), order) for order in (low, high))
            first, second = (builder.shuffle_vector(a, b, order) for order in chosen)
            return builder.fadd(first, second)

        by_one = ([0, 8, 2, 10, 4, 12, 6, 14], [1, 9, 3, 11, 5, 13, 7, 15])
        by_two = ([0, 1, 4, 5, 8, 9, 12, 13], [2, 3, 6, 7, 10, 11, 14, 15])
        twos = [added(rows[k], rows[k + 1], *by_one) for k in (0, 2, 4, 6)]
        fours = [added(twos[k], twos[k + 1], *by_two) for k in (0, 2)]
        return added(fours[0], fours[1], *by_two)

    return lanes_type(array, types.intp, types.intp), codegen


@intrinsic
def named_lanes(typingctx, like, table, row, index, lanes):
    """NamedTuple of the class of ``like``, with lanes as fields. Field k holds the numbers ``table[k, row, index:]``,
    with the number and precision of ``lanes``."""
    result = types.NamedTuple([lanes] * len(like), like.instance_class)
    wide = ir.VectorType(F64, lanes.vector.count)

    def codegen(context, builder, sig, args):
        array = context.make_array(sig.args[1])(context, builder, args[1])
        shape = cgutils.unpack_tuple(builder, array.shape)
        fields = []
        for k in range(len(sig.args[0])):
            offset = builder.add(builder.mul(context.get_constant(types.intp, k), shape[1]), args[2])
            offset = builder.add(builder.mul(offset, shape[2]), args[3])
            value = builder.load(builder.bitcast(builder.gep(array.data, [offset]), wide.as_pointer()))
            value.align = 8
            fields.append(value if wide == lanes.vector else builder.fptrunc(value, lanes.vector))
        return context.make_tuple(builder, sig.return_type, fields)

    return result(like, table, types.intp, types.intp, lanes), codegen


@intrinsic
def named_numbers(typingctx, like, table, row):
    """NamedTuple of the class of ``like`` with the numbers of a row of a contiguous table as fields."""
    result = types.NamedTuple([types.float64] * len(like), like.instance_class)

    def codegen(context, builder, sig, args):
        array = context.make_array(sig.args[1])(context, builder, args[1])
        width = cgutils.unpack_tuple(builder, array.shape)[1]
        begin = builder.gep(array.data, [builder.mul(args[2], width)])
        fields = [
            builder.load(builder.gep(begin, [context.get_constant(types.intp, k)])) for k in range(len(sig.args[0]))
        ]
        return context.make_tuple(builder, sig.return_type, fields)

    return result(like, table, types.intp), codegen


@inlined
def set_zero(a: Any) -> None:
    """a <- 0, all numbers of a contiguous array."""
    row, zero = flat(a), splat(0.0)
    whole = row.size - row.size % WIDTH
    for i in range(0, whole, WIDTH):
        store(row, i, zero)
    masked_store(row, whole, zero, row.size - whole)

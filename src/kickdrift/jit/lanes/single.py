"""Mixed precision beside the arithmetic of `lanes`: 16 or eight lanes of float32 from eight float64, and back; and the
functions of eight lanes of float32, within 3 units in the last place (the cosine: of the number one)."""

import math

from llvmlite import ir
from numba import types
from numba.extending import intrinsic

from kickdrift.jit.compile import as_written
from kickdrift.jit.lanes.functions import LOG2_E, ROOT_HALF, exponent_of, lanes_like, polynomial_of, power_of_two
from kickdrift.jit.lanes.gathering import lane_round, lanes_in
from kickdrift.jit.lanes.masks import select
from kickdrift.jit.lanes.memory import loading
from kickdrift.jit.lanes.vectors import (
    F32,
    F32X8,
    F32X16,
    F64,
    F64X8,
    I32,
    WIDTH,
    Lanes,
    as_lanes,
    constant,
    half_single_type,
    lanes_type,
    pointer_to,
    single_type,
)
from kickdrift.jit.numba_private import cgutils

QUARTER = 4  # lanes in a quarter of 16


def _joined(builder: ir.IRBuilder, low: ir.Value, high: ir.Value) -> ir.Value:
    order = ir.Constant(ir.VectorType(I32, 2 * WIDTH), list(range(2 * WIDTH)))
    return builder.shuffle_vector(low, high, order)


def _chosen(builder: ir.IRBuilder, a: ir.Value, b: ir.Value, order: list[int]) -> ir.Value:
    """Eight lanes of two times eight."""
    return builder.shuffle_vector(a, b, ir.Constant(ir.VectorType(I32, WIDTH), order))


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
def four_of(typingctx, value, half):
    """Lanes 4 ``half`` to 4 ``half`` + 3 of eight float64, four times each, as float32. ``half`` is a literal."""
    first = QUARTER * half.literal_value

    def codegen(context, builder, sig, args):
        narrow = builder.fptrunc(args[0], F32X8)
        order = [first + lane // QUARTER for lane in range(2 * WIDTH)]
        return builder.shuffle_vector(narrow, narrow, ir.Constant(ir.VectorType(I32, 2 * WIDTH), order))

    return single_type(lanes_type, half), codegen


@intrinsic
def halves(typingctx, value):
    """Lower and upper eight of 16 lanes, as float64."""

    def codegen(context, builder, sig, args):
        parts = [_half(builder, args[0], which) for which in range(2)]
        return context.make_tuple(builder, sig.return_type, parts)

    return types.UniTuple(lanes_type, 2)(single_type), codegen


@intrinsic
def load_four_times(typingctx, array, index):
    """Load four adjacent numbers of a contiguous float32 array into all quarters of 16 lanes."""
    four = ir.VectorType(F32, QUARTER)

    def codegen(context, builder, sig, args):
        value = builder.load(pointer_to(context, builder, sig, args, four))
        value.align = 4
        order = ir.Constant(ir.VectorType(I32, 2 * WIDTH), QUARTER * list(range(QUARTER)))
        return builder.shuffle_vector(value, value, order)

    return single_type(array, types.intp), codegen


@intrinsic
def sums_of_quarters(typingctx, low, high):
    """Sum the quarters of 16 lanes as float64: four sums from ``low``, then four from ``high``."""

    def codegen(context, builder, sig, args):
        two = [builder.fadd(_half(builder, value, 0), _half(builder, value, 1)) for value in args]
        parts = [
            _chosen(builder, two[0], two[1], order)
            for order in ([0, 1, 2, 3, 8, 9, 10, 11], [4, 5, 6, 7, 12, 13, 14, 15])
        ]
        return builder.fadd(*parts)

    return lanes_type(single_type, single_type), codegen


@intrinsic
def sums_in_quarters(typingctx, low, high):
    """Sum the four lanes of each quarter of 16 lanes as float64: four sums from ``low``, then four from ``high``."""
    by_one = ([0, 8, 2, 10, 4, 12, 6, 14], [1, 9, 3, 11, 5, 13, 7, 15])
    by_two = ([0, 1, 8, 9, 4, 5, 12, 13], [2, 3, 10, 11, 6, 7, 14, 15])
    in_order = [0, 4, 1, 5, 2, 6, 3, 7]

    def codegen(context, builder, sig, args):
        def added(a, b, orders):
            return builder.fadd(*(_chosen(builder, a, b, order) for order in orders))

        twos = [added(_half(builder, value, 0), _half(builder, value, 1), by_one) for value in args]
        fours = added(twos[0], twos[1], by_two)
        return _chosen(builder, fours, fours, in_order)

    return lanes_type(single_type, single_type), codegen


@intrinsic
def off_diagonal(typingctx, value, instead):
    """16 lanes as a matrix of four rows, with a number ``instead`` of the lanes of its diagonal."""
    mask = [lane // QUARTER == lane % QUARTER for lane in range(2 * WIDTH)]

    def codegen(context, builder, sig, args):
        chosen = ir.Constant(ir.VectorType(ir.IntType(1), 2 * WIDTH), mask)
        return builder.select(chosen, as_lanes(builder, args[1], types.float64, F32X16), args[0])

    return single_type(single_type, types.float64), codegen


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
def named_lanes_single(typingctx, like, table, rows, index):
    """Like `memory.named_lanes`, with four adjacent numbers from each of four ``rows``."""
    result = types.NamedTuple([single_type] * len(like), like.instance_class)
    four = ir.VectorType(F64, QUARTER)

    def codegen(context, builder, sig, args):
        array = context.make_array(sig.args[1])(context, builder, args[1])
        shape, own = cgutils.unpack_tuple(builder, array.shape), cgutils.unpack_tuple(builder, args[2])
        fields = []
        for k in range(len(sig.args[0])):
            parts = []
            for number in own:
                offset = builder.add(builder.mul(context.get_constant(types.intp, k), shape[1]), number)
                offset = builder.add(builder.mul(offset, shape[2]), args[3])
                value = builder.load(builder.bitcast(builder.gep(array.data, [offset]), four.as_pointer()))
                value.align = 8
                parts.append(builder.fptrunc(value, ir.VectorType(F32, QUARTER)))
            order = ir.Constant(ir.VectorType(I32, WIDTH), list(range(WIDTH)))
            both = [builder.shuffle_vector(a, b, order) for a, b in (parts[:2], parts[2:])]
            fields.append(_joined(builder, *both))
        return context.make_tuple(builder, sig.return_type, fields)

    return result(like, table, types.UniTuple(types.int64, 4), types.intp), codegen


@intrinsic
def zeros_in(typingctx, array):
    """Zero in eight lanes of an array's precision."""

    def codegen(context, builder, sig, args):
        return constant(0.0, sig.return_type.vector)

    return lanes_in(array)(array), codegen


@intrinsic
def narrowed(typingctx, value):
    """Eight lanes of float64 as float32."""

    def codegen(context, builder, sig, args):
        return builder.fptrunc(args[0], F32X8)

    return half_single_type(lanes_type), codegen


LN2_HIGH, LN2_LOW = 0.693359375, -2.12194440054690583e-4  # the first has nine bits, so that whole multiples are exact
_exp_series = polynomial_of(tuple(1.0 / math.factorial(k) for k in range(8)))
_log_series = polynomial_of(tuple(2.0 / (2 * k + 1) for k in range(6)))
_sine_series = polynomial_of(tuple((-1.0) ** k / math.factorial(2 * k + 1) for k in range(7)))
_cosine_series = polynomial_of(tuple((-1.0) ** k / math.factorial(2 * k) for k in range(8)))


@as_written
def single_exp(x):
    """Return exp(x) of lanes, 0 below -87 and exp(87) above 87; nan stays nan."""
    low = x < -87.0
    x = select(low, lanes_like(-87.0, x), x)
    x = select(x > 87.0, lanes_like(87.0, x), x)
    k = lane_round(x * LOG2_E)
    r = (x - k * LN2_HIGH) - k * LN2_LOW
    return select(low, lanes_like(0.0, x), _exp_series(r) * power_of_two(k))


@as_written
def single_log(x):
    """Return log(x) of lanes that are positive and normal."""
    k = exponent_of(x)
    m = x * power_of_two(0.0 - k)
    high = m > 2.0 * ROOT_HALF
    m, k = select(high, 0.5 * m, m), select(high, k + 1.0, k)
    s = (m - 1.0) / (m + 1.0)
    return k * LN2_HIGH + (s * _log_series(s * s) + k * LN2_LOW)


@as_written
def single_sine_cosine(x):
    """Return sin(x) and cos(x) of lanes from -pi/2 to pi/2."""
    square = x * x
    return x * _sine_series(square), _cosine_series(square)

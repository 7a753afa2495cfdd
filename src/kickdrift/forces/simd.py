"""SIMD as a type: 8 lanes of float64, or 16 of float32, that compiled kernels use like a number.

numba learns the types ``Lanes`` (LLVM's ``<8 x double>`` and ``<16 x float>``) and ``Mask``, with the arithmetic
operators, the comparisons and a few functions lowered on them; LLVM then emits AVX-512, AVX2, SSE2 or NEON as the
machine has it. Lanes mix with scalars, which are copied to all lanes. They have the fast-math flags of the function
that they stand in, as scalars do. In a function without such flags a product inside a sum is fused with it, always in
the same way. Division is a 14-bit estimate refined by a series where numba compiles for AVX-512 (its divide would take
over half of a pair kernel's time), within 2 ulp, and so is ``inverse_sqrt``; r = 0, infinity and NaN give a result that
is not finite, and so stay visible. `simd_single` has what float32 alone needs.
"""

from __future__ import annotations

import math
import operator
from collections.abc import Callable
from typing import Any

import numpy as np
from llvmlite import ir
from numba import types
from numba.core import cgutils
from numba.core.typing.templates import AbstractTemplate, ConcreteTemplate, infer_global, signature
from numba.extending import intrinsic, lower_builtin, models, register_model

from kickdrift.forces.compiling import features

WIDTH = 8
F64 = ir.DoubleType()
F32 = ir.FloatType()
F64X8 = ir.VectorType(F64, WIDTH)
F32X16 = ir.VectorType(F32, 2 * WIDTH)
I1X8 = ir.VectorType(ir.IntType(1), WIDTH)
I32 = ir.IntType(32)


class Mask(types.Type):
    """Yes-or-no side by side."""

    def __init__(self, count: int) -> None:
        self.count = count
        super().__init__(name=f"Mask({count})")


class Lanes(types.Type):
    """Numbers side by side, with the LLVM type ``vector``; comparisons give a ``mask``."""

    def __init__(self, vector: ir.VectorType, mask: Mask) -> None:
        self.vector, self.mask = vector, mask
        super().__init__(name=f"Lanes({vector.count} x {vector.element})")


mask_type, single_mask_type = Mask(WIDTH), Mask(2 * WIDTH)
lanes_type, single_type = Lanes(F64X8, mask_type), Lanes(F32X16, single_mask_type)
KINDS = (lanes_type, single_type)


@register_model(Lanes)
class _LanesModel(models.PrimitiveModel):
    def __init__(self, dmm: Any, fe_type: Lanes) -> None:
        super().__init__(dmm, fe_type, fe_type.vector)


@register_model(Mask)
class _MaskModel(models.PrimitiveModel):
    def __init__(self, dmm: Any, fe_type: Mask) -> None:
        super().__init__(dmm, fe_type, ir.VectorType(ir.IntType(1), fe_type.count))


def aligned(shape: tuple[int, ...], fill: float | None = 0.0, dtype: Any = np.float64) -> np.ndarray:
    """An array that begins on a 64-byte boundary, so that eight lanes never straddle two cache lines.

    Without ``fill`` its memory is not touched, and so not taken from the system before it is used.
    """
    count, line = int(np.prod(shape)), 64 // np.dtype(dtype).itemsize
    raw = np.empty(count + line, dtype)
    skip = (-raw.ctypes.data % 64) // raw.itemsize
    array = raw[skip : skip + count].reshape(shape)
    if fill is not None:
        array[...] = fill
    return array


def _splat(builder: ir.IRBuilder, scalar: ir.Value, vector: ir.VectorType = F64X8) -> ir.Value:
    if scalar.type != vector.element:
        scalar = builder.fptrunc(scalar, vector.element)
    one = builder.insert_element(ir.Constant(vector, ir.Undefined), scalar, I32(0))
    zeros = ir.Constant(ir.VectorType(I32, vector.count), [0] * vector.count)
    return builder.shuffle_vector(one, ir.Constant(vector, ir.Undefined), zeros)


def _constant(value: float, vector: ir.VectorType = F64X8) -> ir.Constant:
    return ir.Constant(vector, [value] * vector.count)


def _as(builder: ir.IRBuilder, value: ir.Value, kind: types.Type, vector: ir.VectorType) -> ir.Value:
    """A value of that numba type, lanes or a number, as lanes."""
    return value if isinstance(kind, Lanes) else _splat(builder, value, vector)


def _estimate(builder: ir.IRBuilder, name: str, x: ir.Value) -> ir.Value:
    """AVX-512's estimate of 1 / x (rcp14) or 1 / sqrt(x) (rsqrt14), to 14 bits."""
    letter = "d" if x.type == F64X8 else "s"
    every = ir.Constant(ir.IntType(x.type.count), -1)
    kind = ir.FunctionType(x.type, [x.type, x.type, every.type])
    estimate = cgutils.get_or_insert_function(builder.module, kind, f"llvm.x86.avx512.{name}.p{letter}.512")
    return builder.call(estimate, [x, _constant(0.0, x.type), every])


def _suffix(vector: ir.VectorType) -> str:
    return f"v{vector.count}f{64 if vector.element == F64 else 32}"


def _fma(builder: ir.IRBuilder, a: ir.Value, b: ir.Value, c: ir.Value, name: str = "fmuladd") -> ir.Value:
    kind = ir.FunctionType(a.type, [a.type] * 3)
    function = cgutils.get_or_insert_function(builder.module, kind, f"llvm.{name}.{_suffix(a.type)}")
    return builder.call(function, [a, b, c])


def _flags(context: Any) -> tuple[str, ...]:
    """The fast-math flags of the function being compiled."""
    return tuple(sorted(context.fastmath.flags)) if context.fastmath else ()


def _divide(builder: ir.IRBuilder, a: ir.Value, b: ir.Value, flags: tuple[str, ...]) -> ir.Value:
    """a / b; with an estimate y, e = 1 - b y < 2^-13: 1 / b = y (1 + e) (1 + e^2) to 2^-52, y (1 + e) to 2^-26."""
    if "avx512f" not in features():
        return builder.fdiv(a, b, flags=flags)
    y = _estimate(builder, "rcp14", b)
    e = _fma(builder, builder.fneg(b), y, _constant(1.0, b.type), "fma")
    y = _fma(builder, y, e, y, "fma")
    if b.type == F64X8:
        y = _fma(builder, y, builder.fmul(e, e), y, "fma")
    return builder.fmul(a, y, flags=flags)


def _is_product(value: ir.Value) -> bool:
    return isinstance(value, ir.Instruction) and value.opname == "fmul"


def _add(builder: ir.IRBuilder, a: ir.Value, b: ir.Value, flags: tuple[str, ...]) -> ir.Value:
    """a + b, fused where one is a product; LLVM sees to that itself where it may (by the flag "contract")."""
    if not flags and _is_product(b):
        return _fma(builder, b.operands[0], b.operands[1], a)
    if not flags and _is_product(a):
        return _fma(builder, a.operands[0], a.operands[1], b)
    return builder.fadd(a, b, flags=flags)


def _subtract(builder: ir.IRBuilder, a: ir.Value, b: ir.Value, flags: tuple[str, ...]) -> ir.Value:
    """a - b, likewise."""
    if not flags and _is_product(b):
        return _fma(builder, builder.fneg(b.operands[0]), b.operands[1], a)
    if not flags and _is_product(a):
        return _fma(builder, a.operands[0], a.operands[1], builder.fneg(b))
    return builder.fsub(a, b, flags=flags)


_ARITHMETIC: dict[Callable[..., Any], Callable[..., ir.Value]] = {
    operator.add: _add,
    operator.sub: _subtract,
    operator.mul: lambda builder, a, b, flags: builder.fmul(a, b, flags=flags),
    operator.truediv: _divide,
}
_COMPARISONS = {operator.lt: "<", operator.le: "<=", operator.gt: ">", operator.ge: ">=", operator.eq: "=="}
_FUNCTIONS: dict[Callable[..., Any], str] = {
    math.sqrt: "sqrt",
    math.exp: "exp",
    math.log: "log",
    abs: "fabs",
    math.fabs: "fabs",
}


def _register(function: Callable[..., Any], signatures: list[Any]) -> None:
    infer_global(function)(type("LanesTemplate", (ConcreteTemplate,), {"key": function, "cases": signatures}))


def _lower_binary(function: Callable[..., Any], emit: Callable[..., ir.Value], compares: bool) -> None:
    cases = [
        signature(kind.mask if compares else kind, *pair)
        for kind in KINDS
        for pair in ((kind, kind), (kind, types.float64), (types.float64, kind))
    ]
    _register(function, cases)
    for case in cases:

        def lowered(context, builder, sig, args):
            vector = next(kind.vector for kind in sig.args if isinstance(kind, Lanes))
            a, b = (_as(builder, value, kind, vector) for kind, value in zip(sig.args, args, strict=True))
            return emit(builder, a, b, _flags(context))

        lower_builtin(function, *case.args)(lowered)


def _lower_function(function: Callable[..., Any], name: str) -> None:
    _register(function, [signature(kind, kind) for kind in KINDS])
    for kind in KINDS:
        lower_builtin(function, kind)(_calling(name))


def _calling(name: str) -> Callable[..., ir.Value]:
    def lowered(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        vector = args[0].type
        kind = ir.FunctionType(vector, [vector])
        called = cgutils.get_or_insert_function(builder.module, kind, f"llvm.{name}.{_suffix(vector)}")
        return builder.call(called, args)

    return lowered


for _function, _emit in _ARITHMETIC.items():
    _lower_binary(_function, _emit, False)
for _function, _sign in _COMPARISONS.items():
    _lower_binary(_function, lambda builder, a, b, flags, sign=_sign: builder.fcmp_ordered(sign, a, b), True)
for _function, _name in _FUNCTIONS.items():
    _lower_function(_function, _name)

_register(operator.and_, [signature(mask, mask, mask) for mask in (mask_type, single_mask_type)])
_register(operator.or_, [signature(mask, mask, mask) for mask in (mask_type, single_mask_type)])
_register(operator.neg, [signature(kind, kind) for kind in KINDS])


@lower_builtin(operator.and_, Mask, Mask)
def _and(context, builder, sig, args):
    return builder.and_(*args)


@lower_builtin(operator.or_, Mask, Mask)
def _or(context, builder, sig, args):
    return builder.or_(*args)


@lower_builtin(operator.neg, Lanes)
def _negative(context, builder, sig, args):
    return builder.fneg(args[0], flags=_flags(context))


@infer_global(operator.pow)
class _WholePower(AbstractTemplate):
    """``x**k`` for a written-out whole k from 1 to 32; other exponents are not for SIMD lanes."""

    def generic(self, args: Any, kws: Any) -> Any:
        whole = len(args) == 2 and isinstance(args[0], Lanes) and isinstance(args[1], types.IntegerLiteral)
        return signature(args[0], *args) if whole and 1 <= args[1].literal_value <= 32 else None


@lower_builtin(operator.pow, Lanes, types.IntegerLiteral)
def _whole_power(context, builder, sig, args):
    exponent, square, result, flags = sig.args[1].literal_value, args[0], None, _flags(context)
    while exponent:
        if exponent & 1:
            result = square if result is None else builder.fmul(result, square, flags=flags)
        square = builder.fmul(square, square, flags=flags)
        exponent >>= 1
    return result


def _pointer(context: Any, builder: Any, sig: Any, args: Any, vector: ir.VectorType = F64X8) -> ir.Value:
    array, index = args[:2]
    data = context.make_array(sig.args[0])(context, builder, array).data
    return builder.bitcast(builder.gep(data, [index]), vector.as_pointer())


@intrinsic
def load(typingctx, array, index):
    """Eight neighbours of a contiguous float64 array, from ``index`` on."""

    def codegen(context, builder, sig, args):
        value = builder.load(_pointer(context, builder, sig, args))
        value.align = 8
        return value

    return lanes_type(array, types.intp), codegen


@intrinsic
def store(typingctx, array, index, value):
    """Write eight neighbours."""

    def codegen(context, builder, sig, args):
        written = builder.store(args[2], _pointer(context, builder, sig, args))
        written.align = 8
        return context.get_dummy_value()

    return types.void(array, types.intp, lanes_type), codegen


def _first(builder: ir.IRBuilder, count: ir.Value) -> ir.Value:
    """The mask of the first ``count`` lanes."""
    lanes, kind = ir.Constant(ir.VectorType(count.type, WIDTH), list(range(WIDTH))), ir.VectorType(I32, WIDTH)
    one = builder.insert_element(ir.Constant(lanes.type, ir.Undefined), count, I32(0))
    many = builder.shuffle_vector(one, ir.Constant(lanes.type, ir.Undefined), ir.Constant(kind, [0] * WIDTH))
    return builder.icmp_signed("<", lanes, many)


@intrinsic
def load_first(typingctx, array, index, count):
    """The first ``count`` of eight neighbours, zero in the other lanes, whose memory is not touched."""

    def codegen(context, builder, sig, args):
        pointer = _pointer(context, builder, sig, args)
        kind = ir.FunctionType(F64X8, [pointer.type, I32, I1X8, F64X8])
        masked = cgutils.get_or_insert_function(builder.module, kind, "llvm.masked.load.v8f64.p0")
        return builder.call(masked, [pointer, I32(8), _first(builder, args[2]), _constant(0.0)])

    return lanes_type(array, types.intp, types.intp), codegen


@intrinsic
def store_first(typingctx, array, index, value, count):
    """Write the first ``count`` of eight neighbours."""

    def codegen(context, builder, sig, args):
        pointer = _pointer(context, builder, sig, args)
        kind = ir.FunctionType(ir.VoidType(), [F64X8, pointer.type, I32, I1X8])
        masked = cgutils.get_or_insert_function(builder.module, kind, "llvm.masked.store.v8f64.p0")
        builder.call(masked, [args[2], pointer, I32(8), _first(builder, args[3])])
        return context.get_dummy_value()

    return types.void(array, types.intp, lanes_type, types.intp), codegen


@intrinsic
def flat(typingctx, array):
    """All numbers of a contiguous float64 array in one row; it shares the memory and keeps nothing alive."""
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
def splat(typingctx, scalar):
    """The same number in all lanes."""

    def codegen(context, builder, sig, args):
        return _splat(builder, args[0])

    return lanes_type(types.float64), codegen


@intrinsic
def lanes_like(typingctx, value, like):
    """Lanes as they are, a number in as many lanes as ``like`` has; for formulas that happen not to depend on the
    lanes."""

    def codegen(context, builder, sig, args):
        return _as(builder, args[0], sig.args[0], sig.args[1].vector)

    return like(value if isinstance(value, Lanes) else types.float64, like), codegen


@intrinsic
def multiply_add(typingctx, a, b, c):
    """a b + c, fused where the machine can; for where a product is used twice and LLVM would not fuse by itself."""

    def codegen(context, builder, sig, args):
        return _fma(builder, *args)

    return a(a, a, a), codegen


@intrinsic
def plus(typingctx, a, b):
    """a + b that nothing may reassociate: for compensated sums, in functions that are ``compiling.strict``."""

    def codegen(context, builder, sig, args):
        return builder.fadd(*args)

    return lanes_type(lanes_type, lanes_type), codegen


@intrinsic
def minus(typingctx, a, b):
    """a - b, likewise."""

    def codegen(context, builder, sig, args):
        return builder.fsub(*args)

    return lanes_type(lanes_type, lanes_type), codegen


@intrinsic
def inverse_sqrt(typingctx, value):
    """1 / sqrt(x), within 2 ulp; where x is zero, below it, infinite, subnormal or NaN, something that is not finite or
    the true value.

    With AVX-512 an estimate y of 14 bits is corrected by the series of (1 - e)^(-1/2), e = 1 - x y^2 < 2^-13, whose
    first term left out, 35/128 e^4, is below half a rounding unit: a third of the time of a square root and a divide.
    """

    def codegen(context, builder, sig, args):
        x = args[0]
        if "avx512f" not in features():
            kind = ir.FunctionType(F64X8, [F64X8])
            root = builder.call(cgutils.get_or_insert_function(builder.module, kind, "llvm.sqrt.v8f64"), [x])
            return builder.fdiv(_constant(1.0), root, flags=_flags(context))
        y = _estimate(builder, "rsqrt14", x)
        e = _fma(builder, builder.fneg(builder.fmul(x, y)), y, _constant(1.0), "fma")
        series = _fma(builder, _constant(5 / 16), e, _constant(3 / 8), "fma")
        series = _fma(builder, series, e, _constant(1 / 2), "fma")
        return _fma(builder, builder.fmul(y, e), series, y, "fma")

    return lanes_type(lanes_type), codegen


@intrinsic(prefer_literal=True)
def rotated(typingctx, value, places):
    """Lane k of the result is lane (k + places) mod 8; ``places`` is a written-out number."""
    order = [(k + places.literal_value) % WIDTH for k in range(WIDTH)]

    def codegen(context, builder, sig, args):
        return builder.shuffle_vector(args[0], args[0], ir.Constant(ir.VectorType(I32, WIDTH), order))

    return lanes_type(lanes_type, places), codegen


@intrinsic
def sums_before(typingctx, value):
    """In each lane the sum of the lanes before it, 0 in the first (Hillis & Steele 1986, doi:10.1145/7902.7903); one
    that is not finite makes all so."""

    def codegen(context, builder, sig, args):
        def shifted(vector, by, add):
            order = [(k - by) % WIDTH for k in range(WIDTH)]
            turned = builder.shuffle_vector(vector, vector, ir.Constant(ir.VectorType(I32, WIDTH), order))
            kept = ir.Constant(F64X8, [float(k >= by) for k in range(WIDTH)])  # a shift that brings zeros in is slower
            return _fma(builder, turned, kept, add)

        total = shifted(args[0], 1, _constant(0.0))
        for by in (1, 2, 4):
            total = shifted(total, by, total)
        return total

    return lanes_type(lanes_type), codegen


@intrinsic
def broadcast(typingctx, array, index):
    """The number at ``index``, which is not negative, of a contiguous array, in all lanes."""

    def codegen(context, builder, sig, args):
        array = context.make_array(sig.args[0])(context, builder, args[0])
        return _splat(builder, builder.load(builder.gep(array.data, [args[1]])))

    return lanes_type(array, types.intp), codegen


@intrinsic
def entry(typingctx, array, row, column):
    """``array[row, column]`` of a contiguous matrix of int32; neither may be negative."""

    def codegen(context, builder, sig, args):
        array = context.make_array(sig.args[0])(context, builder, args[0])
        width = cgutils.unpack_tuple(builder, array.shape)[1]
        number = builder.load(builder.gep(array.data, [builder.add(builder.mul(args[1], width), args[2])]))
        return builder.sext(number, ir.IntType(64))

    return types.int64(array, types.intp, types.intp), codegen


@intrinsic
def lowest_bit(typingctx, bits):
    """The number of the lowest bit that is set, of one at least."""

    def codegen(context, builder, sig, args):
        return builder.cttz(args[0], ir.IntType(1)(1))

    return types.int64(types.int64), codegen


@intrinsic
def append_members(typingctx, rows, at, listed, members, start, count, bit, plus):
    """Write those of the eight whole numbers ``listed[start:start + 8]``, ``count`` at most, whose ``members`` has that
    bit set, each with ``plus`` added, to the matrix ``rows`` of two int32 from row ``at`` on; how many they are."""
    whole = ir.IntType(64)
    eight = ir.VectorType(whole, WIDTH)

    def codegen(context, builder, sig, args):
        target, source, chosen = (context.make_array(sig.args[k])(context, builder, args[k]).data for k in (0, 2, 3))

        def spread(value):
            one = builder.insert_element(ir.Constant(eight, ir.Undefined), value, I32(0))
            zeros = ir.Constant(ir.VectorType(I32, WIDTH), [0] * WIDTH)
            return builder.shuffle_vector(one, ir.Constant(eight, ir.Undefined), zeros)

        def loaded(data):
            value = builder.load(builder.bitcast(builder.gep(data, [args[4]]), eight.as_pointer()))
            value.align = 8
            return value

        given = builder.icmp_signed("<", ir.Constant(eight, list(range(WIDTH))), spread(args[5]))
        both = builder.and_(loaded(chosen), spread(args[6]))
        mask = builder.and_(given, builder.icmp_unsigned("!=", both, ir.Constant(eight, [0] * WIDTH)))
        pointer = builder.gep(builder.bitcast(target, whole.as_pointer()), [args[1]])
        kind = ir.FunctionType(ir.VoidType(), [eight, pointer.type, I1X8])
        write = cgutils.get_or_insert_function(builder.module, kind, "llvm.masked.compressstore.v8i64")
        builder.call(write, [builder.add(loaded(source), spread(args[7])), pointer, mask])
        return builder.ctpop(builder.zext(builder.bitcast(mask, ir.IntType(8)), whole))

    return types.int64(rows, types.intp, listed, members, types.intp, types.int64, types.int64, types.int64), codegen


@intrinsic
def count_ones(typingctx, bits):
    """How many bits of a whole number are set."""

    def codegen(context, builder, sig, args):
        return builder.ctpop(args[0])

    return types.int64(types.int64), codegen


@intrinsic
def lane_numbers(typingctx):
    """0.0, 1.0, … 7.0."""

    def codegen(context, builder, sig, args):
        return ir.Constant(F64X8, [float(k) for k in range(WIDTH)])

    return lanes_type(), codegen


@intrinsic
def select(typingctx, mask, yes, no):
    """``yes`` where the mask is set, else ``no`` (lanes or a number); what is not chosen has no influence, NaN or
    not."""

    def codegen(context, builder, sig, args):
        return builder.select(args[0], args[1], _as(builder, args[2], sig.args[2], sig.args[1].vector))

    return yes(yes.mask, yes, no if isinstance(no, Lanes) else types.float64), codegen


@intrinsic
def mask_bits(typingctx, mask):
    """The mask as a whole number, lane k in bit k."""

    def codegen(context, builder, sig, args):
        return builder.zext(builder.bitcast(args[0], ir.IntType(sig.args[0].count)), ir.IntType(64))

    return types.int64(mask), codegen


@intrinsic
def any_lane(typingctx, mask):
    """Whether one lane of the mask is set."""

    def codegen(context, builder, sig, args):
        return builder.icmp_unsigned("!=", builder.bitcast(args[0], ir.IntType(8)), ir.IntType(8)(0))

    return types.boolean(mask_type), codegen


def _fold(builder: ir.IRBuilder, vector: ir.Value, combine: Callable[[ir.Value, ir.Value], ir.Value]) -> ir.Value:
    """The lanes combined to one number, always in the same order: halves, quarters, eighths."""
    width = WIDTH
    while width > 1:
        width //= 2
        kind = ir.VectorType(I32, width)
        low = builder.shuffle_vector(vector, vector, ir.Constant(kind, list(range(width))))
        high = builder.shuffle_vector(vector, vector, ir.Constant(kind, list(range(width, 2 * width))))
        vector = combine(low, high)
    return builder.extract_element(vector, I32(0))


@intrinsic
def lane_sum(typingctx, value):
    """The sum of the lanes."""

    def codegen(context, builder, sig, args):
        return _fold(builder, args[0], builder.fadd)

    return types.float64(lanes_type), codegen


@intrinsic
def sums_of_rows(typingctx, array, index, stride):
    """The lanes' sums of eight times eight numbers of a float64 array, from ``index`` on and ``stride`` apart: lane k
    is the sum of the k-th eight."""

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
def lane_max(typingctx, value):
    """The largest lane; lanes that are not numbers do not count."""

    def codegen(context, builder, sig, args):
        def larger(a, b):
            return builder.select(
                builder.or_(builder.fcmp_ordered(">", a, b), builder.fcmp_unordered("uno", b, b)), a, b
            )

        return _fold(builder, args[0], larger)

    return types.float64(lanes_type), codegen


@intrinsic
def named_lanes(typingctx, like, table, row, index):
    """A NamedTuple of the class of ``like`` whose k-th field is the eight numbers ``table[k, row, index:index +
    8]``."""
    result = types.NamedTuple([lanes_type] * len(like), like.instance_class)

    def codegen(context, builder, sig, args):
        array = context.make_array(sig.args[1])(context, builder, args[1])
        shape = cgutils.unpack_tuple(builder, array.shape)
        fields = []
        for k in range(len(sig.args[0])):
            offset = builder.add(builder.mul(context.get_constant(types.intp, k), shape[1]), args[2])
            offset = builder.add(builder.mul(offset, shape[2]), args[3])
            pointer = builder.bitcast(builder.gep(array.data, [offset]), F64X8.as_pointer())
            fields.append(builder.load(pointer))
            fields[-1].align = 8
        return context.make_tuple(builder, sig.return_type, fields)

    return result(like, table, types.intp, types.intp), codegen

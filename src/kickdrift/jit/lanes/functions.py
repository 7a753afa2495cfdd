"""SIMD as a type: functions of lanes in compiled kernels. The operators are in `vectors`.

Lanes are 8 or 4 numbers of float64, or 16 or 8 of float32 (LLVM's ``<8 x double>``, ``<16 x float>`` and half as many).
LLVM emits AVX-512, AVX2, SSE2 or NEON for the machine. All kernels use eight lanes of float64; for the other types see
`forces.lists.row_lanes`. `single` holds the operations of float32.

``inverse_sqrt`` for AVX-512 is a 14-bit estimate refined by a series, within 2 ulp. Zero, infinity and NaN give a
result that is not finite, so they stay visible.

Exponential, logarithm, sine and cosine of eight lanes are polynomials, since LLVM would call the C library for each
lane. Each is within 3 units in the last place of the true value, for the arguments that its docstring names. The bits
are the same wherever the code runs in lanes of the same kind, since no library takes part.
"""

import math
from typing import Any

from llvmlite import ir
from numba import types
from numba.extending import intrinsic

from kickdrift.jit.compile import as_written, features
from kickdrift.jit.lanes.gathering import lane_round
from kickdrift.jit.lanes.masks import select
from kickdrift.jit.lanes.vectors import (
    F64,
    F64X8,
    I32,
    WIDTH,
    as_lanes,
    constant,
    copied,
    estimate,
    flags_of,
    folded,
    fused,
    lanes_type,
)
from kickdrift.jit.numba_private import cgutils


@intrinsic
def splat(typingctx, scalar):
    """Return the same number in all lanes."""

    def codegen(context, builder, sig, args):
        return copied(builder, args[0])

    return lanes_type(types.float64), codegen


@intrinsic
def lanes_like(typingctx, value, like):
    """Return lanes unchanged, or a number in as many lanes as ``like`` has. For formulas that happen not to depend on
    lanes."""

    def codegen(context, builder, sig, args):
        return as_lanes(builder, args[0], sig.args[0], sig.args[1].vector)

    return like(types.float64 if isinstance(value, types.Number) else like, like), codegen


@intrinsic
def in_eight(typingctx, value):
    """Convert four or eight lanes of either precision to eight of float64. With four, the last four lanes are zero."""
    wide = ir.VectorType(F64, value.vector.count)

    def codegen(context, builder, sig, args):
        made = args[0] if args[0].type == wide else builder.fpext(args[0], wide)
        if wide == F64X8:
            return made
        order = ir.Constant(ir.VectorType(I32, WIDTH), list(range(WIDTH)))
        return builder.shuffle_vector(made, constant(0.0, wide), order)

    return lanes_type(value), codegen


@intrinsic
def multiply_add(typingctx, a, b, c):
    """Return a b + c, fused where the machine can. For products that are used twice, which LLVM does not fuse by
    itself."""

    def codegen(context, builder, sig, args):
        return fused(builder, *args)

    return a(a, a, a), codegen


@intrinsic
def plus(typingctx, a, b):
    """Return a + b without reassociation: for compensated sums, in functions that are ``compile.strict``."""

    def codegen(context, builder, sig, args):
        return builder.fadd(*args)

    return lanes_type(lanes_type, lanes_type), codegen


@intrinsic
def minus(typingctx, a, b):
    """Return a - b, likewise."""

    def codegen(context, builder, sig, args):
        return builder.fsub(*args)

    return lanes_type(lanes_type, lanes_type), codegen


@intrinsic
def inverse_sqrt(typingctx, value):
    """1 / sqrt(x), within 2 ulp.

    Zero, negative, infinite, subnormal and NaN x give a result that is not finite, or the true value. With AVX-512 the
    series of (1 - e)^(-1/2), e = 1 - x y^2 < 2^-13, corrects an estimate y of 14 bits. The first omitted term, 35/128
    e^4, is below half a rounding unit. This takes a third of the time of a square root and a divide.
    """

    def codegen(context, builder, sig, args):
        x = args[0]
        if "avx512f" not in features():
            kind = ir.FunctionType(F64X8, [F64X8])
            root = builder.call(cgutils.get_or_insert_function(builder.module, kind, "llvm.sqrt.v8f64"), [x])
            return builder.fdiv(constant(1.0), root, flags=flags_of(context))
        y = estimate(builder, "rsqrt14", x)
        e = fused(builder, builder.fneg(builder.fmul(x, y)), y, constant(1.0), "fma")
        series = fused(builder, constant(5 / 16), e, constant(3 / 8), "fma")
        series = fused(builder, series, e, constant(1 / 2), "fma")
        return fused(builder, builder.fmul(y, e), series, y, "fma")

    return lanes_type(lanes_type), codegen


@intrinsic
def inverse_sqrt_estimate(typingctx, value):
    """1 / sqrt(x) to 14 bits or better, for a correction by the caller."""

    def codegen(context, builder, sig, args):
        if "avx512f" in features():
            return estimate(builder, "rsqrt14", args[0])
        kind = ir.FunctionType(F64X8, [F64X8])
        root = builder.call(cgutils.get_or_insert_function(builder.module, kind, "llvm.sqrt.v8f64"), [args[0]])
        return builder.fdiv(constant(1.0), root, flags=flags_of(context))

    return lanes_type(lanes_type), codegen


@intrinsic(prefer_literal=True)
def rotated(typingctx, value, places):
    """Rotate lanes: lane k of the result is lane (k + places) mod 8. ``places`` is a literal number."""
    order = [(k + places.literal_value) % WIDTH for k in range(WIDTH)]

    def codegen(context, builder, sig, args):
        return builder.shuffle_vector(args[0], args[0], ir.Constant(ir.VectorType(I32, WIDTH), order))

    return lanes_type(lanes_type, places), codegen


@intrinsic
def exclusive_scan(typingctx, value):
    """Exclusive prefix sum: each lane gets the sum of the lanes before it, the first gets 0 (Hillis & Steele 1986,
    doi:10.1145/7902.7903). A non-finite lane makes all lanes non-finite."""

    def codegen(context, builder, sig, args):
        def shifted(vector, by, add):
            order = [(k - by) % WIDTH for k in range(WIDTH)]
            turned = builder.shuffle_vector(vector, vector, ir.Constant(ir.VectorType(I32, WIDTH), order))
            kept = ir.Constant(F64X8, [float(k >= by) for k in range(WIDTH)])  # a shift that brings in zeros is slower
            return fused(builder, turned, kept, add)

        total = shifted(args[0], 1, constant(0.0))
        for by in (1, 2, 4):
            total = shifted(total, by, total)
        return total

    return lanes_type(lanes_type), codegen


@intrinsic
def lane_numbers(typingctx):
    """The lanes 0.0, 1.0, … 7.0."""

    def codegen(context, builder, sig, args):
        return ir.Constant(F64X8, [float(k) for k in range(WIDTH)])

    return lanes_type(), codegen


@intrinsic
def lane_sum(typingctx, value):
    """Sum of the lanes."""

    def codegen(context, builder, sig, args):
        return folded(builder, args[0], builder.fadd)

    return types.float64(lanes_type), codegen


@intrinsic
def lane_max(typingctx, value):
    """Largest lane. NaN lanes do not count."""

    def codegen(context, builder, sig, args):
        def larger(a, b):
            return builder.select(
                builder.or_(builder.fcmp_ordered(">", a, b), builder.fcmp_unordered("uno", b, b)), a, b
            )

        return folded(builder, args[0], larger)

    return types.float64(lanes_type), codegen


LOG2_E = 1.4426950408889634
LN2_HIGH = 0.693147180369123816490  # with zeros at the end, so that whole multiples are exact
LN2_LOW = 1.90821492927058770002e-10
ROOT_HALF = 0.7071067811865476


def _form(vector: ir.VectorType) -> tuple[Any, ir.Constant, ir.Constant]:
    """Type of whole numbers as wide as the lanes, the number of a fraction's bits, and the bias of an exponent."""
    size, fraction, bias = (64, 52, 1023) if vector.element == F64 else (32, 23, 127)
    whole = ir.VectorType(ir.IntType(size), vector.count)
    return whole, ir.Constant(whole, [fraction] * vector.count), ir.Constant(whole, [bias] * vector.count)


@intrinsic
def power_of_two(typingctx, exponent):
    """Return 2^k for lanes of whole numbers k from -1022 to 1023, in float32 from -126 to 127."""

    def codegen(context, builder, sig, args):
        whole, fraction, bias = _form(args[0].type)
        return builder.bitcast(builder.shl(builder.add(builder.fptosi(args[0], whole), bias), fraction), args[0].type)

    return exponent(exponent), codegen


@intrinsic
def exponent_of(typingctx, value):
    """Return k for lanes m 2^k with m from 1 up to 2; the lanes are positive and normal."""

    def codegen(context, builder, sig, args):
        whole, fraction, bias = _form(args[0].type)
        bits = builder.lshr(builder.bitcast(args[0], whole), fraction)
        return builder.sitofp(builder.sub(bits, bias), args[0].type)

    return value(value), codegen


def polynomial_of(coefficients: tuple[float, ...]) -> Any:
    """Return a function of lanes x: the polynomial with these coefficients, lowest power first."""

    @intrinsic
    def polynomial(typingctx, x):
        def codegen(context, builder, sig, args):
            total = constant(coefficients[-1], args[0].type)
            for each in coefficients[-2::-1]:
                total = fused(builder, total, args[0], constant(each, args[0].type))
            return total

        return x(x), codegen

    return polynomial


exp_series = polynomial_of(tuple(1.0 / math.factorial(k) for k in range(14)))
log_series = polynomial_of(tuple(2.0 / (2 * k + 1) for k in range(12)))
sine_series = polynomial_of(tuple((-1.0) ** k / math.factorial(2 * k + 1) for k in range(11)))
cosine_series = polynomial_of(tuple((-1.0) ** k / math.factorial(2 * k) for k in range(12)))


@as_written
def lane_exp(x):
    """Return exp(x) of lanes, 0 below -708 and exp(708) above 708; nan stays nan."""
    low = x < -708.0
    x = select(low, splat(-708.0), x)
    x = select(x > 708.0, splat(708.0), x)
    k = lane_round(x * LOG2_E)
    r = (x - k * LN2_HIGH) - k * LN2_LOW
    return select(low, splat(0.0), exp_series(r) * power_of_two(k))


@as_written
def lane_log(x):
    """Return log(x) of lanes that are positive and normal."""
    k = exponent_of(x)
    m = x * power_of_two(splat(0.0) - k)
    high = m > 2.0 * ROOT_HALF
    m, k = select(high, 0.5 * m, m), select(high, k + 1.0, k)
    s = (m - 1.0) / (m + 1.0)
    return k * LN2_HIGH + (s * log_series(s * s) + k * LN2_LOW)


@as_written
def lane_sine_cosine(x):
    """Return sin(x) and cos(x) of lanes from -pi/2 to pi/2."""
    square = x * x
    return x * sine_series(square), cosine_series(square)

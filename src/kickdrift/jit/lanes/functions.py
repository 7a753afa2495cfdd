"""SIMD as a type: functions of lanes in compiled kernels. The operators are in `vectors`.

Lanes are 8 or 4 numbers of float64, or 16 or 8 of float32 (LLVM's ``<8 x double>``, ``<16 x float>`` and half as many).
LLVM emits AVX-512, AVX2, SSE2 or NEON for the machine. All kernels use eight lanes of float64; for the other types see
`forces.lists.row_lanes`. `single` holds the operations of float32.

``inverse_sqrt`` for AVX-512 is a 14-bit estimate refined by a series, within 2 ulp. Zero, infinity and NaN give a
result that is not finite, so they stay visible.
"""

from __future__ import annotations

from llvmlite import ir
from numba import types
from numba.extending import intrinsic

from kickdrift.jit.compile import features
from kickdrift.jit.lanes.vectors import (
    F64,
    F64X8,
    I32,
    WIDTH,
    Lanes,
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

    return like(value if isinstance(value, Lanes) else types.float64, like), codegen


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

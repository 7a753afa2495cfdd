"""SIMD as a type: 8 or 4 lanes of float64, or 16 or 8 of float32, that compiled kernels use like a number.

numba learns the types ``Lanes`` (LLVM's ``<8 x double>``, ``<16 x float>`` and half as many) and ``Mask``, with
arithmetic operators, comparisons and a few functions. LLVM then emits AVX-512, AVX2, SSE2 or NEON for the machine. All
kernels use eight lanes of float64; for the other types see `forces.row_lanes`. Lanes mix with scalars, which are copied
to all lanes. Like scalars, they have the fast-math flags of the function around them. In a function without such flags,
a product inside a sum is always fused with the sum, in the same way.

For AVX-512, whose divide would take over half of a pair kernel's time, division of 512 bits is a 14-bit estimate
refined by a series, within 2 ulp. So is ``inverse_sqrt``. Zero, infinity and NaN give a result that is not finite, so
they stay visible. Elsewhere division is a plain divide: in a pair kernel for AVX2 estimates were no faster. `single`
holds the operations of float32.
"""

from __future__ import annotations

import math
import operator
from collections.abc import Callable
from typing import Any

from llvmlite import ir
from numba import types
from numba.extending import intrinsic, lower_builtin

from kickdrift.jit.compile import features
from kickdrift.jit.numba_private import AbstractTemplate, ConcreteTemplate, cgutils, infer_global, signature
from kickdrift.jit.vectors import (
    F64,
    F64X8,
    FULL,
    I32,
    KINDS,
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
    suffix,
)


def _divide(builder: ir.IRBuilder, a: ir.Value, b: ir.Value, flags: tuple[str, ...]) -> ir.Value:
    """Emit a / b. An estimate y with e = 1 - b y < 2^-13 gives 1 / b = y (1 + e) (1 + e^2) to 2^-52, or y (1 + e) to
    2^-26."""
    if "avx512f" not in features() or b.type not in FULL:
        return builder.fdiv(a, b, flags=flags)
    y = estimate(builder, "rcp14", b)
    e = fused(builder, builder.fneg(b), y, constant(1.0, b.type), "fma")
    y = fused(builder, y, e, y, "fma")
    if b.type == F64X8:
        y = fused(builder, y, builder.fmul(e, e), y, "fma")
    return builder.fmul(a, y, flags=flags)


def _is_product(value: ir.Value) -> bool:
    return isinstance(value, ir.Instruction) and value.opname == "fmul" and isinstance(value.type, ir.VectorType)


def added(builder: ir.IRBuilder, a: ir.Value, b: ir.Value, flags: tuple[str, ...]) -> ir.Value:
    """Emit a + b, fused if one is a product. LLVM fuses by itself where the flag "contract" allows it."""
    if not flags and _is_product(b):
        return fused(builder, b.operands[0], b.operands[1], a)
    if not flags and _is_product(a):
        return fused(builder, a.operands[0], a.operands[1], b)
    return builder.fadd(a, b, flags=flags)


def subtracted(builder: ir.IRBuilder, a: ir.Value, b: ir.Value, flags: tuple[str, ...]) -> ir.Value:
    """Emit a - b, likewise."""
    if not flags and _is_product(b):
        return fused(builder, builder.fneg(b.operands[0]), b.operands[1], a)
    if not flags and _is_product(a):
        return fused(builder, a.operands[0], a.operands[1], builder.fneg(b))
    return builder.fsub(a, b, flags=flags)


_ARITHMETIC: dict[Callable[..., Any], Callable[..., ir.Value]] = {
    operator.add: added,
    operator.sub: subtracted,
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


def register(function: Callable[..., Any], signatures: list[Any]) -> None:
    """Teach numba the argument types and result types of a function."""
    infer_global(function)(type("LanesTemplate", (ConcreteTemplate,), {"key": function, "cases": signatures}))


def _lower_binary(function: Callable[..., Any], emit: Callable[..., ir.Value], compares: bool) -> None:
    cases = [
        signature(kind.mask if compares else kind, *pair)
        for kind in KINDS
        for pair in ((kind, kind), (kind, types.float64), (types.float64, kind))
    ]
    register(function, cases)
    for case in cases:

        def lowered(context, builder, sig, args):
            vector = next(kind.vector for kind in sig.args if isinstance(kind, Lanes))
            a, b = (as_lanes(builder, value, kind, vector) for kind, value in zip(sig.args, args, strict=True))
            return emit(builder, a, b, flags_of(context))

        lower_builtin(function, *case.args)(lowered)


def _lower_function(function: Callable[..., Any], name: str) -> None:
    register(function, [signature(kind, kind) for kind in KINDS])
    for kind in KINDS:
        lower_builtin(function, kind)(_calling(name))


def _calling(name: str) -> Callable[..., ir.Value]:
    def lowered(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        vector = args[0].type
        kind = ir.FunctionType(vector, [vector])
        called = cgutils.get_or_insert_function(builder.module, kind, f"llvm.{name}.{suffix(vector)}")
        return builder.call(called, args)

    return lowered


for _function, _emit in _ARITHMETIC.items():
    _lower_binary(_function, _emit, False)
for _function, _sign in _COMPARISONS.items():
    _lower_binary(_function, lambda builder, a, b, flags, sign=_sign: builder.fcmp_ordered(sign, a, b), True)
for _function, _name in _FUNCTIONS.items():
    _lower_function(_function, _name)
register(operator.neg, [signature(kind, kind) for kind in KINDS])


@lower_builtin(operator.neg, Lanes)
def _negative(context, builder, sig, args):
    return builder.fneg(args[0], flags=flags_of(context))


@infer_global(operator.pow)
class _WholePower(AbstractTemplate):
    """``x**k`` for a literal whole k from 1 to 32. SIMD lanes have no other exponents."""

    def generic(self, args: Any, kws: Any) -> Any:
        whole = len(args) == 2 and isinstance(args[0], Lanes) and isinstance(args[1], types.IntegerLiteral)
        return signature(args[0], *args) if whole and 1 <= args[1].literal_value <= 32 else None


@lower_builtin(operator.pow, Lanes, types.IntegerLiteral)
def _whole_power(context, builder, sig, args):
    exponent, square, result, flags = sig.args[1].literal_value, args[0], None, flags_of(context)
    while exponent:
        if exponent & 1:
            result = square if result is None else builder.fmul(result, square, flags=flags)
        square = builder.fmul(square, square, flags=flags)
        exponent >>= 1
    return result


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


@intrinsic(prefer_literal=True)
def rotated(typingctx, value, places):
    """Rotate lanes: lane k of the result is lane (k + places) mod 8. ``places`` is a literal number."""
    order = [(k + places.literal_value) % WIDTH for k in range(WIDTH)]

    def codegen(context, builder, sig, args):
        return builder.shuffle_vector(args[0], args[0], ir.Constant(ir.VectorType(I32, WIDTH), order))

    return lanes_type(lanes_type, places), codegen


@intrinsic
def sums_before(typingctx, value):
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

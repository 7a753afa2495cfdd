"""Operators of SIMD lanes: arithmetic, comparisons and mathematical functions that numba learns for the type ``Lanes``.

Lanes mix with scalars, which are copied to all lanes. Like scalars, they have the fast-math flags of the function
around them. In a function without such flags, a product inside a sum is always fused with the sum, in the same way.

For AVX-512, whose divide would take over half of a pair kernel's time, division of 512 bits is a 14-bit estimate
refined by a series, within 2 ulp. Zero, infinity and NaN give a result that is not finite, so they stay visible.
Elsewhere division is a plain divide: in a pair kernel for AVX2 estimates were no faster.
"""

from __future__ import annotations

import math
import operator
from collections.abc import Callable
from typing import Any

from llvmlite import ir
from numba import types
from numba.extending import lower_builtin

from kickdrift.jit.compile import features
from kickdrift.jit.lanes.vectors import (
    F64X8,
    FULL,
    KINDS,
    Lanes,
    as_lanes,
    constant,
    estimate,
    flags_of,
    fused,
    suffix,
)
from kickdrift.jit.numba_private import AbstractTemplate, ConcreteTemplate, cgutils, infer_global, signature


def divided(builder: ir.IRBuilder, a: ir.Value, b: ir.Value, flags: tuple[str, ...]) -> ir.Value:
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
    operator.truediv: divided,
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
    return whole_power(builder, args[0], sig.args[1].literal_value, flags_of(context))


def whole_power(builder: ir.IRBuilder, x: ir.Value, exponent: int, flags: tuple[str, ...]) -> ir.Value:
    """Emit x to a whole power from 1 on."""
    square, result = x, None
    while exponent:
        if exponent & 1:
            result = square if result is None else builder.fmul(result, square, flags=flags)
        square = builder.fmul(square, square, flags=flags)
        exponent >>= 1
    return result

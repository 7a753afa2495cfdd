"""Arithmetic of duals of lanes, along one direction.

Values come from the same operations as those of plain lanes, fused where theirs are. So they have the same bits, and
where a formula runs on both, LLVM computes them once.
"""

from __future__ import annotations

import operator
from collections.abc import Callable
from typing import Any

from llvmlite import ir
from numba import types
from numba.extending import lower_builtin

from kickdrift.jit.duals.dual import SINGLE, Dual, made, of_lanes
from kickdrift.jit.lanes.vectors import LARGEST_POWER, Lanes, added, copied, divided, flags_of, subtracted, whole_power
from kickdrift.jit.numba_private import AbstractTemplate, infer_global, signature

_PLAIN = (types.Number, types.Boolean, Lanes)
Parts = tuple[ir.Value, ir.Value | None]


def lanes_of(*kinds: types.Type) -> Lanes | None:
    """The lanes of duals of lanes that operands of these types give; None if they give no such duals."""
    if not any(isinstance(kind, Dual) for kind in kinds):
        return None
    if not all(kind == SINGLE or of_lanes(kind) or isinstance(kind, _PLAIN) for kind in kinds):
        return None
    return next(
        (kind.value if of_lanes(kind) else kind for kind in kinds if of_lanes(kind) or isinstance(kind, Lanes)), None
    )


def _part(builder: ir.IRBuilder, dual: ir.Value, k: int) -> ir.Value:
    """A part of a dual. If it was computed just now, it is the operation itself, so that a sum sees a product."""
    inside = dual
    while isinstance(inside, ir.instructions.InsertValue):
        if tuple(inside.indices) == (k,):
            return inside.operands[1]
        inside = inside.operands[0]
    return builder.extract_value(dual, k)


def _parts(context: Any, builder: ir.IRBuilder, value: Any, kind: types.Type, vector: ir.VectorType) -> Parts:
    """Value and slope in lanes; the slope is None for an operand that is no dual."""
    if of_lanes(kind):
        return _part(builder, value, 0), _part(builder, value, 1)
    if isinstance(kind, Lanes):
        return value, None
    if kind == SINGLE:
        return copied(builder, _part(builder, value, 0), vector), copied(builder, _part(builder, value, 1), vector)
    return copied(builder, context.cast(builder, value, kind, types.float64), vector), None


def _sum(builder: Any, a: Parts, b: Parts, flags: tuple[str, ...]) -> tuple[ir.Value, ir.Value]:
    value = added(builder, a[0], b[0], flags)
    if a[1] is None or b[1] is None:
        return value, a[1] if b[1] is None else b[1]
    return value, added(builder, a[1], b[1], flags)


def _difference(builder: Any, a: Parts, b: Parts, flags: tuple[str, ...]) -> tuple[ir.Value, ir.Value]:
    value = subtracted(builder, a[0], b[0], flags)
    if b[1] is None:
        return value, a[1]
    return value, builder.fneg(b[1], flags=flags) if a[1] is None else subtracted(builder, a[1], b[1], flags)


def _product(builder: Any, a: Parts, b: Parts, flags: tuple[str, ...]) -> tuple[ir.Value, ir.Value]:
    value = builder.fmul(a[0], b[0], flags=flags)
    terms = [builder.fmul(s, v, flags=flags) for s, v in ((a[1], b[0]), (b[1], a[0])) if s is not None]
    return value, terms[0] if len(terms) == 1 else added(builder, terms[0], terms[1], flags)


def _quotient(builder: Any, a: Parts, b: Parts, flags: tuple[str, ...]) -> tuple[ir.Value, ir.Value]:
    value = divided(builder, a[0], b[0], flags)
    if b[1] is None:
        return value, divided(builder, a[1], b[0], flags)
    change = builder.fmul(b[1], value, flags=flags)
    change = builder.fneg(change, flags=flags) if a[1] is None else subtracted(builder, a[1], change, flags)
    return value, divided(builder, change, b[0], flags)


def _teach(function: Callable[..., Any], emit: Callable[..., tuple[ir.Value, ir.Value]]) -> None:
    @infer_global(function)
    class _Template(AbstractTemplate):
        def generic(self, args: Any, kws: Any) -> Any:
            lanes = lanes_of(*args) if len(args) == 2 else None
            return None if lanes is None else signature(Dual(lanes, lanes), *args)

    def lowered(context, builder, sig, args):
        vector = sig.return_type.value.vector
        a, b = (_parts(context, builder, *each, vector) for each in zip(args, sig.args, strict=True))
        return made(builder, *emit(builder, a, b, flags_of(context)))

    for other in (Dual, *_PLAIN):
        lower_builtin(function, Dual, other)(lowered)
        if other is not Dual:
            lower_builtin(function, other, Dual)(lowered)


_teach(operator.add, _sum)
_teach(operator.sub, _difference)
_teach(operator.mul, _product)
_teach(operator.truediv, _quotient)


@infer_global(operator.neg)
class _Negative(AbstractTemplate):
    def generic(self, args: Any, kws: Any) -> Any:
        return signature(args[0], args[0]) if len(args) == 1 and of_lanes(args[0]) else None


@lower_builtin(operator.neg, Dual)
def _negative(context, builder, sig, args):
    return made(builder, *(builder.fneg(_part(builder, args[0], k), flags=flags_of(context)) for k in range(2)))


@infer_global(operator.pow)
class _WholePower(AbstractTemplate):
    """``x**k`` for a literal whole k, as of lanes."""

    def generic(self, args: Any, kws: Any) -> Any:
        whole = len(args) == 2 and of_lanes(args[0]) and isinstance(args[1], types.IntegerLiteral)
        return signature(args[0], *args) if whole and abs(args[1].literal_value) <= LARGEST_POWER else None


@lower_builtin(operator.pow, Dual, types.IntegerLiteral)
def _power(context, builder, sig, args):
    exponent, flags = sig.args[1].literal_value, flags_of(context)
    x, slope = (_part(builder, args[0], k) for k in range(2))
    if exponent == 1:
        return args[0]
    rate = builder.fmul(whole_power(builder, x, exponent - 1, flags), slope, flags=flags)
    times = ir.Constant(x.type, [float(exponent)] * x.type.count)
    return made(builder, whole_power(builder, x, exponent, flags), builder.fmul(times, rate, flags=flags))

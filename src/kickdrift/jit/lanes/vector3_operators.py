"""The type of vectors of three, of lanes or of numbers, with its operators.

numba learns ``Vector3`` with +, -, the sign, products with lanes and with numbers, and ``.x .y .z``. In a function
without fast-math flags, a product of lanes inside a sum is fused with the sum. Numbers that meet lanes are copied to
all lanes.
"""

from __future__ import annotations

import operator
from collections.abc import Callable
from typing import Any

from llvmlite import ir
from numba import types
from numba.extending import lower_builtin, lower_getattr_generic, models, register_model

from kickdrift.jit.lanes.operators import added, subtracted
from kickdrift.jit.lanes.vectors import (
    Lanes,
    copied,
    flags_of,
)
from kickdrift.jit.numba_private import AbstractTemplate, AttributeTemplate, infer_getattr, infer_global, signature

AXES = ("x", "y", "z")


class Vector3(types.Type):
    """Three values of the type ``of``: lanes or float64."""

    def __init__(self, of: types.Type) -> None:
        self.of = of
        super().__init__(name=f"Vector3({of.name})")


@register_model(Vector3)
class _Vector3Model(models.StructModel):
    def __init__(self, dmm: Any, fe_type: Vector3) -> None:
        super().__init__(dmm, fe_type, [(axis, fe_type.of) for axis in AXES])


def components(builder: ir.IRBuilder, vector: ir.Value) -> list[ir.Value]:
    """Components of a vector. For a vector just put together, these are its original values, so that `lanes.added`
    still recognises a product."""
    known: dict[int, ir.Value] = {}
    while isinstance(vector, ir.instructions.InsertValue):
        (place,), (vector, value) = vector.indices, vector.operands
        known.setdefault(place, value)
    return [known[k] if k in known else builder.extract_value(vector, k) for k in range(3)]


def joined(builder: ir.IRBuilder, parts: list[ir.Value]) -> ir.Value:
    """Vector of three components."""
    vector = ir.Constant(ir.LiteralStructType([part.type for part in parts]), ir.Undefined)
    for k, part in enumerate(parts):
        vector = builder.insert_value(vector, part, k)
    return vector


def common(*kinds: types.Type) -> types.Type | None:
    """Common type of vectors, lanes and numbers in one operation, or None if they do not mix."""
    inner = [kind.of if isinstance(kind, Vector3) else kind for kind in kinds]
    lanes = {kind for kind in inner if isinstance(kind, Lanes)}
    if len(lanes) > 1 or not all(isinstance(kind, Lanes | types.Number) for kind in inner):
        return None
    return lanes.pop() if lanes else types.float64


def passed(kind: types.Type) -> types.Type:
    """Type of a vector, lanes or a number as an argument: whole numbers become float64."""
    return types.float64 if isinstance(kind, types.Number) else kind


def parts_of(builder: ir.IRBuilder, value: ir.Value, kind: types.Type, of: types.Type) -> list[ir.Value]:
    """Three values of the type ``of``: a vector's components, or lanes or a number three times."""
    parts = components(builder, value) if isinstance(kind, Vector3) else [value]
    if isinstance(of, Lanes) and not isinstance(parts[0].type, ir.VectorType):
        parts = [copied(builder, part, of.vector) for part in parts]
    return parts if len(parts) == 3 else 3 * parts


def _multiplied(builder: ir.IRBuilder, a: ir.Value, b: ir.Value, flags: tuple[str, ...]) -> ir.Value:
    return builder.fmul(a, b, flags=flags)


def _teach(function: Callable[..., Any], emit: Callable[..., ir.Value], *pairs: tuple[Any, Any]) -> None:
    """Teach numba an operator on two operands of these classes, component by component."""

    def generic(self: Any, args: Any, kws: Any) -> Any:
        if not any(isinstance(kind, Vector3) for kind in args) or len(args) != 2:
            return None
        given = [passed(kind) for kind in args]
        of = common(*given)
        known = any(all(map(isinstance, given, pair)) for pair in pairs)
        return signature(Vector3(of), *given) if known and of else None

    infer_global(function)(type("Vector3Template", (AbstractTemplate,), {"key": function, "generic": generic}))

    def lowered(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        of, flags = sig.return_type.of, flags_of(context)
        a, b = (parts_of(builder, value, kind, of) for value, kind in zip(args, sig.args, strict=True))
        return joined(builder, [emit(builder, *pair, flags) for pair in zip(a, b, strict=True)])

    for pair in pairs:
        lower_builtin(function, *pair)(lowered)


_teach(operator.add, added, (Vector3, Vector3))
_teach(operator.sub, subtracted, (Vector3, Vector3))
_NUMBER_FIRST = ((Lanes, Vector3), (types.Float, Vector3))
_teach(operator.mul, _multiplied, *_NUMBER_FIRST, *(pair[::-1] for pair in _NUMBER_FIRST))


@infer_global(operator.neg)
class _Negative(AbstractTemplate):
    def generic(self, args: Any, kws: Any) -> Any:
        return signature(args[0], args[0]) if isinstance(args[0], Vector3) else None


@lower_builtin(operator.neg, Vector3)
def _negative(context, builder, sig, args):
    return joined(builder, [builder.fneg(part, flags=flags_of(context)) for part in components(builder, args[0])])


@infer_getattr
class _Components(AttributeTemplate):
    key = Vector3

    def generic_resolve(self, vector: Vector3, name: str) -> Any:
        return vector.of if name in AXES else None


@lower_getattr_generic(Vector3)
def _component(context, builder, kind, value, name):
    return components(builder, value)[AXES.index(name)]

"""More operators for laws: components and products of vectors, and more functions of lanes.

numba learns ``d[0]``, ``d @ e``, ``np.dot(d, e)``, ``np.cross(d, e)`` and ``d / r`` for ``Vector3``, and ``np.where``,
``max``, ``min``, ``math.sin`` and ``math.cos`` for lanes. In plain Python a vector is a NumPy array and lanes are a
number, so one formula serves both.
"""

import math
import operator
from collections.abc import Callable
from typing import Any

import numpy as np
from llvmlite import ir
from numba import types
from numba.extending import intrinsic, lower_builtin

from kickdrift.jit.inner import overload
from kickdrift.jit.lanes import elementary as elementary  # exponential, logarithm and powers of lanes
from kickdrift.jit.lanes.vector3 import Vector3, components, cross, dot, vector3
from kickdrift.jit.lanes.vectors import KINDS, Lanes, Mask, as_lanes, suffix
from kickdrift.jit.numba_private import AbstractTemplate, ConcreteTemplate, cgutils, infer_global, signature

_SCALAR = (types.Float, types.Integer)


# --- vectors ---


@infer_global(operator.getitem)
class _Component(AbstractTemplate):
    """``d[k]`` of a vector."""

    def generic(self, args: Any, kws: Any) -> Any:
        known = len(args) == 2 and isinstance(args[0], Vector3) and isinstance(args[1], types.Integer)
        return signature(args[0].of, args[0], types.intp) if known else None


@lower_builtin(operator.getitem, Vector3, types.Integer)
def _component(context, builder, sig, args):
    x, y, z = components(builder, args[0])
    first, second = (builder.icmp_signed("==", args[1], ir.Constant(args[1].type, k)) for k in range(2))
    return builder.select(first, x, builder.select(second, y, z))


def _both(a: Any, b: Any) -> bool:
    return isinstance(a, Vector3) and isinstance(b, Vector3)


@overload(operator.matmul)
def _matmul(a, b):
    return (lambda a, b: dot(a, b)) if _both(a, b) else None


@overload(np.dot)
def _dot(a, b):
    return (lambda a, b: dot(a, b)) if _both(a, b) else None


@overload(np.cross)
def _cross(a, b):
    return (lambda a, b: cross(a, b)) if _both(a, b) else None


@overload(operator.mul)
def _multiplied(a, b):
    if _both(a, b):  # component by component, as NumPy does
        return lambda a, b: vector3(a.x * b.x, a.y * b.y, a.z * b.z)
    return None


@overload(operator.truediv)
def _divided(a, b):
    if isinstance(a, Vector3) and isinstance(b, (*_SCALAR, Lanes)):
        return lambda a, b: a * (1.0 / b)
    return None


# --- lanes ---


@intrinsic
def _chosen(typingctx, mask, yes, no):
    """Lanes of ``yes`` where the mask is set, else of ``no``; both may be numbers."""
    kind = next(kind for kind in (yes, no, *KINDS) if isinstance(kind, Lanes) and kind.mask == mask)

    def codegen(context, builder, sig, args):
        first, second = (as_lanes(builder, args[k], sig.args[k], kind.vector) for k in (1, 2))
        return builder.select(args[0], first, second)

    given = [types.float64 if isinstance(each, types.Number) else kind for each in (yes, no)]
    return kind(mask, *given), codegen


@overload(np.where)
def _where(condition, x, y):
    if isinstance(condition, Mask):
        return lambda condition, x, y: _chosen(condition, x, y)
    return None


def _teach(function: Callable[..., Any], cases: list[Any], lowered: Callable[..., Any]) -> None:
    infer_global(function)(type("LawTemplate", (ConcreteTemplate,), {"key": function, "cases": cases}))
    for case in cases:
        lower_builtin(function, *case.args)(lowered)


def _larger(sign: str) -> Callable[..., Any]:
    def lowered(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        vector = sig.return_type.vector
        a, b = (as_lanes(builder, value, kind, vector) for value, kind in zip(args, sig.args, strict=True))
        return builder.select(builder.fcmp_ordered(sign, b, a), b, a)

    return lowered


def _calling(name: str) -> Callable[..., Any]:
    def lowered(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        vector = args[0].type
        kind = ir.FunctionType(vector, [vector])
        return builder.call(cgutils.get_or_insert_function(builder.module, kind, f"llvm.{name}.{suffix(vector)}"), args)

    return lowered


for _function, _sign in ((max, ">"), (min, "<")):
    _pairs = [(a, b) for kind in KINDS for a, b in ((kind, kind), (kind, types.float64), (types.float64, kind))]
    _cases = [signature(next(each for each in pair if isinstance(each, Lanes)), *pair) for pair in _pairs]
    _teach(_function, _cases, _larger(_sign))
for _name, _wave in (("sin", math.sin), ("cos", math.cos)):
    _teach(_wave, [signature(kind, kind) for kind in KINDS], _calling(_name))

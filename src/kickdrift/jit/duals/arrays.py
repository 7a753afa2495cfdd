"""Arithmetic of whole arrays of duals, element by element with NumPy's broadcasting, so that laws may use it."""

import operator
from collections.abc import Callable
from typing import Any

import numpy as np
from numba import types

from kickdrift.jit.compile import as_written
from kickdrift.jit.duals.dual import DUAL, SLOT, as_dual, kept_duals
from kickdrift.jit.duals.functions import SLOPES
from kickdrift.jit.inner import overload

NUMBERS = (types.Float, types.Integer)


def _of_duals(kind: Any) -> bool:
    return isinstance(kind, types.Array) and kind.dtype == DUAL


def _plain(kind: Any) -> bool:
    return isinstance(kind, types.Array) and isinstance(kind.dtype, NUMBERS)


def _single(kind: Any) -> bool:
    return kind == DUAL or isinstance(kind, NUMBERS)


@as_written
def empty_duals(shape):
    """Array of duals of this shape, a tuple."""
    count = SLOT
    for length in shape:
        count *= length
    return kept_duals(np.empty(count), shape)


def _teach(function: Callable[..., Any], in_place: Callable[..., Any]) -> None:
    def both(a, b):
        shape = np.broadcast_shapes(a.shape, b.shape)
        first, second, made = np.broadcast_to(a, shape), np.broadcast_to(b, shape), empty_duals(shape)
        for place in np.ndindex(shape):
            made[place] = function(first[place], second[place])
        return made

    def with_single(a, b):
        made = empty_duals(a.shape)
        for place in np.ndindex(a.shape):
            made[place] = as_dual(function(a[place], b))
        return made

    def single_with(a, b):
        made = empty_duals(b.shape)
        for place in np.ndindex(b.shape):
            made[place] = as_dual(function(a, b[place]))
        return made

    def into(a, b):
        second = np.broadcast_to(b, a.shape)
        for place in np.ndindex(a.shape):
            a[place] = function(a[place], second[place])
        return a

    def single_into(a, b):
        for place in np.ndindex(a.shape):
            a[place] = function(a[place], b)
        return a

    @overload(function)
    def whole(a, b):
        duals = _of_duals(a) or _of_duals(b) or DUAL in (a, b)
        if duals and (_of_duals(a) or _plain(a)) and (_of_duals(b) or _plain(b)):
            return both
        if duals and isinstance(a, types.Array) and _single(b):
            return with_single
        return single_with if duals and isinstance(b, types.Array) and _single(a) else None

    @overload(in_place, target="cpu")  # before numba's own rule, which fails on types that it does not know
    def whole_in_place(a, b):
        if _of_duals(a) and (_of_duals(b) or _plain(b)):
            return into
        return single_into if _of_duals(a) and _single(b) else None


for _function, _in_place in (
    (operator.add, operator.iadd),
    (operator.sub, operator.isub),
    (operator.mul, operator.imul),
    (operator.truediv, operator.itruediv),
    (operator.pow, operator.ipow),
):
    _teach(_function, _in_place)


@overload(operator.neg)
def _negative(a):
    return (lambda a: -1.0 * a) if _of_duals(a) else None


def _teach_each(function: Callable[..., Any]) -> None:
    def each(x):
        made = empty_duals(x.shape)
        for place in np.ndindex(x.shape):
            made[place] = function(x[place])
        return made

    overload(function, target="cpu")(lambda x: each if _of_duals(x) else None)


for _function in (np.abs, *(getattr(np, name) for _, name, _ in SLOPES if name and name != "abs")):
    _teach_each(_function)


@overload(np.sum, target="cpu")
def _sum(a, axis=None):
    def of_all(a, axis=None):
        total = as_dual(0.0)
        for place in np.ndindex(a.shape):
            total += a[place]
        return total

    def of_columns(a, axis=None):
        made = empty_duals((a.shape[1],))
        for j in range(a.shape[1]):
            made[j] = as_dual(0.0)
            for i in range(a.shape[0]):
                made[j] = made[j] + a[i, j]
        return made

    if not _of_duals(a):
        return None
    if isinstance(axis, types.NoneType) or axis is None:
        return of_all
    first = isinstance(axis, types.IntegerLiteral) and axis.literal_value == 0
    return of_columns if first and a.ndim == 2 else None


def _product(a, b):
    return np.sum(a * b)


@overload(operator.matmul, target="cpu")
@overload(np.dot, target="cpu")
def _dot(a, b):
    rows = all((_of_duals(each) or _plain(each)) and each.ndim == 1 for each in (a, b))
    return _product if rows and (_of_duals(a) or _of_duals(b)) else None


@overload(np.linalg.norm, target="cpu")
def _norm(x):
    return (lambda x: np.sqrt(np.sum(x * x))) if _of_duals(x) else None

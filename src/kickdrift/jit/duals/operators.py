"""Operators of duals. They mix with numbers and with vectors of numbers, which have no slopes.

The rules are those of calculus: linear operators act on value and slopes alike, bilinear ones by the product rule.
"""

import math
import operator
from collections.abc import Callable
from typing import Any

import numpy as np
from numba import types

from kickdrift.jit.compile import as_written
from kickdrift.jit.duals.dual import DUAL, DUAL3, SLOT, TWICE3, Dual, as_dual, dual, kept_duals, of_lanes
from kickdrift.jit.duals.lane_operators import lanes_of
from kickdrift.jit.inner import by_type, overload
from kickdrift.jit.lanes import law_operators as law_operators  # operators of the vectors that duals hold
from kickdrift.jit.lanes.functions import lanes_like, splat
from kickdrift.jit.lanes.vector3 import Vector3, thrice, vector3
from kickdrift.jit.lanes.vectors import Lanes, Mask

_PLAIN = (types.Number, types.Boolean, Vector3, Lanes)


def _chosen(a: Any, b: Any, both: Any, first: Any, second: Any) -> Any:
    """Code for two duals, or for a dual and something of lower order; None for other types."""
    one, two = (kind.order if isinstance(kind, Dual) else 0 for kind in (a, b))
    if not all(isinstance(kind, (Dual, *_PLAIN)) for kind in (a, b)) or one == two == 0:
        return None
    if one == two:
        return both
    return first if one > two else second


def _calculated(a: Any, b: Any, both: Any, first: Any, second: Any) -> Any:
    """The same for arithmetic; None for what `lane_operators` knows."""
    return None if lanes_of(a, b) else _chosen(a, b, both, first, second)


def _teach_sum(function: Callable[..., Any], in_place: Callable[..., Any], sign: float) -> None:
    def both(a, b):
        return dual(function(a.value, b.value), function(a.slope, b.slope))

    def first(a, b):
        return dual(function(a.value, b), a.slope)

    def second(a, b):
        return dual(function(a, b.value), sign * b.slope)

    def code(a, b):
        return _calculated(a, b, both, first, second)

    overload(function)(code)
    overload(in_place)(code)


def _teach_product(function: Callable[..., Any]) -> Callable[..., Any]:
    def both(a, b):
        return dual(function(a.value, b.value), function(a.slope, b.value) + function(a.value, b.slope))

    def first(a, b):
        return dual(function(a.value, b), function(a.slope, b))

    def second(a, b):
        return dual(function(a, b.value), function(a, b.slope))

    def code(a, b):
        return _calculated(a, b, both, first, second)

    overload(function)(code)
    return code


_teach_sum(operator.add, operator.iadd, 1.0)
_teach_sum(operator.sub, operator.isub, -1.0)
for _product in (operator.matmul, np.dot, np.cross):
    _teach_product(_product)
overload(operator.imul)(_teach_product(operator.mul))


def _quotient(a, b):
    inverse = 1.0 / b.value
    value = a.value * inverse
    return dual(value, (a.slope - b.slope * value) * inverse)


def _over_number(a, b):
    inverse = 1.0 / b
    return dual(a.value * inverse, a.slope * inverse)


def _number_over(a, b):
    value = a * (1.0 / b.value)
    return dual(value, b.slope * (value * (-1.0 / b.value)))


def _divided(a, b):
    if isinstance(b, Vector3) or b in (DUAL3, TWICE3):
        return None
    return _calculated(a, b, _quotient, _over_number, _number_over)


for _division in (operator.truediv, operator.itruediv):
    overload(_division)(_divided)


@overload(operator.neg)
def _negative(a):
    return (lambda a: dual(-a.value, -a.slope)) if isinstance(a, Dual) and not of_lanes(a) else None


@overload(operator.pos)
def _positive(a):
    return (lambda a: a) if isinstance(a, Dual) else None


def _power_of_power(a, b):
    value = a.value**b.value
    return dual(value, (b.value * a.value ** (b.value - 1.0)) * a.slope + (value * math.log(a.value)) * b.slope)


def _power_of_number(a, b):
    return dual(a.value**b, (b * a.value ** (b - 1)) * a.slope)


def _number_to_power(a, b):
    value = a**b.value
    return dual(value, (value * math.log(a)) * b.slope)


def _whole_power(a, b):
    if b == 0:
        return dual(1.0, 0.0 * a.slope)
    if b == 1:
        return a
    before = a.value ** (b - 1)
    return dual(before * a.value, (b * before) * a.slope)


def _power(a, b):
    if a == DUAL and isinstance(b, types.Integer):
        return _whole_power
    if lanes_of(a, b) and isinstance(b, types.Integer):
        return None  # which `lane_operators` knows
    return _chosen(a, b, _power_of_power, _power_of_number, _number_to_power)


for _raise in (operator.pow, operator.ipow):
    overload(_raise)(_power)


def _teach_comparison(function: Callable[..., Any]) -> None:
    def both(a, b):
        return function(a.value, b.value)

    def first(a, b):
        return function(a.value, b)

    def second(a, b):
        return function(a, b.value)

    overload(function)(lambda a, b: _chosen(a, b, both, first, second))


for _comparison in (operator.lt, operator.le, operator.gt, operator.ge, operator.eq, operator.ne):
    _teach_comparison(_comparison)


@overload(operator.getitem)
def _component(vector, k):
    if vector == DUAL3 and isinstance(k, types.Integer):
        return lambda vector, k: dual(vector.value[k], vector.slope[k])
    return None


@overload(np.where)
def _where(condition, x, y):
    if isinstance(condition, types.Boolean) and DUAL in (x, y):
        return lambda condition, x, y: as_dual(x) if condition else as_dual(y)
    if isinstance(condition, Mask) and (of_lanes(x) or of_lanes(y)):
        if not of_lanes(y):
            return lambda condition, x, y: dual(np.where(condition, x.value, y), np.where(condition, x.slope, 0.0))
        if not of_lanes(x):
            return lambda condition, x, y: dual(np.where(condition, x, y.value), np.where(condition, 0.0, y.slope))
        return lambda condition, x, y: dual(
            np.where(condition, x.value, y.value), np.where(condition, x.slope, y.slope)
        )
    return None


@by_type
def dual_like(value, like):
    """A dual of lanes unchanged; lanes, or a number in as many lanes as ``like`` has, as a dual without slopes.
    ``like`` is lanes or a dual of lanes."""
    if of_lanes(value):
        return lambda value, like: value
    if isinstance(like, Lanes):
        return lambda value, like: dual(lanes_like(value, like), lanes_like(0.0, like))
    return lambda value, like: dual(lanes_like(value, like.value), lanes_like(0.0, like.value))


@by_type
def dual_vector(push):
    """A dual vector from what a law returns: a dual vector, a vector of numbers, or three duals or numbers."""
    if push == DUAL3:
        return lambda push: push
    if isinstance(push, Vector3):
        return lambda push: dual(push, thrice(splat(0.0)))
    return lambda push: _of_three(as_dual(push[0]), as_dual(push[1]), as_dual(push[2]))


@by_type(forceinline=True)
def _of_three(x, y, z):
    """Vector of three duals, numbers or lanes."""
    if isinstance(x, Dual):
        return lambda x, y, z: dual(_of_three(x.value, y.value, z.value), _of_three(x.slope, y.slope, z.slope))
    return lambda x, y, z: vector3(x, y, z)


@as_written
def dual_zeros(n):
    """Array (3, n) of duals without value and slopes."""
    return kept_duals(np.zeros(3 * n * SLOT), (3, n))


@as_written
def vector_at(x, i):
    """Return column i of an array (3, n) of duals as a vector."""
    return _of_three(x[0, i], x[1, i], x[2, i])


@as_written
def put_vector(x, i, vector):
    """Write a dual vector into column i of an array (3, n) of duals."""
    x[0, i], x[1, i], x[2, i] = vector.x, vector.y, vector.z

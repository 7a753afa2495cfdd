"""Elementary functions of duals, of ``math`` and NumPy's scalar functions: value and slope by the chain rule."""

import math
from collections.abc import Callable
from typing import Any

import numpy as np
from numba import types

from kickdrift.jit.compile import as_written
from kickdrift.jit.duals import operators as operators  # operators of the duals that these functions return
from kickdrift.jit.duals.dual import DUAL, TWICE, Dual, as_dual, dual, of_lanes
from kickdrift.jit.inner import by_type, overload
from kickdrift.jit.lanes.vectors import Lanes

_TWO_OVER_ROOT_PI = 2.0 / math.sqrt(math.pi)


@by_type
def sign_of(x):
    """1 or -1, with the sign of a number, of a dual or of lanes."""
    if isinstance(x, Lanes):
        return lambda x: np.where(x < 0.0, -1.0, 0.0 * x + 1.0)
    if isinstance(x, Dual):
        return lambda x: sign_of(x.value)
    return lambda x: math.copysign(1.0, x)


# The name in ``math``, the name in NumPy, and the slope from the argument x and the value y.
SLOPES: tuple[tuple[str, str, Callable[[float, float], float]], ...] = (
    ("sqrt", "sqrt", lambda x, y: 0.5 / y),
    ("exp", "exp", lambda x, y: y),
    ("expm1", "expm1", lambda x, y: y + 1.0),
    ("log", "log", lambda x, y: 1.0 / x),
    ("log1p", "log1p", lambda x, y: 1.0 / (1.0 + x)),
    ("log2", "log2", lambda x, y: 1.0 / (x * math.log(2.0))),
    ("log10", "log10", lambda x, y: 1.0 / (x * math.log(10.0))),
    ("sin", "sin", lambda x, y: math.cos(x)),
    ("cos", "cos", lambda x, y: -math.sin(x)),
    ("tan", "tan", lambda x, y: 1.0 + y * y),
    ("asin", "arcsin", lambda x, y: 1.0 / math.sqrt((1.0 - x) * (1.0 + x))),
    ("acos", "arccos", lambda x, y: -1.0 / math.sqrt((1.0 - x) * (1.0 + x))),
    ("atan", "arctan", lambda x, y: 1.0 / (1.0 + x * x)),
    ("sinh", "sinh", lambda x, y: math.cosh(x)),
    ("cosh", "cosh", lambda x, y: math.sinh(x)),
    ("tanh", "tanh", lambda x, y: 1.0 - y * y),
    ("asinh", "arcsinh", lambda x, y: 1.0 / math.sqrt(x * x + 1.0)),
    ("acosh", "arccosh", lambda x, y: 1.0 / math.sqrt((x - 1.0) * (x + 1.0))),
    ("atanh", "arctanh", lambda x, y: 1.0 / ((1.0 - x) * (1.0 + x))),
    ("erf", "", lambda x, y: _TWO_OVER_ROOT_PI * math.exp(-x * x)),
    ("erfc", "", lambda x, y: -_TWO_OVER_ROOT_PI * math.exp(-x * x)),
    ("fabs", "abs", lambda x, y: sign_of(x)),
)


def _teach(function: Callable[..., Any], others: tuple[Any, ...], rule: Callable[[float, float], float]) -> None:
    slope = as_written(rule)

    def known(x):
        value = function(x.value)
        return dual(value, slope(x.value, value) * x.slope)

    def code(x):
        return known if x in (DUAL, TWICE) or of_lanes(x) else None

    for each in (function, *others):
        overload(each)(code)


for _name, _of_numpy, _rule in SLOPES:
    _more = (getattr(np, _of_numpy),) if _of_numpy else ()
    _teach(getattr(math, _name), (*_more, abs) if _name == "fabs" else _more, _rule)


def _duals(*kinds: Any) -> bool:
    """Whether these are duals and numbers, with a dual among them."""
    return DUAL in kinds and all(kind == DUAL or isinstance(kind, types.Number) for kind in kinds)


@as_written
def _angle(y, x):
    square = x.value * x.value + y.value * y.value
    return dual(math.atan2(y.value, x.value), (x.value / square) * y.slope - (y.value / square) * x.slope)


@as_written
def _length(x, y):
    value = math.hypot(x.value, y.value)
    return dual(value, (x.value / value) * x.slope + (y.value / value) * y.slope)


@as_written
def _larger(a, b):
    return b if b.value > a.value else a


@as_written
def _smaller(a, b):
    return b if b.value < a.value else a


@as_written
def _larger_lanes(a, b):
    return np.where(b > a, b, a)


@as_written
def _smaller_lanes(a, b):
    return np.where(b < a, b, a)


def _teach_pair(functions: tuple[Callable[..., Any], ...], rule: Any, rule_of_lanes: Any = None) -> None:
    def known(a, b):
        return rule(as_dual(a), as_dual(b))

    def known_of_lanes(a, b):
        return rule_of_lanes(a, b)

    def code(a, b):
        if rule_of_lanes and (of_lanes(a) or of_lanes(b)):
            return known_of_lanes
        return known if _duals(a, b) else None

    for each in functions:
        overload(each)(code)


_teach_pair((math.atan2, np.arctan2), _angle)
_teach_pair((math.hypot, np.hypot), _length)
_teach_pair((max, np.maximum), _larger, _larger_lanes)
_teach_pair((min, np.minimum), _smaller, _smaller_lanes)


@overload(math.copysign)
def _with_sign(a, b):
    if _duals(a, b):
        return lambda a, b: abs(as_dual(a)) * math.copysign(1.0, as_dual(b).value)
    return None


def _teach_steps(function: Callable[..., Any]) -> None:
    def code(x):
        return (lambda x: function(x.value)) if x in (DUAL, TWICE) else None

    overload(function)(code)


for _step in (math.floor, math.ceil, math.isfinite, math.isnan, np.sign):
    _teach_steps(_step)

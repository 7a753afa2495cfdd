"""Python functions of laws and truncations as device functions, in float64 or float32.

A literal such as ``4.0`` is float64, and would carry all that follows into float64. So the float32 form of a function
has float32 literals. Parameters are constants of the compiled code, or of a
table for pairs of species.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from functools import lru_cache
from itertools import combinations_with_replacement
from types import CellType, FunctionType
from typing import Any

import numpy as np
from numba import config, cuda

from kickdrift.engines.cuda.words import numbers_in
from kickdrift.forces.pairs import lanes
from kickdrift.forces.pairs.binding import pair_numbers, truncation_of
from kickdrift.forces.pairs.lanes import AtCutoff

Code = Callable[..., Any]


def on_device(function: Code, rounding: Any = False) -> Code:
    """A device function of a Python function, with what its arithmetic may do; in numba's simulator the function."""
    return function if config.ENABLE_CUDASIM else cuda.jit(device=True, fastmath=rounding)(function)


def positive(u: Any) -> Any:
    """Return u, or zero where u is negative."""
    return max(u, u - u)


HELPERS: dict[Any, Code] = {lanes.positive: positive}  # device forms of what truncations and baths call


def in_precision(function: Code, single: bool) -> Code:
    """A device function of a Python function and of all Python functions that it calls; with ``single``, floats in
    their code and among their globals are float32."""
    function = getattr(function, "py_func", function)
    number = np.float32 if single else np.float64

    def turned(value: Any) -> Any:
        if type(value) is float:
            return number(value)
        inner = getattr(value, "py_func", value)
        if isinstance(inner, FunctionType) and inner is not function:
            return in_precision(HELPERS.get(value, inner), single)
        return value

    code = function.__code__
    constants = tuple(number(value) if type(value) is float else value for value in code.co_consts)
    values = {name: turned(value) for name, value in function.__globals__.items() if name in code.co_names}
    cells = tuple(
        CellType(turned(cell.cell_contents))
        for name, cell in zip(code.co_freevars, function.__closure__ or (), strict=True)
    )
    defaults = tuple(number(value) if type(value) is float else value for value in function.__defaults__ or ())
    made = FunctionType(code.replace(co_consts=constants), values, function.__name__, defaults, cells)
    return on_device(made)


def numbers_of(values: Any, single: bool) -> Any:
    """A NamedTuple of floats in float64 or float32."""
    return type(values)(*(np.float32(value) if single else np.float64(value) for value in values))


def truncated_law(force: Any, names: Sequence[str], single: bool) -> tuple[Code, Any]:
    """Device function of r2, a table and a row of it that returns energy and force over r of a pair law below its
    cutoff; and the table, with a row for each pair of species. For one species the numbers are constants of the code.
    """
    numbers = pair_numbers(force, names)
    table = numbers.reshape(len(numbers), -1).T.astype(np.float32 if single else np.float64)
    given, by = force.pair_law(names[0], names[0]), truncation_of(force)
    classes: tuple[Any, Any] = type(given), type(by)
    if len(names) > 1:
        return _terms_of_pairs(classes, by, single), table.ravel()
    return _terms(classes, given, AtCutoff(*numbers[-2:, 0, 0].tolist()), by, single), table.ravel()


@lru_cache(maxsize=16)
def _terms(classes: tuple[Any, Any], *values: Any) -> Code:
    """The device function for a class of laws, a class of truncations, and the numbers of both."""
    *given, single = values
    parameters, at_end, by = (numbers_of(each, single) for each in given)
    law, apply = in_precision(classes[0].law, single), in_precision(classes[1].apply, single)

    def terms(r2, table, row):
        energy, force_over_r = law(parameters, r2)
        return apply(by, at_end, r2, energy, force_over_r)

    return on_device(terms)


@lru_cache(maxsize=16)
def _terms_of_pairs(classes: tuple[Any, Any], by: Any, single: bool) -> Code:
    """The device function for classes of laws and truncations, with the law's numbers in a table."""
    law, apply = in_precision(classes[0].law, single), in_precision(classes[1].apply, single)
    numbers = numbers_of(by, single)
    columns = len(classes[0]._fields) + len(AtCutoff._fields)
    parameters, at_end = numbers_in(classes[0], 0, columns), numbers_in(AtCutoff, columns - 2, columns)

    def terms(r2, table, row):
        energy, force_over_r = law(parameters(table, row), r2)
        return apply(numbers, at_end(table, row), r2, energy, force_over_r)

    return on_device(terms)


HEADROOM = 6  # bits between the largest pair force that a liquid reaches and the largest sum
NEAR = 0.7  # of sigma: particles of a liquid are hardly nearer


def grains(force: Any, names: Sequence[str]) -> tuple[float, float]:
    """Numbers of steps in one unit of force and of energy, powers of two, for sums in whole numbers of 64 bits."""
    cutoff, largest = float(force.cutoff), [0.0, 0.0]
    for a, b in combinations_with_replacement(names, 2):
        law = force.pair_law(a, b)
        lengths = [getattr(law, key) for key in law._fields if force.dimensions.get(key) == "length"]
        near = min(NEAR * min(lengths, default=0.0) or 0.3 * cutoff, 0.9 * cutoff)
        for r in np.linspace(near, cutoff, 50).tolist():
            try:
                energy, force_over_r = law.law(r * r)
            except (ArithmeticError, ValueError):  # a law need not hold at every distance
                continue
            for k, value in enumerate((abs(force_over_r) * r, max(abs(energy), abs(force_over_r) * r * r))):
                if math.isfinite(value):
                    largest[k] = max(largest[k], float(value))
    return tuple(2.0 ** (62 - HEADROOM - math.ceil(math.log2(value or 1.0))) for value in largest)  # type: ignore[return-value]

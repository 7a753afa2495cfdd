"""Check a Problem's compiled f against the values of plain Python.

numba counts whole numbers in 64 bits, keeps a list of whole numbers without fractions, and fixes the values of outer
names when it compiles. A run with such an f would be silently wrong.
"""

from __future__ import annotations

import ctypes
import warnings
from collections.abc import Iterator
from typing import TYPE_CHECKING, Any

import numpy as np

from kickdrift.forces.equations.code import CompileError
from kickdrift.model.state import Floats

if TYPE_CHECKING:
    from kickdrift.model.problem import Problem

_POINTER = ctypes.POINTER(ctypes.c_double)
_FUNCTION = ctypes.CFUNCTYPE(ctypes.c_int64, ctypes.c_double, _POINTER, _POINTER)
EPSILON = float(np.finfo(float).eps)
APART = 1e-11  # allowed relative difference of a component, from rounding and mathematical libraries
OF_LARGEST = 16 * EPSILON  # allowed difference, relative to the largest component
NOISE = 1e3  # factor on the change that rounding errors of t and y make
WHY = (
    "compiled code has 64-bit whole numbers, keeps lists of whole numbers whole (write 0.0 for 0), and keeps "
    "the values that names outside f had when it was compiled"
)
SHIFTS = (0.37, 1e-3, 1e-7)  # relative distances of test states; smaller ones if f is undefined


def check_compiled(problem: Problem, address: int) -> None:
    """Compare f at the start and at two states around the start; a CompileError shows both values if they differ."""
    function = getattr(problem.f, "py_func", problem.f)
    compiled = _FUNCTION(address)
    for time, y in _states(problem, function):
        plain = _plain(function, time, y)
        if plain is None:
            continue
        found = np.zeros_like(y)
        given = y.copy()
        compiled(time, given.ctypes.data_as(_POINTER), found.ctypes.data_as(_POINTER))
        wrong = np.flatnonzero(~(np.abs(found - plain) <= _allowed(function, time, y, plain)))
        if wrong.size:
            k = int(wrong[0])
            raise CompileError(
                f"{problem.name}: f(t, y)[{k}] at t = {time:.9g} is {plain[k]:.9g} in plain Python and {found[k]:.9g} "
                f"compiled: {WHY}; compiled=False runs f as plain Python, slowly"
            )


def _states(problem: Problem, function: Any) -> Iterator[tuple[float, Floats]]:
    """Yield the start and a state without round numbers on either side of the start, as far out as f is defined."""
    yield problem.t0, problem.y0.copy()
    rng = np.random.Generator(np.random.PCG64(7))
    sizes = np.abs(problem.y0)
    least = float(sizes[sizes > 0].min(initial=1.0))
    for sign in (1.0, -1.0):
        ways = rng.uniform(0.3, 1.0, len(problem)) * np.where(rng.random(len(problem)) < 0.5, -1.0, 1.0)
        for shift in SHIFTS:
            # a zero component increases, since it may be a concentration
            y = problem.y0 + shift * np.where(sizes > 0, sign * ways * problem.y0, np.abs(ways) * least)
            time = problem.t0 + shift * (1.0 if sign > 0 else 2.0)
            if _plain(function, time, y) is not None:
                yield time, y
                break


def _plain(function: Any, time: float, y: Floats) -> Floats | None:
    """Return f in plain Python; None if f raises or is not finite."""
    with warnings.catch_warnings(), np.errstate(all="ignore"):
        warnings.simplefilter("ignore")
        try:
            value = np.asarray(function(float(time), y.copy()), dtype=float).reshape(-1)
        except Exception:  # any exception of a user's function; the run reports it
            return None
    return value if value.shape == y.shape and np.isfinite(value).all() else None


def _allowed(function: Any, time: float, y: Floats, value: Floats) -> Floats:
    """Return the allowed difference of compiled values.

    Where terms cancel, rounding alone makes relative differences of any size."""
    rng = np.random.Generator(np.random.PCG64(8))
    noise = np.zeros_like(y)
    for _ in range(2):
        nearby = _plain(function, time * (1.0 + 4 * EPSILON), y * (1.0 + rng.uniform(-4, 4, len(y)) * EPSILON))
        if nearby is not None:
            noise = np.maximum(noise, np.abs(nearby - value))
    return APART * np.abs(value) + OF_LARGEST * np.abs(value).max() + NOISE * noise

"""The variational equation of a Problem: y' = f(t, y) and d' = J(t, y) d, as one Problem.

J d comes from the Problem's Jacobian, or from central differences of f along d. A separable Problem stays separable:
its unknowns are then the positions of y, the positions of d, the velocities of y and the velocities of d.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
from numba import njit
from numpy.typing import NDArray

from kickdrift.forces.equation import write
from kickdrift.jit.numba_private import NumbaError
from kickdrift.model.problem import Problem
from kickdrift.model.state import Floats

Slope = Callable[[float, Floats], Floats]
Product = Callable[[float, Floats, Floats], Floats]
APART = float(np.cbrt(np.finfo(float).eps))  # of central differences (Press et al. 2007, Numerical Recipes, 5.7)
LEAST = 1e-3  # of the size of y that sets their distance
SAME = 1e-9  # relative difference between a compiled Jacobian and plain Python's


def varied_problem(problem: Problem, deviation: Floats) -> tuple[Problem, NDArray[np.int64]]:
    """The Problem with a deviation.

    Parameters
    ----------
    deviation : (n,) at the start

    Returns
    -------
    A Problem of 2 n unknowns, and where the deviation's numbers stand among them, (n,).

    Raises
    ------
    InputError
        If f does not compile.
    """
    n, half = len(problem), len(problem) // 2
    own = np.arange(n) + (half * (np.arange(n) >= half) if problem.separable else 0)
    place = np.setdiff1d(np.arange(2 * n), own)
    slope = _slope(problem.f, n, problem.compiled)
    product = _product(problem, slope)
    first = half if problem.separable else 0  # of the rows that are not known

    def f(t, both):
        y, d = both[own], both[place]
        dy, dd = slope(t, y), product(t, y, d)
        out = np.empty(2 * n)
        for i in range(n):
            out[own[i]] = dy[i]
            out[place[i]] = dd[i] if i >= first else d[half + i]
        return out

    energy = problem.energy
    start = np.empty(2 * n)
    start[own], start[place] = problem.y0, deviation
    made = replace(
        problem,
        f=f,
        y0=start,
        jacobian=None,
        energy=None if energy is None else lambda t, both: energy(t, both[own]),
        exact=None,
        equation="",
        parameters={},
    )
    return made, place


def _slope(function: Any, n: int, compiled: bool) -> Slope:
    """A Problem's f as a function that returns an array."""
    if not compiled:
        return lambda t, y: np.asarray(function(t, y), dtype=float).reshape(n)
    inner = _compiled(function)

    @njit(error_model="numpy")
    def slope(t, y):
        out = np.zeros(n)
        write(out, inner(t, y))
        return out

    return slope


def _product(problem: Problem, slope: Slope) -> Product:
    """The product of the Jacobian and a vector."""
    n, jacobian = len(problem), problem.jacobian
    columns = n // 2 if problem.separable else n  # accelerations do not depend on velocities
    if jacobian is not None and not problem.compiled:
        return lambda t, y, d: np.asarray(jacobian(t, y), dtype=float)[:, :columns] @ d[:columns]
    if jacobian is not None:
        inner = _compiled(jacobian)

        @njit(error_model="numpy")
        def by_jacobian(t, y, d):
            matrix, out = np.zeros(n * n), np.zeros(n)
            write(matrix, inner(t, y))
            for i in range(n):
                for j in range(columns):
                    out[i] += matrix[i * n + j] * d[j]
            return out

        if _is_product(by_jacobian, problem, columns):
            return by_jacobian

    def by_differences(t, y, d):
        size = np.sqrt(np.sum(d[:columns] ** 2))
        if size == 0.0:
            return np.zeros(n)
        h = APART * max(np.sqrt(np.sum(y[:columns] ** 2)), LEAST) / size
        ahead, behind = y.copy(), y.copy()
        for j in range(columns):
            ahead[j] += h * d[j]
            behind[j] -= h * d[j]
        return (slope(t, ahead) - slope(t, behind)) / (2.0 * h)

    return njit(error_model="numpy")(by_differences) if problem.compiled else by_differences


def _compiled(function: Any) -> Any:
    return function if hasattr(function, "py_func") else njit(function, error_model="numpy")


def _is_product(product: Product, problem: Problem, columns: int) -> bool:
    """Whether a compiled Jacobian gives what plain Python gives at the start."""
    jacobian: Any = getattr(problem.jacobian, "py_func", problem.jacobian)
    d = np.cos(np.arange(len(problem)))
    try:
        found = product(problem.t0, problem.y0.copy(), d)
    except NumbaError:
        return False
    wanted = np.asarray(jacobian(problem.t0, problem.y0.copy()), dtype=float)[:, :columns] @ d[:columns]
    return bool(np.abs(found - wanted).max() <= SAME * np.abs(wanted).max())

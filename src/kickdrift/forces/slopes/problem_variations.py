"""The variational equation of a Problem: y' = f(t, y) and d' = J(t, y) d for each deviation d, as one Problem.

J d comes from the Problem's Jacobian, or from central differences of f along d. A separable Problem stays separable:
its unknowns are then the positions of y, the positions of each d, the velocities of y and the velocities of each d.
"""

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
from numba import njit
from numpy.typing import NDArray

from kickdrift.errors import InputError
from kickdrift.forces.equations.equation import Callback, call_at, right_hand_side
from kickdrift.model.problem import Problem
from kickdrift.model.state import Floats

Slope = Callable[[float, Floats], Floats]
Product = Callable[[float, Floats, Floats], Floats]
APART = float(np.cbrt(np.finfo(float).eps))  # of central differences (Press et al. 2007, Numerical Recipes, 5.7)
LEAST = 1e-3  # of the size of y that sets their distance
SAME = 1e-9  # relative difference between a compiled Jacobian and plain Python's


def varied_problem(problem: Problem, deviation: Floats) -> tuple[Problem, NDArray[np.int64]]:
    """The Problem with a deviation, or several.

    Parameters
    ----------
    deviation : (n,) at the start, or (k, n) for k deviations

    Returns
    -------
    A Problem of (1 + k) n unknowns, and where the deviation's numbers stand among them, of the shape of ``deviation``.

    Raises
    ------
    InputError
        If f does not compile.
    """
    n, half, count = len(problem), len(problem) // 2, 1 if deviation.ndim == 1 else len(deviation)
    if problem.separable:
        places = np.arange((1 + count) * n).reshape(2, 1 + count, half).swapaxes(0, 1).reshape(1 + count, n)
    else:
        places = np.arange((1 + count) * n).reshape(1 + count, n)
    own, place = places[0].copy(), places[1:].copy()
    used: list[Callback] = []  # machine code that f calls by its address
    slope = _slope(problem, used)
    product = _product(problem, slope, used)
    first = half if problem.separable else 0  # of the rows that are not known

    def f(t, both):
        y, out = both[own], np.empty((1 + count) * n)
        dy = slope(t, y)
        for i in range(n):
            out[own[i]] = dy[i]
        for k in range(count):
            d = both[place[k]]
            dd = product(t, y, d)
            for i in range(n):
                out[place[k, i]] = dd[i] if i >= first else d[half + i]
        return out

    f.used = used  # type: ignore[attr-defined]
    energy = problem.energy
    start = np.empty((1 + count) * n)
    start[own], start[place] = problem.y0, deviation.reshape(count, n)
    made = replace(
        problem,
        f=f,
        y0=start,
        args=(),
        jacobian=None,
        energy=None if energy is None else lambda t, both: energy(t, both[own]),
        exact=None,
        equation="",
        parameters={},
    )
    return made, place.reshape(deviation.shape)


def _slope(problem: Problem, used: list[Callback]) -> Slope:
    """A Problem's f as a function that returns an array."""
    n, function = len(problem), problem.f
    if not problem.compiled:
        return lambda t, y: np.asarray(function(t, y), dtype=float).reshape(n)
    used.append(right_hand_side(problem).callback)
    address = used[-1].address

    @njit(error_model="numpy")
    def slope(t, y):
        out = np.zeros(n)
        if call_at(address, t, y, out) != 0:
            raise ValueError("the Problem's f raised an exception")
        return out

    return slope


def _product(problem: Problem, slope: Slope, used: list[Callback]) -> Product:
    """The product of the Jacobian and a vector."""
    n, jacobian = len(problem), problem.jacobian
    columns = n // 2 if problem.separable else n  # accelerations do not depend on velocities
    if jacobian is not None and not problem.compiled:
        return lambda t, y, d: np.asarray(jacobian(t, y), dtype=float)[:, :columns] @ d[:columns]
    if jacobian is not None and (code := _jacobian_code(problem)):
        used.append(code)
        address = code.address

        @njit(error_model="numpy")
        def by_jacobian(t, y, d):
            matrix, out = np.zeros(n * n), np.zeros(n)
            if call_at(address, t, y, matrix) != 0:
                raise ValueError("the Problem's jacobian raised an exception")
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


def _jacobian_code(problem: Problem) -> Callback | None:
    """Machine code of the Jacobian; None where it does not compile."""
    n, jacobian = len(problem), problem.jacobian
    assert jacobian is not None
    try:
        return Callback(jacobian, n, n * n, True, f"{problem.name}: jacobian")
    except InputError:
        return None


def _is_product(product: Product, problem: Problem, columns: int) -> bool:
    """Whether a compiled Jacobian gives what plain Python gives at the start."""
    jacobian: Any = getattr(problem.jacobian, "py_func", problem.jacobian)
    d = np.cos(np.arange(len(problem)))
    found = product(problem.t0, problem.y0.copy(), d)
    wanted = np.asarray(jacobian(problem.t0, problem.y0.copy()), dtype=float)[:, :columns] @ d[:columns]
    return bool(np.abs(found - wanted).max() <= SAME * np.abs(wanted).max())

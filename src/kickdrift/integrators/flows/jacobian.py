"""Jacobian of a right-hand side by differences."""

from collections.abc import Callable
from typing import Any

import numpy as np

from kickdrift.errors import InputError
from kickdrift.model.state import Floats

Derivative = Callable[[float, Floats], Floats]
NEWTON_UNKNOWNS = 3000  # most unknowns of a dense Jacobian


def difference_jacobian(derivative: Derivative, time: float, y: Floats) -> Any:
    """Central differences (N, N) of f with respect to the flattened y. The relative error is about 1e-10, with steps of
    the cube root of the rounding unit (Press et al. 2007, Numerical Recipes, 5.7)."""
    flat = y.reshape(-1)
    if flat.size > NEWTON_UNKNOWNS:
        raise InputError(f"the Jacobian of {flat.size} unknowns is too large; the limit is {NEWTON_UNKNOWNS}")
    scale = np.maximum(np.abs(flat), 1e-3 * max(float(np.abs(flat).max()), 1e-3))
    steps = np.cbrt(np.finfo(float).eps) * scale
    columns = []
    for k, h in enumerate(steps):
        ahead, behind = flat.copy(), flat.copy()
        ahead[k] += h
        behind[k] -= h
        difference = derivative(time, ahead.reshape(y.shape)) - derivative(time, behind.reshape(y.shape))
        columns.append(difference.reshape(-1) / (ahead[k] - behind[k]))
    return np.array(columns).T

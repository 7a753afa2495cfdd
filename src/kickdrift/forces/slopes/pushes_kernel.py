"""The compiled slope of a force by a number."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from kickdrift.forces.seam.kernel import OK, kernel, run_body
from kickdrift.jit.compile import jit, never_inline


class PushKernel(NamedTuple):
    """A force at four values of a number."""

    ahead: Any
    behind: Any
    far_ahead: Any
    far_behind: Any
    column: int
    size: float
    phase: NDArray[np.float64]  # (2, 3, n)
    a: NDArray[np.float64]  # (3, n)


def bind(bound: list[Any], n: int, column: int, size: float) -> PushKernel:
    """Bind the four copies of a force."""
    ahead, behind, far_ahead, far_behind = bound
    return PushKernel(ahead, behind, far_ahead, far_behind, column, size, np.zeros((2, 3, n)), np.zeros((3, n)))


@kernel(PushKernel)
def push_column(force, t, x, v, a, sums):
    phase = force.phase
    n = phase.shape[2]
    for k in range(3):
        for i in range(n):
            phase[0, k, i], phase[1, k, i] = x[k, i], v[k, i]
    status = add_weighted(force.ahead, force, t, a, 8.0 / 12.0)
    if status == OK:
        status = add_weighted(force.behind, force, t, a, -8.0 / 12.0)
    if status == OK:
        status = add_weighted(force.far_ahead, force, t, a, -1.0 / 12.0)
    if status == OK:
        status = add_weighted(force.far_behind, force, t, a, 1.0 / 12.0)
    return status


@jit
def add_weighted(copy, force, t, a, weight):
    """Add a multiple of a copy's accelerations to those of the column. Return a status."""
    never_inline()
    phase, own = force.phase, force.a
    n = own.shape[1]
    directions = a.shape[1] // n - 1
    own[:, :] = 0.0
    status = run_body(copy, t, phase[0], phase[1], own, None)
    for k in range(3):
        for i in range(n):
            a[k, n + i * directions + force.column] += weight * force.size * own[k, i]
    return status

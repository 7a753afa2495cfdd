"""Other forces than gravity in tangent maps: accelerations on duals, and what masses and parameters do in them."""

from collections.abc import Callable
from typing import Any

import numpy as np

from kickdrift.forces.seam.kernel import FORCES, OK, call_force
from kickdrift.forces.slopes.dual_slopes import NO_DUALS, call_slopes
from kickdrift.jit.compile import jit, never_inline
from kickdrift.jit.duals.dual import SLOT, dual_rows
from kickdrift.jit.duals.operators import vector_at
from kickdrift.jit.inner import overload
from kickdrift.jit.lanes.vectors import WIDTH

NO_SLOPES = 101  # status: a force without a formula on duals


def to_first_order(function: Callable[..., Any]) -> Callable[..., Any]:
    """Limit a function that evaluates forces other than gravity and returns a status. These forces have no second
    derivatives. If the first argument, ``rows``, has the shape (rows, numbers, 2), the status is NO_DUALS, and the
    function is not compiled."""

    def stub(*given: Any) -> Any: ...

    def code(*given):
        return (lambda *given: function(*given)) if given[0].ndim == 2 else (lambda *given: NO_DUALS)

    overload(stub)(code)
    return stub


@jit
def feel(a, x, v, n, t, others, pushes, block):
    """a <- the accelerations by other forces at x and v, three rows of a block. Return a status."""
    never_inline()
    a[:] = 0.0
    for k in range(others.shape[0]):
        status = call_slopes(others[k, 0], others[k, 1], n, t, x, v, a)
        if status != OK:
            return NO_SLOPES if status == NO_DUALS else status
    return add_pushes(a, dual_rows(x, n), dual_rows(v, n), n, t, pushes, block) if pushes.shape[0] > 0 else OK


@jit
def add_pushes(numbers, own_x, own_v, n, t, pushes, block):
    """Add to the slopes of a block what masses and parameters do in other forces. Return a status.

    ``pushes`` (k, 3) are the column, and the addresses of a `pushes_kernel.PushKernel` and its parts. ``numbers`` hold
    the duals of the accelerations at ``own_x`` and ``own_v``."""
    never_inline()
    phase, a = np.zeros((2, 3, 2 * n)), np.empty((3, 2 * n))
    for i in range(n):
        place, speed = vector_at(own_x, i).value, vector_at(own_v, i).value
        phase[0, 0, i], phase[0, 1, i], phase[0, 2, i] = place.x, place.y, place.z
        phase[1, 0, i], phase[1, 1, i], phase[1, 2, i] = speed.x, speed.y, speed.z
    for row in range(pushes.shape[0]):
        if pushes[row, 0] // WIDTH != block:
            continue
        a[:, :] = 0.0
        status = call_force(pushes[row, 1], pushes[row, 2], FORCES, t, phase[0], phase[1], a, None)
        if status != OK:
            return status
        for k in range(3):
            for i in range(n):
                numbers[(k * n + i) * SLOT + 1 + pushes[row, 0] % WIDTH] += a[k, n + i]
    return OK

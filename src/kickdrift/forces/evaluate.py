"""One evaluation of all forces, as the step loops and the observers call it."""

from __future__ import annotations

import numpy as np

from kickdrift.forces.compiling import driver, jit
from kickdrift.forces.handle import handle
from kickdrift.forces.kernel import BLOWN_UP, OK, accelerate
from kickdrift.forces.simd import WIDTH, lane_sum, load, splat

EVALUATIONS = 0  # slot of a loop's cursor: how often the forces were evaluated
SLOTS = 5  # of a cursor; the others are the loops' own


@jit
def fill_accelerations(bound, t, x, v, a, sums, cursor):
    """a <- the accelerations at x; a status."""
    for axis in range(a.shape[0]):
        for i in range(a.shape[1]):
            a[axis, i] = 0.0
    status = accelerate(bound, t, x, v, a, sums)
    cursor[EVALUATIONS] += 1
    if status != OK:
        return status
    total = 0.0
    for row in a:
        total += row_sum(row)
    return OK if np.isfinite(total) else BLOWN_UP


@jit
def fill_derivative(bound, t, y, dy, cursor):
    """dy <- f(t, y); a status. y and dy are (2, rows, n), positions and velocities, or (1, 1, n), a first-order ODE."""
    last = y.shape[0] - 1  # one call for both shapes: the forces are compiled into it
    status = fill_accelerations(bound, t, y[0], y[last], dy[last], None, cursor)
    if last:
        for k in range(y.shape[1]):
            for i in range(y.shape[2]):
                dy[0, k, i] = y[1, k, i]
    return status


@jit
def row_sum(row):
    """The sum of a contiguous row, eight at a time."""
    lanes, whole = splat(0.0), row.size - row.size % WIDTH
    for i in range(0, whole, WIDTH):
        lanes = lanes + load(row, i)
    total = lane_sum(lanes)
    for i in range(whole, row.size):
        total += row[i]
    return total


@driver
def measure(forces, t, phase, a, sums, cursor):
    """a <- accelerations (3, n); sums <- potential energy, virial, interacting pairs; a status."""
    for k in range(sums.size):
        sums[k] = 0.0
    return fill_accelerations(handle(forces), t, phase[0], phase[1], a, sums, cursor)


@driver
def derivative(forces, t, y, dy, cursor):
    """dy <- f(t, y), as Python calls it; a status."""
    return fill_derivative(handle(forces), t, y, dy, cursor)

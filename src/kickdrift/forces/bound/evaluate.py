"""One evaluation of all forces, for step loops and observers."""

from __future__ import annotations

from kickdrift.forces.bound.table import accelerate, accelerate_by
from kickdrift.forces.equations.equation import call_at
from kickdrift.forces.seam.kernel import BLOWN_UP, OK, RAISED
from kickdrift.jit.compile import driver, inlined, is_finite, jit
from kickdrift.jit.handle import handle
from kickdrift.jit.lanes.functions import lane_sum, splat
from kickdrift.jit.lanes.memory import flat, load, masked_load, set_zero
from kickdrift.jit.lanes.vectors import WIDTH

EVALUATIONS = 0  # slot of a loop's cursor: the number of force evaluations
SLOTS = 5  # length of a cursor; the loops use the other slots


@inlined
def fill_accelerations(bound, t, x, v, a, sums, cursor):
    """a <- the accelerations at x; return a status."""
    return fill_by(bound, None, 0, t, x, v, a, sums, cursor)


@inlined
def fill_by(bound, groups, group, t, x, v, a, sums, cursor):
    """a <- the accelerations at x by one group of forces; return a status."""
    set_zero(a)
    status = accelerate_by(bound, groups, group, t, x, v, a, sums)
    cursor[EVALUATIONS] += 1
    if status != OK:
        return status
    return OK if is_finite(sum_of(a)) else BLOWN_UP


@jit
def fill_derivative(bound, t, y, dy, cursor):
    """dy <- f(t, y); return a status. Shapes are (2, rows, n) for positions and velocities, (1, 1, n) for an ODE."""
    if bound.equation != 0:
        return call_equation(bound, t, y, dy, cursor)
    last = y.shape[0] - 1
    status = fill_accelerations(bound, t, y[0], y[last], dy[last], None, cursor)
    if last:
        for k in range(y.shape[1]):
            for i in range(y.shape[2]):
                dy[0, k, i] = y[1, k, i]
    return status


@inlined
def fill_last(bound, t, y, dy, cursor):
    """dy[-1] <- the last part of f(t, y), the accelerations; return a status.

    The caller already has the velocities, and checks whether the accelerations are finite."""
    if bound.equation != 0:
        return call_equation(bound, t, y, dy, cursor)
    last = y.shape[0] - 1
    set_zero(dy[last])
    cursor[EVALUATIONS] += 1
    return accelerate(bound, t, y[0], y[last], dy[last], None)


@jit
def call_equation(bound, t, y, dy, cursor):
    """dy <- a Problem's function of y, both in their memory layout; return a status."""
    cursor[EVALUATIONS] += 1
    if call_at(bound.equation, t, y, dy) != 0:
        return RAISED
    total = 0.0
    for half in range(dy.shape[0]):
        for i in range(dy.shape[2]):
            total += dy[half, 0, i]
    return OK if is_finite(total) else BLOWN_UP


@inlined
def sum_of(a):
    """Return the sum of all numbers in a contiguous array, eight at a time."""
    row = flat(a)
    lanes, whole = splat(0.0), row.size - row.size % WIDTH
    for i in range(0, whole, WIDTH):
        lanes = lanes + load(row, i)
    return lane_sum(lanes + masked_load(row, whole, row.size - whole))


@driver
def measure(forces, t, phase, a, sums, cursor):
    """a <- accelerations (3, n); sums <- potential energy, virial, interacting pairs; return a status."""
    for k in range(sums.size):
        sums[k] = 0.0
    return fill_accelerations(handle(forces), t, phase[0], phase[1], a, sums, cursor)


@driver
def derivative(forces, t, y, dy, cursor):
    """dy <- f(t, y), for calls from Python; return a status."""
    return fill_derivative(handle(forces), t, y, dy, cursor)

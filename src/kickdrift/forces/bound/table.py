"""What joins methods and forces: a table of bound forces, which every step loop takes, and their evaluation."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from kickdrift.forces.equations.equation import EquationKernel, call_at
from kickdrift.forces.gravity.kernel import MOST_IN_REGISTERS, FewBodies, GravityKernel, few_bodies
from kickdrift.forces.seam.kernel import BLOWN_UP, FORCES, FORCES_AND_SUMS, OK, RAISED, BoundForce, call_force
from kickdrift.jit.compile import driver, inlined, is_finite, jit
from kickdrift.jit.handle import handle
from kickdrift.jit.lanes.functions import lane_sum, splat
from kickdrift.jit.lanes.memory import flat, load, masked_load, set_zero
from kickdrift.jit.lanes.vectors import WIDTH

NOBODY = FewBodies(0.0, 0, np.zeros(MOST_IN_REGISTERS), np.zeros(MOST_IN_REGISTERS))


class Forces(NamedTuple):
    """All forces of a System, or a Problem's function, for compiled code; always of the same type."""

    table: NDArray[np.int64]  # (forces, 2) addresses of machine code and of parts; zeros mean gravity among few bodies
    equation: int  # address of a Problem's function; 0 for particles
    few: FewBodies


def table_of(forces: Sequence[BoundForce]) -> Forces:
    """Return the table of these compiled forces. The table is valid as long as the forces exist."""
    rows = np.array([(force.address, force.work) for force in forces], np.int64).reshape(-1, 2)
    few = few_of(forces)
    equations = [force.parts.address for force in forces if isinstance(force.parts, EquationKernel)]
    return Forces(rows, equations[0] if equations else 0, few.parts.few_bodies if few else NOBODY)


def few_of(forces: Sequence[BoundForce]) -> BoundForce | None:
    """Return gravity among a few bodies, if any: loops hold such bodies in registers, without machine code of the
    force."""
    return next((each for each in forces if isinstance(each.parts, GravityKernel) and each.parts.is_few), None)


@inlined
def accelerate_by(forces, groups, group, t, x, v, a, sums):
    """Add the accelerations of all forces to ``a``, or of one group, where ``groups`` holds the group of each force;
    return OK or the status of the first force that fails.

    Unless ``sums`` is None, also add energy, virial and pairs to ``sums``."""
    table, what = forces.table, FORCES if sums is None else FORCES_AND_SUMS
    for k in range(table.shape[0]):
        if groups is not None and groups[k] != group:
            continue
        if table[k, 0] == 0:
            few_bodies(forces.few, flat(x), flat(a), sums)
        else:
            status = call_force(table[k, 0], table[k, 1], what, t, x, v, a, sums)
            if status != OK:
                return status
    return OK


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
    return accelerate_by(bound, None, 0, t, y[0], y[last], dy[last], None)


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

"""Tangent map of Wisdom-Holman methods: the derivatives of their steps, by duals.

The Kepler drift is differentiated through its equation (Mikkola & Innanen 1999, doi:10.1023/A:1008312912468): the root
X of F(X, p) = 0 has the slope dX/dp = -(dF/dp) / (dF/dX). One step of Newton's method on duals gives this slope, and
the rest of the drift is a formula. A body's drift has seven slopes, which serve all columns. Coordinates are Jacobi's.
Masses may vary as well. `wisdom_holman_tangent_kicks` has the kicks.
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from kickdrift.forces.kernel import OK
from kickdrift.integrators.kepler import lagrange, one_g, one_solution
from kickdrift.integrators.wisdom_holman_tangent_kicks import (
    INERTIAL,
    MASSES,
    ROWS,
    V,
    X,
    from_jacobi,
    kick_blocks,
    to_jacobi,
)
from kickdrift.jit import dual_functions as dual_functions  # what duals take part in
from kickdrift.jit.compile import driver, jit
from kickdrift.jit.dual import SLOT, as_dual, dual, dual_rows
from kickdrift.jit.dual_operators import put_vector, vector_at
from kickdrift.jit.lanes import lane_numbers, splat
from kickdrift.jit.masks import select
from kickdrift.jit.memory import flat, masked_load, masked_store, store
from kickdrift.jit.vector3 import vector3
from kickdrift.jit.vectors import WIDTH
from kickdrift.model.state import Floats


class Tangents(NamedTuple):
    """A state with derivatives, on its way through the map; bodies in the order of Jacobi's coordinates.

    Each block has eight columns. Its rows hold duals: positions, velocities, work, and in row MASSES the G m of the
    bodies and, behind them, the G M of the Kepler motions.
    """

    rows: NDArray[np.float64]  # (blocks, ROWS, 3 n SLOT)
    columns: int


def tangents(phase: Floats, slopes: Floats, gm: Floats, gm_slopes: Floats) -> Tangents:
    """Bring phase (2, 3, n), its derivatives (2, 3, n, columns), and G m (n,) with derivatives (n, columns) to Jacobi's
    coordinates. The central body comes first."""
    n, columns = len(gm), slopes.shape[-1]
    made = Tangents(np.zeros((-(-columns // WIDTH), ROWS, 3 * n * SLOT)), columns)
    enter(made.rows, columns, *(np.ascontiguousarray(each) for each in (phase, slopes, gm, gm_slopes)))
    return made


def slopes_in(rows: NDArray[np.float64]) -> NDArray[np.float64]:
    """The derivatives of positions and velocities in the rows of ``Tangents``, to read and to write."""
    duals = rows.reshape(*rows.shape[:2], -1, SLOT)
    return duals[:, :2, :, 1:]


@jit
def fill_masses(masses, gm, gm_slopes, columns, first):
    """masses[0] <- G times the masses, with their slopes by the columns from ``first`` on."""
    for i in range(gm.size):
        slopes = masked_load(flat(gm_slopes), i * columns + first, min(WIDTH, columns - first))
        masses[0, i] = dual(gm[i], slopes)


@jit
def fill_phase(x, half, phase, slopes, columns, first):
    """x (3, n) <- positions (``half`` 0) or velocities (1), with their slopes by the columns from ``first`` on."""
    n = phase.shape[2]
    for k in range(3):
        for i in range(n):
            place = ((half * 3 + k) * n + i) * columns + first
            x[k, i] = dual(phase[half, k, i], masked_load(flat(slopes), place, min(WIDTH, columns - first)))


@driver
def enter(blocks, columns, phase, slopes, gm, gm_slopes):
    """Fill the blocks."""
    n = gm.size
    for block in range(blocks.shape[0]):
        first = block * WIDTH
        masses = dual_rows(blocks[block, MASSES], n)
        fill_masses(masses, gm, gm_slopes, columns, first)
        total = as_dual(0.0)
        for i in range(n):
            total += masses[0, i]
            masses[1, i] = total  # G times the mass up to this body: the G M of its Kepler motion
            masses[2, i] = masses[0, i] / total
        for half in range(2):
            x = dual_rows(blocks[block, half], n)
            fill_phase(x, half, phase, slopes, columns, first)
            to_jacobi(x, masses, True)


@driver
def leave(blocks, columns, phase, slopes):
    """phase (2, 3, n) and slopes (2, 3, n, columns) <- the state."""
    n = phase.shape[2]
    for block in range(blocks.shape[0]):
        first = block * WIDTH
        count = min(WIDTH, columns - first)
        masses, inertial = dual_rows(blocks[block, MASSES], n), dual_rows(blocks[block, INERTIAL], n)
        for half in range(2):
            from_jacobi(dual_rows(blocks[block, half], n), masses, inertial)
            for k in range(3):
                for i in range(n):
                    place = ((half * 3 + k) * n + i) * columns + first
                    phase[half, k, i] = inertial[k, i].value
                    masked_store(flat(slopes), place, inertial[k, i].slope, count)


@driver
def tangent_steps(blocks, n, stages, modified, dt, start, first, steps, others, pushes, order):
    """Apply a row of drifts, each followed by its kick, ``steps`` times. Return a status.

    ``stages`` are rows of drifts, kicks, the fractions of dt at the kicks, and the weights of the kernel's correction.
    ``others`` (k, 2) are the addresses of the slopes of other forces and of their parts. ``pushes`` (p, 3) are what
    columns of masses and parameters do in these forces. ``order`` (n,) are the rows of the bodies in the system.
    """
    slopes, changes, pulls = np.empty(6 * n * WIDTH), np.empty((n, 6)), np.empty((n * (n + 1) // 2, 2))
    drifts, kicks = stages[0], stages[1]
    for step in range(steps):
        for stage in range(drifts.size):
            if drifts[stage] != 0.0:
                fill_kepler(dual_rows(blocks[0, X], n), dual_rows(blocks[0, V], n), dual_rows(blocks[0, MASSES], n),
                            drifts[stage] * dt, changes, slopes)  # fmt: skip
                for block in range(blocks.shape[0]):
                    x, v = dual_rows(blocks[block, X], n), dual_rows(blocks[block, V], n)
                    drift_duals(x, v, dual_rows(blocks[block, MASSES], n), drifts[stage] * dt, changes, slopes)
            if kicks[stage] != 0.0:
                h, t = kicks[stage] * dt, start + (first + step + stages[2, stage]) * dt
                weight = stages[3, stage] * h * h
                status = kick_blocks(blocks, n, h, weight, modified, t, others, pushes, order, pulls)
                if status != OK:
                    return status
    return OK


@jit
def unit_slope(k):
    """Return lanes with a one in lane k."""
    return select(lane_numbers() == float(k), splat(1.0), 0.0)


@jit
def unit_slopes(k):
    """Return the slopes of a vector whose components are the numbers k to k + 2 to differentiate by."""
    return vector3(unit_slope(k), unit_slope(k + 1), unit_slope(k + 2))


@jit
def fill_kepler(x, v, masses, dt, changes, slopes):
    """changes (n, 6) <- the changes of position and velocity by each body's Kepler drift; slopes <- their derivatives
    by position, velocity and GM, eight numbers for each change."""
    for i in range(1, x.shape[1]):
        place = dual(vector_at(x, i).value, unit_slopes(0))
        speed = dual(vector_at(v, i).value, unit_slopes(3))
        gm = dual(masses[1, i].value, unit_slope(6))
        found = kepler_duals(gm, dt, place, speed)
        for half in range(2):
            for k in range(3):
                changes[i, 3 * half + k] = found[half][k].value
                store(slopes, (6 * i + 3 * half + k) * WIDTH, found[half][k].slope)


@jit
def drift_duals(x, v, masses, dt, changes, slopes):
    """Move the bodies along their Kepler orbits, and the centre of mass along a line."""
    put_vector(x, 0, vector_at(x, 0) + dt * vector_at(v, 0))
    for i in range(1, x.shape[1]):
        dx, dv, gm = vector_at(x, i).slope, vector_at(v, i).slope, masses[1, i].slope
        for row in range(6):
            at = (6 * i + row) * WIDTH
            change = slopes[at] * dx.x + slopes[at + 1] * dx.y + slopes[at + 2] * dx.z
            change = change + (slopes[at + 3] * dv.x + slopes[at + 4] * dv.y + slopes[at + 5] * dv.z)
            change = dual(changes[i, row], change + slopes[at + 6] * gm)
            if row < 3:
                x[row, i] += change
            else:
                v[row - 3, i] += change


@jit
def kepler_duals(gm, dt, x, v):
    """Changes of x and v as `kepler.kepler_increments` gives them, on duals."""
    r0: Any = math.sqrt(x @ x)
    eta = x @ v
    beta = 2.0 * gm / r0 - v @ v
    zeta = gm - beta * r0
    ahead = as_dual(dt)
    if beta > 0.0:
        period = 2.0 * math.pi * gm / (beta * math.sqrt(beta))
        if abs(ahead) > 0.5 * period:
            ahead = ahead - period * math.floor(ahead / period + 0.5)
    sign = -1.0 if ahead < 0.0 else 1.0
    ahead, eta = sign * ahead, sign * eta
    found = one_solution(gm.value, beta.value, r0.value, eta.value, zeta.value, ahead.value)
    root = (ahead.value - eta.value * found.g2 - zeta.value * found.g3) / r0.value
    g = one_g(beta, as_dual(root))
    excess = r0 * root + eta * g.g2 + zeta * g.g3 - ahead
    slope = r0.value + eta.value * g.g1.value + zeta.value * g.g2.value
    g = one_g(beta, root - excess / slope)
    f1, g_, fdot, gdot1 = lagrange(gm, ahead, r0, 1.0 / r0, eta, zeta, g)
    return f1 * x + (sign * g_) * v, (sign * fdot) * x + gdot1 * v

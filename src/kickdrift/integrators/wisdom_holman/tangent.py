"""Tangent map of Wisdom-Holman methods: the derivatives of their steps, by duals.

Coordinates are Jacobi's. Masses may vary as well. `tangent_drift` has the Kepler drift,
`tangent_kicks` the kicks. Duals of duals give the second derivatives.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from kickdrift.forces.seam.kernel import OK
from kickdrift.integrators.wisdom_holman.tangent_columns import (
    Blocks,
    Derived,
    blocks_of,
    enter_masses,
    enter_phase,
    leave_number,
)
from kickdrift.integrators.wisdom_holman.tangent_drift import drift_duals, fill_kepler
from kickdrift.integrators.wisdom_holman.tangent_kicks import (
    INERTIAL,
    MASSES,
    ROWS,
    V,
    X,
    from_jacobi,
    kick_blocks,
    to_jacobi,
)
from kickdrift.jit.compile import driver
from kickdrift.jit.duals import functions as functions  # what duals take part in
from kickdrift.jit.duals.dual import SLOT, as_dual, dual_rows
from kickdrift.jit.lanes.vectors import WIDTH


def tangents(phase: Derived, gm: Derived) -> Blocks:
    """Bring a phase (2, 3, n), and G m (n,), to Jacobi's coordinates. The central body comes first.

    The rows of the blocks hold duals: positions, velocities, work, and in row MASSES the G m of the bodies and, behind
    them, the G M of the Kepler motions."""
    made = blocks_of(gm.slopes.shape[1], ROWS, len(gm.values), gm.second.size > 0)
    enter(made.rows, made.columns, phase, gm)
    return made


def slopes_in(rows: NDArray[np.float64], first: int = X) -> NDArray[np.float64]:
    """The first derivatives in two rows of blocks without second ones, to read and to write: of positions and
    velocities, or of the rows from ``first`` on."""
    duals = rows.reshape(*rows.shape[:2], -1, SLOT)
    return duals[:, first : first + 2, :, 1:]


@driver
def enter(blocks, columns, phase, gm):
    """Fill the blocks."""
    n = gm.values.size
    for block in range(blocks.shape[0]):
        masses = dual_rows(blocks[block, MASSES], n)
        enter_masses(masses, gm, columns[block])
        total = as_dual(0.0)
        for i in range(n):
            total += masses[0, i]
            masses[1, i] = total  # G times the mass up to this body: the G M of its Kepler motion
            masses[2, i] = masses[0, i] / total
        for half in range(2):
            x = dual_rows(blocks[block, half], n)
            enter_phase(x, half, phase, columns[block])
            to_jacobi(x, masses, True)


@driver
def leave(blocks, columns, n, phase):
    """phase (2, 3, n) <- the state."""
    for block in range(blocks.shape[0]):
        masses, inertial = dual_rows(blocks[block, MASSES], n), dual_rows(blocks[block, INERTIAL], n)
        for half in range(2):
            from_jacobi(dual_rows(blocks[block, half], n), masses, inertial)
            for k in range(3):
                for i in range(n):
                    leave_number(phase, (half * 3 + k) * n + i, inertial[k, i], columns[block])


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

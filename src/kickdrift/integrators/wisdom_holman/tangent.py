"""Tangent map of Wisdom-Holman methods: the derivatives of their steps, by duals.

Coordinates are Jacobi's. Masses may vary as well. `tangent_drift` has the Kepler drift; the kicks are here: gravity,
other forces, and the kernels that change a kick (see `kernels`). Duals of duals give the second derivatives.
"""

import math

import numpy as np
from numpy.typing import NDArray

from kickdrift.forces.seam.kernel import OK
from kickdrift.integrators.wisdom_holman import tangent_columns
from kickdrift.integrators.wisdom_holman.tangent_columns import feel, to_first_order
from kickdrift.integrators.wisdom_holman.tangent_drift import drift_duals, fill_kepler
from kickdrift.jit.compile import driver, jit, never_inline
from kickdrift.jit.duals import functions as functions  # what duals take part in
from kickdrift.jit.duals.dual import SLOT, as_dual, dual, dual_rows
from kickdrift.jit.duals.operators import dual_vector, put_vector, vector_at
from kickdrift.jit.lanes.vectors import WIDTH

# Rows of a block: Jacobi positions and velocities, accelerations, inertial positions, masses; a place aside for
# kernels; positions, velocities and accelerations in the system's order for other forces.
X, V, A, INERTIAL, MASSES, ASIDE, OWN_X, OWN_V, OWN_A, ROWS = range(10)


# --- kicks ---


@jit
def to_jacobi(x, masses, whole):
    """Change rows to Jacobi's: each body relative to the centre of mass of those before it. With ``whole``, column 0
    becomes the centre of mass of all."""
    centre = vector_at(x, 0)
    for i in range(1, x.shape[1]):
        relative = vector_at(x, i) - centre
        put_vector(x, i, relative)
        centre = centre + masses[2, i] * relative
    if whole:
        put_vector(x, 0, centre)


@jit
def from_jacobi(x, masses, inertial):
    """inertial <- rows of Jacobi's coordinates."""
    centre = vector_at(x, 0)
    for i in range(x.shape[1] - 1, 0, -1):
        relative = vector_at(x, i)
        centre = centre - masses[2, i] * relative
        put_vector(inertial, i, relative + centre)
    put_vector(inertial, 0, centre)


@jit
def kick_blocks(blocks, n, dt, weight, modified, t, others, pushes, order):
    """Kick for a time dt, by the accelerations B(x) and ``weight`` times a correction: B at x + weight B, or with
    ``modified`` B + weight B' B. Return a status."""
    never_inline()
    status = fill_accelerations(blocks, n, X, t, others, pushes, order)
    if status == OK and weight != 0.0 and modified:
        add_corrections(blocks, n, weight)
    elif status == OK and weight != 0.0:
        for block in range(blocks.shape[0]):
            x, a = dual_rows(blocks[block, X], n), dual_rows(blocks[block, A], n)
            aside = dual_rows(blocks[block, ASIDE], n)
            for i in range(n):
                put_vector(aside, i, vector_at(x, i) + weight * vector_at(a, i))
        status = fill_accelerations(blocks, n, ASIDE, t, others, pushes, order)
    for block in range(blocks.shape[0]):
        v, a = dual_rows(blocks[block, V], n), dual_rows(blocks[block, A], n)
        for i in range(n):
            put_vector(v, i, vector_at(v, i) + dt * vector_at(a, i))
    return status


@jit
def fill_accelerations(blocks, n, at, t, others, pushes, order):
    """Accelerations <- those of gravity less the attraction of the Kepler motions, and of the other forces, at the
    positions in row ``at``. Return a status."""
    status = OK
    for block in range(blocks.shape[0]):
        rows = blocks[block]
        x, a = dual_rows(rows[at], n), dual_rows(rows[A], n)
        inertial, masses = dual_rows(rows[INERTIAL], n), dual_rows(rows[MASSES], n)
        from_jacobi(x, masses, inertial)
        pull_pairs(a, inertial, masses)
        if others.shape[0] > 0:
            status = max(status, add_others(rows, n, t, others, pushes, order, block))
        to_jacobi(a, masses, others.shape[0] > 0)
        for i in range(1, n):
            put_vector(a, i, vector_at(a, i) + masses[1, i] * pull_of(vector_at(x, i)))
        if others.shape[0] == 0:  # the centre of mass moves on
            put_vector(a, 0, dual_vector((0.0, 0.0, 0.0)))
    return status


@to_first_order
@jit
def add_others(rows, n, t, others, pushes, order, block):
    """Add the accelerations of the other forces to those of gravity. Return a status, which is not
    OK for a force that takes no duals."""
    own_x, own_a = dual_rows(rows[OWN_X], n), dual_rows(rows[OWN_A], n)
    inertial, a = dual_rows(rows[INERTIAL], n), dual_rows(rows[A], n)
    for i in range(n):
        put_vector(own_x, order[i], vector_at(inertial, i))
    rows[OWN_V] = 0.0
    status = feel(rows[OWN_A], rows[OWN_X], rows[OWN_V], n, t, others, pushes, block)
    for i in range(n):
        put_vector(a, i, vector_at(a, i) + vector_at(own_a, order[i]))
    return status


@jit
def pull_of(d):
    """Return d / r^3 for a dual separation d."""
    square = 1.0 / (d.value @ d.value)
    cube = square * math.sqrt(square)
    return dual(cube * d.value, cube * (d.slope - (3.0 * square * (d.slope @ d.value)) * d.value))


@jit
def pull_pairs(a, inertial, masses):
    """a <- the attraction of all pairs of bodies."""
    n = a.shape[1]
    for i in range(n):
        put_vector(a, i, dual_vector((0.0, 0.0, 0.0)))
    for i in range(n):
        own = vector_at(a, i)
        for j in range(i):
            pull = pull_of(vector_at(inertial, j) - vector_at(inertial, i))
            own = own + masses[0, j] * pull
            put_vector(a, j, vector_at(a, j) - masses[0, i] * pull)
        put_vector(a, i, own)


@jit
def add_corrections(blocks, n, weight):
    """Add ``weight`` times the change of the accelerations when bodies move along them; gravity alone."""
    for block in range(blocks.shape[0]):
        rows = blocks[block]
        x, a = dual_rows(rows[X], n), dual_rows(rows[A], n)
        inertial, masses = dual_rows(rows[INERTIAL], n), dual_rows(rows[MASSES], n)
        moved, change = dual_rows(rows[OWN_X], n), dual_rows(rows[OWN_A], n)
        from_jacobi(a, masses, moved)
        for i in range(n):
            put_vector(change, i, dual_vector((0.0, 0.0, 0.0)))
        for i in range(n):
            for j in range(i):
                d = vector_at(inertial, j) - vector_at(inertial, i)
                own = tidal(d, vector_at(moved, j) - vector_at(moved, i))
                put_vector(change, i, vector_at(change, i) + masses[0, j] * own)
                put_vector(change, j, vector_at(change, j) - masses[0, i] * own)
        to_jacobi(change, masses, False)
        for i in range(1, n):
            own = vector_at(change, i) + masses[1, i] * tidal(vector_at(x, i), vector_at(a, i))
            put_vector(a, i, vector_at(a, i) + weight * own)


@jit
def tidal(d, u):
    """Change of d / |d|^3 when d moves along u."""
    inverse2 = as_dual(1.0) / (d @ d)
    return (inverse2 * math.sqrt(inverse2)) * (u - (3.0 * inverse2 * (d @ u)) * d)


# --- the map ---


def tangents(phase: tangent_columns.Derived, gm: tangent_columns.Derived) -> tangent_columns.Blocks:
    """Bring a phase (2, 3, n), and G m (n,), to Jacobi's coordinates. The central body comes first.

    The rows of the blocks hold duals: positions, velocities, work, and in row MASSES the G m of the bodies and, behind
    them, the G M of the Kepler motions."""
    made = tangent_columns.blocks_of(gm.slopes.shape[1], ROWS, len(gm.values), gm.second.size > 0)
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
        tangent_columns.enter_masses(masses, gm, columns[block])
        total = as_dual(0.0)
        for i in range(n):
            total += masses[0, i]
            masses[1, i] = total  # G times the mass up to this body: the G M of its Kepler motion
            masses[2, i] = masses[0, i] / total
        for half in range(2):
            x = dual_rows(blocks[block, half], n)
            tangent_columns.enter_phase(x, half, phase, columns[block])
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
                    tangent_columns.leave_number(phase, (half * 3 + k) * n + i, inertial[k, i], columns[block])


@driver
def tangent_steps(blocks, n, stages, modified, dt, start, first, steps, others, pushes, order):
    """Apply a row of drifts, each followed by its kick, ``steps`` times. Return a status.

    ``stages`` are rows of drifts, kicks, the fractions of dt at the kicks, and the weights of the kernel's correction.
    ``others`` (k, 2) are the addresses of the slopes of other forces and of their parts. ``pushes`` (p, 3) are what
    columns of masses and parameters do in these forces. ``order`` (n,) are the rows of the bodies in the system.
    """
    slopes, changes = np.empty(6 * n * WIDTH), np.empty((n, 6))
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
                status = kick_blocks(blocks, n, h, weight, modified, t, others, pushes, order)
                if status != OK:
                    return status
    return OK

"""Compiled loop of the Wisdom-Holman map, and positions and velocities from its coordinates.

``y' = A + B``, with A the Kepler motion of every body and B the rest of the Hamiltonian. The rows of drift and kick
weights are as in any splitting. Positions and velocities are rounded as in ``coordinates``.
"""

import math

import numpy as np

from kickdrift.forces.seam.kernel import OK
from kickdrift.integrators.stepping.loops import FRESH, STAGE, STEP
from kickdrift.integrators.wisdom_holman.bodies import GM
from kickdrift.integrators.wisdom_holman.eight import steps_of_eight, takes
from kickdrift.integrators.wisdom_holman.flows import drift, jump
from kickdrift.integrators.wisdom_holman.kernels import kick
from kickdrift.jit.compile import driver, inlined, strict
from kickdrift.jit.handle import handle, status_at, unowned
from kickdrift.jit.lanes.memory import flat
from kickdrift.model.state import Floats


@driver
def wisdom_holman_loop(forces, bodies, stages, dt, start, first, steps, cursor):
    """Apply the row of drifts (``stages[0]``), each followed by its kick (``stages[1]``), ``steps`` times.
    ``stages[2]`` is the fraction of dt at the kick, and ``stages[3]`` the weight of the kernel's correction.
    ``forces`` are the forces other than gravity; the rest is as in
    ``loops``."""
    bound, others = handle(bodies), handle(forces)
    stages, cursor = unowned(stages), unowned(cursor)
    drifts, kicks, passed = stages[0], stages[1], stages[2]
    with_jump, others_act = not bodies.jacobi, others.table.shape[0] > 0
    in_registers = takes(bound.kernel, bound, others)
    while cursor[STEP] < steps:
        if in_registers and not cursor[FRESH]:
            steps_of_eight(bound, stages, dt, steps, cursor)
            if cursor[STEP] == steps:
                break
        for stage in range(cursor[STAGE], kicks.size):
            t = start + (first + cursor[STEP] + passed[stage]) * dt
            h = kicks[stage] * dt
            if not cursor[FRESH]:
                if drifts[stage] != 0.0:
                    status = drift(bound, drifts[stage] * dt, t)
                    if status != OK:
                        cursor[STAGE] = stage
                        return status
                if with_jump and h != 0.0 and others_act:
                    jump(bound, 0.5 * h)
                cursor[FRESH] = 1
            if h != 0.0:
                status = kick(bound.kernel, others, bound, stages, stage, h, t, cursor)
                if status != OK:
                    cursor[STAGE] = stage
                    return status
            cursor[FRESH] = 0
        cursor[STAGE] = 0
        cursor[STEP] += 1
    return OK


# --- positions and velocities ---


def listed_masses(shares: Floats) -> Floats:
    """Table (3, n) for bodies with these masses, the central one first.

    Its rows are the masses, each mass over the mass up to its orbit, and the total mass.
    """
    return np.array([shares, shares / np.cumsum(shares), np.full(len(shares), shares.sum())])


@strict
def leave_jacobi(orbit, carry, centre, slots, listed, masses, half, k, y):
    """One axis of ``coordinates.from_jacobi``."""
    row = 3 * half + k
    first = centre[half, k] + centre[half + 2, k]
    before, moved = first, 0.0
    for body in range(listed.size - 1, 0, -1):
        own = orbit[row, slots[body]]
        if carry.size:
            own += carry[row, slots[body]]
        moved += masses[1, body] * own
        before = first - moved
        y[half, k, listed[body]] = own + before
    y[half, k, listed[0]] = before


@strict
def leave_democratic(orbit, carry, centre, slots, listed, masses, half, k, y):
    """One axis of ``coordinates.from_democratic``."""
    row = 3 * half + k
    first = centre[half, k] + centre[half + 2, k]
    moved = 0.0
    for body in range(1, listed.size):
        own = orbit[row, slots[body]]
        if carry.size:
            own += carry[row, slots[body]]
        y[half, k, listed[body]] = own
        moved += masses[0, body] * own
    central = first - moved / (masses[0, 0] if half else masses[2, 0])
    for body in range(1, listed.size):
        y[half, k, listed[body]] += first if half else central
    y[half, k, listed[0]] = central


@driver
def leave(orbit, carry, centre, slots, listed, masses, jacobi, y):
    """y (2, 3, n) <- positions and velocities. ``slots`` is the slot of each of the ``listed`` bodies."""
    for half in range(2):
        for k in range(3):
            if jacobi:
                leave_jacobi(orbit, carry, centre, slots, listed, masses, half, k, y)
            else:
                leave_democratic(orbit, carry, centre, slots, listed, masses, half, k, y)


FAR = 4.0  # padding bodies circle this many times as far out as the farthest body


@strict
def enter_jacobi(orbit, centre, slots, listed, masses, half, k, y):
    """One axis of ``coordinates.to_jacobi``."""
    moved, total, before = 0.0, 0.0, 0.0
    for body in range(listed.size):
        own = y[half, k, listed[body]]
        if body:
            orbit[3 * half + k, slots[body]] = own - before
        moved += masses[0, body] * own
        total += masses[0, body]
        before = moved / total
    centre[half, k] = before


@strict
def fill_padding(orbit, table, order):
    """Put the bodies that fill up the lanes on distant circles, no two of them at one place."""
    farthest = 0.0
    for slot in range(order.size):
        if order[slot] >= 0:
            x, y, z = orbit[0, slot], orbit[1, slot], orbit[2, slot]
            farthest = max(farthest, math.sqrt(x * x + y * y + z * z))
    farthest = FAR * farthest if farthest > 0.0 else 1.0
    for slot in range(order.size):
        if order[slot] < 0:
            out = farthest * (1.0 + slot)
            orbit[:, slot] = 0.0
            orbit[0, slot], orbit[4, slot] = out, math.sqrt(table[GM, slot] / out)


@driver
def enter(bodies, slots, listed, masses, y):
    """The map's coordinates <- positions and velocities (2, 3, n). Democratic heliocentric ones are there already."""
    if bodies.jacobi:
        bodies.centre[:] = 0.0
        for half in range(2):
            for k in range(3):
                enter_jacobi(bodies.orbit, bodies.centre, slots, listed, masses, half, k, y)
    fill_padding(bodies.orbit, bodies.table, bodies.order)
    bodies.carry[:] = 0.0


@driver
def first_step(forces, loop, bodies, begin, slots, listed, masses, dt, start, y, cursor):
    """Enter y, and take the first step with the loop at an address, but for its last drift. Return a status."""
    enter(bodies, slots, listed, masses, y)
    cursor[STEP:] = 0
    return status_at(loop, (forces, bodies, begin, dt, start, 0, 1, cursor))


@inlined
def copy(source, target):
    """target <- source, contiguous. The assignment of a whole array would take a second longer to compile."""
    source, target = flat(source), flat(target)
    for k in range(source.size):
        target[k] = source[k]


@driver
def shown_steps(
    forces, looks, loop, bodies, shown, step, end, back, aside, slots, listed, masses, dt, start, y, first, steps,
    cursor,
):  # fmt: skip
    """Take steps of ``loop``, at the address ``loop``, and y <- the state at the step point. Return a status.

    The run itself stays before the last drift, which is done on the copy ``shown``. ``end`` and ``back`` are the drift
    and the steps that undo the corrector.
    """
    cursor[STEP:] = 0
    status = status_at(loop, (forces, bodies, step, dt, start, first, steps, cursor))
    if status != OK:
        return status
    copy(bodies.orbit, shown.orbit)
    copy(bodies.carry, shown.carry)
    copy(bodies.centre, shown.centre)
    copy(bodies.first, shown.first)
    aside[:] = 0
    status = status_at(loop, (looks, shown, end, dt, start, first + steps, 1, aside))
    if status == OK and back.size:
        aside[:] = 0
        status = status_at(loop, (looks, shown, back, dt, start, first + steps, 1, aside))
    if status == OK:
        leave(shown.orbit, shown.carry, shown.centre, slots, listed, masses, bodies.jacobi, y)
    return status

"""Positions and velocities from the coordinates of the Wisdom-Holman map, with the rounding of ``coordinates``."""

from __future__ import annotations

import numpy as np

from kickdrift.forces.seam.kernel import OK
from kickdrift.integrators.stepping.loops import STEP
from kickdrift.integrators.wisdom_holman.bodies import Bodies
from kickdrift.jit.compile import driver, inlined, strict
from kickdrift.jit.handle import status_at
from kickdrift.jit.lanes.memory import flat
from kickdrift.model.state import Floats


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


@inlined
def copy(source, target):
    """target <- source, contiguous. The assignment of a whole array would take a second longer to compile."""
    source, target = flat(source), flat(target)
    for k in range(source.size):
        target[k] = source[k]


@driver
def shown_steps(
    forces, looks, loop, bodies, orbit, carry, centre, first_seen, kernel, step, end, back, aside, slots, listed,
    masses, dt, start, y, first, steps, cursor,
):  # fmt: skip
    """Take steps of ``loop``, at the address ``loop``, and y <- the state at the step point. Return a
    status.

    The run itself stays before the last drift, which is done on a copy: ``orbit`` to ``kernel`` are its parts.
    ``end`` and ``back`` are the drift and the steps that undo the corrector.
    """
    cursor[STEP:] = 0
    status = status_at(loop, (forces, bodies, step, dt, start, first, steps, cursor))
    if status != OK:
        return status
    copy(bodies.orbit, orbit)
    copy(bodies.carry, carry)
    copy(bodies.centre, centre)
    copy(bodies.first, first_seen)
    shown = Bodies(
        orbit, carry, centre, bodies.table, bodies.inside, first_seen, bodies.work, bodies.massive, bodies.jacobi,
        bodies.order, bodies.central, bodies.gm, bodies.shares, bodies.x, bodies.a, kernel,
    )  # fmt: skip
    aside[:] = 0
    status = status_at(loop, (looks, shown, end, dt, start, first + steps, 1, aside))
    if status == OK and back.size:
        aside[:] = 0
        status = status_at(loop, (looks, shown, back, dt, start, first + steps, 1, aside))
    if status == OK:
        leave(orbit, carry, centre, slots, listed, masses, bodies.jacobi, y)
    return status

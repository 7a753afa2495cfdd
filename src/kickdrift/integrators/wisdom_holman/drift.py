"""Drift of the Wisdom-Holman map: every body moves along its Kepler orbit, eight at a time."""

from __future__ import annotations

import numpy as np

from kickdrift.forces.seam.kernel import BLOWN_UP, OK
from kickdrift.integrators.wisdom_holman.bodies import (
    GM,
    UNBOUND,
    WAY,
    add_centre,
    add_vectors,
)
from kickdrift.integrators.wisdom_holman.kepler import kepler_increments, lanes_increments
from kickdrift.jit.compile import inlined, is_finite, jit
from kickdrift.jit.lanes.masks import any_lane, mask_bits
from kickdrift.jit.lanes.memory import load
from kickdrift.jit.lanes.vector3 import load3, numbers3, select3, store3
from kickdrift.jit.lanes.vectors import WIDTH


@inlined
def drift(bodies, dt, t):
    """Move every body along its Kepler orbit for a time dt from t on, and the centre of mass along its line. Return a
    status."""
    orbit, table, work = bodies.orbit, bodies.table, bodies.work
    n = orbit.shape[1]
    for b in range(0, n, WIDTH):
        gm = load(table[GM], b)
        moved, kicked, beta, solved = lanes_increments(gm, dt, load3(orbit, b, n), load3(orbit, 3 * n + b, n))
        done = mask_bits(solved)
        if done != 255:
            if one_by_one(bodies, dt, b, done) != OK:
                return BLOWN_UP
            moved = select3(solved, moved, load3(work, WAY * n + b, n))
            kicked = select3(solved, kicked, load3(work, (WAY + 3) * n + b, n))
        if any_lane(beta <= 0.0):
            note_unbound(bodies, b, mask_bits(beta <= 0.0), t)
        add_vectors(bodies, 0, b, moved)
        add_vectors(bodies, 3, b, kicked)
    add_centre(bodies.centre, 0, dt * load(bodies.centre[1], 0))
    return OK


@jit
def one_by_one(bodies, dt, b, done):
    """Compute the increments of the unsolved lanes in ``work``. Return a status."""
    orbit, work = bodies.orbit, bodies.work
    n = orbit.shape[1]
    for i in range(b, b + WIDTH):
        if not (done >> (i - b)) & 1:
            x, v = numbers3(orbit, i, n), numbers3(orbit, 3 * n + i, n)
            moved, kicked = kepler_increments(bodies.table[GM, i], dt, x, v)
            store3(work, WAY * n + i, n, moved)
            store3(work, (WAY + 3) * n + i, n, kicked)
            total = moved.x + moved.y + moved.z + kicked.x + kicked.y + kicked.z
            if not is_finite(total):
                return BLOWN_UP
    return OK


@jit
def note_unbound(bodies, b, lanes, t):
    first = bodies.first
    for k in range(WIDTH):
        if (lanes >> k) & 1 and np.isnan(first[UNBOUND, b + k]):
            first[UNBOUND, b + k] = t

"""Forces other than gravity among the kicks of the Wisdom-Holman map."""

from __future__ import annotations

from kickdrift.forces.bound.table import EVALUATIONS, fill_accelerations
from kickdrift.integrators.wisdom_holman.bodies import (
    PLACE,
    SHARE,
    WAY,
    add_centre,
)
from kickdrift.integrators.wisdom_holman.kicks import places
from kickdrift.jit.compile import jit
from kickdrift.jit.lanes.memory import load


@jit
def fill_positions(bodies):
    """bodies.x[0] <- the particles' positions."""
    orbit, work, order, x, shares = bodies.orbit, bodies.work, bodies.order, bodies.x[0], bodies.shares
    if bodies.jacobi:
        places(bodies)
    place = work[PLACE : PLACE + 3] if bodies.jacobi else orbit[:3]
    for k in range(3):
        central = bodies.centre[0, k]
        for i in range(bodies.massive):
            if order[i] >= 0:
                central -= shares[order[i]] * place[k, i]
        x[k, bodies.central] = central
        for i in range(orbit.shape[1]):
            if order[i] >= 0:
                x[k, order[i]] = central + place[k, i]


@jit
def add_accelerations(bodies, dt):
    """Kick by the accelerations bodies.a, transformed to the map's coordinates."""
    orbit, work, order, a, shares = bodies.orbit, bodies.work, bodies.order, bodies.a, bodies.shares
    for k in range(3):
        mean = a[k, bodies.central]
        if not bodies.jacobi:
            mean *= shares[bodies.central]
            for i in range(bodies.massive):
                if order[i] >= 0:
                    mean += shares[order[i]] * a[k, order[i]]
        first = mean
        for i in range(orbit.shape[1]):
            if order[i] >= 0:
                if bodies.jacobi and i >= bodies.massive:
                    mean = work[WAY + k, bodies.inside[i] - 1] if bodies.inside[i] > 0 else first
                relative = a[k, order[i]] - mean
                orbit[3 + k, i] += dt * relative
                if bodies.jacobi and i < bodies.massive:
                    mean += bodies.table[SHARE, i] * relative
                    work[WAY + k, i] = mean
        bodies.centre[4, k] = 0.0
        for i in range(shares.size):
            bodies.centre[4, k] += shares[i] * a[k, i]
    add_centre(bodies.centre, 1, dt * load(bodies.centre[4], 0))


@jit
def fill_others(forces, bodies, t, cursor):
    """bodies.a <- the accelerations by forces other than gravity. Return a status."""
    fill_positions(bodies)
    status = fill_accelerations(forces, t, bodies.x[0], bodies.x[1], bodies.a, None, cursor)
    cursor[EVALUATIONS] -= 1  # the kick counts
    return status

"""Compiled loop of the Wisdom-Holman map: Kepler drifts and interaction kicks.

``y' = A + B``, with A the Kepler motion of every body and B the rest of the Hamiltonian. The rows of drift and kick
weights are as in any splitting.
"""

from __future__ import annotations

from kickdrift.forces.evaluate import EVALUATIONS, fill_accelerations
from kickdrift.forces.kernel import OK
from kickdrift.integrators.loops import FRESH, STAGE, STEP
from kickdrift.integrators.wisdom_holman_bodies import (
    PLACE,
    SHARE,
    WAY,
    add_centre,
)
from kickdrift.integrators.wisdom_holman_drift import drift
from kickdrift.integrators.wisdom_holman_kicks import heliocentric_kick, jacobi_kick, jump, places
from kickdrift.jit.compile import driver, jit
from kickdrift.jit.handle import handle, unowned
from kickdrift.jit.memory import load


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


@driver
def wisdom_holman_loop(forces, bodies, stages, dt, start, first, steps, cursor):
    """Apply the row of drifts (``stages[0]``), each followed by its kick (``stages[1]``), ``steps`` times.
    ``stages[2]`` is the fraction of dt at the kick. ``forces`` are the forces other than gravity; the rest is as in
    ``loops``."""
    bound, others = handle(bodies), handle(forces)
    stages, cursor = unowned(stages), unowned(cursor)
    drifts, kicks, passed = stages[0], stages[1], stages[2]
    with_jump, others_act = not bodies.jacobi, others.table.shape[0] > 0
    while cursor[STEP] < steps:
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
                if others_act:
                    status = fill_others(others, bound, t, cursor)
                    if status != OK:
                        cursor[STAGE] = stage
                        return status
                if with_jump:
                    heliocentric_kick(bound, h, t)
                else:
                    jacobi_kick(bound, h, t)
                if others_act:
                    add_accelerations(bound, h)
                if with_jump:
                    jump(bound, 0.5 * h if others_act else h)
                cursor[EVALUATIONS] += 1
            cursor[FRESH] = 0
        cursor[STAGE] = 0
        cursor[STEP] += 1
    return OK

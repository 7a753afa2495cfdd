"""The compiled variations of forces, along any number of deviations.

Particle i of the System has the deviations ``n + i * directions`` to ``n + (i + 1) * directions - 1``.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from kickdrift.forces.gravity.slope import Sources, acceleration_and_slope, sources_of
from kickdrift.forces.seam.kernel import OK, kernel, run_body
from kickdrift.forces.slopes.dual_slopes import NO_DUALS, dual_slopes
from kickdrift.jit.compile import jit, never_inline
from kickdrift.jit.duals.dual import SLOT, dual, dual_rows
from kickdrift.jit.lanes.memory import aligned, flat, masked_load, masked_store
from kickdrift.jit.lanes.vectors import WIDTH
from kickdrift.jit.threads.chunks import Chunks, chunk_task, each_chunk, in_chunks

if TYPE_CHECKING:
    from kickdrift.model.system import System

STEP = float(np.cbrt(np.finfo(float).eps))  # relative displacement of central differences
EXACT, DIFFERENCES = 1.0, 2.0  # how the slopes were found


class VariedGravity(NamedTuple):
    """Gravity and its variation in closed form, along one deviation."""

    force: Any  # bound to the particles without deviations
    phase: NDArray[np.float64]  # (2, 3, n) positions and velocities of the particles
    a: NDArray[np.float64]  # (3, n) accelerations of the particles
    sources: Sources
    chunks: Chunks


class VariedForce(NamedTuple):
    """Any force, and its variations by duals, or by central differences where its code takes no duals."""

    force: Any
    phase: NDArray[np.float64]
    a: NDArray[np.float64]
    duals: NDArray[np.float64]  # (3, numbers) positions, velocities and accelerations
    displaced: NDArray[np.float64]  # (2, 3, n)
    ahead: NDArray[np.float64]  # (3, n)
    behind: NDArray[np.float64]  # (3, n)
    found: NDArray[np.float64]  # (1,) EXACT or DIFFERENCES after the first evaluation


def bind(force: Any, system: System, threads: int, analytic: bool) -> VariedGravity | VariedForce:
    """Return the force of a System for its particles and deviations."""
    n = len(system)
    room = force.bind(system, threads), np.zeros((2, 3, n)), np.zeros((3, n))
    if analytic:
        return VariedGravity(*room, sources_of(force, system), in_chunks(n, threads))
    numbers = aligned((3, 3 * n * SLOT))
    return VariedForce(*room, numbers, np.zeros((2, 3, n)), np.zeros((3, n)), np.zeros((3, n)), np.zeros(1))


@jit
def add_own(force, t, x, v, a, sums):
    """Add the particles' own accelerations, by the force without deviations. Return a status."""
    phase, own = force.phase, force.a
    for k in range(3):
        for i in range(own.shape[1]):
            phase[0, k, i], phase[1, k, i], own[k, i] = x[k, i], v[k, i], 0.0
    status = run_body(force.force, t, phase[0], phase[1], own, sums)
    if status != OK:
        return status
    for k in range(3):
        for i in range(own.shape[1]):
            a[k, i] += own[k, i]
    return OK


@chunk_task
def slope_of_acceleration(varied, i):
    """Return the variation of the acceleration of body i."""
    never_inline()
    acceleration_and_slope(varied.sources, i)


@kernel(VariedGravity)
def varied_gravity(force, t, x, v, a, sums):
    status = add_own(force, t, x, v, a, sums)
    if status != OK:
        return status
    sources, n = force.sources, force.a.shape[1]
    for k in range(3):
        for i in range(n):
            sources.x[k, i], sources.u[k, i] = x[k, i], x[k, n + i]
    each_chunk(force, force.chunks, "slope_of_acceleration")
    for k in range(3):
        for i in range(n):
            a[k, n + i] += sources.slope[k, i]
    return OK


@kernel(VariedForce)
def varied_force(force, t, x, v, a, sums):
    status = add_own(force, t, x, v, a, sums)
    if status != OK:
        return status
    n, duals = force.a.shape[1], force.duals
    directions = x.shape[1] // n - 1
    xs, vs, slopes = dual_rows(duals[0], n), dual_rows(duals[1], n), dual_rows(duals[2], n)
    for first in range(0, directions, WIDTH):
        count = min(WIDTH, directions - first)
        in_duals(xs, x, n, directions, first, count)
        in_duals(vs, v, n, directions, first, count)
        for k in range(3):
            for i in range(n):
                slopes[k, i] = 0.0
        status = dual_slopes(force.force, t, xs, vs, slopes)
        if status == NO_DUALS:
            break
        if status != OK:
            return status
        force.found[0] = EXACT
        add_slopes(slopes, a, n, directions, first, count)
    if status == NO_DUALS:
        force.found[0] = DIFFERENCES
        for direction in range(directions):
            status = add_difference(force, t, x, v, a, directions, direction)
            if status != OK:
                return status
    return OK


@jit
def in_duals(rows, x, n, directions, first, count):
    """Rows of duals <- values x, and slopes along ``count`` deviations from the first on."""
    for k in range(3):
        for i in range(n):
            place = k * x.shape[1] + n + i * directions + first
            rows[k, i] = dual(x[k, i], masked_load(flat(x), place, count))


@jit
def add_slopes(slopes, a, n, directions, first, count):
    """Add the slopes to the accelerations of these deviations."""
    numbers = flat(a)
    for k in range(3):
        for i in range(n):
            place = k * a.shape[1] + n + i * directions + first
            masked_store(numbers, place, masked_load(numbers, place, count) + slopes[k, i].slope, count)


@jit
def add_difference(force, t, x, v, a, directions, direction):
    """Add the slope along one deviation, by central differences, to its accelerations. Return a status."""
    never_inline()
    displaced, ahead, behind = force.displaced, force.ahead, force.behind
    n = ahead.shape[1]
    size, deviation = 0.0, 0.0
    for k in range(3):
        for i in range(n):
            own = n + i * directions + direction
            size = max(size, abs(x[k, i]), abs(v[k, i]))
            deviation = max(deviation, abs(x[k, own]), abs(v[k, own]))
    h = STEP * size / deviation if size > 0.0 and deviation > 0.0 else STEP
    for sign in (1.0, -1.0):
        there = ahead if sign > 0.0 else behind
        for k in range(3):
            for i in range(n):
                own = n + i * directions + direction
                displaced[0, k, i] = x[k, i] + sign * h * x[k, own]
                displaced[1, k, i] = v[k, i] + sign * h * v[k, own]
                there[k, i] = 0.0
        status = run_body(force.force, t, displaced[0], displaced[1], there, None)
        if status != OK:
            return status
    for k in range(3):
        for i in range(n):
            a[k, n + i * directions + direction] += (ahead[k, i] - behind[k, i]) / (2.0 * h)
    return OK

"""The compiled variations of forces."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from kickdrift.forces.gravity_slope import Sources, acceleration_and_slope, sources_of
from kickdrift.forces.kernel import OK, kernel, run_body
from kickdrift.jit.chunks import Chunks, chunk_task, each_chunk, in_chunks
from kickdrift.jit.compile import never_inline

if TYPE_CHECKING:
    from kickdrift.model.system import System

STEP = float(np.cbrt(np.finfo(float).eps))  # relative displacement of central differences


class VariedGravity(NamedTuple):
    """Gravity and its variation in closed form."""

    force: Any  # bound to the particles without deviations
    phase: NDArray[np.float64]  # (2, 3, n) positions and velocities of the particles
    a: NDArray[np.float64]  # (3, n) accelerations of the particles
    sources: Sources
    chunks: Chunks


class VariedForce(NamedTuple):
    """Any force, and its variation by central differences."""

    force: Any
    phase: NDArray[np.float64]
    a: NDArray[np.float64]
    displaced: NDArray[np.float64]  # (2, 3, n)
    ahead: NDArray[np.float64]  # (3, n)
    behind: NDArray[np.float64]  # (3, n)


def bind(force: Any, system: System, threads: int, analytic: bool) -> VariedGravity | VariedForce:
    """Return the force of a System for its particles and deviations."""
    n = len(system)
    room = force.bind(system, threads), np.zeros((2, 3, n)), np.zeros((3, n))
    if analytic:
        return VariedGravity(*room, sources_of(force, system), in_chunks(n, threads))
    return VariedForce(*room, np.zeros((2, 3, n)), np.zeros((3, n)), np.zeros((3, n)))


@chunk_task
def slope_of_acceleration(varied, i):
    """Return the variation of the acceleration of body i."""
    never_inline()
    acceleration_and_slope(varied.sources, i)


@kernel(VariedGravity)
def varied_gravity(force, t, x, v, a, sums):
    phase, own, sources = force.phase, force.a, force.sources
    n = own.shape[1]
    for k in range(3):
        for i in range(n):
            phase[0, k, i], phase[1, k, i], own[k, i] = x[k, i], v[k, i], 0.0
            sources.x[k, i], sources.u[k, i] = x[k, i], x[k, n + i]
    status = run_body(force.force, t, phase[0], phase[1], own, sums)
    if status != OK:
        return status
    each_chunk(force, force.chunks, "slope_of_acceleration")
    for k in range(3):
        for i in range(n):
            a[k, i] += own[k, i]
            a[k, n + i] += sources.slope[k, i]
    return OK


@kernel(VariedForce)
def varied_force(force, t, x, v, a, sums):
    phase, own, displaced = force.phase, force.a, force.displaced
    ahead, behind = force.ahead, force.behind
    n = own.shape[1]
    size, deviation = 0.0, 0.0
    for k in range(3):
        for i in range(n):
            phase[0, k, i], phase[1, k, i], own[k, i] = x[k, i], v[k, i], 0.0
            size = max(size, abs(x[k, i]), abs(v[k, i]))
            deviation = max(deviation, abs(x[k, n + i]), abs(v[k, n + i]))
    status = run_body(force.force, t, phase[0], phase[1], own, sums)
    if status != OK:
        return status
    h = STEP * size / deviation if size > 0.0 and deviation > 0.0 else STEP
    for sign in (1.0, -1.0):
        there = ahead if sign > 0.0 else behind
        for k in range(3):
            for i in range(n):
                displaced[0, k, i] = x[k, i] + sign * h * x[k, n + i]
                displaced[1, k, i] = v[k, i] + sign * h * v[k, n + i]
                there[k, i] = 0.0
        status = run_body(force.force, t, displaced[0], displaced[1], there, None)
        if status != OK:
            return status
    for k in range(3):
        for i in range(n):
            a[k, i] += own[k, i]
            a[k, n + i] += (ahead[k, i] - behind[k, i]) / (2.0 * h)
    return OK

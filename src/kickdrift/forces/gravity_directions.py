"""Slopes of gravity along many deviations at once, eight in the lanes of a register."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from kickdrift.forces.central import gravitational_constant
from kickdrift.forces.kernel import OK, kernel, run_body
from kickdrift.jit.compile import as_written, in_order, never_inline
from kickdrift.jit.memory import flat, masked_load, masked_store
from kickdrift.jit.vector3 import dot, vector3
from kickdrift.jit.vectors import WIDTH

if TYPE_CHECKING:
    from kickdrift.forces.gravity import Gravity
    from kickdrift.model.system import System


class GravityAlong(NamedTuple):
    """Gravity and its variations in closed form, along any number of deviations."""

    force: Any  # bound to the particles without deviations
    phase: NDArray[np.float64]  # (2, 3, n) positions and velocities of the particles
    a: NDArray[np.float64]  # (3, n) accelerations of the particles
    softening2: float
    gm: NDArray[np.float64]  # (n,)
    varied_gm: NDArray[np.float64]  # (n directions,) slope of G m along each deviation; empty if masses stay


def bind(force: Gravity, system: System, threads: int, masses: NDArray[np.float64] | None) -> GravityAlong:
    """Bind gravity to a System, its deviations, and the slopes of its masses (n, directions)."""
    n, G = len(system), gravitational_constant(force.name, force.G, system)
    varied = np.zeros(0) if masses is None else np.ascontiguousarray(G * masses).reshape(-1)
    room = force.bind(system, threads), np.zeros((2, 3, n)), np.zeros((3, n))
    return GravityAlong(*room, force.softening**2, G * system.state.masses, varied)


@kernel(GravityAlong)
def gravity_along(force, t, x, v, a, sums):
    phase, own = force.phase, force.a
    n = own.shape[1]
    for k in range(3):
        for i in range(n):
            phase[0, k, i], phase[1, k, i], own[k, i] = x[k, i], v[k, i], 0.0
    status = run_body(force.force, t, phase[0], phase[1], own, sums)
    if status != OK:
        return status
    for k in range(3):
        for i in range(n):
            a[k, i] += own[k, i]
    slopes_of_pairs(force, x, a)
    return OK


@in_order
def slopes_of_pairs(force, x, a):
    """Add the slopes of all pairs' accelerations: w (u - 3 d (d . u) / r^2) with w = G m / r^3, for the separation d
    and its deviation u; and d / r^3 times the slope of G m."""
    never_inline()
    n, size = force.a.shape[1], x.shape[1]
    directions = size // n - 1
    for i in range(n):
        for j in range(i):
            if force.gm[i] == 0.0 and force.gm[j] == 0.0 and force.varied_gm.size == 0:
                continue
            d = vector3(x[0, j] - x[0, i], x[1, j] - x[1, i], x[2, j] - x[2, i])
            inverse = 1.0 / math.sqrt(dot(d, d) + force.softening2)
            weight, square = inverse * inverse * inverse, 3.0 * inverse * inverse
            for first in range(0, directions, WIDTH):
                count = min(WIDTH, directions - first)
                own, other = i * directions + first, j * directions + first
                u = vectors_at(x, n + other, size, count) - vectors_at(x, n + own, size, count)
                slope = weight * (u - (square * dot(u, d)) * d)
                on_own, on_other = force.gm[j] * slope, -force.gm[i] * slope
                if force.varied_gm.size > 0:
                    pull = weight * d
                    on_own = on_own + masked_load(force.varied_gm, other, count) * pull
                    on_other = on_other - masked_load(force.varied_gm, own, count) * pull
                add_vectors(a, n + own, size, count, on_own)
                add_vectors(a, n + other, size, count, on_other)


@as_written
def vectors_at(x, place, size, count):
    """Load ``count`` of eight vectors."""
    x = flat(x)
    return vector3(
        masked_load(x, place, count), masked_load(x, size + place, count), masked_load(x, 2 * size + place, count)
    )


@as_written
def add_vectors(a, place, size, count, slope):
    """Add ``count`` of eight vectors."""
    total = vectors_at(a, place, size, count) + slope
    a = flat(a)
    masked_store(a, place, total.x, count)
    masked_store(a, size + place, total.y, count)
    masked_store(a, 2 * size + place, total.z, count)

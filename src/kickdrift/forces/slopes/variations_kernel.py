"""The compiled variations of forces, along any number of deviations and by numbers; for gravity to second order.

Particle i of the System has the deviations ``n + i * directions`` to ``n + (i + 1) * directions - 1``.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from kickdrift.forces.gravity.slope import (
    ByBodies,
    Sources,
    acceleration_and_slope,
    by_bodies,
    slopes_by_bodies,
    sources_of,
)
from kickdrift.forces.laws.central import gravitational_constant
from kickdrift.forces.seam.kernel import OK, kernel, run_body
from kickdrift.forces.slopes.dual_slopes import NO_DUALS, dual_slopes
from kickdrift.jit.compile import as_written, in_order, jit, never_inline
from kickdrift.jit.duals.dual import SLOT, dual, dual_rows
from kickdrift.jit.lanes.memory import aligned, flat, load, masked_load, masked_store, store
from kickdrift.jit.lanes.vector3 import dot, load3, store3, vector3
from kickdrift.jit.lanes.vectors import WIDTH
from kickdrift.jit.threads.chunks import Chunks, chunk_task, each_chunk, in_chunks

if TYPE_CHECKING:
    from kickdrift.forces.gravity.direct import Gravity
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


def bind_variations(force: Any, system: System, threads: int, analytic: bool) -> VariedGravity | VariedForce:
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


CHEAPER = 2.05  # an operation with bodies in the lanes takes so many times less than one with deviations (measured)


class GravityAlong(NamedTuple):
    """Gravity and its variations in closed form, along any number of deviations.

    The first ``first`` deviations are of order 1. Behind them are those of order 2, one for each pair of these in the
    order (0, 0), (0, 1), …, (1, 1), (1, 2), …; there may be none.
    """

    force: Any  # bound to the particles without deviations
    phase: NDArray[np.float64]  # (2, 3, n) positions and velocities of the particles
    a: NDArray[np.float64]  # (3, n) accelerations of the particles
    softening2: float
    gm: NDArray[np.float64]  # (n,)
    varied_gm: NDArray[np.float64]  # (n directions,) slope of G m along each deviation; empty if masses stay
    first: int
    by_bodies: ByBodies
    few: bool  # bodies take the lanes, in place of deviations
    apart: NDArray[np.float64]  # (4, first and more) room for the separations of two bodies' deviations of order 1


def bind_directions(
    force: Gravity, system: System, threads: int, masses: NDArray[np.float64] | None, along: int, first: int
) -> GravityAlong:
    """Bind gravity to a System, its deviations, and the slopes of its masses (n, directions)."""
    n, G = len(system), gravitational_constant(force.name, force.G, system)
    varied = np.zeros(0) if masses is None else np.ascontiguousarray(G * masses).reshape(-1)
    gm, room = G * system.state.masses, (force.bind(system, threads), np.zeros((2, 3, n)), np.zeros((3, n)))
    lanes = by_bodies(gm, varied, along, first)
    few = prefers_bodies(n, len(lanes.sources), along, first)
    return GravityAlong(*room, force.softening**2, gm, varied, first, lanes, few, np.zeros((4, first + 2 * WIDTH)))


def prefers_bodies(n: int, sources: int, along: int, first: int) -> bool:
    """Whether lanes of bodies take less time than lanes of deviations, by the number of register operations."""
    light = n - sources
    pairs = (n * (n - 1) - light * (light - 1)) // 2
    chunks = -(-first // WIDTH)
    if along > first:
        chunks += sum(-(-(first - one) // WIDTH) for one in range(first))
    return sources * -(-n // WIDTH) * along <= CHEAPER * pairs * chunks


@kernel(GravityAlong)
def gravity_along(force, t, x, v, a, sums):
    status = add_own(force, t, x, v, a, sums)
    if status != OK:
        return status
    if force.few:
        slopes_by_bodies(force, x, a)
        return OK
    slopes_of_pairs(force, x, a)
    if x.shape[1] > force.a.shape[1] * (1 + force.first):
        second_slopes_of_pairs(force, x, a)
    return OK


@in_order
def slopes_of_pairs(force, x, a):
    """Add the slopes of all pairs' accelerations along deviations of order 1: w (u - 3 d (d . u) / r^2) with w = G m /
    r^3, for the separation d and its deviation u; and d / r^3 times the slope of G m."""
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
            for first in range(0, force.first, WIDTH):
                count = min(WIDTH, force.first - first)
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


@in_order
def second_slopes_of_pairs(force, x, a):
    """Add the slopes along deviations of order 2, and what two deviations u and w of order 1 do together: for all pairs
    of bodies, G m times -3 ((d . u) w + (d . w) u + (u . w) d - 5 (d . u) (d . w) d / r^2) / r^5, and the slope along
    each of them times the slope of G m along the other."""
    never_inline()
    n, size, first, apart = force.a.shape[1], x.shape[1], force.first, flat(force.apart)
    directions, room = size // n - 1, force.apart.shape[1]
    for i in range(n):
        for j in range(i):
            if force.gm[i] == 0.0 and force.gm[j] == 0.0 and force.varied_gm.size == 0:
                continue
            d = vector3(x[0, j] - x[0, i], x[1, j] - x[1, i], x[2, j] - x[2, i])
            inverse = 1.0 / math.sqrt(dot(d, d) + force.softening2)
            weight, square = inverse * inverse * inverse, inverse * inverse
            row, other = n + i * directions, n + j * directions
            for one in range(0, first, WIDTH):  # the separations of order 1, and their parts along d
                count = min(WIDTH, first - one)
                u = vectors_at(x, other + one, size, count) - vectors_at(x, row + one, size, count)
                store3(apart, one, room, u)
                store(apart, 3 * room + one, dot(u, d))
            column = first
            for one in range(first):
                u = vector3(apart[one], apart[room + one], apart[2 * room + one])
                ud = apart[3 * room + one]
                for two in range(one, first, WIDTH):
                    count = min(WIDTH, first - two)
                    w, wd = load3(apart, two, room), load(apart, 3 * room + two)
                    s = vectors_at(x, other + column, size, count) - vectors_at(x, row + column, size, count)
                    bend = ud * w + wd * u + (dot(w, u) + dot(s, d) - (5.0 * square * ud) * wd) * d
                    slope = weight * (s - (3.0 * square) * bend)
                    on_own, on_other = force.gm[j] * slope, -force.gm[i] * slope
                    if force.varied_gm.size > 0:
                        along_u = weight * (u - (3.0 * square * ud) * d)
                        along_w = weight * (w - (3.0 * square * wd) * d)
                        own_gm, other_gm = i * directions, j * directions
                        on_own = on_own + force.varied_gm[other_gm + one] * along_w
                        on_own = on_own + masked_load(force.varied_gm, other_gm + two, count) * along_u
                        on_other = on_other - force.varied_gm[own_gm + one] * along_w
                        on_other = on_other - masked_load(force.varied_gm, own_gm + two, count) * along_u
                    add_vectors(a, row + column, size, count, on_own)
                    add_vectors(a, other + column, size, count, on_other)
                    column += count


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


class PushKernel(NamedTuple):
    """A force at four values of a number."""

    ahead: Any
    behind: Any
    far_ahead: Any
    far_behind: Any
    column: int
    size: float
    phase: NDArray[np.float64]  # (2, 3, n)
    a: NDArray[np.float64]  # (3, n)


def bind(bound: list[Any], n: int, column: int, size: float) -> PushKernel:
    """Bind the four copies of a force."""
    ahead, behind, far_ahead, far_behind = bound
    return PushKernel(ahead, behind, far_ahead, far_behind, column, size, np.zeros((2, 3, n)), np.zeros((3, n)))


@kernel(PushKernel)
def push_column(force, t, x, v, a, sums):
    phase = force.phase
    n = phase.shape[2]
    for k in range(3):
        for i in range(n):
            phase[0, k, i], phase[1, k, i] = x[k, i], v[k, i]
    status = add_weighted(force.ahead, force, t, a, 8.0 / 12.0)
    if status == OK:
        status = add_weighted(force.behind, force, t, a, -8.0 / 12.0)
    if status == OK:
        status = add_weighted(force.far_ahead, force, t, a, -1.0 / 12.0)
    if status == OK:
        status = add_weighted(force.far_behind, force, t, a, 1.0 / 12.0)
    return status


@jit
def add_weighted(copy, force, t, a, weight):
    """Add a multiple of a copy's accelerations to those of the column. Return a status."""
    never_inline()
    phase, own = force.phase, force.a
    n = own.shape[1]
    directions = a.shape[1] // n - 1
    own[:, :] = 0.0
    status = run_body(copy, t, phase[0], phase[1], own, None)
    for k in range(3):
        for i in range(n):
            a[k, n + i * directions + force.column] += weight * force.size * own[k, i]
    return status

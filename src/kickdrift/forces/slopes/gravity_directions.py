"""Slopes of gravity along many deviations at once, eight in the lanes of a register, and its second derivatives."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from kickdrift.forces.gravity.by_bodies import ByBodies, by_bodies, slopes_by_bodies
from kickdrift.forces.laws.central import gravitational_constant
from kickdrift.forces.seam.kernel import OK, kernel
from kickdrift.forces.slopes.variations_kernel import add_own
from kickdrift.jit.compile import as_written, in_order, never_inline
from kickdrift.jit.lanes.memory import flat, load, masked_load, masked_store, store
from kickdrift.jit.lanes.vector3 import dot, load3, store3, vector3
from kickdrift.jit.lanes.vectors import WIDTH

if TYPE_CHECKING:
    from kickdrift.forces.gravity.direct import Gravity
    from kickdrift.model.system import System


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


def bind(
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

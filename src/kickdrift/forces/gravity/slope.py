"""Direct sum of gravity with its slopes and second derivatives.

Along the velocities the slope is the time derivative: the jerk of Hermite methods. Along a deviation vector it is the
right-hand side of the variational equations. For few deviations, eight bodies in the lanes of a register waste less
than eight deviations in the lanes, as `variations_kernel` has them.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from numpy.typing import NDArray

from kickdrift.forces.laws.central import gravitational_constant
from kickdrift.jit.compile import in_order, jit, never_inline
from kickdrift.jit.lanes.functions import inverse_sqrt, lane_numbers, splat
from kickdrift.jit.lanes.gathering import add_strided, strided, transposed
from kickdrift.jit.lanes.masks import select
from kickdrift.jit.lanes.memory import aligned, flat, load, masked_load, masked_store, store
from kickdrift.jit.lanes.vector3 import dot, lane_sums, load3, numbers3, store3, thrice
from kickdrift.jit.lanes.vectors import WIDTH

if TYPE_CHECKING:
    from kickdrift.forces.gravity.direct import Gravity
    from kickdrift.model.subject import Subject


class Sources(NamedTuple):
    """Attracting bodies, padded with massless ones to a multiple of eight, and the results for them."""

    softening2: float
    gm: NDArray[np.float64]  # (slots,) G m
    x: NDArray[np.float64]  # (3, slots) positions
    u: NDArray[np.float64]  # (3, slots) velocities or deviations
    a: NDArray[np.float64]  # (3, n) accelerations
    slope: NDArray[np.float64]  # (3, n) change of the accelerations when each body moves along its u


def sources_of(force: Gravity, system: Subject) -> Sources:
    """Bind the force to a System."""
    n = len(system)
    slots = WIDTH * -(-n // WIDTH)
    gm = np.zeros(slots)
    gm[:n] = gravitational_constant(force.name, force.G, system) * system.state.masses
    return Sources(
        force.softening**2, gm, np.zeros((3, slots)), np.zeros((3, slots)), np.zeros((3, n)), np.zeros((3, n))
    )


@jit
def acceleration_and_slope(sources, i):
    """Compute a = sum G m d / r^3 and its slope sum G m (u - 3 d (d . u) / r^2) / r^3 for body i.

    d and u are the sources' values minus the body's own, and r^2 = d^2 + softening^2 (Makino & Aarseth 1992,
    doi:10.1093/pasj/44.2.141, eqs. 1 and 2).
    """
    gm, softening2, zero = sources.gm, sources.softening2, splat(0.0)
    slots, n = gm.size, sources.a.shape[1]
    xi, ui = numbers3(sources.x, i, slots), numbers3(sources.u, i, slots)
    a, slope = thrice(zero), thrice(zero)
    for j in range(0, slots, WIDTH):
        d, u = load3(sources.x, j, slots) - xi, load3(sources.u, j, slots) - ui
        source = select(lane_numbers() == float(i - j), zero, load(gm, j))  # all bodies but the body itself
        massive = source > 0.0
        inverse = 1.0 / math.sqrt(dot(d, d) + softening2)
        inverse2 = inverse * inverse
        w = select(massive, source * inverse * inverse2, zero)
        along = select(massive, 3.0 * inverse2 * dot(d, u), zero)
        a, slope = a + w * d, slope + w * (u - along * d)
    store3(sources.a, i, n, lane_sums(a))
    store3(sources.slope, i, n, lane_sums(slope))


FEW = 3  # so few columns go number by number
SIZE, APART = 6 * WIDTH, 4 * WIDTH  # numbers for eight bodies and one source; for a deviation of these


class ByBodies(NamedTuple):
    """Room for deviations with bodies in lanes. ``slots`` are the bodies, padded to whole lanes."""

    sources: NDArray[np.int64]  # bodies with a mass, or with one that varies
    slots: int
    places: NDArray[np.float64]  # (3 slots,) positions
    own: NDArray[np.float64]  # (directions 3 slots,) deviations
    found: NDArray[np.float64]  # (directions 3 slots,) their accelerations
    pairs: NDArray[np.float64]  # (sources SIZE,) separation d, 1 / r^3, G m / r^3 and 3 / r^2
    apart: NDArray[np.float64]  # (first sources APART,) deviation u of the separation, and d . u; for order 2 alone


def by_bodies(gm: NDArray[np.float64], varied_gm: NDArray[np.float64], directions: int, first: int) -> ByBodies:
    """Make room for these masses, slopes of masses (n directions,), and deviations."""
    n = len(gm)
    slots, massive = WIDTH * -(-n // WIDTH), gm != 0.0
    if varied_gm.size:
        massive |= varied_gm.reshape(n, -1).any(axis=1)
    sources = np.flatnonzero(massive)
    own, found = (aligned((WIDTH * -(-directions // WIDTH) * 3 * slots,)) for _ in range(2))
    apart = aligned((first * len(sources) * APART if directions > first else 0,))
    return ByBodies(sources, slots, aligned((3 * slots,)), own, found, aligned((len(sources) * SIZE,)), apart)


@in_order
def eight_rows(x, place, stride, rows, count):
    """Return ``count`` numbers of each of ``rows`` rows, as a tuple of eight; the last row fills the rest."""
    last = rows - 1
    return (
        masked_load(x, place, count),
        masked_load(x, place + min(1, last) * stride, count),
        masked_load(x, place + min(2, last) * stride, count),
        masked_load(x, place + min(3, last) * stride, count),
        masked_load(x, place + min(4, last) * stride, count),
        masked_load(x, place + min(5, last) * stride, count),
        masked_load(x, place + min(6, last) * stride, count),
        masked_load(x, place + min(7, last) * stride, count),
    )


@in_order
def fill_deviations(force, x, n, directions):
    """places and own <- positions and deviations."""
    never_inline()
    room = force.by_bodies
    own, slots, numbers = room.own, room.slots, flat(x)
    stride = 3 * slots
    for k in range(3):
        row = k * x.shape[1]
        for b in range(0, n, WIDTH):
            bodies, place = min(WIDTH, n - b), row + n + b * directions
            store(room.places, k * slots + b, masked_load(numbers, row + b, bodies))
            for column in range(0, directions, WIDTH):
                count, to = min(WIDTH, directions - column), (3 * column + k) * slots + b
                if directions == 1:
                    store(own, to, masked_load(numbers, place, bodies))
                    continue
                if count <= FEW:
                    for c in range(count):
                        store(own, to + c * stride, strided(numbers, place + column + c, directions, bodies))
                    continue
                lanes = transposed(eight_rows(numbers, place + column, directions, bodies, count))
                store(own, to, lanes[0])
                store(own, to + stride, lanes[1])
                store(own, to + 2 * stride, lanes[2])
                store(own, to + 3 * stride, lanes[3])
                store(own, to + 4 * stride, lanes[4])
                store(own, to + 5 * stride, lanes[5])
                store(own, to + 6 * stride, lanes[6])
                store(own, to + 7 * stride, lanes[7])


@in_order
def add_found(force, a, n, directions):
    """Add the results to the accelerations."""
    never_inline()
    room = force.by_bodies
    found, slots, numbers = room.found, room.slots, flat(a)
    stride = 3 * slots
    for k in range(3):
        for b in range(0, n, WIDTH):
            bodies, place = min(WIDTH, n - b), k * a.shape[1] + n + b * directions
            for column in range(0, directions, WIDTH):
                count, at, to = min(WIDTH, directions - column), (3 * column + k) * slots + b, place + column
                if directions == 1:
                    masked_store(numbers, to, masked_load(numbers, to, bodies) + load(found, at), bodies)
                    continue
                if count <= FEW:
                    for c in range(count):
                        add_strided(numbers, to + c, directions, bodies, load(found, at + c * stride))
                    continue
                rows = transposed(eight_rows(found, at, stride, count, WIDTH))
                before = eight_rows(numbers, to, directions, bodies, count)  # all before a store: rows overlap
                masked_store(numbers, to, before[0] + rows[0], count)
                if bodies > 1:
                    masked_store(numbers, to + directions, before[1] + rows[1], count)
                if bodies > 2:
                    masked_store(numbers, to + 2 * directions, before[2] + rows[2], count)
                if bodies > 3:
                    masked_store(numbers, to + 3 * directions, before[3] + rows[3], count)
                if bodies > 4:
                    masked_store(numbers, to + 4 * directions, before[4] + rows[4], count)
                if bodies > 5:
                    masked_store(numbers, to + 5 * directions, before[5] + rows[5], count)
                if bodies > 6:
                    masked_store(numbers, to + 6 * directions, before[6] + rows[6], count)
                if bodies > 7:
                    masked_store(numbers, to + 7 * directions, before[7] + rows[7], count)


@in_order
def fill_pairs(force, b):
    """pairs <- what eight bodies from slot b on, and each source, need."""
    never_inline()
    room = force.by_bodies
    pairs, own = room.pairs, load3(room.places, b, room.slots)
    for s in range(room.sources.size):
        j, at = room.sources[s], s * SIZE
        d = numbers3(room.places, j, room.slots) - own
        inverse = inverse_sqrt(dot(d, d) + force.softening2)
        inverse = select(lane_numbers() == float(j - b), splat(0.0), inverse)  # the body itself
        inverse2 = inverse * inverse
        store3(pairs, at, WIDTH, d)
        store(pairs, at + 3 * WIDTH, inverse * inverse2)
        store(pairs, at + 4 * WIDTH, force.gm[j] * inverse * inverse2)
        store(pairs, at + 5 * WIDTH, 3.0 * inverse2)


@in_order
def fill_first(force, room, b, column, directions, keep):
    """found <- slopes of the accelerations of eight bodies along a deviation of order 1. With ``keep``, apart <- what
    second derivatives need."""
    pairs, own, slots, count = room.pairs, room.own, room.slots, room.sources.size
    base = 3 * column * slots
    mine, total = load3(own, base + b, slots), thrice(splat(0.0))
    for s in range(count):
        j, at = room.sources[s], s * SIZE
        d, u = load3(pairs, at, WIDTH), numbers3(own, base + j, slots) - mine
        along = dot(u, d)
        total = total + load(pairs, at + 4 * WIDTH) * (u - (load(pairs, at + 5 * WIDTH) * along) * d)
        if force.varied_gm.size > 0:
            total = total + (force.varied_gm[j * directions + column] * load(pairs, at + 3 * WIDTH)) * d
        if keep:
            place = (column * count + s) * APART
            store3(room.apart, place, WIDTH, u)
            store(room.apart, place + 3 * WIDTH, along)
    store3(room.found, base + b, slots, total)


@in_order
def fill_second(force, room, b, one, two, column, directions):
    """found <- the accelerations of eight bodies along a deviation of order 2, see
    `variations_kernel.second_slopes_of_pairs`."""
    pairs, own, slots, count = room.pairs, room.own, room.slots, room.sources.size
    base, apart = 3 * column * slots, room.apart
    mine, total = load3(own, base + b, slots), thrice(splat(0.0))
    for s in range(count):
        j, at, left, right = room.sources[s], s * SIZE, (one * count + s) * APART, (two * count + s) * APART
        d, square = load3(pairs, at, WIDTH), load(pairs, at + 5 * WIDTH)
        u, ud = load3(apart, left, WIDTH), load(apart, left + 3 * WIDTH)
        w, wd = load3(apart, right, WIDTH), load(apart, right + 3 * WIDTH)
        q = numbers3(own, base + j, slots) - mine
        bend = ud * w + wd * u + (dot(w, u) + dot(q, d) - ((5.0 / 3.0) * square * ud) * wd) * d
        total = total + load(pairs, at + 4 * WIDTH) * (q - square * bend)
        if force.varied_gm.size > 0:
            weight, row = load(pairs, at + 3 * WIDTH), j * directions
            total = total + (force.varied_gm[row + one] * weight) * (w - (square * wd) * d)
            total = total + (force.varied_gm[row + two] * weight) * (u - (square * ud) * d)
    store3(room.found, base + b, slots, total)


@in_order
def each_first(force, b, directions):
    """found <- slopes along all deviations of order 1."""
    never_inline()
    for column in range(force.first):
        fill_first(force, force.by_bodies, b, column, directions, directions > force.first)


@in_order
def each_second(force, b, directions):
    """found <- accelerations along all deviations of order 2."""
    never_inline()
    column = force.first
    for one in range(force.first):
        for two in range(one, force.first):
            fill_second(force, force.by_bodies, b, one, two, column, directions)
            column += 1


@in_order
def slopes_by_bodies(force, x, a):
    """Add the slopes of all accelerations along deviations of order 1 and 2."""
    n = force.a.shape[1]
    directions = x.shape[1] // n - 1
    fill_deviations(force, x, n, directions)
    for b in range(0, force.by_bodies.slots, WIDTH):
        fill_pairs(force, b)
        each_first(force, b, directions)
        if directions > force.first:
            each_second(force, b, directions)
    add_found(force, a, n, directions)

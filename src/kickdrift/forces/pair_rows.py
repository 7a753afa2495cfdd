"""The steps of the pair sum, for each width of lanes: one particle, or two, against a cluster.

The argument ``zero`` holds zeros in all lanes of a step; its type selects the functions' number of lanes.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numba import types

from kickdrift.forces.clusters import (
    APART,
    SHIFTS,
    STRIDE,
    load_vector,
    store_vector,
    table_place,
)
from kickdrift.jit.compile import as_written
from kickdrift.jit.inner import overload
from kickdrift.jit.lanes import in_eight, lane_numbers, multiply_add
from kickdrift.jit.masks import lowest_bit, select
from kickdrift.jit.memory import broadcast, load, load_like, store
from kickdrift.jit.single import (
    halves,
    load_single,
    load_twice,
    store_narrow,
    two_of,
)
from kickdrift.jit.vectors import F64, WIDTH, single_type

PLACES = (
    table_place.py_func(2, 1, 0),
    table_place.py_func(2, 0, 1),
)  # distances in the table between shifts and between rows, for rows of two particles


def working_arrays(zero: Any, pairs: Any, c: int) -> Any:
    """Return positions, reactions of chunk c and an empty table, in the precision of the pairs."""
    raise NotImplementedError("for compiled code")


@overload(working_arrays)
def _working_arrays(zero, pairs, c):
    if zero.vector.element == F64:
        return lambda zero, pairs, c: (pairs.x, pairs.force[c], np.empty(SHIFTS * STRIDE))
    size = SHIFTS * (PLACES[0] if zero == single_type else STRIDE)
    return lambda zero, pairs, c: (pairs.x_single, pairs.force_single[c], np.empty(size, np.float32))


def particle_of(zero: Any, place: int) -> int:
    """Return the index in its cluster of a row's (first) particle, from the row's place in the table."""
    raise NotImplementedError("for compiled code")


@overload(particle_of)
def _particle_of(zero, place):
    if zero == single_type:
        per_shift, per_row = PLACES
        return lambda zero, place: 2 * (place % per_shift // per_row)
    return lambda zero, place: place % STRIDE


@as_written
def slot_of(other):
    """Return the slot of the particle whose x is at ``other``."""
    return other // STRIDE * WIDTH + other % STRIDE


def fill_table(table: Any, pairs: Any, cluster: int, used: int, zero: Any) -> None:
    """Fill the table with a cluster's positions minus each shift in use; a look-up is cheaper than a subtraction in
    each step."""


@overload(fill_table)
def _fill_table(table, pairs, cluster, used, zero):
    def double(table, pairs, cluster, used, zero):
        shifts = pairs.shifts
        x, y, z = load_vector(pairs.x, cluster)
        while used:
            s = lowest_bit(used)
            used &= used - 1
            store_vector(table, s, x - shifts[0, s], y - shifts[1, s], z - shifts[2, s])

    def single(table, pairs, cluster, used, zero):
        shifts, origin = pairs.shifts, pairs.origin
        x, y, z = load_vector(pairs.x, cluster)
        while used:
            s = lowest_bit(used)
            used &= used - 1
            store_narrow(table, STRIDE * s, x - (shifts[0, s] + origin[0]))
            store_narrow(table, STRIDE * s + WIDTH, y - (shifts[1, s] + origin[1]))
            store_narrow(table, STRIDE * s + 2 * WIDTH, z - (shifts[2, s] + origin[2]))

    def twos(table, pairs, cluster, used, zero):
        shifts, origin = pairs.shifts, pairs.origin
        x, y, z = load_vector(pairs.x, cluster)
        # an empty second place of a row is further away than all other empty places, for every shift
        aside = 10 * APART * pairs.cutoff + 3 * pairs.cell.matrix[0, 0]
        x = select(lane_numbers() < float(pairs.filled[cluster]), x, x + aside)
        while used:
            s = lowest_bit(used)
            used &= used - 1
            store_twos(table, 8 * STRIDE * s, x - (shifts[0, s] + origin[0]))
            store_twos(table, 8 * STRIDE * s + 2 * WIDTH, y - (shifts[1, s] + origin[1]))
            store_twos(table, 8 * STRIDE * s + 4 * WIDTH, z - (shifts[2, s] + origin[2]))

    return double if zero.vector.element == F64 else twos if zero == single_type else single


@as_written
def store_twos(table, at, value):
    """Store lanes 0 and 1 eight times each in float32, then lanes 2 and 3 in the next row, and so on."""
    store(table, at, two_of(value, 0))
    store(table, at + 2 * STRIDE, two_of(value, 1))
    store(table, at + 4 * STRIDE, two_of(value, 2))
    store(table, at + 6 * STRIDE, two_of(value, 3))


def displacements(zero: Any, x: Any, table: Any, other: int, place: int) -> Any:
    """Return the displacements from the neighbours whose x begin at ``other`` to the row at ``place``."""


@overload(displacements)
def _displacements(zero, x, table, other, place):
    def one(zero, x, table, other, place):
        dx = broadcast(table, place, zero) - load_like(x, other, zero)
        dy = broadcast(table, place + WIDTH, zero) - load_like(x, other + WIDTH, zero)
        return dx, dy, broadcast(table, place + 2 * WIDTH, zero) - load_like(x, other + 2 * WIDTH, zero)

    def two(zero, x, table, other, place):
        dx = load_single(table, place) - load_twice(x, other)
        dy = load_single(table, place + 2 * WIDTH) - load_twice(x, other + WIDTH)
        return dx, dy, load_single(table, place + 4 * WIDTH) - load_twice(x, other + 2 * WIDTH)

    return two if zero == single_type else one


def subtract_reactions(reactions: Any, other: int, g: Any, dx: Any, dy: Any, dz: Any) -> None:
    """Add g times the displacements to the reactions on the neighbours whose x begin at ``other``."""


@overload(subtract_reactions)
def _subtract_reactions(reactions, other, g, dx, dy, dz):
    per_row = 2 if g == single_type else 1

    def add(reactions, other, g, dx, dy, dz):
        x, y, z = per_row * other, per_row * (other + WIDTH), per_row * (other + 2 * WIDTH)
        hx, hy, hz = load_like(reactions, x, g), load_like(reactions, y, g), load_like(reactions, z, g)
        store(reactions, x, multiply_add(g, dx, hx))
        store(reactions, y, multiply_add(g, dy, hy))
        store(reactions, z, multiply_add(g, dz, hz))

    return add


def store_row_force(row_sums: Any, row: int, fx: Any, fy: Any, fz: Any) -> None:
    """Store the forces on a row's particles, with the lanes not yet summed."""


@overload(store_row_force)
def _store_row_force(row_sums, row, fx, fy, fz):
    def one(row_sums, row, fx, fy, fz):
        store_vector(row_sums, row, in_float64(fx), in_float64(fy), in_float64(fz))

    def two(row_sums, row, fx, fy, fz):
        (x, x2), (y, y2), (z, z2) = halves(fx), halves(fy), halves(fz)
        store_vector(row_sums, 2 * row, x, y, z)
        store_vector(row_sums, 2 * row + 1, x2, y2, z2)

    return two if fx == single_type else one


def in_float64(value: Any) -> Any:
    """Return eight lanes of float64: 16 lanes are summed in pairs, four lanes are padded with four zeros."""


@overload(in_float64)
def _in_float64(value):
    def two(value):
        low, high = halves(value)
        return low + high

    return two if value == single_type else (lambda value: in_eight(value))


def clear(reactions: Any, cluster: int, zero: Any) -> None:
    """Set the reactions on a cluster to zero, unless the forces themselves hold them."""


@overload(clear)
def _clear(reactions, cluster, zero):
    per_row = 2 if zero == single_type else 1

    def single(reactions, cluster, zero):
        for k in range(3):
            store(reactions, per_row * (STRIDE * cluster + WIDTH * k), zero)

    return single if reactions.dtype == types.float32 else (lambda reactions, cluster, zero: None)


def add_reactions(forces: Any, reactions: Any, cluster: int, zero: Any) -> None:
    """Add the reactions on a cluster to its forces, unless the forces themselves hold them."""


@overload(add_reactions)
def _add_reactions(forces, reactions, cluster, zero):
    per_row = 2 if zero == single_type else 1

    def single(forces, reactions, cluster, zero):
        for k in range(3):
            p = STRIDE * cluster + WIDTH * k
            store(forces, p, load(forces, p) + in_float64(load_like(reactions, per_row * p, zero)))

    return single if reactions.dtype == types.float32 else (lambda forces, reactions, cluster, zero: None)

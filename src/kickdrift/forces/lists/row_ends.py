"""The ends of rows in the pair sum: how a row's forces begin anew, and where they go.

Rows of particles are short, and a processor cannot predict where each of many rows ends: it lost a sixth of the time of
the sum in large systems. With AVX-512 in float64, one loop therefore goes through all rows of a cluster, without a
branch at their ends. After each entry it stores the row's forces so far. Elsewhere each row has a loop of its own: rows
of tiles are longer, and with narrower vectors the stores take longer than the branches.

The argument ``zero`` holds zeros in all lanes of a step; its type selects the functions' number of lanes.
"""

from __future__ import annotations

from typing import Any

from kickdrift.forces.lists.clusters import STRIDE, store_vector
from kickdrift.forces.lists.pair_rows import in_float64
from kickdrift.forces.lists.row_lanes import Wide
from kickdrift.jit.compile import as_written
from kickdrift.jit.inner import overload
from kickdrift.jit.lanes.masks import less_than_next, select
from kickdrift.jit.lanes.memory import store, sums_of_rows, zero_unless_same
from kickdrift.jit.lanes.single import load_single, sums_in_quarters
from kickdrift.jit.lanes.vectors import WIDTH, single_type


def rows_in_one_loop(lanes: Any) -> int | None:
    """Return the number of rows that one loop goes through, all of a cluster, or None if each row has a loop."""
    raise NotImplementedError("for compiled code")


@overload(rows_in_one_loop)
def _rows_in_one_loop(lanes):
    return (lambda lanes: WIDTH) if lanes.instance_class is Wide else (lambda lanes: None)


@as_written
def row_of(place):
    """Return the number of a particle's row in its cluster, from the row's place in the table."""
    return place & (WIDTH - 1)


@as_written
def of_row(sums, place, before):
    """Return the sums of a row's forces up to its entry at ``place``: zeros where the entry ``before`` was another
    row's."""
    x, y, z = sums
    change = row_of(place ^ before)
    return zero_unless_same(x, change), zero_unless_same(y, change), zero_unless_same(z, change)


def store_row_force(row_sums: Any, row: int, fx: Any, fy: Any, fz: Any) -> None:
    """Store the forces on a row's particles, with the lanes not yet summed."""


@overload(store_row_force)
def _store_row_force(row_sums, row, fx, fy, fz):
    def one(row_sums, row, fx, fy, fz):
        store_vector(row_sums, row, in_float64(fx), in_float64(fy), in_float64(fz))

    def four(row_sums, row, fx, fy, fz):
        at = 2 * STRIDE * row
        store(row_sums, at, fx)
        store(row_sums, at + 2 * WIDTH, fy)
        store(row_sums, at + 4 * WIDTH, fz)

    return four if fx == single_type else one


def row_forces(row_sums: Any, axis: int, start: Any, first: int, zero: Any) -> Any:
    """Return one component of the forces on a cluster's particles, eight of float64, from what its rows have stored.

    The rows begin at ``start[first]``, ``start[first + 1]`` …"""
    raise NotImplementedError("for compiled code")


@overload(row_forces)
def _row_forces(row_sums, axis, start, first, zero):
    def four(row_sums, axis, start, first, zero):
        at = 2 * WIDTH * axis
        return sums_in_quarters(load_single(row_sums, at), load_single(row_sums, at + 2 * STRIDE))

    def one(row_sums, axis, start, first, zero):
        return particle_forces(row_sums, axis, start, first)

    return four if zero == single_type else one


@as_written
def particle_forces(row_sums, axis, start, first):
    """Return `row_forces` for rows of particles. Rows without entries may have stored nothing."""
    return select(less_than_next(start, first), sums_of_rows(row_sums, WIDTH * axis, STRIDE), 0.0)

"""The ends of rows in the pair sum: how a row's forces begin anew, and where they go.

Rows of particles are short, and a processor cannot predict where each of many rows ends: it lost a sixth of the time of
the sum in large systems. So one loop goes through all rows of a cluster, without a branch at their ends. After each
entry the loop stores the row's forces up to there, and the next row's forces overwrite nothing of them. A row of tiles
is long, so it has a loop of its own.

The argument ``zero`` holds zeros in all lanes of a step; its type selects the functions' number of lanes.
"""

from __future__ import annotations

from typing import Any

from kickdrift.forces.clusters import STRIDE, store_vector
from kickdrift.forces.pair_rows import in_float64
from kickdrift.jit.compile import as_written
from kickdrift.jit.inner import overload
from kickdrift.jit.masks import less_than_next, select
from kickdrift.jit.memory import store, sums_of_rows, zero_unless_same
from kickdrift.jit.single import load_single, sums_in_quarters
from kickdrift.jit.vectors import WIDTH, single_type


def rows_together(zero: Any) -> int:
    """Return the number of rows that one loop goes through: all of a cluster's particles, or one row of tiles."""
    raise NotImplementedError("for compiled code")


@overload(rows_together)
def _rows_together(zero):
    return (lambda zero: 1) if zero == single_type else (lambda zero: WIDTH)


def of_row(sums: Any, place: int, before: int) -> Any:
    """Return the sums of a row's forces up to its entry at ``place``: zeros where the entry ``before`` was another
    row's. The places are those in the cluster's table."""
    raise NotImplementedError("for compiled code")


@overload(of_row)
def _of_row(sums, place, before):
    def together(sums, place, before):
        x, y, z = sums
        change = (place ^ before) & (WIDTH - 1)
        return zero_unless_same(x, change), zero_unless_same(y, change), zero_unless_same(z, change)

    return (lambda sums, place, before: sums) if sums[0] == single_type else together


def store_so_far(row_sums: Any, place: int, fx: Any, fy: Any, fz: Any) -> None:
    """Store a row's forces after its entry at ``place``, if a loop goes through more than one row."""


@overload(store_so_far)
def _store_so_far(row_sums, place, fx, fy, fz):
    def together(row_sums, place, fx, fy, fz):
        store_row_force(row_sums, place & (WIDTH - 1), fx, fy, fz)

    return (lambda row_sums, place, fx, fy, fz: None) if fx == single_type else together


def store_at_end(row_sums: Any, row: int, fx: Any, fy: Any, fz: Any) -> None:
    """Store a row's forces after its loop, if each row has one."""


@overload(store_at_end)
def _store_at_end(row_sums, row, fx, fy, fz):
    def alone(row_sums, row, fx, fy, fz):
        store_row_force(row_sums, row, fx, fy, fz)

    return alone if fx == single_type else (lambda row_sums, row, fx, fy, fz: None)


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
    """Return `row_forces` for rows of particles. Rows without entries have stored nothing."""
    return select(less_than_next(start, first), sums_of_rows(row_sums, WIDTH * axis, STRIDE), 0.0)

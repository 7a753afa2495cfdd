"""The variation of a pair law along one deviation, for the sweep over the list that sums the forces.

The forces come from the same operations with and without a deviation, so their bits are the same.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numba import types
from numpy.typing import NDArray

from kickdrift.forces.lists.clusters import STRIDE, load_vector, store_vector
from kickdrift.forces.lists.row_ends import of_row, particle_forces, row_of, store_row_force
from kickdrift.forces.pairs.intra_cluster import terms_within
from kickdrift.forces.pairs.lanes import pair_slopes
from kickdrift.forces.pairs.special_slopes import broadcast_vector, react, variation
from kickdrift.jit.compile import as_written
from kickdrift.jit.duals.dual import dual
from kickdrift.jit.inner import overload
from kickdrift.jit.lanes.functions import rotated, splat
from kickdrift.jit.lanes.masks import select
from kickdrift.jit.lanes.vectors import WIDTH


class Deviation(NamedTuple):
    """One deviation of all particles, in the places of the list, with its slopes."""

    u: NDArray[np.float64]  # (3 slots,)
    s: NDArray[np.float64]  # (3 slots,)
    row_sums: NDArray[np.float64]  # slopes of a cluster's rows, not yet summed over lanes


@as_written
def slope_within(laws, i, j, r2, cutoff2):
    """Return twice the derivative by r^2 of the force over r of the pairs of `pair_terms`, zero beyond the cutoff."""
    _, h = pair_slopes(laws, i, j, r2)
    return select(r2 < cutoff2, h, 0.0)


@as_written
def row_deviation(deviation, cluster, row, zero):
    """Return the deviation of a row's particle in all lanes, and the zeros that its slope begins with."""
    return broadcast_vector(deviation.u, STRIDE * cluster + row, zero), (zero, zero, zero)


@as_written
def deviation_at(deviation, varied, cluster, place, before):
    """Return ``varied`` for the entry at ``place``: what `row_deviation` returns if the entry ``before`` was another
    row's."""
    (ux, _, _), slopes = varied
    return broadcast_vector(deviation.u, STRIDE * cluster + row_of(place), ux), of_row(slopes, place, before)


@as_written
def varied_row(deviation, varied, other, g, h, dx, dy, dz):
    """Return what `row_deviation` began with the variations of pairs added, and react on the neighbours."""
    (ux, uy, uz), (sx, sy, sz) = varied
    gx, gy, gz = react(deviation.u, deviation.s, other, ux, uy, uz, g, h, dx, dy, dz)
    return (ux, uy, uz), (sx + gx, sy + gy, sz + gz)


@as_written
def store_row_slope(deviation, row, varied):
    """Store the slope of a row's particle, not yet summed over lanes."""
    _, (sx, sy, sz) = varied
    store_row_force(deviation.row_sums, row, sx, sy, sz)


@as_written
def add_row_slopes(deviation, start, first, cluster):
    """Add the slopes of a cluster's rows; ``start`` and ``first`` are as in `row_forces`."""
    s, row_sums = deviation.s, deviation.row_sums
    sx, sy, sz = load_vector(s, cluster)
    sx, sy = sx + particle_forces(row_sums, 0, start, first), sy + particle_forces(row_sums, 1, start, first)
    store_vector(s, cluster, sx, sy, sz + particle_forces(row_sums, 2, start, first))


@as_written
def vary_cluster(deviation, laws, x, cluster, cutoff2):
    """Add the variations among a cluster's eight particles, in the order of `intra_cluster`."""
    at, own, u = WIDTH * cluster, load_vector(x, cluster), load_vector(deviation.u, cluster)
    sx, sy, sz = load_vector(deviation.s, cluster)
    gx, gy, gz = apart(laws, at, own, u, cutoff2, 1)
    sx, sy, sz = sx + (gx - rotated(gx, 7)), sy + (gy - rotated(gy, 7)), sz + (gz - rotated(gz, 7))
    gx, gy, gz = apart(laws, at, own, u, cutoff2, 2)
    sx, sy, sz = sx + (gx - rotated(gx, 6)), sy + (gy - rotated(gy, 6)), sz + (gz - rotated(gz, 6))
    gx, gy, gz = apart(laws, at, own, u, cutoff2, 3)
    sx, sy, sz = sx + (gx - rotated(gx, 5)), sy + (gy - rotated(gy, 5)), sz + (gz - rotated(gz, 5))
    gx, gy, gz = apart(laws, at, own, u, cutoff2, 4)
    store_vector(deviation.s, cluster, sx + gx, sy + gy, sz + gz)


def apart(laws: Any, at: int, own: Any, u: Any, cutoff2: float, places: int) -> Any:
    """Return the variations of the forces on the eight particles from slot ``at`` on by the particles ``places``
    further on."""
    raise NotImplementedError("for compiled code")


@overload(apart, prefer_literal=True)
def _apart(laws, at, own, u, cutoff2, places):
    if not isinstance(places, types.IntegerLiteral):
        return None

    def meets(laws, at, own, u, cutoff2, places):
        (x, y, z), (ux, uy, uz) = own, u
        dx, dy, dz = x - rotated(x, places), y - rotated(y, places), z - rotated(z, places)
        wx, wy, wz = ux - rotated(ux, places), uy - rotated(uy, places), uz - rotated(uz, places)
        r2 = dx * dx + dy * dy + dz * dz
        _, force_over_r = terms_within(laws, at, places, dual(r2, splat(2.0)))
        g, h = select(r2 < cutoff2, force_over_r.value, 0.0), select(r2 < cutoff2, force_over_r.slope, 0.0)
        return variation(g, h, dx, dy, dz, wx, wy, wz)

    return meets

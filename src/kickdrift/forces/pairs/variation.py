"""The variation of a pair law along one deviation, for the sweep over the list that sums the forces.

The forces come from the same operations with and without a deviation, so their bits are the same.

Special pairs, which the rows of a cluster list do not hold, are varied apart. There ``u`` and ``s`` hold the deviations
and their slopes, 3 slots for each deviation, in one row.
"""

from typing import NamedTuple

import numpy as np
from numba import types
from numpy.typing import NDArray

from kickdrift.forces.lists.clusters import SHIFT_BITS, STRIDE, load_vector, store_vector
from kickdrift.forces.lists.pair_rows import of_row, particle_forces, row_of, store_row_force
from kickdrift.forces.pairs.intra_cluster import terms_within
from kickdrift.forces.pairs.lanes import pair_slopes
from kickdrift.jit.compile import as_written
from kickdrift.jit.duals.dual import dual
from kickdrift.jit.inner import by_type
from kickdrift.jit.lanes.functions import lane_sum, rotated, splat
from kickdrift.jit.lanes.masks import select
from kickdrift.jit.lanes.memory import broadcast, load_like, store
from kickdrift.jit.lanes.tabled import by_bytes
from kickdrift.jit.lanes.vectors import WIDTH


@as_written
def variation(g, h, dx, dy, dz, wx, wy, wz):
    """Return the variation of the force g d of pairs, with h = 2 dg / d(r^2) and the differences w of deviations."""
    along = h * (dx * wx + dy * wy + dz * wz)
    return g * wx + along * dx, g * wy + along * dy, g * wz + along * dz


@as_written
def broadcast_vector(x, p, zero):
    """Return the vector whose x is at a place, in all lanes."""
    return broadcast(x, p, zero), broadcast(x, p + WIDTH, zero), broadcast(x, p + 2 * WIDTH, zero)


@as_written
def load_vector_like(x, p, zero):
    """Return the vectors whose x begin at a place, as many as ``zero`` has lanes."""
    return load_like(x, p, zero), load_like(x, p + WIDTH, zero), load_like(x, p + 2 * WIDTH, zero)


@as_written
def store_vector_like(x, p, a, b, c):
    """Write vectors whose x begin at a place."""
    store(x, p, a)
    store(x, p + WIDTH, b)
    store(x, p + 2 * WIDTH, c)


@as_written
def react(u, s, other, ux, uy, uz, g, h, dx, dy, dz):
    """Return the variations of pairs with the neighbours whose x begin at ``other``, and subtract them from the
    neighbours' slopes. The particles have the deviation (ux, uy, uz)."""
    wx, wy, wz = load_vector_like(u, other, g)
    gx, gy, gz = variation(g, h, dx, dy, dz, ux - wx, uy - wy, uz - wz)
    sx, sy, sz = load_vector_like(s, other, g)
    store_vector_like(s, other, sx - gx, sy - gy, sz - gz)
    return gx, gy, gz


@as_written
def add_special_slopes(special, laws, pairs, u, s, number, c, cutoff2):
    """Add the variations of chunk c's entries of special pairs."""
    if special is None:
        return
    x, shifts, zero, size = pairs.x, pairs.shifts, splat(0.0), pairs.x.size
    for e in range(special.number[c]):
        cluster, met, within = special.entries[c, e]
        other, shift = met >> SHIFT_BITS, met & 31
        xj, yj, zj = load_vector(x, other)
        xj, yj, zj = xj + shifts[0, shift], yj + shifts[1, shift], zj + shifts[2, shift]
        for row in range(WIDTH):
            if (within >> (WIDTH * row)) & 255 == 0:
                continue
            p, factor = STRIDE * cluster + row, by_bytes(special.factors, special.codes[c, e, row])
            dx, dy, dz = broadcast_vector(x, p, zero)
            dx, dy, dz = dx - xj, dy - yj, dz - zj
            r2 = select(factor > 0.0, dx * dx + dy * dy + dz * dz, 4.0 * cutoff2)
            g, h = pair_slopes(laws, WIDTH * cluster + row, STRIDE * other, r2)
            g, h = select(r2 < cutoff2, factor * g, 0.0), select(r2 < cutoff2, factor * h, 0.0)
            for q in range(number):
                at = q * size + p
                ux, uy, uz = broadcast_vector(u, at, zero)
                gx, gy, gz = react(u, s, q * size + STRIDE * other, ux, uy, uz, g, h, dx, dy, dz)
                s[at] += lane_sum(gx)
                s[at + WIDTH] += lane_sum(gy)
                s[at + 2 * WIDTH] += lane_sum(gz)


class Deviation(NamedTuple):
    """One deviation of all particles, in the places of the list, with its slopes."""

    u: NDArray[np.float64]  # (3 slots,)
    s: NDArray[np.float64]  # (3 slots,)
    row_sums: NDArray[np.float64]  # slopes of a cluster's rows, not yet summed over lanes


@as_written
def slope_within(laws, i, place, r2, cutoff2):
    """Return twice the derivative by r^2 of the force over r of the pairs of `pair_terms`, zero beyond the cutoff."""
    _, h = pair_slopes(laws, i, place, r2)
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


@by_type(prefer_literal=True)
def apart(laws, at, own, u, cutoff2, places):
    """Return the variations of the forces on the eight particles from slot ``at`` on by the particles ``places``
    further on."""
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

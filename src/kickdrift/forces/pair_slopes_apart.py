"""The variations of pairs that the rows of a cluster list do not hold: those within a cluster, and special pairs.

See `pair_slopes`. ``u`` and ``s`` hold the deviations and their slopes, 3 slots for each deviation, in one row.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numba import types

from kickdrift.forces.clusters import SHIFT_BITS, STRIDE, load_vector, store_vector
from kickdrift.forces.intra_cluster import terms_within
from kickdrift.forces.law_lanes import pair_slopes
from kickdrift.jit.compile import as_written
from kickdrift.jit.dual import dual
from kickdrift.jit.inner import overload
from kickdrift.jit.lanes import lane_sum, lanes_like, rotated, splat
from kickdrift.jit.masks import select
from kickdrift.jit.memory import broadcast, load
from kickdrift.jit.vectors import WIDTH


def add_apart(
    laws: Any, x: Any, u: Any, s: Any, number: int, cluster: int, cutoff2: float, places: int, part: float
) -> None:
    """Add the variations of the pairs of a cluster's particles that are ``places`` apart. Particles four places apart
    meet twice, each time with ``part`` of the slope."""
    raise NotImplementedError("for compiled code")


@overload(add_apart, prefer_literal=True)
def _add_apart(laws, x, u, s, number, cluster, cutoff2, places, part):
    if not isinstance(places, types.IntegerLiteral):
        return None
    back = WIDTH - places.literal_value

    def add(laws, x, u, s, number, cluster, cutoff2, places, part):
        own_x, own_y, own_z = load_vector(x, cluster)
        dx, dy, dz = own_x - rotated(own_x, places), own_y - rotated(own_y, places), own_z - rotated(own_z, places)
        r2 = dx * dx + dy * dy + dz * dz
        _, term = terms_within(laws, WIDTH * cluster, places, dual(r2, lanes_like(2.0, r2)))
        g, h = select(r2 < cutoff2, part * term.value, 0.0), select(r2 < cutoff2, part * term.slope, 0.0)
        for q in range(number):
            own = q * (x.size // STRIDE) + cluster
            ux, uy, uz = load_vector(u, own)
            wx, wy, wz = ux - rotated(ux, places), uy - rotated(uy, places), uz - rotated(uz, places)
            along = h * (dx * wx + dy * wy + dz * wz)
            gx, gy, gz = g * wx + along * dx, g * wy + along * dy, g * wz + along * dz
            sx, sy, sz = load_vector(s, own)
            sx, sy, sz = sx + (gx - rotated(gx, back)), sy + (gy - rotated(gy, back)), sz + (gz - rotated(gz, back))
            store_vector(s, own, sx, sy, sz)

    return add


def add_special_slopes(special: Any, laws: Any, pairs: Any, u: Any, s: Any, number: int, c: int, cutoff2: float) -> None:
    """Add the variations of chunk c's entries of special pairs."""


@overload(add_special_slopes)
def _add_special_slopes(special, laws, pairs, u, s, number, c, cutoff2):
    if isinstance(special, types.NoneType):
        return lambda special, laws, pairs, u, s, number, c, cutoff2: None

    def add(special, laws, pairs, u, s, number, c, cutoff2):
        x, shifts, zero, size = pairs.x, pairs.shifts, splat(0.0), pairs.x.size
        lanes = np.empty(WIDTH)
        for e in range(special.number[c]):
            cluster, met, within = special.entries[c, e]
            other, shift = met >> SHIFT_BITS, met & 31
            xj, yj, zj = load_vector(x, other)
            xj, yj, zj = xj + shifts[0, shift], yj + shifts[1, shift], zj + shifts[2, shift]
            for row in range(WIDTH):
                if (within >> (WIDTH * row)) & 255 == 0:
                    continue
                p, word = STRIDE * cluster + row, special.codes[c, e, row]
                for lane in range(WIDTH):
                    lanes[lane] = special.factors[(word >> (WIDTH * lane)) & 255]
                factor = load(lanes, 0)
                dx, dy, dz = vector_at(x, p, zero)
                dx, dy, dz = dx - xj, dy - yj, dz - zj
                r2 = select(factor > 0.0, dx * dx + dy * dy + dz * dz, 4.0 * cutoff2)
                g, h = pair_slopes(laws, WIDTH * cluster + row, WIDTH * other, r2)
                g, h = select(r2 < cutoff2, factor * g, 0.0), select(r2 < cutoff2, factor * h, 0.0)
                for q in range(number):
                    at, theirs = q * size + p, q * (size // STRIDE) + other
                    wx, wy, wz = vector_at(u, at, zero)
                    ux, uy, uz = load_vector(u, theirs)
                    wx, wy, wz = wx - ux, wy - uy, wz - uz
                    along = h * (dx * wx + dy * wy + dz * wz)
                    gx, gy, gz = g * wx + along * dx, g * wy + along * dy, g * wz + along * dz
                    sx, sy, sz = load_vector(s, theirs)
                    store_vector(s, theirs, sx - gx, sy - gy, sz - gz)
                    add_at(s, at, lane_sum(gx), lane_sum(gy), lane_sum(gz))

    return add


@as_written
def vector_at(x, p, zero):
    """Return the vector whose x is at a place, in all lanes."""
    return broadcast(x, p, zero), broadcast(x, p + WIDTH, zero), broadcast(x, p + 2 * WIDTH, zero)


@as_written
def add_at(s, p, x, y, z):
    """Add to the vector whose x is at a place."""
    s[p] += x
    s[p + WIDTH] += y
    s[p + 2 * WIDTH] += z

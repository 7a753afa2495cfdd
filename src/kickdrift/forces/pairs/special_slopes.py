"""The variation of a pair, and those of special pairs, which the rows of a cluster list do not hold.

See `slopes`. ``u`` and ``s`` hold the deviations and their slopes, 3 slots for each deviation, in one row.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numba import types

from kickdrift.forces.lists.clusters import SHIFT_BITS, STRIDE, load_vector
from kickdrift.forces.pairs.lanes import pair_slopes
from kickdrift.jit.compile import as_written
from kickdrift.jit.inner import overload
from kickdrift.jit.lanes.functions import lane_sum, splat
from kickdrift.jit.lanes.masks import select
from kickdrift.jit.lanes.memory import broadcast, load, load_like, store
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


def add_special_slopes(
    special: Any, laws: Any, pairs: Any, u: Any, s: Any, number: int, c: int, cutoff2: float
) -> None:
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
                dx, dy, dz = broadcast_vector(x, p, zero)
                dx, dy, dz = dx - xj, dy - yj, dz - zj
                r2 = select(factor > 0.0, dx * dx + dy * dy + dz * dz, 4.0 * cutoff2)
                g, h = pair_slopes(laws, WIDTH * cluster + row, WIDTH * other, r2)
                g, h = select(r2 < cutoff2, factor * g, 0.0), select(r2 < cutoff2, factor * h, 0.0)
                for q in range(number):
                    at = q * size + p
                    ux, uy, uz = broadcast_vector(u, at, zero)
                    gx, gy, gz = react(u, s, q * size + STRIDE * other, ux, uy, uz, g, h, dx, dy, dz)
                    s[at] += lane_sum(gx)
                    s[at + WIDTH] += lane_sum(gy)
                    s[at + 2 * WIDTH] += lane_sum(gz)

    return add

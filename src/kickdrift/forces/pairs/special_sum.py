"""Forces of the pairs that pair forces leave out or scale; `special_pairs` has their entries in the list."""

from __future__ import annotations

from typing import Any

import numpy as np
from numba import types

from kickdrift.forces.lists.clusters import SHIFT_BITS, STRIDE, load_vector, store_vector
from kickdrift.forces.pairs.lanes import pair_terms
from kickdrift.jit.inner import overload
from kickdrift.jit.lanes.functions import splat
from kickdrift.jit.lanes.masks import select
from kickdrift.jit.lanes.memory import broadcast, load, sums_of_rows
from kickdrift.jit.lanes.vectors import WIDTH


def add_special(special: Any, laws: Any, pairs: Any, forces: Any, c: int, cutoff2: float, totals: Any) -> Any:
    """Add the forces of chunk c's entries to ``forces``; return energy, virial and number of pairs, ``totals``, with
    theirs."""
    raise NotImplementedError("for compiled code")


@overload(add_special)
def _add_special(special, laws, pairs, forces, c, cutoff2, totals):
    if isinstance(special, types.NoneType):
        return lambda special, laws, pairs, forces, c, cutoff2, totals: totals

    def add(special, laws, pairs, forces, c, cutoff2, totals):
        energies, virials, counts = totals
        x, shifts, zero = pairs.x, pairs.shifts, splat(0.0)
        lanes, row_sums = np.empty(WIDTH), np.empty(WIDTH * STRIDE)
        for e in range(special.number[c]):
            cluster, met, within = special.entries[c, e]
            other, s = met >> SHIFT_BITS, met & 31
            xj, yj, zj = load_vector(x, other)
            xj, yj, zj = xj + shifts[0, s], yj + shifts[1, s], zj + shifts[2, s]
            hx, hy, hz = zero, zero, zero
            for row in range(WIDTH):
                fx, fy, fz = zero, zero, zero
                if (within >> (WIDTH * row)) & 255:
                    p, word = STRIDE * cluster + row, special.codes[c, e, row]
                    for lane in range(WIDTH):
                        lanes[lane] = special.factors[(word >> (WIDTH * lane)) & 255]
                    factor = load(lanes, 0)
                    dx, dy, dz = (
                        broadcast(x, p, zero) - xj,
                        broadcast(x, p + WIDTH, zero) - yj,
                        broadcast(x, p + 2 * WIDTH, zero) - zj,
                    )
                    r2 = select(factor > 0.0, dx * dx + dy * dy + dz * dz, 4.0 * cutoff2)
                    energy, force_over_r = pair_terms(laws, WIDTH * cluster + row, WIDTH * other, r2)
                    inside = r2 < cutoff2
                    g = select(inside, factor * force_over_r, 0.0)
                    fx, fy, fz = g * dx, g * dy, g * dz
                    hx, hy, hz = hx + fx, hy + fy, hz + fz
                    energies = energies + select(inside, factor * energy, 0.0)
                    virials = virials + g * select(inside, r2, 0.0)
                    counts = counts + select(inside, zero + 1.0, 0.0)
                store_vector(row_sums, row, fx, fy, fz)
            ax, ay, az = load_vector(forces, cluster)
            ax = ax + sums_of_rows(row_sums, 0, STRIDE)
            ay = ay + sums_of_rows(row_sums, WIDTH, STRIDE)
            store_vector(forces, cluster, ax, ay, az + sums_of_rows(row_sums, 2 * WIDTH, STRIDE))
            ax, ay, az = load_vector(forces, other)
            store_vector(forces, other, ax - hx, ay - hy, az - hz)
        return energies, virials, counts

    return add

"""Compiled sums of the embedded-atom method: densities at all particles, then forces.

The first visit of a particle reads the tables at each neighbour's distance, sums the density, and keeps the slopes. The
second visit weighs the slopes by the slopes of both particles' embedding energies.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from kickdrift.forces.lists.clusters import STRIDE, chunk_clusters
from kickdrift.forces.lists.neighbours import ROW, block_of_neighbours
from kickdrift.forces.many_body.kernel import law_body
from kickdrift.jit.compile import as_written, never_inline
from kickdrift.jit.duals.lanes import inverse_sqrt, lane_sum, load, numbers_at, select, store, value_of
from kickdrift.jit.lanes.functions import splat
from kickdrift.jit.lanes.gathering import lane_floor, rows_of
from kickdrift.jit.lanes.memory import aligned
from kickdrift.jit.lanes.vectors import WIDTH
from kickdrift.jit.threads.chunks import chunk_task, each_chunk

KEPT = 6  # numbers that the first visit keeps of each pair


class EmbeddedAtomLaw(NamedTuple):
    """Splines of a potential, and room for what the first visit finds.

    A row of ``by_distance`` holds the cubics of an interval of distances, four numbers each: density at the first
    particle, r times pair energy and, with several species, density at the second."""

    by_distance: NDArray[np.float64]  # (species, species, intervals, 8 or 12)
    intervals: int
    per_length: float  # 1 over an interval of distances
    by_density: NDArray[np.float64]  # (species, intervals, 4) embedding energies
    per_density: float
    highest: float  # density from which the embedding energy continues as a line
    slope: NDArray[np.float64]  # (slots,) slope of each particle's embedding energy
    kept: NDArray[np.float64]  # (slots * room * 6,)

    def with_room(self, slots: int, room: int, chunks: int) -> EmbeddedAtomLaw:
        """Return the law with workspace for this room."""
        return self._replace(slope=np.zeros(slots), kept=aligned((slots * room * KEPT,), fill=None))


@law_body(EmbeddedAtomLaw)
def embedded_atom(law, force, chunks):
    each_chunk(force, chunks, "chunk_densities")
    each_chunk(force, chunks, "chunk_embedded_forces")


@as_written
def cubic(c3, c2, c1, c0, p):
    """Return a cubic and its slope at p."""
    return ((c3 * p + c2) * p + c1) * p + c0, (3.0 * c3 * p + 2.0 * c2) * p + c1


@chunk_task
def chunk_densities(force, c):
    """Sum the densities at chunk c's particles, and their energies."""
    never_inline()
    rows, law, pairs = force.rows, force.law, force.pairs
    table, kept, cutoff2 = law.by_distance, law.kept, force.cutoff**2
    species, width, room = table.shape[0], table.shape[3], rows.near.shape[1]
    last = float(law.intervals - 1)
    pair_energy, pair_count, embedded = splat(0.0), splat(0.0), 0.0
    begin, end = chunk_clusters(pairs, c)
    for cluster in range(begin, end):
        for slot in range(WIDTH * cluster, WIDTH * cluster + pairs.filled[cluster]):
            own = value_of(rows.at[ROW * slot + 3])
            density = splat(0.0)
            for first in range(0, rows.lengths[slot], WIDTH):
                dx, dy, dz, r2, beyond, kind = block_of_neighbours(rows, slot, first, cutoff2)
                r2 = select(beyond, splat(cutoff2), r2)
                inverse = inverse_sqrt(r2)
                p = r2 * inverse * law.per_length
                interval = lane_floor(value_of(p))
                interval = select(interval < last, interval, splat(last))  # nan too: no index is out of range
                p = p - interval
                p = select(p > 1.0, splat(1.0), p)
                row = (kind + own * species) * float(law.intervals) + interval
                a3, a2, a1, a0 = rows_of(table, row, width, 0)
                here, slope_here = cubic(a3, a2, a1, a0, p)
                b3, b2, b1, b0 = rows_of(table, row, width, 4)
                z, slope_z = cubic(b3, b2, b1, b0, p)
                slope_there = slope_here
                if species > 1:
                    e3, e2, e1, e0 = rows_of(table, row, width, 8)
                    _, slope_there = cubic(e3, e2, e1, e0, p)
                energy = z * inverse
                slope = (slope_z * law.per_length - energy) * inverse * inverse  # of the pair energy, over r
                per_r = inverse * law.per_length
                density = density + select(beyond, splat(0.0), here)
                pair_energy = pair_energy + select(beyond, splat(0.0), energy)
                pair_count = pair_count + select(beyond, splat(0.0), splat(1.0))
                at = (slot * room + first) * KEPT
                store(kept, at, dx)
                store(kept, at + WIDTH, dy)
                store(kept, at + 2 * WIDTH, dz)
                store(kept, at + 3 * WIDTH, select(beyond, splat(0.0), slope))
                store(kept, at + 4 * WIDTH, select(beyond, splat(0.0), slope_here * per_r))
                if species > 1:
                    store(kept, at + 5 * WIDTH, select(beyond, splat(0.0), slope_there * per_r))
            embedded += embedding(law, slot, int(own), lane_sum(density))
    force.sums[c, 0] = 0.5 * lane_sum(pair_energy) + embedded
    force.sums[c, 2] = 0.5 * lane_sum(pair_count)


@as_written
def embedding(law, slot, kind, density):
    """Write the slope of a particle's embedding energy, and return the energy."""
    table = law.by_density
    p = density * law.per_density
    most = table.shape[1] - 1
    interval = max(0, int(value_of(p))) if p < float(most) else most  # nan too: no index is out of range
    p = p - interval
    p = 1.0 if p > 1.0 else p
    c3, c2 = table[kind, interval, 0], table[kind, interval, 1]
    c1, c0 = table[kind, interval, 2], table[kind, interval, 3]
    value, slope = cubic(c3, c2, c1, c0, p)
    slope *= law.per_density
    law.slope[slot] = slope
    return value + slope * (density - law.highest) if density > law.highest else value


@chunk_task
def chunk_embedded_forces(force, c):
    """Sum the forces on chunk c's particles."""
    never_inline()
    rows, law, pairs = force.rows, force.law, force.pairs
    kept, room, forces = law.kept, rows.near.shape[1], pairs.force[0]
    several = law.by_distance.shape[0] > 1
    virial = splat(0.0)
    begin, end = chunk_clusters(pairs, c)
    for cluster in range(begin, end):
        for slot in range(WIDTH * cluster, WIDTH * cluster + pairs.filled[cluster]):
            own = law.slope[slot]
            fx, fy, fz = splat(0.0), splat(0.0), splat(0.0)
            for first in range(0, rows.lengths[slot], WIDTH):
                at = (slot * room + first) * KEPT
                dx, dy, dz = load(kept, at), load(kept, at + WIDTH), load(kept, at + 2 * WIDTH)
                there = load(kept, at + (5 if several else 4) * WIDTH)
                other = numbers_at(law.slope, rows.near, slot * room + first)
                g = load(kept, at + 3 * WIDTH) + own * load(kept, at + 4 * WIDTH) + other * there
                fx, fy, fz = fx - g * dx, fy - g * dy, fz - g * dz
                virial = virial - g * (dx * dx + dy * dy + dz * dz)
            p = STRIDE * cluster + slot % WIDTH
            forces[p], forces[p + WIDTH], forces[p + 2 * WIDTH] = lane_sum(fx), lane_sum(fy), lane_sum(fz)
    force.sums[c, 1] = 0.5 * lane_sum(virial)

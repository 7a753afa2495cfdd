"""Compiled sums of the embedded-atom method: densities at all particles, then forces.

Each pair stands in the row of one of its particles. The first visit of a row reads the tables at each distance, adds
the densities to both particles, and keeps the slopes. The second visit weighs the slopes by the slopes of both
particles' embedding energies, and adds the forces. It computes the separations again, because large systems would wait
for memory if the first visit kept these too.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from kickdrift.forces.lists.along import add_along, store_along, zeros_along
from kickdrift.forces.lists.clusters import N_CLUSTERS, STRIDE, chunk_clusters
from kickdrift.forces.lists.neighbours import ROW, block_of_neighbours, separations
from kickdrift.forces.many_body.kernel import law_body
from kickdrift.jit.compile import as_written, never_inline
from kickdrift.jit.duals.lanes import (
    add_numbers_at,
    add_rows_at,
    inverse_sqrt,
    lane_sum,
    load,
    select,
    store,
    value_of,
)
from kickdrift.jit.lanes.functions import splat
from kickdrift.jit.lanes.gathering import lane_floor, rows_of
from kickdrift.jit.lanes.memory import aligned
from kickdrift.jit.lanes.vectors import WIDTH
from kickdrift.jit.threads.chunks import chunk_task, each_chunk

KEPT = 3  # numbers that the first visit keeps of each pair for the second
BLOCK = 3  # numbers of each neighbour in the row at hand


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
    densities: NDArray[np.float64]  # (chunks, slots) from the pairs of each chunk
    at: NDArray[np.float64]  # (4 slots,) x, y, z and slope of the embedding energy of each slot
    row: NDArray[np.float64]  # (chunks, room * BLOCK)
    kept: NDArray[np.float64]  # (slots * room * KEPT,)
    forces: NDArray[np.float64]  # (chunks, 4 slots) from the pairs of each chunk: x, y, z and 0 for each slot

    def with_room(self, slots: int, room: int, chunks: int) -> EmbeddedAtomLaw:
        """Return the law with workspace for this room."""
        return self._replace(
            densities=aligned((chunks, slots)),
            at=aligned((ROW * slots,)),
            row=aligned((chunks, room * BLOCK)),
            kept=aligned((slots * room * KEPT,), fill=None),
            forces=aligned((chunks, ROW * slots)),
        )


@law_body(EmbeddedAtomLaw, pairs_once=True)
def embedded_atom(law, force, chunks):
    each_chunk(force, chunks, "chunk_densities")
    each_chunk(force, chunks, "chunk_embedding")
    each_chunk(force, chunks, "chunk_embedded_forces")
    each_chunk(force, chunks, "collect_embedded_forces")


@as_written
def cubic(c3, c2, c1, c0, p):
    """Return a cubic and its slope at p."""
    return ((c3 * p + c2) * p + c1) * p + c0, (3.0 * c3 * p + 2.0 * c2) * p + c1


@chunk_task
def chunk_densities(force, c):
    """Sum the densities from chunk c's pairs, and their energies."""
    never_inline()
    rows, law, pairs = force.rows, force.law, force.pairs
    table, kept, block, densities, cutoff2 = law.by_distance, law.kept, law.row[c], law.densities[c], force.cutoff**2
    species, width, room = table.shape[0], table.shape[3], rows.near.shape[1]
    last = float(law.intervals - 1)
    for cluster in range(pairs.counts[N_CLUSTERS]):
        if rows.reached[c, cluster]:
            store(densities, WIDTH * cluster, splat(0.0))
    pair_energy, pair_count = splat(0.0), splat(0.0)
    begin, end = chunk_clusters(pairs, c)
    at = WIDTH * begin * room * KEPT  # where the next numbers are kept, without gaps
    for cluster in range(begin, end):
        for slot in range(WIDTH * cluster, WIDTH * cluster + pairs.filled[cluster]):
            own = value_of(rows.at[ROW * slot + 3])
            density, begin_row, count = splat(0.0), slot * room, rows.lengths[slot]
            # Two short loops are faster than one long loop, since the processor then works on several rounds at once.
            for first in range(0, count, WIDTH):
                _, _, _, r2, beyond, kind = block_of_neighbours(rows, slot, first, cutoff2)
                r2 = select(beyond, splat(cutoff2), r2)
                inverse = inverse_sqrt(r2)
                store(block, BLOCK * first, select(beyond, splat(0.0), inverse))
                store(block, BLOCK * first + WIDTH, r2 * inverse * law.per_length)
                if species > 1:
                    store(block, BLOCK * first + 2 * WIDTH, kind)
            for first in range(0, count, WIDTH):
                inverse, p = load(block, BLOCK * first), load(block, BLOCK * first + WIDTH)
                beyond = inverse == 0.0
                interval = lane_floor(value_of(p))
                interval = select(interval < last, interval, splat(last))  # nan too: no index is out of range
                p = p - interval
                p = select(p > 1.0, splat(1.0), p)
                row = interval
                if species > 1:
                    kind = value_of(load(block, BLOCK * first + 2 * WIDTH))
                    row = row + (kind + own * species) * float(law.intervals)
                a3, a2, a1, a0 = rows_of(table, row, width, 0)
                here, slope_here = cubic(a3, a2, a1, a0, p)
                b3, b2, b1, b0 = rows_of(table, row, width, 4)
                z, slope_z = cubic(b3, b2, b1, b0, p)
                there, slope_there = here, slope_here
                if species > 1:
                    e3, e2, e1, e0 = rows_of(table, row, width, 8)
                    there, slope_there = cubic(e3, e2, e1, e0, p)
                energy = z * inverse
                per_r = inverse * law.per_length
                density = density + select(beyond, splat(0.0), here)
                add_numbers_at(densities, rows.near, begin_row + first, select(beyond, splat(0.0), there))
                pair_energy = pair_energy + energy
                pair_count = pair_count + select(beyond, splat(0.0), splat(1.0))
                store(kept, at, (slope_z * law.per_length - energy) * inverse * inverse)  # slope of the pair energy
                store(kept, at + WIDTH, slope_here * per_r)
                if species > 1:
                    store(kept, at + 2 * WIDTH, slope_there * per_r)
                at += (KEPT if species > 1 else KEPT - 1) * WIDTH
            densities[slot] += lane_sum(density)
    force.sums[c, 0] = lane_sum(pair_energy)
    force.sums[c, 2] = lane_sum(pair_count)


@as_written
def over_chunks(force, numbers, c, cluster, at):
    """Return the sum of a number of a cluster in chunk c: that from the chunk's own pairs, then those of the others."""
    total = numbers[c, at]
    for other in range(force.chunks.number):
        if other != c and force.rows.reached[other, cluster]:
            total += numbers[other, at]
    return total


@chunk_task
def chunk_embedding(force, c):
    """Sum the chunks' densities at chunk c's particles, and the embedding energies."""
    never_inline()
    rows, law, pairs = force.rows, force.law, force.pairs
    embedded = 0.0
    begin, end = chunk_clusters(pairs, c)
    for cluster in range(begin, end):
        for slot in range(WIDTH * cluster, WIDTH * cluster + pairs.filled[cluster]):
            density = over_chunks(force, law.densities, c, cluster, slot)
            for k in range(3):
                law.at[ROW * slot + k] = rows.at[ROW * slot + k]
            embedded += embedding(law, slot, int(value_of(rows.at[ROW * slot + 3])), density)
    force.sums[c, 0] += embedded


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
    law.at[ROW * slot + 3] = slope
    return value + slope * (density - law.highest) if density > law.highest else value


@chunk_task
def chunk_embedded_forces(force, c):
    """Sum the forces from chunk c's pairs."""
    never_inline()
    rows, law, pairs = force.rows, force.law, force.pairs
    kept, room, forces = law.kept, rows.near.shape[1], law.forces[c]
    several = law.by_distance.shape[0] > 1
    for cluster in range(pairs.counts[N_CLUSTERS]):
        if rows.reached[c, cluster]:
            for k in range(ROW):
                store(forces, WIDTH * (ROW * cluster + k), splat(0.0))
    virial, along = splat(0.0), zeros_along(force.along, force.sums)
    begin, end = chunk_clusters(pairs, c)
    at = WIDTH * begin * room * KEPT
    for cluster in range(begin, end):
        for slot in range(WIDTH * cluster, WIDTH * cluster + pairs.filled[cluster]):
            own = law.at[ROW * slot + 3]
            fx, fy, fz = splat(0.0), splat(0.0), splat(0.0)
            for first in range(0, rows.lengths[slot], WIDTH):
                dx, dy, dz, other = separations(rows, law.at, slot, first)
                here, there = load(kept, at + WIDTH), load(kept, at + (2 if several else 1) * WIDTH)
                g = load(kept, at) + own * here + other * there
                at += (KEPT if several else KEPT - 1) * WIDTH
                gx, gy, gz = g * dx, g * dy, g * dz
                fx, fy, fz = fx - gx, fy - gy, fz - gz
                add_rows_at(forces, rows.near, slot * room + first, (gx, gy, gz, 0.0 * gx))
                virial = virial - (gx * dx + gy * dy + gz * dz)
                along = add_along(along, -gx * dx, -gy * dy, -gz * dz)
            p = ROW * slot
            forces[p] += lane_sum(fx)
            forces[p + 1] += lane_sum(fy)
            forces[p + 2] += lane_sum(fz)
    force.sums[c, 1] = lane_sum(virial)
    store_along(along, force.along, c)


@chunk_task
def collect_embedded_forces(force, c):
    """Sum the chunks' forces on chunk c's particles."""
    never_inline()
    law, pairs = force.law, force.pairs
    total = pairs.force[0]
    begin, end = chunk_clusters(pairs, c)
    for cluster in range(begin, end):
        for slot in range(WIDTH * cluster, WIDTH * cluster + pairs.filled[cluster]):
            for k in range(3):
                place = STRIDE * cluster + k * WIDTH + slot % WIDTH
                total[place] = over_chunks(force, law.forces, c, cluster, ROW * slot + k)

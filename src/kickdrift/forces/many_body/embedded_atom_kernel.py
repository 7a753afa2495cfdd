"""Compiled sums of the embedded-atom method: densities at all particles, then forces.

Each pair stands in the row of one of its particles. The first visit of a row brings the neighbours within the cutoff
side by side, reads the tables at their distances, adds the densities to both particles, and keeps the slopes. The
second visit weighs the slopes by the slopes of both particles' embedding energies, and adds the forces. It computes the
separations again, because large systems would wait for memory if the first visit kept these too.

In mixed precision the tables and what is kept of a pair are of float32. Positions, separations and sums are of float64.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from kickdrift.forces.lists.along import add_along, store_along, zeros_along
from kickdrift.forces.lists.clusters import N_CLUSTERS, SHIFTS, TABLE_STRIDE, chunk_clusters
from kickdrift.forces.lists.neighbours import ROW, close_neighbours, separations, shift_cluster
from kickdrift.forces.many_body.kernel import add_others, clear_reached, law_body
from kickdrift.jit.compile import as_written, never_inline
from kickdrift.jit.duals.lanes import (
    add_numbers_at,
    add_rows_at,
    in_double,
    in_precision_of,
    inverse_sqrt,
    lane_sum,
    load,
    rows_at,
    select,
    store,
    value_of,
)
from kickdrift.jit.lanes.functions import lane_numbers, splat
from kickdrift.jit.lanes.gathering import lane_floor, rows_of
from kickdrift.jit.lanes.memory import aligned
from kickdrift.jit.lanes.vectors import WIDTH
from kickdrift.jit.threads.chunks import chunk_task, each_chunk


class EmbeddedAtomLaw(NamedTuple):
    """Splines of a potential, and room for what the first visit finds.

    A row of ``by_distance`` holds the cubics of an interval of distances, four numbers each: density at the first
    particle, r times pair energy and, with several species, density at the second."""

    by_distance: NDArray[Any]  # (species, species, intervals, 8 or 12), of float32 in mixed precision
    intervals: int
    per_length: float  # 1 over an interval of distances
    by_density: NDArray[np.float64]  # (species, intervals, 4) embedding energies
    per_density: float
    first: float  # density where the table begins
    lowest: float  # density below which the embedding energy continues as a line
    highest: float  # density from which it does
    densities: NDArray[np.float64]  # (chunks, slots) from the pairs of each chunk
    at: NDArray[np.float64]  # (4 slots,) x, y, z and slope of the embedding energy of each slot
    shifted: NDArray[np.float64]  # (chunks, 32 * 27) see `shift_cluster`
    row: NDArray[np.float64]  # (chunks, slots + 16) squared distances of the neighbours at hand
    close: NDArray[np.int64]  # (chunks, slots) neighbours within the cutoff in a chunk's pairs
    kept: NDArray[Any]  # two or three slopes for each number of ``rows.near``
    forces: NDArray[np.float64]  # (chunks, 4 slots) from the pairs of each chunk: x, y, z and 0 for each slot

    def with_room(self, slots: int, room: int, chunks: int) -> EmbeddedAtomLaw:
        """Return the law with workspace for this room."""
        return self._replace(
            densities=aligned((chunks, slots)),
            at=aligned((ROW * slots,)),
            shifted=aligned((chunks, TABLE_STRIDE * SHIFTS)),
            row=aligned((chunks, slots + 2 * WIDTH), fill=None),
            close=np.zeros((chunks, slots), np.int64),
            kept=aligned((slots * room * (2 if len(self.by_distance) == 1 else 3),), None, self.by_distance.dtype),
            forces=aligned((chunks, ROW * slots)),
        )


@law_body(EmbeddedAtomLaw, ("by_distance",), pairs_once=True)
def embedded_atom(law, force, chunks):
    each_chunk(force, chunks, "chunk_densities")
    each_chunk(force, chunks, "chunk_embedding")
    each_chunk(force, chunks, "chunk_embedded_forces")
    each_chunk(force, chunks, "collect_forces")


@as_written
def cubic(c3, c2, c1, c0, p):
    """Return a cubic and its slope at p."""
    return ((c3 * p + c2) * p + c1) * p + c0, (3.0 * c3 * p + 2.0 * c2) * p + c1


@as_written
def first_place(force, c):
    """Return where chunk c's neighbours begin in ``rows.near``. They stand there without gaps, in blocks of eight."""
    slots, room = force.rows.near.shape
    return c * (slots // force.chunks.number) * room


@as_written
def has_rows(force, c, cluster):
    """Tell whether chunk c's pairs are neighbours of this cluster's particles."""
    pairs = force.pairs
    start, (begin, end) = pairs.row_start[c], chunk_clusters(pairs, c)
    mine = begin <= cluster < end
    return force.rows.reached[c, cluster] and (mine or start[WIDTH * cluster] != start[WIDTH * (cluster + 1)])


@chunk_task
def chunk_densities(force, c):
    """Sum the densities from chunk c's pairs, and their energies."""
    never_inline()
    rows, law, pairs = force.rows, force.law, force.pairs
    table, kept, row, densities, close = law.by_distance, law.kept, law.row[c], law.densities[c], law.close[c]
    species, width, near = table.shape[0], table.shape[3], rows.near
    last = float(law.intervals - 1)
    clear_reached(force, densities, c, 1)
    pair_energy, pair_count = splat(0.0), 0
    at = first_place(force, c)
    keep = at * (3 if species > 1 else 2)
    for cluster in range(pairs.counts[N_CLUSTERS]):
        if not has_rows(force, c, cluster):
            continue
        shift_cluster(pairs, c, cluster, law.shifted[c])
        for slot in range(WIDTH * cluster, WIDTH * cluster + pairs.filled[cluster]):
            own = value_of(rows.at[ROW * slot + 3])
            count = close_neighbours(force, c, slot, law.shifted[c], at, row)
            close[slot] = count
            pair_count += count
            density = splat(0.0)
            for first in range(0, count, WIDTH):
                here = lane_numbers() < float(count - first)
                r2 = in_precision_of(table, load(row, first))
                inverse = inverse_sqrt(r2)
                p = r2 * inverse * law.per_length
                interval = lane_floor(value_of(p))
                interval = select(interval < last, interval, last)  # nan too: no index is out of range
                p = p - interval
                p = select(p > 1.0, 0.0 * p + 1.0, p)
                line = interval
                if species > 1:
                    kind = in_precision_of(table, value_of(rows_at(rows.at, near, at)[3]))
                    line = line + (kind + own * species) * float(law.intervals)
                a3, a2, a1, a0 = rows_of(table, line, width, 0)
                b3, b2, b1, b0 = rows_of(table, line, width, 4)
                own_density, own_slope = cubic(a3, a2, a1, a0, p)
                z, slope_z = cubic(b3, b2, b1, b0, p)
                energy = z * inverse
                per_r = inverse * law.per_length
                store(kept, keep, (slope_z * law.per_length - energy) * inverse * inverse)  # slope of the pair energy
                store(kept, keep + WIDTH, own_slope * per_r)
                own_density = select(here, in_double(own_density), 0.0)
                density = density + own_density
                keep += 2 * WIDTH
                if species > 1:
                    e3, e2, e1, e0 = rows_of(table, line, width, 8)
                    other_density, other_slope = cubic(e3, e2, e1, e0, p)
                    store(kept, keep, other_slope * per_r)
                    add_numbers_at(densities, near, at, select(here, in_double(other_density), 0.0))
                    keep += WIDTH
                else:
                    add_numbers_at(densities, near, at, own_density)
                pair_energy = pair_energy + select(here, in_double(energy), 0.0)
                at += WIDTH
            densities[slot] += lane_sum(density)
    force.sums[c, 0] = lane_sum(pair_energy)
    force.sums[c, 2] = pair_count


@chunk_task
def chunk_embedding(force, c):
    """Sum the chunks' densities at chunk c's particles, and the embedding energies."""
    never_inline()
    rows, law, pairs = force.rows, force.law, force.pairs
    embedded = splat(0.0)
    begin, end = chunk_clusters(pairs, c)
    for cluster in range(begin, end):
        add_others(force, law.densities, c, cluster, 1)
        for p in range(ROW * WIDTH * cluster, ROW * WIDTH * (cluster + 1), WIDTH):
            store(law.at, p, load(rows.at, p))
        embedded = embedded + embedding(law, c, cluster, pairs.filled[cluster])
    force.sums[c, 0] += lane_sum(embedded)


@as_written
def embedding(law, c, cluster, filled):
    """Write the slopes of a cluster's embedding energies over the species in ``law.at``, and return the energies."""
    table, row, density = law.by_density, law.row[c], load(law.densities[c], WIDTH * cluster)
    last = float(table.shape[1] - 1)
    p = (density - law.first) * law.per_density
    interval = lane_floor(value_of(p))
    interval = select(interval < last, interval, last)  # nan too: no index is out of range
    interval = select(interval > 0.0, interval, 0.0)
    p = p - interval
    p = select(p > 1.0, 0.0 * p + 1.0, p)
    p = select(density < law.lowest, 0.0 * p, p)
    kind = splat(0.0)
    if table.shape[0] > 1:
        for lane in range(WIDTH):
            row[lane] = law.at[ROW * (WIDTH * cluster + lane) + 3]
        kind = value_of(load(row, 0))
    c3, c2, c1, c0 = rows_of(table, interval + kind * float(table.shape[1]), ROW, 0)
    value, slope = cubic(c3, c2, c1, c0, p)
    slope = slope * law.per_density
    store(row, 0, slope)
    for lane in range(WIDTH):
        law.at[ROW * (WIDTH * cluster + lane) + 3] = row[lane]
    value = select(density > law.highest, value + slope * (density - law.highest), value)
    value = select(density < law.lowest, value + slope * (density - law.lowest), value)
    return select(lane_numbers() < float(filled), value, 0.0)


@chunk_task
def chunk_embedded_forces(force, c):
    """Sum the forces from chunk c's pairs."""
    never_inline()
    rows, law, pairs = force.rows, force.law, force.pairs
    kept, forces, near = law.kept, law.forces[c], rows.near
    several = law.by_distance.shape[0] > 1
    clear_reached(force, forces, c, ROW)
    virial, by_axis = splat(0.0), zeros_along(force.along, force.sums)
    at = first_place(force, c)
    keep = at * (3 if several else 2)
    for cluster in range(pairs.counts[N_CLUSTERS]):
        if not has_rows(force, c, cluster):
            continue
        for slot in range(WIDTH * cluster, WIDTH * cluster + pairs.filled[cluster]):
            p = ROW * slot
            x, y, z, own = law.at[p], law.at[p + 1], law.at[p + 2], law.at[p + 3]
            fx, fy, fz = splat(0.0), splat(0.0), splat(0.0)
            for _ in range(0, law.close[c, slot], WIDTH):
                dx, dy, dz, other = separations(rows, law.at, near, at, x, y, z)
                by_own = in_double(load(kept, keep + WIDTH))
                by_other = in_double(load(kept, keep + 2 * WIDTH)) if several else by_own
                g = in_double(load(kept, keep)) + own * by_own + other * by_other
                gx, gy, gz = g * dx, g * dy, g * dz  # zero beyond the last neighbour: its separation is zero
                fx, fy, fz = fx - gx, fy - gy, fz - gz
                add_rows_at(forces, near, at, (gx, gy, gz, 0.0 * gx))
                at += WIDTH
                keep += (3 if several else 2) * WIDTH
                virial = virial - (gx * dx + gy * dy + gz * dz)
                by_axis = add_along(by_axis, -gx, -gy, -gz, dx, dy, dz)
            forces[p] += lane_sum(fx)
            forces[p + 1] += lane_sum(fy)
            forces[p + 2] += lane_sum(fz)
    force.sums[c, 1] = lane_sum(virial)
    store_along(by_axis, force.along, c)

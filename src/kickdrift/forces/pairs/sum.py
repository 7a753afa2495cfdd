"""The compiled sum of a pair law over the rows of a cluster list and its special pairs, in float64 or mixed precision.

A step of the loop takes one particle against a cluster of eight or half a cluster, or four particles against half a
cluster (see `row_lanes`). In mixed precision the lanes are float32. A particle's force is then summed in float32 over a
row and over the reactions of a chunk. All else is float64: the state, sums over rows and chunks, and energies.

The argument ``zero`` holds zeros in all lanes of a step; its type selects the functions' number of lanes.
"""

from __future__ import annotations

import numpy as np

from kickdrift.forces.lists.along import add_along, store_along, trace_of, zeros_along
from kickdrift.forces.lists.clusters import N_CLUSTERS, SHIFT_BITS, STRIDE, chunk_clusters, load_vector, store_vector
from kickdrift.forces.lists.pair_rows import (
    add_reactions,
    clear,
    displacements,
    fetch_streams,
    fill_table,
    in_float64,
    of_row,
    particle_of,
    row_forces,
    row_of,
    rows_in_one_loop,
    store_row_force,
    streams,
    subtract_reactions,
    working_arrays,
)
from kickdrift.forces.lists.row_lanes import nothing
from kickdrift.forces.lists.special_pairs import is_inside
from kickdrift.forces.lists.sums import hand_over
from kickdrift.forces.pairs.intra_cluster import own_pairs, row_start
from kickdrift.forces.pairs.lanes import in_registers, pair_terms
from kickdrift.forces.pairs.variation import (
    add_row_slopes,
    deviation_at,
    row_deviation,
    slope_within,
    store_row_slope,
    varied_row,
    vary_cluster,
)
from kickdrift.jit.compile import as_written, never_inline
from kickdrift.jit.lanes.functions import lane_sum, multiply_add, splat
from kickdrift.jit.lanes.masks import bytes_with_bits, lowest_bit, select
from kickdrift.jit.lanes.memory import broadcast, entry, sums_of_rows
from kickdrift.jit.lanes.tabled import by_bytes
from kickdrift.jit.lanes.vectors import WIDTH
from kickdrift.jit.threads.chunks import chunk_task


@as_written
def add_special(special, laws, pairs, forces, c, cutoff2, totals):
    """Add the forces of chunk c's entries to ``forces``; return energy, virial, number of pairs and the virial along
    each axis, ``totals``, with theirs."""
    if special is None:
        return totals
    energies, virials, counts, along = totals
    x, shifts, zero = pairs.x, pairs.shifts, splat(0.0)
    row_sums, present = np.zeros(WIDTH * STRIDE), -1
    for e in range(special.number[c]):
        cluster, met, within = special.entries[c, e]
        if cluster != present:  # all entries of a cluster are side by side
            add_special_rows(forces, row_sums, present)
            present = cluster
        other, s = met >> SHIFT_BITS, met & 31
        xj, yj, zj = load_vector(x, other)
        xj, yj, zj = xj + shifts[0, s], yj + shifts[1, s], zj + shifts[2, s]
        hx, hy, hz = zero, zero, zero
        rows = bytes_with_bits(within)
        while rows:
            row = lowest_bit(rows)
            rows &= rows - 1
            p = STRIDE * cluster + row
            factor = by_bytes(special.factors, special.codes[c, e, row])
            dx, dy, dz = (
                broadcast(x, p, zero) - xj,
                broadcast(x, p + WIDTH, zero) - yj,
                broadcast(x, p + 2 * WIDTH, zero) - zj,
            )
            r2 = select(factor > 0.0, dx * dx + dy * dy + dz * dz, 4.0 * cutoff2)
            energy, force_over_r = pair_terms(laws, WIDTH * cluster + row, STRIDE * other, r2)
            inside = r2 < cutoff2
            g = select(inside, factor * force_over_r, 0.0)
            fx, fy, fz = g * dx, g * dy, g * dz
            hx, hy, hz = hx + fx, hy + fy, hz + fz
            energies = energies + select(inside, factor * energy, 0.0)
            virials = virials + g * select(inside, r2, 0.0)
            counts = counts + select(inside, zero + 1.0, 0.0)
            along = add_along(along, fx, fy, fz, dx, dy, dz)
            sx, sy, sz = load_vector(row_sums, row)
            store_vector(row_sums, row, sx + fx, sy + fy, sz + fz)
        ax, ay, az = load_vector(forces, other)
        store_vector(forces, other, ax - hx, ay - hy, az - hz)
    add_special_rows(forces, row_sums, present)
    return energies, virials, counts, along


@as_written
def add_special_rows(forces, row_sums, cluster):
    """Add the sums of a cluster's rows to its forces, and set them to zero; nothing for cluster -1."""
    if cluster < 0:
        return
    ax, ay, az = load_vector(forces, cluster)
    ax, ay = ax + sums_of_rows(row_sums, 0, STRIDE), ay + sums_of_rows(row_sums, WIDTH, STRIDE)
    store_vector(forces, cluster, ax, ay, az + sums_of_rows(row_sums, 2 * WIDTH, STRIDE))
    for row in range(WIDTH):
        store_vector(row_sums, row, splat(0.0), splat(0.0), splat(0.0))


@chunk_task
def chunk_forces(force, c, thread):
    """Sum the forces of chunk c's pairs into the chunk's own array."""
    never_inline()
    sum_pairs(force, None, None, rows_in_one_loop(force.lanes), c, thread)


@chunk_task
def chunk_forces_and_sums(force, c, thread):
    """Sum the forces of chunk c's pairs, and the chunk's energy and virial."""
    never_inline()
    sum_pairs(force, force.sums, None, rows_in_one_loop(force.lanes), c, thread)


@as_written
def sum_pairs(force, sums, deviation, together, c, thread):
    """Sum the forces of chunk c's pairs. If they are not None, also sum energy and virial, and the variation along one
    `Deviation`. ``together`` is the number of rows that one loop goes through; if it is None, each row has a loop."""
    pairs = force.pairs
    zero = nothing(force.lanes)
    x, forces, reactions, table, row_sums = working_arrays(zero, pairs, force.chunks, c, thread)
    rows, start, used, touched = pairs.rows[c], pairs.row_start[c], pairs.used[c], pairs.touched[c]
    for cluster in range(pairs.counts[N_CLUSTERS]):
        if touched[cluster]:
            store_vector(forces, cluster, splat(0.0), splat(0.0), splat(0.0))
            clear(reactions, cluster, zero)
            if deviation is not None:
                store_vector(deviation.s, cluster, splat(0.0), splat(0.0), splat(0.0))
    cutoff2 = force.cutoff**2
    laws = in_registers((force.law, force.at_cutoff, force.truncation, force.tables), zero)
    energy_sum, virial_sum, pair_count = splat(0.0), splat(0.0), splat(0.0)
    along_sum = zeros_along(force.along, sums)
    begin, end = chunk_clusters(pairs, c)
    rows_each, front = WIDTH // pairs.per_row, streams(pairs)
    loops, rows_of_loop = (rows_each, 1) if together is None else (1, together)
    for cluster in range(pairs.counts[N_CLUSTERS]):
        if not touched[cluster]:
            continue
        first = rows_each * cluster
        mine = begin <= cluster and cluster < end
        if start[first] == start[first + rows_each] and not mine:
            continue
        fetch_streams(front, pairs, x, reactions, cluster, zero)
        fill_table(table, pairs, cluster, used[cluster], zero)
        # A step is a chain of 20 dependent operations. To keep the processor busy, the loop works on three steps at
        # once: the sums of this step, the forces of the next, and the displacements of the step after that.
        at, own = start[first], WIDTH * cluster
        other, place = entry(rows, at, 0), entry(rows, at, 1)
        dx, dy, dz = displacements(zero, x, table, other, place)
        r2 = dx * dx + dy * dy + dz * dz
        energy, force_over_r = pair_terms(laws, own + particle_of(zero, place), other, r2)
        g = select(r2 < cutoff2, force_over_r, 0.0)
        if deviation is not None:
            h = slope_within(laws, own + particle_of(zero, place), other, r2, cutoff2)
        next_other, next_place = entry(rows, at + 1, 0), entry(rows, at + 1, 1)
        next_dx, next_dy, next_dz = displacements(zero, x, table, next_other, next_place)
        next_r2 = next_dx * next_dx + next_dy * next_dy + next_dz * next_dz
        for row in range(loops):
            fx, fy, fz = row_start(zero, laws, pairs, table, cluster, row, cutoff2)
            if deviation is not None:
                varied = row_deviation(deviation, cluster, row, zero)
            if together is not None:
                before = place
            for k in range(start[first + row], start[first + row + rows_of_loop]):
                later_other, later_place = entry(rows, k + 2, 0), entry(rows, k + 2, 1)
                later_dx, later_dy, later_dz = displacements(zero, x, table, later_other, later_place)
                later_r2 = later_dx * later_dx + later_dy * later_dy + later_dz * later_dz
                i = own + particle_of(zero, next_place)
                next_energy, force_over_r = pair_terms(laws, i, next_other, next_r2)
                next_g = select(next_r2 < cutoff2, force_over_r, 0.0)
                if together is not None:
                    fx, fy, fz = of_row((fx, fy, fz), place, before)
                    if deviation is not None:
                        varied = deviation_at(deviation, varied, cluster, place, before)
                fx, fy, fz = multiply_add(g, dx, fx), multiply_add(g, dy, fy), multiply_add(g, dz, fz)
                if together is not None:
                    store_row_force(row_sums, row_of(place), fx, fy, fz)
                subtract_reactions(reactions, other, -g, dx, dy, dz)
                if deviation is not None:
                    varied = varied_row(deviation, varied, other, g, h, dx, dy, dz)
                    if together is not None:
                        store_row_slope(deviation, row_of(place), varied)
                    h = slope_within(laws, i, next_other, next_r2, cutoff2)
                if sums is not None:
                    inside = r2 < cutoff2
                    energy_sum = energy_sum + in_float64(select(inside, energy, 0.0))
                    virial_sum = virial_sum + in_float64(g * select(inside, r2, 0.0))
                    pair_count = pair_count + in_float64(select(inside, zero + 1.0, 0.0))
                    along_sum = add_along(along_sum, g * dx, g * dy, g * dz, dx, dy, dz)
                if together is not None:
                    before, place = place, next_place
                other, dx, dy, dz, r2, g, energy = next_other, next_dx, next_dy, next_dz, next_r2, next_g, next_energy
                next_other, next_place, next_r2 = later_other, later_place, later_r2
                next_dx, next_dy, next_dz = later_dx, later_dy, later_dz
            if together is None:
                store_row_force(row_sums, row, fx, fy, fz)
                if deviation is not None:
                    store_row_slope(deviation, row, varied)
        own_x, own_y, own_z = load_vector(forces, cluster)
        if mine and not is_inside(pairs.special, cluster):
            gx, gy, gz, energy_own, virial_own, count_own, along_sum = own_pairs(
                zero, laws, pairs, cluster, cutoff2, along_sum
            )
            own_x, own_y, own_z = own_x + gx, own_y + gy, own_z + gz
            if sums is not None:
                energy_sum, virial_sum, pair_count = (
                    energy_sum + energy_own,
                    virial_sum + virial_own,
                    pair_count + count_own,
                )
        own_x = own_x + row_forces(row_sums, 0, start, first, zero)
        own_y = own_y + row_forces(row_sums, 1, start, first, zero)
        own_z = own_z + row_forces(row_sums, 2, start, first, zero)
        store_vector(forces, cluster, own_x, own_y, own_z)
        if deviation is not None:
            add_row_slopes(deviation, start, first, cluster)
            if mine and not is_inside(pairs.special, cluster):
                vary_cluster(deviation, laws, pairs.x, cluster, cutoff2)
    totals = energy_sum, virial_sum, pair_count, along_sum
    energy_sum, virial_sum, pair_count, along_sum = add_special(pairs.special, laws, pairs, forces, c, cutoff2, totals)
    for cluster in range(pairs.counts[N_CLUSTERS]):
        if touched[cluster]:
            add_reactions(forces, reactions, cluster, zero)
            hand_over(pairs, force.chunks, forces, cluster, c)
    if sums is not None:
        sums[c, 0] = lane_sum(energy_sum)
        sums[c, 1] = lane_sum(trace_of(along_sum, virial_sum))
        sums[c, 2] = lane_sum(pair_count)
        store_along(along_sum, force.along, c)

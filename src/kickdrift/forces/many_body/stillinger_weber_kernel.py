"""Compiled sums of Stillinger and Weber's potential, in a time that grows as the neighbours, not as their pairs.

The sum over triples of g_j g_k (cos - c)^2 is a square of moments of the neighbours' directions n: with S = sum g,
V = sum g n and M = sum g n n^T it is M:M - 2 c V.V + c^2 S^2, less the terms with j = k. So one loop over the
neighbours finds the moments, and a second the forces. The particles of a cluster are in lanes: each step of a loop
takes one neighbour of each.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from kickdrift.forces.lists.along import add_along, store_along, zeros_along
from kickdrift.forces.lists.clusters import chunk_clusters
from kickdrift.forces.lists.neighbours import ROW, neighbours_of_eight, separations
from kickdrift.forces.many_body.kernel import clear_reached, law_body, row_numbers
from kickdrift.jit.compile import as_written, never_inline
from kickdrift.jit.duals.lanes import (
    add_rows_at,
    in_double,
    in_precision_of,
    inverse_sqrt,
    lane_exp,
    lane_log,
    lane_sum,
    load,
    rows_at,
    select,
    store,
    value_of,
)
from kickdrift.jit.lanes.functions import splat
from kickdrift.jit.lanes.memory import aligned
from kickdrift.jit.lanes.single import zeros_in
from kickdrift.jit.lanes.vectors import WIDTH
from kickdrift.jit.threads.chunks import chunk_task, each_chunk

NX, NY, NZ, INVERSE, G, SLOPE_G, ALONG, KIND, R = range(9)  # what is kept of each neighbour
KEPT = 9
MOMENTS = 11


class StillingerWeberLaw(NamedTuple):
    """Parameters of each pair and triple of species, of float32 in mixed precision, and workspace."""

    by_pair: NDArray[Any]  # (species^2, 8) cutoff, sigma, gamma sigma, A epsilon, B sigma^p, sigma^q, p, q
    by_triple: NDArray[Any]  # (species^3, 4) w, w c, w c^2 and w (1 - c)^2: w is lambda epsilon, c is cos_theta0
    species: int
    plain: bool  # whether p is 4 and q is 0 for all pairs
    kept: NDArray[Any]  # (chunks, room * 9 * 8)
    moments: NDArray[Any]  # (chunks, 2 species * 11 * 8) sums over neighbours of a species, and their weighted sums
    forces: NDArray[np.float64]  # (chunks, 4 slots) from the terms of each chunk: x, y, z and 0 for each slot

    def with_room(self, slots: int, room: int, chunks: int) -> StillingerWeberLaw:
        """Return the law with workspace for this room."""
        kind = self.by_pair.dtype
        return self._replace(
            kept=aligned((chunks, room * KEPT * WIDTH), None, kind),
            moments=aligned((chunks, 2 * self.species * MOMENTS * WIDTH), 0.0, kind),
            forces=aligned((chunks, ROW * slots)),
        )


@law_body(StillingerWeberLaw, ("by_pair", "by_triple"))
def stillinger_weber(law, force, chunks):
    each_chunk(force, chunks, "chunk_stillinger_weber")
    each_chunk(force, chunks, "collect_forces")


@chunk_task
def chunk_stillinger_weber(force, c):
    """Sum the forces of the terms centred at chunk c's particles."""
    never_inline()
    rows, law, pairs = force.rows, force.law, force.pairs
    forces, kept, moments, table, places = law.forces[c], law.kept[c], law.moments[c], law.by_pair, rows.places[c]
    cutoff2, species, zero = force.cutoff**2, law.species, zeros_in(table)
    clear_reached(force, forces, c, ROW)
    energy, virial, pair_count = splat(0.0), splat(0.0), splat(0.0)
    by_axis = zeros_along(force.along, force.sums)
    begin, end = chunk_clusters(pairs, c)
    for cluster in range(begin, end):
        most = neighbours_of_eight(rows, c, cluster, cutoff2)
        count = load(rows.counts[c], 0)
        pair_count = pair_count + count
        x, y, z, own = rows_at(rows.at, places, 0)
        own = in_precision_of(table, value_of(own))
        for j in range(most):
            here = count > float(j)
            dx, dy, dz, kind = separations(rows, rows.at, places, WIDTH * (j + 1), x, y, z)
            kind = in_precision_of(table, value_of(kind))
            cut, sigma, gs, a = row_numbers(table, kind + own * float(species), 0)
            b, one, p, q = row_numbers(table, kind + own * float(species), 4)
            r2 = in_precision_of(table, select(here, dx * dx + dy * dy + dz * dz, cutoff2))
            inverse = inverse_sqrt(r2)
            r = r2 * inverse
            here = here & ~(r >= cut)
            near = 1.0 / select(here, r - cut, -1.0)
            if law.plain:
                repulsion, attraction = b * inverse**4, one
                slope = -4.0 * repulsion * inverse
            else:
                log_r = lane_log(r)
                repulsion, attraction = b * lane_exp(-p * log_r), one * lane_exp(-q * log_r)
                slope = (q * attraction - p * repulsion) * inverse
            decay = select(here, 0.5 * a * lane_exp(sigma * near), 0.0)
            g = select(here, lane_exp(gs * near), 0.0)
            pair_energy = (repulsion - attraction) * decay
            energy = energy + in_double(pair_energy)
            at = j * KEPT * WIDTH
            store(kept, at + NX * WIDTH, in_precision_of(table, -dx) * inverse)
            store(kept, at + NY * WIDTH, in_precision_of(table, -dy) * inverse)
            store(kept, at + NZ * WIDTH, in_precision_of(table, -dz) * inverse)
            store(kept, at + INVERSE * WIDTH, inverse)
            store(kept, at + G * WIDTH, g)
            store(kept, at + SLOPE_G * WIDTH, -gs * near * near * g)
            store(kept, at + ALONG * WIDTH, slope * decay - pair_energy * sigma * near * near)
            store(kept, at + KIND * WIDTH, kind)
            store(kept, at + R * WIDTH, r)
        sum_moments(kept, moments, most, species, zero)
        weigh_moments(law, moments, own, species, zero)
        fx, fy, fz = splat(0.0), splat(0.0), splat(0.0)
        for j in range(most):
            at = j * KEPT * WIDTH
            nx, ny, nz = load(kept, at), load(kept, at + NY * WIDTH), load(kept, at + NZ * WIDTH)
            inverse, g = load(kept, at + INVERSE * WIDTH), load(kept, at + G * WIDTH)
            along, kind = load(kept, at + ALONG * WIDTH), value_of(load(kept, at + KIND * WIDTH))
            gx, gy, gz = zero, zero, zero
            for b in range(species):
                g_b = select(kind == float(b), g, 0.0)
                w = (species + b) * MOMENTS * WIDTH
                vx, vy, vz = load(moments, w + WIDTH), load(moments, w + 2 * WIDTH), load(moments, w + 3 * WIDTH)
                xx, yy, zz = load(moments, w + 4 * WIDTH), load(moments, w + 5 * WIDTH), load(moments, w + 6 * WIDTH)
                xy, xz, yz = load(moments, w + 7 * WIDTH), load(moments, w + 8 * WIDTH), load(moments, w + 9 * WIDTH)
                tx = xx * nx + xy * ny + xz * nz - vx
                ty = xy * nx + yy * ny + yz * nz - vy
                tz = xz * nx + yz * ny + zz * nz - vz
                tn = tx * nx + ty * ny + tz * nz
                h = tn - (vx * nx + vy * ny + vz * nz) + load(moments, w) - load(moments, w + 10 * WIDTH) * g
                energy = energy + in_double(0.5 * g_b * h)
                along = along + select(kind == float(b), load(kept, at + SLOPE_G * WIDTH) * h, 0.0)
                across = 2.0 * g_b * inverse
                gx = gx + across * (tx - tn * nx)
                gy = gy + across * (ty - tn * ny)
                gz = gz + across * (tz - tn * nz)
            gx, gy, gz = in_double(gx + along * nx), in_double(gy + along * ny), in_double(gz + along * nz)
            virial = virial - in_double(along * load(kept, at + R * WIDTH))
            r = -in_double(load(kept, at + R * WIDTH))
            by_axis = add_along(by_axis, r * gx, r * gy, r * gz, in_double(nx), in_double(ny), in_double(nz))
            fx, fy, fz = fx + gx, fy + gy, fz + gz
            add_rows_at(forces, places, WIDTH * (j + 1), (-gx, -gy, -gz, 0.0 * gx))
        add_rows_at(forces, places, 0, (fx, fy, fz, 0.0 * fx))
    force.sums[c, 0] = lane_sum(energy)
    force.sums[c, 1] = lane_sum(virial)
    store_along(by_axis, force.along, c)
    force.sums[c, 2] = 0.5 * lane_sum(pair_count)


@as_written
def sum_moments(kept, moments, most, species, zero):
    """Sum S, V, M (xx yy zz xy xz yz) over the neighbours of each species."""
    for b in range(species):
        s, vx, vy, vz = zero, zero, zero, zero
        xx, yy, zz, xy, xz, yz = zero, zero, zero, zero, zero, zero
        for j in range(most):
            at = j * KEPT * WIDTH
            nx, ny, nz = load(kept, at), load(kept, at + NY * WIDTH), load(kept, at + NZ * WIDTH)
            mine = value_of(load(kept, at + KIND * WIDTH)) == float(b)
            g = select(mine, load(kept, at + G * WIDTH), 0.0)
            wx, wy, wz = g * nx, g * ny, g * nz
            s, vx, vy, vz = s + g, vx + wx, vy + wy, vz + wz
            xx, yy, zz = xx + wx * nx, yy + wy * ny, zz + wz * nz
            xy, xz, yz = xy + wx * ny, xz + wx * nz, yz + wy * nz
        at = b * MOMENTS * WIDTH
        for each in (s, vx, vy, vz, xx, yy, zz, xy, xz, yz):
            store(moments, at, each)
            at += WIDTH


@as_written
def weigh_moments(law, moments, own, species, zero):
    """For neighbours of each species, sum the moments with the weights of their triples. The last number is the weight
    of the terms with j = k."""
    for b in range(species):
        at = (species + b) * MOMENTS * WIDTH
        for m in range(MOMENTS):
            store(moments, at + m * WIDTH, zero)
        for k in range(species):
            row = (own * float(species) + float(b)) * float(species) + float(k)
            w, wc, wcc, alone = row_numbers(law.by_triple, row, 0)
            source = k * MOMENTS * WIDTH
            for m in range(MOMENTS - 1):
                weight = wcc if m == 0 else (wc if m < 4 else w)
                store(
                    moments, at + m * WIDTH, load(moments, at + m * WIDTH) + weight * load(moments, source + m * WIDTH)
                )
            if k == b:
                store(moments, at + 10 * WIDTH, alone)

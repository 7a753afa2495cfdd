"""Compiled sums of Stillinger and Weber's potential, in a time that grows as the neighbours, not as their pairs.

The sum over triples of g_j g_k (cos - c)^2 is a square of moments of the neighbours' directions n: with S = sum g,
V = sum g n and M = sum g n n^T it is M:M - 2 c V.V + c^2 S^2, less the terms with j = k. So one loop over the
neighbours finds the moments, and a second the forces.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from kickdrift.forces.lists.along import add_along, store_along, zeros_along
from kickdrift.forces.lists.clusters import STRIDE, chunk_clusters
from kickdrift.forces.lists.neighbours import ROW, block_of_neighbours
from kickdrift.forces.many_body.kernel import clear, collect, law_body, react, row_numbers
from kickdrift.jit.compile import as_written, never_inline
from kickdrift.jit.duals.lanes import inverse_sqrt, lane_exp, lane_log, lane_sum, load, select, store, value_of
from kickdrift.jit.lanes.functions import splat
from kickdrift.jit.lanes.masks import mask_bits
from kickdrift.jit.lanes.memory import aligned
from kickdrift.jit.lanes.vectors import WIDTH
from kickdrift.jit.threads.chunks import chunk_task, each_chunk

COLUMNS = 8  # of `by_pair`
KEPT = 9  # numbers kept of each neighbour
MOMENTS = 11


class StillingerWeberLaw(NamedTuple):
    """Parameters of each pair and triple of species."""

    by_pair: NDArray[
        np.float64
    ]  # (species, species, 8) cutoff, sigma, gamma sigma, A epsilon, B sigma^p, sigma^q, p, q
    weight: NDArray[np.float64]  # (species, species, species) lambda epsilon, the first at the centre
    cosine: NDArray[np.float64]  # (species, species, species)
    plain: bool  # whether p is 4 and q is 0 for all pairs
    kept: NDArray[np.float64]  # (chunks, room * 9)
    moments: NDArray[np.float64]  # (chunks, 2 species, 11) sums over neighbours of a species, and their weighted sums
    reactions: NDArray[np.float64]  # (chunks, 24)

    def with_room(self, slots: int, room: int, chunks: int) -> StillingerWeberLaw:
        """Return the law with workspace for this room."""
        return self._replace(
            kept=aligned((chunks, room * KEPT), fill=None),
            moments=aligned((chunks, 2 * len(self.weight), MOMENTS)),
            reactions=aligned((chunks, 3 * WIDTH)),
        )


@law_body(StillingerWeberLaw)
def stillinger_weber(law, force, chunks):
    each_chunk(force, chunks, "chunk_stillinger_weber")
    collect(force.pairs, chunks)


@as_written
def pair_numbers(law, own, kind):
    """Return the parameters of the pairs with neighbours of these species."""
    species = law.by_pair.shape[0]
    row = kind + own * species
    c, sigma, gs, a = row_numbers(law.by_pair, species, row, COLUMNS, 0)
    b, one, p, q = row_numbers(law.by_pair, species, row, COLUMNS, 4)
    return c, sigma, gs, a, b, one, p, q


@chunk_task
def chunk_stillinger_weber(force, c):
    """Sum the forces of the terms centred at chunk c's particles."""
    never_inline()
    rows, law, pairs = force.rows, force.law, force.pairs
    clear(pairs, c)
    forces, kept, moments, reactions = pairs.force[c], law.kept[c], law.moments[c], law.reactions[c]
    cutoff2, species, room = force.cutoff**2, law.by_pair.shape[0], rows.near.shape[1]
    energy, virial, pair_count = splat(0.0), splat(0.0), splat(0.0)
    by_axis = zeros_along(force.along, force.sums)
    begin, end = chunk_clusters(pairs, c)
    for cluster in range(begin, end):
        for slot in range(WIDTH * cluster, WIDTH * cluster + pairs.filled[cluster]):
            own = value_of(rows.at[ROW * slot + 3])
            for first in range(0, rows.lengths[slot], WIDTH):
                dx, dy, dz, r2, beyond, kind = block_of_neighbours(rows, slot, first, cutoff2)
                cut, sigma, gs, a, b, one, p, q = pair_numbers(law, own, kind)
                r2 = select(beyond, splat(cutoff2), r2)
                inverse = inverse_sqrt(r2)
                r = r2 * inverse
                beyond = beyond | (r >= cut)
                near = 1.0 / select(beyond, splat(-1.0), r - cut)
                if law.plain:
                    repulsion, attraction = b * inverse**4, one
                    slope = -4.0 * repulsion * inverse
                else:
                    log_r = lane_log(r)
                    repulsion, attraction = b * lane_exp(-p * log_r), one * lane_exp(-q * log_r)
                    slope = (q * attraction - p * repulsion) * inverse
                decay = select(beyond, splat(0.0), 0.5 * a * lane_exp(sigma * near))
                g = select(beyond, splat(0.0), lane_exp(gs * near))
                pair_energy = (repulsion - attraction) * decay
                energy = energy + pair_energy
                pair_count = pair_count + select(beyond, splat(0.0), splat(1.0))
                at = first * KEPT
                store(kept, at, -dx * inverse)
                store(kept, at + WIDTH, -dy * inverse)
                store(kept, at + 2 * WIDTH, -dz * inverse)
                store(kept, at + 3 * WIDTH, inverse)
                store(kept, at + 4 * WIDTH, g)
                store(kept, at + 5 * WIDTH, -gs * near * near * g)
                store(kept, at + 6 * WIDTH, slope * decay - pair_energy * sigma * near * near)
                store(kept, at + 7 * WIDTH, select(beyond, splat(-1.0), kind))
                store(kept, at + 8 * WIDTH, r)
            sum_moments(kept, moments, rows.lengths[slot], species)
            weigh_moments(law, moments, int(own), species)
            fx, fy, fz = splat(0.0), splat(0.0), splat(0.0)
            for first in range(0, rows.lengths[slot], WIDTH):
                at = first * KEPT
                nx, ny, nz = load(kept, at), load(kept, at + WIDTH), load(kept, at + 2 * WIDTH)
                inverse, g, slope_g = load(kept, at + 3 * WIDTH), load(kept, at + 4 * WIDTH), load(kept, at + 5 * WIDTH)
                along, kind = load(kept, at + 6 * WIDTH), load(kept, at + 7 * WIDTH)
                gx, gy, gz = splat(0.0), splat(0.0), splat(0.0)
                for b in range(species):
                    mine = kind == float(b)
                    g_b, w = select(mine, g, 0.0), species + b
                    vx, vy, vz = moments[w, 1], moments[w, 2], moments[w, 3]
                    tx = moments[w, 4] * nx + moments[w, 7] * ny + moments[w, 8] * nz - vx
                    ty = moments[w, 7] * nx + moments[w, 5] * ny + moments[w, 9] * nz - vy
                    tz = moments[w, 8] * nx + moments[w, 9] * ny + moments[w, 6] * nz - vz
                    tn = tx * nx + ty * ny + tz * nz
                    h = tn - (vx * nx + vy * ny + vz * nz) + moments[w, 0] - moments[w, 10] * g
                    energy = energy + 0.5 * g_b * h
                    along = along + select(mine, slope_g * h, 0.0)
                    across = 2.0 * g_b * inverse
                    gx, gy, gz = (
                        gx + across * (tx - tn * nx),
                        gy + across * (ty - tn * ny),
                        gz + across * (tz - tn * nz),
                    )
                gx, gy, gz = gx + along * nx, gy + along * ny, gz + along * nz
                virial = virial - along * load(kept, at + 8 * WIDTH)
                r = -load(kept, at + 8 * WIDTH)
                by_axis = add_along(by_axis, r * gx * nx, r * gy * ny, r * gz * nz)
                fx, fy, fz = fx + gx, fy + gy, fz + gz
                react(forces, reactions, rows.near, slot * room + first, mask_bits(kind >= 0.0), gx, gy, gz)
            p = STRIDE * cluster + slot % WIDTH
            forces[p] += lane_sum(fx)
            forces[p + WIDTH] += lane_sum(fy)
            forces[p + 2 * WIDTH] += lane_sum(fz)
    force.sums[c, 0] = lane_sum(energy)
    force.sums[c, 1] = lane_sum(virial)
    store_along(by_axis, force.along, c)
    force.sums[c, 2] = 0.5 * lane_sum(pair_count)


@as_written
def sum_moments(kept, moments, count, species):
    """Sum S, V, M (xx yy zz xy xz yz) and g^2 over the neighbours of each species."""
    for b in range(species):
        s, vx, vy, vz = splat(0.0), splat(0.0), splat(0.0), splat(0.0)
        xx, yy, zz, xy, xz, yz = splat(0.0), splat(0.0), splat(0.0), splat(0.0), splat(0.0), splat(0.0)
        for first in range(0, count, WIDTH):
            at = first * KEPT
            nx, ny, nz = load(kept, at), load(kept, at + WIDTH), load(kept, at + 2 * WIDTH)
            g = select(load(kept, at + 7 * WIDTH) == float(b), load(kept, at + 4 * WIDTH), 0.0)
            wx, wy, wz = g * nx, g * ny, g * nz
            s, vx, vy, vz = s + g, vx + wx, vy + wy, vz + wz
            xx, yy, zz = xx + wx * nx, yy + wy * ny, zz + wz * nz
            xy, xz, yz = xy + wx * ny, xz + wx * nz, yz + wy * nz
        moments[b, 0] = lane_sum(s)
        moments[b, 1], moments[b, 2], moments[b, 3] = lane_sum(vx), lane_sum(vy), lane_sum(vz)
        moments[b, 4], moments[b, 5], moments[b, 6] = lane_sum(xx), lane_sum(yy), lane_sum(zz)
        moments[b, 7], moments[b, 8], moments[b, 9] = lane_sum(xy), lane_sum(xz), lane_sum(yz)


@as_written
def weigh_moments(law, moments, own, species):
    """For neighbours of each species, sum the moments with the weights of their triples. The last number is the weight
    of the terms with j = k."""
    for b in range(species):
        w = species + b
        for m in range(MOMENTS):
            moments[w, m] = 0.0
        for k in range(species):
            weight, cosine = law.weight[own, b, k], law.cosine[own, b, k]
            moments[w, 0] += weight * cosine * cosine * moments[k, 0]
            for m in range(1, 4):
                moments[w, m] += weight * cosine * moments[k, m]
            for m in range(4, 10):
                moments[w, m] += weight * moments[k, m]
        moments[w, 10] = law.weight[own, b, b] * (1.0 - law.cosine[own, b, b]) ** 2

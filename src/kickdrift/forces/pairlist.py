"""The cluster pair list: which particles may be within the cutoff of each other, laid out for SIMD.

Particles are sorted into columns over the x-y plane and by z in each, and padded to clusters of eight. The list holds,
for every particle i, the clusters J (with the periodic shift to apply) that hold a particle within the cutoff plus a
skin: an *outer* list with a wide skin, made from the sorted columns, and an *inner* one pruned from it, which the
forces run over (the scheme of Páll & Hess, Comput. Phys. Commun. 184, 2641, 2013, doi:10.1016/j.cpc.2013.06.003). Every
pair of images stands once: J's image follows i's cluster in the order (column x, column y, cluster), unwrapped across
the periodic edges; the pairs inside a cluster are implied. A list is refreshed when a particle has moved by half its
skin, which is looked at on every force evaluation, and is a function of the positions alone.
"""

from __future__ import annotations

import numpy as np

from kickdrift.forces.chunks import chunk_task, each_chunk
from kickdrift.forces.clusters import (
    BUILT,
    JUMPS_ALLOWED,
    N_CLUSTERS,
    NX,
    NY,
    OUTER_BUILDS,
    PRUNES,
    ROOM_NEEDED,
    SHIFT_BITS,
    STRIDE,
    chunk_clusters,
    copy,
    copy_positions,
    largest_move,
    load_vector,
    sort,
)
from kickdrift.forces.compiling import jit, never_inline
from kickdrift.forces.kernel import BLOWN_UP, GROW, OK
from kickdrift.forces.simd import WIDTH, any_lane, flat, load, mask_bits, select, splat, store


@jit
def refresh(pairs, x, threads):
    """Bring the list up to date with positions x (3, n): OK, GROW (room for ``counts[ROOM_NEEDED]``) or BLOWN_UP."""
    counts = pairs.counts
    if counts[BUILT]:
        copy_positions(pairs, x)
        inner, total = largest_move(pairs, pairs.inner_reference)
        jumped = (
            inner > (pairs.cutoff + 0.5 * pairs.inner_skin) ** 2
        )  # past the whole range of the force since the last call
        if not np.isfinite(total) or (jumped and not counts[JUMPS_ALLOWED]):
            return BLOWN_UP
        if 4.0 * inner <= pairs.inner_skin**2:
            return OK
        outer, total = largest_move(pairs, pairs.outer_reference)
        if 4.0 * outer <= (pairs.outer_skin - pairs.inner_skin) ** 2:
            prune(pairs, threads)
            return OK
    for k in range(3):
        for i in range(x.shape[1]):
            if not np.isfinite(x[k, i]):
                return BLOWN_UP
    counts[BUILT] = 0
    sort(pairs, x)
    copy_positions(pairs, x)
    search(pairs, threads)
    if counts[ROOM_NEEDED] > pairs.outer.shape[1]:
        return GROW
    copy(flat(x), flat(pairs.built_at))
    prune(pairs, threads)
    counts[BUILT] = 1
    return OK


@jit
def search(pairs, threads):
    """Make the outer list from the sorted clusters."""
    each_chunk(pairs, threads, "search_chunk")
    needed = 0
    for made in pairs.made:
        needed = max(needed, made)
    pairs.counts[ROOM_NEEDED] = needed
    pairs.counts[OUTER_BUILDS] += 1
    copy(pairs.x, pairs.outer_reference)


@jit
def prune(pairs, threads):
    """Make the inner list from the outer one."""
    each_chunk(pairs, threads, "prune_chunk")
    pairs.counts[PRUNES] += 1
    copy(pairs.x, pairs.inner_reference)


@chunk_task
def search_chunk(pairs, c):
    """Make chunk c's share of the outer list, and count its entries, also where room ran out.

    Particle i lists cluster J where it is within reach of J's bounding box: eight particles are tested at a time.
    """
    never_inline()
    reach2 = (pairs.cutoff + pairs.outer_skin) ** 2
    shifts, filled, span, bounds = pairs.shifts, pairs.filled, pairs.outer_span, pairs.bounds
    entries, room = pairs.outer[c], pairs.outer.shape[1]
    touched = pairs.touched[c]
    for cluster in range(touched.size):
        touched[cluster] = False
    most = min(27 * pairs.counts[N_CLUSTERS], 1 << 20)
    near, particles_near = np.empty(most, np.int32), np.empty(most, np.int64)
    begin, end = chunk_clusters(pairs, c)
    made = 0
    for cluster in range(begin, end):
        touched[cluster] = True
        xi, yi, zi = load_vector(pairs.x, cluster)
        candidates = clusters_near(pairs, cluster, reach2, near)
        kept = 0
        for k in range(candidates):
            other, s = near[k] >> SHIFT_BITS, near[k] & 31
            dx = gap(xi - shifts[0, s], bounds[0, other], bounds[3, other])
            dy = gap(yi - shifts[1, s], bounds[1, other], bounds[4, other])
            dz = gap(zi - shifts[2, s], bounds[2, other], bounds[5, other])
            near[kept] = near[k]
            particles_near[kept] = mask_bits(dx * dx + dy * dy + dz * dz < reach2)
            kept += particles_near[kept] != 0
        for lane in range(filled[cluster]):
            span[WIDTH * cluster + lane, 0] = made
            if made + kept < room:
                for k in range(kept):
                    entries[made] = near[k]  # overwritten unless kept
                    made += (particles_near[k] >> lane) & 1
            else:
                made += kept  # an upper bound is room enough
            span[WIDTH * cluster + lane, 1] = made
        for k in range(kept):
            touched[near[k] >> SHIFT_BITS] = True
    pairs.made[c] = made + 1


@jit
def gap(x, low, high):
    """How far x lies outside of the interval."""
    below, above = low - x, x - high
    far = select(below > above, below, above)
    return select(far > 0.0, far, splat(0.0))


@jit
def clusters_near(pairs, cluster, reach2, near):
    """Fill ``near`` with the entries of the clusters after this one that may be within reach, by column and height."""
    nx, ny = pairs.counts[NX], pairs.counts[NY]
    home, bounds, shifts, column_clusters = pairs.home[cluster], pairs.bounds, pairs.shifts, pairs.column_clusters
    cx, cy = home // ny, home % ny
    periodic = pairs.edges[0] > 0.0
    width_x, width_y, low_x, low_y = pairs.grid
    reach = reach2**0.5
    span_x, span_y = int(reach / width_x) + 1, int(reach / width_y) + 1
    x_to = min(cx + span_x, 2 * nx - 1 if periodic else nx - 1)
    y_from, y_to = max(cy - span_y, -ny if periodic else 0), min(cy + span_y, 2 * ny - 1 if periodic else ny - 1)
    found = 0
    for ux in range(cx, x_to + 1):
        shift_x = ux // nx
        gap_x = max(0.0, low_x + ux * width_x - bounds[3, cluster])
        for uy in range(y_from, y_to + 1):
            if ux == cx and uy < cy:
                continue
            below, above = low_y + uy * width_y - bounds[4, cluster], bounds[1, cluster] - low_y - (uy + 1) * width_y
            gap_y = max(0.0, below, above)
            height2 = 1.000001 * reach2 - gap_x * gap_x - gap_y * gap_y  # a margin for the rounding of column edges
            if height2 < 0.0:
                continue
            lowest, highest = bounds[2, cluster] - height2**0.5, bounds[5, cluster] + height2**0.5
            shift_y = (uy + ny) // ny - 1
            other_home = (ux - shift_x * nx) * ny + uy - shift_y * ny
            same_column = ux == cx and uy == cy
            for shift_z in range(-1 if periodic and not same_column else 0, 2 if periodic else 1):
                s = 9 * (shift_x + 1) + 3 * (shift_y + 1) + shift_z + 1
                here = same_column and shift_z == 0
                for other in range(
                    cluster + 1 if here else column_clusters[other_home], column_clusters[other_home + 1]
                ):
                    if bounds[2, other] + shifts[2, s] > highest:
                        break
                    if bounds[5, other] + shifts[2, s] >= lowest and found < near.size:
                        near[found] = (other << SHIFT_BITS) | s
                        found += 1
    return found


@jit
def shift_particle(x, p, shifts, shifted):
    """The position at place p less each of the shifts: (3, 32), flat. Looking them up costs less than subtracting."""
    for k in range(3):
        here = splat(x[p + k * WIDTH])
        for s in range(0, 4 * WIDTH, WIDTH):
            store(shifted, 4 * WIDTH * k + s, here - load(shifts[k], s))


@chunk_task
def prune_chunk(pairs, c):
    """Keep those of chunk c's outer entries that have a particle within the cutoff and the inner skin."""
    never_inline()
    shifts, filled, outer_span, inner_span = pairs.shifts, pairs.filled, pairs.outer_span, pairs.inner_span
    reach = pairs.cutoff + pairs.inner_skin
    outer, inner = pairs.outer[c], pairs.inner[c]
    x, shifted = pairs.x, np.empty(3 * 4 * WIDTH)
    begin, end = chunk_clusters(pairs, c)
    made = 0
    for cluster in range(begin, end):
        for lane in range(filled[cluster]):
            i = WIDTH * cluster + lane
            shift_particle(x, STRIDE * cluster + lane, shifts, shifted)
            inner_span[i, 0] = made
            for k in range(outer_span[i, 0], outer_span[i, 1]):
                entry = outer[k]
                s = entry & 31
                xj, yj, zj = load_vector(x, entry >> SHIFT_BITS)
                xi, yi, zi = splat(shifted[s]), splat(shifted[s + 32]), splat(shifted[s + 64])
                dx, dy, dz = xi - xj, yi - yj, zi - zj
                inner[made] = entry  # overwritten unless kept
                made += any_lane(dx * dx + dy * dy + dz * dz < reach * reach)
            inner_span[i, 1] = made

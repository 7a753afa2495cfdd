"""The cluster pair list: pairs of particles that may be within the cutoff, arranged for SIMD."""

from __future__ import annotations

from math import ceil, floor
from typing import Any

import numpy as np

from kickdrift.forces.box_change import (
    PRUNED,
    SEARCHED,
    adopt,
    keep_lengths,
    least_factor,
)
from kickdrift.forces.cluster_load import Loading, keep_positions, move_since
from kickdrift.forces.cluster_sort import sort
from kickdrift.forces.clusters import (
    BUILT,
    JUMPS_ALLOWED,
    LOOKED_AHEAD,
    N_CLUSTERS,
    NX,
    NY,
    OUTER_BUILDS,
    PRUNES,
    ROOM_NEEDED,
    SHIFT_BITS,
    SHIFTS,
    STRIDE,
    chunk_clusters,
    copy,
    load_vector,
    table_place,
)
from kickdrift.forces.kernel import BLOWN_UP, GROW, OK
from kickdrift.forces.pair_rows import copy_to_single
from kickdrift.forces.row_lanes import Tiles, blocks
from kickdrift.forces.special_pairs import clear_special, mark_special, place_special, without_special
from kickdrift.forces.tile_rows import write_tiles
from kickdrift.jit.chunks import chunk_task, each_chunk
from kickdrift.jit.compile import as_written, is_finite, jit, never_inline
from kickdrift.jit.handle import handle
from kickdrift.jit.inner import overload
from kickdrift.jit.masks import bytes_with_bits, count_ones, mask_bits
from kickdrift.jit.memory import flat, store
from kickdrift.jit.packing import append_members
from kickdrift.jit.single import joined, load_single
from kickdrift.jit.vectors import WIDTH

OUTWORN = -1  # status of lists that must be made anew


@jit
def refresh(pairs, x, chunks):
    """Update the list for positions x (3, n); return OK, GROW (to ``counts[ROOM_NEEDED]``) or BLOWN_UP."""
    counts = pairs.counts
    adopt(pairs)
    if counts[BUILT]:
        each_chunk(handle(Loading(pairs, x)), chunks, "load_chunk")
        status = outlasts(pairs, chunks)
        if status != OUTWORN:
            return status
    for k in range(3):
        for i in range(x.shape[1]):
            if not is_finite(x[k, i]):
                return BLOWN_UP
    counts[BUILT] = 0
    sort(pairs, x, chunks)
    place_special(pairs.special, pairs.place)
    search(pairs, chunks)
    if counts[ROOM_NEEDED] > pairs.near.shape[1]:
        return GROW
    copy(flat(x), flat(pairs.built_at))
    prune(pairs, chunks)
    counts[BUILT] = 1
    return OK


@jit
def outlasts(pairs, chunks):
    """Prune the outer list if the noted moves of the particles need it.

    Return OK if all pairs within the cutoff are then in the inner list, OUTWORN if the lists must be made anew, or
    BLOWN_UP."""
    inner, total = move_since(pairs, pairs.inner_reference, PRUNED)
    jumped = (
        inner > (pairs.cutoff + 0.5 * pairs.inner_skin) ** 2
    )  # a particle has passed the whole range of the force since the last call
    if not is_finite(total) or (jumped and not pairs.counts[JUMPS_ALLOWED]):
        return BLOWN_UP
    room = pairs.inner_skin - (1.0 - least_factor(pairs, PRUNED)) * (pairs.cutoff + pairs.inner_skin)
    if room >= 0.0 and 4.0 * inner <= room**2:
        return OK
    each_chunk(pairs, chunks, "outer_move_chunk")
    outer, total = move_since(pairs, pairs.outer_reference, SEARCHED)
    room = pairs.outer_skin - pairs.inner_skin
    room -= (1.0 - least_factor(pairs, SEARCHED)) * (pairs.cutoff + pairs.outer_skin)
    if room >= 0.0 and 4.0 * outer <= room**2:
        prune(pairs, chunks)
        return OK
    return OUTWORN


@jit
def search(pairs, chunks):
    """Make the outer list from the sorted clusters."""
    each_chunk(pairs, chunks, "search_chunk")
    needed = 0
    for made in pairs.made:
        needed = max(needed, made)
    pairs.counts[ROOM_NEEDED] = needed
    pairs.counts[OUTER_BUILDS] += 1
    keep_lengths(pairs, SEARCHED)


@jit
def prune(pairs, chunks):
    """Prune the outer list to make the inner list."""
    copy_to_single(pairs, 0, pairs.counts[N_CLUSTERS])
    each_chunk(pairs, chunks, "prune_chunk")
    pairs.counts[PRUNES] += 1
    keep_lengths(pairs, PRUNED)


@chunk_task
def search_chunk(pairs, c):
    """Make chunk c's share of the outer list, and count its entries even if they do not fit."""
    never_inline()
    reach2 = (pairs.cutoff + pairs.outer_skin) ** 2
    span, near, touched = pairs.near_span, pairs.near[c], pairs.touched[c]
    for cluster in range(touched.size):
        touched[cluster] = False
    begin, end = chunk_clusters(pairs, c)
    made = 0
    for cluster in range(begin, end):
        touched[cluster] = True
        span[cluster, 0] = min(made, near.size)
        made = clusters_near(pairs, cluster, reach2, near, made)
        span[cluster, 1] = min(made, near.size)
        for k in range(span[cluster, 0], span[cluster, 1]):
            touched[near[k] >> SHIFT_BITS] = True
    pairs.made[c] = made
    keep_positions(pairs, c, pairs.outer_reference)


@jit
def clusters_near(pairs, cluster, reach2, near, found):
    """Append to ``near`` the later clusters whose bounding box is within reach of this cluster's box.

    Entries begin at ``found``; entries that do not fit are only counted. Return the index of the next entry."""
    for row in range(pairs.bricks.whole.shape[0]):
        found = clusters_near_in(pairs, row, cluster, reach2, near, found)
    return found


@jit
def clusters_near_in(pairs, row, cluster, reach2, near, found):
    """Append the near clusters of one row of bricks, which share a lean; see `clusters_near`."""
    nx, ny = pairs.counts[NX], pairs.counts[NY]
    home, bounds, shifts, column_clusters = pairs.home[cluster], pairs.bounds, pairs.shifts, pairs.column_clusters
    cx, cy = home // ny, home % ny
    width_x, width_y, low_x, low_y = pairs.grid
    first_y, last_y, first_z, last_z = pairs.bricks.whole[row]
    lean_x, lean_y = pairs.bricks.leans[row]
    low_x, low_y = low_x + lean_x, low_y + lean_y
    reach = reach2**0.5
    span_x, span_y = int(reach / width_x) + 1, int(reach / width_y) + 1
    x_from, x_to = cx - span_x - ceil(lean_x / width_x), cx + span_x - floor(lean_x / width_x)
    y_from, y_to = cy - span_y - ceil(lean_y / width_y), cy + span_y - floor(lean_y / width_y)
    x_to = min(x_to, 2 * nx - 1 if pairs.cell.matrix[0, 0] > 0.0 else nx - 1)
    y_from, y_to = max(y_from, first_y * ny), min(y_to, last_y * ny + ny - 1)
    for ux in range(max(x_from, cx), x_to + 1):
        shift_x = int(ux >= nx)
        gap_x = max(0.0, low_x + ux * width_x - bounds[3, cluster], bounds[0, cluster] - low_x - (ux + 1) * width_x)
        for uy in range(y_from, y_to + 1):
            if ux == cx and uy < cy:
                continue
            below, above = low_y + uy * width_y - bounds[4, cluster], bounds[1, cluster] - low_y - (uy + 1) * width_y
            gap_y = max(0.0, below, above)
            height2 = 1.000001 * reach2 - gap_x * gap_x - gap_y * gap_y  # a margin for the rounding of column edges
            if height2 < 0.0:
                continue
            lowest, highest = bounds[2, cluster] - height2**0.5, bounds[5, cluster] + height2**0.5
            shift_y = int(uy >= ny) - int(uy < 0)
            other_home = (ux - shift_x * nx) * ny + uy - shift_y * ny
            same_column = ux == cx and uy == cy
            first, last = column_clusters[other_home], column_clusters[other_home + 1]
            if first == last:
                continue
            for shift_z in range(max(first_z, 0) if same_column else first_z, last_z + 1):
                s = 9 * (shift_x + 1) + 3 * (shift_y + 1) + shift_z + 1
                if lowest > bounds[5, last - 1] + shifts[2, s] or highest < bounds[2, first] + shifts[2, s]:
                    continue
                begin = cluster + 1 if same_column and shift_z == 0 else first
                for other in range(first_above(pairs, begin, last, lowest - shifts[2, s]), last):
                    if bounds[2, other] + shifts[2, s] > highest:
                        break
                    gap2 = 0.0
                    for k in range(3):
                        before = bounds[k, cluster] - bounds[k + 3, other] - shifts[k, s]
                        after = bounds[k, other] + shifts[k, s] - bounds[k + 3, cluster]
                        gap = max(0.0, before, after)
                        gap2 += gap * gap
                    if gap2 < reach2:
                        if found < near.size:
                            near[found] = (other << SHIFT_BITS) | s
                        found += 1
    return found


@jit
def first_above(pairs, begin, end, height):
    """Return the first cluster of a column, from ``begin`` to ``end``, that reaches ``height``; by bisection."""
    while begin < end:
        middle = (begin + end) // 2
        if pairs.bounds[5, middle] < height:
            begin = middle + 1
        else:
            end = middle
    return begin


@chunk_task
def prune_chunk(pairs, c):
    """Make chunk c's rows of the inner list."""
    never_inline()
    make_rows(pairs.block, pairs, c)
    keep_positions(pairs, c, pairs.inner_reference)


def make_rows(block: Any, pairs: Any, c: int) -> None:
    """Make chunk c's rows, of tiles or of particles."""


@overload(make_rows)
def _make_rows(block, pairs, c):
    if block.instance_class is Tiles:
        return lambda block, pairs, c: write_tiles(pairs, c, all_within)
    return lambda block, pairs, c: particle_rows(pairs, c)


@jit
def all_within(pairs, cluster, other, s):
    """Return 64 bits that mark the pairs of two clusters within reach; see `pairs_within`."""
    table = np.empty(4 * 6 * WIDTH, np.float32)
    return pairs_within(pairs, cluster, other, s, spread_rows(pairs, cluster, table), table)


@as_written
def particle_rows(pairs, c):
    """Make chunk c's rows of particles.

    For each pair of near clusters, list the particles of one cluster that have a particle of the other within the
    cutoff plus the inner skin. The rows belong to the cluster that gives fewer rows."""
    span, near = pairs.near_span, pairs.near[c]
    begin, end = chunk_clusters(pairs, c)
    most = 1 + (span[end - 1, 1] - span[begin, 0] if end > begin else 0)
    within, met, by = np.empty(most, np.int64), np.empty(most, np.int32), np.empty(most, np.int32)
    table = np.empty(4 * 6 * WIDTH, np.float32)
    made = 0
    clear_special(pairs.special, c)
    for cluster in range(begin, end):
        filled = pairs.filled[cluster]
        mark_special(pairs.special, pairs.place, c, cluster, filled, True)
        reach2 = spread_rows(pairs, cluster, table)
        for k in range(span[cluster, 0], span[cluster, 1]):
            bits = pairs_within(pairs, cluster, near[k] >> SHIFT_BITS, near[k] & 31, reach2, table)
            bits = without_special(pairs.special, pairs.place, c, cluster, near[k], bits, filled)
            within[made], met[made], by[made] = bits, near[k], cluster
            made += int(bits != 0)  # overwritten unless one is
        mark_special(pairs.special, pairs.place, c, cluster, filled, False)
    write_rows(pairs, c, within[:made], met, by)


@jit
def write_rows(pairs, c, within, met, by):
    """Write chunk c's rows from the pairs within reach in each pair of clusters.

    Members are the particles of one cluster that have a particle of the other within reach. They are eight bits for
    each block of the other cluster, since each block is an entry of its own.
    """
    rows, start, used, per_row = pairs.rows[c], pairs.row_start[c], pairs.used[c], pairs.per_row
    per_shift, each = table_place(per_row, 1, 0), blocks(pairs.block)
    of, members = np.empty(within.size, np.int32), np.empty(within.size + WIDTH, np.int64)
    listed = np.empty(within.size + WIDTH, np.int64)
    clusters = pairs.counts[N_CLUSTERS]
    first = np.zeros(clusters + 1, np.int64)
    used[:clusters] = 0
    for k in range(within.size):
        cluster, other, s = by[k], met[k] >> SHIFT_BITS, met[k] & 31
        own = others = 0
        for block in range(each):
            own |= bytes_with_bits(within[k] & columns_of_block(each, block)) << WIDTH * block
            there = within[k] & lines_of_block(each, block)
            there |= there >> 32
            there |= there >> 16
            others |= ((there | there >> 8) & 255) << WIDTH * block
        own &= in_each_block(each, filled_bits(pairs, cluster))
        others &= in_each_block(each, filled_bits(pairs, other))
        # which cluster has the rows: computed without branches, which would be unpredictable
        turn = int(2 * (count_ones(own) - count_ones(others)) + ((cluster + other) & 1) > 0)
        here, shift = cluster + turn * (other - cluster), s + turn * (SHIFTS - 1 - 2 * s)
        of[k] = here
        listed[k] = (STRIDE * (other + turn * (cluster - other))) | (per_shift * shift) << 32
        members[k] = own + turn * (others - own)
        used[here] |= 1 << shift
        first[here + 1] += 1
    for cluster in range(clusters):
        first[cluster + 1] += first[cluster]
    fill = first.copy()
    sorted_listed, sorted_members = np.empty_like(listed), np.empty_like(members)
    for k in range(within.size):
        at = fill[of[k]]
        sorted_listed[at], sorted_members[at] = listed[k], members[k]
        fill[of[k]] = at + 1
    rows_each = WIDTH // per_row
    made = 0
    for cluster in range(clusters):
        begin, end = first[cluster], first[cluster + 1]
        for row in range(rows_each):
            start[rows_each * cluster + row] = made
            for block in range(each):
                bit = 1 << (per_row * row + WIDTH * block)
                place = table_place(per_row, 0, row) << 32 | WIDTH // each * block
                for at in range(begin, end, WIDTH):
                    made += append_members(rows, made, sorted_listed, sorted_members, at, end - at, bit, place)
    start[rows_each * clusters] = made
    rows[made : made + LOOKED_AHEAD] = 0


@jit
def columns_of_block(each, block):
    """Return the mask, among the 64 bits of two clusters' pairs, of the pairs with a block of the second cluster.

    ``each`` is the number of blocks in a cluster."""
    return ((255 >> (WIDTH - WIDTH // each)) << (WIDTH // each * block)) * 0x0101010101010101


@jit
def lines_of_block(each, block):
    """Return the mask of the pairs with a block of the first cluster; see `columns_of_block`."""
    return -1 if each == 1 else 0xFFFFFFFF << (32 * block)


@jit
def in_each_block(each, bits):
    """Return eight bits, repeated for each block of a cluster."""
    return bits if each == 1 else bits | bits << WIDTH


@jit
def filled_bits(pairs, cluster):
    """Return the lanes that hold particles, as bits."""
    return (1 << pairs.filled[cluster]) - 1


@jit
def spread_rows(pairs, cluster, table):
    """Fill a table with a cluster's positions in float32, relative to its first particle, two in 16 lanes.

    Return the squared reach, with a margin for the rounding of these positions."""
    x, p = pairs.x, STRIDE * cluster
    size = 0.0
    for k in range(3):
        at = p + WIDTH * k
        size = max(size, pairs.bounds[k + 3, cluster] - pairs.bounds[k, cluster])
        for row in range(4):
            two = joined(x[at + 2 * row] - x[at], x[at + 2 * row + 1] - x[at])
            store(table, 2 * WIDTH * (4 * k + row), two)
    reach = pairs.cutoff + pairs.inner_skin
    return (reach + 1e-6 * (size + reach)) ** 2


@jit
def pairs_within(pairs, cluster, other, s, reach2, table):
    """Return 64 bits that mark the pairs of two clusters within reach, with the shift applied.

    Each particle of the first cluster has eight bits. A distance that is nan counts as within reach."""
    x, p, shifts = pairs.x, STRIDE * cluster, pairs.shifts
    xj, yj, zj = load_vector(x, other)
    xj = xj - (x[p] - shifts[0, s])
    yj = yj - (x[p + WIDTH] - shifts[1, s])
    zj = zj - (x[p + 2 * WIDTH] - shifts[2, s])
    x2, y2, z2 = joined(xj, xj), joined(yj, yj), joined(zj, zj)
    bits = 0
    for row in range(4):
        dx = x2 - load_single(table, 2 * WIDTH * row)
        dy = y2 - load_single(table, 2 * WIDTH * (row + 4))
        dz = z2 - load_single(table, 2 * WIDTH * (row + 8))
        beyond = dx * dx + dy * dy + dz * dz >= reach2
        bits |= (mask_bits(beyond) ^ 0xFFFF) << (16 * row)
    return bits

"""Rows of tiles, the list of mixed precision with 16 lanes: half a cluster, four particles, against half a cluster.

A row is half a cluster with the halves of other clusters that have a particle in reach. All rows of a chunk belong to
the chunk's own clusters.
"""

from __future__ import annotations

import numpy as np

from kickdrift.forces.lists.clusters import (
    LOOKED_AHEAD,
    N_CLUSTERS,
    SHIFT_BITS,
    SHIFTS,
    STRIDE,
    chunk_clusters,
    table_place,
)
from kickdrift.forces.lists.pair_rows import fill_table, tile_table
from kickdrift.forces.lists.particle_rows import pairs_within, spread_rows
from kickdrift.forces.lists.special_pairs import clear_special, is_special, mark_special, without_special
from kickdrift.jit.compile import as_written, jit
from kickdrift.jit.lanes.masks import mask_bits
from kickdrift.jit.lanes.packing import append_members
from kickdrift.jit.lanes.single import joined, load_four_times, load_single
from kickdrift.jit.lanes.vectors import WIDTH

HALF = WIDTH // 2
PER_SHIFT, PER_ROW = table_place.py_func(HALF, 1, 0), table_place.py_func(HALF, 0, 1)
UNSHIFTED = SHIFTS // 2
ALL = 0xFFFF  # bits of 16 lanes


@jit
def all_within(pairs, cluster, other, s):
    """Return 64 bits that mark the pairs of two clusters within reach; see `pairs_within`."""
    table = np.empty(4 * 6 * WIDTH, np.float32)
    return pairs_within(pairs.x, pairs.shifts, cluster, other, s, spread_rows(pairs, cluster, table), table)


@jit
def write_tiles(pairs, c):
    """Write chunk c's rows of tiles."""
    span, near, rows, start, used = pairs.near_span, pairs.near[c], pairs.rows[c], pairs.row_start[c], pairs.used[c]
    x, zero, table = pairs.x_single, joined(0.0, 0.0), tile_table()
    begin, end = chunk_clusters(pairs, c)
    reach2 = single_reach(pairs) ** 2
    most = 1
    for cluster in range(begin, end):
        most = max(most, span[cluster, 1] - span[cluster, 0])
    listed, members = np.empty(most + WIDTH, np.int64), np.empty(most + WIDTH, np.int64)
    clear_special(pairs.special, c)
    made = 0
    for cluster in range(pairs.counts[N_CLUSTERS]):
        start[2 * cluster] = start[2 * cluster + 1] = made
        used[cluster] = 0
        if cluster < begin or cluster >= end:
            continue
        filled = pairs.filled[cluster]
        mark_special(pairs.special, pairs.place, c, cluster, filled, True)
        shifts = 0
        for k in range(span[cluster, 0], span[cluster, 1]):
            shifts |= 1 << (near[k] & 31)
        fill_table(table, pairs, cluster, shifts, zero)
        shifts = 1 << UNSHIFTED  # for the pairs within the cluster
        first, count = span[cluster, 0], span[cluster, 1] - span[cluster, 0]
        for k in range(count):
            other, s = near[first + k] >> SHIFT_BITS, near[first + k] & 31
            at, place = STRIDE * other, PER_SHIFT * s
            low, high = fours(x, at), fours(x, at + HALF)
            listed[k] = at | place << 32
            members[k] = (
                in_reach(table, place, low, reach2)
                | in_reach(table, place, high, reach2) << 1
                | in_reach(table, place + PER_ROW, low, reach2) << 2
                | in_reach(table, place + PER_ROW, high, reach2) << 3
            )
            if is_special(pairs.special, c, other):
                bits = all_within(pairs, cluster, other, s)
                without_special(pairs.special, pairs.place, c, cluster, near[first + k], bits, filled)
                members[k] = 0
            shifts |= int(members[k] != 0) << s
        used[cluster] = shifts
        for row in range(2):
            start[2 * cluster + row] = made
            for block in range(2):
                bit, place = 1 << (2 * row + block), PER_ROW * row << 32 | HALF * block
                for at in range(0, count, WIDTH):
                    made += append_members(rows, made, listed, members, at, count - at, bit, place)
        mark_special(pairs.special, pairs.place, c, cluster, filled, False)
    start[2 * pairs.counts[N_CLUSTERS]] = made
    rows[made : made + LOOKED_AHEAD] = 0


@as_written
def fours(x, at):
    """Return x, y and z of half a cluster, in all quarters of 16 lanes."""
    return load_four_times(x, at), load_four_times(x, at + WIDTH), load_four_times(x, at + 2 * WIDTH)


@as_written
def in_reach(table, place, theirs, reach2):
    """Return 1 if a particle of the row at ``place`` has one of ``theirs`` in reach, else 0. A distance that is nan
    counts as within reach."""
    x, y, z = theirs
    dx = load_single(table, place) - x
    dy = load_single(table, place + 2 * WIDTH) - y
    dz = load_single(table, place + 4 * WIDTH) - z
    return int(mask_bits(dx * dx + dy * dy + dz * dz >= reach2) != ALL)


@jit
def single_reach(pairs):
    """Return cutoff and inner skin, with a margin for the rounding of positions in float32."""
    bounds, clusters = pairs.bounds, pairs.counts[N_CLUSTERS]
    reach = pairs.cutoff + pairs.inner_skin
    size = 0.0
    for k in range(3):
        size = max(size, pairs.live[k], bounds[k + 3, :clusters].max() - bounds[k, :clusters].min())
    return reach + 1e-6 * (size + reach)

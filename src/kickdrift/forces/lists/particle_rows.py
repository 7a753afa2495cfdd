"""Rows of the inner list: of particles with the clusters, or halves, in their reach, and of tiles, half against half.

Arrays of a whole chunk exceed the caches in a large system. So what is found of two clusters is packed into one number,
and clusters that a chunk does not touch are not looked at.

A row of tiles, for mixed precision with 16 lanes, is half a cluster, four particles, with the halves of other clusters
that have a particle in reach. All rows of a chunk belong to the chunk's own clusters.
"""

import numpy as np

from kickdrift.forces.lists.clusters import (
    LOOKED_AHEAD,
    N_CLUSTERS,
    SHIFT_BITS,
    SHIFTS,
    STRIDE,
    chunk_clusters,
    load_vector,
    table_place,
)
from kickdrift.forces.lists.pair_rows import fill_table, tile_table
from kickdrift.forces.lists.row_lanes import blocks
from kickdrift.forces.lists.special_pairs import clear_special, is_special, mark_special, without_special
from kickdrift.jit.compile import as_written, jit
from kickdrift.jit.lanes.masks import bytes_with_bits, count_ones, mask_bits
from kickdrift.jit.lanes.memory import store
from kickdrift.jit.lanes.packing import append_members
from kickdrift.jit.lanes.single import joined, load_four_times, load_single
from kickdrift.jit.lanes.vectors import WIDTH

PACKED_BITS = 32  # bits of a packed number for a cluster and a shift; the bits of members lie above


@as_written
def particle_rows(pairs, c):
    """Make chunk c's rows of particles.

    For each pair of near clusters, list the particles of one cluster that have a particle of the other within the
    cutoff plus the inner skin. The rows belong to the cluster that gives fewer rows."""
    x, shifts, span, near = pairs.x, pairs.shifts, pairs.near_span, pairs.near[c]
    begin, end = chunk_clusters(pairs, c)
    most, longest = 1, 1
    for cluster in range(begin, end):
        count = span[cluster, 1] - span[cluster, 0]
        most, longest = most + count, max(longest, count + 1)
    within, met = np.empty(longest, np.int64), np.empty(longest, np.int64)
    found, of = np.empty(most, np.int64), np.empty(most, np.int32)
    fill = np.zeros(pairs.counts[N_CLUSTERS], np.int32)
    table = np.empty(4 * 6 * WIDTH, np.float32)
    made = 0
    clear_special(pairs.special, c)
    for cluster in range(pairs.counts[N_CLUSTERS]):
        if pairs.touched[c, cluster]:
            pairs.used[c, cluster] = 0
    for cluster in range(begin, end):
        filled = pairs.filled[cluster]
        mark_special(pairs.special, c, cluster, filled, True)
        reach2 = spread_rows(pairs, cluster, table)
        some = 0
        for k in range(span[cluster, 0], span[cluster, 1]):
            bits = pairs_within(x, shifts, cluster, near[k] >> SHIFT_BITS, near[k] & 31, reach2, table)
            bits = without_special(pairs.special, c, cluster, near[k], bits, filled)
            within[some], met[some] = bits, near[k]
            some += int(bits != 0)  # overwritten unless one is
        mark_special(pairs.special, c, cluster, filled, False)
        add_members(pairs, c, cluster, within[:some], met, fill, found[made:], of[made:])
        made += some
    write_rows(pairs, c, found[:made], of, fill)


@jit
def add_members(pairs, c, cluster, within, met, fill, found, of):
    """Note which of two clusters has the rows of their pairs, and count them in ``fill``.

    ``of`` takes that cluster. ``found`` takes the other one and the shift, packed, and the members: the particles of
    the row's cluster that have a particle of the other within reach. They are eight bits for each block of the other
    cluster, since each block is an entry of its own.
    """
    each, used, filled = blocks(pairs.block), pairs.used[c], pairs.filled
    filled_here = in_each_block(each, filled_bits(filled, cluster))
    for k in range(within.size):
        other, s = met[k] >> SHIFT_BITS, met[k] & 31
        own = others = 0
        for block in range(each):
            own |= bytes_with_bits(within[k] & columns_of_block(each, block)) << WIDTH * block
            there = within[k] & lines_of_block(each, block)
            there |= there >> 32
            there |= there >> 16
            others |= ((there | there >> 8) & 255) << WIDTH * block
        own &= filled_here
        others &= in_each_block(each, filled_bits(filled, other))
        # which cluster has the rows: computed without branches, which would be unpredictable
        turn = int(2 * (count_ones(own) - count_ones(others)) + ((cluster + other) & 1) > 0)
        here, shift = cluster + turn * (other - cluster), s + turn * (SHIFTS - 1 - 2 * s)
        of[k] = here
        met_then = (other + turn * (cluster - other)) << SHIFT_BITS | shift
        found[k] = met_then | (own + turn * (others - own)) << PACKED_BITS
        used[here] |= 1 << shift
        fill[here] += 1


@jit
def write_rows(pairs, c, found, of, fill):
    """Write chunk c's rows from what `add_members` found."""
    rows, start, touched, per_row = pairs.rows[c], pairs.row_start[c], pairs.touched[c], pairs.per_row
    per_shift, each = table_place(per_row, 1, 0), blocks(pairs.block)
    longest = at = 0
    for cluster in range(fill.size):
        if touched[cluster]:
            count = fill[cluster]
            fill[cluster] = at
            at, longest = at + count, max(longest, count)
    in_order = np.empty(found.size, np.int64)
    for k in range(found.size):
        at = fill[of[k]]
        in_order[at] = found[k]
        fill[of[k]] = at + 1
    listed, members = np.empty(longest + WIDTH, np.int64), np.empty(longest + WIDTH, np.int64)
    rows_each = WIDTH // per_row
    made = begin = 0
    for cluster in range(fill.size):
        if not touched[cluster]:
            continue
        count = fill[cluster] - begin
        for k in range(count):
            packed = in_order[begin + k]
            met, members[k] = packed & ((1 << PACKED_BITS) - 1), packed >> PACKED_BITS
            listed[k] = STRIDE * (met >> SHIFT_BITS) | (per_shift * (met & 31)) << 32
        begin += count
        for row in range(rows_each):
            start[rows_each * cluster + row] = made
            for block in range(each):
                bit = 1 << (per_row * row + WIDTH * block)
                place = table_place(per_row, 0, row) << 32 | WIDTH // each * block
                for at in range(0, count, WIDTH):
                    made += append_members(rows, made, listed, members, at, count - at, bit, place)
        start[rows_each * (cluster + 1)] = made
    start[rows_each * fill.size] = made
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
def filled_bits(filled, cluster):
    """Return the lanes that hold particles, as bits."""
    return (1 << filled[cluster]) - 1


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
def pairs_within(x, shifts, cluster, other, s, reach2, table):
    """Return 64 bits that mark the pairs of two clusters within reach, with the shift applied.

    Each particle of the first cluster has eight bits. A distance that is nan counts as within reach."""
    p = STRIDE * cluster
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
        mark_special(pairs.special, c, cluster, filled, True)
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
                without_special(pairs.special, c, cluster, near[first + k], bits, filled)
                members[k] = 0
            shifts |= int(members[k] != 0) << s
        used[cluster] = shifts
        for row in range(2):
            start[2 * cluster + row] = made
            for block in range(2):
                bit, place = 1 << (2 * row + block), PER_ROW * row << 32 | HALF * block
                for at in range(0, count, WIDTH):
                    made += append_members(rows, made, listed, members, at, count - at, bit, place)
        mark_special(pairs.special, c, cluster, filled, False)
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

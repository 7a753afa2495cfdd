"""Positions brought to their places in the clusters, and how far particles have moved since the list was made."""

from __future__ import annotations

from typing import Any, NamedTuple

from kickdrift.forces.lists.box_change import changed_since, largest_own_move
from kickdrift.forces.lists.clusters import LANES, STRIDE, chunk_clusters, copy, load_vector, unsigned
from kickdrift.forces.lists.pair_rows import copy_to_single
from kickdrift.jit.compile import jit, never_inline
from kickdrift.jit.lanes.functions import lane_max, lane_sum, splat
from kickdrift.jit.lanes.masks import select
from kickdrift.jit.threads.chunks import chunk_task

AT_ONCE = 64  # clusters whose positions are copied and then compared, while they are in the first cache


class Loading(NamedTuple):
    """A list and the positions for it."""

    pairs: Any  # a handle of a ClusterList
    x: Any  # (3, n)


@chunk_task
def load_chunk(loading, c):
    """Copy chunk c's positions to their places, in mixed precision also as float32, and note the moves since the last
    pruning."""
    never_inline()
    pairs = loading.pairs
    begin, end = chunk_clusters(pairs, c)
    largest, total = splat(0.0), splat(0.0)
    for block in range(begin, end, AT_ONCE):
        last = min(block + AT_ONCE, end)
        copy_positions(pairs, loading.x, block, last)
        copy_to_single(pairs, block, last)
        largest, total = add_moves(pairs, pairs.inner_reference, block, last, largest, total)
    note_moves(pairs, c, largest, total)


@chunk_task
def outer_move_chunk(pairs, c):
    """Note the moves in chunk c since the last search."""
    never_inline()
    begin, end = chunk_clusters(pairs, c)
    largest, total = add_moves(pairs, pairs.outer_reference, begin, end, splat(0.0), splat(0.0))
    note_moves(pairs, c, largest, total)


@jit
def move_since(pairs, reference, which):
    """Return the largest squared displacement since the last search or pruning, and a sum that is finite if all are
    finite. The chunks have noted theirs, which count in a box that keeps its size."""
    if changed_since(pairs, which):
        return largest_own_move(pairs, reference, which)
    largest = 0.0
    for c in range(pairs.moves.shape[0]):
        largest = max(largest, pairs.moves[c, 0])
    return largest, total_move(pairs)


@jit
def total_move(pairs):
    """Return a number that is finite if all noted moves are."""
    total = 0.0
    for c in range(pairs.moves.shape[0]):
        total += pairs.moves[c, 1]
    return total


@jit
def copy_positions(pairs, x, begin, end):
    """Copy the positions of these clusters' particles to their places."""
    order, offset, sorted_x = pairs.order, pairs.offset, pairs.x
    for cluster in range(begin, end):
        first, at = unsigned(pairs.first[cluster]), unsigned(STRIDE * cluster)
        for lane in range(unsigned(pairs.filled[cluster])):
            i, p = unsigned(order[first + lane]), at + lane
            sorted_x[p] = x[0, i] - offset[p]
            sorted_x[p + LANES] = x[1, i] - offset[p + LANES]
            sorted_x[p + LANES + LANES] = x[2, i] - offset[p + LANES + LANES]


@jit
def add_moves(pairs, reference, begin, end, largest, total):
    """Return the largest squared displacement from the reference and a sum that is finite if all are finite, lane by
    lane; ``largest`` and ``total`` with those of these clusters."""
    for cluster in range(begin, end):
        x, y, z = load_vector(pairs.x, cluster)
        x0, y0, z0 = load_vector(reference, cluster)
        dx, dy, dz = x - x0, y - y0, z - z0
        d2 = dx * dx + dy * dy + dz * dz
        largest = select(d2 > largest, d2, largest)
        total = total + d2
    return largest, total


@jit
def note_moves(pairs, c, largest, total):
    """Write what `add_moves` found in chunk c: largest squared displacement, sum."""
    pairs.moves[c, 0], pairs.moves[c, 1] = lane_max(largest), lane_sum(total)


@jit
def keep_positions(pairs, c, reference):
    """Copy chunk c's positions to a reference; the last chunk also takes the places beyond the clusters in use."""
    begin, end = chunk_clusters(pairs, c)
    last = reference.size if c + 1 == pairs.force.shape[0] else STRIDE * end
    copy(pairs.x[STRIDE * begin : last], reference[STRIDE * begin : last])

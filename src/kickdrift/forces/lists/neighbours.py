"""Neighbours of each particle, for many-body forces.

A force that visits all neighbours of a particle at once takes them from rows: the cluster list, spread to both
particles of each pair. A row holds the slots of the neighbours within the cutoff plus the inner skin when the list was
last pruned. A force that visits each pair once takes it from the cluster list itself.

Distances are those between nearest images: a cutoff is at most half the height of the box, so the nearest image is the
only image within the cutoff.
"""

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from kickdrift.forces.lists.clusters import (
    LANES,
    N_CLUSTERS,
    PRUNES,
    STRIDE,
    TABLE_STRIDE,
    ClusterList,
    chunk_clusters,
    unsigned,
)
from kickdrift.forces.seam.kernel import GROW, OK
from kickdrift.jit.compile import as_written, jit, never_inline
from kickdrift.jit.duals.lanes import load, packed, rows_at, store, value_of
from kickdrift.jit.lanes.functions import lane_numbers, splat
from kickdrift.jit.lanes.gathering import ROW, lane_round
from kickdrift.jit.lanes.masks import lowest_bit, mask_bits
from kickdrift.jit.lanes.memory import aligned, entry
from kickdrift.jit.lanes.packing import fill_places, pack_counted, pack_places, transpose_places
from kickdrift.jit.lanes.vectors import WIDTH
from kickdrift.jit.threads.chunks import chunk_task, each_chunk
from kickdrift.model.box.box import Box
from kickdrift.model.box.cell import least_height

MADE_AT, ROOM_NEEDED, SUMMED = range(3)  # slots of `Neighbours.state`
SPARE = 1.5  # room beyond the mean number of neighbours


class Neighbours(NamedTuple):
    """Neighbours of the particle in each slot."""

    state: NDArray[np.int64]  # (3,) see the slots above: prunings of the list when the rows were made, the longest row,
    # and 1 if the forces at the positions in ``at`` are summed
    lengths: NDArray[np.int64]  # (slots,) neighbours in each row
    near: NDArray[np.int32]  # (slots, room) slots; the last block of eight ends with the particle's own slot. With
    # ``once``, room for the neighbours within the cutoff, see `close_neighbours`
    at: NDArray[np.float64]  # (4 slots,) x, y, z and species of each slot
    species: NDArray[np.int64]  # (n,)
    matrix: NDArray[np.float64]  # (3, 3) edge vectors as rows; a zero row for an axis that is not periodic
    inverse: NDArray[np.float64]  # (3,) 1 over the diagonal, 0 for an axis that is not periodic
    once: bool  # whether the force visits each pair once
    reached: NDArray[np.bool_]  # (chunks, clusters) whether a chunk's pairs hold particles of a cluster
    listed: NDArray[np.int32]  # (chunks, 8 (room + 8)) this and the next two: see `neighbours_of_eight`
    places: NDArray[np.int32]  # (chunks, 8 (room + 1))
    counts: NDArray[np.float64]  # (chunks, 8)


def whole_blocks(room: float) -> int:
    """Room for whole blocks of eight."""
    return int(-(-room // WIDTH) * WIDTH)


def with_room(rows: Neighbours, room: int) -> Neighbours:
    """Return empty rows with this room for each particle."""
    chunks = len(rows.reached)
    return rows._replace(
        state=np.full(3, -1, np.int64),
        near=aligned((rows.near.shape[0], room), 0, np.int32),
        listed=aligned((chunks, WIDTH * (room + WIDTH)), 0, np.int32),
        places=aligned((chunks, WIDTH * (room + 1)), 0, np.int32),
    )


def neighbours_of(pairs: ClusterList, box: Box, species: NDArray[np.int64], once: bool = False) -> Neighbours:
    """Return empty rows, with room that a guess from the density gives, for a force that visits each pair ``once``, or
    else from both sides."""
    n, slots = len(species), pairs.x.size // 3
    reach = pairs.cutoff + pairs.inner_skin
    volume = box.volume if all(box.periodic_axes) else math.inf
    room = whole_blocks(min((1.0 if once else SPARE) * 4.19 * reach**3 * n / volume, n) + 2 * WIDTH)
    matrix = pairs.cell.matrix
    diagonal = np.diag(matrix)
    empty = np.zeros((slots, 0), np.int32)
    rows = Neighbours(
        state=np.zeros(0, np.int64),
        lengths=np.zeros(slots, np.int64),
        near=empty,
        at=aligned((ROW * slots,)),
        species=species,
        matrix=matrix,
        inverse=np.divide(1.0, diagonal, out=np.zeros(3), where=diagonal > 0),
        once=once,
        reached=np.zeros(pairs.touched.shape, np.bool_),
        listed=empty,
        places=empty,
        counts=aligned((len(pairs.touched), WIDTH)),
    )
    return with_room(rows, room)


@jit
def renew(work):
    """Make the rows again if the list has been pruned since; return OK, or GROW to ``state[ROOM_NEEDED]``.

    ``work`` is the handle of a force with ``rows``, its list ``pairs``, and ``chunks``."""
    rows, pairs = work.rows, work.pairs
    if rows.state[MADE_AT] == pairs.counts[PRUNES]:
        return OK
    rows.reached[:, : pairs.counts[N_CLUSTERS]] = False
    if rows.once:
        each_chunk(work, work.chunks, "reach_of_chunk")
        largest = 0
        for c in range(work.chunks.number):
            largest = max(largest, rows.lengths[c])
        rows.state[ROOM_NEEDED] = -(-largest // (rows.lengths.size // work.chunks.number))
    else:
        make_rows(rows, pairs)
    if rows.state[ROOM_NEEDED] > rows.near.shape[1]:
        return GROW
    for i in range(pairs.place.size):
        p = pairs.place[i]
        rows.at[ROW * (p // STRIDE * WIDTH + p % STRIDE) + 3] = rows.species[i]
    rows.state[MADE_AT], rows.state[SUMMED] = pairs.counts[PRUNES], 0
    return OK


@chunk_task
def reach_of_chunk(work, c):
    """Note which clusters chunk c's pairs reach, and in ``lengths[c]`` the room for their neighbours."""
    never_inline()
    rows, pairs = work.rows, work.pairs
    listed, start, reached = pairs.rows[c], pairs.row_start[c], rows.reached[c]
    begin, end = chunk_clusters(pairs, c)
    most, room = WIDTH * (pairs.place.size // WIDTH + 2), 0
    for cluster in range(pairs.counts[N_CLUSTERS]):
        first, last = start[WIDTH * cluster], start[WIDTH * cluster + WIDTH]
        if pairs.touched[c, cluster] and (first != last or begin <= cluster < end):
            reached[cluster] = True
            for slot in range(WIDTH * cluster, WIDTH * cluster + WIDTH):
                room += min(WIDTH * (start[slot + 1] - start[slot] + 2), most)
            for k in range(first, last):
                reached[entry(listed, k, 0) // STRIDE] = True
    rows.lengths[c] = room


@as_written
def shift_cluster(pairs, c, cluster, table):
    """Write a cluster's positions minus each shift in chunk c's rows to the table; a look-up is cheaper than a
    subtraction for each pair of clusters."""
    p = STRIDE * cluster
    x, y, z = load(pairs.x, p), load(pairs.x, p + WIDTH), load(pairs.x, p + 2 * WIDTH)
    used = pairs.used[c, cluster]
    while used:
        s = lowest_bit(used)
        used &= used - 1
        store(table, TABLE_STRIDE * s, x - pairs.shifts[0, s])
        store(table, TABLE_STRIDE * s + WIDTH, y - pairs.shifts[1, s])
        store(table, TABLE_STRIDE * s + 2 * WIDTH, z - pairs.shifts[2, s])


@as_written
def close_neighbours(work, c, slot, table, at, distances):
    """Write the slots of the neighbours within the cutoff of the particle in a slot, in chunk c's pairs, to
    ``rows.near`` from ``at`` on, and their squared distances to ``distances``. Return their number.

    The particle's own slot, at the cutoff, fills the last block of eight. ``table`` is from `shift_cluster`."""
    pairs, near = work.pairs, work.rows.near
    x, listed, start, cutoff2 = pairs.x, pairs.rows[c], pairs.row_start[c], work.cutoff**2
    cluster, lane = slot // WIDTH, slot % WIDTH
    begin, end = chunk_clusters(pairs, c)
    count = 0
    if begin <= cluster < end:
        p = STRIDE * cluster + lane
        r2 = squared_distances(x, STRIDE * cluster, x[p], x[p + WIDTH], x[p + 2 * WIDTH])
        within = ~(r2 >= cutoff2) & (lane_numbers() < float(lane))  # nan is within, so that a blow-up stays visible
        store(distances, 0, packed(within, r2))
        count += pack_counted(near, at, WIDTH * cluster, within)
    for k in range(start[slot], start[slot + 1]):
        other, p = unsigned(entry(listed, k, 0)), unsigned(entry(listed, k, 1))
        r2 = squared_distances(x, other, table[p], table[p + LANES], table[p + LANES + LANES])
        within = ~(r2 >= cutoff2)
        store(distances, count, packed(within, r2))
        count += pack_counted(near, at + count, other // unsigned(3), within)
    store(distances, count, splat(cutoff2))
    fill_places(near, at + count, slot)
    return count


@as_written
def squared_distances(at, p, x, y, z):
    """Return the squared distances of a cluster's particles, whose first x has the index p, from x, y, z."""
    dx, dy, dz = load(at, p) - x, load(at, p + LANES) - y, load(at, p + LANES + LANES) - z
    return dx * dx + dy * dy + dz * dz


@jit
def follow_box(rows):
    """Bring the rows to the edge lengths of the list's box, which a barostat changes."""
    for k in range(3):
        edge = rows.matrix[k, k]
        if edge > 0.0 and rows.inverse[k] != 1.0 / edge:
            rows.inverse[k] = 1.0 / edge
            rows.state[SUMMED] = 0


@jit
def make_rows(rows, pairs):
    """Fill the rows from the list's pairs within the cutoff plus the inner skin, and count those that do not fit."""
    never_inline()
    x, shifts, count, near = pairs.x, pairs.shifts, rows.lengths, rows.near
    reach2 = (pairs.cutoff + pairs.inner_skin) ** 2
    narrow = least_height(rows.matrix) < 2.001 * (pairs.cutoff + pairs.inner_skin)
    chunks, clusters = pairs.rows.shape[0], pairs.counts[N_CLUSTERS]
    for slot in range(WIDTH * clusters):
        count[slot] = 0
    owner, end = 0, chunk_clusters(pairs, 0)[1]
    for cluster in range(clusters):
        while cluster >= end:
            owner += 1
            end = chunk_clusters(pairs, owner)[1]
        rows.reached[owner, cluster] = True
        first, filled = STRIDE * cluster, pairs.filled[cluster]
        for i in range(filled):
            for j in range(i):
                r2 = 0.0
                for k in range(3):
                    d = x[first + WIDTH * k + i] - x[first + WIDTH * k + j]
                    r2 += d * d
                if r2 < reach2:
                    add_pair(rows, narrow, WIDTH * cluster + i, WIDTH * cluster + j)
        for c in range(chunks):
            if not pairs.touched[c, cluster]:
                continue
            listed, start = pairs.rows[c], pairs.row_start[c]
            for lane in range(WIDTH):
                at = first + lane
                for k in range(start[WIDTH * cluster + lane], start[WIDTH * cluster + lane + 1]):
                    p, s = entry(listed, k, 0), entry(listed, k, 1) // TABLE_STRIDE
                    other = p // STRIDE
                    r2 = squared_distances(
                        x, p, x[at] - shifts[0, s], x[at + WIDTH] - shifts[1, s], x[at + 2 * WIDTH] - shifts[2, s]
                    )
                    bits = mask_bits(r2 < reach2)
                    if bits:
                        rows.reached[owner, other] = True
                        rows.reached[((other + 1) * chunks - 1) // clusters, cluster] = True  # by the other's chunk
                    while bits:
                        add_pair(rows, narrow, WIDTH * cluster + lane, WIDTH * other + lowest_bit(bits))
                        bits &= bits - 1
    needed = 0
    for slot in range(WIDTH * clusters):
        needed = max(needed, count[slot])
        for k in range(count[slot], min(-(-count[slot] // WIDTH) * WIDTH, near.shape[1])):
            near[slot, k] = slot
    rows.state[ROOM_NEEDED] = needed


@jit
def add_pair(rows, narrow, i, j):
    """Add a pair of slots to both rows. In a ``narrow`` box, the rows may hold another image of the pair already."""
    if narrow and (i == j or listed_already(rows, i, j)):
        return
    add_one(rows, i, j)
    add_one(rows, j, i)


@jit
def listed_already(rows, i, j):
    found = False
    for k in range(min(rows.lengths[i], rows.near.shape[1])):
        found = found or rows.near[i, k] == j
    return found


@jit
def add_one(rows, i, j):
    k = rows.lengths[i]
    if k < rows.near.shape[1]:
        rows.near[i, k] = j
    rows.lengths[i] = k + 1


@jit
def copy_places(rows, pairs):
    """Copy the positions from the list's clusters to the slots, and note whether one has changed."""
    x, at, same = pairs.x, rows.at, True
    for cluster in range(pairs.counts[N_CLUSTERS]):
        for lane in range(WIDTH):
            p, q = STRIDE * cluster + lane, ROW * (WIDTH * cluster + lane)
            for k in range(3):
                same = same and at[q + k] == x[p + k * WIDTH]
                at[q + k] = x[p + k * WIDTH]
    if not same:
        rows.state[SUMMED] = 0


@as_written
def separations(rows, at, places, first, x, y, z):
    """Return the separations from the particles in the slots ``places[first:first + 8]`` to x, y, z, numbers or lanes,
    and the particles' fourth numbers in ``at``, which holds the rows x, y, z and a number of each slot."""
    matrix, inverse = rows.matrix, rows.inverse
    xj, yj, zj, number = rows_at(at, places, first)
    dx, dy, dz = x - xj, y - yj, z - zj
    whole = lane_round(value_of(dz) * inverse[2])
    dx, dy, dz = dx - whole * matrix[2, 0], dy - whole * matrix[2, 1], dz - whole * matrix[2, 2]
    whole = lane_round(value_of(dy) * inverse[1])
    dx, dy = dx - whole * matrix[1, 0], dy - whole * matrix[1, 1]
    return dx - lane_round(value_of(dx) * inverse[0]) * matrix[0, 0], dy, dz, number


@as_written
def neighbours_of_eight(rows, c, cluster, cutoff2):
    """Write the neighbours within the cutoff of a cluster's eight particles to ``places[c]``, and to ``counts[c]`` how
    many each has. Return the largest of these numbers.

    ``places`` takes eight slots for the particles themselves, then eight for the first neighbour of each, and so on; a
    particle's own slot fills the rest. ``listed`` is room for eight rows."""
    listed, places, counts = rows.listed[c], rows.places[c], rows.counts[c]
    width, most = rows.near.shape[1] + WIDTH, 0
    for lane in range(WIDTH):
        slot = WIDTH * cluster + lane
        at, q, made = slot * rows.near.shape[1], ROW * slot, 0
        for first in range(0, rows.lengths[slot], WIDTH):
            x, y, z = rows.at[q], rows.at[q + 1], rows.at[q + 2]
            dx, dy, dz, _ = separations(rows, rows.at, rows.near, at + first, x, y, z)
            # a distance that is nan counts as within the cutoff, so that a blow-up stays visible
            within = ~(dx * dx + dy * dy + dz * dz >= cutoff2) & (lane_numbers() < float(rows.lengths[slot] - first))
            made += pack_places(listed, lane * width + made, rows.near, at + first, within)
        places[lane], counts[lane] = slot, made
        most = max(most, made)
    for lane in range(WIDTH):
        for k in range(int(counts[lane]), most, WIDTH):
            fill_places(listed, lane * width + k, WIDTH * cluster + lane)
    for k in range(0, most, WIDTH):
        transpose_places(listed, k, width, places, WIDTH * (k + 1))
    return most

"""Neighbours of each particle, for many-body forces: rows of the cluster list, spread to both particles of each pair.

A many-body force visits all neighbours of a particle at once. A row holds the slots of these neighbours, within the
cutoff plus the inner skin when the list was last pruned. Distances are those between nearest images: a cutoff is at
most half the height of the box, so the nearest image is the only image within the cutoff.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from kickdrift.forces.lists.clusters import (
    N_CLUSTERS,
    PRUNES,
    STRIDE,
    TABLE_STRIDE,
    ClusterList,
    chunk_clusters,
    load_vector,
)
from kickdrift.forces.seam.kernel import GROW, OK
from kickdrift.jit.compile import as_written, jit, never_inline
from kickdrift.jit.duals.lanes import rows_at, value_of
from kickdrift.jit.lanes.functions import lane_numbers
from kickdrift.jit.lanes.gathering import ROW, lane_round
from kickdrift.jit.lanes.masks import lowest_bit, mask_bits
from kickdrift.jit.lanes.memory import aligned, entry
from kickdrift.jit.lanes.vectors import WIDTH
from kickdrift.model.box.box import Box
from kickdrift.model.box.cell import least_height

MADE_AT, ROOM_NEEDED, SUMMED = range(3)  # slots of `Neighbours.state`
SPARE = 1.5  # room beyond the mean number of neighbours


class Neighbours(NamedTuple):
    """Neighbours of the particle in each slot."""

    state: NDArray[np.int64]  # (3,) see the slots above: prunings of the list when the rows were made, the longest row,
    # and 1 if the forces at the positions in ``at`` are summed
    lengths: NDArray[np.int64]  # (slots,) neighbours in each row
    near: NDArray[np.int32]  # (slots, room) slots; the last block of eight ends with the particle's own slot
    at: NDArray[np.float64]  # (4 slots,) x, y, z and species of each slot
    species: NDArray[np.int64]  # (n,)
    matrix: NDArray[np.float64]  # (3, 3) edge vectors as rows; a zero row for an axis that is not periodic
    inverse: NDArray[np.float64]  # (3,) 1 over the diagonal, 0 for an axis that is not periodic
    once: bool  # whether a pair is in one of its two rows alone
    reached: NDArray[np.bool_]  # (chunks, clusters) whether rows of a chunk hold particles of a cluster


def whole_blocks(room: float) -> int:
    """Room for whole blocks of eight."""
    return int(-(-room // WIDTH) * WIDTH)


def with_room(rows: Neighbours, room: int) -> Neighbours:
    """Return empty rows with this room for each particle."""
    near = aligned((rows.near.shape[0], room), fill=0, dtype=np.int32)
    return rows._replace(state=np.full(3, -1, np.int64), near=near)


def neighbours_of(pairs: ClusterList, box: Box, species: NDArray[np.int64], once: bool = False) -> Neighbours:
    """Return empty rows, with room that a guess from the density gives. With ``once``, they hold each pair once."""
    n, slots = len(species), pairs.x.size // 3
    reach = pairs.cutoff + pairs.inner_skin
    volume = box.volume if all(box.periodic_axes) else math.inf
    room = whole_blocks(min(SPARE * 4.19 * reach**3 * n / volume, n) / (2 if once else 1) + 2 * WIDTH)
    matrix = pairs.cell.matrix
    diagonal = np.diag(matrix)
    return Neighbours(
        state=np.full(3, -1, np.int64),
        lengths=np.zeros(slots, np.int64),
        near=aligned((slots, room), fill=0, dtype=np.int32),
        at=aligned((ROW * slots,)),
        species=species,
        matrix=matrix,
        inverse=np.divide(1.0, diagonal, out=np.zeros(3), where=diagonal > 0),
        once=once,
        reached=np.zeros(pairs.touched.shape, np.bool_),
    )


@jit
def renew(rows, pairs):
    """Make the rows again if the list has been pruned since; return OK, or GROW to ``state[ROOM_NEEDED]``."""
    if rows.state[MADE_AT] == pairs.counts[PRUNES]:
        return OK
    make_rows(rows, pairs)
    if rows.state[ROOM_NEEDED] > rows.near.shape[1]:
        return GROW
    near, count = rows.near, rows.lengths
    for slot in range(WIDTH * pairs.counts[N_CLUSTERS]):
        for k in range(count[slot], -(-count[slot] // WIDTH) * WIDTH):
            near[slot, k] = slot
    for i in range(pairs.place.size):
        p = pairs.place[i]
        rows.at[ROW * (p // STRIDE * WIDTH + p % STRIDE) + 3] = rows.species[i]
    rows.state[MADE_AT], rows.state[SUMMED] = pairs.counts[PRUNES], 0
    return OK


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
    x, shifts, count = pairs.x, pairs.shifts, rows.lengths
    reach2 = (pairs.cutoff + pairs.inner_skin) ** 2
    narrow = least_height(rows.matrix) < 2.001 * (pairs.cutoff + pairs.inner_skin)
    clusters = pairs.counts[N_CLUSTERS]
    for slot in range(WIDTH * clusters):
        count[slot] = 0
    rows.reached[:, :clusters] = False
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
        for c in range(pairs.rows.shape[0]):
            if not pairs.touched[c, cluster]:
                continue
            listed, start = pairs.rows[c], pairs.row_start[c]
            for lane in range(WIDTH):
                at = first + lane
                for k in range(start[WIDTH * cluster + lane], start[WIDTH * cluster + lane + 1]):
                    other, shift = entry(listed, k, 0) // STRIDE, entry(listed, k, 1) // TABLE_STRIDE
                    xj, yj, zj = load_vector(x, other)
                    dx = xj - (x[at] - shifts[0, shift])
                    dy = yj - (x[at + WIDTH] - shifts[1, shift])
                    dz = zj - (x[at + 2 * WIDTH] - shifts[2, shift])
                    bits = mask_bits(dx * dx + dy * dy + dz * dz < reach2)
                    if bits:
                        rows.reached[owner, other] = True
                    while bits:
                        add_pair(rows, narrow, WIDTH * cluster + lane, WIDTH * other + lowest_bit(bits))
                        bits &= bits - 1
    needed = 0
    for slot in range(WIDTH * clusters):
        needed = max(needed, count[slot])
    rows.state[ROOM_NEEDED] = needed


@jit
def add_pair(rows, narrow, i, j):
    """Add a pair of slots to both rows, or once to the first. In a ``narrow`` box, the rows may hold another image of
    the pair already."""
    if narrow and (i == j or listed_already(rows, i, j) or listed_already(rows, j, i)):
        return
    add_one(rows, i, j)
    if not rows.once:
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
def separations(rows, at, slot, first):
    """Return the separations from eight neighbours, from the ``first`` of a row on, to the particle in a slot, and the
    neighbours' fourth numbers in ``at``, which holds the rows x, y, z and a number of each slot."""
    matrix, inverse = rows.matrix, rows.inverse
    q = ROW * slot
    x, y, z, number = rows_at(at, rows.near, slot * rows.near.shape[1] + first)
    dx, dy, dz = at[q] - x, at[q + 1] - y, at[q + 2] - z
    whole = lane_round(value_of(dz) * inverse[2])
    dx, dy, dz = dx - whole * matrix[2, 0], dy - whole * matrix[2, 1], dz - whole * matrix[2, 2]
    whole = lane_round(value_of(dy) * inverse[1])
    dx, dy = dx - whole * matrix[1, 0], dy - whole * matrix[1, 1]
    return dx - lane_round(value_of(dx) * inverse[0]) * matrix[0, 0], dy, dz, number


@as_written
def block_of_neighbours(rows, slot, first, cutoff2):
    """Return the separations from eight neighbours, from the ``first`` of a row on, to the particle in a slot, with
    their squares, whether they are beyond the cutoff, and the neighbours' species."""
    dx, dy, dz, kind = separations(rows, rows.at, slot, first)
    r2 = dx * dx + dy * dy + dz * dz
    # a distance that is nan counts as within the cutoff, so that a blow-up stays visible
    beyond = (r2 >= cutoff2) | (lane_numbers() >= float(rows.lengths[slot] - first))
    return dx, dy, dz, r2, beyond, value_of(kind)

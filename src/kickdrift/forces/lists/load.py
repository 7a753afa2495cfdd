"""Positions brought to their places in the clusters, and how far particles and edges have moved since a list was made.

A barostat scales positions and box by the same factors, and writes the edge lengths where the lists read them. A pair
that was at least R apart when a list was made is then at least R m - 2 u apart: m is the least factor of an edge since
then, and u the largest move of a particle beside the scaling. So a list of radius R holds every pair within the cutoff
as long as 2 u <= R m - cutoff. In a box that keeps its size m is one, and this is the usual condition on half the skin.

A box that changes its shape deforms by x -> x F. Then m is 1 - |F - 1|, at most the least stretch of F. Where a tilt
jumps by a whole edge, the box has other edges of the same lattice, and all lists are made anew.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from kickdrift.forces.lists.clusters import (
    BUILT,
    LANES,
    N_CLUSTERS,
    SHIFTS,
    STRIDE,
    STRIDE_UNKNOWN,
    ClusterList,
    chunk_clusters,
    copy,
    load_vector,
    skins,
    store_vector,
    unsigned,
)
from kickdrift.forces.lists.pair_rows import copy_to_single
from kickdrift.jit.compile import jit, never_inline, plain, strict
from kickdrift.jit.lanes.functions import lane_max, lane_numbers, lane_sum, splat
from kickdrift.jit.lanes.gathering import lane_round
from kickdrift.jit.lanes.masks import select
from kickdrift.jit.lanes.vectors import WIDTH
from kickdrift.jit.threads.chunks import chunk_task
from kickdrift.model.box.cell import LENGTHS, bricks_of, follow, live_cell, put_edges

SEARCHED, PRUNED = 0, 1  # rows of ``made_in``


@strict
def adopt(pairs):
    """Bring the box of a list, and the whole edges subtracted from positions, to the edge lengths of now."""
    live, matrix, offset = pairs.live, pairs.cell.matrix, pairs.offset
    if pairs.cell.leans:
        adopt_leaning(pairs)
        return
    for k in range(3):
        edge = matrix[k, k]
        if live[k] == edge or edge == 0.0:
            continue
        for cluster in range(pairs.counts[N_CLUSTERS]):
            for p in range(STRIDE * cluster + WIDTH * k, STRIDE * cluster + WIDTH * (k + 1)):
                offset[p] = np.rint(offset[p] / edge) * live[k]
        matrix[k, k] = pairs.cell.edges[k] = live[k]
        for s in range(SHIFTS):
            number = (s // 9, s // 3 % 3, s % 3)[k] - 1
            pairs.shifts[k, s] = pairs.bricks.shifts[k, s] = number * live[k]


@strict
def adopt_leaning(pairs):
    """Do the work of `adopt` for a leaning box. The sums are in the order of `into_brick`, so they have its bits."""
    cell, bricks, offset, live = pairs.cell, pairs.bricks, pairs.offset, pairs.live
    m, then = cell.matrix, cell.matrix.copy()
    if not follow(cell):
        return
    if live.size > LENGTHS and not alike(then, m):
        pairs.counts[BUILT] = 0
    per_a, per_b, per_c = per_edge(then[0, 0]), per_edge(then[1, 1]), per_edge(then[2, 2])
    for cluster in range(pairs.counts[N_CLUSTERS]):
        x, y, z = load_vector(offset, cluster)
        of_c = lane_round(z * per_c)
        of_b = lane_round((y - of_c * then[2, 1]) * per_b)
        of_a = lane_round((x - (of_c * then[2, 0] + of_b * then[1, 0])) * per_a)
        x = of_c * m[2, 0] + of_b * m[1, 0] + of_a * m[0, 0]
        store_vector(offset, cluster, x, of_c * m[2, 1] + of_b * m[1, 1], of_c * m[2, 2])
    resize_bricks(pairs, bricks, live)


@strict
def per_edge(edge):
    """One over an edge; zero along an open axis."""
    return 1.0 / edge if edge > 0.0 else 0.0


@strict
def alike(then, now):
    """Tell whether the images of two boxes have the same numbers: no tilt has jumped by an edge, and each row of bricks
    has lost as many edges; see `Bricks`."""
    for k in range(1, 3):
        for m in range(k):
            if then[m, m] > 0.0 and abs(now[k, m] / now[m, m] - then[k, m] / then[m, m]) > 0.5:
                return False
    for j in range(-1, 2):
        for k in range(-1, 2):
            if edges_lost(then, j, k) != edges_lost(now, j, k):
                return False
    return True


@strict
def edges_lost(matrix, j, k):
    """Whole edges a in j b + k c."""
    return np.rint((j * matrix[1, 0] + k * matrix[2, 0]) / matrix[0, 0])


@strict
def resize_bricks(pairs, bricks, live):
    """Bring the shifts of a leaning box to the edges of now."""
    if live.size > LENGTHS:
        remake_bricks(pairs, bricks)
        return
    for k in range(3):
        for s in range(SHIFTS):
            pairs.shifts[k, s] = bricks.shifts[k, s] = bricks.shifts_by_edge[k, s] * live[k]
    for row in range(bricks.leans.shape[0]):
        for k in range(2):
            bricks.leans[row, k] = bricks.leans_by_edge[row, k] * live[k]


@strict
def remake_bricks(pairs, bricks):
    """Set the shifts of a box from its edge vectors, as `bricks_of` does."""
    matrix, row = pairs.cell.matrix, 0
    for j in range(-1, 2):
        for k in range(-1, 2):
            lost = edges_lost(matrix, j, k)
            x = j * matrix[1, 0] + k * matrix[2, 0] - lost * matrix[0, 0]
            y, z = j * matrix[1, 1] + k * matrix[2, 1], k * matrix[2, 2]
            for i in range(-1, 2):
                s = 9 * (i + 1) + 3 * (j + 1) + k + 1
                pairs.shifts[0, s] = bricks.shifts[0, s] = x + i * matrix[0, 0]
                pairs.shifts[1, s] = bricks.shifts[1, s] = y
                pairs.shifts[2, s] = bricks.shifts[2, s] = z
            if k == 0 or matrix[2, 2] > 0.0:
                bricks.leans[row, 0], bricks.leans[row, 1] = x, k * matrix[2, 1]
                row += 1


@strict
def covered(edges):
    """Distance within which the bricks have all images, for a live box (6,); see `Bricks`."""
    matrix, lean = np.zeros((3, 3)), 0.0
    put_edges(edges, matrix)
    for j in range(-1, 2):
        for k in range(-1, 2):
            x = j * matrix[1, 0] + k * matrix[2, 0] - edges_lost(matrix, j, k) * matrix[0, 0]
            lean = max(lean, abs(x))
    least = min(matrix[0, 0] - lean, matrix[1, 1] - abs(matrix[2, 1]))
    return min(least, matrix[2, 2]) if matrix[2, 2] > 0.0 else least


@strict
def outer_skin_now(pairs):
    """Skin of the outer list: less where a box that leans far has no images further away."""
    if pairs.live.size == LENGTHS:
        return pairs.outer_skin
    return min(pairs.outer_skin, covered(pairs.made_in[SEARCHED]) - pairs.cutoff)


def live_list(pairs: ClusterList, lengths: NDArray[np.float64], shortest: NDArray[np.float64]) -> dict[str, Any]:
    """Parts of a list whose box has its edge lengths, or lengths and tilts, in this memory. The box may shrink to the
    ``shortest`` (3,)."""
    cell, bricks = live_cell(pairs.cell, lengths), pairs.bricks
    if len(lengths) > LENGTHS:
        return {"live": lengths, "cell": cell, "bricks": bricks_of(cell), "made_in": np.array([lengths] * 2)}
    if not cell.leans:
        return {"live": lengths, "cell": cell}
    resize_bricks.py_func(pairs, bricks, lengths)
    axes = lengths > 0.0
    reach = bricks.reach * min(1.0, float((shortest[axes] / lengths[axes]).max()))
    inner, outer = skins(bricks._replace(reach=reach), pairs.cutoff, STRIDE_UNKNOWN * pairs.cutoff)
    return {
        "live": lengths, "cell": cell, "bricks": bricks._replace(reach=reach), "inner_skin": inner, "outer_skin": outer
    }  # fmt: skip


@strict
def keep_lengths(pairs, which):
    """Keep the edges at a search or a pruning."""
    for k in range(pairs.live.size):
        pairs.made_in[which, k] = pairs.live[k]


@strict
def factor(pairs, which, k):
    """Factor of an edge since the last search or pruning."""
    then = pairs.made_in[which, k]
    return pairs.live[k] / then if then > 0.0 else 1.0


@strict
def deformation(pairs, which):
    """Lower triangle (6,) of F, which brings the edges at the last search or pruning to those of now: h' = h F. The
    order is that of a live box."""
    then, now = pairs.made_in[which], pairs.live
    a, b, c = then[0], then[1], then[2] if then[2] > 0.0 else 1.0
    x, y, z = now[0] / a, now[1] / b, now[2] / c if now[2] > 0.0 else 1.0
    yx, zy = (now[5] - then[5] * x) / b, (now[3] - then[3] * y) / c
    return x, y, z, zy, (now[4] - then[4] * x - then[3] * yx) / c, yx


@strict
def least_factor(pairs, which):
    """Least factor of the edges along periodic axes; exactly 1 in a box that keeps its size. For a box that changes its
    shape, a bound of its least stretch."""
    if pairs.live.size > LENGTHS:
        x, y, z, zy, zx, yx = deformation(pairs, which)
        return 1.0 - ((x - 1.0) ** 2 + (y - 1.0) ** 2 + (z - 1.0) ** 2 + zy * zy + zx * zx + yx * yx) ** 0.5
    least = np.inf
    for k in range(3):
        if pairs.made_in[which, k] > 0.0:
            least = min(least, factor(pairs, which, k))
    return least if least < np.inf else 1.0


@strict
def changed_since(pairs, which):
    """Whether an edge has another length than at the last search or pruning."""
    changed = False
    for k in range(pairs.live.size):
        changed |= pairs.live[k] != pairs.made_in[which, k]
    return changed


@jit
def largest_own_move(pairs, reference, which):
    """Return the largest squared displacement from the reference beside the scaling of the box, and a sum that is
    finite if all are finite. Padding lanes, which do not scale, are left out."""
    zy, zx, yx = 0.0, 0.0, 0.0
    a, b, c = factor(pairs, which, plain(0)), factor(pairs, which, plain(1)), factor(pairs, which, plain(2))
    shears = pairs.live.size > LENGTHS
    if shears:
        a, b, c, zy, zx, yx = deformation(pairs, which)
    largest = splat(0.0)
    total = splat(0.0)
    for cluster in range(pairs.counts[N_CLUSTERS]):
        x, y, z = load_vector(pairs.x, cluster)
        x0, y0, z0 = load_vector(reference, cluster)
        dx, dy, dz = x - a * x0, y - b * y0, z - c * z0
        if shears:
            dx, dy = dx - yx * y0 - zx * z0, dy - zy * z0
        d2 = select(lane_numbers() < float(pairs.filled[cluster]), dx * dx + dy * dy + dz * dz, 0.0)
        largest = select(d2 > largest, d2, largest)
        total = total + d2
    return lane_max(largest), lane_sum(total)


@strict
def scaled_tail(pairs, volume):
    """Factor of the tail corrections, which are as one over the volume; ``volume`` is that of the corrections."""
    return volume / volume_of(pairs.live)


@strict
def volume_of(lengths):
    """Product of the edge lengths along periodic axes."""
    product = 1.0
    for k in range(3):
        if lengths[k] > 0.0:
            product *= lengths[k]
    return product


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

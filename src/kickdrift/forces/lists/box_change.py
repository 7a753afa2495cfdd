"""Pair lists in a box whose edges a run changes.

A barostat scales positions and box by the same factors, and writes the edge lengths where the lists read them. A pair
that was at least R apart when a list was made is then at least R m - 2 u apart: m is the least factor of an edge since
then, and u the largest move of a particle beside the scaling. So a list of radius R holds every pair within the cutoff
as long as 2 u <= R m - cutoff. In a box that keeps its size m is one, and this is the usual condition on half the skin.
"""

from __future__ import annotations

import numpy as np

from kickdrift.forces.lists.clusters import N_CLUSTERS, SHIFTS, STRIDE, load_vector
from kickdrift.jit.compile import jit, strict
from kickdrift.jit.lanes.functions import lane_max, lane_numbers, lane_sum, splat
from kickdrift.jit.lanes.masks import select
from kickdrift.jit.lanes.vectors import WIDTH

SEARCHED, PRUNED = 0, 1  # rows of ``made_in``


@strict
def adopt(pairs):
    """Bring the box of a list, and the whole edges subtracted from positions, to the edge lengths of now."""
    live, matrix, offset = pairs.live, pairs.cell.matrix, pairs.offset
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
def keep_lengths(pairs, which):
    """Keep the edge lengths at a search or a pruning."""
    for k in range(3):
        pairs.made_in[which, k] = pairs.live[k]


@strict
def factor(pairs, which, k):
    """Factor of an edge since the last search or pruning."""
    then = pairs.made_in[which, k]
    return pairs.live[k] / then if then > 0.0 else 1.0


@strict
def least_factor(pairs, which):
    """Least factor of the edges along periodic axes; exactly 1 in a box that keeps its size."""
    least = np.inf
    for k in range(3):
        if pairs.made_in[which, k] > 0.0:
            least = min(least, factor(pairs, which, k))
    return least if least < np.inf else 1.0


@strict
def changed_since(pairs, which):
    """Whether an edge has another length than at the last search or pruning."""
    changed = False
    for k in range(3):
        changed |= pairs.live[k] != pairs.made_in[which, k]
    return changed


@jit
def largest_own_move(pairs, reference, which):
    """Return the largest squared displacement from the reference beside the scaling of the box, and a sum that is
    finite if all are finite. Padding lanes, which do not scale, are left out."""
    a, b, c = factor(pairs, which, 0), factor(pairs, which, 1), factor(pairs, which, 2)
    largest = splat(0.0)
    total = splat(0.0)
    for cluster in range(pairs.counts[N_CLUSTERS]):
        x, y, z = load_vector(pairs.x, cluster)
        x0, y0, z0 = load_vector(reference, cluster)
        dx, dy, dz = x - a * x0, y - b * y0, z - c * z0
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

"""Counts of pairs of particles by distance: the compiled loop of the radial distribution function."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from kickdrift.jit.compile import driver
from kickdrift.model.box import Box
from kickdrift.model.cell import cell_of, square_by_edges
from kickdrift.model.state import Floats


def pair_counts(
    positions: Floats, box: Box, kinds: NDArray[np.int64], unlike: bool, r_max: float, bins: int
) -> NDArray[np.int64]:
    """Number of pairs in each bin (bins,) of equal width up to ``r_max``.

    ``r_max`` is at most half the least height of the periodic box. Each pair of the (n, 3) ``positions`` counts once if
    its ``kinds`` (n,) differ, or, without ``unlike``, if they are equal.
    """
    cell = cell_of(box)
    edges = np.where(cell.edges > 0, cell.edges, np.inf)
    # Only the last periodic edge leans along its own axis, so positions along that axis repeat after the edge's length.
    sorted_by = int(np.flatnonzero(box.periodic_axes)[-1])
    wrapped = box.wrap(positions)
    order = np.argsort(wrapped[:, sorted_by], kind="stable")
    counts = np.zeros(bins, np.int64)
    x = np.ascontiguousarray(wrapped[order].T)
    count_pairs(x, kinds[order], unlike, cell.matrix, cell.leans, edges, sorted_by, r_max, np.empty(len(order)), counts)
    return counts


@driver
def count_pairs(x, kinds, unlike, matrix, leans, edges, sorted_by, r_max, row, counts):
    """Add to counts the pairs of x (3, n), sorted by its row ``sorted_by``. ``row`` (n,) holds one particle's
    distances.

    A pair may be close along that axis directly or across the boundary, so two stretches of the sorted row are
    searched.
    """
    n, bins = x.shape[1], counts.size
    widths, limit = bins / r_max, r_max * r_max
    sorted_row, period = x[sorted_by], matrix[sorted_by, sorted_by]
    inverse = np.array([1.0 / matrix[k, k] if matrix[k, k] > 0.0 else 0.0 for k in range(3)])
    for i in range(n):
        near = np.searchsorted(sorted_row, sorted_row[i] + r_max, side="right")
        far = np.searchsorted(sorted_row, sorted_row[i] + period - r_max)
        for begin, end in ((i + 1, near), (max(far, i + 1), n)):
            if leans:
                for j in range(begin, end):
                    row[j] = square_by_edges(matrix, inverse, x[0, i] - x[0, j], x[1, i] - x[1, j], x[2, i] - x[2, j])
            else:
                for j in range(begin, end):
                    squared = 0.0
                    for k in range(3):
                        d = abs(x[k, i] - x[k, j])
                        d = min(d, edges[k] - d)
                        squared += d * d
                    row[j] = squared
            for j in range(begin, end):
                if row[j] < limit and (kinds[i] != kinds[j]) == unlike:
                    counts[min(int(math.sqrt(row[j]) * widths), bins - 1)] += 1

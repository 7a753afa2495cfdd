"""Counts of pairs of particles by distance: the compiled loop of the radial distribution function."""

import math

import numpy as np
from numpy.typing import NDArray

from kickdrift.jit.compile import driver
from kickdrift.model.box.box import Box
from kickdrift.model.box.cell import minimum_image_of, squared_distances
from kickdrift.model.state import Floats


def pair_counts(
    positions: Floats, box: Box, kinds: NDArray[np.int64], unlike: bool, r_max: float, bins: int
) -> NDArray[np.int64]:
    """Number of pairs in each bin (bins,) of equal width up to ``r_max``.

    ``r_max`` is at most half the least height of the periodic box. Each pair of the (n, 3) ``positions`` counts once if
    its ``kinds`` (n,) differ, or, without ``unlike``, if they are equal.
    """
    image, wrapped = minimum_image_of(box), box.wrap(positions)
    order = np.argsort(wrapped[:, image.axis], kind="stable")
    counts = np.zeros(bins, np.int64)
    x = np.ascontiguousarray(wrapped[order].T)
    count_pairs(x, kinds[order], unlike, image, r_max, np.empty(len(order)), counts)
    return counts


@driver
def count_pairs(x, kinds, unlike, image, r_max, row, counts):
    """Add to counts the pairs of x (3, n), sorted along ``image.axis``. ``row`` (n,) holds one particle's distances.

    A pair may be close along that axis directly or across the boundary, so two stretches of the sorted row are
    searched.
    """
    n, bins = x.shape[1], counts.size
    widths, limit = bins / r_max, r_max * r_max
    sorted_row, period = x[image.axis], image.period
    for i in range(n):
        near = np.searchsorted(sorted_row, sorted_row[i] + r_max, side="right")
        far = np.searchsorted(sorted_row, sorted_row[i] + period - r_max)
        for begin, end in ((i + 1, near), (max(far, i + 1), n)):
            squared_distances(image, x, i, begin, end, row)
            for j in range(begin, end):
                if row[j] < limit and (kinds[i] != kinds[j]) == unlike:
                    counts[min(int(math.sqrt(row[j]) * widths), bins - 1)] += 1

"""How particles are arranged around each other."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike
from scipy.spatial import cKDTree

from kickdrift.box import Box
from kickdrift.errors import InputError
from kickdrift.state import Floats

BLOCK = 1000  # particles whose neighbours are in memory at once


def radial_distribution(
    positions: ArrayLike, box_lengths: Sequence[float] | Box, r_max: float | None = None, bins: int = 200
) -> tuple[Floats, Floats]:
    """The radial distribution function g(r) of n particles in a periodic box.

    g is the number of ordered pairs (i, j ≠ i) with r in a bin, over that of n(n-1) independent pairs spread evenly:
    n(n-1) (4π/3)(r₊³ - r₋³) / V. So it is 1 on average for an ideal gas, whatever n is.
    (Allen & Tildesley, Computer Simulation of Liquids, 2nd ed. 2017, section 8.2.)

    Parameters
    ----------
    positions : (n, 3) or (frames, n, 3)
        Wrapped or not; frames are averaged.
    box_lengths : three edge lengths, or a periodic Box
    r_max : largest distance, by default half the shortest edge, which it cannot pass
    bins : number of bins of equal width between 0 and r_max

    Returns
    -------
    r, g : (bins,) centres of the bins, and the function in them
    """
    box = Box.of(box_lengths)
    if box.lengths is None:
        raise InputError("radial_distribution: needs a periodic box; an open one has no density")
    frames = np.asarray(positions, dtype=float)
    if frames.ndim == 2:
        frames = frames[np.newaxis]
    if frames.ndim != 3 or frames.shape[2] != 3 or frames.shape[0] < 1 or frames.shape[1] < 2:
        raise InputError(f"radial_distribution: expected positions of shape (n, 3) with n >= 2, got {frames.shape}")
    if bins < 1:
        raise InputError(f"radial_distribution: expected one bin or more, got {bins}")
    half = min(box.lengths) / 2
    r_max = half if r_max is None else float(r_max)
    if not 0 < r_max <= half:
        raise InputError(f"radial_distribution: r_max = {r_max:g} is not in (0, {half:g}], half the shortest edge")
    edges = np.linspace(0.0, r_max, bins + 1)
    n = frames.shape[1]
    pairs = np.zeros(bins)
    for x in frames:
        wrapped = box.wrap(x)
        tree = cKDTree(wrapped, boxsize=box.lengths)
        for start in range(0, n, BLOCK):
            some = cKDTree(wrapped[start : start + BLOCK], boxsize=box.lengths)
            distances = some.sparse_distance_matrix(tree, r_max, output_type="ndarray")["v"]
            pairs += np.histogram(distances, edges)[0]
    pairs[0] -= len(frames) * n  # each particle has found itself
    shells = 4 / 3 * np.pi * np.diff(edges**3)
    ideal = len(frames) * n * (n - 1) * shells / box.volume
    return (edges[1:] + edges[:-1]) / 2, pairs / ideal

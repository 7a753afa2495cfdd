"""Particles near each other in a Box, found by a tree or by a grid."""

import itertools
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from kickdrift.model.box.box import Box
from kickdrift.model.state import Floats

CROWD = 3  # most particles in one cell; with more, a tree is faster
CELLS = 2**20  # cells along an axis; later cells reuse these numbers, so that one integer numbers a cell


def any_nearer(positions: Floats, box: Box | Sequence[float] | None, limit: float) -> bool:
    """Tell whether two of ``positions`` (n, 3), wrapped into the box, are nearer than ``limit``. True also if two are
    almost so near, or if a place is crowded.

    Each of eight grids has cells at least twice as high as the limit, shifted by half a cell along some axes. Two near
    particles share a cell in at least one grid. (SciPy's tree takes a quarter of a second to import.)
    """
    box = Box.of(box)
    heights = box.heights
    cells = np.maximum(1, np.floor(heights / (2 * limit)))
    upright = box.fractional(positions) * np.where(np.isfinite(heights), heights, 1.0) if box.triclinic else positions
    width = np.divide(heights, cells, out=np.full(3, 2 * limit), where=np.isfinite(cells))
    for shift in itertools.product((0.0, 0.5), repeat=3):
        place = np.floor(upright / width + shift)
        place %= np.where(np.isfinite(cells), cells, CELLS)
        cell = (place % CELLS).astype(np.int64) @ np.array([CELLS**2, CELLS, 1])
        order = np.argsort(cell)
        cell = cell[order]
        for apart in range(1, len(order)):
            alike = np.flatnonzero(cell[apart:] == cell[:-apart])
            if not alike.size:
                break
            if apart > CROWD:
                return True
            between = box.minimum_image(positions[order[alike]] - positions[order[alike + apart]])
            if (np.einsum("ij,ij->i", between, between) < (1.000001 * limit) ** 2).any():
                return True
    return False


def nearest_pair(
    positions: Floats, box: Box, limit: float, but: NDArray[np.int64] | None = None
) -> tuple[int, int, float] | None:
    """Nearest two of ``positions`` (n, 3) and their distance; None if no distance is below ``limit``. The pairs ``but``
    (m, 2), i < j, do not count."""
    if but is not None and len(but):
        return _nearest_other_pair(positions, box, limit, but)
    from scipy.spatial import cKDTree

    wrapped = box.wrap(positions)
    images, owners = _with_images(wrapped, box, limit)
    distances, found = cKDTree(images).query(wrapped, k=2, distance_upper_bound=limit)
    closest = int(np.argmin(distances[:, 1]))
    if not distances[closest, 1] < limit:
        return None
    other = int(owners[found[closest][found[closest] != closest][0]])
    return min(closest, other), max(closest, other), float(distances[closest, 1])


def _nearest_other_pair(
    positions: Floats, box: Box, limit: float, but: NDArray[np.int64]
) -> tuple[int, int, float] | None:
    pairs = pairs_nearer(positions, box, limit)
    pairs = pairs[~np.isin(pairs @ [len(positions), 1], but @ [len(positions), 1])]
    between = box.minimum_image(positions[pairs[:, 0]] - positions[pairs[:, 1]])
    distances = np.linalg.norm(between, axis=1)
    if not len(pairs):
        return None
    closest = int(np.argmin(distances))
    return int(pairs[closest, 0]), int(pairs[closest, 1]), float(distances[closest])


def pairs_nearer(positions: Floats, box: Box, limit: float) -> NDArray[np.int64]:
    """Pairs (m, 2) of particles with images within ``limit`` of each other, each pair once.

    The limit is at most half the least height of the box, so that at most one image of a pair is within it.
    """
    from scipy.spatial import cKDTree

    wrapped = box.wrap(positions)
    if not box.triclinic and all(box.periodic_axes):
        found = cKDTree(wrapped, boxsize=box.lengths).query_pairs(limit, output_type="ndarray")
        return found.reshape(-1, 2).astype(np.int64)
    images, owners = _with_images(wrapped, box, limit)
    pairs = cKDTree(images).query_pairs(limit, output_type="ndarray").reshape(-1, 2)
    pairs = np.sort(pairs[(pairs < len(wrapped)).any(axis=1)], axis=1)  # query_pairs returns i < j
    first, second = owners[pairs[:, 0]], owners[pairs[:, 1]]
    both = np.sort(np.column_stack([first, second])[first != second], axis=1)
    return np.unique(both, axis=0).astype(np.int64)


def _with_images(wrapped: Floats, box: Box, limit: float) -> tuple[Floats, NDArray[np.int64]]:
    """Positions, followed by their images within ``limit`` of the box, and the particle of each row."""
    images, owners = wrapped, np.arange(len(wrapped))
    rows, heights = box.matrix, box.heights
    for k in range(3):
        if not box.periodic_axes[k]:
            continue
        along, margin = box.fractional(images)[:, k], 1.000001 * limit / heights[k]
        low, high = along < margin, along > 1 - margin
        images = np.concatenate([images, images[low] + rows[k], images[high] - rows[k]])
        owners = np.concatenate([owners, owners[low], owners[high]])
    return images, owners

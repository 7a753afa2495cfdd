"""The Box of a cell of any shape, as other programs and structure files have cells, and the rotation into its axes."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from kickdrift.model.box.box import Box, Oriented
from kickdrift.model.state import Floats

UPRIGHT = 1e-6  # least part of a vector, relative to its length, perpendicular to the other vectors
LEAST = 0.3  # of three unit vectors, one has at least a third of its square perpendicular to two others


def without_rounding(cell: Floats, rounding: float) -> Floats:
    """The edge vectors (3, 3), one a row, with zeros for numbers that are at most ``rounding`` times their length."""
    return np.where(np.abs(cell) <= rounding * np.linalg.norm(cell, axis=1, keepdims=True), 0.0, cell)


def oriented(cell: Floats, axes: Sequence[bool] | NDArray[np.bool_]) -> Oriented:
    """The Box with edge vectors (3, 3) that point anywhere, periodic along one or more ``axes``, and the rotation into
    its axes. A vector along an open axis is replaced by its part perpendicular to the periodic vectors.

    Raises
    ------
    InputError
        For periodic vectors that span no volume; see Box.
    """
    there = np.array(axes, dtype=bool)
    whole, heights = _completed(cell, there)
    with np.errstate(all="ignore"):
        left_handed = np.linalg.det(whole) < 0
    # Reversed edge vectors span the same lattice.
    box, rotation = Box.from_vectors(-whole if left_handed else whole, there.tolist())
    if there.all():
        return Oriented(box, rotation)
    matrix = np.where(there[:, None], box.matrix, np.diag(heights))
    return Oriented(Box(matrix=matrix, periodic=there.tolist()), rotation)


def _completed(cell: Floats, axes: NDArray[np.bool_]) -> tuple[Floats, Floats]:
    """The cell (3, 3) with new vectors along its open axes, and the heights (3,) of its own vectors there.

    A new vector is perpendicular to all others, and as long as the longest periodic vector."""
    rows, heights = np.where(axes[:, None], cell, 0.0), np.zeros(3)
    longest = np.linalg.norm(rows, axis=1).max() or 1.0
    for k in np.flatnonzero(~axes):
        others = rows[rows.any(axis=1)]
        upright = _upright(cell[k], others)
        heights[k] = np.linalg.norm(upright)
        if heights[k] <= UPRIGHT * np.linalg.norm(cell[k]):
            heights[k] = 0.0
            units = [_upright(unit, others) for unit in np.eye(3)[[k, k - 1, k - 2]]]
            upright = next(unit for unit in units if unit @ unit > LEAST)
        rows[k] = longest * (upright / np.linalg.norm(upright))
    return rows, heights


def _upright(vector: Floats, others: Floats) -> Floats:
    """The part of a vector (3,) that is perpendicular to others (m, 3)."""
    for _ in range(2):  # one pass leaves rounding errors
        if (others @ vector).any():
            vector = vector - np.linalg.lstsq(others.T, vector)[0] @ others
    return vector

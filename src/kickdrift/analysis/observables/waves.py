"""Wave vectors that fit a periodic box, and sums over particles for all of them at once."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from kickdrift.errors import InputError
from kickdrift.model.box.box import Box
from kickdrift.model.box.edges import shortest
from kickdrift.model.state import Floats

REACH = 1.5  # default range in units of 2π over the mean distance (V/n)^(1/3), beyond a liquid's first peak
ROOM = 2**22  # most complex numbers of one product in memory


def reciprocal(box: Box) -> Floats:
    """Reciprocal vectors as rows, (3, 3). The product with the own edge vector is 2π, with the others 0. Rows of open
    axes are zero."""
    axes = np.array(box.periodic_axes)
    rows, found = np.where(axes[:, None], box.matrix, np.eye(3)), np.zeros((3, 3))
    for j in np.flatnonzero(axes):
        found[j, j] = 2 * np.pi / rows[j, j]
        for k in range(j + 1, 3):
            found[j, k] = -(rows[k, :k] @ found[j, :k]) / rows[k, k]
    return found


def in_shells(
    box: Box, units: Floats, particles: int, k_max: float | None, width: float | None
) -> tuple[NDArray[np.int64], NDArray[np.int64], int]:
    """One half of the vectors (m, 3) up to k_max, without -k for each k; the shell of each; and the number of
    shells."""
    axes = np.array(box.periodic_axes)
    room = float(np.prod(np.diag(box.matrix)[axes]))
    mean_distance = (room / particles) ** (1 / int(axes.sum()))
    smallest = float(np.linalg.norm(shortest(units[axes])[0]))
    largest = REACH * 2 * math.pi / mean_distance if k_max is None else float(k_max)
    step = smallest / 2 if width is None else float(width)
    if not (math.isfinite(largest) and largest >= smallest):
        raise InputError(f"structure_factor: k_max = {largest:g} is below the smallest wave vector, {smallest:g}")
    if not (math.isfinite(step) and step > 0):
        raise InputError(f"structure_factor: width must be positive, got {step:g}")
    # The number of a wave vector along an edge is their product over 2π.
    edges = np.linalg.norm(box.matrix, axis=1)
    most = [int(largest / (2 * np.pi / edge)) if there else 0 for edge, there in zip(edges, axes, strict=True)]
    grid = np.stack(np.meshgrid(*(np.arange(-m, m + 1) for m in most), indexing="ij"), axis=-1).reshape(-1, 3)
    a, b, c = grid.T
    half = (a > 0) | ((a == 0) & ((b > 0) | ((b == 0) & (c > 0))))
    wanted = grid[half & (np.linalg.norm(grid @ units, axis=1) <= largest)]
    # Shells begin half a width below the smallest vector. A small margin keeps equal lengths in one shell.
    place = np.floor((np.linalg.norm(wanted @ units, axis=1) - smallest) / step + 0.5 + 1e-9).astype(np.int64)
    kept, shell = np.unique(place, return_inverse=True)
    return wanted, shell.ravel(), len(kept)


class Waves(NamedTuple):
    """Wave vectors, sorted for ``intensity``: columns (p, 2) of a and b that share their values of c."""

    units: Floats  # (3, 3) reciprocal vectors as rows
    low: NDArray[np.int64]  # (3,) smallest a, b, c, and the largest
    high: NDArray[np.int64]
    columns: NDArray[np.int64]
    column: NDArray[np.int64]  # (m,) column of each vector, and its c, counted from the smallest
    depth: NDArray[np.int64]
    order: NDArray[np.int64]  # (m,) index of each vector in the caller's order

    @classmethod
    def of(cls, wanted: NDArray[np.int64], units: Floats) -> Waves:
        columns, column = np.unique(wanted[:, :2], axis=0, return_inverse=True)
        column = column.ravel()
        order = np.argsort(column, kind="stable")
        low, high = wanted.min(axis=0), wanted.max(axis=0)
        return cls(units, low, high, columns - low[:2], column[order], wanted[order, 2] - low[2], order)

    def intensity(self, x: Floats) -> Floats:
        """|sum over particles of exp(-i k·r)|² / n for each vector (m,), in the caller's order.

        The factors of each reciprocal vector are tabulated. For given a, b, one matrix product sums over particles for
        all c.
        """
        n, phases = len(x), np.ascontiguousarray((x @ self.units.T).T)
        along = [
            np.exp(-1j * np.arange(self.low[axis], self.high[axis] + 1)[:, None] * phases[axis]) for axis in range(3)
        ]
        result = np.empty(len(self.order))
        size = max(1, ROOM // n)
        for start in range(0, len(self.columns), size):
            a, b = self.columns[start : start + size].T
            sums = (along[0][a] * along[1][b]) @ along[2].T
            some = slice(*np.searchsorted(self.column, (start, start + len(a))))
            amplitude = sums[self.column[some] - start, self.depth[some]]
            result[self.order[some]] = (amplitude.real**2 + amplitude.imag**2) / n
        return result

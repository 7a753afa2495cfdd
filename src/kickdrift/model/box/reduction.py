"""Short vectors of a lattice, for boxes and nearest images."""

from __future__ import annotations

import itertools

import numpy as np
from numpy.typing import NDArray

Rows = NDArray[np.float64]

SMALLER = 1 - 1e-12  # largest ratio of squares that counts as shorter, so that rounding ends the search


def lower(rows: Rows) -> Rows:
    """Same lattice with tilts of half an edge at most: the lower triangular ``rows`` (3, 3), each less multiples of
    earlier rows."""
    made = rows.copy()
    for k, before in ((2, 1), (2, 0), (1, 0)):
        if made[before, before]:
            made[k] -= np.rint(made[k, before] / made[before, before]) * made[before]
    return made


def shortest(rows: Rows) -> Rows:
    """Minkowski-reduced vectors (m, 3) of the lattice with the vectors ``rows`` (m, 3), m = 1, 2 or 3.

    Source: the greedy algorithm of Nguyen & Stehlé (ACM Trans. Algorithms 5, 46, 2009, doi:10.1145/1597036.1597050).
    Their lemma on Voronoi coordinates gives the nearest image of a vector with coordinates within ±1/2 along these
    rows: the vector plus -1, 0 or 1 times each row.
    """
    made = rows[np.argsort((rows**2).sum(axis=1), kind="stable")]
    if len(made) == 1:
        return made
    while True:
        first = made[:-1] if len(made) == 2 else shortest(made[:-1])
        last = made[-1] - np.rint(np.linalg.lstsq(first.T, made[-1], rcond=None)[0]) @ first
        steps = np.array(list(itertools.product((0, 1, -1), repeat=len(first)))) @ first
        last = min(last + steps, key=lambda vector: float(vector @ vector))
        done = last @ last >= SMALLER * (first[-1] @ first[-1])
        made = np.vstack([first, last])
        if done:
            return made
        made = made[np.argsort((made**2).sum(axis=1), kind="stable")]


def neighbours(rows: Rows) -> Rows:
    """Sums of -1, 0 or 1 times each of the ``rows`` (m, 3), without zero, shape (3^m - 1, 3)."""
    return np.array([n for n in itertools.product((-1, 0, 1), repeat=len(rows)) if any(n)]) @ rows

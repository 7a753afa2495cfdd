"""Short edge vectors of a lattice: the same lattice by other vectors, for boxes and nearest images."""

from __future__ import annotations

import itertools

import numpy as np
from numpy.typing import NDArray

Rows = NDArray[np.float64]

SMALLER = (
    1 - 1e-12
)  # a new vector counts as shorter below this share of the old square, so that rounding ends the search


def lower(rows: Rows) -> Rows:
    """The same lattice with tilts of half an edge at most: the lower triangular ``rows`` (3, 3), each less whole
    numbers of the rows before."""
    made = rows.copy()
    for k, before in ((2, 1), (2, 0), (1, 0)):
        if made[before, before]:
            made[k] -= np.rint(made[k, before] / made[before, before]) * made[before]
    return made


def shortest(rows: Rows) -> Rows:
    """The Minkowski-reduced vectors (m, 3) of the lattice with the vectors ``rows`` (m, 3), m = 1, 2 or 3.

    The greedy algorithm of Nguyen & Stehlé (ACM Trans. Algorithms 5, 46, 2009, doi:10.1145/1597036.1597050). By their
    lemma on Voronoi coordinates, the nearest image of a vector whose coordinates along these rows are within ±1/2 is
    that vector plus -1, 0 or 1 of each.
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
    """(3^m - 1, 3) the sums of -1, 0 or 1 of each of the ``rows`` (m, 3), without zero."""
    return np.array([n for n in itertools.product((-1, 0, 1), repeat=len(rows)) if any(n)]) @ rows

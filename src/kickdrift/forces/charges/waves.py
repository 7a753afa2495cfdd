"""The waves of Ewald's far part: which ones, in columns along the third axis of the reciprocal lattice."""

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from kickdrift.model.box.box import Box


class Waves(NamedTuple):
    """Wave vectors k = 2 pi (i, m, n) of the reciprocal lattice with |k| below a limit, one of each two opposite ones.

    A *column* has i and m, and every n from -most to most; its waves at n and -n are kept together. The wave n of
    column c has the number ``first[c] + n``.
    """

    columns: NDArray[np.int64]  # (columns, 2) i and m
    first: NDArray[np.int64]  # (columns + 1,) number of the first wave of each column
    kept: NDArray[np.float64]  # (waves, 2) 1 for a wave that counts, n and -n, else 0
    most: tuple[int, int, int]  # largest i, m and n


def waves_of(box: Box, limit: float) -> Waves:
    """The waves up to this wave number in a periodic box; none for a limit of 0."""
    if limit == 0.0:
        return Waves(np.zeros((0, 2), np.int64), np.zeros(1, np.int64), np.zeros((0, 2)), (0, 0, 0))
    inverse = 2.0 * math.pi * np.linalg.inv(box.matrix)  # k = inverse @ (i, m, n)
    most = np.floor(limit * np.linalg.norm(box.matrix, axis=1) / (2.0 * math.pi) + 1e-9).astype(int)
    columns, first, kept = [], [0], []
    for i in range(most[0] + 1):
        for m in range(0 if i == 0 else -most[1], most[1] + 1):
            both = np.array([[[i, m, sign * n] for sign in (1, -1)] for n in range(most[2] + 1)])
            inside = np.linalg.norm(both @ inverse.T, axis=-1) <= limit * (1.0 + 1e-12)
            inside[0, 1] = False  # n and -n are one wave there
            if i == m == 0:
                inside[0, 0] = False
                inside[:, 1] = False
            if inside.any():
                count = int(np.flatnonzero(inside.any(axis=1))[-1]) + 1
                columns.append((i, m))
                kept.append(inside[:count])
                first.append(first[-1] + count)
    made = np.concatenate(kept).astype(float) if kept else np.zeros((0, 2))
    rows = np.array(columns, np.int64).reshape(-1, 2)
    return Waves(rows, np.array(first, np.int64), made, (int(most[0]), int(most[1]), int(most[2])))

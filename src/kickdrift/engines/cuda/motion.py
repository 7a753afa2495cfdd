"""Kicks and drifts on the device, and the particles in the order of the caller."""

from __future__ import annotations

from functools import lru_cache
from typing import Any

from numba import cuda

from kickdrift.engines.cuda.law_code import Code

MARKS = 4
FAR, MOST = 0, 3  # marks: largest square of a displacement, and most neighbours of a particle
NOT_FINITE, TOO_LARGE = 1, 2  # flags of positions, and of forces


@lru_cache(maxsize=8)
def move_of(write: Code) -> Code:
    """Kernel of two kicks and a drift; the first ``kick`` ends a step, and the second begins the next.

    Arguments: x, v, a and the positions ``at`` of the last list (3, n), the places and marks to write, and the times of
    the kicks and the drift. ``write`` writes a place, see `Places`."""

    @cuda.jit
    def move(x, v, a, at, written, marks, last_kick, kick, drift):
        i = cuda.grid(1)
        if i < x.shape[1]:
            square = 0.0
            for k in range(3):
                speed = v[k, i] + last_kick * a[k, i]
                speed = speed + kick * a[k, i]
                v[k, i] = speed
                place = x[k, i] + drift * speed
                x[k, i] = place
                way = place - at[k, i]
                square += way * way
            write(written, i, x[0, i], x[1, i], x[2, i])
            if not square <= marks[FAR]:
                if square < 1e300:
                    cuda.atomic.max(marks, FAR, square)
                else:
                    marks[NOT_FINITE] = 1.0

    return move


@lru_cache(maxsize=8)
def placing_of(write: Code) -> Code:
    """Kernel that writes positions (3, n) to their places."""

    @cuda.jit
    def place(x, written):
        i = cuda.grid(1)
        if i < x.shape[1]:
            write(written, i, x[0, i], x[1, i], x[2, i])

    return place


@cuda.jit
def put_in_order(ids: Any, rows: Any, ordered: Any) -> None:
    """Write rows (m, n) of particles ``ids`` to their columns."""
    i = cuda.grid(1)
    if i < ids.size:
        for k in range(rows.shape[0]):
            ordered[k, ids[i]] = rows[k, i]


@cuda.jit
def copy(x: Any, v: Any, a: Any, ids: Any, weights: Any, x2: Any, v2: Any, a2: Any, ids2: Any, weights2: Any) -> None:
    """Copy a state to another."""
    i = cuda.grid(1)
    if i < ids.size:
        for k in range(3):
            x2[k, i], v2[k, i], a2[k, i] = x[k, i], v[k, i], a[k, i]
        ids2[i], weights2[i] = ids[i], weights[i]

"""Particles in the order of cells, on the device.

Cells form lines along the last axis. Lines are no thinner than the range of the list, so that the neighbours of a
particle are in nine lines. `FINE` cells of a line are as long as the range. Along open axes, particles beyond the first
and the last cell belong to these. Atomic counters place the particles in a cell in any order. No result depends on this
order, because forces are sums of whole numbers.
"""

from __future__ import annotations

import math
from functools import lru_cache
from typing import Any, NamedTuple

import numpy as np
from numba import config, cuda

from kickdrift.engines.cuda.law_code import Code, on_device
from kickdrift.model.state import Floats

MOST_CELLS = 1 << 24
FINE = 4
CHUNK = 32  # cells that one thread sums
SCAN = 32 if config.ENABLE_CUDASIM else 1024  # threads of the scan


class Grid(NamedTuple):
    """Cells of a box: their numbers along each axis, corner, inverse edges, and which axes are periodic."""

    counts: tuple[int, int, int]
    corner: tuple[float, float, float]
    inverse: tuple[float, float, float]
    periodic: tuple[bool, bool, bool]

    @property
    def size(self) -> int:
        return int(np.prod(self.counts))


def grid_of(edges: Floats, positions: Floats, reach: float) -> Grid:
    """Grid of a box with edges (3,), zero along open axes, for neighbours within ``reach``. Open axes have cells from
    the first to the last of the positions (3, n)."""
    corner, length = np.zeros(3), edges.copy()
    for axis in np.flatnonzero(edges == 0):
        corner[axis], length[axis] = positions[axis].min(), np.ptp(positions[axis])
    counts = np.maximum(1, np.floor(length / reach * [1, 1, FINE])).astype(np.int64)
    while np.prod(counts.astype(float)) > MOST_CELLS:
        counts = np.maximum(1, counts // 2)
    inverse = np.where(length > 0, counts / np.where(length > 0, length, 1.0), 0.0)
    return Grid(*(tuple(each.tolist()) for each in (counts, corner, inverse, edges > 0)))


@lru_cache(maxsize=8)
def counting_of(grid: Grid) -> Code:
    """Kernel that counts the particles of each cell, and notes each particle's cell and number in the cell."""
    (na, nb, nc), (ca, cb, cc), (ia, ib, ic), (pa, pb, pc) = grid

    def along(x, corner, inverse, count, periodic):
        t = (x - corner) * inverse
        if periodic:
            share = t / count
            t = (share - math.floor(share)) * count
        return np.int64(min(max(t, 0.0), count - 1.0))

    cell_along = on_device(along)

    @cuda.jit
    def count(x, cells, numbers, counts):
        i = cuda.grid(1)
        if i < cells.size:
            a = cell_along(x[0, i], ca, ia, na, pa)
            b = cell_along(x[1, i], cb, ib, nb, pb)
            c = cell_along(x[2, i], cc, ic, nc, pc)
            cell = (a * nb + b) * nc + c
            cells[i] = cell
            numbers[i] = cuda.atomic.add(counts, cell, 1)

    return count


@cuda.jit
def add_chunks(counts: Any, sums: Any) -> None:
    """Write the sum of each `CHUNK` counts."""
    t = cuda.grid(1)
    if t < sums.size:
        total = 0
        for k in range(t * CHUNK, min((t + 1) * CHUNK, counts.size)):
            total += counts[k]
        sums[t] = total


@cuda.jit
def scan(sums: Any, marks: Any) -> None:
    """Replace the sums by the sums before each, in one block. Set the marks to zero."""
    t = cuda.threadIdx.x
    shares = cuda.shared.array(SCAN, np.int32)
    size = (sums.size + SCAN - 1) // SCAN
    first, end = min(t * size, sums.size), min((t + 1) * size, sums.size)
    total = 0
    for k in range(first, end):
        total += sums[k]
    shares[t] = total
    cuda.syncthreads()
    if t == 0:
        for k in range(marks.size):
            marks[k] = 0.0
        before = 0
        for k in range(SCAN):
            own = shares[k]
            shares[k] = before
            before += own
    cuda.syncthreads()
    before = shares[t]
    for k in range(first, end):
        own = sums[k]
        sums[k] = before
        before += own


@cuda.jit
def start_cells(counts: Any, sums: Any, starts: Any) -> None:
    """Write the number of particles before each cell (m + 1,), and set the counts (m,) to zero."""
    t = cuda.grid(1)
    if t < sums.size:
        before = sums[t]
        for k in range(t * CHUNK, min((t + 1) * CHUNK, counts.size)):
            own = counts[k]
            starts[k] = before
            counts[k] = 0
            before += own
        if t == sums.size - 1:
            starts[counts.size] = before


@lru_cache(maxsize=8)
def moving_of(write: Code) -> Code:
    """Kernel that moves the particles to the order of their cells, with their places, and notes their cells."""

    @cuda.jit
    def move(cells, numbers, starts, x, v, a, ids, weights, x2, v2, a2, ids2, weights2, homes, at, placed):
        i = cuda.grid(1)
        if i < cells.size:
            to = starts[cells[i]] + numbers[i]
            for k in range(3):
                x2[k, to], v2[k, to], a2[k, to] = x[k, i], v[k, i], a[k, i]
                at[k, to] = x[k, i]
            ids2[to], weights2[to], homes[to] = ids[i], weights[i], cells[i]
            write(placed, to, x[0, i], x[1, i], x[2, i])

    return move


@cuda.jit
def write_kinds(ids: Any, kinds: Any, placed: Any) -> None:
    """Write the species of the particles, in the caller's order, to their places."""
    i = cuda.grid(1)
    if i < ids.size:
        placed[4 * i + 3] = kinds[ids[i]]

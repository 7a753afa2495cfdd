"""Particles in the order of cells, and their neighbours, on the device.

A cell has its edges no shorter than the range of the list, so that the neighbours of a particle are in 27 cells. Along
open axes, particles beyond the first and the last cell belong to these. Atomic counters place the particles in a cell
in any order. No result depends on this order, because forces are sums of whole numbers.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numba import cuda

from kickdrift.engines.cuda.law_code import Code, on_device
from kickdrift.engines.cuda.places import Places
from kickdrift.model.state import Floats

MOST_CELLS = 1 << 24


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
    counts = np.maximum(1, np.floor(length / reach)).astype(np.int64)
    while np.prod(counts.astype(float)) > MOST_CELLS:
        counts = np.maximum(1, counts // 2)
    inverse = np.where(length > 0, counts / np.where(length > 0, length, 1.0), 0.0)
    return Grid(*(tuple(each.tolist()) for each in (counts, corner, inverse, edges > 0)))  # type: ignore[arg-type]


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

    return count  # type: ignore[no-any-return]


def scan_of(threads: int) -> Code:
    """Kernel of one block that writes the sums ``starts`` (m + 1,) of the counts (m,) before each, and clears these."""

    @cuda.jit
    def scan(counts, starts):
        t = cuda.threadIdx.x
        sums = cuda.shared.array(threads, np.int32)
        size = (counts.size + threads - 1) // threads
        first, end = min(t * size, counts.size), min((t + 1) * size, counts.size)
        total = 0
        for k in range(first, end):
            total += counts[k]
        sums[t] = total
        cuda.syncthreads()
        if t == 0:
            before = 0
            for k in range(threads):
                own = sums[k]
                sums[k] = before
                before += own
            starts[counts.size] = before
        cuda.syncthreads()
        before = sums[t]
        for k in range(first, end):
            own = counts[k]
            starts[k] = before
            counts[k] = 0
            before += own

    return scan  # type: ignore[no-any-return]


def moving_of(places: Places) -> Code:
    """Kernel that moves the particles to the order of their cells, with the positions ``at`` of this list."""
    write = places.write

    @cuda.jit
    def move(cells, numbers, starts, x, v, a, ids, weights, x_new, v_new, a_new, ids_new, weights_new, at, written, homes):
        i = cuda.grid(1)
        if i < cells.size:
            to = starts[cells[i]] + numbers[i]
            for k in range(3):
                x_new[k, to] = x[k, i]
                at[k, to] = x[k, i]
                v_new[k, to] = v[k, i]
                a_new[k, to] = a[k, i]
            ids_new[to] = ids[i]
            homes[to] = cells[i]
            weights_new[to] = weights[i]
            write(written, to, x[0, i], x[1, i], x[2, i])

    return move  # type: ignore[no-any-return]


def search_of(grid: Grid, places: Places, reach: float) -> Code:
    """Kernel that writes the neighbours of each particle within ``reach`` to rows, their numbers, and the largest."""
    (na, nb, nc), _, _, (pa, pb, pc) = grid
    read, apart = places.read, places.apart
    square = np.float32(reach**2 * 1.00001) if places.single else np.float64(reach**2)

    @cuda.jit
    def search(placed, homes, starts, near, counts, most):
        i = cuda.grid(1)
        if i < counts.size:
            own = read(placed, i)
            cell = homes[i]
            a, b, c = cell // (nb * nc), cell // nc % nb, cell % nc
            found = 0
            for da in range(min(na, 3)):
                ka = a + da - 1 if na > 2 else da
                if pa:
                    ka = (ka + na) % na
                if ka < 0 or ka >= na:
                    continue
                for db in range(min(nb, 3)):
                    kb = b + db - 1 if nb > 2 else db
                    if pb:
                        kb = (kb + nb) % nb
                    if kb < 0 or kb >= nb:
                        continue
                    for dc in range(min(nc, 3)):
                        kc = c + dc - 1 if nc > 2 else dc
                        if pc:
                            kc = (kc + nc) % nc
                        if kc < 0 or kc >= nc:
                            continue
                        row = (ka * nb + kb) * nc + kc
                        for j in range(starts[row], starts[row + 1]):
                            dx, dy, dz = apart(own, read(placed, j))
                            if dx * dx + dy * dy + dz * dz < square and j != i:
                                if found < near.shape[1]:
                                    near[i, found] = j
                                found += 1
            counts[i] = min(found, near.shape[1])
            if found > most[0]:
                cuda.atomic.max(most, 0, found)

    return search  # type: ignore[no-any-return]

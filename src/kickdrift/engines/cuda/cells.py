"""Particles in the order of cells, and their neighbours, on the device.

A cell has its edges no shorter than the range of the list, so that the neighbours of a particle are in 27 cells. Along
open axes, particles beyond the first and the last cell belong to these. Atomic counters place the particles in a cell
in any order. No result depends on this order, because forces are sums of whole numbers.
"""

from __future__ import annotations

import math
from functools import lru_cache
from typing import NamedTuple

import numpy as np
from numba import config, cuda

from kickdrift.engines.cuda.law_code import Code, on_device
from kickdrift.engines.cuda.places import Places
from kickdrift.model.state import Floats

MOST_CELLS = 1 << 24
SEARCHING = 1 if config.ENABLE_CUDASIM else 32  # threads that search the neighbours of one particle: a warp


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


@lru_cache(maxsize=1)
def scan_of(threads: int) -> Code:
    """Kernel of one block that writes ``starts`` (m + 1,), the sums of the counts (m,) before each cell. It then sets
    the counts, the marks and the largest number of neighbours to zero."""

    @cuda.jit
    def scan(counts, starts, marks, most):
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
            most[0] = 0
            for k in range(marks.size):
                marks[k] = 0.0
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

    return scan


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


def votes_of() -> Code:
    """Device function that returns the threads of a warp that have a hit, as bits."""
    if config.ENABLE_CUDASIM:
        return lambda hit: 1 if hit else 0
    return on_device(lambda hit: np.uint32(cuda.ballot_sync(0xFFFFFFFF, hit)))


@lru_cache(maxsize=8)
def search_of(grid: Grid, places: Places, reach: float) -> Code:
    """Kernel that writes the neighbours of each particle within ``reach`` to rows, their numbers, and the largest.

    A warp searches for one particle: each of its threads looks at another candidate. Cells along the last axis are one
    run of particles, or two where they go around the box."""
    (na, nb, nc), _, _, (pa, pb, pc) = grid
    read, apart, votes = places.read, places.apart, votes_of()
    square = np.float32(reach**2 * 1.00001) if places.single else np.float64(reach**2)
    plane, line, warp = np.uint32(nb * nc), np.uint32(nc), np.uint32(SEARCHING)
    whole = pc and nc < 4
    around = pc and nc > 3

    def beside_of(count, periodic):
        def beside(c, d):
            k = np.int32(np.int32(c) + d - 1) if count > 2 else np.int32(d)
            if periodic and k < 0:
                k = np.int32(count - 1)
            if periodic and k >= count:
                k = np.int32(0)
            return k

        return on_device(beside)

    beside_a, beside_b = beside_of(na, pa), beside_of(nb, pb)

    @cuda.jit
    def search(placed, homes, starts, near, counts, most):
        t = np.uint32(cuda.grid(1))
        i, lane = np.uint32(t // warp), np.uint32(t % warp)
        if i < counts.size:
            own, cell = read(placed, i), np.uint32(homes[i])
            a = np.uint32(cell // plane)
            rest = np.uint32(cell - a * plane)
            b = np.uint32(rest // line)
            c = np.int32(rest - b * line)
            first, last = np.int32(max(c - 1, 0)), np.int32(min(c + 1, nc - 1))
            if whole:
                first, last = np.int32(0), np.int32(nc - 1)
            runs = 2 if around and (c == 0 or c == nc - 1) else 1
            other = np.int32(nc - 1 - c)
            earlier, found, room = np.uint32((1 << lane) - 1), np.int32(0), np.int32(near.shape[1])
            row = near[i]
            for da in range(min(na, 3)):
                ka = beside_a(a, da)
                if ka < 0 or ka >= na:
                    continue
                for db in range(min(nb, 3)):
                    kb = beside_b(b, db)
                    if kb < 0 or kb >= nb:
                        continue
                    base = np.int32(np.int32(ka * nb + kb) * nc)
                    for run in range(runs):
                        low, high = (other, other) if run == 1 else (first, last)
                        j, end = np.uint32(starts[np.uint32(base + low)]), np.uint32(starts[np.uint32(base + high + 1)])
                        while j < end:
                            candidate, hit = np.uint32(j + lane), False
                            if candidate < end and candidate != i:
                                dx, dy, dz = apart(own, read(placed, candidate))
                                hit = dx * dx + dy * dy + dz * dz < square
                            hits = votes(hit)
                            place = np.int32(found + cuda.popc(np.uint32(hits & earlier)))
                            if hit and place < room:
                                row[np.uint32(place)] = candidate
                            found = np.int32(found + cuda.popc(hits))
                            j = np.uint32(j + warp)
            if lane == 0:
                counts[i] = min(found, room)
                if found > most[0]:
                    cuda.atomic.max(most, 0, found)

    return search

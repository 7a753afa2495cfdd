"""The tree: particles in clusters of eight, halved again and again along the longest edge, and each part's moments.

It is a balanced k-d tree (Bentley 1975, doi:10.1145/361002.361007) where Barnes and Hut had an octree: every cluster
is full, so that no SIMD lane idles; it takes no more levels for two clusters far apart, for particles in a plane or in
one place, where an octree's keys run out of bits; and its shape is known from n alone, so it needs no pointers.

The parts of node k are 2 k and 2 k + 1, the root is 1. Everything is made anew at each evaluation from the particles in
the order of their ids, so the tree depends on the positions and on nothing before.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from kickdrift.forces.chunks import chunk_task
from kickdrift.forces.compiling import jit, never_inline
from kickdrift.forces.simd import WIDTH, lane_max, lane_sum, load, select, splat

# columns of a node: its G M, centre of mass, radius about it, bound, moments; 16 fill two cache lines
GM, CX, CY, CZ, RADIUS, BOUND, XX, XY, XZ, YY, YZ, ZZ, TRACE, COLUMNS = *range(13), 16
SUBTREES = 5  # levels above the parts that threads take


def clusters_of(n: int) -> int:
    """Clusters of eight that n particles fill."""
    return -(-n // WIDTH)


def levels_of(n: int) -> int:
    """Levels below the root, so that the lowest nodes have one cluster at most."""
    return (clusters_of(n) - 1).bit_length()


def spans(n: int) -> NDArray[np.int64]:
    """(nodes, 2) first cluster and last + 1 of each node; the j-th of 2^l at level l has j K / 2^l to (j + 1) K / 2^l
    of K clusters."""
    clusters, depth = clusters_of(n), levels_of(n)
    span = np.zeros((2 << depth, 2), np.int64)
    for level in range(depth + 1):
        edges = np.arange((1 << level) + 1) * clusters >> level
        span[1 << level : 2 << level] = np.stack([edges[:-1], edges[1:]], axis=1)
    return span


@jit
def build(force, x):
    """Sort the particles at x (3, n) into the tree; whether they are numbers."""
    n, rows = x.shape[1], force.rows
    for i in range(n):
        for k in range(3):
            if not math.isfinite(x[k, i]):
                return False
            rows[i, k] = x[k, i]
        rows[i, 3] = i
    top = min(SUBTREES, force.depth)
    for node in range(1, 1 << top):
        halve(force, node)
    return True


@chunk_task
def subtree(force, c):
    """Everything below the c-th node of level SUBTREES: order, places, moments."""
    never_inline()
    top = min(SUBTREES, force.depth)
    for level in range(top, force.depth):
        for node in range(((1 << top) + c) << (level - top), ((1 << top) + c + 1) << (level - top)):
            halve(force, node)
    root = (1 << top) + c
    place(force, WIDTH * force.span[root, 0], WIDTH * force.span[root, 1])
    for level in range(top, force.depth + 1):
        for node in range(root << (level - top), (root + 1) << (level - top)):
            moments(force, node)


@jit
def halve(force, node):
    """Divide a node's particles at the median along the longest edge of their box."""
    rows, n = force.rows, force.rows.shape[0]
    begin, end = WIDTH * force.span[node, 0], min(WIDTH * force.span[node, 1], n)
    middle = WIDTH * force.span[2 * node, 1]
    if middle <= begin or middle >= end:
        return
    longest, axis = -1.0, 0
    for k in range(3):
        low = high = rows[begin, k]
        for i in range(begin + 1, end):
            low, high = min(low, rows[i, k]), max(high, rows[i, k])
        if high - low > longest:
            longest, axis = high - low, k
    part(rows, begin, end - 1, middle, axis)


@jit
def part(rows, low, high, middle, axis):
    """Rearrange rows low to high so that none before ``middle`` is larger and none after it is smaller (Hoare 1961,
    doi:10.1145/366622.366647)."""
    while low < high:
        step = (high - low) // 8
        pivot = median(
            median(rows[low, axis], rows[low + step, axis], rows[low + 2 * step, axis]),
            median(rows[low + 3 * step, axis], rows[(low + high) // 2, axis], rows[high - 3 * step, axis]),
            median(rows[high - 2 * step, axis], rows[high - step, axis], rows[high, axis]),
        )
        i, j = low, high
        while i <= j:
            while rows[i, axis] < pivot:
                i += 1
            while rows[j, axis] > pivot:
                j -= 1
            if i <= j:
                for k in range(4):
                    rows[i, k], rows[j, k] = rows[j, k], rows[i, k]
                i += 1
                j -= 1
        if middle <= j:
            high = j
        elif middle >= i:
            low = i
        else:
            return


@jit
def median(a, b, c):
    """The middle one."""
    return max(min(a, b), min(max(a, b), c))


@jit
def place(force, begin, end):
    """Positions and G m in the tree's order; places beyond the last particle have no mass and stand where it does."""
    rows, x, y, z = force.rows, force.x[0], force.x[1], force.x[2]
    n = rows.shape[0]
    for s in range(begin, end):
        row = rows[min(s, n - 1)]
        x[s], y[s], z[s] = row[0], row[1], row[2]
        force.gm[s] = force.gm_by_id[int(row[3])] if s < n else 0.0


@jit
def moments(force, node):
    """Mass, centre of mass, and the moments about it: second, and third of the absolute distance."""
    x, y, z, gm, out = force.x[0], force.x[1], force.x[2], force.gm, force.nodes[node]
    begin, end = WIDTH * force.span[node, 0], WIDTH * force.span[node, 1]
    zero = splat(0.0)
    total, mx, my, mz = zero, zero, zero, zero
    out[GM] = 0.0
    if begin == end:
        return
    x0, y0, z0 = x[begin], y[begin], z[begin]  # sums about a near point round less
    for s in range(begin, end, WIDTH):
        m = load(gm, s)
        total = total + m
        mx, my, mz = mx + m * (load(x, s) - x0), my + m * (load(y, s) - y0), mz + m * (load(z, s) - z0)
    whole = lane_sum(total)
    if whole == 0.0:
        return
    cx, cy, cz = x0 + lane_sum(mx) / whole, y0 + lane_sum(my) / whole, z0 + lane_sum(mz) / whole
    xx, xy, xz, yy, yz, zz, third, largest = zero, zero, zero, zero, zero, zero, zero, zero
    for s in range(begin, end, WIDTH):
        m = load(gm, s)
        dx, dy, dz = load(x, s) - cx, load(y, s) - cy, load(z, s) - cz
        r2 = dx * dx + dy * dy + dz * dz
        third = third + m * r2 * math.sqrt(r2)
        largest = select((m > 0.0) & (r2 > largest), r2, largest)
        xx, xy, xz = xx + m * dx * dx, xy + m * dx * dy, xz + m * dx * dz
        yy, yz, zz = yy + m * dy * dy, yz + m * dy * dz, zz + m * dz * dz
    out[GM], out[CX], out[CY], out[CZ] = whole, cx, cy, cz
    out[RADIUS], out[BOUND] = math.sqrt(lane_max(largest)), 4.0 * lane_sum(third)
    # as the kernel uses them: three times the second moments, and 3/2 of their trace
    out[XX], out[XY], out[XZ] = 3.0 * lane_sum(xx), 3.0 * lane_sum(xy), 3.0 * lane_sum(xz)
    out[YY], out[YZ], out[ZZ] = 3.0 * lane_sum(yy), 3.0 * lane_sum(yz), 3.0 * lane_sum(zz)
    out[TRACE] = 0.5 * (out[XX] + out[YY] + out[ZZ])

"""Particles sorted into columns over the x-y plane and by z in each column, and cut into padded clusters.

All code is compiled strictly, so a particle on an edge is in the same column on every processor. The parts that take
long run in chunks of particles or of columns, which depend on nothing but the particles and the box.
"""

from __future__ import annotations

from math import inf
from typing import Any, NamedTuple

import numpy as np

from kickdrift.forces.lists.clusters import APART, FAR, N_CLUSTERS, NX, NY, STRIDE
from kickdrift.jit.compile import jit, never_inline, strict
from kickdrift.jit.handle import handle
from kickdrift.jit.lanes.vectors import WIDTH
from kickdrift.jit.threads.chunks import chunk_task, each_chunk
from kickdrift.model.box.cell import into_brick


class Sorting(NamedTuple):
    """A list that is being sorted."""

    pairs: Any  # a handle of a ClusterList
    x: Any  # (3, n) positions
    offset: Any  # (3, n) whole edges to subtract from each position
    z: Any  # (n,) positions along z, less the edges
    low: Any  # (3,) lowest corner
    extent: Any  # (3,)
    ends: Any  # (columns + 1,) first particle of each column, in the order of columns
    places: Any  # (chunks, columns) number of a chunk's particles in each column, then the place of the next one
    before: Any  # (n,) particles in the former order, which is nearly the new one


@strict
def sort(pairs, x, chunks):
    """Sort the particles into columns and by z (ids break ties), and make padded clusters with bounding boxes."""
    n = pairs.order.size
    low, extent = extents(pairs, x)
    for k in range(3):  # compiling the assignment of a whole array takes a second longer
        pairs.origin[k] = low[k] + 0.5 * extent[k]
    nx, ny = columns(n, extent)
    pairs.counts[NX], pairs.counts[NY] = nx, ny
    pairs.grid[0], pairs.grid[1], pairs.grid[2], pairs.grid[3] = extent[0] / nx, extent[1] / ny, low[0], low[1]
    ends, places = np.zeros(nx * ny + 1, np.int64), np.zeros((chunks.number, nx * ny), np.int64)
    sort_with(pairs, x, chunks, np.empty((3, n)), np.empty(n), low, extent, ends, places, pairs.order.copy())


@strict
def sort_with(pairs, x, chunks, offset, z, low, extent, ends, places, before):
    """Do the work of `sort`, whose arrays outlive this call: a handle keeps none alive."""
    first = pairs.column_clusters
    sorting = handle(Sorting(pairs, x, offset, z, low, extent, ends, places, before))
    each_chunk(sorting, chunks, "columns_of_chunk")
    each_chunk(sorting, chunks, "counts_of_chunk")
    first[0] = at = 0
    for column in range(ends.size - 1):
        begin = at
        for c in range(places.shape[0]):
            count = places[c, column]
            places[c, column] = at
            at += count
        ends[column + 1] = at
        first[column + 1] = first[column] + (at - begin + WIDTH - 1) // WIDTH
    pairs.counts[N_CLUSTERS] = first[ends.size - 1]
    each_chunk(sorting, chunks, "order_of_chunk")
    each_chunk(sorting, chunks, "clusters_of_chunk")


@strict
def extents(pairs, x):
    """Return the lowest corner and the extent of the particles after `columns_of_chunk`."""
    matrix = pairs.cell.matrix
    low, extent = np.zeros(3), np.zeros(3)
    for k in range(3):
        if matrix[k, k] > 0.0:
            extent[k] = matrix[k, k]
        else:
            low[k] = high = x[k, 0]
            for i in range(x.shape[1]):
                low[k], high = min(low[k], x[k, i]), max(high, x[k, i])
            extent[k] = max(high - low[k], 1e-3 * pairs.cutoff)
    return low, extent


@chunk_task
def columns_of_chunk(sorting, c):
    """Find the whole edges to subtract from the positions of chunk c's particles, and the particles' columns."""
    never_inline()
    pairs, low, extent, z, column = sorting.pairs, sorting.low, sorting.extent, sorting.z, sorting.pairs.column
    chunks, n, nx, ny = pairs.force.shape[0], column.size, pairs.counts[NX], pairs.counts[NY]
    begin, end = c * n // chunks, (c + 1) * n // chunks
    x, offset, matrix = sorting.x[:, begin:end], sorting.offset[:, begin:end], pairs.cell.matrix
    offset[:] = 0.0
    for k in range(2, -1, -1):
        if matrix[k, k] > 0.0:
            into_brick(matrix, k, x, offset)
    for i in range(end - begin):
        a = int((x[0, i] - offset[0, i] - low[0]) / extent[0] * nx)
        b = int((x[1, i] - offset[1, i] - low[1]) / extent[1] * ny)
        column[begin + i] = min(max(a, 0), nx - 1) * ny + min(max(b, 0), ny - 1)
        z[begin + i] = x[2, i] - offset[2, i]


@chunk_task
def counts_of_chunk(sorting, c):
    """Count chunk c's particles, by the former order, in each column."""
    never_inline()
    column, before, places = sorting.pairs.column, sorting.before, sorting.places[c]
    n, chunks = before.size, sorting.places.shape[0]
    for k in range(c * n // chunks, (c + 1) * n // chunks):
        places[column[before[k]]] += 1


@chunk_task
def order_of_chunk(sorting, c):
    """Bring chunk c's particles to their columns, in the former order."""
    never_inline()
    order, column, before, places = sorting.pairs.order, sorting.pairs.column, sorting.before, sorting.places[c]
    n, chunks = before.size, sorting.places.shape[0]
    for k in range(c * n // chunks, (c + 1) * n // chunks):
        i = before[k]
        at = places[column[i]]
        order[at] = i
        places[column[i]] = at + 1


@chunk_task
def clusters_of_chunk(sorting, c):
    """Sort the particles of chunk c's columns by z, and make their clusters."""
    never_inline()
    pairs, order, ends, low, extent = sorting.pairs, sorting.pairs.order, sorting.ends, sorting.low, sorting.extent
    far = low + 2.0 * extent + FAR * pairs.cutoff  # further than any particle minus an edge
    chunks, all_columns = pairs.force.shape[0], pairs.counts[NX] * pairs.counts[NY]
    from_column, to_column = c * all_columns // chunks, (c + 1) * all_columns // chunks
    longest = 0
    for column in range(from_column, to_column):
        longest = max(longest, ends[column + 1] - ends[column])
    heights = np.empty(longest)
    for column in range(from_column, to_column):
        start, end = ends[column], ends[column + 1]
        for k in range(start, end):
            heights[k - start] = sorting.z[order[k]]
        shell_sort(order[start:end], heights)
        cluster = pairs.column_clusters[column]
        for begin in range(start, end, WIDTH):
            pairs.first[cluster] = begin
            particles = order[begin : min(begin + WIDTH, end)]
            fill_cluster(pairs, sorting.x, sorting.offset, cluster, column, particles, far)
            cluster += 1


@strict
def columns(n, extent):
    """Return the numbers of columns along x and y.

    A column is about as wide as a cluster of eight is high, and there are no more columns than clusters."""
    width = (extent[0] * extent[1] * extent[2] * WIDTH / n) ** (1.0 / 3.0)
    nx, ny = max(1, int(extent[0] / width)), max(1, int(extent[1] / width))
    while nx * ny > n // WIDTH + 1:  # a thin sheet
        nx, ny = (nx + 1) // 2, (ny + 1) // 2
    return nx, ny


@jit
def fill_cluster(pairs, x, offset, cluster, column, particles, far):
    """Assign slots of a cluster to up to eight particles, and pad the cluster."""
    bounds, sorted_x = pairs.bounds, pairs.x
    pairs.filled[cluster], pairs.home[cluster] = particles.size, column
    for lane in range(particles.size):
        pairs.place[particles[lane]] = STRIDE * cluster + lane
    for k in range(3):
        bounds[k, cluster], bounds[k + 3, cluster] = inf, -inf
        for lane in range(WIDTH):
            p = STRIDE * cluster + k * WIDTH + lane
            sorted_x[p] = far[k] + lane * APART * pairs.cutoff  # apart, since lanes of one cluster interact
            if lane < particles.size:
                i = particles[lane]
                here = x[k, i] - offset[k, i]
                sorted_x[p] = here
                pairs.offset[p] = offset[k, i]
                bounds[k, cluster] = min(bounds[k, cluster], here)
                bounds[k + 3, cluster] = max(bounds[k + 3, cluster], here)


@jit
def shell_sort(order, z):
    """Sort particle numbers by their z, then by number (Shell 1959, gaps of Ciura 2001); fast for nearly sorted input.

    ``z`` holds the heights of these particles, and is sorted too."""
    for gap in (1750, 701, 301, 132, 57, 23, 10, 4, 1):
        for k in range(gap, order.size):
            i, height = order[k], z[k]
            at = k
            while at >= gap:
                j, other = order[at - gap], z[at - gap]
                if other < height or (other == height and j < i):
                    break
                order[at], z[at] = j, other
                at -= gap
            order[at], z[at] = i, height

"""The cluster pair list: which particles may be within the cutoff of each other, laid out for SIMD.

Particles are sorted into columns over the x-y plane and by z in each, and padded to clusters of eight. The list holds,
for every particle i, the clusters J (with the periodic shift to apply) that hold a particle within the cutoff plus a
skin: an *outer* list with a wide skin, made from the sorted columns, and an *inner* one pruned from it, which the
forces run over (the scheme of Páll & Hess, Comput. Phys. Commun. 184, 2641, 2013, doi:10.1016/j.cpc.2013.06.003). Every
pair of images stands once: J's image follows i's cluster in the order (column x, column y, cluster), unwrapped across
the periodic edges; the pairs inside a cluster are implied. A list is refreshed when a particle has moved by half its
skin, which is looked at on every force evaluation, and is a function of the positions alone.
"""

from __future__ import annotations

from math import floor, inf
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from kickdrift.box import Box
from kickdrift.forces.chunks import chunk_task, each_chunk
from kickdrift.forces.compiling import jit, never_inline
from kickdrift.forces.kernel import BLOWN_UP, GROW, OK
from kickdrift.forces.simd import WIDTH, aligned, any_lane, lane_max, lane_sum, load, mask_bits, select, splat, store

# slots of `ClusterList.counts`
N_CLUSTERS, NX, NY, BUILT, OUTER_BUILDS, PRUNES, ROOM_NEEDED, JUMPS_ALLOWED = range(8)

STRIDE = 3 * WIDTH  # from a cluster to the next in `x` and `force`
FAR = 1e30  # where the padding lanes sit: outside of every cutoff, with a finite square
OUTER_SKIN, INNER_SKIN = 0.32, 0.08  # of the cutoff
SHIFT_BITS, NO_SHIFT = 5, 13  # 27 shifts, in base 3


class ClusterList(NamedTuple):
    """The list's arrays, all allocated once; n particles, `slots` places in clusters, `chunks` shares of the work.

    Vectors are stored cluster by cluster, eight x, eight y, eight z: a cluster is then three neighbouring cache lines.
    The *place* of a particle is where its x stands; its y and z are WIDTH and 2 WIDTH further on.
    """

    cutoff: float
    inner_skin: float
    outer_skin: float
    edges: NDArray[np.float64]  # (3,), zero where the box is open
    shifts: NDArray[np.float64]  # (3, 32), of which 27 are used
    counts: NDArray[np.int64]
    order: NDArray[np.int64]  # (n,) particles in slot order, padding left out
    column: NDArray[np.int64]  # (n,)
    column_clusters: NDArray[np.int64]  # (columns + 1,) the first cluster of each column
    place: NDArray[np.int64]  # (n,) where a particle stands in `x` and `force`
    offset: NDArray[np.float64]  # (3, n) whole edges taken off its position
    filled: NDArray[np.int64]  # (clusters,) particles in a cluster
    home: NDArray[np.int64]  # (clusters,) its column
    bounds: NDArray[np.float64]  # (6, clusters) lowest x y z, highest x y z
    grid: NDArray[np.float64]  # (4,) width of the columns along x and y, lowest corner
    x: NDArray[np.float64]  # (3 slots,)
    outer_reference: NDArray[np.float64]  # (3 slots,) positions when the list was made
    inner_reference: NDArray[np.float64]
    outer_span: NDArray[np.int64]  # (slots, 2) first and last entry + 1 of particle i
    inner_span: NDArray[np.int64]
    outer: NDArray[np.int32]  # (chunks, room) entries: cluster << 5 | shift
    inner: NDArray[np.int32]
    force: NDArray[np.float64]  # (chunks, 3 slots)
    touched: NDArray[np.bool_]  # (chunks, clusters): where a chunk's forces may not be zero
    made: NDArray[np.int64]  # (chunks,) entries that the last search found


def chunk_count(n: int) -> int:
    """Shares of the work, by the number of particles alone, so that sums have one order whatever the threads."""
    return 1 if n < 256 else 2 if n < 4000 else 4 if n < 20_000 else 8


def cluster_list(n: int, box: Box, cutoff: float, room: int | None = None) -> ClusterList:
    """Empty lists for n particles; ``room`` is the number of entries a chunk can hold."""
    edges = np.array(box.lengths) if box.lengths is not None else np.zeros(3)
    slack = float(edges.min()) - cutoff if box.periodic else inf  # shifts reach one box over, not further
    chunks = chunk_count(n)
    slots = WIDTH * (n // WIDTH + n // WIDTH + 3)  # every column's last cluster may be padded
    clusters = slots // WIDTH
    shifts = aligned((3, 4 * WIDTH))
    shifts[:, :27] = edges[:, None] * (np.indices((3, 3, 3)).reshape(3, 27) - 1)
    room = room or 16 * n // chunks + 64
    return ClusterList(
        cutoff=cutoff,
        inner_skin=min(INNER_SKIN * cutoff, slack / 2),
        outer_skin=min(OUTER_SKIN * cutoff, slack),
        edges=edges,
        shifts=shifts,
        counts=np.zeros(8, np.int64),
        order=np.arange(n, dtype=np.int64),
        column=np.zeros(n, np.int64),
        column_clusters=np.zeros(clusters + 2, np.int64),
        place=np.zeros(n, np.int64),
        offset=np.zeros((3, n)),
        filled=np.zeros(clusters, np.int64),
        home=np.zeros(clusters, np.int64),
        bounds=np.zeros((6, clusters)),
        grid=np.zeros(4),
        x=aligned((3 * slots,), FAR),
        outer_reference=aligned((3 * slots,)),
        inner_reference=aligned((3 * slots,)),
        outer_span=np.zeros((slots, 2), np.int64),
        inner_span=np.zeros((slots, 2), np.int64),
        outer=np.empty((chunks, room), np.int32),
        inner=np.empty((chunks, room), np.int32),
        force=aligned((chunks, 3 * slots)),
        touched=np.zeros((chunks, clusters), np.bool_),
        made=np.zeros(chunks, np.int64),
    )


@jit
def refresh(pairs, x, threads):
    """Bring the list up to date with positions x (3, n): OK, GROW (room for ``counts[ROOM_NEEDED]``) or BLOWN_UP."""
    counts = pairs.counts
    if counts[BUILT]:
        copy_positions(pairs, x)
        inner, total = largest_move(pairs, pairs.inner_reference)
        jumped = (
            inner > (pairs.cutoff + 0.5 * pairs.inner_skin) ** 2
        )  # past the whole range of the force since the last call
        if not np.isfinite(total) or (jumped and not counts[JUMPS_ALLOWED]):
            return BLOWN_UP
        if 4.0 * inner <= pairs.inner_skin**2:
            return OK
        outer, total = largest_move(pairs, pairs.outer_reference)
        if 4.0 * outer <= (pairs.outer_skin - pairs.inner_skin) ** 2:
            prune(pairs, threads)
            return OK
    for k in range(3):
        for i in range(x.shape[1]):
            if not np.isfinite(x[k, i]):
                return BLOWN_UP
    counts[BUILT] = 0
    sort(pairs, x)
    copy_positions(pairs, x)
    search(pairs, threads)
    if counts[ROOM_NEEDED] > pairs.outer.shape[1]:
        return GROW
    prune(pairs, threads)
    counts[BUILT] = 1
    return OK


@jit
def copy_positions(pairs, x):
    """Copy positions to their places."""
    place, offset, sorted_x = pairs.place, pairs.offset, pairs.x
    for i in range(place.size):
        p = place[i]
        sorted_x[p] = x[0, i] - offset[0, i]
        sorted_x[p + WIDTH] = x[1, i] - offset[1, i]
        sorted_x[p + 2 * WIDTH] = x[2, i] - offset[2, i]


@jit
def load_vector(x, cluster):
    """A cluster's eight x, y and z."""
    p = STRIDE * cluster
    return load(x, p), load(x, p + WIDTH), load(x, p + 2 * WIDTH)


@jit
def largest_move(pairs, reference):
    """The largest squared displacement from the reference, and a sum that is not finite where one of them is not."""
    largest = splat(0.0)
    total = splat(0.0)
    for cluster in range(pairs.counts[N_CLUSTERS]):
        x, y, z = load_vector(pairs.x, cluster)
        x0, y0, z0 = load_vector(reference, cluster)
        dx, dy, dz = x - x0, y - y0, z - z0
        d2 = dx * dx + dy * dy + dz * dz
        largest = select(d2 > largest, d2, largest)
        total = total + d2
    return lane_max(largest), lane_sum(total)


@jit
def sort(pairs, x):
    """Columns, order in z (ids break ties), clusters, padding, and each cluster's bounding box."""
    n = pairs.order.size
    order, column, first, offset = pairs.order, pairs.column, pairs.column_clusters, pairs.offset
    low, extent = wrap(pairs, x)
    nx, ny = columns(n, extent)
    pairs.counts[NX], pairs.counts[NY] = nx, ny
    pairs.grid[0], pairs.grid[1], pairs.grid[2], pairs.grid[3] = extent[0] / nx, extent[1] / ny, low[0], low[1]
    fill = np.zeros(nx * ny + 1, np.int64)
    for i in range(n):
        a = int((x[0, i] - offset[0, i] - low[0]) / extent[0] * nx)
        b = int((x[1, i] - offset[1, i] - low[1]) / extent[1] * ny)
        column[i] = min(max(a, 0), nx - 1) * ny + min(max(b, 0), ny - 1)
        fill[column[i] + 1] += 1
    for c in range(nx * ny):
        fill[c + 1] += fill[c]
    before, z = np.empty(n, np.int64), np.empty(n)
    for i in range(n):
        before[i] = order[i]  # nearly sorted already
        z[i] = x[2, i] - offset[2, i]
    for i in before:
        order[fill[column[i]]] = i
        fill[column[i]] += 1
    cluster = start = 0
    for c in range(nx * ny):
        end = fill[c]
        shell_sort(order[start:end], z)
        first[c] = cluster
        for begin in range(start, end, WIDTH):
            fill_cluster(pairs, x, cluster, c, order[begin : min(begin + WIDTH, end)])
            cluster += 1
        start = end
    first[nx * ny] = cluster
    pairs.counts[N_CLUSTERS] = cluster


@jit
def wrap(pairs, x):
    """The whole edges to take off each position; the lowest corner and the extent of what is left."""
    n, offset = x.shape[1], pairs.offset
    low, extent = np.zeros(3), np.zeros(3)
    for k in range(3):
        edge = pairs.edges[k]
        if edge > 0.0:
            extent[k] = edge
            for i in range(n):
                offset[k, i] = floor(x[k, i] / edge) * edge
        else:
            low[k] = high = x[k, 0]
            for i in range(n):
                low[k], high = min(low[k], x[k, i]), max(high, x[k, i])
            extent[k] = max(high - low[k], 1e-3 * pairs.cutoff)
    return low, extent


@jit
def columns(n, extent):
    """Numbers of columns along x and y: about as wide as a cluster of eight is high, and no more than clusters."""
    width = (extent[0] * extent[1] * extent[2] * WIDTH / n) ** (1.0 / 3.0)
    nx, ny = max(1, int(extent[0] / width)), max(1, int(extent[1] / width))
    while nx * ny > n // WIDTH + 1:  # a thin sheet
        nx, ny = (nx + 1) // 2, (ny + 1) // 2
    return nx, ny


@jit
def fill_cluster(pairs, x, cluster, column, particles):
    """Give up to eight particles their slots, and pad."""
    bounds, sorted_x, offset = pairs.bounds, pairs.x, pairs.offset
    pairs.filled[cluster], pairs.home[cluster] = particles.size, column
    for lane in range(particles.size):
        pairs.place[particles[lane]] = STRIDE * cluster + lane
    for k in range(3):
        bounds[k, cluster], bounds[k + 3, cluster] = inf, -inf
        for lane in range(WIDTH):
            p = STRIDE * cluster + k * WIDTH + lane
            sorted_x[p] = FAR
            if lane < particles.size:
                i = particles[lane]
                here = x[k, i] - offset[k, i]
                sorted_x[p] = here
                bounds[k, cluster] = min(bounds[k, cluster], here)
                bounds[k + 3, cluster] = max(bounds[k + 3, cluster], here)


@jit
def shell_sort(order, z):
    """Sort particle numbers by z, then by number (Shell 1959, the gaps of Ciura 2001); quick when nearly sorted."""
    for gap in (1750, 701, 301, 132, 57, 23, 10, 4, 1):
        for k in range(gap, order.size):
            i = order[k]
            at = k
            while at >= gap:
                j = order[at - gap]
                if z[j] < z[i] or (z[j] == z[i] and j < i):
                    break
                order[at] = j
                at -= gap
            order[at] = i


@jit
def search(pairs, threads):
    """Make the outer list from the sorted clusters."""
    each_chunk(pairs, threads, "search_chunk")
    needed = 0
    for made in pairs.made:
        needed = max(needed, made)
    pairs.counts[ROOM_NEEDED] = needed
    pairs.counts[OUTER_BUILDS] += 1
    copy(pairs.x, pairs.outer_reference)


@jit
def prune(pairs, threads):
    """Make the inner list from the outer one."""
    each_chunk(pairs, threads, "prune_chunk")
    pairs.counts[PRUNES] += 1
    copy(pairs.x, pairs.inner_reference)


@jit
def copy(source, target):
    for p in range(source.size):
        target[p] = source[p]


@jit
def chunk_clusters(pairs, c):
    """The clusters whose particles are chunk c's to work on: first, last + 1."""
    chunks, clusters = pairs.force.shape[0], pairs.counts[N_CLUSTERS]
    return c * clusters // chunks, (c + 1) * clusters // chunks


@chunk_task
def search_chunk(pairs, c):
    """Make chunk c's share of the outer list, and count its entries, also where room ran out.

    Particle i lists cluster J where it is within reach of J's bounding box: eight particles are tested at a time.
    """
    never_inline()
    reach2 = (pairs.cutoff + pairs.outer_skin) ** 2
    shifts, filled, span, bounds = pairs.shifts, pairs.filled, pairs.outer_span, pairs.bounds
    entries, room = pairs.outer[c], pairs.outer.shape[1]
    touched = pairs.touched[c]
    for cluster in range(touched.size):
        touched[cluster] = False
    most = min(27 * pairs.counts[N_CLUSTERS], 1 << 20)
    near, particles_near = np.empty(most, np.int32), np.empty(most, np.int64)
    begin, end = chunk_clusters(pairs, c)
    made = 0
    for cluster in range(begin, end):
        touched[cluster] = True
        xi, yi, zi = load_vector(pairs.x, cluster)
        candidates = clusters_near(pairs, cluster, reach2, near)
        kept = 0
        for k in range(candidates):
            other, s = near[k] >> SHIFT_BITS, near[k] & 31
            dx = gap(xi - shifts[0, s], bounds[0, other], bounds[3, other])
            dy = gap(yi - shifts[1, s], bounds[1, other], bounds[4, other])
            dz = gap(zi - shifts[2, s], bounds[2, other], bounds[5, other])
            near[kept] = near[k]
            particles_near[kept] = mask_bits(dx * dx + dy * dy + dz * dz < reach2)
            kept += particles_near[kept] != 0
        for lane in range(filled[cluster]):
            span[WIDTH * cluster + lane, 0] = made
            if made + kept < room:
                for k in range(kept):
                    entries[made] = near[k]  # overwritten unless kept
                    made += (particles_near[k] >> lane) & 1
            else:
                made += kept  # an upper bound is room enough
            span[WIDTH * cluster + lane, 1] = made
        for k in range(kept):
            touched[near[k] >> SHIFT_BITS] = True
    pairs.made[c] = made + 1


@jit
def gap(x, low, high):
    """How far x lies outside of the interval."""
    below, above = low - x, x - high
    far = select(below > above, below, above)
    return select(far > 0.0, far, splat(0.0))


@jit
def clusters_near(pairs, cluster, reach2, near):
    """Fill ``near`` with the entries of the clusters after this one that may be within reach, by column and height."""
    nx, ny = pairs.counts[NX], pairs.counts[NY]
    home, bounds, shifts, column_clusters = pairs.home[cluster], pairs.bounds, pairs.shifts, pairs.column_clusters
    cx, cy = home // ny, home % ny
    periodic = pairs.edges[0] > 0.0
    width_x, width_y, low_x, low_y = pairs.grid
    reach = reach2**0.5
    span_x, span_y = int(reach / width_x) + 1, int(reach / width_y) + 1
    x_to = min(cx + span_x, 2 * nx - 1 if periodic else nx - 1)
    y_from, y_to = max(cy - span_y, -ny if periodic else 0), min(cy + span_y, 2 * ny - 1 if periodic else ny - 1)
    found = 0
    for ux in range(cx, x_to + 1):
        shift_x = ux // nx
        gap_x = max(0.0, low_x + ux * width_x - bounds[3, cluster])
        for uy in range(y_from, y_to + 1):
            if ux == cx and uy < cy:
                continue
            below, above = low_y + uy * width_y - bounds[4, cluster], bounds[1, cluster] - low_y - (uy + 1) * width_y
            gap_y = max(0.0, below, above)
            height2 = 1.000001 * reach2 - gap_x * gap_x - gap_y * gap_y  # a margin for the rounding of column edges
            if height2 < 0.0:
                continue
            lowest, highest = bounds[2, cluster] - height2**0.5, bounds[5, cluster] + height2**0.5
            shift_y = (uy + ny) // ny - 1
            other_home = (ux - shift_x * nx) * ny + uy - shift_y * ny
            same_column = ux == cx and uy == cy
            for shift_z in range(-1 if periodic and not same_column else 0, 2 if periodic else 1):
                s = 9 * (shift_x + 1) + 3 * (shift_y + 1) + shift_z + 1
                here = same_column and shift_z == 0
                for other in range(
                    cluster + 1 if here else column_clusters[other_home], column_clusters[other_home + 1]
                ):
                    if bounds[2, other] + shifts[2, s] > highest:
                        break
                    if bounds[5, other] + shifts[2, s] >= lowest and found < near.size:
                        near[found] = (other << SHIFT_BITS) | s
                        found += 1
    return found


@jit
def shift_particle(x, p, shifts, shifted):
    """The position at place p less each of the shifts: (3, 32), flat. Looking them up costs less than subtracting."""
    for k in range(3):
        here = splat(x[p + k * WIDTH])
        for s in range(0, 4 * WIDTH, WIDTH):
            store(shifted, 4 * WIDTH * k + s, here - load(shifts[k], s))


@chunk_task
def prune_chunk(pairs, c):
    """Keep those of chunk c's outer entries that have a particle within the cutoff and the inner skin."""
    never_inline()
    shifts, filled, outer_span, inner_span = pairs.shifts, pairs.filled, pairs.outer_span, pairs.inner_span
    reach = pairs.cutoff + pairs.inner_skin
    outer, inner = pairs.outer[c], pairs.inner[c]
    x, shifted = pairs.x, np.empty(3 * 4 * WIDTH)
    begin, end = chunk_clusters(pairs, c)
    made = 0
    for cluster in range(begin, end):
        for lane in range(filled[cluster]):
            i = WIDTH * cluster + lane
            shift_particle(x, STRIDE * cluster + lane, shifts, shifted)
            inner_span[i, 0] = made
            for k in range(outer_span[i, 0], outer_span[i, 1]):
                entry = outer[k]
                s = entry & 31
                xj, yj, zj = load_vector(x, entry >> SHIFT_BITS)
                xi, yi, zi = splat(shifted[s]), splat(shifted[s + 32]), splat(shifted[s + 64])
                dx, dy, dz = xi - xj, yi - yj, zi - zj
                inner[made] = entry  # overwritten unless kept
                made += any_lane(dx * dx + dy * dy + dz * dz < reach * reach)
            inner_span[i, 1] = made

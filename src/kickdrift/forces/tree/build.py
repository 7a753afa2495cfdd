"""The tree: particles in clusters of eight, halved recursively across the longest edge, and the moments of each part.

Barnes and Hut's octree cuts cubes. Here the box of a node's own particles is cut in the middle of its longest edge, at
the nearest whole number of clusters (a k-d tree, Bentley 1975, doi:10.1145/361002.361007). So every cluster is full and
no SIMD lane idles. Distant star clusters, a plane or many particles in one place need no deeper tree, whereas an
octree's keys run out of bits.

A node with c clusters has 2 c - 1 nodes in its tree: itself, then the nodes of its first part, then those of its
second. Node k's parts are k + 1 and k + 2 (clusters of the first), and the next node after its tree is k + 2 c - 1. So
there are no pointers, and the walk needs no stack. Each evaluation builds the tree again from the particles in the
order of their ids, so the tree depends only on the present positions.
"""

import math

from kickdrift.forces.tree.cut import cut_together, divide
from kickdrift.jit.compile import as_written, is_finite, jit, never_inline
from kickdrift.jit.lanes.functions import lane_max, lane_sum, splat
from kickdrift.jit.lanes.masks import select
from kickdrift.jit.lanes.memory import load
from kickdrift.jit.lanes.vectors import WIDTH
from kickdrift.jit.threads.chunks import chunk_task, each_chunk

# Columns of a node. The columns for the walk fill one cache line: G M, centre of mass, radius about it, bound, first
# cluster, the next node after its tree. The moments fill another.
GM, CX, CY, CZ, RADIUS, BOUND, FIRST, BEYOND, XX, XY, XZ, YY, YZ, ZZ, TRACE, COLUMNS = range(16)
TASKS, GROUPS = 0, 1  # slots of `counts`
CHUNKS = 64  # shares of the work; tasks and blocks of groups are assigned to them in turn
MANY, PARTS = 4096, 16  # all chunks together cut nodes of over a PARTS-th of so many clusters or more


@jit
def build(force, x):
    """Cut the particles at x (3, n) into tasks, parts of a CHUNKS-th, and list the nodes above the tasks.

    Returns whether the positions are finite.
    """
    n, rows, span = x.shape[1], force.rows, force.span
    for i in range(n):
        for k in range(3):
            if not is_finite(x[k, i]):
                return False
            rows[i, k] = x[k, i]
        rows[i, 3] = i
    clusters = force.gm.size // WIDTH
    span[0, 0], span[0, 1] = 0, clusters
    k = parts = 0
    while k < 2 * clusters - 1:
        count = span[k, 1] - span[k, 0]
        if clusters >= MANY and count * PARTS > clusters:
            cut_together(force, k)
            k += 1
        else:
            force.tasks[parts] = k
            parts += 1
            k += 2 * count - 1
    force.counts[TASKS] = parts
    each_chunk(force, force.chunks, "cuts")
    k = tasks = upper = 0
    while k < 2 * clusters - 1:
        if is_task(force, k):
            force.tasks[tasks] = k
            tasks += 1
            k += 2 * (span[k, 1] - span[k, 0]) - 1
        else:
            force.groups[upper] = k
            upper += 1
            k += 1
    force.counts[TASKS], force.counts[GROUPS] = tasks, upper
    return True


@jit
def is_task(force, node):
    """Tell whether a node is small enough to be a task."""
    count = force.span[node, 1] - force.span[node, 0]
    return count * CHUNKS <= force.gm.size // WIDTH or count == 1


@chunk_task
def cuts(force, c):
    """Cut some of the parts into tasks."""
    never_inline()
    for part in range(c, force.counts[TASKS], CHUNKS):
        root = force.tasks[part]
        k, end = root, root + 2 * (force.span[root, 1] - force.span[root, 0]) - 1
        while k < end:
            if is_task(force, k):
                k += 2 * (force.span[k, 1] - force.span[k, 0]) - 1
            else:
                halve(force, k)
                k += 1


@chunk_task
def subtrees(force, c):
    """Build everything below some of the tasks: order, places, moments."""
    never_inline()
    for task in range(c, force.counts[TASKS], CHUNKS):
        root = force.tasks[task]
        first, last = force.span[root, 0], force.span[root, 1]
        for k in range(root, root + 2 * (last - first) - 1):
            if force.span[k, 1] - force.span[k, 0] > 1:
                halve(force, k)
        place(force, WIDTH * first, WIDTH * last)
        for k in range(root, root + 2 * (last - first) - 1):
            moments(force, k)


@chunk_task
def upper_moments(force, c):
    """Compute the moments of some of the nodes above the tasks."""
    never_inline()
    for k in range(c, force.counts[GROUPS], CHUNKS):
        moments(force, force.groups[k])


@jit
def find_groups(force, most):
    """Find the groups: the largest nodes of at most ``most`` clusters."""
    k = groups = 0
    while k < 2 * (force.gm.size // WIDTH) - 1:
        count = force.span[k, 1] - force.span[k, 0]
        if count <= most:
            force.groups[groups] = k
            groups += 1
            k += 2 * count - 1
        else:
            k += 1
    force.counts[GROUPS] = groups


@jit
def halve(force, node):
    """Cut a node's particles in the middle of the longest edge of their box, to the nearest whole cluster."""
    rows, span = force.rows, force.span
    first, last = span[node, 0], span[node, 1]
    begin, end = WIDTH * first, min(WIDTH * last, rows.shape[0])
    longest, axis, centre = -1.0, 0, 0.0
    for k in range(3):
        low = high = rows[begin, k]
        for i in range(begin + 1, end):
            low, high = min(low, rows[i, k]), max(high, rows[i, k])
        if high - low > longest:
            longest, axis, centre = high - low, k, low + 0.5 * (high - low)
    after, before = partition(rows, begin, end - 1, axis, centre)
    cut = min(max(first + (after - begin + WIDTH // 2) // WIDTH, first + 1), last - 1)
    if WIDTH * cut <= before:
        part(rows, begin, before, WIDTH * cut, axis)
    elif WIDTH * cut >= after:
        part(rows, after, end - 1, WIDTH * cut, axis)
    divide(span, node, cut)


@jit
def partition(rows, low, high, axis, pivot):
    """Partition rows low to high: up to the second returned number none is larger than the pivot, and from the first
    returned number on none is smaller (Hoare 1961, doi:10.1145/366622.366642)."""
    i, j = low, high
    while i <= j:
        while i <= high and rows[i, axis] < pivot:
            i += 1
        while j >= low and rows[j, axis] > pivot:
            j -= 1
        if i <= j:
            for k in range(4):
                rows[i, k], rows[j, k] = rows[j, k], rows[i, k]
            i += 1
            j -= 1
    return i, j


@jit
def part(rows, low, high, middle, axis):
    """Reorder rows low to high: before ``middle`` none is larger than the row at ``middle``, and after it none is
    smaller."""
    while low < high:
        step = (high - low) // 8
        pivot = median(
            median(rows[low, axis], rows[low + step, axis], rows[low + 2 * step, axis]),
            median(rows[low + 3 * step, axis], rows[(low + high) // 2, axis], rows[high - 3 * step, axis]),
            median(rows[high - 2 * step, axis], rows[high - step, axis], rows[high, axis]),
        )
        i, j = partition(rows, low, high, axis, pivot)
        if middle <= j:
            high = j
        elif middle >= i:
            low = i
        else:
            return


@jit
def median(a, b, c):
    """Return the median of three."""
    return max(min(a, b), min(max(a, b), c))


@jit
def place(force, begin, end):
    """Write positions and G m in the tree's order. Slots beyond the last particle have no mass and repeat its
    position."""
    rows, x, y, z = force.rows, force.x[0], force.x[1], force.x[2]
    n = rows.shape[0]
    for s in range(begin, end):
        row = rows[min(s, n - 1)]
        x[s], y[s], z[s] = row[0], row[1], row[2]
        force.gm[s] = force.gm_by_id[int(row[3])] if s < n else 0.0


@as_written
def moments(force, node):
    """Compute mass, centre of mass, and the moments about it: the second, and the third of the absolute distance."""
    x, y, z, gm, out = force.x[0], force.x[1], force.x[2], force.gm, force.nodes[node]
    begin, end = WIDTH * force.span[node, 0], WIDTH * force.span[node, 1]
    zero = splat(0.0)
    total, mx, my, mz = zero, zero, zero, zero
    out[GM], out[FIRST], out[BEYOND] = 0.0, begin // WIDTH, node + 2 * ((end - begin) // WIDTH) - 1
    x0, y0, z0 = x[begin], y[begin], z[begin]  # sums about a near point have smaller rounding errors
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
    # the kernel uses three times the second moments, and 3/2 of their trace
    out[XX], out[XY], out[XZ] = 3.0 * lane_sum(xx), 3.0 * lane_sum(xy), 3.0 * lane_sum(xz)
    out[YY], out[YZ], out[ZZ] = 3.0 * lane_sum(yy), 3.0 * lane_sum(yz), 3.0 * lane_sum(zz)
    out[TRACE] = 0.5 * (out[XX] + out[YY] + out[ZZ])

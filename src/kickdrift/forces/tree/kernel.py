"""Compiled tree force: groups of up to 64 particles walk the tree together, and sum what attracts them eight at a time.

Threads share the groups. Each particle's sum has one order, whatever the number of threads.
"""

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from kickdrift.forces.seam.kernel import BLOWN_UP, OK, kernel
from kickdrift.forces.seam.samples import SUMMED, WITH_SUMS, no_looks, note_look, sums_expected
from kickdrift.forces.tree.build import (
    BEYOND,
    BOUND,
    CHUNKS,
    COLUMNS,
    CX,
    FIRST,
    GM,
    GROUPS,
    RADIUS,
    TRACE,
    XX,
    XY,
    XZ,
    YY,
    YZ,
    ZZ,
    build,
    find_groups,
)
from kickdrift.forces.tree.cut import SHARE_COLUMNS
from kickdrift.jit.compile import as_written, jit, never_inline
from kickdrift.jit.lanes.functions import inverse_sqrt, lane_max, lane_numbers, splat
from kickdrift.jit.lanes.masks import select
from kickdrift.jit.lanes.memory import aligned, load, store
from kickdrift.jit.lanes.vector3 import dot, lane_sums, load3, numbers3, store3, thrice, vector3
from kickdrift.jit.lanes.vectors import WIDTH
from kickdrift.jit.threads.chunks import Chunks, chunk_task, each_chunk, in_chunks
from kickdrift.model.state import Floats


@as_written
def add_nodes(force, potential, first, last, found, count):
    """Add the attraction of nodes: mass M and second moments S about the centre, for the softened U = -G / sqrt(r^2 +
    softening^2).

    With D from the centre and u = 1 / sqrt(D^2 + softening^2), the potential is -G [M u + (3 D.S.D u^5 - tr S u^3) /
    2]. Without softening this is the traceless quadrupole's potential.
    """
    softening2, stride = force.softening2, force.gm.size
    for s in range(WIDTH * first, WIDTH * last, WIDTH):
        x, a = load3(force.x, s, stride), load3(force.a, s, stride)
        phi = splat(0.0)
        for f in range(count):
            row = force.nodes[found[f]]
            d = x - numbers3(row, CX, 1)
            u = inverse_sqrt(dot(d, d) + softening2)
            u2 = u * u
            u3 = u2 * u
            u5 = u2 * u3
            moments_x, moments_y = vector3(row[XX], row[XY], row[XZ]), vector3(row[XY], row[YY], row[YZ])
            moments_z = vector3(row[XZ], row[YZ], row[ZZ])
            moments = vector3(dot(moments_x, d), dot(moments_y, d), dot(moments_z, d))  # 3 S D
            q = dot(moments, d)
            w = u5 * (row[TRACE] - 2.5 * q * u2) - row[GM] * u3
            a = a + (u5 * moments + w * d)
            if potential is not None:
                phi = phi - (row[GM] * u + 0.5 * q * u5 - row[TRACE] / 3.0 * u3)
        store3(force.a, s, stride, a)
        if potential is not None:
            store(potential, s, load(potential, s) + phi)


@as_written
def add_particles(force, potential, first, last, near, count):
    """Add the attraction of the particles of clusters, one by one."""
    softening2, gm, stride, zero = force.softening2, force.gm, force.gm.size, splat(0.0)
    for s in range(WIDTH * first, WIDTH * last, WIDTH):
        x, a = load3(force.x, s, stride), load3(force.a, s, stride)
        phi = zero
        for f in range(count):
            start = WIDTH * near[f]
            for j in range(start, start + WIDTH):
                source = gm[j]
                if source == 0.0:
                    continue
                d = numbers3(force.x, j, stride) - x
                u = inverse_sqrt(dot(d, d) + softening2)
                if start == s:  # all particles but the particle itself
                    u = select(lane_numbers() == float(j - start), zero, u)
                w = source * u
                if potential is not None:
                    phi = phi - w
                a = a + w * u * u * d
        store3(force.a, s, stride, a)
        if potential is not None:
            store(potential, s, load(potential, s) + phi)


GROUP_CLUSTERS = 8  # clusters that walk together, one lane each in the estimate of their acceleration
OPENING_ANGLE = 0.6  # largest radius over distance of a whole node, for the estimate of |a|
BUFFER = 256  # nodes, or clusters, between two sums of their attraction


@as_written
def walk(force, potential, first, last):
    """Find the nodes and particles that attract the clusters from ``first`` to before ``last``, and sum their
    attraction."""
    zero = splat(0.0)
    for s in range(WIDTH * first, WIDTH * last, WIDTH):
        store3(force.a, s, force.gm.size, thrice(zero))
        if potential is not None:
            store(potential, s, zero)
    low, high = bounding_box(force, first, last)
    tolerance = force.tolerance * least_acceleration(force, first, last, low, high)
    nodes = force.nodes
    found, near = np.empty(BUFFER, np.int64), np.empty(BUFFER, np.int64)
    n_found = n_near = 0
    k = 0
    while k < nodes.shape[0]:
        row = nodes[k]
        cluster, beyond = int(row[FIRST]), int(row[BEYOND])
        if row[GM] == 0.0:
            k = beyond
            continue
        d2 = distance2(row, low, high)
        d, radius = math.sqrt(d2), row[RADIUS]
        if d > radius and row[BOUND] <= tolerance * d2 * d * (d - radius) * (d - radius):
            found[n_found] = k
            n_found += 1
            if n_found == BUFFER:
                add_nodes(force, potential, first, last, found, n_found)
                n_found = 0
            k = beyond
            continue
        if beyond == k + 1:
            near[n_near] = cluster
            n_near += 1
            if n_near == BUFFER:
                add_particles(force, potential, first, last, near, n_near)
                n_near = 0
        k += 1
    add_nodes(force, potential, first, last, found, n_found)
    add_particles(force, potential, first, last, near, n_near)


@as_written
def bounding_box(force, first, last):
    """Lowest and highest x, y, z of clusters first to last."""
    low, high = np.empty(3), np.empty(3)
    for k in range(3):
        x = force.x[k]
        least, most = load(x, WIDTH * first), load(x, WIDTH * first)
        for s in range(WIDTH * first + WIDTH, WIDTH * last, WIDTH):
            here = load(x, s)
            least, most = select(here < least, here, least), select(here > most, here, most)
        low[k], high[k] = -lane_max(-least), lane_max(most)
    return low, high


@as_written
def distance2(row, low, high):
    """Squared distance from a node's centre of mass to the nearest point of a box."""
    total = 0.0
    for k in range(3):
        c = row[CX + k]
        d = max(low[k] - c, c - high[k], 0.0)
        total += d * d
    return total


@as_written
def least_acceleration(force, first, last, low, high):
    """Estimate the smallest |a| in a group from the smooth field of masses at its clusters' centres.

    A near cluster counts as spread over its radius, so no particle near a centre makes the estimate too large.
    """
    nodes, softening2 = force.nodes, force.softening2
    centre = np.empty((3, WIDTH))
    for lane in range(WIDTH):
        s = WIDTH * min(first + lane, last - 1)
        store3(centre, lane, WIDTH, 1.0 / WIDTH * lane_sums(load3(force.x, s, force.gm.size)))
    x, zero = load3(centre, 0, WIDTH), splat(0.0)
    a = thrice(zero)
    k = 0
    while k < nodes.shape[0]:
        row = nodes[k]
        cluster, beyond = int(row[FIRST]), int(row[BEYOND])
        if row[GM] == 0.0:
            k = beyond
            continue
        alone = beyond == k + 1
        radius = row[RADIUS]
        if alone or radius * radius < OPENING_ANGLE * OPENING_ANGLE * distance2(row, low, high):
            d = numbers3(row, CX, 1) - x
            spread = radius * radius + softening2 if alone else softening2
            inverse = inverse_sqrt(dot(d, d) + spread)
            w = row[GM] * inverse * inverse * inverse
            if alone and first <= cluster < last:
                w = select(lane_numbers() == float(cluster - first), zero, w)
                w = select(lane_numbers() >= float(last - first), zero, w)
            a = a + w * d
            k = beyond
        else:
            k += 1
    size2 = select(lane_numbers() < float(last - first), -dot(a, a), splat(-math.inf))
    return math.sqrt(-lane_max(size2))


# A node counts as a whole if its bound is below SHARE accuracy^POWER |a|. The bounds b of many nodes of random sign add
# up to b times the root of their number, b^-3/5 (a volume, and b goes as its edge to the fifth), so to b^7/10. SHARE is
# measured, so that 99 % of the particles are within the accuracy (kickdrift_validation.barnes_hut).
SHARE, POWER = 16.0, 10 / 7


class TreeKernel(NamedTuple):
    """Gravity tree bound to a System. ``slots`` are places in full clusters of eight."""

    softening2: float
    tolerance: float
    gm_by_id: NDArray[np.float64]  # (n,) G m
    masses: NDArray[np.float64]  # (n,) coherent
    rows: NDArray[np.float64]  # (n, 4) x, y, z and id, sorted
    spare: NDArray[np.float64]  # (n, 4) the rows while they move; later the accelerations in the order of ids
    x: NDArray[np.float64]  # (3, slots) in the tree's order, as are all later arrays
    gm: NDArray[np.float64]  # (slots,)
    a: NDArray[np.float64]  # (3, slots)
    potential: NDArray[np.float64]  # (slots,)
    span: NDArray[np.int64]  # (nodes, 2) first cluster and last + 1
    nodes: NDArray[np.float64]  # (nodes, COLUMNS)
    tasks: NDArray[np.int64]  # nodes whose trees are built separately
    groups: NDArray[np.int64]  # nodes above the tasks; later nodes that walk together
    counts: NDArray[np.int64]  # numbers of tasks and groups
    cut: NDArray[np.float64]  # the cut of a large node: see `cut`
    shares: NDArray[np.float64]  # (CHUNKS, SHARE_COLUMNS) what each chunk finds there
    wanted: NDArray[np.bool_]  # (n,) by id, whose accelerations are wanted; (0,) for all
    looks: NDArray[np.int64]  # (4,) what is known of samples; see `forces.seam.samples`
    chunks: Chunks


def bind(gm_by_id: Floats, masses: Floats, softening: float, accuracy: float, threads: int) -> TreeKernel:
    """Parts for bodies with these G m (n,) and coherent masses (n,), on this number of threads."""
    n = len(gm_by_id)
    clusters = -(-n // WIDTH)
    slots, nodes = WIDTH * clusters, 2 * clusters - 1
    return TreeKernel(
        softening2=softening**2,
        tolerance=SHARE * accuracy**POWER,
        gm_by_id=gm_by_id,
        masses=masses,
        rows=aligned((n, 4), fill=None),
        spare=aligned((n, 4), fill=None),
        x=aligned((3, slots)),
        gm=aligned((slots,)),
        a=aligned((3, slots)),
        potential=aligned((slots,)),
        span=np.zeros((nodes, 2), np.int64),
        nodes=aligned((nodes, COLUMNS)),
        tasks=np.zeros(clusters, np.int64),
        groups=np.zeros(clusters, np.int64),
        counts=np.zeros(2, np.int64),
        cut=np.zeros(5),
        shares=aligned((CHUNKS, SHARE_COLUMNS)),
        wanted=np.zeros(0, np.bool_),
        looks=no_looks(),
        chunks=in_chunks(CHUNKS, threads),
    )


@kernel(TreeKernel)
def tree_forces(force, t, x, v, a, sums):
    if (sums is None or not is_summed(force, x)) and not sum_all(force, sums is not None, x):
        return BLOWN_UP
    if sums is not None:
        note_look(force.looks)
        add_sums(force, sums)
    for k in range(3):
        for i in range(x.shape[1]):
            a[k, i] += force.spare[i, k]
    return OK


@jit
def sum_all(force, wanted, x):
    """Sum the accelerations at x, and the potential where a sample comes. Return whether x is finite."""
    force.looks[SUMMED] = 0
    if not build(force, x):
        return False
    each_chunk(force, force.chunks, "subtrees")
    each_chunk(force, force.chunks, "upper_moments")
    find_groups(force, GROUP_CLUSTERS)
    if sums_expected(force.looks, wanted):
        each_chunk(force, force.chunks, "group_accelerations_and_sums")
    else:
        each_chunk(force, force.chunks, "group_accelerations")
    each_chunk(force, force.chunks, "in_order_of_ids")
    force.looks[SUMMED] = force.looks[WITH_SUMS]
    return True


@jit
def is_summed(force, x):
    """Tell whether the last evaluation has the potential at the positions x (3, n)."""
    rows, same = force.rows, force.looks[SUMMED] != 0
    for s in range(rows.shape[0]):
        i = int(rows[s, 3])
        for k in range(3):
            same = same and x[k, i] == rows[s, k]
    return same


@chunk_task
def in_order_of_ids(force, c):
    """Write some of the accelerations in the order of the particles' ids."""
    never_inline()
    n = force.rows.shape[0]
    for s in range(n * c // CHUNKS, n * (c + 1) // CHUNKS):
        i = int(force.rows[s, 3])
        for k in range(3):
            force.spare[i, k] = force.a[k, s]


@as_written
def add_sums(force, sums):
    """Add potential energy, virial and pairs. The virial is the sum of m x . a over particles, with x from the centre
    of mass. This equals the sum of r . F over pairs as far as the two forces of a pair are opposite."""
    n, root = force.rows.shape[0], force.nodes[0]
    energy = virial = 0.0
    massless = 0
    for s in range(n):
        m = force.masses[int(force.rows[s, 3])]
        if m == 0.0:
            massless += 1
        energy += 0.5 * m * force.potential[s]
        for k in range(3):
            virial += m * (force.x[k, s] - root[CX + k]) * force.a[k, s]
    if root[GM] > 0.0:
        sums[0] += energy
        sums[1] += virial
    sums[2] += 0.5 * (n * (n - 1) - massless * (massless - 1))


@chunk_task
def group_accelerations(force, c):
    """Compute the accelerations of some of the groups."""
    never_inline()
    walk_some(force, None, c)


@chunk_task
def group_accelerations_and_sums(force, c):
    """Compute the same, and the potential at each particle."""
    never_inline()
    walk_some(force, force.potential, c)


@as_written
def walk_some(force, potential, c):
    """Walk every CHUNKS-th block of groups from c on. Neighbours walk one after the other, over nodes still in the
    cache."""
    count = force.counts[GROUPS]
    block = 1 + count // (8 * CHUNKS)
    for begin in range(c * block, count, CHUNKS * block):
        for g in range(begin, min(begin + block, count)):
            first, last = wanted_clusters(force, force.groups[g])
            if first < last:
                walk(force, potential, first, last)


@jit
def wanted_clusters(force, group):
    """Return the first cluster of a group with a particle that is wanted, and the last one plus 1."""
    first, last = force.span[group, 0], force.span[group, 1]
    if force.wanted.size == 0:
        return first, last
    while first < last and not is_wanted(force, first):
        first += 1
    while first < last and not is_wanted(force, last - 1):
        last -= 1
    return first, last


@jit
def is_wanted(force, cluster):
    """Tell whether the acceleration of a particle in a cluster is wanted."""
    for s in range(WIDTH * cluster, min(WIDTH * cluster + WIDTH, force.rows.shape[0])):
        if force.wanted[int(force.rows[s, 3])]:
            return True
    return False

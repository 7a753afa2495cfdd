"""Compiled tree force: groups of up to 64 particles walk the tree together and sum the attraction of nodes and
particles eight at a time.

Threads share the groups. Each particle's sum has one order, whatever the number of threads.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from kickdrift.forces.seam.kernel import BLOWN_UP, OK, kernel
from kickdrift.forces.tree.build import (
    CHUNKS,
    COLUMNS,
    CX,
    GM,
    GROUPS,
    build,
    find_groups,
)
from kickdrift.forces.tree.cut import SHARE_COLUMNS
from kickdrift.forces.tree.walk import GROUP_CLUSTERS, walk
from kickdrift.jit.compile import as_written, never_inline
from kickdrift.jit.lanes.memory import aligned
from kickdrift.jit.lanes.vectors import WIDTH
from kickdrift.jit.threads.chunks import Chunks, chunk_task, each_chunk, in_chunks
from kickdrift.model.state import Floats

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
        chunks=in_chunks(CHUNKS, threads),
    )


@kernel(TreeKernel)
def tree_forces(force, t, x, v, a, sums):
    if not build(force, x):
        return BLOWN_UP
    each_chunk(force, force.chunks, "subtrees")
    each_chunk(force, force.chunks, "upper_moments")
    find_groups(force, GROUP_CLUSTERS)
    if sums is None:
        each_chunk(force, force.chunks, "group_accelerations")
    else:
        each_chunk(force, force.chunks, "group_accelerations_and_sums")
        add_sums(force, sums)
    each_chunk(force, force.chunks, "in_order_of_ids")
    for k in range(3):
        for i in range(x.shape[1]):
            a[k, i] += force.spare[i, k]
    return OK


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
            walk(force, potential, force.groups[g])

"""Forces in the clusters of all chunks, summed in one order and added to the particles' accelerations."""

from typing import Any, NamedTuple

from numba import types

from kickdrift.forces.lists.clusters import LANES, N_CLUSTERS, chunk_clusters, load_vector, store_vector, unsigned
from kickdrift.jit.compile import as_written, inlined, jit, never_inline
from kickdrift.jit.handle import handle
from kickdrift.jit.inner import by_type
from kickdrift.jit.lanes.functions import lane_sum, splat
from kickdrift.jit.threads.chunks import chunk_task, each_chunk

FEW = 2  # chunks whose forces the second cache holds


class Collecting(NamedTuple):
    """What sums the forces of all chunks."""

    pairs: Any  # a handle of a ClusterList
    chunks: Any


class Gathering(NamedTuple):
    """What adds the forces in the clusters to the accelerations of the particles."""

    pairs: Any  # a handle of a ClusterList
    chunks: Any
    inverse_masses: Any
    a: Any  # (3, n)
    mean: Any  # None, or in mixed precision the mean acceleration, which is subtracted


@jit
def add_accelerations(force, a):
    """Sum the chunks' forces in one order, and add the accelerations to ``a``.

    In mixed precision the mean acceleration from all forces is zero but for rounding. It is subtracted, to conserve
    momentum as in float64."""
    add_collected(force, collected_mean(force.mixed, force.pairs, force.chunks), a)


@by_type
def collected_mean(mixed, pairs, chunks):
    """Return None; in mixed precision, sum the chunks' forces and return the mean acceleration."""
    if isinstance(mixed, types.NoneType):
        return lambda mixed, pairs, chunks: None

    def mean(mixed, pairs, chunks):
        collect(pairs, chunks)
        return mean_acceleration(mixed, pairs)

    return mean


@by_type
def no_mean_yet(mixed):
    """Return None; in mixed precision, a mean acceleration of zero."""
    return (lambda mixed: None) if isinstance(mixed, types.NoneType) else lambda mixed: (0.0, 0.0, 0.0)


@jit
def add_collected(force, mean, a):
    """Add the accelerations to ``a``; ``mean`` is from `collected_mean`."""
    if mean is None:
        collect(force.pairs, force.chunks)
    each_chunk(
        handle(Gathering(force.pairs, force.chunks, force.inverse_masses, a, mean)), force.chunks, "gather_chunk"
    )


@jit
def collect(pairs, chunks):
    """Sum all chunks' forces in the first chunk's array, unless chunks that ran in turn have done so."""
    if not in_turn(chunks):
        each_chunk(handle(Collecting(pairs, chunks)), chunks, "collect_chunk")


@jit
def mean_acceleration(mixed, pairs):
    """Return the mean acceleration from all forces; ``mixed`` is the total mass."""
    fx, fy, fz = splat(0.0), splat(0.0), splat(0.0)
    for cluster in range(pairs.counts[N_CLUSTERS]):
        gx, gy, gz = load_vector(pairs.force[0], cluster)
        fx, fy, fz = fx + gx, fy + gy, fz + gz
    return lane_sum(fx) / mixed, lane_sum(fy) / mixed, lane_sum(fz) / mixed


@jit
def in_turn(chunks):
    """Return whether the chunks run one after another, so that they can add to the totals."""
    return chunks.team == 0 and chunks.number > FEW


@jit
def thread_memory(numbers, pairs, c, thread):
    """Return a part of this thread's row of ``numbers`` (threads, twice the numbers in all clusters), as memory for the
    clusters of chunk c.

    The chunk's own clusters lie in the middle of the row, and earlier clusters before them. So all chunks of a thread
    use the same memory, which stays in the cache."""
    begin, _ = chunk_clusters(pairs, c)
    size = numbers.shape[1] // 2
    first = size - size // pairs.filled.size * begin
    return numbers[thread][first : first + size]


@jit
def force_memory(pairs, chunks, c, thread):
    """Return the memory in which this thread sums the forces of chunk c's pairs. Few chunks need none of the thread's
    memory, since their own arrays fit the cache."""
    return pairs.force[c] if chunks.number <= FEW else thread_memory(pairs.thread_force, pairs, c, thread)


@jit
def hand_over(pairs, chunks, forces, cluster, c):
    """Add the forces on a cluster from chunk c to the totals, if chunks run in turn, or copy the forces to the chunk's
    own array."""
    if in_turn(chunks):
        add_to_total(pairs, forces, cluster, c)
    elif chunks.number > FEW:
        gx, gy, gz = load_vector(forces, cluster)
        store_vector(pairs.force[c], cluster, gx, gy, gz)


@jit
def add_to_total(pairs, forces, cluster, c):
    """Add the forces on a cluster from chunk c, whose turn it is, to the totals in the first chunk's array: the sums of
    `collect_chunk`, in its order."""
    fx, fy, fz = splat(0.0), splat(0.0), splat(0.0)
    for before in range(c):
        if pairs.touched[before, cluster]:
            fx, fy, fz = load_vector(pairs.force[0], cluster)
            break
    gx, gy, gz = load_vector(forces, cluster)
    store_vector(pairs.force[0], cluster, fx + gx, fy + gy, fz + gz)


@chunk_task
def collect_chunk(collecting, own):
    """Sum all chunks' forces on the clusters of one chunk in the first chunk's array."""
    never_inline()
    pairs = collecting.pairs
    begin, end = chunk_clusters(pairs, own)
    for cluster in range(begin, end):
        fx, fy, fz = summed(pairs, collecting.chunks.number, cluster)
        store_vector(pairs.force[0], cluster, fx, fy, fz)


@as_written
def summed(pairs, number, cluster):
    """Return the sum of all chunks' forces on a cluster, in one order."""
    fx, fy, fz = splat(0.0), splat(0.0), splat(0.0)
    for c in range(number):
        if pairs.touched[c, cluster]:
            gx, gy, gz = load_vector(pairs.force[c], cluster)
            fx, fy, fz = fx + gx, fy + gy, fz + gz
    return fx, fy, fz


@as_written
def forces_on(pairs, chunks, mean, cluster):
    """Return the forces on a cluster after the sum of the pairs, and after `collected_mean`."""
    if mean is not None or in_turn(chunks):
        return load_vector(pairs.force[0], cluster)
    return summed(pairs, chunks.number, cluster)


@chunk_task
def gather_chunk(gathering, c):
    """Add the accelerations of the particles of chunk c."""
    never_inline()
    n, chunks = gathering.a.shape[1], gathering.chunks.number
    gather(gathering, c * n // chunks, (c + 1) * n // chunks)


@jit
def gather(gathering, begin, end):
    """Add the accelerations of these particles. Their chunks are of equal numbers in the user's order, since arrays of
    particles are written one number after another then."""
    place, total, inverse_masses = gathering.pairs.place, gathering.pairs.force[0], gathering.inverse_masses
    a, mean = gathering.a, gathering.mean
    for i in range(unsigned(begin), unsigned(end)):
        p, w = unsigned(place[i]), inverse_masses[i]
        a[0, i] += less(mean, 0, total[p] * w)
        a[1, i] += less(mean, 1, total[p + LANES] * w)
        a[2, i] += less(mean, 2, total[p + LANES + LANES] * w)


@inlined
def less(mean, k, value):
    """Return the value less a component of the mean, if there is one."""
    return value if mean is None else value - mean[k]

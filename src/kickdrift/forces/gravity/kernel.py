"""Compiled direct sum: each pair of massive bodies once (Newton's third law), eight at a time. Massless particles only
feel the massive ones.

The massive bodies are in clusters of eight. Rotating a cluster's eight bodies against themselves gives its own pairs.
Each body of the cluster also meets all earlier clusters, which take the reaction. So only the last cluster is ever
partly empty, and a last cluster with a single body (Sun and eight planets) wastes nothing. Each chunk has its own array
of accelerations, and these are summed in one order, so threads do not change the bits.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from kickdrift.forces.lists.clusters import STRIDE
from kickdrift.forces.seam.kernel import OK, kernel
from kickdrift.forces.seam.samples import SUMMED, WITH_SUMS, no_looks, note_look, sums_expected
from kickdrift.jit.compile import as_written, jit, never_inline
from kickdrift.jit.lanes.functions import inverse_sqrt, lane_numbers, lane_sum, multiply_add, rotated, splat
from kickdrift.jit.lanes.masks import select
from kickdrift.jit.lanes.memory import aligned, flat, load, masked_load, masked_store, store
from kickdrift.jit.lanes.vector3 import dot, lane_sums, load3, numbers3, plus_dot, rotated3, store3, thrice, vector3
from kickdrift.jit.lanes.vectors import WIDTH
from kickdrift.jit.threads.chunks import Chunks, chunk_task, each_chunk, in_chunks
from kickdrift.model.state import Floats

FAR_AWAY = 1e60  # first position of empty lanes: no distance is zero, and no third power underflows
MOST_IN_REGISTERS = 2 * WIDTH  # most bodies kept in registers, without massless ones


class FewBodies(NamedTuple):
    """Gravity among few bodies."""

    softening2: float
    massive: int
    gm: NDArray[np.float64]  # (MOST_IN_REGISTERS,) G m
    masses: NDArray[np.float64]  # (MOST_IN_REGISTERS,) coherent


@as_written
def few_bodies(force, x, a, sums):
    """Sum all pairs of a few bodies, with x, y and z in rows. The first eight bodies form a ring, each further body
    meets these eight, and the further bodies form a ring. Nothing is stored in between."""
    n, softening2 = force.massive, force.softening2
    total_energy, total_virial = splat(0.0), splat(0.0)
    for first in range(0, max(n - 1, 1), WIDTH):  # a single further body has no ring
        count = min(n - first, WIDTH)
        y, z = masked_load(x, n + first, count), masked_load(x, 2 * n + first, count)
        xi = vector3(lanes_or_out(x, first, count), y, z)
        gm, masses = load(force.gm, first), load(force.masses, first)
        ai, energy, virial = ring(xi, gm, masses, softening2, sums)
        for j in range(first + WIDTH, n):
            d = numbers3(x, j, n) - xi
            r2 = dot(d, d)
            inverse = inverse_sqrt(softening2 + r2)
            cube = inverse * inverse * inverse
            ai = ai + force.gm[j] * cube * d
            if sums is not None:
                gmm = force.gm[j] * masses
                energy, virial = energy - gmm * inverse, virial - gmm * cube * r2
            store3(a, j, n, numbers3(a, j, n) - lane_sums(gm * cube * d))
        for row, acceleration in enumerate((ai.x, ai.y, ai.z)):
            own = row * n + first
            masked_store(a, own, masked_load(a, own, count) + acceleration, count)
        if sums is not None:
            total_energy, total_virial = total_energy + energy, total_virial + virial
    if sums is not None:
        sums[0] += lane_sum(total_energy)
        sums[1] += lane_sum(total_virial)
        sums[2] += 0.5 * n * (n - 1)


@as_written
def lanes_or_out(x, first, count):
    """Load ``count`` values, and fill the other lanes with FAR_AWAY."""
    lanes = lane_numbers()
    return select(lanes < float(count), masked_load(x, first, count), FAR_AWAY * (lanes + 1.0))


@as_written
def ring(xi, gm_i, masses, softening2, sums):
    """Sum the pairs of eight bodies in a ring.

    Each body attracts the next, second and third, which give back the reaction. Opposite bodies compute one half each.
    Missing bodies have no mass and are at FAR_AWAY. Returns accelerations, energy and virial, in lanes.
    """
    zero = splat(0.0)
    energy, virial = zero, zero
    a, reaction = thrice(zero), thrice(zero)
    xj, gm_j = xi, gm_i
    for turn in range(4):
        xj, gm_j, reaction = rotated3(xj, 1), rotated(gm_j, 1), rotated3(reaction, 1)
        d = xj - xi
        inverse = inverse_sqrt(plus_dot(softening2, d, d))
        cube = inverse * inverse * inverse
        a = a + gm_j * cube * d
        if turn < 3:
            w = -gm_i * cube
            reaction = reaction + w * d
        if sums is not None:
            gmm = masses * gm_j if turn < 3 else 0.5 * masses * gm_j
            energy = energy - gmm * inverse
            virial = virial - gmm * cube * dot(d, d)
    return a + rotated3(reaction, 4), energy, virial


PAIRS_PER_CHUNK = 60_000  # some 30 microseconds of work; waking a thread takes a few
MOST_CHUNKS = 32


class GravityKernel(NamedTuple):
    """Direct gravity bound to a System, in clusters of eight slots. The massive bodies come first, and the massless
    particles begin a new cluster. Empty slots have no mass. Vectors are stored as in a ``ClusterList``."""

    softening2: float
    massive: int  # number of massive bodies
    sources: int  # number of their clusters
    clusters: int
    place: NDArray[np.int64]  # (n,) index of each particle's x; y and z are WIDTH and 2 WIDTH behind
    gm: NDArray[np.float64]  # (slots,) G m
    masses: NDArray[np.float64]  # (slots,) coherent
    x: NDArray[np.float64]  # (3 slots,)
    a: NDArray[np.float64]  # (chunks x 3 slots,) each chunk's contribution to the accelerations
    sums: NDArray[np.float64]  # (chunks, 2) energy, virial
    looks: NDArray[np.int64]  # (4,) what is known of samples; see `forces.seam.samples`
    chunks: Chunks

    @property
    def is_few(self) -> bool:
        """Tell whether all bodies have a mass and stay in registers."""
        return len(self.place) == self.massive <= MOST_IN_REGISTERS

    @property
    def few_bodies(self) -> FewBodies:
        """These bodies in the form for registers."""
        room = np.zeros((2, MOST_IN_REGISTERS))
        room[:, : len(self.gm)] = self.gm, self.masses
        return FewBodies(self.softening2, self.massive, room[0], room[1])


def bind(gm_by_id: Floats, masses_by_id: Floats, softening: float, threads: int) -> GravityKernel:
    """Parts for bodies with these G m (n,) and coherent masses (n,), on this number of threads."""
    n, massless = len(gm_by_id), masses_by_id == 0.0
    massive = n - int(np.count_nonzero(massless))
    sources = -(-massive // WIDTH)
    clusters = sources + -(-(n - massive) // WIDTH)
    slot = np.empty(n, np.int64)
    slot[~massless] = np.arange(massive)
    slot[massless] = sources * WIDTH + np.arange(n - massive)
    gm, masses = np.zeros(clusters * WIDTH), np.zeros(clusters * WIDTH)
    gm[slot] = gm_by_id
    masses[slot] = masses_by_id
    chunks = chunks_for(massive, n)
    x = aligned((clusters * STRIDE,))
    for empty in range(massive, sources * WIDTH):
        x[empty // WIDTH * STRIDE + empty % WIDTH] = FAR_AWAY * (1.0 + empty % WIDTH)
    return GravityKernel(
        softening2=softening**2,
        massive=massive,
        sources=sources,
        clusters=clusters,
        place=slot // WIDTH * STRIDE + slot % WIDTH,
        gm=gm,
        masses=masses,
        x=x,
        a=aligned((chunks * clusters * STRIDE,)),
        sums=np.zeros((chunks, 2)),
        looks=no_looks(),
        chunks=in_chunks(chunks, threads),
    )


def chunks_for(massive: int, particles: int) -> int:
    """Number of chunks: a power of two that depends on the sizes alone, so that threads get equal shares."""
    pairs = massive * (particles - massive) + massive * (massive - 1) // 2
    chunks = 1
    while chunks < MOST_CHUNKS and 2 * chunks * PAIRS_PER_CHUNK <= pairs:
        chunks *= 2
    return chunks


@kernel(GravityKernel)
def gravity_forces(force, t, x, v, a, sums):
    place, n = force.place, force.place.size
    x, a = flat(x), flat(a)
    if n <= MOST_IN_REGISTERS and force.massive == n:
        few_bodies(force, x, a, sums)
        return OK
    if sums is None or not is_summed(force, x):
        sum_all(force, sums is not None, x)
    if sums is not None:
        note_look(force.looks)
        for c in range(force.chunks.number):
            sums[0] += force.sums[c, 0]
            sums[1] += force.sums[c, 1]
        massive = force.massive
        sums[2] += 0.5 * massive * (massive - 1) + massive * (n - massive)
    for i in range(n):
        store3(a, i, n, numbers3(a, i, n) + numbers3(force.a, place[i], WIDTH))
    return OK


@jit
def sum_all(force, wanted, x):
    """Sum the accelerations at x, and energy and virial where a sample comes."""
    place, n = force.place, force.place.size
    for i in range(n):
        store3(force.x, place[i], WIDTH, numbers3(x, i, n))
    if sums_expected(force.looks, wanted):
        each_chunk(force, force.chunks, "chunk_accelerations_and_sums")
    else:
        each_chunk(force, force.chunks, "chunk_accelerations")
    collect(force)
    force.looks[SUMMED] = force.looks[WITH_SUMS]


@jit
def is_summed(force, x):
    """Tell whether the last evaluation has energy and virial at the positions x."""
    n, same = force.place.size, force.looks[SUMMED] != 0
    for i in range(n):
        p = force.place[i]
        for k in range(3):
            same = same and x[k * n + i] == force.x[p + k * WIDTH]
    return same


@as_written
def collect(force):
    """Sum the chunks' accelerations into chunk 0's, in one order."""
    a, part = force.a, force.clusters * STRIDE
    for c in range(1, force.chunks.number):
        for p in range(0, part, WIDTH):
            store(a, p, load(a, p) + load(a, c * part + p))


@chunk_task
def chunk_accelerations(force, c):
    """Compute the accelerations from chunk c's pairs."""
    never_inline()
    sum_pairs(force, None, c)


@chunk_task
def chunk_accelerations_and_sums(force, c):
    """Compute the same, with these pairs' energy and virial."""
    never_inline()
    sum_pairs(force, force.sums, c)


@as_written
def sum_pairs(force, sums, c):
    """Sum the pairs of chunk c, which has every 2 ``chunks``-th cluster of massive bodies, counted from c and from 2
    ``chunks`` - 1 - c. A cluster's work grows with its number, so these two series share the work evenly."""
    first, last = c * force.clusters, 2 * force.chunks.number - 1
    zero = splat(0.0)
    for cluster in range(first, first + force.clusters):
        store3(force.a, cluster * STRIDE, WIDTH, thrice(zero))
    energy, virial = zero, zero
    turn = 0
    for cluster in range(force.sources):
        if turn == c or turn == last - c:
            u, w = inside_cluster(force, sums, cluster, first)
            energy, virial = energy + u, virial + w
            if cluster > 0:
                u, w = earlier_clusters(force, sums, cluster, first)
                energy, virial = energy + u, virial + w
        turn = turn + 1 if turn < last else 0
    cluster = force.sources + c
    while cluster < force.clusters:
        massless_accelerations(force, cluster, first)
        cluster += force.chunks.number
    if sums is not None:
        sums[c, 0], sums[c, 1] = lane_sum(energy), lane_sum(virial)


@as_written
def inside_cluster(force, sums, cluster, first):
    """Sum the pairs within a cluster, whose accelerations begin at cluster ``first`` of the array. Returns energy and
    virial, in lanes."""
    gm, masses = load(force.gm, cluster * WIDTH), load(force.masses, cluster * WIDTH)
    a, energy, virial = ring(load3(force.x, cluster * STRIDE, WIDTH), gm, masses, force.softening2, sums)
    store3(force.a, (first + cluster) * STRIDE, WIDTH, a)
    return energy, virial


@as_written
def earlier_clusters(force, sums, cluster, first):
    """Sum the pairs of a cluster's bodies, two at a time, with the bodies of all earlier clusters, which take the
    reaction."""
    x, gm, a, masses = force.x, force.gm, force.a, force.masses
    softening2 = force.softening2
    zero = splat(0.0)
    energy, virial = zero, zero
    for lane in range(0, min(WIDTH, force.massive - cluster * WIDTH), 2):
        i = cluster * WIDTH + lane
        p = cluster * STRIDE + lane
        q = p + 1 if i + 1 < force.massive else p  # a massless slot follows the last body
        xi, xk, gm_i, gm_k = numbers3(x, p, WIDTH), numbers3(x, q, WIDTH), gm[i], gm[i + 1]
        ai, ak = thrice(zero), thrice(zero)
        potential_i, potential_k, virial_i, virial_k = zero, zero, zero, zero  # for unit masses of i and k
        for other in range(cluster):
            xj, gm_j = load3(x, other * STRIDE, WIDTH), load(gm, other * WIDTH)
            there = (first + other) * STRIDE
            aj = load3(a, there, WIDTH)
            d, e = xj - xi, xj - xk
            inverse_i, inverse_k = inverse_sqrt(plus_dot(softening2, d, d)), inverse_sqrt(plus_dot(softening2, e, e))
            cube_i, cube_k = inverse_i * inverse_i * inverse_i, inverse_k * inverse_k * inverse_k
            wi, wk = gm_j * cube_i, gm_j * cube_k
            ai, ak = ai + wi * d, ak + wk * e
            if sums is not None:
                potential_i = multiply_add(gm_j, inverse_i, potential_i)
                potential_k = multiply_add(gm_j, inverse_k, potential_k)
                virial_i, virial_k = multiply_add(wi, dot(d, d), virial_i), multiply_add(wk, dot(e, e), virial_k)
            wi, wk = -gm_i * cube_i, -gm_k * cube_k  # the reaction
            store3(a, there, WIDTH, aj + wi * d + wk * e)
        if sums is not None:
            energy = energy - masses[i] * potential_i - masses[i + 1] * potential_k
            virial = virial - masses[i] * virial_i - masses[i + 1] * virial_k
        p = (first + cluster) * STRIDE + lane
        store3(a, p, WIDTH, numbers3(a, p, WIDTH) + lane_sums(ai))
        store3(a, p + 1, WIDTH, numbers3(a, p + 1, WIDTH) + lane_sums(ak))
    return energy, virial


@as_written
def massless_accelerations(force, cluster, first):
    """Sum the attraction of each massive body on a cluster of massless particles."""
    x, gm, softening2 = force.x, force.gm, force.softening2
    xi, a = load3(x, cluster * STRIDE, WIDTH), thrice(splat(0.0))
    for j in range(force.massive):
        d = numbers3(x, j // WIDTH * STRIDE + j % WIDTH, WIDTH) - xi
        inverse = inverse_sqrt(plus_dot(softening2, d, d))
        a = a + gm[j] * inverse * inverse * inverse * d
    store3(force.a, (first + cluster) * STRIDE, WIDTH, a)

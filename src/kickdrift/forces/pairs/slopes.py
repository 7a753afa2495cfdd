"""The variations of a pair law on its cluster list, along any number of deviations.

A pair at the distance d with the force g d has the variation g w + h (d . w) d, where w is the difference of the two
deviations, and h is twice the derivative of g by r^2. The law's own formula on duals of lanes gives g and h, so they
are exact. They are computed once for up to ``MOST`` deviations. A single deviation takes part in the sweep that sums
the forces (see `variation`).

A truncation that lets the force jump at the cutoff has no derivative there. Pairs on each side of the jump have theirs.
"""

from typing import Any, NamedTuple

import numpy as np
from numba import types
from numpy.typing import NDArray

from kickdrift.forces.lists.clusters import (
    LANES,
    N_CLUSTERS,
    STRIDE,
    chunk_clusters,
    load_vector,
    store_vector,
    table_place,
    unsigned,
)
from kickdrift.forces.lists.pair_rows import (
    displacements,
    fill_table,
    rows_in_one_loop,
    store_row_force,
    working_arrays,
)
from kickdrift.forces.lists.row_lanes import blocks, nothing
from kickdrift.forces.lists.special_pairs import UNSHIFTED, is_inside
from kickdrift.forces.lists.sums import add_accelerations
from kickdrift.forces.pairs.beside_pairs import (
    BesidePairs,
    accelerations_of_own,
    add_by_masses,
    add_own,
    add_particles,
    copy_phase,
    room_beside,
)
from kickdrift.forces.pairs.kernel import PairKernel
from kickdrift.forces.pairs.lanes import pair_slopes
from kickdrift.forces.pairs.sum import sum_pairs
from kickdrift.forces.pairs.upkeep import refresh_force
from kickdrift.forces.pairs.variation import (
    Deviation,
    add_special_slopes,
    broadcast_vector,
    load_vector_like,
    react,
    store_vector_like,
)
from kickdrift.forces.seam.kernel import OK
from kickdrift.forces.seam.samples import SUMMED
from kickdrift.jit.compile import as_written, jit, never_inline
from kickdrift.jit.inner import by_type
from kickdrift.jit.lanes.functions import splat
from kickdrift.jit.lanes.masks import select
from kickdrift.jit.lanes.memory import aligned, entry, flat, load_like, store, sums_of_rows
from kickdrift.jit.lanes.vectors import WIDTH
from kickdrift.jit.threads.chunks import Chunks, chunk_task, each_chunk
from kickdrift.model.state import Floats

MOST = 16  # deviations at once: g and h then take a small part of the time, and the deviations fit the cache
TERMS = 5  # numbers kept of each pair: g, h and the displacement


class PairSlopes(NamedTuple):
    """A pair law on its list, with its variations."""

    force: Any  # PairWork of the particles
    address: int  # of the machine code of this force
    work: int
    phase: NDArray[np.float64]  # (2, 3, n) positions and velocities of the particles
    a: NDArray[np.float64]  # (3, n) accelerations of the particles
    by_masses: NDArray[np.float64]  # (n, k) -dm / m along the deviations; (n, 0) if no mass varies
    number: NDArray[np.int64]  # (1,) deviations at present
    deviations: NDArray[np.float64]  # (MOST, 3 slots) in the places of the list
    slopes: NDArray[np.float64]  # (chunks, MOST, 3 slots)
    chunks: Chunks
    alone: Any  # 1 for a single deviation, else None


class PairSlopesKernel(BesidePairs):
    """A bound pair force with its variations: ``parts`` is a PairSlopes."""


def bind(own: PairKernel, by_masses: Floats, along: int) -> PairSlopesKernel:
    """Bind a pair force of n particles with ``along`` deviations of each; ``by_masses`` is as in `PairSlopes`."""
    work = own.parts
    shape = min(along, MOST), work.pairs.x.size
    number, alone = np.zeros(1, np.int64), 1 if along == 1 else None
    room = number, aligned(shape), aligned((work.chunks.number, *shape)), work.chunks, alone
    return PairSlopesKernel(PairSlopes(*room_beside(own, by_masses), *room), own)


@jit
def add_slopes(force, wanted, t, x, v, a, sums):
    """Add the accelerations of the particles and their deviations. Return a status."""
    status = add_along(force.alone, force, wanted, t, x, v, a, sums)
    if status == OK:
        add_by_masses(force.by_masses, force.a, a)
    return status


PairSlopesKernel.add = add_slopes


@by_type
def add_along(alone, force, wanted, t, x, v, a, sums):
    """Add the accelerations of the particles and their deviations, whose masses are constant. Return a status."""
    if isinstance(alone, types.NoneType):
        return lambda alone, force, wanted, t, x, v, a, sums: add_several(force, wanted, t, x, v, a, sums)
    return lambda alone, force, wanted, t, x, v, a, sums: add_one(force, wanted, t, x, v, a, sums)


@jit
def add_one(force, wanted, t, x, v, a, sums):
    """See `add_along`. The forces and the slopes along a single deviation come from one sweep."""
    own = force.force
    if wanted:
        status = accelerations_of_own(force, wanted, t, x, v, sums)
    else:
        copy_phase(force, x, v)
        status = refresh_force(own, force.phase[0])
    if status != OK:
        return status
    force.number[0] = 1
    place_deviations(force, x, 1, 0)
    own.looks[SUMMED] = 0
    each_chunk(force, force.chunks, "chunk_forces_and_slopes")
    if not wanted:
        add_accelerations(own, force.a)
    add_particles(force, a)
    collect_slopes(force, a, 1, 0)
    return OK


@jit
def add_several(force, wanted, t, x, v, a, sums):
    """See `add_along`."""
    status = add_own(force, wanted, t, x, v, a, sums)
    if status != OK:
        return status
    directions = x.shape[1] // force.a.shape[1] - 1
    for first in range(0, directions, MOST):
        force.number[0] = min(MOST, directions - first)
        place_deviations(force, x, directions, first)
        each_chunk(force, force.chunks, "chunk_slopes")
        collect_slopes(force, a, directions, first)
    return OK


@jit
def place_deviations(force, x, directions, first):
    """Write the deviations from the first on to the places of their particles; padding has none."""
    never_inline()
    place, deviations, n = force.force.pairs.place, force.deviations, force.a.shape[1]
    for q in range(force.number[0]):
        u = deviations[q]
        for cluster in range(force.force.pairs.counts[N_CLUSTERS]):
            store_vector(u, cluster, splat(0.0), splat(0.0), splat(0.0))
        at = n + first + q
        for i in range(n):
            p = unsigned(place[i])
            u[p], u[p + LANES], u[p + LANES + LANES] = x[0, at], x[1, at], x[2, at]
            at += directions


@jit
def collect_slopes(force, a, directions, first):
    """Add the slopes of all chunks, in one order, to the accelerations of the deviations from the first on."""
    never_inline()
    pairs, slopes, n, inverse_masses = force.force.pairs, force.slopes, force.a.shape[1], force.force.inverse_masses
    for q in range(force.number[0]):
        total = force.deviations[q]
        for cluster in range(pairs.counts[N_CLUSTERS]):
            sx, sy, sz = splat(0.0), splat(0.0), splat(0.0)
            for c in range(force.chunks.number):
                if pairs.touched[c, cluster]:
                    gx, gy, gz = load_vector(slopes[c, q], cluster)
                    sx, sy, sz = sx + gx, sy + gy, sz + gz
            store_vector(total, cluster, sx, sy, sz)
        at = n + first + q
        for i in range(n):
            p, w = unsigned(pairs.place[i]), inverse_masses[i]
            a[0, at] += total[p] * w
            a[1, at] += total[p + LANES] * w
            a[2, at] += total[p + LANES + LANES] * w
            at += directions


@chunk_task
def chunk_forces_and_slopes(force, c, thread):
    """Sum the forces of chunk c's pairs and their variations along one deviation into the chunk's own arrays."""
    never_inline()
    own, u, s = force.force, flat(force.deviations), flat(force.slopes[c])
    sum_pairs(own, None, Deviation(u, s, np.empty(WIDTH * STRIDE)), rows_in_one_loop(own.lanes), c, thread)
    laws = own.law, own.at_cutoff, own.truncation, own.tables
    add_special_slopes(own.pairs.special, laws, own.pairs, u, s, 1, c, own.cutoff**2)


@chunk_task
def chunk_slopes(force, c):
    """Sum the variations of chunk c's pairs into the chunk's own array."""
    never_inline()
    sum_slopes(force.force, flat(force.deviations), flat(force.slopes[c]), force.number[0], c)


@as_written
def sum_slopes(force, u, s, number, c):
    pairs = force.pairs
    zero = nothing(force.lanes)
    x, _, _, table, _ = working_arrays(zero, pairs, force.chunks, c, 0)
    rows, start, used, touched = pairs.rows[c], pairs.row_start[c], pairs.used[c], pairs.touched[c]
    clusters, room = pairs.counts[N_CLUSTERS], pairs.x.size // STRIDE
    longest = 0
    for cluster in range(clusters):
        if touched[cluster]:
            for row in range(WIDTH * cluster, WIDTH * cluster + WIDTH):
                longest = max(longest, start[row + 1] - start[row])
            for q in range(number):
                store_vector(s, q * room + cluster, splat(0.0), splat(0.0), splat(0.0))
    parts = blocks(pairs.block)
    others, terms = np.empty(longest + parts, np.int64), np.empty(TERMS * WIDTH * (longest + parts))
    row_sums, lanes = np.empty(number * WIDTH * STRIDE), np.arange(float(WIDTH))
    cutoff2 = force.cutoff**2
    laws = force.law, force.at_cutoff, force.truncation, force.tables
    begin, end = chunk_clusters(pairs, c)
    for cluster in range(clusters):
        if not touched[cluster]:
            continue
        first = WIDTH * cluster
        within = begin <= cluster and cluster < end and not is_inside(pairs.special, cluster)
        if start[first] == start[first + WIDTH] and not within:
            continue
        fill_table(table, pairs, cluster, used[cluster] | 1 << UNSHIFTED, zero)
        for row in range(WIDTH):
            at, listed = start[first + row], start[first + row + 1] - start[first + row]
            count = listed + parts if within else listed  # the row's own cluster comes last
            ux, uy, uz = broadcast_vector(u, STRIDE * cluster + row, zero)
            fx, fy, fz = zero, zero, zero
            for k in range(count):
                if k < listed:
                    other, place = entry(rows, at + k, 0), entry(rows, at + k, 1)
                    after = zero + 1.0
                else:
                    lane = WIDTH // parts * (k - listed)
                    other, place = STRIDE * cluster + lane, table_place(1, UNSHIFTED, row)
                    after = load_like(lanes, lane, zero) - float(row)  # each pair once
                dx, dy, dz = displacements(zero, x, table, other, place)
                r2 = select(after > 0.0, dx * dx + dy * dy + dz * dz, 4.0 * cutoff2)
                g, h = pair_slopes(laws, first + row, other, r2)
                g, h = select(r2 < cutoff2, g, 0.0), select(r2 < cutoff2, h, 0.0)
                gx, gy, gz = react(u, s, other, ux, uy, uz, g, h, dx, dy, dz)
                fx, fy, fz = fx + gx, fy + gy, fz + gz
                if number > 1:
                    others[k], p = other, TERMS * WIDTH * k
                    store(terms, p, g)
                    store(terms, p + WIDTH, h)
                    store_vector_like(terms, p + 2 * WIDTH, dx, dy, dz)
            store_row_force(row_sums, row, fx, fy, fz)
            for q in range(1, number):
                before = STRIDE * room * q
                ux, uy, uz = broadcast_vector(u, before + STRIDE * cluster + row, zero)
                fx, fy, fz = zero, zero, zero
                for k in range(count):
                    p = TERMS * WIDTH * k
                    g, h = load_like(terms, p, zero), load_like(terms, p + WIDTH, zero)
                    dx, dy, dz = load_vector_like(terms, p + 2 * WIDTH, zero)
                    gx, gy, gz = react(u, s, before + others[k], ux, uy, uz, g, h, dx, dy, dz)
                    fx, fy, fz = fx + gx, fy + gy, fz + gz
                store_row_force(row_sums, WIDTH * q + row, fx, fy, fz)
        for q in range(number):
            p, own = WIDTH * STRIDE * q, q * room + cluster
            sx, sy, sz = load_vector(s, own)
            sx, sy = sx + sums_of_rows(row_sums, p, STRIDE), sy + sums_of_rows(row_sums, p + WIDTH, STRIDE)
            store_vector(s, own, sx, sy, sz + sums_of_rows(row_sums, p + 2 * WIDTH, STRIDE))
    add_special_slopes(pairs.special, laws, pairs, u, s, number, c, cutoff2)

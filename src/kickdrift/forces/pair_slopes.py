"""The variations of a pair law on its cluster list, along any number of deviations.

A pair at the distance d with the force g d has the variation g w + h (d . w) d, where w is the difference of the two
deviations, and h is twice the derivative of g by r^2. The law's own formula on duals of lanes gives g and h, so they are
exact. They are computed once for up to ``MOST`` deviations.

A truncation that lets the force jump at the cutoff has no derivative there. Pairs on each side of the jump have theirs.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from kickdrift.forces.beside_pairs import BesidePairs, accelerations_of_own
from kickdrift.forces.clusters import LANES, N_CLUSTERS, STRIDE, chunk_clusters, load_vector, store_vector, unsigned
from kickdrift.forces.kernel import OK
from kickdrift.forces.law_lanes import pair_slopes
from kickdrift.forces.pair_kernel import PairKernel
from kickdrift.forces.pair_rows import displacements, fill_table, slot_of, store_row_force, working_arrays
from kickdrift.forces.pair_slopes_apart import add_apart, add_special_slopes
from kickdrift.forces.row_lanes import nothing
from kickdrift.forces.special_pairs import is_inside
from kickdrift.jit.chunks import Chunks, chunk_task, each_chunk
from kickdrift.jit.compile import as_written, jit, never_inline
from kickdrift.jit.lanes import splat
from kickdrift.jit.masks import select
from kickdrift.jit.memory import aligned, broadcast, entry, flat, load_like, store, sums_of_rows
from kickdrift.jit.vectors import WIDTH
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


class PairSlopesKernel(BesidePairs):
    """A bound pair force with its variations: ``parts`` is a PairSlopes."""


def bind(own: PairKernel, masses: Floats, slopes_of_masses: Floats | None, along: int) -> PairSlopesKernel:
    """Bind a pair force of n particles with ``along`` deviations of each."""
    n, work = len(masses), own.parts
    by_masses = np.zeros((n, 0)) if slopes_of_masses is None else -slopes_of_masses / masses[:, None]
    shape = min(along, MOST), work.pairs.x.size
    parts = PairSlopes(
        work, 0, 0, np.zeros((2, 3, n)), np.zeros((3, n)), np.ascontiguousarray(by_masses), np.zeros(1, np.int64),
        aligned(shape), aligned((work.chunks.number, *shape)), work.chunks,
    )  # fmt: skip
    return PairSlopesKernel(parts, own)


@jit
def add_slopes(force, wanted, t, x, v, a, sums):
    """Add the accelerations of the particles and their deviations. Return a status."""
    status = accelerations_of_own(force, wanted, t, x, v, sums)
    if status != OK:
        return status
    own, n = force.a, force.a.shape[1]
    for k in range(3):
        for i in range(n):
            a[k, i] += own[k, i]
    directions = x.shape[1] // n - 1
    for first in range(0, directions, MOST):
        force.number[0] = min(MOST, directions - first)
        place_deviations(force, x, directions, first)
        each_chunk(force, force.chunks, "chunk_slopes")
        collect_slopes(force, a, directions, first)
    by_masses = force.by_masses
    if by_masses.shape[1] > 0:
        for k in range(3):
            for i in range(n):
                for q in range(directions):
                    a[k, n + i * directions + q] += by_masses[i, q] * own[k, i]
    return OK


PairSlopesKernel.add = add_slopes


@jit
def place_deviations(force, x, directions, first):
    """Write the deviations from the first on to the places of their particles; padding has none."""
    never_inline()
    place, deviations, n = force.force.pairs.place, force.deviations, force.a.shape[1]
    for q in range(force.number[0]):
        deviations[q, :] = 0.0
    for k in range(3):
        for i in range(n):
            p = unsigned(place[i]) + unsigned(k) * LANES
            for q in range(force.number[0]):
                deviations[q, p] = x[k, n + i * directions + first + q]


@jit
def collect_slopes(force, a, directions, first):
    """Add the slopes of all chunks, in one order, to the accelerations of the deviations from the first on."""
    never_inline()
    pairs, slopes, n = force.force.pairs, force.slopes, force.a.shape[1]
    for k in range(3):
        for i in range(n):
            p = unsigned(pairs.place[i]) + unsigned(k) * LANES
            for c in range(force.chunks.number):
                if pairs.touched[c, pairs.place[i] // STRIDE]:
                    for q in range(force.number[0]):
                        a[k, n + i * directions + first + q] += slopes[c, q, p] * force.force.inverse_masses[i]


@chunk_task
def chunk_slopes(force, c):
    """Sum the variations of chunk c's pairs into the chunk's own array."""
    never_inline()
    sum_slopes(force.force, flat(force.deviations), flat(force.slopes[c]), force.number[0], c)


@as_written
def sum_slopes(force, u, s, number, c):
    pairs = force.pairs
    zero = nothing(force.lanes)
    x, _, table = working_arrays(zero, pairs, c)
    rows, start, used, touched = pairs.rows[c], pairs.row_start[c], pairs.used[c], pairs.touched[c]
    clusters, size = pairs.counts[N_CLUSTERS], pairs.x.size
    longest = 0
    for cluster in range(clusters):
        for row in range(WIDTH * cluster, WIDTH * cluster + WIDTH):
            longest = max(longest, start[row + 1] - start[row])
        if touched[cluster]:
            for q in range(number):
                store_vector(s, q * (size // STRIDE) + cluster, splat(0.0), splat(0.0), splat(0.0))
    terms, row_sums = np.empty(TERMS * WIDTH * longest), np.empty(number * WIDTH * STRIDE)
    cutoff2 = force.cutoff**2
    laws = force.law, force.at_cutoff, force.truncation, force.tables
    begin, end = chunk_clusters(pairs, c)
    for cluster in range(clusters):
        first = WIDTH * cluster
        if start[first] < start[first + WIDTH]:
            fill_table(table, pairs, cluster, used[cluster], zero)
            for row in range(WIDTH):
                at, count = start[first + row], start[first + row + 1] - start[first + row]
                for k in range(count):
                    other, place = entry(rows, at + k, 0), entry(rows, at + k, 1)
                    dx, dy, dz = displacements(zero, x, table, other, place)
                    r2 = dx * dx + dy * dy + dz * dz
                    g, h = pair_slopes(laws, first + row, slot_of(other), r2)
                    p = TERMS * WIDTH * k
                    store(terms, p, select(r2 < cutoff2, g, 0.0))
                    store(terms, p + WIDTH, select(r2 < cutoff2, h, 0.0))
                    store(terms, p + 2 * WIDTH, dx)
                    store(terms, p + 3 * WIDTH, dy)
                    store(terms, p + 4 * WIDTH, dz)
                for q in range(number):
                    mine = q * size + STRIDE * cluster + row
                    ux, uy, uz = (
                        broadcast(u, mine, zero),
                        broadcast(u, mine + WIDTH, zero),
                        broadcast(u, mine + 2 * WIDTH, zero),
                    )
                    fx, fy, fz = zero, zero, zero
                    for k in range(count):
                        p, theirs = TERMS * WIDTH * k, q * size + entry(rows, at + k, 0)
                        g, h = load_like(terms, p, zero), load_like(terms, p + WIDTH, zero)
                        dx, dy, dz = (
                            load_like(terms, p + 2 * WIDTH, zero),
                            load_like(terms, p + 3 * WIDTH, zero),
                            load_like(terms, p + 4 * WIDTH, zero),
                        )
                        wx, wy, wz = (
                            ux - load_like(u, theirs, zero),
                            uy - load_like(u, theirs + WIDTH, zero),
                            uz - load_like(u, theirs + 2 * WIDTH, zero),
                        )
                        along = h * (dx * wx + dy * wy + dz * wz)
                        gx, gy, gz = g * wx + along * dx, g * wy + along * dy, g * wz + along * dz
                        fx, fy, fz = fx + gx, fy + gy, fz + gz
                        store(s, theirs, load_like(s, theirs, zero) - gx)
                        store(s, theirs + WIDTH, load_like(s, theirs + WIDTH, zero) - gy)
                        store(s, theirs + 2 * WIDTH, load_like(s, theirs + 2 * WIDTH, zero) - gz)
                    store_row_force(row_sums, WIDTH * q + row, fx, fy, fz)
            for q in range(number):
                p, own = WIDTH * STRIDE * q, q * (size // STRIDE) + cluster
                sx, sy, sz = load_vector(s, own)
                sx, sy = sx + sums_of_rows(row_sums, p, STRIDE), sy + sums_of_rows(row_sums, p + WIDTH, STRIDE)
                store_vector(s, own, sx, sy, sz + sums_of_rows(row_sums, p + 2 * WIDTH, STRIDE))
        if begin <= cluster and cluster < end and not is_inside(pairs.special, cluster):
            add_apart(laws, pairs.x, u, s, number, cluster, cutoff2, 1, 1.0)
            add_apart(laws, pairs.x, u, s, number, cluster, cutoff2, 2, 1.0)
            add_apart(laws, pairs.x, u, s, number, cluster, cutoff2, 3, 1.0)
            add_apart(laws, pairs.x, u, s, number, cluster, cutoff2, 4, 0.5)
    add_special_slopes(pairs.special, laws, pairs, u, s, number, c, cutoff2)

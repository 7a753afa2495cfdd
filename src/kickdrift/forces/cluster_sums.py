"""Forces in the clusters of all chunks, summed in one order and added to the particles' accelerations."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numba import types

from kickdrift.forces.clusters import LANES, STRIDE, chunk_clusters, load_vector, store_vector, unsigned
from kickdrift.jit.chunks import chunk_task, each_chunk
from kickdrift.jit.compile import jit, never_inline
from kickdrift.jit.handle import handle
from kickdrift.jit.inner import overload
from kickdrift.jit.lanes import splat
from kickdrift.jit.vectors import WIDTH


class Gathering(NamedTuple):
    """What adds the forces in the clusters to the accelerations of the particles."""

    pairs: Any  # a handle of a ClusterList
    chunks: Any
    inverse_masses: Any
    a: Any  # (3, n)
    left_over: Any  # None, or in mixed precision the mean acceleration, which is subtracted


def add_accelerations(mixed: Any, force: Any, a: Any) -> None:
    """Sum the chunks' forces in one order, and add the accelerations to ``a``.

    In mixed precision the mean acceleration from all forces is zero but for rounding. It is subtracted, to conserve
    momentum as in float64."""


@overload(add_accelerations)
def _add_accelerations(mixed, force, a):
    if isinstance(mixed, types.NoneType):
        return lambda mixed, force, a: each_chunk(
            handle(Gathering(force.pairs, force.chunks, force.inverse_masses, a, None)), force.chunks, "gather_chunk"
        )

    def less_mean(mixed, force, a):
        pairs, chunks, inverse_masses = force.pairs, force.chunks, force.inverse_masses
        each_chunk(handle(Gathering(pairs, chunks, inverse_masses, a, None)), chunks, "collect_chunk")
        gx = gy = gz = 0.0
        total = pairs.force[0]
        for p in pairs.place:
            gx, gy, gz = gx + total[p], gy + total[p + WIDTH], gz + total[p + 2 * WIDTH]
        mean = gx / mixed, gy / mixed, gz / mixed
        each_chunk(handle(Gathering(pairs, chunks, inverse_masses, a, mean)), chunks, "gather_chunk")

    return less_mean


@chunk_task
def collect_chunk(gathering, c):
    """Sum all chunks' forces on the clusters of chunk c in the first chunk's array."""
    never_inline()
    pairs = gathering.pairs
    begin, end = chunk_clusters(pairs, c)
    for cluster in range(begin, end):
        fx, fy, fz = summed(pairs, gathering.chunks, cluster)
        store_vector(pairs.force[0], cluster, fx, fy, fz)


@chunk_task
def gather_chunk(gathering, c):
    """Add the accelerations of the particles in the clusters of chunk c."""
    never_inline()
    begin, end = chunk_clusters(gathering.pairs, c)
    gather(gathering, begin, end)


@jit
def gather(gathering, begin, end):
    pairs, inverse_masses, a, mean = gathering.pairs, gathering.inverse_masses, gathering.a, gathering.left_over
    order, lanes = pairs.order, np.empty(STRIDE)
    for cluster in range(begin, end):
        fx, fy, fz = total_of(mean, pairs, gathering.chunks, cluster)
        store_vector(lanes, 0, fx, fy, fz)
        first = pairs.first[cluster]
        for lane in range(pairs.filled[cluster]):
            i, p = unsigned(order[first + lane]), unsigned(lane)
            w = inverse_masses[i]
            a[0, i] += less(mean, 0, lanes[p] * w)
            a[1, i] += less(mean, 1, lanes[p + LANES] * w)
            a[2, i] += less(mean, 2, lanes[p + LANES + LANES] * w)


def less(mean: Any, k: int, value: float) -> float:
    """Return the value less a component of the mean, if there is one."""
    raise NotImplementedError("for compiled code")


@overload(less)
def _less(mean, k, value):
    if isinstance(mean, types.NoneType):
        return lambda mean, k, value: value
    return lambda mean, k, value: value - mean[k]


def total_of(mean: Any, pairs: Any, chunks: Any, cluster: int) -> Any:
    """Return the forces on a cluster, which are summed already if their mean is known."""
    raise NotImplementedError("for compiled code")


@overload(total_of)
def _total_of(mean, pairs, chunks, cluster):
    if isinstance(mean, types.NoneType):
        return lambda mean, pairs, chunks, cluster: summed(pairs, chunks, cluster)
    return lambda mean, pairs, chunks, cluster: load_vector(pairs.force[0], cluster)


@jit
def summed(pairs, chunks, cluster):
    """Return the sum of the chunks' forces on a cluster, in one order."""
    force, touched = pairs.force, pairs.touched
    fx, fy, fz = splat(0.0), splat(0.0), splat(0.0)
    for c in range(chunks.number):
        if touched[c, cluster]:
            gx, gy, gz = load_vector(force[c], cluster)
            fx, fy, fz = fx + gx, fy + gy, fz + gz
    return fx, fy, fz

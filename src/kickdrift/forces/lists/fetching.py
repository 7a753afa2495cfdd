"""Cache lines that the pair sum asks for before it needs them.

The pair sum goes through the clusters in the order of memory, and each cluster meets those of the columns around its
own. In a large system the meeting places form several streams, one for each slab of columns within reach: each moves on
by one cluster when the sum does. The processor does not see these streams, since the sum jumps from one to the next.
"""

from __future__ import annotations

from typing import Any, NamedTuple

from kickdrift.forces.lists.clusters import N_CLUSTERS, NX, NY, STRIDE
from kickdrift.forces.lists.pair_rows import ROW
from kickdrift.jit.compile import as_written
from kickdrift.jit.inner import overload
from kickdrift.jit.lanes.memory import fetch_to_read, fetch_to_write
from kickdrift.jit.lanes.vectors import single_type

FEW = 2000  # clusters whose positions and forces the second cache holds
MOST = 4  # slabs on each side
SPARE = 4  # clusters that the streams are ahead of the sum: the time that memory takes to answer


class Streams(NamedTuple):
    """Where the streams are, in clusters."""

    apart: int  # distance from one to the next
    ahead: int  # how far the middle one is ahead of the sum
    sides: int  # number on each side of the middle one; -1 if there are none


@as_written
def streams(pairs):
    """Return the streams of the pair sum."""
    clusters, reach = pairs.counts[N_CLUSTERS], pairs.cutoff + pairs.inner_skin
    apart = clusters // pairs.counts[NX]
    rows = int(reach / pairs.grid[1]) + 1
    sides = -1 if clusters < FEW else min(int(reach / pairs.grid[0]) + 1, MOST)
    ahead = rows * (apart // pairs.counts[NY]) + rows + SPARE
    return Streams(apart, ahead, sides)


@as_written
def fetch_streams(found, pairs, x, reactions, cluster, zero):
    """Ask for the positions and reactions of the clusters at the front of all streams."""
    for side in range(-found.sides, found.sides + 1):
        front = cluster + side * found.apart + found.ahead
        if front >= 0 and front < pairs.counts[N_CLUSTERS]:
            fetch_to_read(x, STRIDE * front, STRIDE)
            fetch_reactions(reactions, front, zero)


def fetch_reactions(reactions: Any, cluster: int, zero: Any) -> None:
    """Ask for the reactions on a cluster, which are four for each particle if rows have tiles."""


@overload(fetch_reactions)
def _fetch_reactions(reactions, cluster, zero):
    size = ROW * STRIDE if zero == single_type else STRIDE
    return lambda reactions, cluster, zero: fetch_to_write(reactions, size * cluster, size)

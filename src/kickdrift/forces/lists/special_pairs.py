"""Pairs that pair forces leave out or scale: bonded neighbours and other exclusions of a Topology.

A pair of clusters with such a pair leaves the rows of the list and becomes an entry of its own, with a factor for each
of its pairs. So the main loop over the rows knows nothing of factors. Without such pairs, ``special`` is None and the
code is as if this module were not there.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from numpy.typing import NDArray

from kickdrift.forces.lists.clusters import SHIFT_BITS, SHIFTS, STRIDE
from kickdrift.jit.compile import inlined, jit
from kickdrift.jit.lanes.vectors import WIDTH

if TYPE_CHECKING:
    from kickdrift.model.molecules.topology import Topology

CODE_BITS = 3
OWN = (1 << CODE_BITS) - 1  # code of a pair that the same entry meets from the other side, or of a particle with itself
UNSHIFTED = SHIFTS // 2
NEXT, OTHER, ROW, CODE = range(4)  # columns of a record


class Special(NamedTuple):
    """Special pairs of n particles, and the entries that hold them. ``room`` is the room of the outer list."""

    start: NDArray[np.int32]  # (n + 1,) partners of particle i: partner[start[i] : start[i + 1]]
    partner: NDArray[np.int32]  # a particle << 3 | code, an index in ``factors``
    slot_start: NDArray[np.int32]  # (slots + 1,) the same for the particle in each slot
    met: NDArray[np.int64]  # a place << 3 | code
    factors: NDArray[np.float64]  # (8,) the first is 1, the last, of `OWN`, is 0
    particle: NDArray[np.int64]  # (slots,) the particle in each slot, -1 for padding
    marks: NDArray[np.int64]  # (chunks, clusters) 1 + index of a record of the present cluster with another; 0 for none
    records: NDArray[np.int64]  # (chunks, most, 4) special pairs of the present cluster: the mark of the next record of
    # the same two clusters, the other cluster, the row, and the code in the other particle's byte
    recorded: NDArray[np.int64]  # (chunks,) number of records
    inside: NDArray[np.bool_]  # (clusters,) whether a cluster has special pairs among its own particles
    number: NDArray[np.int64]  # (chunks,) entries
    entries: NDArray[np.int64]  # (chunks, room + clusters, 3) a cluster, the other << 5 | shift, bits of pairs in reach
    codes: NDArray[np.int64]  # (chunks, room + clusters, 8) for each row, a byte for each of eight pairs


def special_of(topology: Topology | None, n: int, slots: int, chunks: int, room: int) -> Special | None:
    """Return the special pairs of n particles; None if there are none."""
    if topology is None or not len(topology.scaled.pairs):
        return None
    pairs, factors = topology.scaled
    values = np.unique(factors)
    table = np.zeros(WIDTH)
    table[0], table[1 : 1 + len(values)] = 1.0, values  # three factors, and 0 for exclusions
    both = np.concatenate([pairs, pairs[:, ::-1]])
    order = np.lexsort((both[:, 1], both[:, 0]))
    codes = 1 + np.searchsorted(values, np.tile(factors, 2))
    count = np.bincount(both[:, 0], minlength=n)
    clusters = slots // WIDTH
    return Special(
        start=np.concatenate([[0], np.cumsum(count)]).astype(np.int32),
        partner=(both[:, 1] << CODE_BITS | codes)[order].astype(np.int32),
        slot_start=np.zeros(slots + 1, np.int32),
        met=np.zeros(len(both), np.int64),
        factors=table,
        particle=np.full(slots, -1, np.int64),
        marks=np.zeros((chunks, clusters), np.int64),
        records=np.empty((chunks, WIDTH * int(count.max()), 4), np.int64),
        recorded=np.zeros(chunks, np.int64),
        inside=np.zeros(clusters, np.bool_),
        number=np.zeros(chunks, np.int64),
        **rooms(chunks, room + clusters),
    )


def rooms(chunks: int, room: int) -> dict[str, NDArray[np.int64]]:
    """Return empty entries."""
    return {"entries": np.empty((chunks, room, 3), np.int64), "codes": np.empty((chunks, room, WIDTH), np.int64)}


def with_special_room(special: Special | None, room: int) -> Special | None:
    """Return the special pairs with empty entries for an outer list of this room."""
    if special is None:
        return None
    made: Special = special._replace(**rooms(len(special.number), room + len(special.inside)))  # type: ignore[arg-type]
    return made


@jit
def place_special(special, place):
    """After a sort, note the particle of each slot, and the places of its partners in the order of the slots."""
    if special is None:
        return
    special.particle[:] = -1
    for i in range(place.size):
        special.particle[place[i] // STRIDE * WIDTH + place[i] % STRIDE] = i
    made = 0
    for slot in range(special.particle.size):
        special.slot_start[slot] = made
        i = special.particle[slot]
        if i >= 0:
            for k in range(special.start[i], special.start[i + 1]):
                partner = special.partner[k]
                special.met[made] = place[partner >> CODE_BITS] << CODE_BITS | partner & OWN
                made += 1
    special.slot_start[special.particle.size] = made


@inlined
def clear_special(special, c):
    """Empty the entries of chunk c."""
    if special is not None:
        special.number[c] = 0


@jit
def mark_special(special, c, cluster, filled, on):
    """Record the special pairs of this cluster, mark the other clusters, and make the entry of its own pairs; or,
    without ``on``, remove the marks."""
    if special is None:
        return
    marks, records, number = special.marks[c], special.records[c], 0
    if not on:
        for k in range(special.recorded[c]):
            marks[records[k, OTHER]] = 0
        return
    for row in range(filled):
        slot = WIDTH * cluster + row
        for k in range(special.slot_start[slot], special.slot_start[slot + 1]):
            there, code = special.met[k] >> CODE_BITS, special.met[k] & OWN
            other = there // STRIDE
            records[number, NEXT], records[number, OTHER], records[number, ROW] = marks[other], other, row
            records[number, CODE] = code << (WIDTH * (there - STRIDE * other))
            number += 1
            marks[other] = number
    special.recorded[c] = number
    special.inside[cluster] = marks[cluster] > 0
    if marks[cluster] > 0:
        add_entry(special, c, cluster, cluster << SHIFT_BITS | UNSHIFTED, -1, filled)


@jit
def add_entry(special, c, cluster, met, bits, filled):
    """Append the entry of a pair of clusters, with pairs in reach at ``bits``."""
    at, other = special.number[c], met >> SHIFT_BITS
    entry, codes = special.entries[c, at], special.codes[c, at]
    particles = 0
    for lane in range(filled):  # padding meets padding at the same place
        particles |= 255 << (WIDTH * lane)
    entry[0], entry[1], entry[2] = cluster, met, bits & particles
    for lane in range(WIDTH):
        codes[lane] = 0
    mark = special.marks[c, other]
    while mark > 0:
        record = special.records[c, mark - 1]
        codes[record[ROW]] |= record[CODE]
        mark = record[NEXT]
    if other == cluster and met & 31 == UNSHIFTED:
        for lane in range(filled):
            for before in range(lane + 1):
                codes[lane] |= OWN << (WIDTH * before)
    special.number[c] = at + 1


@inlined
def without_special(special, c, cluster, met, bits, filled):
    """Return the bits of pairs within reach for the rows of the list: 0 if the pair of clusters becomes an entry."""
    if special is None:
        return bits
    if bits == 0 or special.marks[c, met >> SHIFT_BITS] == 0:
        return bits
    add_entry(special, c, cluster, met, bits, filled)
    return 0


@inlined
def is_special(special, c, other):
    """Tell whether the present cluster of chunk c is marked to have special pairs with another cluster."""
    return False if special is None else special.marks[c, other] > 0


@inlined
def is_inside(special, cluster):
    """Tell whether a cluster has special pairs among its own particles."""
    return False if special is None else special.inside[cluster]

"""The cluster pair list: pairs of particles that may be within the cutoff, arranged for SIMD.

The list has two levels. The outer list has the clusters near each cluster (`search`). The inner list has rows
of particles (`particle_rows`) or of tiles (`tile_rows`), and is made again from the outer list between two searches.
"""

from __future__ import annotations

from typing import Any

from kickdrift.forces.lists.box_change import PRUNED, SEARCHED, adopt, keep_lengths, least_factor
from kickdrift.forces.lists.clusters import BUILT, JUMPS_ALLOWED, PRUNES, ROOM_NEEDED, chunk_clusters, copy
from kickdrift.forces.lists.load import Loading, keep_positions, move_since
from kickdrift.forces.lists.pair_rows import copy_to_single
from kickdrift.forces.lists.particle_rows import particle_rows
from kickdrift.forces.lists.row_lanes import Tiles
from kickdrift.forces.lists.search import search
from kickdrift.forces.lists.sort import sort
from kickdrift.forces.lists.special_pairs import place_special
from kickdrift.forces.lists.tile_rows import write_tiles
from kickdrift.forces.seam.kernel import BLOWN_UP, GROW, OK
from kickdrift.jit.compile import is_finite, jit, never_inline
from kickdrift.jit.handle import handle
from kickdrift.jit.inner import overload
from kickdrift.jit.lanes.memory import flat
from kickdrift.jit.threads.chunks import chunk_task, each_chunk

OUTWORN = -1  # status of lists that must be made anew


@jit
def refresh(pairs, x, chunks):
    """Update the list for positions x (3, n); return OK, GROW (to ``counts[ROOM_NEEDED]``) or BLOWN_UP."""
    counts = pairs.counts
    adopt(pairs)
    if counts[BUILT]:
        each_chunk(handle(Loading(pairs, x)), chunks, "load_chunk")
        status = outlasts(pairs, chunks)
        if status != OUTWORN:
            return status
    each_chunk(handle(Loading(pairs, x)), chunks, "finite_chunk")
    if not all_finite(pairs):
        return BLOWN_UP
    counts[BUILT] = 0
    sort(pairs, x, chunks)
    place_special(pairs.special, pairs.place)
    search(pairs, chunks)
    if counts[ROOM_NEEDED] > pairs.near.shape[1]:
        return GROW
    each_chunk(handle(Loading(pairs, x)), chunks, "built_at_chunk")
    prune(pairs, chunks)
    counts[BUILT] = 1
    return OK


@chunk_task
def finite_chunk(loading, c):
    """Note in ``moves[c, 1]`` how many of chunk c's coordinates are not finite."""
    never_inline()
    numbers, chunks = flat(loading.x), loading.pairs.moves.shape[0]
    bad = 0
    for p in range(c * numbers.size // chunks, (c + 1) * numbers.size // chunks):
        bad += int(not is_finite(numbers[p]))
    loading.pairs.moves[c, 1] = bad


@jit
def all_finite(pairs):
    """Tell whether no chunk has found a coordinate that is not finite."""
    bad = 0.0
    for c in range(pairs.moves.shape[0]):
        bad += pairs.moves[c, 1]
    return bad == 0.0


@chunk_task
def built_at_chunk(loading, c):
    """Keep the positions of chunk c, of a search, in the order of the particles."""
    never_inline()
    given, kept, chunks = flat(loading.x), flat(loading.pairs.built_at), loading.pairs.moves.shape[0]
    begin, end = c * given.size // chunks, (c + 1) * given.size // chunks
    copy(given[begin:end], kept[begin:end])


@chunk_task
def single_chunk(pairs, c):
    """In mixed precision, copy the positions of chunk c's clusters to float32."""
    never_inline()
    begin, end = chunk_clusters(pairs, c)
    copy_to_single(pairs, begin, end)


@jit
def outlasts(pairs, chunks):
    """Prune the outer list if the noted moves of the particles need it.

    Return OK if all pairs within the cutoff are then in the inner list, OUTWORN if the lists must be made anew, or
    BLOWN_UP."""
    inner, total = move_since(pairs, pairs.inner_reference, PRUNED)
    jumped = (
        inner > (pairs.cutoff + 0.5 * pairs.inner_skin) ** 2
    )  # a particle has passed the whole range of the force since the last call
    if not is_finite(total) or (jumped and not pairs.counts[JUMPS_ALLOWED]):
        return BLOWN_UP
    room = pairs.inner_skin - (1.0 - least_factor(pairs, PRUNED)) * (pairs.cutoff + pairs.inner_skin)
    if room >= 0.0 and 4.0 * inner <= room**2:
        return OK
    each_chunk(pairs, chunks, "outer_move_chunk")
    outer, total = move_since(pairs, pairs.outer_reference, SEARCHED)
    room = pairs.outer_skin - pairs.inner_skin
    room -= (1.0 - least_factor(pairs, SEARCHED)) * (pairs.cutoff + pairs.outer_skin)
    if room >= 0.0 and 4.0 * outer <= room**2:
        prune(pairs, chunks)
        return OK
    return OUTWORN


@jit
def prune(pairs, chunks):
    """Prune the outer list to make the inner list."""
    if pairs.x_single.size:
        each_chunk(pairs, chunks, "single_chunk")
    each_chunk(pairs, chunks, "prune_chunk")
    pairs.counts[PRUNES] += 1
    keep_lengths(pairs, PRUNED)


@chunk_task
def prune_chunk(pairs, c):
    """Make chunk c's rows of the inner list."""
    never_inline()
    make_rows(pairs.block, pairs, c)
    keep_positions(pairs, c, pairs.inner_reference)


def make_rows(block: Any, pairs: Any, c: int) -> None:
    """Make chunk c's rows, of tiles or of particles."""


@overload(make_rows)
def _make_rows(block, pairs, c):
    if block.instance_class is Tiles:
        return lambda block, pairs, c: write_tiles(pairs, c)
    return lambda block, pairs, c: particle_rows(pairs, c)

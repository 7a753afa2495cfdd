"""Pair lists of bound pair forces: their room, skins and checkpoint."""

from __future__ import annotations

from typing import Any

import numpy as np

from kickdrift.errors import InputError
from kickdrift.forces.lists.clusters import (
    BUILT,
    ROOM_NEEDED,
    SHIFTS,
    empty_rows,
    skins,
)
from kickdrift.forces.lists.neighbours import whole_blocks
from kickdrift.forces.lists.special_pairs import with_special_room
from kickdrift.forces.pairs.kernel import PairKernel
from kickdrift.forces.seam.kernel import OK
from kickdrift.jit.lanes.memory import aligned
from kickdrift.jit.lanes.vectors import WIDTH
from kickdrift.model.box.cell import LENGTHS

LONGEST_SCALE = 2.0  # in cutoffs
THIN = 1e-3  # part of the cutoff: a skin for rounding alone


def grown(bound: Any) -> Any:
    """Return the bound force with more room in its list if the last search ran out of room; else unchanged."""
    if not isinstance(bound, PairKernel):
        return bound
    pairs = bound.pairs
    if bound.row_need > bound.row_room:
        return bound.with_row_room(whole_blocks(1.2 * bound.row_need))
    if pairs.counts[ROOM_NEEDED] <= pairs.near.shape[1]:
        return bound
    return with_room(bound, int(1.3 * pairs.counts[ROOM_NEEDED]))


def thinned(bound: Any) -> Any:
    """Return the bound force with a list for one set of positions: its skins suffice for rounding and for the
    differences of a Jacobian."""
    if not isinstance(bound, PairKernel):
        return bound
    pairs = bound.pairs
    skin = min(THIN * pairs.cutoff, pairs.inner_skin)
    return bound.with_list(inner_skin=skin, outer_skin=skin)


def tuned(bound: Any, stride: float) -> Any:
    """Return the bound force with the cheapest skins; ``stride`` is the fastest particle's move between two
    evaluations."""
    if not isinstance(bound, PairKernel):
        return bound
    inner, outer = skins(bound.pairs.bricks, bound.pairs.cutoff, stride, _scale(bound))
    return bound.with_list(inner_skin=inner, outer_skin=outer)


def _scale(bound: PairKernel) -> float:
    """Edge of a cluster of a pair law in a periodic box, up to twice the cutoff; 0 for others. The cost of a list grows
    with the volume around clusters, so a skin in units of a cutoff shorter than a cluster would be too thin."""
    pairs = bound.pairs
    lengths = pairs.live[:LENGTHS]
    if type(bound) is not PairKernel or not lengths.all():
        return 0.0
    edge = float(WIDTH * lengths.prod() / len(pairs.place)) ** (1 / 3)
    return min(edge, LONGEST_SCALE * pairs.cutoff)


def with_room(bound: PairKernel, room: int) -> PairKernel:
    """Return the bound force with empty lists of ``room`` entries in each chunk."""
    pairs = bound.pairs
    chunks = len(pairs.made)
    rows = empty_rows(chunks, room, pairs.per_row, pairs.block)
    special = with_special_room(pairs.special, room)
    return bound.with_list(near=np.empty((chunks, room), np.int32), rows=rows, special=special)


def with_moving_parts(bound: Any) -> Any:
    """Return the bound force with memory for steps in the order of the clusters; see `sorted_steps`."""
    return bound.with_list(moving=aligned((bound.pairs.x.size // 3 * 7,), fill=None))


def memory(bound: PairKernel, varies: bool = False) -> dict[str, Any]:
    """State that determines the order of sums: the list's room and skins, and the positions of its last search and
    pruning, which make it again. The room counts because growing takes one more evaluation. If the box ``varies``, its
    edge lengths then belong to the state."""
    pairs = bound.pairs
    built_at, pruned_at = (pairs.built_at.copy(), pairs.inner_reference.copy()) if pairs.counts[BUILT] else (None, None)
    sizes = {"room": pairs.near.shape[1], "inner_skin": pairs.inner_skin, "outer_skin": pairs.outer_skin}
    if bound.row_room:
        sizes["row_room"] = bound.row_room
    found = {**sizes, "built_at": built_at, "pruned_at": pruned_at}
    return found | {"boxes": pairs.made_in.copy()} if varies else found


def _put_boxes(bound: PairKernel, boxes: Any) -> None:
    """Set the edge lengths at the last search and pruning; the other arguments are as in `recalled`."""
    own = bound.pairs.made_in
    there = own[:, :LENGTHS] > 0
    if not (
        np.shape(boxes) == own.shape
        and np.all(np.isfinite(boxes))
        and np.array_equal((lengths := np.asarray(boxes)[:, :LENGTHS]) > 0, there)
        and np.all(lengths[there] >= 2 * bound.pairs.cutoff)
    ):
        raise InputError("checkpoint: its pair list belongs to another box")
    own[...] = boxes


def recalled(bound: PairKernel, memory: dict[str, Any]) -> PairKernel:
    """Return the bound force with the list of this memory.

    Raises InputError if the memory does not fit these particles: it may come from a file, and compiled code checks no
    bounds."""
    if "inner_skin" not in memory:  # from a version with other lists
        return bound
    pairs = bound.pairs
    _, most = skins(pairs.bricks, pairs.cutoff, np.inf, LONGEST_SCALE * pairs.cutoff)
    room, built_at, pruned_at = memory["room"], memory["built_at"], memory["pruned_at"]
    row_room = memory.get("row_room", 0)
    shapes = [(built_at, pairs.built_at), (pruned_at, pairs.inner_reference)] if built_at is not None else []
    if not (
        0 <= memory["inner_skin"] <= memory["outer_skin"] <= most
        and isinstance(room, int)
        and 0 <= room <= pairs.near.shape[1] + len(pairs.filled) ** 2 * SHIFTS
        and isinstance(row_room, int)
        and (0 < row_room <= whole_blocks(len(pairs.place)) + bound.row_room) == (bound.row_room > 0)
        and row_room % WIDTH == 0
        and all(given.shape == own.shape and given.dtype == own.dtype for given, own in shapes)
    ):
        raise InputError("checkpoint: its pair list belongs to other particles")
    skins_then = {key: memory[key] for key in ("inner_skin", "outer_skin")}
    bound = with_room(bound, memory["room"]).with_list(**skins_then).with_row_room(row_room).ready()
    bound.pairs.counts[BUILT] = 0
    if "boxes" in memory:
        _put_boxes(bound, memory["boxes"])
    if memory["built_at"] is not None and bound.remake(memory["built_at"], memory["pruned_at"]) != OK:
        raise InputError("checkpoint: the positions of its pair list give no valid list")
    return bound

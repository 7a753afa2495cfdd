"""The compiled sum over the cluster pair list: any pair law, any truncation, one species or many."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numba import carray, types
from numpy.typing import NDArray

from kickdrift.errors import InputError
from kickdrift.forces.clusters import (
    BUILT,
    LANES,
    N_CLUSTERS,
    OUTER_BUILDS,
    ROOM_NEEDED,
    SHIFTS,
    STRIDE,
    ClusterList,
    cluster_list,
    copy,
    empty_rows,
    load_vector,
    skins,
    store_vector,
    unsigned,
)
from kickdrift.forces.kernel import FORCES_AND_SUMS, OK, REMAKE, BoundForce, call_force
from kickdrift.forces.list_code import list_code, prune, refresh
from kickdrift.forces.pair_sum import copy_to_single
from kickdrift.forces.row_lanes import RowLanes, row_lanes
from kickdrift.forces.truncation import AtCutoff, Cut, ForceShift, Shift, Switch
from kickdrift.jit.chunks import Chunks, each_chunk, in_chunks
from kickdrift.jit.compile import as_written, driver, jit
from kickdrift.jit.handle import Handle, handle_at
from kickdrift.jit.inner import overload
from kickdrift.jit.lanes import splat
from kickdrift.jit.memory import aligned
from kickdrift.jit.vectors import WIDTH
from kickdrift.model.state import Floats

if TYPE_CHECKING:
    from kickdrift.forces.pair_law import PairForce
    from kickdrift.model.system import System


THIN = 1e-3  # of the cutoff: a skin for rounding


class Tables(NamedTuple):
    """Numbers per pair of species, spread over the slots: ``law[k, species of i, slot of j]`` for the k-th
    parameter."""

    law: NDArray[np.float64]  # (parameters, species, slots)
    at_cutoff: NDArray[np.float64]  # (2, species, slots)
    law_pairs: NDArray[np.float64]  # (parameters, species, species)
    at_cutoff_pairs: NDArray[np.float64]  # (2, species, species)
    species: NDArray[np.int64]  # (n,)
    row: NDArray[np.int64]  # (slots,) the species in a slot


class PairWork(NamedTuple):
    """A pair law bound to a System."""

    law: Any  # the law's NamedTuple of parameters (of the first pair of species, where there are several)
    at_cutoff: AtCutoff  # likewise
    tables: Any  # Tables, or None for one species
    truncation: Any
    mixed: Any  # None, or the total mass, in mixed precision
    lanes: RowLanes  # of a step of the sum
    cutoff: float
    tail: tuple[float, float]  # energy and virial from beyond the cutoff
    inverse_masses: NDArray[np.float64]  # (n,)
    sums: NDArray[np.float64]  # (chunks, 3) energy, virial, pairs
    pairs: ClusterList
    chunks: Chunks


class PairKernel(BoundForce):
    """A bound pair force: ``parts`` is a PairWork. Its lists change by making another."""

    def ready(self) -> PairKernel:
        """See BoundForce."""
        if self.work:
            return self
        made: PairKernel = self._compiled(self.parts._replace(pairs=self.pairs._replace(code=list_code(self.pairs))))
        return made

    def _compute_for(self, kind: types.Type) -> Callable[..., int]:
        return compute_for(kind)

    @property
    def pairs(self) -> ClusterList:
        """The list."""
        pairs: ClusterList = self.parts.pairs
        return pairs

    def with_list(self, **changes: Any) -> PairKernel:
        """The same force with these parts of its list changed."""
        return PairKernel(self.parts._replace(pairs=self.pairs._replace(**changes)))

    def remake(self, built_at: Floats, pruned_at: Floats) -> int:
        """Make the list that was made at positions ``built_at`` (3, n) and last pruned where its ``inner_reference``
        was ``pruned_at``; a status."""
        return ask(self.address, self.work, REMAKE, built_at, pruned_at)


@driver
def ask(address, work, what, x, a):
    return call_force(address, work, what, 0.0, x, x, a, None)


def compute_for(kind: types.Type) -> Callable[..., int]:
    """All that is done with a PairWork of that type, as a function to be compiled for its address."""
    restore = handle_at(Handle(kind))

    def compute(work, what, n, t, x, v, a, sums):
        force = restore(work)
        if what == REMAKE:
            return remake(force, carray(x, (3, n)), carray(a, force.pairs.x.shape))
        return add_forces(force, what == FORCES_AND_SUMS, carray(x, (3, n)), carray(a, (3, n)), carray(sums, (3,)))

    return compute


@jit
def remake(force, built_at, pruned_at):
    pairs = force.pairs
    pairs.counts[BUILT] = 0
    status = refresh(pairs, built_at, force.chunks)
    if status == OK:
        copy(pruned_at, pairs.x)
        prune(pairs, force.chunks)
        spread(force.tables, pairs)
    return status


@jit
def add_forces(force, wanted, x, a, sums):
    """a <- a + the accelerations (3, n); where ``wanted`` sums <- sums + energy, virial, pairs; a status."""
    pairs, chunks = force.pairs, force.chunks
    builds = pairs.counts[OUTER_BUILDS]
    status = refresh(pairs, x, chunks)
    if status != OK:
        return status
    if pairs.counts[OUTER_BUILDS] != builds:
        spread(force.tables, pairs)
    prepare(force.mixed, pairs)
    if not wanted:
        each_chunk(force, chunks, "chunk_forces")
    else:
        each_chunk(force, chunks, "chunk_forces_and_sums")
        for c in range(chunks.number):
            sums[0] += force.sums[c, 0]
            sums[1] += force.sums[c, 1]
            sums[2] += force.sums[c, 2]
        sums[0] += force.tail[0]
        sums[1] += force.tail[1]
    collect(pairs, chunks)
    place, total, inverse_masses = pairs.place, pairs.force[0], force.inverse_masses
    gx, gy, gz = left_over(force.mixed, place, total)
    for i in range(place.size):
        p, w = unsigned(place[i]), inverse_masses[i]
        a[0, i] += total[p] * w - gx
        a[1, i] += total[p + LANES] * w - gy
        a[2, i] += total[p + LANES + LANES] * w - gz
    return OK


def prepare(mixed: Any, pairs: ClusterList) -> None:
    """In mixed precision copy the positions to float32."""


@overload(prepare)
def _prepare(mixed, pairs):
    return (
        (lambda mixed, pairs: None)
        if isinstance(mixed, types.NoneType)
        else (lambda mixed, pairs: copy_to_single(pairs))
    )


def left_over(mixed: Any, place: Any, total: Any) -> tuple[float, float, float]:
    """In mixed precision, what the forces together accelerate the whole by: zero but for rounding, and taken off, so
    that momentum is conserved as in float64."""
    raise NotImplementedError("for compiled code")


@overload(left_over)
def _left_over(mixed, place, total):
    if isinstance(mixed, types.NoneType):
        return lambda mixed, place, total: (0.0, 0.0, 0.0)

    def mean(mixed, place, total):
        gx = gy = gz = 0.0
        for p in place:
            gx, gy, gz = gx + total[p], gy + total[p + WIDTH], gz + total[p + 2 * WIDTH]
        return gx / mixed, gy / mixed, gz / mixed

    return mean


def spread(tables: Any, pairs: ClusterList) -> None:
    """After a sort: put each pair of species' numbers where their slots now are."""


@overload(spread)
def _spread(tables, pairs):
    if isinstance(tables, types.NoneType):
        return lambda tables, pairs: None

    def spread_tables(tables, pairs):
        for i in range(pairs.place.size):
            p = pairs.place[i]
            s = p // STRIDE * WIDTH + p % STRIDE
            of_i = tables.species[i]
            tables.row[s] = of_i
            for row in range(tables.law.shape[1]):
                for k in range(tables.law.shape[0]):
                    tables.law[k, row, s] = tables.law_pairs[k, row, of_i]
                for k in range(2):
                    tables.at_cutoff[k, row, s] = tables.at_cutoff_pairs[k, row, of_i]

    return spread_tables


@jit
def collect(pairs, chunks):
    """Add the chunks' forces up in chunk 0's, in one order."""
    force, touched = pairs.force, pairs.touched
    total = force[0]
    for cluster in range(pairs.counts[N_CLUSTERS]):
        fx, fy, fz = splat(0.0), splat(0.0), splat(0.0)
        for c in range(chunks.number):
            if touched[c, cluster]:
                gx, gy, gz = load_vector(force[c], cluster)
                fx, fy, fz = fx + gx, fy + gy, fz + gz
        store_vector(total, cluster, fx, fy, fz)


def law_class(force: PairForce) -> Any:
    """The class of a force's parameters, as compiled code takes it."""
    cls = force.Parameters
    if "compiled_law" not in vars(cls):
        cls.compiled_law = as_written(cls.law)
    return cls


def bind(force: PairForce, system: System, threads: int, mixed: bool = False) -> PairKernel:
    """A pair force for this System, on this many threads."""
    lanes = row_lanes(mixed)
    cls = law_class(force)
    n, names = len(system), system.species
    laws = [[force.pair_law(a, b) for b in names] for a in names]
    cutoff = float(force.cutoff or 0.0)
    at_cutoff = [[AtCutoff(*(float(u) for u in p.law(cutoff**2))) for p in row] for row in laws]
    pairs = cluster_list(n, system.box, cutoff, lanes, single=mixed)
    tables = None
    if len(names) > 1:
        law_pairs = np.array(laws, dtype=float).transpose(2, 0, 1).copy()
        at_cutoff_pairs = np.array(at_cutoff).transpose(2, 0, 1).copy()
        slots = pairs.x.size // 3
        tables = Tables(
            law=aligned((len(law_pairs), len(names), slots), 1.0),
            at_cutoff=aligned((2, len(names), slots)),
            law_pairs=law_pairs,
            at_cutoff_pairs=at_cutoff_pairs,
            species=system.species_index.astype(np.int64),
            row=np.zeros(slots, np.int64),
        )
    chunks = pairs.force.shape[0]
    work = PairWork(
        law=cls(*(float(value) for value in laws[0][0])),
        at_cutoff=at_cutoff[0][0],
        tables=tables,
        truncation=truncation_of(force),
        mixed=float(system.coherent_masses.sum()) if mixed else None,
        lanes=lanes,
        cutoff=cutoff,
        tail=force.tail_corrections(system),
        inverse_masses=1.0 / system.coherent_masses,
        sums=np.zeros((chunks, 3)),
        pairs=pairs,
        chunks=in_chunks(chunks, threads),
    )
    return PairKernel(work)


def truncation_of(force: PairForce) -> Any:
    """The compiled truncation that a pair force names."""
    cutoff, start = float(force.cutoff or 0.0), float(force.switch_start or 0.0)
    return {
        "cut": Cut(),
        "shift": Shift(),
        "force-shift": ForceShift(cutoff),
        "switch": Switch(start**2, 1.0 / (cutoff**2 - start**2)),
    }[force.truncation]


def grown(bound: Any) -> Any:
    """The bound force with room in its list for what the last search found, where it had run out; else as it is."""
    if not isinstance(bound, PairKernel):
        return bound
    pairs = bound.pairs
    if pairs.counts[ROOM_NEEDED] <= pairs.near.shape[1]:
        return bound
    return with_room(bound, int(1.3 * pairs.counts[ROOM_NEEDED]))


def thinned(bound: Any) -> Any:
    """The bound force with a list for one set of positions: its skins are for rounding, and for differences of
    Jacobians, alone."""
    if not isinstance(bound, PairKernel):
        return bound
    pairs = bound.pairs
    skin = min(THIN * pairs.cutoff, pairs.inner_skin)
    return bound.with_list(inner_skin=skin, outer_skin=skin)


def tuned(bound: Any, stride: float) -> Any:
    """The bound force with the skins for a fastest particle that goes so far between two evaluations."""
    if not isinstance(bound, PairKernel):
        return bound
    inner, outer = skins(bound.pairs.bricks, bound.pairs.cutoff, stride)
    return bound.with_list(inner_skin=inner, outer_skin=outer)


def with_room(bound: PairKernel, room: int) -> PairKernel:
    """The bound force with empty lists of so many entries a chunk."""
    pairs = bound.pairs
    chunks = len(pairs.made)
    rows = empty_rows(chunks, room, pairs.block)
    return bound.with_list(near=np.empty((chunks, room), np.int32), rows=rows)


def memory(bound: PairKernel) -> dict[str, Any]:
    """What the order of sums depends on: the positions that the list was sorted and searched at and those that it was
    last pruned at, which make it anew; its skins; and its room, since growing takes an evaluation more."""
    pairs = bound.pairs
    built_at, pruned_at = (pairs.built_at.copy(), pairs.inner_reference.copy()) if pairs.counts[BUILT] else (None, None)
    sizes = {"room": pairs.near.shape[1], "inner_skin": pairs.inner_skin, "outer_skin": pairs.outer_skin}
    return {**sizes, "built_at": built_at, "pruned_at": pruned_at}


def recalled(bound: PairKernel, memory: dict[str, Any]) -> PairKernel:
    """The bound force with the list that had this memory, which may come from a file: an InputError where it does not
    fit these particles, since compiled code looks at no bounds."""
    if "inner_skin" not in memory:  # of a version that had other lists
        return bound
    pairs = bound.pairs
    _, most = skins(pairs.bricks, pairs.cutoff, np.inf)
    room, built_at, pruned_at = memory["room"], memory["built_at"], memory["pruned_at"]
    shapes = [(built_at, pairs.built_at), (pruned_at, pairs.inner_reference)] if built_at is not None else []
    if not (
        0 <= memory["inner_skin"] <= memory["outer_skin"] <= most
        and isinstance(room, int)
        and 0 <= room <= pairs.near.shape[1] + len(pairs.filled) ** 2 * SHIFTS
        and all(given.shape == own.shape and given.dtype == own.dtype for given, own in shapes)
    ):
        raise InputError("checkpoint: its pair list belongs to other particles")
    skins_then = {key: memory[key] for key in ("inner_skin", "outer_skin")}
    bound = with_room(bound, memory["room"]).with_list(**skins_then).ready()
    bound.pairs.counts[BUILT] = 0
    if memory["built_at"] is not None and bound.remake(memory["built_at"], memory["pruned_at"]) != OK:
        raise InputError("checkpoint: the positions of its pair list give no valid list")
    return bound

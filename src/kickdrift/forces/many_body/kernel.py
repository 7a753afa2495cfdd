"""Compiled sums of many-body forces: a visit of each particle with all its neighbours."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np
from numba import types
from numpy.typing import NDArray

from kickdrift.forces.lists.clusters import N_CLUSTERS, STRIDE, ClusterList, chunk_clusters
from kickdrift.forces.lists.list_code import refresh
from kickdrift.forces.lists.neighbours import (
    ROOM_NEEDED,
    SUMMED,
    Neighbours,
    copy_places,
    follow_box,
    renew,
    with_room,
)
from kickdrift.forces.lists.sums import Gathering
from kickdrift.forces.pairs.kernel import PairKernel, compute_for
from kickdrift.forces.seam.kernel import OK
from kickdrift.jit.compile import as_written, jit, never_inline
from kickdrift.jit.duals.lanes import load, store, value_of
from kickdrift.jit.handle import Handle, handle
from kickdrift.jit.inner import by_type
from kickdrift.jit.lanes.functions import splat
from kickdrift.jit.lanes.gathering import ROW, rows_of
from kickdrift.jit.lanes.memory import broadcast
from kickdrift.jit.lanes.single import zeros_in
from kickdrift.jit.lanes.vectors import WIDTH
from kickdrift.jit.threads.chunks import Chunks, chunk_task, each_chunk

LAWS: dict[type, Callable[..., Any]] = {}


class ManyBodyWork(NamedTuple):
    """A many-body law bound to a System."""

    law: Any  # the law's NamedTuple of numbers and arrays, whose class is in ``LAWS``
    cutoff: float
    inverse_masses: NDArray[np.float64]  # (n,)
    sums: NDArray[np.float64]  # (chunks, 3) energy, virial, pairs
    along: Any  # virial of each chunk, for a barostat; see `lists.along`
    rows: Neighbours
    pairs: ClusterList
    chunks: Chunks


class ManyBodyKernel(PairKernel):
    """A bound many-body force: ``parts`` is a ManyBodyWork."""

    @property
    def row_room(self) -> int:
        """See PairKernel."""
        return int(self.parts.rows.near.shape[1])

    @property
    def row_need(self) -> int:
        """See PairKernel."""
        return int(self.parts.rows.state[ROOM_NEEDED])

    def with_row_room(self, room: int) -> ManyBodyKernel:
        """See PairKernel."""
        rows = with_room(self.parts.rows, room)
        law = self.parts.law.with_room(*rows.near.shape, self.parts.chunks.number)
        return ManyBodyKernel(self.parts._replace(rows=rows, law=law))

    def _compute_for(self, kind: types.Type) -> Callable[..., int]:
        return compute_for(kind, add_forces, renew_rows)


def law_body(cls: type, tables: tuple[str, ...], pairs_once: bool = False) -> Callable[[Callable[..., Any]], Any]:
    """Register the compiled body of a law, ``body(law, force, chunks)``, and whether it visits each pair once.

    ``tables`` names the arrays that are of float32 in mixed precision.

    The body writes the force on the particle in each slot to ``force.pairs.force[0]``, see `collect_forces`. It writes
    energy, virial and number of pairs of each chunk to ``force.sums``."""

    def register(body: Callable[..., Any]) -> Any:
        LAWS[cls] = body
        cls.kernel_sources = (body,)  # type: ignore[attr-defined]
        cls.pairs_once, cls.tables = pairs_once, tables  # type: ignore[attr-defined]
        return body

    return register


@by_type
def run_law(law, force, chunks):
    """Run the body of the law's class."""
    return LAWS[(law.kind if isinstance(law, Handle) else law).instance_class]


@jit
def renew_rows(force):
    """Make the rows of neighbours of a new list; return a status."""
    return renew(force)


@jit
def refresh_rows(force, x):
    """Update the list and the rows of neighbours for positions x (3, n); return a status."""
    status = refresh(force.pairs, x, force.chunks)
    if status == OK:
        status = renew(force)
    if status == OK:
        follow_box(force.rows)
        copy_places(force.rows, force.pairs)
    return status


@jit
def add_forces(force, wanted, x, a, sums):
    """Add the accelerations (3, n) to a and, if ``wanted``, energy, virial and pairs to sums. Return a status.

    A second call at the same positions, as for a look after a step, takes the sums of the first."""
    pairs, chunks, state = force.pairs, force.chunks, force.rows.state
    status = refresh_rows(force, x)
    if status != OK:
        return status
    if state[SUMMED] != 1:
        run_law(force.law, force, chunks)
        state[SUMMED] = 1
    if wanted:
        for c in range(chunks.number):
            sums[0] += force.sums[c, 0]
            sums[1] += force.sums[c, 1]
            sums[2] += force.sums[c, 2]
    each_chunk(handle(Gathering(pairs, chunks, force.inverse_masses, a, None)), chunks, "gather_chunk")
    return OK


@as_written
def clear_reached(force, numbers, c, each):
    """Set to zero the numbers, ``each`` for a slot, of the clusters that chunk c's rows reach."""
    for cluster in range(force.pairs.counts[N_CLUSTERS]):
        if force.rows.reached[c, cluster]:
            for k in range(each):
                store(numbers, WIDTH * (each * cluster + k), splat(0.0))


@as_written
def add_others(force, numbers, c, cluster, each):
    """Add to chunk c's numbers of a cluster, ``each`` for a slot, those that the other chunks' rows give."""
    for other in range(force.chunks.number):
        if other != c and force.rows.reached[other, cluster]:
            for p in range(each * WIDTH * cluster, each * WIDTH * (cluster + 1), WIDTH):
                store(numbers[c], p, load(numbers[c], p) + load(numbers[other], p))


@chunk_task
def collect_forces(force, c):
    """Sum the chunks' forces, ``law.forces``, on chunk c's particles."""
    never_inline()
    forces, pairs = force.law.forces, force.pairs
    total = pairs.force[0]
    begin, end = chunk_clusters(pairs, c)
    for cluster in range(begin, end):
        add_others(force, forces, c, cluster, ROW)
        for lane in range(WIDTH):
            p, q = STRIDE * cluster + lane, ROW * (WIDTH * cluster + lane)
            total[p], total[p + WIDTH], total[p + 2 * WIDTH] = forces[c, q], forces[c, q + 1], forces[c, q + 2]


@as_written
def row_numbers(table, rows, column):
    """Return four lanes: the numbers from ``column`` on of these rows of a table (rows, columns). All lanes take the
    same row if there is only one."""
    if table.shape[0] > 1:
        a, b, c, d = rows_of(table, value_of(rows), table.shape[1], column)
    else:
        zero = zeros_in(table)
        a, b = broadcast(table, column, zero), broadcast(table, column + 1, zero)
        c, d = broadcast(table, column + 2, zero), broadcast(table, column + 3, zero)
    return a, b, c, d

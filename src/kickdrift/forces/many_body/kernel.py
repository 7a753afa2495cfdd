"""Compiled sums of many-body forces: a visit of each particle with all its neighbours."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np
from numba import types
from numpy.typing import NDArray

from kickdrift.forces.lists.clusters import (
    LANES,
    N_CLUSTERS,
    STRIDE,
    ClusterList,
    unsigned,
)
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
from kickdrift.forces.pairs.kernel import PairKernel, compute_for
from kickdrift.forces.seam.kernel import OK
from kickdrift.jit.compile import as_written, jit
from kickdrift.jit.duals.lanes import load, store, value_of
from kickdrift.jit.handle import Handle
from kickdrift.jit.inner import overload
from kickdrift.jit.lanes.functions import splat
from kickdrift.jit.lanes.gathering import place_at, rows_of
from kickdrift.jit.lanes.masks import lowest_bit
from kickdrift.jit.lanes.memory import broadcast
from kickdrift.jit.lanes.vectors import WIDTH
from kickdrift.jit.threads.chunks import Chunks

THREE_LANES = unsigned(STRIDE)
LAWS: dict[type, Callable[..., Any]] = {}


class ManyBodyWork(NamedTuple):
    """A many-body law bound to a System."""

    law: Any  # the law's NamedTuple of numbers and arrays, whose class is in ``LAWS``
    cutoff: float
    inverse_masses: NDArray[np.float64]  # (n,)
    sums: NDArray[np.float64]  # (chunks, 3) energy, virial, pairs
    along: Any  # (chunks, 3) virial along each axis, for a barostat; else None
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


def law_body(cls: type, pairs_once: bool = False) -> Callable[[Callable[..., Any]], Any]:
    """Register the compiled body of a law, ``body(law, force, chunks)``, and whether its rows hold each pair once.

    The body writes the force on the particle in each slot to ``force.pairs.force`` (one array for each chunk, which are
    summed afterwards), and energy, virial and number of pairs to ``force.sums``."""

    def register(body: Callable[..., Any]) -> Any:
        LAWS[cls] = body
        cls.kernel_sources = (body,)  # type: ignore[attr-defined]
        cls.pairs_once = pairs_once  # type: ignore[attr-defined]
        return body

    return register


def run_law(law: Any, force: Any, chunks: Chunks) -> None:
    """Run the body of the law's class."""


@overload(run_law)
def _run_law(law, force, chunks):
    return LAWS[(law.kind if isinstance(law, Handle) else law).instance_class]


@jit
def renew_rows(force):
    """Make the rows of neighbours of a new list; return a status."""
    return renew(force.rows, force.pairs)


@jit
def refresh_rows(force, x):
    """Update the list and the rows of neighbours for positions x (3, n); return a status."""
    status = refresh(force.pairs, x, force.chunks)
    if status == OK:
        status = renew(force.rows, force.pairs)
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
    place, total, inverse_masses = pairs.place, pairs.force[0], force.inverse_masses
    for i in range(place.size):
        p, w = unsigned(place[i]), inverse_masses[i]
        a[0, i] += total[p] * w
        a[1, i] += total[p + LANES] * w
        a[2, i] += total[p + LANES + LANES] * w
    return OK


@jit
def clear(pairs, c):
    """Set chunk c's forces to zero."""
    forces = pairs.force[c]
    for p in range(0, STRIDE * pairs.counts[N_CLUSTERS], WIDTH):
        store(forces, p, splat(0.0))


@jit
def collect(pairs, chunks):
    """Sum the chunks' forces in chunk 0, in one order."""
    total = pairs.force[0]
    for p in range(0, STRIDE * pairs.counts[N_CLUSTERS], WIDTH):
        force = load(total, p)
        for c in range(1, chunks.number):
            force = force + load(pairs.force[c], p)
        store(total, p, force)


@as_written
def row_numbers(table, species, rows, stride, column):
    """Return four lanes: the parameters from ``column`` on in these rows of a table with ``stride`` numbers in a row.
    For one species all lanes take the first row."""
    if species > 1:
        a, b, c, d = rows_of(table, value_of(rows), stride, column)
    else:
        zero = splat(0.0)
        a, b = broadcast(table, column, zero), broadcast(table, column + 1, zero)
        c, d = broadcast(table, column + 2, zero), broadcast(table, column + 3, zero)
    return a, b, c, d


@as_written
def react(forces, buffer, near, first, bits, gx, gy, gz):
    """Subtract lanes from the forces on the neighbours from ``first`` on whose bit is set."""
    store(buffer, 0, gx)
    store(buffer, WIDTH, gy)
    store(buffer, 2 * WIDTH, gz)
    while bits:
        k = lowest_bit(bits)
        bits &= bits - 1
        slot = unsigned(place_at(near, first + k))
        p = slot // LANES * THREE_LANES + slot % LANES
        forces[p] -= buffer[k]
        forces[p + LANES] -= buffer[k + WIDTH]
        forces[p + LANES + LANES] -= buffer[k + 2 * WIDTH]

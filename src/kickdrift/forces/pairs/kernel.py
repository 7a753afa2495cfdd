"""Compiled forces of a pair law, with any truncation and one species or many: the upkeep of the list, and the sum."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np
from numba import carray, types
from numpy.typing import NDArray

from kickdrift.forces.lists.clusters import (
    BUILT,
    LANES,
    ClusterList,
    copy,
    unsigned,
)
from kickdrift.forces.lists.list_code import adopt, list_code, prune, refresh
from kickdrift.forces.lists.load import PRUNED, SEARCHED, scaled_tail
from kickdrift.forces.lists.row_lanes import RowLanes
from kickdrift.forces.lists.sums import Gathering, add_accelerations, mean_acceleration
from kickdrift.forces.pairs import sum as sum  # the tasks of chunks
from kickdrift.forces.pairs.sorted_steps import step_by, steps_code
from kickdrift.forces.pairs.upkeep import fill_tables, refresh_force
from kickdrift.forces.seam.kernel import (
    FORCES_ALONE,
    FORCES_AND_SUMS,
    OK,
    REFRESH,
    REMAKE,
    TAKE_STEPS,
    BoundForce,
    call_force,
)
from kickdrift.forces.seam.samples import SUMMED, WITH_SUMS, note_look, sums_expected
from kickdrift.jit.compile import driver, jit
from kickdrift.jit.handle import Handle, handle, handle_at
from kickdrift.jit.inner import by_type
from kickdrift.jit.threads.chunks import Chunks, each_chunk
from kickdrift.model.box.cell import differs
from kickdrift.model.state import Floats


@jit
def sum_forces(force, wanted):
    """Sum the forces of all chunks; if a sample is ``wanted`` or expected, also their energies and virials."""
    if sums_expected(force.looks, wanted):
        each_chunk(force, force.chunks, "chunk_forces_and_sums")
    else:
        each_chunk(force, force.chunks, "chunk_forces")


@jit
def is_summed(force, x):
    """Tell whether the last evaluation has energy and virial at the positions x (3, n), in a box of the same edges."""
    pairs = force.pairs
    if force.looks[SUMMED] == 0 or pairs.counts[BUILT] == 0:
        return False
    if differs(pairs.cell):
        return False
    own, offset, same = pairs.x, pairs.offset, True
    for i in range(pairs.place.size):
        p = unsigned(pairs.place[i])
        y, z = p + LANES, p + LANES + LANES
        same &= x[0, i] - offset[p] == own[p] and x[1, i] - offset[y] == own[y] and x[2, i] - offset[z] == own[z]
    return same


@jit
def gather_again(force, a):
    """Add the accelerations of the last evaluation once more."""
    mean = mean_again(force.mixed, force.pairs)
    gathering = Gathering(force.pairs, force.chunks, force.inverse_masses, a, mean)
    each_chunk(handle(gathering), force.chunks, "gather_chunk")


@by_type
def mean_again(mixed, pairs):
    """Return None; in mixed precision, the mean acceleration from the sums of all chunks."""
    if isinstance(mixed, types.NoneType):
        return lambda mixed, pairs: None
    return lambda mixed, pairs: mean_acceleration(mixed, pairs)


class PairWork(NamedTuple):
    """A pair law bound to a System."""

    law: Any  # the law's NamedTuple of parameters, for the first pair of species
    at_cutoff: Any  # AtCutoff or AtOwnCutoff, for the first pair of species
    tables: Any  # Tables, or None for one species
    truncation: Any
    mixed: Any  # None, or the total mass, in mixed precision
    lanes: RowLanes  # lanes of a step of the sum
    cutoff: float
    tail: tuple[float, float]  # energy and virial from beyond the cutoff
    tail_volume: float  # of the box that these belong to
    inverse_masses: NDArray[np.float64]  # (n,)
    sums: NDArray[np.float64]  # (chunks, 3) energy, virial, pairs
    looks: NDArray[np.int64]  # (4,) what is known of samples; see `forces.seam.samples`
    along: Any  # virial of each chunk, for a barostat; see `lists.along`
    pairs: ClusterList
    chunks: Chunks
    steps: int = 0  # address of the machine code of steps in the order of the clusters, for a force that takes them


class PairKernel(BoundForce):
    """A bound pair force: ``parts`` is a PairWork. Changing the list makes another PairKernel."""

    def ready(self) -> PairKernel:
        """See BoundForce."""
        if self.work:
            return self
        parts = self.parts._replace(pairs=self.pairs._replace(code=list_code(self.pairs)))
        made: PairKernel = self._compiled(parts._replace(steps=steps_code(parts)) if self.pairs.moving.size else parts)
        return made

    def _compute_for(self, kind: types.Type) -> Callable[..., int]:
        return compute_for(kind, add_forces, fill_tables, stepping)

    @property
    def pairs(self) -> ClusterList:
        """List of pairs."""
        pairs: ClusterList = self.parts.pairs
        return pairs

    def with_list(self, **changes: Any) -> PairKernel:
        """Return the same force with these parts of its list changed."""
        return type(self)(self.parts._replace(pairs=self.pairs._replace(**changes)))

    @property
    def row_room(self) -> int:
        """Room for the neighbours of each particle; 0 for a force that takes pairs one by one."""
        return 0

    @property
    def row_need(self) -> int:
        """Neighbours of the particle with most of them, when the rows were last made."""
        return 0

    def with_row_room(self, room: int) -> PairKernel:
        """Return the same force with this room for neighbours."""
        return self

    def remake(self, built_at: Floats, pruned_at: Floats) -> int:
        """Make the list again and return a status. Its last search was at positions ``built_at`` (3, n), its last
        pruning at ``pruned_at``, which was its ``inner_reference``."""
        return ask(self.address, self.work, REMAKE, built_at, pruned_at)


@driver
def ask(address, work, what, x, a):
    return call_force(address, work, what, 0.0, x, x, a, None)


@jit
def no_steps(force, work, what, plan, x, v, a):
    return OK


@jit
def stepping(force, work, what, plan, x, v, a):
    """Take the steps of a plan, or do one of their tasks: update the list, or sum the forces; return a status."""
    if what == REFRESH:
        return refresh_force(force, x)
    if what == FORCES_ALONE:
        sum_forces(force, False)
    else:
        step_by(force, work, plan, x, v, a)
    return OK


def compute_for(
    kind: types.Type, add: Callable[..., int], complete: Callable[..., int], step: Callable[..., int] = no_steps
) -> Callable[..., int]:
    """All tasks for this type of ``parts`` with a list of pairs, as a function to compile for its address.

    ``add(force, wanted, x, a, sums)`` adds the forces. ``complete(force)`` makes what a new list needs beside it.
    ``step(force, work, what, plan, x, v, a)`` does the tasks of steps. All return a status."""
    restore = handle_at(Handle(kind))

    def compute(work, what, n, t, x, v, a, sums):
        force = restore(work)
        if what >= TAKE_STEPS:
            plan = carray(sums, (int(t),))
            return step(force, work, what, plan, carray(x, (3, n)), carray(v, (3, n)), carray(a, (3, n)))
        if what == REMAKE:
            status = remake(force, carray(x, (3, n)), carray(a, force.pairs.x.shape))
            return complete(force) if status == OK else status
        return add(force, what == FORCES_AND_SUMS, carray(x, (3, n)), carray(a, (3, n)), carray(sums, (3,)))

    return compute


@jit
def remake(force, built_at, pruned_at):
    """Make the list again from its last search and its last pruning; return a status."""
    pairs = force.pairs
    pairs.counts[BUILT] = 0
    now, then = pairs.live.copy(), pairs.made_in.copy()
    copy(then[SEARCHED], pairs.live)
    status = refresh(pairs, built_at, force.chunks)
    if status == OK:
        copy(then[PRUNED], pairs.live)
        adopt(pairs, force.chunks)
        copy(pruned_at, pairs.x)
        prune(pairs, force.chunks)
    copy(now, pairs.live)
    return status


@jit
def add_forces(force, wanted, x, a, sums):
    """Add the accelerations (3, n) to a and, if ``wanted``, energy, virial and pairs to sums. Return a status."""
    pairs, chunks = force.pairs, force.chunks
    if wanted and is_summed(force, x):
        gather_again(force, a)
    else:
        force.looks[SUMMED] = 0
        status = refresh_force(force, x)
        if status != OK:
            return status
        sum_forces(force, wanted)
        add_accelerations(force, a)
        force.looks[SUMMED] = force.looks[WITH_SUMS]
    if wanted:
        note_look(force.looks)
        for c in range(chunks.number):
            sums[0] += force.sums[c, 0]
            sums[1] += force.sums[c, 1]
            sums[2] += force.sums[c, 2]
        scaled = scaled_tail(pairs, force.tail_volume)
        sums[0] += scaled * force.tail[0]
        sums[1] += scaled * force.tail[1]
    return OK

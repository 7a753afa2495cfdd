"""Bound forces that call a force on a neighbour list by its address, and add something of their own."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, ClassVar

import numpy as np
from numba import carray, types

from kickdrift.forces.lists.clusters import ClusterList
from kickdrift.forces.pairs.kernel import PairKernel
from kickdrift.forces.seam.kernel import FORCES, FORCES_AND_SUMS, OK, call_force
from kickdrift.jit.compile import jit, never_inline
from kickdrift.jit.handle import Handle, handle_at
from kickdrift.model.state import Floats


class BesidePairs(PairKernel):
    """A bound force that calls ``own``, a force of the particles alone, and uses its list.

    ``parts`` has the fields ``force``, ``address`` and ``work``: the parts and the machine code of ``own``, which
    `ready` fills in. The compiled body ``add(force, wanted, t, x, v, a, sums)`` returns a status."""

    add: ClassVar[Any]

    def __init__(self, parts: Any, own: Any = None) -> None:
        super().__init__(parts)
        self.own: PairKernel = own

    def ready(self) -> BesidePairs:
        """See BoundForce."""
        if self.work:
            return self
        own = self.own.ready()
        made: BesidePairs = self._compiled(self.beside(own))
        made.own = own
        return made

    def beside(self, own: PairKernel) -> Any:
        """The parts beside a force that is ready."""
        return self.parts._replace(force=own.parts, address=own.address, work=own.work)

    def _compute_for(self, kind: types.Type) -> Callable[..., int]:
        restore, add = handle_at(Handle(kind)), type(self).add

        def compute(work, what, n, t, x, v, a, sums):
            shape, wanted = (3, n), what == FORCES_AND_SUMS
            return add(restore(work), wanted, t, carray(x, shape), carray(v, shape), carray(a, shape), carray(sums, 3))

        return compute

    @property
    def pairs(self) -> ClusterList:
        """See PairKernel."""
        return self.own.pairs

    def with_list(self, **changes: Any) -> BesidePairs:
        """See PairKernel."""
        return type(self)(self.parts, self.own.with_list(**changes))

    @property
    def row_room(self) -> int:
        """See PairKernel."""
        return self.own.row_room

    @property
    def row_need(self) -> int:
        """See PairKernel."""
        return self.own.row_need

    def with_row_room(self, room: int) -> BesidePairs:
        """See PairKernel."""
        return type(self)(self.parts, self.own.with_row_room(room))

    def remake(self, built_at: Floats, pruned_at: Floats) -> int:
        """See PairKernel."""
        return self.own.remake(built_at, pruned_at)


def room_beside(own: PairKernel, by_masses: Floats) -> tuple[Any, int, int, Floats, Floats, Floats]:
    """The first fields of the parts: ``own``, no machine code yet, room for the particles' phase and accelerations, and
    -dm / m (n, k) along the deviations."""
    a = np.zeros((3, len(by_masses)))
    return own.parts, 0, 0, np.zeros((2, *a.shape)), a, by_masses


@jit
def copy_phase(force, x, v):
    """Copy positions and velocities of the particles, and set force.a to zero."""
    phase, a = force.phase, force.a
    for k in range(3):
        for i in range(a.shape[1]):
            phase[0, k, i], phase[1, k, i], a[k, i] = x[k, i], v[k, i], 0.0


@jit
def accelerations_of_own(force, wanted, t, x, v, sums):
    """force.a <- accelerations (3, n) of the particles, whose positions are the first n columns of x. Return a
    status."""
    never_inline()
    copy_phase(force, x, v)
    phase, a = force.phase, force.a
    if wanted:
        return call_force(force.address, force.work, FORCES_AND_SUMS, t, phase[0], phase[1], a, sums)
    return call_force(force.address, force.work, FORCES, t, phase[0], phase[1], a, None)


@jit
def add_own(force, wanted, t, x, v, a, sums):
    """Add the accelerations of the particles, which stay in force.a. Return a status."""
    status = accelerations_of_own(force, wanted, t, x, v, sums)
    if status == OK:
        add_particles(force, a)
    return status


@jit
def add_particles(force, a):
    """Add force.a, the accelerations of the particles."""
    own = force.a
    for k in range(3):
        for i in range(own.shape[1]):
            a[k, i] += own[k, i]


def slopes_by_masses(masses: Floats, slopes: Floats | None) -> Floats:
    """-dm / m of n particles along k deviations, (n, k) from slopes of the masses; (n, 0) if no mass varies."""
    return np.zeros((len(masses), 0)) if slopes is None else np.ascontiguousarray(-slopes / masses[:, None])


@jit
def add_by_masses(by_masses, own, a):
    """Add what the masses do to the accelerations of the deviations; ``own`` (3, n) are those of the particles."""
    n, directions = by_masses.shape
    for k in range(3):
        for i in range(n):
            for q in range(directions):
                a[k, n + i * directions + q] += by_masses[i, q] * own[k, i]

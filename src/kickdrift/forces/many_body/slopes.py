"""The variations of a many-body force: its kernel on duals, along each deviation in turn.

The kernel of the forces runs on positions with slopes. So the variations are exact. Where a formula has a kink, such as
a spline between two points of its table, they are those of the side of the particles. The values of the duals have the
bits of the kernel's own forces, so the first deviation brings the forces on the particles along.
"""

from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np
from numba import types
from numpy.typing import NDArray

from kickdrift.forces.lists.clusters import N_CLUSTERS, STRIDE, unsigned
from kickdrift.forces.lists.neighbours import ROW
from kickdrift.forces.many_body.kernel import ManyBodyWork, refresh_rows, run_law
from kickdrift.forces.pairs.beside_pairs import BesidePairs, add_by_masses, add_particles, copy_phase, room_beside
from kickdrift.forces.pairs.kernel import PairKernel
from kickdrift.forces.seam.kernel import OK
from kickdrift.jit.compile import jit, never_inline
from kickdrift.jit.duals.dual import dual
from kickdrift.jit.duals.lanes import dual_numbers, with_duals
from kickdrift.jit.lanes.vectors import WIDTH
from kickdrift.model.state import Floats


class ManyBodySlopes(NamedTuple):
    """A many-body force on its list, with its variations."""

    force: Any  # ManyBodyWork of the particles
    address: int  # of the machine code of this force
    work: int
    phase: NDArray[np.float64]  # (2, 3, n) positions and velocities of the particles
    a: NDArray[np.float64]  # (3, n) accelerations of the particles
    by_masses: NDArray[np.float64]  # (n, k) -dm / m along the deviations; (n, 0) if no mass varies
    duals: Any = None  # ManyBodyWork on duals


class ManyBodySlopesKernel(BesidePairs):
    """A bound many-body force with its variations: ``parts`` is a ManyBodySlopes."""

    def beside(self, own: PairKernel) -> ManyBodySlopes:
        """See BesidePairs."""
        parts: ManyBodySlopes = super().beside(own)._replace(duals=on_duals(own.parts))
        return parts

    def _compute_for(self, kind: types.Type) -> Callable[..., int]:
        return super()._compute_for(with_duals(kind))


def bind(own: PairKernel, by_masses: Floats) -> ManyBodySlopesKernel:
    """Bind a many-body force of n particles; ``by_masses`` is as in `ManyBodySlopes`."""
    return ManyBodySlopesKernel(ManyBodySlopes(*room_beside(own, by_masses)), own)


def on_duals(work: ManyBodyWork) -> ManyBodyWork:
    """The same force with the same neighbours. Its positions, workspace, forces and sums are duals."""
    law, fresh = work.law, work.law.with_room(*work.rows.near.shape, work.chunks.number)
    room = {
        name: dual_numbers(array.shape)
        for name, array in fresh._asdict().items()
        if array is not getattr(law, name) and array.dtype == np.float64
    }
    return work._replace(
        law=fresh._replace(**room),
        sums=dual_numbers(work.sums.shape),
        rows=work.rows._replace(at=dual_numbers(work.rows.at.shape)),
        pairs=work.pairs._replace(x=dual_numbers(work.pairs.x.shape), force=dual_numbers(work.pairs.force.shape)),
    )


@jit
def add_slopes(force, wanted, t, x, v, a, sums):
    """Add the accelerations of the particles and their deviations. Return a status."""
    copy_phase(force, x, v)
    status = refresh_rows(force.force, force.phase[0])
    if status != OK:
        return status
    n, duals = force.a.shape[1], force.duals
    directions = x.shape[1] // n - 1
    place_values(force)
    for q in range(directions):
        place_deviation(force, x, n + q, directions)
        run_law(duals.law, duals, duals.chunks)
        if q == 0:
            collect_values(force, wanted, sums)
        collect_slopes(force, a, n + q, directions)
    add_particles(force, a)
    add_by_masses(force.by_masses, force.a, a)
    return OK


ManyBodySlopesKernel.add = add_slopes


@jit
def place_values(force):
    """Write positions and species to the duals' slots and clusters; padding has no slopes."""
    never_inline()
    sorted_x, x = force.force.pairs.x, force.duals.pairs.x
    for p in range(STRIDE * force.force.pairs.counts[N_CLUSTERS]):
        x[p] = sorted_x[p]
    values, at = force.force.rows.at, force.duals.rows.at
    for p in range(ROW * WIDTH * force.force.pairs.counts[N_CLUSTERS]):
        at[p] = values[p]


@jit
def place_deviation(force, x, first, apart):
    """Write a deviation as slopes of its particles. Its columns of x begin at ``first``."""
    never_inline()
    place, values, at, sorted_x = force.force.pairs.place, force.force.rows.at, force.duals.rows.at, force.duals.pairs.x
    for i in range(place.size):
        p, column = place[i], first + i * apart
        slot = ROW * (p // STRIDE * WIDTH + p % STRIDE)
        for k in range(3):
            at[slot + k] = sorted_x[p + k * WIDTH] = dual(values[slot + k], x[k, column])


@jit
def collect_values(force, wanted, sums):
    """Add the accelerations of the particles to force.a and, if ``wanted``, energy, virial and pairs to sums."""
    never_inline()
    place, total, inverse_masses = force.force.pairs.place, force.duals.pairs.force[0], force.force.inverse_masses
    for i in range(place.size):
        p, w = unsigned(place[i]), inverse_masses[i]
        for k in range(3):
            force.a[k, i] += total[p + unsigned(k * WIDTH)].value * w
    if wanted:
        for c in range(force.duals.chunks.number):
            for k in range(3):
                sums[k] += force.duals.sums[c, k].value


@jit
def collect_slopes(force, a, first, apart):
    """Add the slopes of the forces to the accelerations of a deviation."""
    never_inline()
    place, total, inverse_masses = force.force.pairs.place, force.duals.pairs.force[0], force.force.inverse_masses
    for i in range(place.size):
        p, column, w = unsigned(place[i]), first + i * apart, inverse_masses[i]
        for k in range(3):
            a[k, column] += total[p + unsigned(k * WIDTH)].slope * w

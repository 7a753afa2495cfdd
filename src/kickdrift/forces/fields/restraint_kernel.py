"""Compiled position restraints: a sum over the held particles, on one thread, so that the sum has a fixed order."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from kickdrift.forces.bonded.kernel import clear_along, note_along
from kickdrift.forces.seam.kernel import OK, kernel
from kickdrift.jit.compile import never_inline
from kickdrift.model.box.cell import Cell, cell_of, follow, nearest_image

if TYPE_CHECKING:
    from kickdrift.model.state import Floats
    from kickdrift.model.subject import Subject


class RestraintKernel(NamedTuple):
    """A restraint bound to a System."""

    particles: NDArray[np.int64]  # (m,)
    stiffness: Floats  # (3,)
    fractions: Floats  # (3, m) reference positions in edge vectors of the box, and as lengths along open axes
    inverse_masses: Floats  # (m,)
    scales: bool  # whether the places move with the box, so that there is a virial
    cell: Cell
    along: Any = None  # (1, 3) virial along each axis, for a barostat; else None


def bind(particles: Any, stiffness: Any, fractions: Floats, scales: bool, system: Subject) -> RestraintKernel:
    """Bind a restraint whose reference positions are these fractions (m, 3) of the box."""
    held = np.array(particles, np.int64)
    return RestraintKernel(
        held,
        np.array(np.broadcast_to(stiffness, 3), float),
        np.ascontiguousarray(fractions.T),
        1.0 / system.coherent_masses[held],
        scales,
        cell_of(system.box),
    )


@kernel(RestraintKernel)
def restraint_forces(force, t, x, v, a, sums):
    never_inline()
    follow(force.cell)
    if sums is not None:
        clear_along(force.along)
    matrix, d, energy, virial = force.cell.matrix, np.empty(3, x.dtype), 0.0, 0.0
    for m in range(force.particles.size):
        i = force.particles[m]
        for axis in range(3):
            place = force.fractions[axis, m] if matrix[axis, axis] == 0.0 else 0.0
            for k in range(3):
                place += force.fractions[k, m] * matrix[k, axis]
            d[axis] = x[axis, i] - place
        nearest_image(force.cell, d)
        for axis in range(3):
            pull = force.stiffness[axis] * d[axis]
            a[axis, i] -= pull * force.inverse_masses[m]
            if sums is not None:
                energy += 0.5 * pull * d[axis]
                virial -= pull * d[axis]
                note_along(force.along, axis, pull, d)
    if sums is not None:
        sums[0] += energy
        sums[1] += virial if force.scales else 0.0
    return OK

"""Slabs: boxes that are open along z. Ewald's sum with vacuum between the slab and its images, and a correction.

The box of the sum is the slab's with a longer edge z. The correction makes the field of the slab's dipole that of a
slab in vacuum (Yeh & Berkowitz 1999, doi:10.1063/1.479595). What is left falls as exp(-2 pi gap / L), with the gap
between images and the longest period L of the plane (Arnold, de Joannis & Holm 2002, doi:10.1063/1.1491955).
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from kickdrift.forces.seam.kernel import OK, kernel, run_body
from kickdrift.jit.compile import jit, never_inline
from kickdrift.model.box.box import Box
from kickdrift.model.state import Floats

MARGIN = 0.5  # longest periods beyond the gap that the estimate asks for
PLANE = (True, True, False)


def is_slab(box: Box) -> bool:
    """Tell whether a box is periodic along x and y, and open along z."""
    return box.periodic_axes == PLANE


def space_of(box: Box, accuracy: float) -> Box:
    """The box of Ewald's sum for a slab, periodic along three axes. The edge z of ``box`` is the slab's thickness."""
    matrix = box.matrix
    reciprocal = np.linalg.inv(matrix[:2, :2])  # its columns
    vectors = [reciprocal @ (i, j) for i in range(-2, 3) for j in range(-2, 3) if i or j]
    longest = 1.0 / min(float(np.linalg.norm(each)) for each in vectors)
    gap = max(longest * (MARGIN - math.log(accuracy) / (2.0 * math.pi)), 0.5 * float(box.heights.min()))
    matrix[2] = 0.0, 0.0, box.matrix[2, 2] + gap
    return Box(matrix=matrix)


class SlabFar(NamedTuple):
    """Far part of the charges of a slab, bound to a System."""

    far: Any  # the far part in the box with vacuum
    pull: float  # 4 pi / volume of that box
    charges: NDArray[np.float64]  # (n,) scaled by the root of Coulomb's constant
    inverse_masses: NDArray[np.float64]  # (n,)


def bind(far: Any, space: Box, charges: Floats, masses: Floats) -> SlabFar:
    """Parts for a far part that is bound in the box ``space``, and for charges and coherent masses (n,)."""
    return SlabFar(far, 4.0 * math.pi / space.volume, charges, 1.0 / masses)


@kernel(SlabFar)
def slab_body(force, t, x, v, a, sums):
    status = run_body(force.far, t, x, v, a, sums)
    if status != OK:
        return status
    energy = add_dipole(force, x, a)
    if sums is not None:
        sums[0] += energy
        sums[1] += energy  # it falls as 1 / length
    return OK


@jit
def add_dipole(force, x, a):
    """Add the accelerations by the dipole's field along z. Return the energy."""
    never_inline()
    moment = 0.0
    for i in range(force.charges.size):
        moment += force.charges[i] * x[2, i]
    for i in range(force.charges.size):
        a[2, i] -= force.pull * moment * force.charges[i] * force.inverse_masses[i]
    return 0.5 * force.pull * moment * moment

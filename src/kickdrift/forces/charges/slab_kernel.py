"""The far part of the charges of a slab in compiled code: that of its longer box, and the field of the dipole."""

import math
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from kickdrift.forces.seam.kernel import OK, kernel, run_body
from kickdrift.jit.compile import jit, never_inline
from kickdrift.model.box.box import Box
from kickdrift.model.state import Floats


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

"""Compiled springs. They run on one thread, so every sum has a fixed order."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from kickdrift.forces.kernel import OK, kernel
from kickdrift.jit.compile import never_inline
from kickdrift.model.cell import Cell, nearest_image


class SpringsKernel(NamedTuple):
    """Springs bound to a System."""

    pairs: NDArray[np.int64]  # (springs, 2)
    stiffness: NDArray[np.float64]  # (springs,)
    length: NDArray[np.float64]  # (springs,)
    cell: Cell
    inverse_masses: NDArray[np.float64]  # (n,)


@kernel(SpringsKernel)
def spring_forces(force, t, x, v, a, sums):
    never_inline()
    pairs, inverse_masses = force.pairs, force.inverse_masses
    d = np.empty(3, x.dtype)
    energy = virial = 0.0
    for s in range(pairs.shape[0]):
        i, j = pairs[s, 0], pairs[s, 1]
        for k in range(3):
            d[k] = x[k, i] - x[k, j]
        r = math.sqrt(nearest_image(force.cell, d))
        stretch = r - force.length[s]
        tension = force.stiffness[s] * stretch
        over_r = tension / r if r != 0.0 else 0.0  # a spring of length 0 has no direction, so no force
        for k in range(3):
            a[k, i] -= over_r * d[k] * inverse_masses[i]
            a[k, j] += over_r * d[k] * inverse_masses[j]
        if sums is not None:
            energy += 0.5 * tension * stretch
            virial -= tension * r
    if sums is not None:
        sums[0] += energy
        sums[1] += virial
        sums[2] += pairs.shape[0]
    return OK

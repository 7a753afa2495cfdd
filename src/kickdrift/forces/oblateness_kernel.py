"""Compiled zonal harmonics. Their time is linear in the number of bodies, so they run on one thread in one order."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from kickdrift.forces.kernel import OK, kernel
from kickdrift.jit.compile import never_inline
from kickdrift.jit.memory import flat
from kickdrift.jit.vector3 import dot, numbers3, store3, thrice


class OblatenessKernel(NamedTuple):
    """The harmonics bound to a System."""

    central: int
    gm: float  # G M of the central body
    j2: float  # J2 R^2
    j4: float  # J4 R^4
    pole: NDArray[np.float64]  # (3,) of length 1
    share: NDArray[np.float64]  # (n,) m / M: the central body's share of a body's acceleration
    masses: NDArray[np.float64]  # (n,) coherent


@kernel(OblatenessKernel)
def oblateness_forces(force, t, x, v, a, sums):
    """Add the forces. -grad of J_n R^n P_n(s) / r^(n+1) is J_n R^n / r^(n+2) [P'_(n+1)(s) r / |r| - P'_n(s) pole],
    since s P'_n + (n + 1) P_n = P'_(n+1)."""
    never_inline()
    c, gm, j2, j4 = force.central, force.gm, force.j2, force.j4
    n, x, a = x.shape[1], flat(x), flat(a)
    xc, pole, back = numbers3(x, c, n), numbers3(force.pole, 0, 1), thrice(0.0)
    energy = virial = 0.0
    for i in range(n):
        if i == c:
            continue
        d = numbers3(x, i, n) - xc
        inverse2 = 1.0 / dot(d, d)
        inverse = math.sqrt(inverse2)
        s = dot(d, pole) * inverse
        s2 = s * s
        two, four = j2 * inverse2, j4 * inverse2 * inverse2
        slope2, slope3 = 3.0 * s, 1.5 * (5.0 * s2 - 1.0)
        slope4, slope5 = 2.5 * s * (7.0 * s2 - 3.0), 1.875 * ((21.0 * s2 - 14.0) * s2 + 1.0)
        along = gm * inverse2 * inverse * (two * slope3 + four * slope5)
        across = gm * inverse2 * (two * slope2 + four * slope4)
        acceleration = along * d - across * pole
        store3(a, i, n, numbers3(a, i, n) + acceleration)
        back = back + force.share[i] * acceleration
        if sums is not None:
            u2 = 0.5 * two * (3.0 * s2 - 1.0)
            u4 = 0.125 * four * ((35.0 * s2 - 30.0) * s2 + 3.0)
            energy += force.masses[i] * gm * inverse * (u2 + u4)
            virial += force.masses[i] * gm * inverse * (3.0 * u2 + 5.0 * u4)  # U_n ~ r^-(n+1)
    store3(a, c, n, numbers3(a, c, n) - back)
    if sums is not None:
        sums[0] += energy
        sums[1] += virial
        sums[2] += n - 1
    return OK

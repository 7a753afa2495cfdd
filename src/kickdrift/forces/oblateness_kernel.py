"""The compiled zonal harmonics. Their time grows as the bodies do, so they run on one thread in one order."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from numpy.typing import NDArray

from kickdrift.forces.central import Attraction
from kickdrift.forces.kernel import OK, kernel
from kickdrift.jit.compile import never_inline

if TYPE_CHECKING:
    from kickdrift.forces.oblateness import Oblateness
    from kickdrift.model.system import System


class OblatenessKernel(NamedTuple):
    """The harmonics bound to a System."""

    central: int
    gm: float  # G M of the central body
    j2: float  # J2 R^2
    j4: float  # J4 R^4
    pole: NDArray[np.float64]  # (3,) of length 1
    share: NDArray[np.float64]  # (n,) m / M: what the central body takes of a body's acceleration
    masses: NDArray[np.float64]  # (n,) coherent


def bind(force: Oblateness, system: System) -> OblatenessKernel:
    """The force for this System."""
    central, gm, share, masses = Attraction.of(force, system)
    j2, j4 = force.j2 * force.radius**2, force.j4 * force.radius**4
    return OblatenessKernel(central, gm, j2, j4, np.array(force.axis), share, masses)


@kernel(OblatenessKernel)
def oblateness_forces(force, t, x, v, a, sums):
    """-grad of J_n R^n P_n(s) / r^(n+1) is J_n R^n / r^(n+2) [P'_(n+1)(s) r / |r| - P'_n(s) pole], as s P'_n + (n + 1)
    P_n = P'_(n+1)."""
    never_inline()
    c, gm, j2, j4 = force.central, force.gm, force.j2, force.j4
    pole_x, pole_y, pole_z = force.pole[0], force.pole[1], force.pole[2]
    back_x = back_y = back_z = energy = virial = 0.0
    for i in range(x.shape[1]):
        if i == c:
            continue
        dx, dy, dz = x[0, i] - x[0, c], x[1, i] - x[1, c], x[2, i] - x[2, c]
        inverse2 = 1.0 / (dx * dx + dy * dy + dz * dz)
        inverse = math.sqrt(inverse2)
        s = (dx * pole_x + dy * pole_y + dz * pole_z) * inverse
        s2 = s * s
        two, four = j2 * inverse2, j4 * inverse2 * inverse2
        slope2, slope3 = 3.0 * s, 1.5 * (5.0 * s2 - 1.0)
        slope4, slope5 = 2.5 * s * (7.0 * s2 - 3.0), 1.875 * ((21.0 * s2 - 14.0) * s2 + 1.0)
        along = gm * inverse2 * inverse * (two * slope3 + four * slope5)
        across = gm * inverse2 * (two * slope2 + four * slope4)
        ax, ay, az = along * dx - across * pole_x, along * dy - across * pole_y, along * dz - across * pole_z
        a[0, i] += ax
        a[1, i] += ay
        a[2, i] += az
        share = force.share[i]
        back_x += share * ax
        back_y += share * ay
        back_z += share * az
        if sums is not None:
            u2 = 0.5 * two * (3.0 * s2 - 1.0)
            u4 = 0.125 * four * ((35.0 * s2 - 30.0) * s2 + 3.0)
            energy += force.masses[i] * gm * inverse * (u2 + u4)
            virial += force.masses[i] * gm * inverse * (3.0 * u2 + 5.0 * u4)  # U_n ~ r^-(n+1)
    a[0, c] -= back_x
    a[1, c] -= back_y
    a[2, c] -= back_z
    if sums is not None:
        sums[0] += energy
        sums[1] += virial
        sums[2] += x.shape[1] - 1
    return OK

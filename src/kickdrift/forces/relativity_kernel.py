"""Compiled 1PN correction. Its time is linear in the number of bodies, so it runs on one thread in one order."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from kickdrift.forces.kernel import OK, kernel
from kickdrift.jit.compile import jit, never_inline
from kickdrift.jit.memory import flat
from kickdrift.jit.vector3 import dot, numbers3, store3, thrice


class RelativityKernel(NamedTuple):
    """The correction bound to a System."""

    central: int
    gm: float  # G M of the central body
    light2: float  # c^2
    full: bool
    share: NDArray[np.float64]  # (n,) m / M: the central body's share of a body's acceleration
    masses: NDArray[np.float64]  # (n,) coherent


@jit
def energy_of_the_full_form(gm_over_r, v2, share):
    """Return c^2 E_1 / m of a body of mass ``share`` M, so that E + E_1 is constant to order c^-4 along r'' = -g (1 +
    share) r / r^3 + (1 + share) a_1PN, g = G M.

    Its rate must be -v . a_1PN = -g (r . v) (3 v^2 + 4 g / r) / (c^2 r^3). With v^4, v^2 g / r and (g / r)^2 this
    leaves one coefficient free. The coefficient of v^2 is the test body's, 3 / 2, and at share = 0 all three are the
    test body's.
    """
    return 0.375 / (1.0 + share) * v2 * v2 + 1.5 * gm_over_r * v2 + (0.5 - 1.5 * share) * gm_over_r * gm_over_r


@kernel(RelativityKernel)
def relativity_forces(force, t, x, v, a, sums):
    never_inline()
    c, gm, light2 = force.central, force.gm, force.light2
    n, x, v, a = x.shape[1], flat(x), flat(v), flat(a)
    back = thrice(0.0)
    energy = virial = 0.0
    for i in range(n):
        if i == c:
            continue
        d, u = numbers3(x, i, n) - numbers3(x, c, n), numbers3(v, i, n) - numbers3(v, c, n)
        r2, v2, rv = dot(d, d), dot(u, u), dot(d, u)
        inverse = 1.0 / math.sqrt(r2)
        gm_over_r = gm * inverse
        if force.full:
            scale = gm_over_r * inverse * inverse / light2
            along, across = scale * (4.0 * gm_over_r - v2), 4.0 * scale * rv
        else:
            along, across = -6.0 * gm_over_r * gm_over_r * inverse * inverse / light2, 0.0
        acceleration = along * d + across * u
        store3(a, i, n, numbers3(a, i, n) + acceleration)
        share = force.share[i]
        back = back + share * acceleration
        if sums is not None:
            m = force.masses[i]
            virial += m * dot(acceleration, d)
            if force.full:
                energy += m * energy_of_the_full_form(gm_over_r, v2, share) / light2
            else:
                energy -= 3.0 * m * gm_over_r * gm_over_r / light2
    store3(a, c, n, numbers3(a, c, n) - back)
    if sums is not None:
        sums[0] += energy
        sums[1] += virial
        sums[2] += n - 1
    return OK

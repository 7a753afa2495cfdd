"""Direct sum of gravity together with its slope along a direction.

Along the velocities the slope is the time derivative: the jerk of Hermite methods. Along a deviation vector it is the
right-hand side of the variational equations.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from numpy.typing import NDArray

from kickdrift.forces.laws.central import gravitational_constant
from kickdrift.jit.compile import jit
from kickdrift.jit.lanes.functions import lane_numbers, splat
from kickdrift.jit.lanes.masks import select
from kickdrift.jit.lanes.memory import load
from kickdrift.jit.lanes.vector3 import dot, lane_sums, load3, numbers3, store3, thrice
from kickdrift.jit.lanes.vectors import WIDTH

if TYPE_CHECKING:
    from kickdrift.forces.gravity.direct import Gravity
    from kickdrift.model.subject import Subject


class Sources(NamedTuple):
    """Attracting bodies, padded with massless ones to a multiple of eight, and the results for them."""

    softening2: float
    gm: NDArray[np.float64]  # (slots,) G m
    x: NDArray[np.float64]  # (3, slots) positions
    u: NDArray[np.float64]  # (3, slots) velocities or deviations
    a: NDArray[np.float64]  # (3, n) accelerations
    slope: NDArray[np.float64]  # (3, n) change of the accelerations when each body moves along its u


def sources_of(force: Gravity, system: Subject) -> Sources:
    """Bind the force to a System."""
    n = len(system)
    slots = WIDTH * -(-n // WIDTH)
    gm = np.zeros(slots)
    gm[:n] = gravitational_constant(force.name, force.G, system) * system.state.masses
    return Sources(
        force.softening**2, gm, np.zeros((3, slots)), np.zeros((3, slots)), np.zeros((3, n)), np.zeros((3, n))
    )


@jit
def acceleration_and_slope(sources, i):
    """Compute a = sum G m d / r^3 and its slope sum G m (u - 3 d (d . u) / r^2) / r^3 for body i.

    d and u are the sources' values minus the body's own, and r^2 = d^2 + softening^2 (Makino & Aarseth 1992,
    doi:10.1093/pasj/44.2.141, eqs. 1 and 2).
    """
    gm, softening2, zero = sources.gm, sources.softening2, splat(0.0)
    slots, n = gm.size, sources.a.shape[1]
    xi, ui = numbers3(sources.x, i, slots), numbers3(sources.u, i, slots)
    a, slope = thrice(zero), thrice(zero)
    for j in range(0, slots, WIDTH):
        d, u = load3(sources.x, j, slots) - xi, load3(sources.u, j, slots) - ui
        source = select(lane_numbers() == float(i - j), zero, load(gm, j))  # all bodies but the body itself
        massive = source > 0.0
        inverse = 1.0 / math.sqrt(dot(d, d) + softening2)
        inverse2 = inverse * inverse
        w = select(massive, source * inverse * inverse2, zero)
        along = select(massive, 3.0 * inverse2 * dot(d, u), zero)
        a, slope = a + w * d, slope + w * (u - along * d)
    store3(sources.a, i, n, lane_sums(a))
    store3(sources.slope, i, n, lane_sums(slope))

"""Gravity in many small systems at once, one system in each lane.

Eight systems with equal numbers of bodies stand side by side, body by body and axis by axis. Every sum is a plain loop
and no operation mixes lanes. So no system affects another, and a system's bits do not depend on its lane.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from kickdrift.jit.compile import driver, in_order
from kickdrift.jit.handle import handle, unowned
from kickdrift.jit.lanes.functions import inverse_sqrt, splat
from kickdrift.jit.lanes.memory import load, store
from kickdrift.jit.lanes.vector3 import cross, dot, load3, plus_dot, store3, thrice
from kickdrift.jit.lanes.vectors import WIDTH

# Rows of a sample: energies, momentum, angular momentum about the origin.
KINETIC, POTENTIAL, MOMENTUM, ANGULAR = 0, 1, 2, 5
LOOK = 8


class LaneBodies(NamedTuple):
    """Constant data of eight systems.

    Arrays of positions, velocities and accelerations are (3, n, 8), or (3, 2 n, 8) with deviations after the bodies."""

    gm: NDArray[np.float64]  # (n, 8) G m
    masses: NDArray[np.float64]  # (n, 8) coherent
    softening2: NDArray[np.float64]  # (8,)


@in_order
def accelerations_in_lanes(bodies, x, a):
    """Write the accelerations at x to a, counting each pair once. For deviations, write the slope of the accelerations
    along the deviations (formulas and sources are in ``slope``)."""
    gm, n, rows = bodies.gm, bodies.gm.shape[0], x.shape[1]
    softening2 = load(bodies.softening2, 0)
    stride, behind, varied = rows * WIDTH, n * WIDTH, rows > n
    zero = splat(0.0)
    for p in range(0, 3 * stride, WIDTH):
        store(a, p, zero)
    for p in range(0, behind - WIDTH, WIDTH):
        xi, ai, gm_i = load3(x, p, stride), load3(a, p, stride), load(gm, p)
        ui, si = thrice(zero), thrice(zero)
        if varied:
            ui, si = load3(x, p + behind, stride), load3(a, p + behind, stride)
        for q in range(p + WIDTH, behind, WIDTH):
            d, gm_j = load3(x, q, stride) - xi, load(gm, q)
            inverse = inverse_sqrt(plus_dot(softening2, d, d))
            inverse2 = inverse * inverse
            cube = inverse * inverse2
            wi, wj = gm_j * cube, gm_i * cube
            ai = ai + wi * d
            store3(a, q, stride, load3(a, q, stride) - wj * d)
            if varied:
                e = load3(x, q + behind, stride) - ui
                e = e - 3.0 * inverse2 * dot(d, e) * d
                si = si + wi * e
                store3(a, q + behind, stride, load3(a, q + behind, stride) - wj * e)
        store3(a, p, stride, ai)
        if varied:
            store3(a, p + behind, stride, si)


@in_order
def look_in_lanes(bodies, x, v, found):
    """Write energies and momenta of the bodies to found (LOOK, 8)."""
    gm, masses, n = bodies.gm, bodies.masses, bodies.gm.shape[0]
    softening2 = load(bodies.softening2, 0)
    stride, end = x.shape[1] * WIDTH, n * WIDTH
    zero = splat(0.0)
    kinetic, potential = zero, zero
    momentum, angular = thrice(zero), thrice(zero)
    for p in range(0, end, WIDTH):
        xi, vi = load3(x, p, stride), load3(v, p, stride)
        m, gm_i = load(masses, p), load(gm, p)
        kinetic = kinetic + m * dot(vi, vi)
        momentum, angular = momentum + m * vi, angular + m * cross(xi, vi)
        for q in range(p + WIDTH, end, WIDTH):
            d = load3(x, q, stride) - xi
            inverse = inverse_sqrt(plus_dot(softening2, d, d))
            potential = potential - gm_i * load(masses, q) * inverse
    store(found, KINETIC * WIDTH, 0.5 * kinetic)
    store(found, POTENTIAL * WIDTH, potential)
    store3(found, MOMENTUM * WIDTH, WIDTH, momentum)
    store3(found, ANGULAR * WIDTH, WIDTH, angular)


@driver
def measure_in_lanes(bodies, y, a, found):
    """Write accelerations to a, and the values of ``look_in_lanes`` to found (LOOK, 8), at y (2, 3, n or 2 n, 8)."""
    bound, y = handle(bodies), unowned(y)
    accelerations_in_lanes(bound, y[0], unowned(a))
    look_in_lanes(bound, y[0], y[1], unowned(found))

"""Gravity in many small systems at once: a lane is a system.

Eight systems of as many bodies stand side by side, body by body and axis by axis, so that every sum is a plain loop and
nothing goes across lanes: what a system does depends on no other, and its bits neither on the lane it is in.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from kickdrift.jit.compile import driver, in_order
from kickdrift.jit.handle import handle, unowned
from kickdrift.jit.lanes import inverse_sqrt, splat
from kickdrift.jit.memory import load, store
from kickdrift.jit.vectors import WIDTH

# Rows of a look: energies, momentum, angular momentum about the origin.
KINETIC, POTENTIAL, MOMENTUM, ANGULAR = 0, 1, 2, 5
LOOK = 8


class LaneBodies(NamedTuple):
    """What of eight systems does not change. Arrays of positions, velocities and accelerations are (3, n, 8), or
    (3, 2 n, 8) where deviations ride along behind the bodies."""

    gm: NDArray[np.float64]  # (n, 8) G m
    masses: NDArray[np.float64]  # (n, 8) coherent
    softening2: NDArray[np.float64]  # (8,)


@in_order
def load3(array, p, stride):
    """Eight x, y and z from ``p`` on."""
    return load(array, p), load(array, p + stride), load(array, p + 2 * stride)


@in_order
def store3(array, p, stride, vector):
    store(array, p, vector[0])
    store(array, p + stride, vector[1])
    store(array, p + 2 * stride, vector[2])


@in_order
def pull_in_lanes(bodies, x, a):
    """a <- the accelerations at x, each pair once; of deviations, the slope of these along them (the formulas and their
    sources are in ``gravity_slope``)."""
    gm, n, rows = bodies.gm, bodies.gm.shape[0], x.shape[1]
    softening2 = load(bodies.softening2, 0)
    stride, behind, varied = rows * WIDTH, n * WIDTH, rows > n
    zero = splat(0.0)
    for p in range(0, 3 * stride, WIDTH):
        store(a, p, zero)
    for p in range(0, behind - WIDTH, WIDTH):
        xi, yi, zi = load3(x, p, stride)
        ax, ay, az = load3(a, p, stride)
        gm_i = load(gm, p)
        ux, uy, uz, sx, sy, sz = zero, zero, zero, zero, zero, zero
        if varied:
            ux, uy, uz = load3(x, p + behind, stride)
            sx, sy, sz = load3(a, p + behind, stride)
        for q in range(p + WIDTH, behind, WIDTH):
            xj, yj, zj = load3(x, q, stride)
            bx, by, bz = load3(a, q, stride)
            gm_j = load(gm, q)
            dx, dy, dz = xj - xi, yj - yi, zj - zi
            inverse = inverse_sqrt(softening2 + dx * dx + dy * dy + dz * dz)
            inverse2 = inverse * inverse
            cube = inverse * inverse2
            wi, wj = gm_j * cube, gm_i * cube
            ax, ay, az = ax + wi * dx, ay + wi * dy, az + wi * dz
            store3(a, q, stride, (bx - wj * dx, by - wj * dy, bz - wj * dz))
            if varied:
                vx, vy, vz = load3(x, q + behind, stride)
                ex, ey, ez = vx - ux, vy - uy, vz - uz
                along = 3.0 * inverse2 * (dx * ex + dy * ey + dz * ez)
                ex, ey, ez = ex - along * dx, ey - along * dy, ez - along * dz
                sx, sy, sz = sx + wi * ex, sy + wi * ey, sz + wi * ez
                bx, by, bz = load3(a, q + behind, stride)
                store3(a, q + behind, stride, (bx - wj * ex, by - wj * ey, bz - wj * ez))
        store3(a, p, stride, (ax, ay, az))
        if varied:
            store3(a, p + behind, stride, (sx, sy, sz))


@in_order
def look_in_lanes(bodies, x, v, found):
    """found (LOOK, 8) <- energies and momenta of the bodies."""
    gm, masses, n = bodies.gm, bodies.masses, bodies.gm.shape[0]
    softening2 = load(bodies.softening2, 0)
    stride, end = x.shape[1] * WIDTH, n * WIDTH
    zero = splat(0.0)
    kinetic, potential = zero, zero
    px, py, pz, lx, ly, lz = zero, zero, zero, zero, zero, zero
    for p in range(0, end, WIDTH):
        xi, yi, zi = load3(x, p, stride)
        vx, vy, vz = load3(v, p, stride)
        m, gm_i = load(masses, p), load(gm, p)
        kinetic = kinetic + m * (vx * vx + vy * vy + vz * vz)
        px, py, pz = px + m * vx, py + m * vy, pz + m * vz
        lx, ly, lz = lx + m * (yi * vz - zi * vy), ly + m * (zi * vx - xi * vz), lz + m * (xi * vy - yi * vx)
        for q in range(p + WIDTH, end, WIDTH):
            xj, yj, zj = load3(x, q, stride)
            dx, dy, dz = xj - xi, yj - yi, zj - zi
            inverse = inverse_sqrt(softening2 + dx * dx + dy * dy + dz * dz)
            potential = potential - gm_i * load(masses, q) * inverse
    store(found, KINETIC * WIDTH, 0.5 * kinetic)
    store(found, POTENTIAL * WIDTH, potential)
    store3(found, MOMENTUM * WIDTH, WIDTH, (px, py, pz))
    store3(found, ANGULAR * WIDTH, WIDTH, (lx, ly, lz))


@driver
def measure_in_lanes(bodies, y, a, found):
    """a <- accelerations, found (LOOK, 8) <- what ``look_in_lanes`` sees, at y (2, 3, n or 2 n, 8)."""
    bound, y = handle(bodies), unowned(y)
    pull_in_lanes(bound, y[0], unowned(a))
    look_in_lanes(bound, y[0], y[1], unowned(found))

"""Attraction of a tree's nodes and particles on the clusters of a group, eight particles at a time."""

from __future__ import annotations

from kickdrift.forces.tree.build import (
    CX,
    GM,
    TRACE,
    XX,
    XY,
    XZ,
    YY,
    YZ,
    ZZ,
)
from kickdrift.jit.compile import as_written
from kickdrift.jit.lanes.functions import inverse_sqrt, lane_numbers, splat
from kickdrift.jit.lanes.masks import select
from kickdrift.jit.lanes.memory import load, store
from kickdrift.jit.lanes.vector3 import dot, load3, numbers3, store3, vector3
from kickdrift.jit.lanes.vectors import WIDTH


@as_written
def add_nodes(force, potential, first, last, found, count):
    """Add the attraction of nodes: mass M and second moments S about the centre, for the softened U = -G / sqrt(r^2 +
    softening^2).

    With D from the centre and u = 1 / sqrt(D^2 + softening^2), the potential is -G [M u + (3 D.S.D u^5 - tr S u^3) /
    2]. Without softening this is the traceless quadrupole's potential.
    """
    softening2, stride = force.softening2, force.gm.size
    for s in range(WIDTH * first, WIDTH * last, WIDTH):
        x, a = load3(force.x, s, stride), load3(force.a, s, stride)
        phi = splat(0.0)
        for f in range(count):
            row = force.nodes[found[f]]
            d = x - numbers3(row, CX, 1)
            u = inverse_sqrt(dot(d, d) + softening2)
            u2 = u * u
            u3 = u2 * u
            u5 = u2 * u3
            moments_x, moments_y = vector3(row[XX], row[XY], row[XZ]), vector3(row[XY], row[YY], row[YZ])
            moments_z = vector3(row[XZ], row[YZ], row[ZZ])
            moments = vector3(dot(moments_x, d), dot(moments_y, d), dot(moments_z, d))  # 3 S D
            q = dot(moments, d)
            w = u5 * (row[TRACE] - 2.5 * q * u2) - row[GM] * u3
            a = a + (u5 * moments + w * d)
            if potential is not None:
                phi = phi - (row[GM] * u + 0.5 * q * u5 - row[TRACE] / 3.0 * u3)
        store3(force.a, s, stride, a)
        if potential is not None:
            store(potential, s, load(potential, s) + phi)


@as_written
def add_particles(force, potential, first, last, near, count):
    """Add the attraction of the particles of clusters, one by one."""
    softening2, gm, stride, zero = force.softening2, force.gm, force.gm.size, splat(0.0)
    for s in range(WIDTH * first, WIDTH * last, WIDTH):
        x, a = load3(force.x, s, stride), load3(force.a, s, stride)
        phi = zero
        for f in range(count):
            start = WIDTH * near[f]
            for j in range(start, start + WIDTH):
                source = gm[j]
                if source == 0.0:
                    continue
                d = numbers3(force.x, j, stride) - x
                u = inverse_sqrt(dot(d, d) + softening2)
                if start == s:  # all particles but the particle itself
                    u = select(lane_numbers() == float(j - start), zero, u)
                w = source * u
                if potential is not None:
                    phi = phi - w
                a = a + w * u * u * d
        store3(force.a, s, stride, a)
        if potential is not None:
            store(potential, s, load(potential, s) + phi)

"""Walk of a group of particles through the tree, and the attraction of nodes and particles, eight at a time."""

from __future__ import annotations

import math

import numpy as np

from kickdrift.forces.tree.build import (
    BEYOND,
    BOUND,
    CX,
    FIRST,
    GM,
    RADIUS,
    TRACE,
    XX,
    XY,
    XZ,
    YY,
    YZ,
    ZZ,
)
from kickdrift.jit.compile import as_written
from kickdrift.jit.lanes.functions import inverse_sqrt, lane_max, lane_numbers, splat
from kickdrift.jit.lanes.masks import select
from kickdrift.jit.lanes.memory import load, store
from kickdrift.jit.lanes.vector3 import dot, lane_sums, load3, numbers3, store3, thrice, vector3
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


GROUP_CLUSTERS = 8  # clusters that walk together, one lane each in the estimate of their acceleration
OPENING_ANGLE = 0.6  # largest radius over distance of a whole node, for the estimate of |a|
BUFFER = 256  # nodes, or clusters, between two sums of their attraction


@as_written
def walk(force, potential, group):
    """Find the nodes and particles that attract a group, and sum their attraction."""
    first, last = force.span[group, 0], force.span[group, 1]
    zero = splat(0.0)
    for s in range(WIDTH * first, WIDTH * last, WIDTH):
        store3(force.a, s, force.gm.size, thrice(zero))
        if potential is not None:
            store(potential, s, zero)
    low, high = bounding_box(force, first, last)
    tolerance = force.tolerance * least_acceleration(force, first, last, low, high)
    nodes = force.nodes
    found, near = np.empty(BUFFER, np.int64), np.empty(BUFFER, np.int64)
    n_found = n_near = 0
    k = 0
    while k < nodes.shape[0]:
        row = nodes[k]
        cluster, beyond = int(row[FIRST]), int(row[BEYOND])
        if row[GM] == 0.0:
            k = beyond
            continue
        d2 = distance2(row, low, high)
        d, radius = math.sqrt(d2), row[RADIUS]
        if d > radius and row[BOUND] <= tolerance * d2 * d * (d - radius) * (d - radius):
            found[n_found] = k
            n_found += 1
            if n_found == BUFFER:
                add_nodes(force, potential, first, last, found, n_found)
                n_found = 0
            k = beyond
            continue
        if beyond == k + 1:
            near[n_near] = cluster
            n_near += 1
            if n_near == BUFFER:
                add_particles(force, potential, first, last, near, n_near)
                n_near = 0
        k += 1
    add_nodes(force, potential, first, last, found, n_found)
    add_particles(force, potential, first, last, near, n_near)


@as_written
def bounding_box(force, first, last):
    """Lowest and highest x, y, z of clusters first to last."""
    low, high = np.empty(3), np.empty(3)
    for k in range(3):
        x = force.x[k]
        least, most = load(x, WIDTH * first), load(x, WIDTH * first)
        for s in range(WIDTH * first + WIDTH, WIDTH * last, WIDTH):
            here = load(x, s)
            least, most = select(here < least, here, least), select(here > most, here, most)
        low[k], high[k] = -lane_max(-least), lane_max(most)
    return low, high


@as_written
def distance2(row, low, high):
    """Squared distance from a node's centre of mass to the nearest point of a box."""
    total = 0.0
    for k in range(3):
        c = row[CX + k]
        d = max(low[k] - c, c - high[k], 0.0)
        total += d * d
    return total


@as_written
def least_acceleration(force, first, last, low, high):
    """Estimate the smallest |a| in a group from the smooth field of masses at its clusters' centres.

    A near cluster counts as spread over its radius, so no particle near a centre makes the estimate too large.
    """
    nodes, softening2 = force.nodes, force.softening2
    centre = np.empty((3, WIDTH))
    for lane in range(WIDTH):
        s = WIDTH * min(first + lane, last - 1)
        store3(centre, lane, WIDTH, 1.0 / WIDTH * lane_sums(load3(force.x, s, force.gm.size)))
    x, zero = load3(centre, 0, WIDTH), splat(0.0)
    a = thrice(zero)
    k = 0
    while k < nodes.shape[0]:
        row = nodes[k]
        cluster, beyond = int(row[FIRST]), int(row[BEYOND])
        if row[GM] == 0.0:
            k = beyond
            continue
        alone = beyond == k + 1
        radius = row[RADIUS]
        if alone or radius * radius < OPENING_ANGLE * OPENING_ANGLE * distance2(row, low, high):
            d = numbers3(row, CX, 1) - x
            spread = radius * radius + softening2 if alone else softening2
            inverse = inverse_sqrt(dot(d, d) + spread)
            w = row[GM] * inverse * inverse * inverse
            if alone and first <= cluster < last:
                w = select(lane_numbers() == float(cluster - first), zero, w)
                w = select(lane_numbers() >= float(last - first), zero, w)
            a = a + w * d
            k = beyond
        else:
            k += 1
    size2 = select(lane_numbers() < float(last - first), -dot(a, a), splat(-math.inf))
    return math.sqrt(-lane_max(size2))

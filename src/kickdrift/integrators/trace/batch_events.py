"""Steps of systems in lanes in which an event may happen: pairs within their distances, and bodies far out.

A bound in lanes clears most steps. The other steps go to a compiled test by its address (see
``kickdrift.batch.lane_events``), which follows the curves between step points and the paths of bodies that met.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from kickdrift.integrators.wisdom_holman.bodies import OTHERS, SOURCE
from kickdrift.jit.compile import in_order, jit
from kickdrift.jit.handle import status_at
from kickdrift.jit.lanes.functions import splat
from kickdrift.jit.lanes.masks import mask_bits, select
from kickdrift.jit.lanes.memory import load
from kickdrift.jit.lanes.vector3 import dot, load3, thrice
from kickdrift.jit.lanes.vectors import WIDTH


class Limits(NamedTuple):
    """Distances within which something may happen to eight systems. Pairs are i < j, with the central body first."""

    watched: bool
    lengths: NDArray[np.float64]  # (pairs, 8)
    fractions: NDArray[np.float64]  # (pairs, 8) of the mean distance from the central body
    touching: NDArray[np.float64]  # (pairs, 8) of bodies that touch; the lengths are no shorter
    far: NDArray[np.float64]  # (8,) distance of an escape; infinite if none is watched
    about: NDArray[np.float64]  # (8,) 1: from the centre of mass of the others; 0: from the central body
    before: NDArray[np.float64]  # (2, 3, n) positions from the central body and velocities, at a step's start
    after: NDArray[np.float64]  # (2, 3, n) the same at its end
    kept: NDArray[np.float64]  # (8, 2, 3, n) the start of the last step of each system, where an event may happen
    none: NDArray[np.int64]  # (COUNTS,) zeros: no points
    places: NDArray[np.int64]  # (n,) slot of each body, -1 for the central one


@in_order
def momentum_of(v, share):
    """Velocity of the central body, the other way."""
    stride = share.size
    total = thrice(splat(0.0))
    for p in range(0, stride, WIDTH):
        total = total + load(share, p) * load3(v, p, stride)
    return total


@in_order
def within(r0, r1, u0, u1, h, size2, length, fraction):
    """Mask of the lanes whose pair may come within its limit: the hull of Hermite's cubic, or the straight way from the
    step's start, may reach as far."""
    a, way, b = h * u0, r1 - r0, r1 - r0 - (h * (1.0 / 3.0)) * u1
    leg2, b2, way2 = dot(a, a), dot(b, b), dot(way, way)
    leg2 = select(b2 > leg2, b2, leg2)
    leg2 = select(way2 > leg2, way2, leg2)
    reach2 = length * length + fraction * fraction * size2
    return (reach2 > 0.0) & (dot(r0, r0) <= 2.0 * (reach2 + leg2))


@in_order
def may_happen(own, h):
    """Bits of the lanes in whose last step an event may have happened."""
    limits, orbits = own.limits, own.orbits
    x0, v0, x1, v1 = own.start[0], own.start[1], orbits.orbit[0], orbits.orbit[1]
    share, source = orbits.table[OTHERS], orbits.table[SOURCE]
    stride, pair = share.size, 0
    found = splat(0.0) > 1.0
    move0, move1 = momentum_of(v0, share), momentum_of(v1, share)
    total, mass = thrice(splat(0.0)), load(orbits.central, 0)
    for p in range(0, stride, WIDTH):
        a, b = load3(x0, p, stride), load3(x1, p, stride)
        u, w = load3(v0, p, stride) + move0, load3(v1, p, stride) + move1
        size2 = 4.0 * dot(b, b)  # more than any change within the step
        length, fraction = load(limits.lengths, pair), load(limits.fractions, pair)
        found = found | within(a, b, u, w, h, size2, length, fraction)
        total, mass = total + load(source, p) * b, mass + load(source, p)
        pair += WIDTH
    for p in range(0, stride, WIDTH):
        ai, bi = load3(x0, p, stride), load3(x1, p, stride)
        ui, wi = load3(v0, p, stride), load3(v1, p, stride)
        for q in range(p + WIDTH, stride, WIDTH):
            bj = load3(x1, q, stride)
            size2 = 2.0 * (dot(bi, bi) + dot(bj, bj))
            length, fraction = load(limits.lengths, pair), load(limits.fractions, pair)
            found = found | within(
                load3(x0, q, stride) - ai, bj - bi, load3(v0, q, stride) - ui, load3(v1, q, stride) - wi, h, size2,
                length, fraction,
            )  # fmt: skip
            pair += WIDTH
    far, about = load(limits.far, 0), load(limits.about, 0)
    for p in range(0, stride, WIDTH):
        m, b = load(source, p), load3(x1, p, stride)
        d = b - (about / (mass - m)) * (total - m * b)
        found = found | (dot(d, d) >= far * far)
    return mask_bits(found)


@jit
def put_lane(q, share, k, y):
    """y (2, 3, n) <- positions of the bodies of lane k from the central one, and velocities from the centre of mass."""
    for axis in range(3):
        y[0, axis, 0] = y[1, axis, 0] = 0.0
        for i in range(share.shape[0]):
            for half in range(2):
                y[half, axis, i + 1] = q[half, axis, i, k]
            y[1, axis, 0] -= share[i, k] * q[1, axis, i, k]


@jit
def happens(own, room, quiet_at, k, h, alone):
    """Tell whether an event may have happened in the last step of lane k, which was taken ``alone`` in ``room`` or with
    the other lanes."""
    limits, share = own.limits, own.orbits.table[OTHERS]
    put_lane(own.start, share, k, limits.before)
    put_lane(own.orbits.orbit, share, k, limits.after)
    for i in range(share.shape[0]):
        limits.places[i + 1] = own.slots[i, k]
    counts = room.counts if alone else limits.none
    given = (
        limits.before, limits.after, h, counts, room.path, limits.places, limits.lengths, limits.fractions,
        limits.touching, limits.far[k], limits.about[k], own.orbits.bodies.gm, k,
    )  # fmt: skip
    if status_at(quiet_at, given) != 0:
        return False
    limits.kept[k] = limits.before
    return True

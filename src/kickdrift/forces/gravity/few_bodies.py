"""Direct gravity among few bodies, whose numbers stay in registers."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from kickdrift.jit.compile import as_written
from kickdrift.jit.lanes.functions import inverse_sqrt, lane_numbers, lane_sum, rotated, splat
from kickdrift.jit.lanes.masks import select
from kickdrift.jit.lanes.memory import load, masked_load, masked_store
from kickdrift.jit.lanes.vector3 import dot, lane_sums, numbers3, plus_dot, rotated3, store3, thrice, vector3
from kickdrift.jit.lanes.vectors import WIDTH

FAR_AWAY = 1e60  # first position of empty lanes: no distance is zero, and no third power underflows
MOST_IN_REGISTERS = 2 * WIDTH  # most bodies kept in registers, without massless ones


class FewBodies(NamedTuple):
    """Gravity among few bodies."""

    softening2: float
    massive: int
    gm: NDArray[np.float64]  # (MOST_IN_REGISTERS,) G m
    masses: NDArray[np.float64]  # (MOST_IN_REGISTERS,) coherent


@as_written
def few_bodies(force, x, a, sums):
    """Sum all pairs of a few bodies, with x, y and z in rows. The first eight bodies form a ring, each further body
    meets these eight, and the further bodies form a ring. Nothing is stored in between."""
    n, softening2 = force.massive, force.softening2
    total_energy, total_virial = splat(0.0), splat(0.0)
    for first in range(0, max(n - 1, 1), WIDTH):  # a single further body has no ring
        count = min(n - first, WIDTH)
        y, z = masked_load(x, n + first, count), masked_load(x, 2 * n + first, count)
        xi = vector3(lanes_or_out(x, first, count), y, z)
        gm, masses = load(force.gm, first), load(force.masses, first)
        ai, energy, virial = ring(xi, gm, masses, softening2, sums)
        for j in range(first + WIDTH, n):
            d = numbers3(x, j, n) - xi
            r2 = dot(d, d)
            inverse = inverse_sqrt(softening2 + r2)
            cube = inverse * inverse * inverse
            ai = ai + force.gm[j] * cube * d
            if sums is not None:
                gmm = force.gm[j] * masses
                energy, virial = energy - gmm * inverse, virial - gmm * cube * r2
            store3(a, j, n, numbers3(a, j, n) - lane_sums(gm * cube * d))
        for row, acceleration in enumerate((ai.x, ai.y, ai.z)):
            own = row * n + first
            masked_store(a, own, masked_load(a, own, count) + acceleration, count)
        if sums is not None:
            total_energy, total_virial = total_energy + energy, total_virial + virial
    if sums is not None:
        sums[0] += lane_sum(total_energy)
        sums[1] += lane_sum(total_virial)
        sums[2] += 0.5 * n * (n - 1)


@as_written
def lanes_or_out(x, first, count):
    """Load ``count`` values, and fill the other lanes with FAR_AWAY."""
    lanes = lane_numbers()
    return select(lanes < float(count), masked_load(x, first, count), FAR_AWAY * (lanes + 1.0))


@as_written
def ring(xi, gm_i, masses, softening2, sums):
    """Sum the pairs of eight bodies in a ring.

    Each body attracts the next, second and third, which give back the reaction. Opposite bodies compute one half each.
    Missing bodies have no mass and are at FAR_AWAY. Returns accelerations, energy and virial, in lanes.
    """
    zero = splat(0.0)
    energy, virial = zero, zero
    a, reaction = thrice(zero), thrice(zero)
    xj, gm_j = xi, gm_i
    for turn in range(4):
        xj, gm_j, reaction = rotated3(xj, 1), rotated(gm_j, 1), rotated3(reaction, 1)
        d = xj - xi
        inverse = inverse_sqrt(plus_dot(softening2, d, d))
        cube = inverse * inverse * inverse
        a = a + gm_j * cube * d
        if turn < 3:
            w = -gm_i * cube
            reaction = reaction + w * d
        if sums is not None:
            gmm = masses * gm_j if turn < 3 else 0.5 * masses * gm_j
            energy = energy - gmm * inverse
            virial = virial - gmm * cube * dot(d, d)
    return a + rotated3(reaction, 4), energy, virial

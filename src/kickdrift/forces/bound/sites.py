"""Virtual sites among the bound forces of a System: their places before all forces, and their forces after these.

The forces see unit masses at sites, and give accelerations there as everywhere. The last entry of the table takes these
accelerations, and gives the forces to the particles that the sites follow, by the derivatives of the places. A place
that is linear in positions leaves the virial as it is. A cross product is quadratic, and adds its part.
"""

from __future__ import annotations

from copy import copy
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from kickdrift.forces.seam.kernel import OK, BoundForce, kernel
from kickdrift.jit.compile import strict
from kickdrift.model.state import Floats


class Placing(NamedTuple):
    """Virtual sites that take their places, see `VirtualSites`."""

    site: NDArray[np.int64]  # (s,)
    of: NDArray[np.int64]  # (s, 3)
    shares: Floats  # (s, 2)
    normal: Floats  # (s,)


class Spreading(NamedTuple):
    """Virtual sites that give their forces away."""

    site: NDArray[np.int64]
    of: NDArray[np.int64]
    shares: Floats
    normal: Floats
    over: Floats  # (s, 3) the sites' mass in the forces over the masses of the particles that they follow
    mass: float  # the sites' mass in the forces


@kernel(Placing)
def place_sites(force, t, x, v, a, sums):
    place_all(force, x)
    return OK


@strict
def place_all(force, x):
    """Put the sites at their places at x (3, n), operation by operation as ``VirtualSites.place`` does."""
    for s in range(force.site.size):
        at, i, j, k = force.site[s], force.of[s, 0], force.of[s, 1], force.of[s, 2]
        one, two, normal = force.shares[s, 0], force.shares[s, 1], force.normal[s]
        x1, y1, z1 = x[0, j] - x[0, i], x[1, j] - x[1, i], x[2, j] - x[2, i]
        x2, y2, z2 = x[0, k] - x[0, i], x[1, k] - x[1, i], x[2, k] - x[2, i]
        x[0, at] = ((x[0, i] + one * x1) + two * x2) + normal * (y1 * z2 - z1 * y2)
        x[1, at] = ((x[1, i] + one * y1) + two * y2) + normal * (z1 * x2 - x1 * z2)
        x[2, at] = ((x[2, i] + one * z1) + two * z2) + normal * (x1 * y2 - y1 * x2)


@kernel(Spreading)
def spread_forces(force, t, x, v, a, sums):
    """Give the accelerations of the sites to the particles that they follow, and add the virial of cross products."""
    virial = 0.0
    for s in range(force.site.size):
        at, i, j, k = force.site[s], force.of[s, 0], force.of[s, 1], force.of[s, 2]
        one, two, normal = force.shares[s, 0], force.shares[s, 1], force.normal[s]
        fx, fy, fz = a[0, at], a[1, at], a[2, at]
        x1, y1, z1 = x[0, j] - x[0, i], x[1, j] - x[1, i], x[2, j] - x[2, i]
        x2, y2, z2 = x[0, k] - x[0, i], x[1, k] - x[1, i], x[2, k] - x[2, i]
        gx, gy, gz = normal * (y2 * fz - z2 * fy), normal * (z2 * fx - x2 * fz), normal * (x2 * fy - y2 * fx)
        hx, hy, hz = normal * (fy * z1 - fz * y1), normal * (fz * x1 - fx * z1), normal * (fx * y1 - fy * x1)
        virial += x1 * gx + y1 * gy + z1 * gz
        gx, gy, gz = gx + one * fx, gy + one * fy, gz + one * fz
        hx, hy, hz = hx + two * fx, hy + two * fy, hz + two * fz
        own, other, third = force.over[s, 0], force.over[s, 1], force.over[s, 2]
        a[0, i] += own * (fx - gx - hx)
        a[1, i] += own * (fy - gy - hy)
        a[2, i] += own * (fz - gz - hz)
        a[0, j] += other * gx
        a[1, j] += other * gy
        a[2, j] += other * gz
        a[0, k] += third * hx
        a[1, k] += third * hy
        a[2, k] += third * hz
        a[0, at], a[1, at], a[2, at] = 0.0, 0.0, 0.0
    if sums is not None:
        sums[1] += force.mass * virial
    return OK


def weighed(system: Any) -> Any:
    """The System as forces see it: with unit masses at its sites."""
    masses = system.state.masses.copy()
    masses[system.virtual_sites.particles] = 1.0
    seen = copy(system)
    object.__setattr__(seen, "state", replace(system.state, masses=masses))
    return seen


def around(system: Any, forces: tuple[BoundForce, ...]) -> tuple[BoundForce, ...]:
    """The forces of a System between the two tasks of its sites, which each group of forces has; see `site_groups`."""
    sites = system.virtual_sites
    place = sites.particles, sites.of, sites.shares, sites.normal
    over = 1.0 / system.state.masses[sites.of]
    groups = site_groups(system)
    placing = [BoundForce(Placing(*place)) for _ in groups]
    spreading = [BoundForce(Spreading(*place, over, float(system.units.coherent_mass))) for _ in groups]
    return (*placing, *forces, *spreading)


def site_groups(system: Any) -> list[int]:
    """Groups of forces in a System with virtual sites; none without sites."""
    if getattr(system, "virtual_sites", None) is None:
        return []
    return sorted({getattr(force, "group", 0) for force in system.forces})

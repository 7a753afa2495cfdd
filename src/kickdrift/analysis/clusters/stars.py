"""The stars of a cluster at one time: their gravity, their potential, and the field of the galaxy around them."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from scipy.spatial.distance import cdist

from kickdrift.errors import InputError
from kickdrift.forces.bound.forces import BoundForces
from kickdrift.forces.fields.shipped import Field
from kickdrift.forces.laws.central import gravitational_constant
from kickdrift.forces.laws.field_law import FieldForce
from kickdrift.model.state import Floats
from kickdrift.model.system import System
from kickdrift.model.units.unit_systems import UnitSystem

GRAVITY = ("gravity", "gravity-tree")
DIRECT = 3000  # most stars whose potential is summed over all pairs
ACCURACY = 1e-4  # of the tree, for more stars
BLOCK = 2**20  # pairs that are summed at a time
STEP = 1e-4  # of the distance from the galaxy's centre, for the tidal field


class Stars(NamedTuple):
    """Stars of a cluster at one time, in the units of their system.

    Attributes
    ----------
    x, v : (n, 3) positions and velocities
    masses : (n,)
    gravity, softening : the constant G, and a length, 0 for point masses
    time : of this state
    galaxy : the fields that the stars feel beside their own gravity
    units : UnitSystem
    """

    x: Floats
    v: Floats
    masses: Floats
    gravity: float
    softening: float
    time: float
    galaxy: tuple[Any, ...]
    units: UnitSystem

    def some(self, chosen: Any) -> Stars:
        """Some of the stars."""
        return self._replace(x=self.x[chosen], v=self.v[chosen], masses=self.masses[chosen])


def stars_of(source: Any, called: str) -> Stars:
    """Stars of a System, of a Simulation at its time, or of a frame of a run.

    Raises InputError without gravity, for fewer than two massive bodies, and in a periodic box.
    """
    system = source if isinstance(source, System) else getattr(source, "system", None)
    if not isinstance(system, System):
        kind = type(source).__name__
        raise InputError(f"{called}: expected a System, a Simulation or a frame such as run[-1], got {kind}")
    state = source.state if hasattr(source, "state") else system.state
    return stars_at(system, state.positions, state.velocities, state.masses, state.time, called)


def stars_at(system: System, x: Floats, v: Floats, masses: Floats, time: float, called: str) -> Stars:
    """Stars of a System at a state: the bodies that have mass and are there. Raises InputError as `stars_of` does."""
    own = [force for force in system.forces if getattr(force, "name", "") in GRAVITY]
    if not own:
        raise InputError(f"{called}: expected a system with the force gravity or gravity-tree")
    if system.box.periodic:
        raise InputError(f"{called}: expected a cluster in open space; the box is periodic")
    there = (masses > 0) & np.isfinite(x).all(axis=1)
    if np.count_nonzero(there) < 2:
        raise InputError(f"{called}: expected two or more bodies with mass, got {np.count_nonzero(there)}")
    constant = gravitational_constant(own[0].name, own[0].G, system)
    galaxy = tuple(force for force in system.forces if isinstance(force, Field | FieldForce))
    found = Stars(x, v, masses, constant, own[0].softening, float(time), galaxy, system.units)
    return found.some(there)


def potentials(stars: Stars) -> Floats:
    """Potential (n,) of the other stars at each star, per mass: exact for some thousand stars, else by the tree."""
    x, masses, n = stars.x, stars.masses, len(stars.masses)
    if n > DIRECT:
        return _by_tree(stars)
    found, rows = np.empty(n), max(1, BLOCK // n)
    for first in range(0, n, rows):
        own = np.arange(first, min(first + rows, n))
        r2 = cdist(x[own], x, "sqeuclidean") + stars.softening**2
        r2[own - first, own] = np.inf
        found[own] = -stars.gravity * ((1.0 / np.sqrt(r2)) @ masses)
    return found


def _by_tree(stars: Stars) -> Floats:
    from kickdrift.forces.tree.kernel import bind
    from kickdrift.forces.tree.potential import tree_potential

    kernel = bind(stars.gravity * stars.masses, stars.masses, stars.softening, ACCURACY, 1)
    tree_potential(kernel, np.ascontiguousarray(stars.x.T))
    found = np.empty(len(stars.masses))
    found[kernel.rows[:, 3].astype(np.int64)] = kernel.potential[: len(found)]
    return found


def tidal_strength(stars: Stars, centre: Floats, motion: Floats) -> float | None:
    """Strength of the galaxy's tide at a centre with a velocity: Omega^2 + dF_r / dr, per time squared.

    Omega = |r x v| / r^2 is the angular speed about the field's centre, by default the origin, and F_r the field's
    radial acceleration (King 1962, doi:10.1086/108756). None without a field of a galaxy, or where the tide does not
    pull stars away.
    """
    given: list[Any] = [getattr(force, "centre", None) for force in stars.galaxy]
    middle = next((np.array(each, dtype=float) for each in given if np.shape(each) == (3,)), np.zeros(3))
    distance = float(np.linalg.norm(centre - middle))
    if not stars.galaxy or distance == 0.0:
        return None
    outwards, h = (centre - middle) / distance, STEP * distance
    places = centre + h * np.array([-1.0, 1.0])[:, None] * outwards
    probes = System(places, masses=float(stars.masses.mean()), forces=stars.galaxy, units=stars.units)
    pulls = BoundForces(probes).derivative(stars.time, probes.state.phase)[1].T
    turning = float(np.linalg.norm(np.cross(outwards, motion))) / distance
    strength = turning**2 + float((pulls[1] - pulls[0]) @ outwards) / (2.0 * h)
    return strength if strength > 0.0 else None

"""Walls: planes that keep particles on one side. They are for open sides of a box.

A wall is the plane through a point, and its normal points to the side of the particles. With s = (x - point) . normal,
the distance of a particle from the wall, a soft wall has an energy of s. A hard wall has none: it mirrors particles,
which ``integrators.splitting.mirrors`` does in the drift of splitting methods.

This module does not import numba, so reading and checking a system file stays fast; ``bind`` compiles.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from kickdrift.errors import InputError
from kickdrift.forces.laws.field_law import field_law
from kickdrift.forces.seam.arguments import Vector, check_in_plane
from kickdrift.model.state import Floats
from kickdrift.text import shown

if TYPE_CHECKING:
    from kickdrift.model.subject import Subject

ROUNDING = 1e-9  # of the distances from the origin: a particle so little behind a hard wall is on it


def check_wall(p: Any) -> None:
    """Refuse a normal without a direction."""
    if not any(p.normal):
        raise InputError("normal must not be zero")


def check_open(name: str, p: Any, system: Subject) -> None:
    """Refuse a wall across a periodic axis, and one out of the plane of a two-dimensional system."""
    for axis, periodic in enumerate(system.box.periodic_axes):
        if periodic and p.normal[axis]:
            raise InputError(f"a wall needs an open side, but the box is periodic along {'xyz'[axis]}")
    check_in_plane(name, "normal", p.normal, system)


def distances(p: Any, x: Floats) -> Floats:
    """Distances (n,) from a wall of particles at x (n, 3); negative behind it."""
    found: Floats = (x - np.array(p.point)) @ unit(p)
    return found


def unit(p: Any) -> Floats:
    """The normal, of length 1."""
    normal = np.array(p.normal, dtype=float)
    found: Floats = normal / np.linalg.norm(normal)
    return found


def check_before(p: Any, system: Subject) -> None:
    """Refuse a wall with a particle behind it."""
    x = system.state.positions
    s = distances(p, x) - getattr(p, "speed", 0.0) * system.state.time
    i = int(s.argmin())
    if s[i] < -ROUNDING * (np.abs(x[i]).max() + np.abs(p.point).max()):
        raise InputError(
            f"{system.body(i)} is {-s[i]:.6g} behind the wall; the normal points to the side of the particles"
        )


@field_law
class HarmonicWall(NamedTuple):
    """Soft wall, U = k (reach - s)^2 / 2 for each particle nearer to the wall than ``reach``, or behind the wall.

    Attributes
    ----------
    stiffness : float
        Energy per length squared, zero or more.
    normal : (x, y, z)
        Points to the side of the particles; of any length.
    point : (x, y, z)
        A point of the wall; default the origin.
    reach : float
        Distance from the wall at which the force begins; default 0, so that particles behind the wall are pushed back.
    """

    stiffness: float
    normal: Vector
    point: Vector = (0.0, 0.0, 0.0)
    reach: float = 0.0

    dimensions = {"stiffness": "stiffness", "point": "length", "reach": "length"}  # type: ignore[misc]  # noqa: RUF012
    varies = ()  # type: ignore[misc]

    def law(p, x, v, m, t):
        normal = p.normal / math.sqrt(p.normal @ p.normal)  # type: ignore[operator]
        deep = max(p.reach - (x - p.point) @ normal, 0.0)
        return 0.5 * p.stiffness * deep * deep, (p.stiffness * deep) * normal

    def check(p):
        check_wall(p)
        if p.stiffness < 0:
            raise InputError(f"stiffness must be zero or more, got {shown(p.stiffness)}")
        if p.reach < 0:
            raise InputError(f"reach must be zero or more, got {shown(p.reach)}")

    def check_system(p, system):
        """Refuse a wall across a periodic axis, and one that has most particles behind it."""
        check_open("harmonic-wall", p, system)
        behind = int((distances(p, system.state.positions) < 0).sum())
        if behind > len(system) // 2:
            raise InputError(
                f"{behind} of {len(system)} particles are behind the wall; the normal points to their side"
            )


@field_law
class LennardJonesWall(NamedTuple):
    """Wall of a half space of Lennard-Jones particles: U = epsilon (2/15 (sigma/s)^9 - (sigma/s)^3) - U(cutoff).

    The force jumps at the cutoff, except at the minimum (2/5)^(1/6) sigma = 0.8584 sigma, which leaves repulsion alone.
    A particle behind the wall has no energy, and such a run stops. This is Lennard-Jones' law summed over a half space,
    as in LAMMPS' fix wall/lj93.

    Attributes
    ----------
    normal : (x, y, z)
        Points to the side of the particles; of any length.
    cutoff : float
        Distance from the wall beyond which it does not act.
    point : (x, y, z)
        A point of the wall; default the origin.
    epsilon, sigma : float
        Energy and length; default 1.
    """

    normal: Vector
    cutoff: float
    point: Vector = (0.0, 0.0, 0.0)
    epsilon: float = 1.0
    sigma: float = 1.0

    dimensions = {  # type: ignore[misc]  # noqa: RUF012
        "cutoff": "length", "point": "length", "epsilon": "energy", "sigma": "length",
    }  # fmt: skip
    varies = ()  # type: ignore[misc]

    def law(p, x, v, m, t):
        normal = p.normal / math.sqrt(p.normal @ p.normal)  # type: ignore[operator]
        s = (x - p.point) @ normal
        near, last = (p.sigma / s) ** 3, (p.sigma / p.cutoff) ** 3
        energy = p.epsilon * ((2.0 / 15.0 * near * near - 1.0) * near - (2.0 / 15.0 * last * last - 1.0) * last)
        push = p.epsilon * (1.2 * near * near - 3.0) * near / s
        energy, push = np.where(s > 0.0, energy, math.nan), np.where(s > 0.0, push, math.nan)
        return np.where(s < p.cutoff, energy, 0.0), np.where(s < p.cutoff, push, 0.0) * normal

    def check(p):
        check_wall(p)
        for key in ("cutoff", "sigma"):
            if getattr(p, key) <= 0:
                raise InputError(f"{key} must be positive, got {shown(getattr(p, key))}")
        if p.epsilon < 0:
            raise InputError(f"epsilon must be zero or more, got {shown(p.epsilon)}")

    def check_system(p, system):
        """Refuse a wall across a periodic axis, and one with a particle behind it."""
        check_open("lennard-jones-wall", p, system)
        check_before(p, system)


@field_law
class ReflectingWall(NamedTuple):
    """Hard wall: a particle that meets it goes on with its velocity mirrored, at the very time of the bounce.

    Splitting methods bounce in their drifts, where particles fly straight. Between two kicks such a bounce keeps
    energy and can be reversed. Beside other forces, each bounce changes the total energy by up to force x speed x dt,
    with either sign. These methods mirror the centres of bodies. ``event-driven`` bounces spheres at their surface, and
    takes walls that move or lose energy. Other methods integrate a force, which a bounce is not, so they refuse this
    wall.

    Attributes
    ----------
    normal : (x, y, z)
        Points to the side of the particles; of any length.
    point : (x, y, z)
        A point of the wall at t = 0; default the origin.
    restitution : float
        Ratio of the normal speeds after and before a bounce, relative to the wall, from 0 to 1; default 1.
    speed : float
        Speed of the wall along its normal; default 0.
    """

    normal: Vector
    point: Vector = (0.0, 0.0, 0.0)
    restitution: float = 1.0
    speed: float = 0.0

    dimensions = {"point": "length", "speed": "velocity"}  # type: ignore[misc]  # noqa: RUF012
    varies = ()  # type: ignore[misc]
    per_mass = reflects = True  # type: ignore[misc]

    def law(p, x, v, m, t):
        return 0.0 * m, 0.0 * x

    def check(p):
        check_wall(p)
        if not 0 <= p.restitution <= 1:
            raise InputError(f"restitution must be a number from 0 to 1, got {shown(p.restitution)}")

    def check_system(p, system):
        """Refuse a wall across a periodic axis, and one with a particle behind it."""
        check_open("reflecting-wall", p, system)
        check_before(p, system)

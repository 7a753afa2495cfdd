"""Drag by gas and by stars: a gas disc around a central body, and dynamical friction."""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np

from kickdrift.forces.around.oblateness import axis
from kickdrift.forces.laws.around import around, vector
from kickdrift.forces.laws.body_law import body_law
from kickdrift.forces.laws.central import (
    Attraction,
    Central,
    check_along_z,
    check_axis,
    check_central,
    check_positive,
)
from kickdrift.forces.seam.arguments import Vector, check_not_negative
from kickdrift.model.state import Floats

NEAR, TERMS = 0.3, 12  # speed over dispersion below which a series with so many terms replaces the error function


class Gas(NamedTuple):
    """A gas disc around a System's central body."""

    central: int
    coefficient: Floats  # (n,)
    scale: float
    slope: float
    speed: float  # (1 - headwind) sqrt(G M)
    thinness: float  # 1 / (2 aspect^2); 0 for a disc without a height
    pole: Vector
    share: Floats  # (n,) zeros: the gas takes the momentum


@body_law
class GasDrag(NamedTuple):
    """Quadratic drag by a gas disc that rotates about the central body, a little slower than on circular orbits.

    a = -K w |w|, w the velocity relative to the gas. The gas moves on circles at (1 - headwind) sqrt(G M / R), R the
    distance from the axis. K = coefficient (R / scale)^-slope exp(-z^2 / (2 H^2)), H = aspect R (Adachi, Hayashi &
    Nakazawa 1976, doi:10.1143/PTP.56.1756). A circular orbit shrinks at da/dt = -2 K headwind^2 v a. The central body
    takes no force.

    Attributes
    ----------
    coefficient : float, or one for each particle or species
        C_D pi s^2 rho / (2 m) at the distance ``scale``, an inverse length, for a body of radius s and mass m in gas of
        density rho; zero for planets.
    scale : float
        A length.
    slope : float
        The density falls as R^-slope; default 0.
    headwind : float
        The gas turns slower than an orbit by this fraction of the orbital speed; default 0.
    aspect : float
        Height of the disc over its radius; default 0, gas of the same density at all heights.
    pole : (x, y, z)
        Axis of the disc's rotation, of any length; default z.
    central : str or int, optional
        The central body's name or number; default the most massive body.
    G : float, optional
        Default the unit system's own.
    """

    coefficient: float
    scale: float
    slope: float = 0.0
    headwind: float = 0.0
    aspect: float = 0.0
    pole: Vector = (0.0, 0.0, 1.0)
    central: Central = None
    G: float | None = None

    name = "gas-drag"  # type: ignore[misc]
    velocity_dependent = works = external = True  # type: ignore[misc]
    varies = ("coefficient",)  # type: ignore[misc]
    odd_in_time = ("coefficient", "pole")  # type: ignore[misc]
    dimensions = {  # type: ignore[misc]  # noqa: RUF012
        "coefficient": "inverse length",
        "scale": "length",
        "G": "gravitational constant",
    }
    law = staticmethod(around)  # type: ignore[misc]

    @staticmethod
    def pull(p, i, d, u, t):
        pole = vector(p.pole)
        height = d @ pole
        flat = d - height * pole
        r2 = flat @ flat
        r = math.sqrt(r2)
        wind = u - (p.speed / (r * math.sqrt(r))) * np.cross(pole, flat)
        drag = p.coefficient[i] * (r / p.scale) ** -p.slope * math.exp(-p.thinness * height * height / r2)
        return 0.0, (-drag * math.sqrt(wind @ wind)) * wind

    def check(p):
        check_positive("gas-drag", scale=p.scale, G=p.G)
        check_central("gas-drag", p.central)
        check_not_negative(coefficient=p.coefficient, aspect=p.aspect)
        check_axis("pole", p.pole)

    def check_system(p, system):
        """Refuse a system that this force cannot run."""
        check_along_z("pole", p.pole, system)

    def bound(p: Any, system):
        """The gas around this System's central body."""
        central, gm, share = Attraction.of("gas-drag", p, system)
        thinness = 0.5 / p.aspect**2 if p.aspect else 0.0
        speed = (1.0 - p.headwind) * math.sqrt(gm)
        return Gas(central, p.coefficient, p.scale, p.slope, speed, thinness, axis(p.pole), np.zeros_like(share))


class Background(NamedTuple):
    """Light particles around a System's central body."""

    central: int
    strength: Floats  # (n,) 4 pi G^2 m rho log at the distance scale
    scale: float
    slope: float
    inverse_dispersion: float  # 1 / (sqrt(2) sigma)
    share: Floats  # (n,) zeros: the background takes the momentum


@body_law
class DynamicalFriction(NamedTuple):
    """Chandrasekhar's dynamical friction: drag of a background of light particles, such as stars, on each body.

    a = -4 pi G^2 m rho log [erf(X) - 2 X exp(-X^2) / sqrt(pi)] v / v^3, X = v / (sqrt(2) dispersion), rho = density (r
    / scale)^-slope, for r and v from the central body (Binney & Tremaine 2008, Galactic Dynamics, eq. 8.7). The
    velocities of the background are Maxwell's. The friction acts on bodies with mass. The central body takes no force.

    Attributes
    ----------
    density : float
        Mass per volume at the distance ``scale``, zero or more.
    dispersion : float
        Velocity dispersion along one axis.
    log : float
        Coulomb logarithm, zero or more.
    scale : float
        A length; default 1. Without a slope it has no effect.
    slope : float
        The density falls as r^-slope; default 0, 2 for an isothermal sphere.
    central : str or int, optional
        The body in the centre, by name or number; default the most massive body.
    G : float, optional
        Default the unit system's own.
    """

    density: float
    dispersion: float
    log: float
    scale: float = 1.0
    slope: float = 0.0
    central: Central = None
    G: float | None = None

    name = "dynamical-friction"  # type: ignore[misc]
    by_mass = velocity_dependent = works = external = True  # type: ignore[misc]
    odd_in_time = ("log",)  # type: ignore[misc]
    dimensions = {  # type: ignore[misc]  # noqa: RUF012
        "density": "density",
        "dispersion": "velocity",
        "scale": "length",
        "G": "gravitational constant",
    }
    law = staticmethod(around)  # type: ignore[misc]

    @staticmethod
    def pull(p, i, d, u, t):
        """[erf(X) - 2 X exp(-X^2) / sqrt(pi)] / X^3 is 4 / sqrt(pi) times the sum of (-X^2)^k / (k! (2 k + 3))."""
        strength = p.strength[i]
        if p.slope != 0.0:
            strength *= (math.sqrt(d @ d) / p.scale) ** -p.slope
        speed = math.sqrt(u @ u) * p.inverse_dispersion
        if speed < NEAR:
            term, total = 1.0, 1.0 / 3.0
            for k in range(1, TERMS):
                term *= -speed * speed / k
                total += term / (2.0 * k + 3.0)
            shape = 4.0 / math.sqrt(math.pi) * total
        else:
            slow = 2.0 / math.sqrt(math.pi) * speed * math.exp(-speed * speed)
            shape = (math.erf(speed) - slow) / (speed * speed * speed)
        return 0.0, (-strength * shape * p.inverse_dispersion**3) * u

    def check(p):
        check_positive("dynamical-friction", dispersion=p.dispersion, scale=p.scale, G=p.G)
        check_central("dynamical-friction", p.central)
        check_not_negative(density=p.density, log=p.log)

    def bound(p: Any, system):
        """The background of this System's bodies."""
        central, gm, share = Attraction.of("dynamical-friction", p, system)
        masses = system.state.masses
        strength = 4.0 * math.pi * (gm / masses[central]) ** 2 * masses * p.density * p.log
        inverse = 1.0 / (math.sqrt(2.0) * p.dispersion)
        return Background(central, strength, p.scale, p.slope, inverse, np.zeros_like(share))

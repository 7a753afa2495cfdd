"""Gas and stars around a central body: drag by a disc, dynamical friction, and migration of planets."""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np

from kickdrift.errors import InputError
from kickdrift.forces.around.oblateness import axis
from kickdrift.forces.laws.body_law import body_law
from kickdrift.forces.laws.central import (
    Attraction,
    Central,
    around,
    check_along_z,
    check_axis,
    check_central,
    check_positive,
    vector,
)
from kickdrift.forces.seam.arguments import Vector, check_not_negative, number
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


class Disc(NamedTuple):
    """Damping rates of a System's bodies in a disc around its central body."""

    central: int
    rate_a: Floats  # (n,) 1 / tau_a; 0 for none
    rate_e: Floats
    rate_i: Floats
    gm: Floats  # (n,) G (m_i + M)
    edge: float  # 0 for none
    width: float
    pole: Vector
    share: Floats  # (n,) zeros: the disc takes the momentum


@body_law
class Migration(NamedTuple):
    """Exponential migration, and damping of eccentricities and inclinations, as by a disc around the central body.

    a = -v / (2 tau_a) - 2 (v . r) r / (r^2 tau_e) - 2 (v . k) k / tau_i, for r and v from the central body and the pole
    k of the disc (Papaloizou & Larwood 2000, doi:10.1046/j.1365-8711.2000.03466.x). A planet's semi-major axis falls as
    exp(-t / tau_a), a small eccentricity as exp(-t / tau_e), a small inclination as exp(-t / tau_i). Damping of e keeps
    the angular momentum, so a falls by 2 e^2 / tau_e as well.

    An inner edge traps planets: inside ``edge`` (1 - width), migration is outward and ten times as fast, and goes over
    to its full rate at ``edge`` (1 + width) (Pichierri, Morbidelli & Crida 2018, doi:10.1007/s10569-018-9848-2). The
    position is the osculating semi-major axis. The central body takes no force.

    Attributes
    ----------
    tau_a, tau_e, tau_i : float, or one for each particle or species
        Times; 0, the default, means no damping. A positive time damps; REBOUNDx has the other sign. A negative tau_a
        means outward migration. tau_e and tau_i must not be negative.
    edge : float, optional
        A length; default none.
    width : float
        Half-width of the edge over its radius; default 0.02.
    pole : (x, y, z)
        Axis of the disc, of any length; default z.
    central : str or int, optional
        The central body's name or number; default the most massive body.
    G : float, optional
        Default the unit system's own.
    """

    tau_a: float = 0.0
    tau_e: float = 0.0
    tau_i: float = 0.0
    edge: float | None = None
    width: float = 0.02
    pole: Vector = (0.0, 0.0, 1.0)
    central: Central = None
    G: float | None = None

    name = "migration"  # type: ignore[misc]
    velocity_dependent = works = external = True  # type: ignore[misc]
    varies = ("tau_a", "tau_e", "tau_i")  # type: ignore[misc]
    odd_in_time = ("tau_a", "tau_e", "tau_i")  # type: ignore[misc]
    dimensions = {  # type: ignore[misc]  # noqa: RUF012
        "tau_a": "time",
        "tau_e": "time",
        "tau_i": "time",
        "edge": "length",
        "G": "gravitational constant",
    }
    law = staticmethod(around)  # type: ignore[misc]

    @staticmethod
    def pull(p, i, d, u, t):
        rate, r2, pole = p.rate_a[i], d @ d, vector(p.pole)
        if p.edge > 0.0 and rate != 0.0:
            binding = 2.0 / math.sqrt(r2) - (u @ u) / p.gm[i]
            beyond = (1.0 / binding / p.edge - 1.0) / p.width if binding > 0.0 else 1.0
            if beyond <= -1.0:
                rate *= -10.0
            elif beyond < 1.0:
                rate *= 5.5 * math.cos(0.5 * math.pi * (1.0 - beyond)) - 4.5
        push = (-2.0 * p.rate_e[i] * (d @ u) / r2) * d - (0.5 * rate) * u - (2.0 * p.rate_i[i] * (u @ pole)) * pole
        return 0.0, push

    def check(p):
        check_positive("migration", edge=p.edge, width=p.width, G=p.G)
        check_central("migration", p.central)
        check_not_negative(tau_e=p.tau_e, tau_i=p.tau_i)
        if p.edge is not None and number("migration", "width", p.width) >= 1.0:
            raise InputError(f"width must be under 1, got {p.width}")
        check_axis("pole", p.pole)

    def check_system(p, system):
        """Refuse a system that this force cannot run."""
        check_along_z("pole", p.pole, system)

    def bound(p: Any, system):
        """The damping of this System's bodies."""
        central, gm, share = Attraction.of("migration", p, system)
        a, e, i = (np.divide(1.0, tau, out=0.0 * tau, where=tau != 0) for tau in (p.tau_a, p.tau_e, p.tau_i))
        still = np.zeros_like(share)
        return Disc(central, a, e, i, gm * (1.0 + share), p.edge or 0.0, p.width, axis(p.pole), still)

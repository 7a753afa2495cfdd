"""Migration of planets in a disc: damping of semi-major axes, eccentricities and inclinations, with an inner edge."""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np

from kickdrift.errors import InputError
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
from kickdrift.forces.seam.arguments import Vector, check_not_negative, number
from kickdrift.model.state import Floats


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

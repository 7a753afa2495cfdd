"""Tides with a constant time lag between a central body and the bodies around it."""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np

from kickdrift.errors import InputError
from kickdrift.forces.laws.body_law import body_law
from kickdrift.forces.laws.central import (
    Attraction,
    Central,
    around,
    check_central,
    check_positive,
    column,
)
from kickdrift.forces.seam.arguments import Vector, check_not_negative, values_in
from kickdrift.model.state import Floats
from kickdrift.text import shown

ROTATIONS = ("none", "synchronous", "pseudo-synchronous")


class Bulges(NamedTuple):
    """The tides of a System's bodies."""

    central: int
    gm: Floats  # (n,) G (m_i + M)
    raised: Floats  # (n,) 3 G k2 m_i R^5 of the central body: its tide by body i
    felt: Floats  # (n,) 3 G k2 M^2 R^5 / m_i of body i: its tide by the central body
    lag: Floats  # (n,) time lags
    spin: Floats  # (3, n)
    slaved: Floats  # (n,) 1 for synchronous, 2 for pseudo-synchronous rotation in place of the spin, else 0
    share: Floats


@body_law
class Tides(NamedTuple):
    """Tides with a constant time lag: those that each body raises on the central body, and the central body on it.

    A body of radius R, Love number k2, time lag tau and spin S feels, by another body of mass m at r, v from it, the
    opposite of F = -3 G k2 m^2 R^5 / r^8 [r + tau (2 r (r . v) / r^2 + r × S + v)], which acts on the other body (Hut
    1981, A&A 99, 126; Mignard 1979). The part without tau has the energy -G k2 m^2 R^5 / (2 r^6) and the apsidal
    motion of Sterne 1939. The part with tau takes energy from orbit and spin.

    Spins stay as they are given: the torque on a body does not change its spin. This holds where a spin changes slowly
    or follows the orbit. ``rotation`` says how bodies without a spin rotate.

    Attributes
    ----------
    k2 : float, or one for each particle or species
        Potential Love number of degree 2; zero for a body that keeps its shape. Apsidal motion constants are k2 / 2.
    radius : float, or one for each particle or species
        A length.
    tau : float, or one for each particle or species
        Time lag, 1 / (n Q) for a quality factor Q at the mean motion n; default 0, the tides without dissipation.
    spin : (x, y, z), or one for each particle or species
        Angular velocity in radians per unit of time.
    rotation : "none", "synchronous" or "pseudo-synchronous", optional
        How the bodies with a time lag but a spin of zero rotate: not at all, with the mean motion of their orbit, or as
        tides alone would turn them (Hut 1981, eq. 42). Without it, such bodies are refused. The central body needs a
        spin, or "none".
    central : str or int, optional
        The central body's name or number; default the most massive body.
    G : float, optional
        Default the unit system's own.
    """

    k2: float
    radius: float
    tau: float = 0.0
    spin: Vector = (0.0, 0.0, 0.0)
    rotation: str | None = None
    central: Central = None
    G: float | None = None

    name = "tides"  # type: ignore[misc]
    stands_for, acts_by = "tides", "k2"  # type: ignore[misc]
    by_mass = True  # type: ignore[misc]
    varies = ("k2", "radius", "tau", "spin")  # type: ignore[misc]
    odd_in_time = ("tau", "spin")  # type: ignore[misc]
    dimensions = {  # type: ignore[misc]  # noqa: RUF012
        "radius": "length",
        "tau": "time",
        "spin": "rate",
        "G": "gravitational constant",
    }
    law = staticmethod(around)  # type: ignore[misc]

    @property
    def velocity_dependent(p):
        """Whether there is a time lag, which a splitting method refuses."""
        return _lags(p)

    @property
    def works(p):
        """Whether there is a time lag, so that energy is not conserved."""
        return _lags(p)

    @staticmethod
    def pull(p, i, d, u, t):
        c, r2 = p.central, d @ d
        inverse2 = 1.0 / r2
        inverse8 = inverse2 * inverse2 * inverse2 * inverse2
        raised, felt = p.raised[i], p.felt[i]
        static, late = raised + felt, raised * p.lag[c] + felt * p.lag[i]
        normal, rate = np.cross(d, u), 0.0  # the slaved spin is the normal times the rate
        if p.slaved[i] > 0.0:
            h2, gm = normal @ normal, p.gm[i]
            binding = 2.0 / math.sqrt(r2) - (u @ u) / gm  # 1 / a
            if binding > 0.0 and h2 > 0.0:
                rate = binding * math.sqrt(gm * binding / h2)
                if p.slaved[i] > 1.0:
                    ratio = h2 * binding / gm  # 1 - e^2
                    e2 = 1.0 - ratio
                    f2 = 1.0 + e2 * (7.5 + e2 * (5.625 + 0.3125 * e2))
                    f5 = 1.0 + e2 * (3.0 + 0.375 * e2)
                    rate *= f2 / (ratio * math.sqrt(ratio) * f5)
            else:
                rate = inverse2
        drag = (2.0 * (d @ u) * inverse2) * d + u
        twist = (raised * p.lag[c]) * column(p.spin, c) + (felt * p.lag[i]) * (column(p.spin, i) + rate * normal)
        push = static * d + late * drag + np.cross(d, twist)
        return -static * inverse2 * inverse2 * inverse2 / 6.0, -inverse8 * push

    def check(p):
        check_positive("tides", G=p.G)
        check_central("tides", p.central)
        check_not_negative(k2=p.k2, radius=p.radius, tau=p.tau)
        if p.rotation is not None and p.rotation not in ROTATIONS:
            raise InputError(f"rotation: expected one of {', '.join(ROTATIONS)}, got {shown(p.rotation)}")

    def bound(p: Any, system):
        """The tides of this System's bodies; an InputError names a body without mass or without a spin."""
        central, gm, share = Attraction.of("tides", p, system)
        masses, deformed = system.state.masses, 3.0 * p.k2 * p.radius**5
        for i in np.flatnonzero((deformed > 0) & (masses == 0)):
            raise InputError(
                f"tides: k2: {system.body(int(i))} has no mass, so its tide would move it without limit; give 0"
            )
        lagging = (deformed > 0) & (p.tau != 0)
        for i in np.flatnonzero(lagging & ~p.spin.any(axis=0)):
            if p.rotation is None:
                raise InputError(
                    f"tides: spin: {system.body(int(i))} has a time lag and no spin; give its spin, or rotation = "
                    + " or ".join(map(repr, ROTATIONS))
                )
            if i == central and p.rotation != "none":
                raise InputError(
                    f"tides: spin: the central body, {system.body(int(i))}, has a time lag and no spin; rotation = "
                    f"{p.rotation!r} is for the other bodies"
                )
        if system.dimensions == 2 and p.spin[:2].any():
            raise InputError("tides: spin: expected vectors along z in this two-dimensional system")
        slaved = float(ROTATIONS.index(p.rotation)) if p.rotation else 0.0
        one = gm / masses[central]  # G
        felt = one * masses[central] ** 2 * np.divide(deformed, masses, out=0.0 * masses, where=masses > 0)
        return Bulges(
            central,
            one * (masses + masses[central]),
            one * deformed[central] * masses,
            felt,
            p.tau,
            p.spin,
            np.where(lagging & ~p.spin.any(axis=0), slaved, 0.0),
            share,
        )


def _lags(p: Tides) -> bool:
    """Tell whether a body has a time lag."""
    return bool(values_in(p.tau).any())

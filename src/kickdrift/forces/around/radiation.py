"""Light and heat that push small bodies: radiation pressure with Poynting-Robertson drag, and Yarkovsky's force."""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np

from kickdrift.errors import InputError
from kickdrift.forces.around.relativity import FORMS
from kickdrift.forces.laws.body_law import body_law
from kickdrift.forces.laws.central import (
    Attraction,
    Central,
    around,
    central_body,
    check_central,
    check_positive,
    light,
)
from kickdrift.forces.seam.arguments import check_not_negative, values_in
from kickdrift.model.state import Floats
from kickdrift.text import shown


class Radiation(NamedTuple):
    """The radiation of a System's central body."""

    central: int
    pressure: Floats  # (n,) beta G M
    inverse_light: float  # 0 without drag
    share: Floats  # (n,) m / M in the potential form, else zeros: the radiation carries the momentum away


@body_law
class RadiationPressure(NamedTuple):
    """Radiation pressure of the central body, with Poynting-Robertson drag, in addition to ``gravity``.

    a = beta G M / r^2 [(1 - v_r / c) n - v / c], for r and v from the central body, n = r / |r| (Burns, Lamy & Soter
    1979, Icarus 40, 1, eq. 5). The drag takes energy and angular momentum: a and e fall as in Wyatt
    & Whipple 1950, ApJ 111, 134. The drag depends on velocity, so methods for velocity-independent forces refuse it.

    The central body takes no force, since it shines in all directions. The potential form leaves the drag out: U = beta
    G M m / r alone. There the central body takes the opposite force, so that energy and momentum are conserved.

    Attributes
    ----------
    beta : float, or one for each particle or species
        Radiation pressure over the central body's gravity, zero or more: about 0.2 for a grain of 1 um at the Sun. Zero
        for planets.
    c : float, optional
        Speed of light in the system's units; default the unit system's own.
    central : str or int, optional
        The shining body's name or number; default the most massive body.
    form : "full" or "potential"
    G : float, optional
        Default the unit system's own.
    """

    beta: float
    c: float | None = None
    central: Central = None
    form: str = "full"
    G: float | None = None

    name = stands_for = "radiation-pressure"  # type: ignore[misc]
    by_mass = True  # type: ignore[misc]
    varies = ("beta",)  # type: ignore[misc]
    dimensions = {"c": "velocity", "G": "gravitational constant"}  # type: ignore[misc]  # noqa: RUF012
    law = staticmethod(around)  # type: ignore[misc]

    @property
    def velocity_dependent(p):
        """Whether there is drag, which a splitting method refuses."""
        return p.form == "full"

    @property
    def below_light(p):
        """Whether there is drag, which holds for speeds far below that of light."""
        return p.form == "full"

    @property
    def works(p):
        """Whether there is drag, so that energy is not conserved."""
        return p.form == "full"

    @property
    def external(p):
        """Whether there is drag, so that momentum is not conserved."""
        return p.form == "full"

    @staticmethod
    def pull(p, i, d, u, t):
        inverse = 1.0 / math.sqrt(d @ d)
        energy = p.pressure[i] * inverse
        scale, outward = energy * inverse, (d @ u) * inverse
        push = (scale * inverse * (1.0 - outward * p.inverse_light)) * d - (scale * p.inverse_light) * u
        return energy, push

    def check(p):
        check_positive("radiation-pressure", c=p.c, G=p.G)
        check_central("radiation-pressure", p.central)
        check_not_negative(beta=p.beta)
        if p.form not in FORMS:
            raise InputError(f"form: expected one of {', '.join(FORMS)}, got {shown(p.form)}")

    def check_system(p, system):
        """Refuse a system that this force cannot run."""
        if p.form == "full":
            light("radiation-pressure", p.c, system)

    def bound(p: Any, system):
        """The radiation of this System's central body."""
        central, gm, share = Attraction.of("radiation-pressure", p, system)
        if p.form == "potential":
            return Radiation(central, gm * p.beta, 0.0, share)
        return Radiation(central, gm * p.beta, 1.0 / light("radiation-pressure", p.c, system), np.zeros_like(share))


class Recoil(NamedTuple):
    """Accelerations by recoil at a distance from a System's central body."""

    central: int
    a1: Floats  # (n,)
    a2: Floats
    a3: Floats
    scale: float
    power: float
    share: Floats  # (n,) zeros: the radiation or the gas carries the momentum away


@body_law
class NonGravitational(NamedTuple):
    """Recoil of a body that emits heat or gas: Yarkovsky's force on asteroids, jets of comets.

    a = (scale / r)^power (a1 n + a2 t + a3 h), for n along r from the central body, h along r × v, and t = h × n along
    the motion (Marsden, Sekanina & Yeomans 1973, doi:10.1086/111402). With a2 alone and power 2 this is the transverse
    acceleration of the Yarkovsky effect (Farnocchia et al. 2013, doi:10.1016/j.icarus.2013.02.004): da/dt = 2 a2
    scale^2 / (n a^2 (1 - e^2)), n the mean motion. The force does work. The central body takes no force.

    Attributes
    ----------
    a2 : float, or one for each particle or species
        Transverse acceleration at the distance ``scale``: A2 of orbit solutions, 1e-14 to 1e-13 AU/d^2 for asteroids.
        Positive for an orbit that grows.
    scale : float
        A length; A2 of orbit solutions is given for 1 AU.
    a1, a3 : float, or one for each particle or species
        Radial and normal acceleration there; default 0.
    power : float
        Default 2.
    central : str or int, optional
        The name or number of the body that warms the others; default the most massive body.
    """

    a2: float
    scale: float
    a1: float = 0.0
    a3: float = 0.0
    power: float = 2.0
    central: Central = None

    name = "non-gravitational"  # type: ignore[misc]
    velocity_dependent = works = external = True  # type: ignore[misc]
    varies = ("a1", "a2", "a3")  # type: ignore[misc]
    odd_in_time = ("a2", "a3")  # type: ignore[misc]
    dimensions = {  # type: ignore[misc]  # noqa: RUF012
        "a1": "acceleration",
        "a2": "acceleration",
        "a3": "acceleration",
        "scale": "length",
    }
    law = staticmethod(around)  # type: ignore[misc]

    @staticmethod
    def pull(p, i, d, u, t):
        """A body that moves along r has no transverse direction, and no transverse or normal force."""
        inverse, normal = 1.0 / math.sqrt(d @ d), np.cross(d, u)
        size = math.sqrt(normal @ normal)
        unit = 1.0 / size if size > 0.0 else 0.0
        strength = (p.scale * inverse) ** p.power
        radial, across = strength * p.a1[i] * inverse, strength * unit
        push = radial * d + (across * p.a2[i] * inverse) * np.cross(normal, d) + (across * p.a3[i]) * normal
        return 0.0, push

    def check(p):
        check_positive("non-gravitational", scale=p.scale)
        check_central("non-gravitational", p.central)

    def check_system(p, system):
        """Refuse a system that this force cannot run."""
        if system.dimensions == 2 and values_in(p.a3).any():
            raise InputError("a3: is out of the plane of this two-dimensional system; expected 0")

    def bound(p: Any, system):
        """The accelerations of this System's bodies."""
        central = central_body("non-gravitational", p.central, system)
        return Recoil(central, p.a1, p.a2, p.a3, p.scale, p.power, np.zeros(len(system)))

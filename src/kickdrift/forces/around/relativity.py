"""First correction of general relativity to the gravity of one central body."""

from __future__ import annotations

import math
from typing import NamedTuple

from kickdrift.errors import InputError
from kickdrift.forces.laws.around import around
from kickdrift.forces.laws.body_law import body_law
from kickdrift.forces.laws.central import (
    Attraction,
    Central,
    check_central,
    check_positive,
    light,
)
from kickdrift.model.state import Floats
from kickdrift.text import shown

FORMS = ("full", "potential")


class Schwarzschild(NamedTuple):
    """The correction of a System's central body."""

    central: int
    gm: float  # G M of the central body
    light2: float  # c^2
    full: bool
    share: Floats  # (n,) m / M: the central body's share of a body's acceleration


@body_law
class PostNewtonian(NamedTuple):
    """First post-Newtonian (1PN) force of the central body on every other body, in addition to ``gravity``.

    The full form is Schwarzschild's field in harmonic coordinates, for r and v from the central body of mass M:
    a = G M / (c^2 r^3) [(4 G M / r - v^2) r + 4 (r . v) v] (Anderson et al. 1975, doi:10.1086/153779; the terms of the
    Sun alone in the Einstein-Infeld-Hoffmann equations, Newhall, Standish & Williams 1983, A&A 125, 150, eq. 1). The
    pericentre advances by 6 pi G M / (c^2 a (1 - e^2)) a revolution (Will 1993, Theory and Experiment in Gravitational
    Physics, section 7.3). The full form depends on velocity, so methods for velocity-independent forces refuse this
    form.

    The potential form, U = -3 m (G M / (c r))^2, depends only on position and has the same advance to first order. It
    has neither the orbit's small periodic changes nor its period (Nobili & Roxburgh 1986, IAU Symposium 114, 105).

    The central body takes the opposite force, so the sum of m v is conserved. The potential energy includes the full
    form's addition to E: per mass, 3 v^4 / 8 + G M (3 v^2 + G M / r) / (2 r), over c^2, for a massless body, with
    weights for a massive one (see ``law``). Then the energy of one body around the central body is
    constant to order c^-4, and the energy of several attracting bodies to m / M of c^-2. Relativity does not conserve
    the sum of m x × v: on an eccentric orbit this sum oscillates by about e G M / (c^2 r) of its value.

    Attributes
    ----------
    c : float, optional
        Speed of light in the system's units; default the unit system's own.
    central : str or int, optional
        The central body's name or number; default the most massive body.
    form : "full" or "potential"
    G : float, optional
        Default the unit system's own.
    """

    c: float | None = None
    central: Central = None
    form: str = "full"
    G: float | None = None

    name = "relativity-1pn"  # type: ignore[misc]
    stands_for = "relativity to first order"  # type: ignore[misc]
    by_mass = fastmath = below_light = True  # type: ignore[misc]
    odd_in_time = ()  # type: ignore[misc]
    dimensions = {"c": "velocity", "G": "gravitational constant"}  # type: ignore[misc]  # noqa: RUF012

    @property
    def velocity_dependent(p):
        """Tell whether this is the full form, which a splitting method refuses."""
        return p.form == "full"

    law = staticmethod(around)  # type: ignore[misc]

    @staticmethod
    def pull(p, i, d, u, t):
        """The full form's energy is c^2 E_1 / m, so that E + E_1 is constant to order c^-4 along r'' = -g (1 + share) r
        / r^3 + (1 + share) a_1PN, g = G M.

        The rate of E_1 must be -v . a_1PN = -g (r . v) (3 v^2 + 4 g / r) / (c^2 r^3). With v^4, v^2 g / r and (g / r)^2
        this leaves one coefficient free. The coefficient of v^2 is the test body's, 3 / 2, and at share = 0 all three
        are the test body's.
        """
        v2, inverse, share = u @ u, 1.0 / math.sqrt(d @ d), p.share[i]
        gm_over_r = p.gm * inverse
        if p.full:
            scale = gm_over_r * inverse * inverse / p.light2
            push = (scale * (4.0 * gm_over_r - v2)) * d + (4.0 * scale * (d @ u)) * u
            first = 0.375 / (1.0 + share) * v2 * v2 + 1.5 * gm_over_r * v2
            energy = (first + (0.5 - 1.5 * share) * gm_over_r * gm_over_r) / p.light2
        else:
            push = (-6.0 * gm_over_r * gm_over_r * inverse * inverse / p.light2) * d
            energy = -3.0 * gm_over_r * gm_over_r / p.light2
        return energy, push

    def check(p):
        check_positive("relativity-1pn", c=p.c, G=p.G)
        check_central("relativity-1pn", p.central)
        if p.form not in FORMS:
            raise InputError(f"form: expected one of {', '.join(FORMS)}, got {shown(p.form)}")

    def check_system(p, system):
        """Refuse a system that this force cannot run."""
        light("relativity-1pn", p.c, system)

    def bound(p, system):
        """The correction of this System's central body."""
        central, gm, share = Attraction.of("relativity-1pn", p, system)
        return Schwarzschild(central, gm, light("relativity-1pn", p.c, system) ** 2, p.form == "full", share)

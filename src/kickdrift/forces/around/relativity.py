"""General relativity: the first correction about one body or of all pairs, gravitational waves, Lense-Thirring."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from kickdrift.errors import InputError
from kickdrift.forces.laws.body_law import body_law
from kickdrift.forces.laws.central import (
    Attraction,
    Central,
    around,
    check_along_z,
    check_central,
    check_open,
    check_positive,
    column,
    gravitational_constant,
    light,
    room,
    vector,
)
from kickdrift.forces.seam.arguments import Vector
from kickdrift.model.state import Floats
from kickdrift.text import shown

if TYPE_CHECKING:
    from kickdrift.model.subject import Subject


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


class Sources(NamedTuple):
    """All bodies as sources of gravity."""

    gm: Floats  # (n,) G m
    light: float


class Radiators(NamedTuple):
    """All bodies as sources of gravitational waves; not `Sources`, since each type has one compiled law."""

    gm: Floats  # (n,) G m
    light: float


@body_law
class EinsteinInfeldHoffmann(NamedTuple):
    """First post-Newtonian (1PN) force between all pairs of bodies, in addition to ``gravity``.

    The Einstein-Infeld-Hoffmann equations with beta = gamma = 1 (Newhall, Standish & Williams 1983, A&A 125, 150, eq.
    1). The accelerations on their right side are Newton's. ``relativity-1pn`` has the terms of one central body alone,
    and needs less time. The force depends on velocity, so methods for velocity-independent forces refuse it.

    The energy includes the 1PN terms, per c^2: the sums of 3 m v^4 / 8, of m phi^2 / 2, and over ordered pairs of
    G m_i m_j (6 v_i^2 - 7 v_i . v_j - (n . v_i) (n . v_j)) / (4 r), with phi the sum of G m_j / r and n = r / |r|
    (Landau & Lifshitz, The Classical Theory of Fields, section 106). It is constant to order c^-4. The sum of m v is
    conserved to order c^-2 alone. Velocities are those of the file: give them from the centre of mass.

    Attributes
    ----------
    c : float, optional
        Speed of light in the system's units; default the unit system's own.
    G : float, optional
        Default the unit system's own.
    """

    c: float | None = None
    G: float | None = None

    name = "relativity-eih"  # type: ignore[misc]
    stands_for = "relativity to first order"  # type: ignore[misc]
    by_mass = velocity_dependent = external = below_light = True  # type: ignore[misc]
    odd_in_time = ()  # type: ignore[misc]
    dimensions = {"c": "velocity", "G": "gravitational constant"}  # type: ignore[misc]  # noqa: RUF012

    @staticmethod
    def law(p, x, v, m, t, a):
        n, gm, inverse_c2 = x.shape[1], p.gm, 1.0 / (p.light * p.light)
        phi, newton = room(x)[0], room(x)
        for i in range(n):
            for j in range(n):
                if j == i or gm[j] == 0.0:
                    continue
                d = column(x, j) - column(x, i)
                inverse = 1.0 / math.sqrt(d @ d)
                phi[i] += gm[j] * inverse
                pull = gm[j] * inverse * inverse * inverse
                for k in range(3):
                    newton[k, i] += pull * d[k]
        energy = 0.0
        for i in range(n):
            vi = column(v, i)
            v2, mutual = vi @ vi, 0.0
            for j in range(n):
                if j == i or gm[j] == 0.0:
                    continue
                d, vj, aj = column(x, j) - column(x, i), column(v, j), column(newton, j)
                inverse = 1.0 / math.sqrt(d @ d)
                along, together = (d @ vj) * inverse, vi @ vj
                first = v2 + 2.0 * (vj @ vj) - 4.0 * together - 4.0 * phi[i] - phi[j]
                first += 0.5 * (d @ aj) - 1.5 * along * along
                second = 3.0 * (d @ vj) - 4.0 * (d @ vi)
                pull = gm[j] * inverse * inverse * inverse * inverse_c2
                push = (pull * first) * d + (pull * second) * (vi - vj) + (3.5 * gm[j] * inverse * inverse_c2) * aj
                for k in range(3):
                    a[k, i] += push[k]
                mutual += gm[j] * inverse * (6.0 * v2 - 7.0 * together - along * (d @ vi) * inverse)
            energy += m[i] * inverse_c2 * (0.375 * v2 * v2 + 0.5 * phi[i] * phi[i] + 0.25 * mutual)
        return energy

    def check(p):
        check_positive("relativity-eih", c=p.c, G=p.G)

    def check_system(p, system):
        """Refuse a system that this force cannot run."""
        _check_pairs("relativity-eih", p, system, 1)

    def bound(p, system):
        """The masses as sources."""
        return Sources(*_sources("relativity-eih", p, system))


@body_law
class RadiationReaction(NamedTuple):
    """Loss of orbital energy to gravitational waves: the 2.5PN force of each pair of bodies with masses.

    The acceleration of a pair's separation, in harmonic coordinates, is a = -8 G^2 m_1 m_2 / (5 c^5 r^3) [(v^2 + 3 G M
    / r) v - (v . n) (3 v^2 + 17 G M / (3 r)) n], with M = m_1 + m_2 and n = r / |r| (Damour & Deruelle 1981; Blanchet
    2014, doi:10.12942/lrr-2014-2, section 7). The mean rates of a and e are those of Peters 1964, Phys. Rev. 136,
    B1224. The force of more than two bodies is the sum over pairs, which leaves out terms of three bodies.

    The waves take energy, so the total energy falls. The two bodies of a pair take opposite forces.

    Attributes
    ----------
    c : float, optional
        Speed of light in the system's units; default the unit system's own.
    G : float, optional
        Default the unit system's own.
    """

    c: float | None = None
    G: float | None = None

    name = stands_for = "relativity-2.5pn"  # type: ignore[misc]
    by_mass = velocity_dependent = works = below_light = True  # type: ignore[misc]
    dimensions = {"c": "velocity", "G": "gravitational constant"}  # type: ignore[misc]  # noqa: RUF012

    @staticmethod
    def law(p, x, v, m, t, a):
        n, gm, c = x.shape[1], p.gm, p.light
        for i in range(n):
            for j in range(i):
                if gm[i] == 0.0 or gm[j] == 0.0:
                    continue
                d, u, total = column(x, i) - column(x, j), column(v, i) - column(v, j), gm[i] + gm[j]
                inverse, v2 = 1.0 / math.sqrt(d @ d), u @ u
                potential = total * inverse
                scale = 1.6 * gm[i] * gm[j] * inverse * inverse * inverse / (c * c * c * c * c)
                along = scale * (d @ u) * inverse * inverse * (3.0 * v2 + 17.0 / 3.0 * potential)
                push = along * d - (scale * (v2 + 3.0 * potential)) * u
                for k in range(3):
                    a[k, i] += gm[j] / total * push[k]
                    a[k, j] -= gm[i] / total * push[k]

    def check(p):
        check_positive("relativity-2.5pn", c=p.c, G=p.G)

    def check_system(p, system):
        """Refuse a system that this force cannot run."""
        _check_pairs("relativity-2.5pn", p, system, 2)

    def bound(p, system):
        """The masses as sources."""
        return Radiators(*_sources("relativity-2.5pn", p, system))


class Rotation(NamedTuple):
    """The rotation of a System's central body."""

    central: int
    strength: Vector  # 2 G S / c^2
    share: Floats


@body_law
class LenseThirring(NamedTuple):
    """Frame dragging by the rotation of the central body, in addition to ``gravity``.

    a = 2 G / (c^2 r^3) [3 (r . S) (r × v) / r^2 + v × S], S the angular momentum of the central body (Lense & Thirring
    1918; IERS Conventions 2010, eq. 10.12). The node moves by 2 G S / (c^2 a^3 (1 - e^2)^(3/2)) per unit of time. The
    force does no work. It depends on velocity, so methods for velocity-independent forces refuse it.

    The central body takes the opposite force. Its rotation stays the same.

    Attributes
    ----------
    angular_momentum : (x, y, z)
        S; for the Earth 5.86e33 kg m^2/s.
    c : float, optional
        Speed of light in the system's units; default the unit system's own.
    central : str or int, optional
        The rotating body's name or number; default the most massive body.
    G : float, optional
        Default the unit system's own.
    """

    angular_momentum: Vector
    c: float | None = None
    central: Central = None
    G: float | None = None

    name = stands_for = "lense-thirring"  # type: ignore[misc]
    by_mass = velocity_dependent = below_light = True  # type: ignore[misc]
    odd_in_time = ("angular_momentum",)  # type: ignore[misc]
    dimensions = {  # type: ignore[misc]  # noqa: RUF012
        "angular_momentum": "angular momentum",
        "c": "velocity",
        "G": "gravitational constant",
    }
    law = staticmethod(around)  # type: ignore[misc]

    @staticmethod
    def pull(p, i, d, u, t):
        inverse2, spin = 1.0 / (d @ d), vector(p.strength)
        inverse3 = inverse2 * math.sqrt(inverse2)
        return 0.0, (3.0 * inverse3 * inverse2 * (d @ spin)) * np.cross(d, u) + inverse3 * np.cross(u, spin)

    def check(p):
        check_positive("lense-thirring", c=p.c, G=p.G)
        check_central("lense-thirring", p.central)

    def check_system(p, system):
        """Refuse a system that this force cannot run."""
        check_along_z("angular_momentum", p.angular_momentum, system)
        light("lense-thirring", p.c, system)

    def bound(p, system):
        """The rotation of this System's central body."""
        central, _, share = Attraction.of("lense-thirring", p, system)
        c = light("lense-thirring", p.c, system)
        factor = 2.0 * gravitational_constant("lense-thirring", p.G, system) / (c * c)
        x, y, z = (factor * s for s in p.angular_momentum)
        return Rotation(central, (x, y, z), share)


def _sources(name: str, p: Any, system: Subject) -> tuple[Floats, float]:
    """G m of each body, and the speed of light."""
    return gravitational_constant(name, p.G, system) * system.state.masses, light(name, p.c, system)


def _check_pairs(name: str, p: Any, system: Subject, least: int) -> None:
    """Refuse a periodic box, missing constants, and a system of fewer bodies with a mass."""
    check_open(name, system)
    _sources(name, p, system)
    massive = int(np.count_nonzero(system.state.masses))
    if massive < least:
        raise InputError(f"{name}: needs {least} or more bodies with a mass; this system has {massive}")

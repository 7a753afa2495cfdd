"""Gravity of a flattened body: the zonal harmonics J2 and J4 of its field."""

from __future__ import annotations

import math
from typing import NamedTuple

from kickdrift.errors import InputError
from kickdrift.forces.arguments import Vector
from kickdrift.forces.body_law import body_law
from kickdrift.forces.central import (
    Attraction,
    Central,
    central_body,
    check_central,
    check_open,
    check_positive,
    gravitational_constant,
)
from kickdrift.model.state import Floats


class Harmonics(NamedTuple):
    """The harmonics of a System's central body."""

    central: int
    gm: float  # G M of the central body
    j2: float  # J2 R^2
    j4: float  # J4 R^4
    pole: Vector  # of length 1
    share: Floats  # (n,) m / M: the central body's share of a body's acceleration


@body_law
class Oblateness(NamedTuple):
    """The zonal harmonics J2 and J4 of a flattened central body's field, on top of ``gravity``.

    U = (G M m / r) [J2 (R / r)^2 P2(s) + J4 (R / r)^4 P4(s)], P2 and P4 Legendre's polynomials, s = r . pole / r, the
    sine of the latitude (Murray & Dermott 1999, Solar System Dynamics, section 6.11).

    The pole is fixed. The central body takes the opposite force, so momentum is conserved, but it does not take the
    torque. Only the angular momentum along the pole is conserved.

    Attributes
    ----------
    j2 : float
        Positive for a flattened body: 1.0826e-3 for the Earth.
    radius : float
        R, the equatorial radius that j2 and j4 are given for; a length.
    j4 : float
        Default 0.
    central : str or int, optional
        The flattened body's name or number; default the most massive body.
    pole : (x, y, z)
        Direction of the axis of symmetry, of any length; default z.
    G : float, optional
        Default the unit system's own.
    """

    j2: float
    radius: float
    j4: float = 0.0
    central: Central = None
    pole: Vector = (0.0, 0.0, 1.0)
    G: float | None = None

    name = "j2"  # type: ignore[misc]
    by_mass = fastmath = True  # type: ignore[misc]
    dimensions = {"radius": "length", "G": "gravitational constant"}  # type: ignore[misc]  # noqa: RUF012

    @staticmethod
    def law(p, x, v, m, t, a):
        """-grad of J_n R^n P_n(s) / r^(n+1) is J_n R^n / r^(n+2) [P'_(n+1)(s) r / |r| - P'_n(s) pole], since s P'_n +
        (n + 1) P_n = P'_(n+1)."""
        c, gm, j2, j4, pole, n = p.central, p.gm, p.j2, p.j4, p.pole, x.shape[1]
        xc, yc, zc = x[0, c], x[1, c], x[2, c]
        back_x = back_y = back_z = energy = virial = 0.0
        for i in range(n):
            if i == c:
                continue
            dx, dy, dz = x[0, i] - xc, x[1, i] - yc, x[2, i] - zc
            inverse2 = 1.0 / (dx * dx + dy * dy + dz * dz)
            inverse = math.sqrt(inverse2)
            s = (dx * pole[0] + dy * pole[1] + dz * pole[2]) * inverse
            s2 = s * s
            two, four = j2 * inverse2, j4 * inverse2 * inverse2
            slope2, slope3 = 3.0 * s, 1.5 * (5.0 * s2 - 1.0)
            slope4, slope5 = 2.5 * s * (7.0 * s2 - 3.0), 1.875 * ((21.0 * s2 - 14.0) * s2 + 1.0)
            along = gm * inverse2 * inverse * (two * slope3 + four * slope5)
            across = gm * inverse2 * (two * slope2 + four * slope4)
            ax, ay, az = along * dx - across * pole[0], along * dy - across * pole[1], along * dz - across * pole[2]
            a[0, i] += ax
            a[1, i] += ay
            a[2, i] += az
            share = p.share[i]
            back_x, back_y, back_z = back_x + share * ax, back_y + share * ay, back_z + share * az
            u2 = 0.5 * two * (3.0 * s2 - 1.0)
            u4 = 0.125 * four * ((35.0 * s2 - 30.0) * s2 + 3.0)
            energy += m[i] * gm * inverse * (u2 + u4)
            virial += m[i] * gm * inverse * (3.0 * u2 + 5.0 * u4)  # U_n ~ r^-(n+1)
        a[0, c] -= back_x
        a[1, c] -= back_y
        a[2, c] -= back_z
        return energy, virial, n - 1

    def check(p):
        check_positive("j2", radius=p.radius, G=p.G)
        check_central("j2", p.central)
        if not any(p.pole):
            raise InputError(f"pole: expected a vector with a direction, got {list(p.pole)}")

    def check_system(p, system):
        """Refuse a system that this force cannot run."""
        check_open("j2", system)
        if system.dimensions == 2 and p.pole[2] and any(p.pole[:2]):
            raise InputError(
                f"pole: expected a vector along z or in the plane of this two-dimensional system, got {list(p.pole)}"
            )
        central_body("j2", p.central, system)
        gravitational_constant("j2", p.G, system)

    def bound(p, system):
        """The harmonics of this System's central body."""
        central, gm, share = Attraction.of("j2", p, system)
        j2, j4 = p.j2 * p.radius**2, p.j4 * p.radius**4
        return Harmonics(central, gm, j2, j4, axis(p.pole), share)


def axis(pole: Vector) -> Vector:
    """A direction as a unit vector."""
    largest = max(map(abs, pole))
    x, y, z = (p / largest for p in pole)
    length = math.sqrt(x * x + y * y + z * z)
    return x / length, y / length, z / length

"""Gravity beyond a central point: the zonal harmonics J2 to J6 of a flattened body, and powers of the distance."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from kickdrift.errors import InputError
from kickdrift.forces.laws.body_law import body_law
from kickdrift.forces.laws.central import (
    Attraction,
    Central,
    around,
    central_body,
    check_around,
    check_axis,
    check_central,
    check_positive,
    vector,
)
from kickdrift.forces.seam.arguments import Vector, number
from kickdrift.model.state import Floats

Z = (0.0, 0.0, 1.0)


class Harmonics(NamedTuple):
    """The harmonics of one body of a System."""

    central: int
    gm: float  # G M of this body
    zonal: Floats  # (5,) J_n R^n for n = 2 … 6
    more: bool  # whether J3, J5 or J6 is there
    pole: Vector  # of length 1
    share: Floats  # (n,) m / M: this body's share of another body's acceleration


@body_law
class Oblateness(NamedTuple):
    """The zonal harmonics J2 to J6 of a flattened body's field, on top of ``gravity``.

    U = (G M m / r) sum of J_n (R / r)^n P_n(s), P_n Legendre's polynomials, s = r . pole / r, the sine of the latitude
    (Murray & Dermott 1999, Solar System Dynamics, section 6.11). Several bodies may be flattened: give one force for
    each.

    The pole is fixed. The flattened body takes the opposite force, so momentum is conserved. But the body does not take
    the torque, so only the angular momentum along the pole is conserved.

    Attributes
    ----------
    j2 : float
        Positive for a flattened body: 1.0826e-3 for the Earth.
    radius : float
        R, the equatorial radius to which the harmonics refer; a length.
    j3, j4, j5, j6 : float
        Default 0.
    central : str or int, optional
        The flattened body's name or number; default the most massive body.
    pole : (x, y, z)
        Direction of the axis of symmetry, of any length; default z.
    longitude, latitude : float, optional
        Direction of the pole as two angles in degrees, in place of ``pole``: from x towards y, and from the plane of x
        and y towards z. In equatorial coordinates these are the pole's right ascension and declination.
    G : float, optional
        Default the unit system's own.
    """

    j2: float
    radius: float
    j4: float = 0.0
    central: Central = None
    pole: Vector = Z
    G: float | None = None
    j3: float = 0.0
    j5: float = 0.0
    j6: float = 0.0
    longitude: float | None = None
    latitude: float | None = None

    name = "j2"  # type: ignore[misc]
    stands_for = "j2"  # type: ignore[misc]
    by_mass = fastmath = True  # type: ignore[misc]
    dimensions = {  # type: ignore[misc]  # noqa: RUF012
        "radius": "length",
        "G": "gravitational constant",
        "longitude": "angle",
        "latitude": "angle",
    }
    law = staticmethod(around)  # type: ignore[misc]

    @staticmethod
    def pull(p, i, d, u, t):
        """-grad of J_n R^n P_n(s) / r^(n+1) is J_n R^n / r^(n+2) [P'_(n+1)(s) r / |r| - P'_n(s) pole], since s P'_n +
        (n + 1) P_n = P'_(n+1)."""
        pole, zonal, inverse2 = vector(p.pole), p.zonal, 1.0 / (d @ d)
        inverse = math.sqrt(inverse2)
        s = (d @ pole) * inverse
        s2, inverse4 = s * s, inverse2 * inverse2
        two, four = zonal[0] * inverse2, zonal[2] * inverse4
        slope3, slope5 = 1.5 * (5.0 * s2 - 1.0), 1.875 * ((21.0 * s2 - 14.0) * s2 + 1.0)
        slope4 = 2.5 * s * (7.0 * s2 - 3.0)
        energy = 0.5 * two * (3.0 * s2 - 1.0) + 0.125 * four * ((35.0 * s2 - 30.0) * s2 + 3.0)
        along = two * slope3 + four * slope5
        across = two * 3.0 * s + four * slope4
        if p.more:
            three, five, six = (
                zonal[1] * inverse2 * inverse,
                zonal[3] * inverse4 * inverse,
                zonal[4] * inverse4 * inverse2,
            )
            slope6 = 2.625 * s * ((33.0 * s2 - 30.0) * s2 + 5.0)
            slope7 = 0.4375 * (((429.0 * s2 - 495.0) * s2 + 135.0) * s2 - 5.0)
            energy += 0.5 * three * s * (5.0 * s2 - 3.0) + 0.125 * five * s * ((63.0 * s2 - 70.0) * s2 + 15.0)
            energy += 0.0625 * six * (((231.0 * s2 - 315.0) * s2 + 105.0) * s2 - 5.0)
            along += three * slope4 + five * slope6 + six * slope7
            across += three * slope3 + five * slope5 + six * slope6
        scale = p.gm * inverse
        return scale * energy, (scale * inverse2 * along) * d - (scale * inverse * across) * pole

    def check(p):
        check_positive("j2", radius=p.radius, G=p.G)
        check_central("j2", p.central)
        check_axis("pole", p.pole)
        angles = {"longitude": p.longitude, "latitude": p.latitude}
        for key, other in (("longitude", "latitude"), ("latitude", "longitude")):
            if angles[key] is None:
                continue
            number("j2", key, angles[key])
            if angles[other] is None:
                raise InputError(f"{other} is missing; longitude and latitude of the pole go together")
            if tuple(p.pole) != Z:
                raise InputError(f"give pole, or its longitude and latitude, not both; got pole = {list(p.pole)}")

    def check_system(p, system):
        """Refuse a system that this force cannot run."""
        check_around("j2", p, system)
        pole = pole_of(p)
        if system.dimensions == 2 and pole[2] and any(pole[:2]):
            raise InputError(
                f"pole: expected a vector along z or in the plane of this two-dimensional system, got {list(pole)}"
            )

    def bound(p, system):
        """The harmonics of this System's flattened body."""
        central, gm, share = Attraction.of("j2", p, system)
        zonal = np.array([j * p.radius**n for n, j in enumerate((p.j2, p.j3, p.j4, p.j5, p.j6), 2)])
        return Harmonics(central, gm, zonal, any((p.j3, p.j5, p.j6)), axis(pole_of(p)), share)


def pole_of(p: Oblateness) -> Vector:
    """Direction of the pole, of any length."""
    if p.longitude is None or p.latitude is None:
        return p.pole
    longitude, latitude = math.radians(p.longitude), math.radians(p.latitude)
    across = math.cos(latitude)
    return across * math.cos(longitude), across * math.sin(longitude), math.sin(latitude)


def axis(pole: Vector) -> Vector:
    """A direction as a unit vector."""
    largest = max(map(abs, pole))
    x, y, z = (p / largest for p in pole)
    length = math.sqrt(x * x + y * y + z * z)
    return x / length, y / length, z / length


class Power(NamedTuple):
    """The power law of a System's central body."""

    central: int
    acceleration: float
    scale: float
    power: float
    share: Floats


@body_law
class CentralPotential(NamedTuple):
    """A force along the line to the central body, as a power of the distance r: a = acceleration (r / scale)^power.

    It stands for masses that are not bodies of the system: a halo, a disc, a cloud. U = -m acceleration scale
    (r / scale)^(power + 1) / (power + 1), and -m acceleration scale log(r / scale) for power = -1. A nearly circular
    orbit under this force alone turns by 2 pi / sqrt(3 + power) from pericentre to pericentre (Binney & Tremaine 2008,
    Galactic Dynamics, section 3.1). The central body takes the opposite force.

    Attributes
    ----------
    acceleration : float
        Outward acceleration at the distance ``scale``; negative for attraction.
    power : float
    scale : float
        A length; default 1.
    central : str or int, optional
        The central body's name or number; default the most massive body.
    """

    acceleration: float
    power: float
    scale: float = 1.0
    central: Central = None

    name = "central-potential"  # type: ignore[misc]
    dimensions = {"acceleration": "acceleration", "scale": "length"}  # type: ignore[misc]  # noqa: RUF012
    law = staticmethod(around)  # type: ignore[misc]

    @staticmethod
    def pull(p, i, d, u, t):
        r = math.sqrt(d @ d)
        ratio, above = r / p.scale, p.power + 1.0
        strength = p.acceleration * ratio**p.power
        if above == 0.0:
            energy = -p.acceleration * p.scale * math.log(ratio)
        else:
            energy = -strength * r / above
        return energy, (strength / r) * d

    def check(p):
        check_positive("central-potential", scale=p.scale)
        check_central("central-potential", p.central)

    def bound(p, system):
        """The power law of this System's central body."""
        central = central_body("central-potential", p.central, system)
        masses = system.state.masses
        return Power(central, p.acceleration, p.scale, p.power, masses / masses[central])

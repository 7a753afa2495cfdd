"""Sun and planets in JPL's ephemeris DE421, for making system files; no run needs it.

Folkner, Williams & Boggs 2009, The Planetary and Lunar Ephemeris DE421, IPN Progress Report 42-178. Read with the
packages jplephem and de421: pip install 'kickdrift[ephemeris]'.
"""

import math
from collections.abc import Sequence
from datetime import UTC, date, datetime, timedelta
from typing import Any, NamedTuple

import numpy as np

from kickdrift.errors import InputError
from kickdrift.model.state import Floats
from kickdrift.model.units.unit_systems import AU, YEAR
from kickdrift.text import shown, suggestion

DAY = 86400.0
J2000 = 2451545.0
EARTH_MOON = "Earth-Moon"  # barycentre of the Earth and the Moon
SOLAR_SYSTEM = (
    "Sun", "Mercury", "Venus", EARTH_MOON, "Mars", "Jupiter", "Saturn", "Uranus", "Neptune", "Pluto",
)  # fmt: skip
BODIES = (*SOLAR_SYSTEM, "Earth", "Moon")
_GM = dict(zip(SOLAR_SYSTEM, ("GMS", "GM1", "GM2", "GMB", *(f"GM{k}" for k in range(4, 10))), strict=True))


class EphemerisStates(NamedTuple):
    """Bodies at one date, in the ICRF, relative to the barycentre of the solar system.

    Attributes
    ----------
    julian_date : float
        TDB.
    names : tuple of str
    gm : (n,) km^3/s^2
    positions, velocities : (n, 3)
        AU (149,597,870,700 m) and AU a year of 365.25 days.
    """

    julian_date: float
    names: tuple[str, ...]
    gm: Floats
    positions: Floats
    velocities: Floats


def ephemeris_states(when: float | str | date, bodies: Sequence[str] = SOLAR_SYSTEM) -> EphemerisStates:
    """States and G M of bodies at a date.

    Parameters
    ----------
    when : a Julian date, or a calendar date ("2000-01-01T12:00", a datetime), both as barycentric dynamical time (TDB)
    bodies : names from ``BODIES``; "Earth-Moon" is the barycentre of the Earth and the Moon

    Raises
    ------
    InputError
        For a date or a body that DE421 does not have, and if the packages are missing.
    """
    known = {name.lower(): name for name in BODIES}
    if isinstance(bodies, str) or not len(bodies):
        raise InputError(f"bodies: expected a list of one or more of {', '.join(BODIES)}, got {shown(bodies)}")
    for body in bodies:
        if not isinstance(body, str) or body.lower() not in known:
            raise InputError(f"bodies: {shown(body)} is not one of {', '.join(BODIES)}{suggestion(str(body), BODIES)}")
    names = tuple(known[body.lower()] for body in bodies)
    day = julian_date(when)
    ephemeris = _de421()
    if not ephemeris.jalpha <= day <= ephemeris.jomega:
        first, last = (calendar(float(end)) for end in (ephemeris.jalpha, ephemeris.jomega))
        raise InputError(f"date: DE421 reaches from {first} to {last}, got {shown(when)} (Julian date {day:.1f})")
    states = np.array([_state(ephemeris, name, day) for name in names])  # (n, 2, 3), km and km/day
    positions, velocities = states[:, 0] * 1e3 / AU, states[:, 1] * 1e3 / AU * (YEAR / DAY)
    gm = np.array([_gravity(ephemeris, name) for name in names])
    return EphemerisStates(day, names, gm, positions, velocities)


def julian_date(when: float | str | date) -> float:
    """Julian date of a calendar date; a number is returned as it is."""
    if isinstance(when, str):
        try:
            when = datetime.fromisoformat(when)
        except ValueError:
            raise InputError(
                f"date: expected a Julian date or a date such as 2000-01-01T12:00, got {shown(when)}"
            ) from None
    if isinstance(when, date):
        moment = when if isinstance(when, datetime) else datetime(when.year, when.month, when.day)
        if moment.utcoffset():
            raise InputError(
                f"date: is in TDB, which has no time zones; expected a date without a time zone, got {moment}"
            )
        since = moment.replace(tzinfo=UTC) - datetime(2000, 1, 1, 12, tzinfo=UTC)
        return J2000 + since / timedelta(days=1)
    if isinstance(when, bool) or not isinstance(when, int | float | np.number) or not math.isfinite(when):
        raise InputError(f"date: expected a Julian date or a date such as 2000-01-01T12:00, got {shown(when)}")
    return float(when)


def calendar(julian: float) -> str:
    """Calendar date of a Julian date."""
    return (datetime(2000, 1, 1, 12) + timedelta(days=julian - J2000)).isoformat(timespec="minutes")


def _de421() -> Any:
    try:
        import de421
        from jplephem.ephem import Ephemeris
    except ImportError:
        raise InputError("reading JPL's ephemeris needs two packages: pip install 'kickdrift[ephemeris]'") from None
    return Ephemeris(de421)


def _state(ephemeris: Any, name: str, day: float) -> Floats:
    """Barycentric position and velocity, shape (2, 3), in km and km/day."""
    if name in ("Earth", "Moon"):  # the ephemeris has their barycentre, and the Moon relative to the Earth
        from_earth = _read(ephemeris, "moon", day)
        share = 1.0 / (1.0 + ephemeris.EMRAT)
        return _read(ephemeris, "earthmoon", day) + from_earth * (-share if name == "Earth" else 1.0 - share)
    return _read(ephemeris, "earthmoon" if name == EARTH_MOON else name.lower(), day)


def _read(ephemeris: Any, key: str, day: float) -> Floats:
    return np.array([np.ravel(part) for part in ephemeris.position_and_velocity(key, day)])


def _gravity(ephemeris: Any, name: str) -> float:
    """G M in km^3/s^2."""
    both, ratio = float(getattr(ephemeris, _GM[EARTH_MOON])), float(ephemeris.EMRAT)
    shares = {"Earth": ratio / (1.0 + ratio), "Moon": 1.0 / (1.0 + ratio)}
    own = both * shares[name] if name in shares else float(getattr(ephemeris, _GM[name]))
    return own * float(ephemeris.AU) ** 3 / DAY**2

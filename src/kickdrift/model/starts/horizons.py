"""States of bodies from JPL: by name from Horizons, or from an SPK kernel on disk.

Horizons (Giorgini et al. 1996, BAAS 28, 1158; https://ssd.jpl.nasa.gov/horizons) is asked through the package
astroquery and a network. A kernel is read by jplephem, without a network: pip install 'kickdrift[sky]'.
"""

import math
import os
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from kickdrift.errors import InputError
from kickdrift.model.starts.ephemeris import DAY, calendar, julian_date
from kickdrift.model.state import Floats
from kickdrift.model.units.unit_systems import AU, YEAR
from kickdrift.text import choices, clean, shown

SUN, MOST_NAMED = 10, 8  # the Sun's number; bodies of one name that an error lists
OBLIQUITY = math.radians(84381.448 / 3600.0)  # of the ecliptic of J2000 to the equator of the ICRF, IAU 1976
INSTALL = "pip install 'kickdrift[sky]'"
PLANES = {"ecliptic": "ecliptic", "equator": "earth"}  # the names that Horizons has for the planes
ICRF = 1  # number of this frame in a kernel


class Found(NamedTuple):
    """State of one body relative to the origin.

    Attributes
    ----------
    position, velocity : (3,)
        AU (149,597,870,700 m) and AU a year of 365.25 days.
    said : what was asked: body, date, plane and origin
    """

    position: Floats
    velocity: Floats
    said: str


def from_horizons(target: str, date: Any, plane: str = "ecliptic", origin: int = SUN) -> Found:
    """State of a body at a date, by Horizons.

    Parameters
    ----------
    target : as Horizons takes it: "1;" and "Ceres;" are small bodies, "599" and "Jupiter" a planet
    date : a Julian date, or a date such as "2025-01-01T12:00", as barycentric dynamical time (TDB)
    plane : "ecliptic" (of J2000) or "equator" (of the ICRF) is the x-y plane
    origin : NAIF number of the body at the origin; 10 is the Sun

    Raises
    ------
    InputError
        Without astroquery or without a network, and for a body that Horizons does not know, or knows several times.
    """
    day = _day(date, plane)
    try:
        from astroquery.jplhorizons import Horizons
    except ImportError:
        raise InputError(f"horizons: asking JPL Horizons needs astroquery: {INSTALL}") from None
    try:
        table = Horizons(id=target, location=f"500@{origin}", epochs=day).vectors(refplane=PLANES[plane])
        row = table[0]
        values = np.array([float(row[key]) for key in ("x", "y", "z", "vx", "vy", "vz")]).reshape(2, 3)
        name = str(row["targetname"])
    except Exception as error:  # of astroquery, of its network, or of an answer that it cannot read
        raise InputError(f"horizons: {_why(target, error)}") from None
    return Found(values[0], values[1] * (YEAR / DAY), _said(f"JPL Horizons, {clean(name)}", day, plane, origin))


def _why(target: str, error: Exception) -> str:
    """One line about an answer without a state."""
    lines = [" ".join(line.split()) for line in str(error).splitlines() if line.strip()]
    if isinstance(error, ValueError) and "ambiguous" in str(error).lower():
        named = [line for line in lines[1:] if any(letter.isdigit() for letter in line)]
        listed = "; ".join(clean(line) for line in named[:MOST_NAMED])
        more = f"; and {len(named) - MOST_NAMED} more" if len(named) > MOST_NAMED else ""
        return f"{shown(target)} names several bodies, give the number of one: {listed}{more}"
    if isinstance(error, ValueError):
        return f"{shown(target)}: {clean(lines[0] if lines else 'no answer', 200)}"
    kind = type(error).__name__
    return f"no answer from JPL ({kind}); without a network, spk reads a kernel on disk"


def from_kernel(path: Path, target: int, date: Any, plane: str = "ecliptic", origin: int = SUN) -> Found:
    """State of a body at a date, from an SPK kernel.

    Parameters
    ----------
    path : the kernel
    target : NAIF number of the body, such as 2000001 for Ceres
    date, plane, origin : as for `from_horizons`

    Raises
    ------
    InputError
        Without jplephem, for a file that is no kernel, for bodies that the kernel does not join, and for a date
        outside the kernel, with the dates that it has.
    """
    day = _day(date, plane)
    try:
        import jplephem.spk  # noqa: F401
    except ImportError:
        raise InputError(f"spk: reading a kernel needs jplephem: {INSTALL}") from None
    if not os.path.isfile(path):  # Path.is_file raises for long names
        raise InputError(f"spk: there is no file {path}")
    with _read(path):
        kernel = _opened(path)
    try:
        with _read(path):
            segments = list(kernel.segments)
            state = _chain(segments, target, origin, day)
    finally:
        kernel.close()
    if plane == "ecliptic":
        c, s = math.cos(OBLIQUITY), math.sin(OBLIQUITY)
        state = state @ np.array([[1.0, 0.0, 0.0], [0.0, c, s], [0.0, -s, c]]).T
    positions = state * 1e3 / AU
    return Found(positions[0], positions[1] * (YEAR / DAY), _said(f"{path.name}, {target}", day, plane, origin))


def _opened(path: Path) -> Any:
    """The kernel. Raises ValueError if its records of segments form a circle, which jplephem would follow for ever."""
    from jplephem.daf import DAF
    from jplephem.spk import SPK

    file = path.open("rb")
    try:
        records, seen = DAF(file), set[int]()
        record = int(records.fward)
        while record:
            if record in seen:
                raise ValueError("its records of segments form a circle")
            seen.add(record)
            record = int(records.summary_control_struct.unpack(records.read_record(record)[:24])[0])
        return SPK(records)
    except BaseException:
        file.close()
        raise


@contextmanager
def _read(path: Path) -> Iterator[None]:
    try:
        yield
    except InputError:
        raise
    except Exception as error:  # whatever a broken file makes of the reader
        text = clean(" ".join(f"{type(error).__name__}: {error}".split()), 150)
        raise InputError(f"spk: {path.name} is no SPK kernel that jplephem can read: {text}") from None


def _chain(segments: list[Any], target: int, origin: int, day: float) -> Floats:
    """Position and velocity (2, 3) of the target from the origin, in km and km a day, in the ICRF."""
    ways = [dict(_way(segments, body, day)) for body in (target, origin)]
    common = next((body for body in ways[0] if body in ways[1]), None)
    if common is None:
        pairs = sorted({f"{each.target} from {each.center}" for each in segments})
        raise InputError(f"spk: no path from {target} to {origin} in the kernel, which has {choices(pairs)}")
    found: Floats = ways[0][common] - ways[1][common]
    return found


def _way(segments: list[Any], body: int, day: float) -> Iterator[tuple[int, Floats]]:
    """The body itself and those at the centres of its segments, each with the body's state relative to it."""
    state, seen = np.zeros((2, 3)), set[int]()
    yield body, state
    while body not in seen:
        seen.add(body)
        own = [each for each in segments if each.target == body]
        if not own:
            return
        # a later segment has precedence, as in SPICE
        fits = next((each for each in reversed(own) if each.start_jd <= day <= each.end_jd), None)
        if fits is None:
            spans = " and ".join(f"{calendar(each.start_jd)} to {calendar(each.end_jd)}" for each in own)
            raise InputError(f"date: the kernel has {body} from {spans}, got {calendar(day)}")
        if fits.frame != ICRF:
            raise InputError(f"spk: the kernel has {body} in the frame {fits.frame}, and only 1, the ICRF, is read")
        state = state + np.array(fits.compute_and_differentiate(day))
        body = int(fits.center)
        yield body, state


def _day(date: Any, plane: str) -> float:
    if plane not in PLANES:
        raise InputError(f"plane: expected {' or '.join(PLANES)}, got {shown(plane)}")
    return julian_date(date)


def _said(what: str, day: float, plane: str, origin: int) -> str:
    frame = "ecliptic of J2000" if plane == "ecliptic" else "equator of the ICRF"
    return f"{what}: {calendar(day)} TDB (Julian date {day:.9g}), {frame}, origin {origin}"

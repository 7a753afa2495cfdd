"""Make systems/solar-system.toml from JPL's ephemeris, and check that the one that ships is what it says.

    python -m kickdrift_validation.solar_system_from_jpl [--date 2000-01-01T12:00] [--moon] [--output FILE.toml]

Without --output the two shipped files are compared with the ephemeris; needs jplephem and de421.
"""

import argparse
import math
import sys
from pathlib import Path

import numpy as np

import kickdrift as kd
from kickdrift.errors import InputError
from kickdrift.model.starts.coordinates import to_barycentric
from kickdrift.model.starts.ephemeris import SOLAR_SYSTEM, EphemerisStates, calendar, ephemeris_states
from kickdrift.model.units.unit_systems import AU, YEAR
from kickdrift.systemfile.json_schema import NAMED
from kickdrift.systemfile.reading import loads
from kickdrift_validation.claim import Claim, claim, not_run, show

SOURCE = "JPL DE421 (Folkner, Williams & Boggs 2009, IPN Progress Report 42-178)"
APART = (*SOLAR_SYSTEM[:3], "Earth", "Moon", *SOLAR_SYSTEM[4:])
ABOUT = {
    False: ("with the Earth and Moon as one body at their barycentre", "wisdom-holman", 0.005),
    True: ("with the Earth and Moon apart", "gauss-radau15", 0.005),
}
WHY = {
    False: """\
# Earth and Moon are one body at their barycentre, so a step of two days suits all planets. A separate Moon would need
# steps of a day, and a Wisdom-Holman map cannot follow its orbit around the Earth. The merged body lacks the attraction
# of the pair's extent, some 6e-8 of the Sun's, which turns its orbit by 60 km a year. solar-system-moon has the Moon.
""",
    True: """\
# Earth and Moon are separate bodies, and the Moon's month needs short steps. solar-system merges them into one body.
""",
}


def system_file(found: EphemerisStates, moon: bool) -> str:
    what, integrator, dt = ABOUT[moon]
    rows = ",\n".join(f"  [{', '.join(repr(float(c)) for c in row)}]" for row in found.positions)
    speeds = ",\n".join(f"  [{', '.join(repr(float(c)) for c in row)}]" for row in found.velocities)
    masses = ",\n".join(f'  "{round(float(gm), 6)!r} km^3/s^2"' for gm in found.gm)
    names = ", ".join(f'"{name}"' for name in found.names)
    date = f"{calendar(found.julian_date)} TDB (Julian date {found.julian_date!r})"
    text = f"""\
{NAMED}
# The Sun, the eight planets and Pluto from JPL's ephemeris DE421 on {date}
#
# Coordinates are in the ICRF (axes of the Earth's equator of 2000), in AU and AU per year of 365.25 days.
# kickdrift_validation.solar_system_from_jpl made this file; kickdrift moves it to the barycentre on reading.
{WHY[moon]}title = "Sun, planets and Pluto from JPL DE421 at {calendar(found.julian_date)}, {what}"
units = "astro"

[particles]
names = [{names}]
GM = [
{masses},
]
positions = [
{rows},
]
barycentric = true

[velocities]
values = [
{speeds},
]

[[force]]
type = "gravity"

[run]
integrator = "{integrator}"
dt = {dt}
steps = {round(100 / dt)}
every = {round(0.1 / dt)}

[invariants]
momentum = [0.0, 0.0, 0.0]
source = "{SOURCE}, with the packages jplephem and de421"
"""
    energy, turning = sums(text)
    known = f"energy = {energy:.14g} # of these bodies\nangular_momentum = [{', '.join(f'{c:.14g}' for c in turning)}]"
    return text.replace("[invariants]", f"[invariants]\n{known}")


def sums(text: str) -> tuple[float, np.ndarray]:
    """The energy and the angular momentum (3,) of a system file's bodies."""
    system = loads(text)
    assert isinstance(system, kd.System)
    x, v, m = system.state.positions, system.state.velocities, system.state.masses
    i, j = np.triu_indices(len(m), 1)
    pulls = system.units.gravity * m[i] * m[j] / np.linalg.norm(x[i] - x[j], axis=1)
    energy = math.fsum([*(0.5 * m * (v**2).sum(axis=1)), *-pulls])
    return energy, (m[:, None] * np.cross(x, v)).sum(axis=0)


def claims(long: bool = False) -> list[Claim]:
    """The shipped files hold what the ephemeris says."""
    rows = []
    for name, bodies in (("solar-system", SOLAR_SYSTEM), ("solar-system-moon", APART)):
        text, bound = f"{name}: largest difference from the ephemeris, relative", "under 1e-14"
        try:
            found = ephemeris_states("2000-01-01T12:00", bodies)
        except InputError as error:
            print(error)
            rows.append(not_run(text, bound, SOURCE))
            continue
        system = kd.load(name)
        assert isinstance(system, kd.System)
        gm = system.state.masses * system.units.gravity
        far = []
        for ours, theirs in ((system.state.positions, found.positions), (system.state.velocities, found.velocities)):
            theirs = to_barycentric(theirs, found.gm)[0]
            far.append(np.max(np.linalg.norm(ours - theirs, axis=1) / np.linalg.norm(theirs, axis=1)))
        rows.append(claim(text, float(max(far)), bound, max(far) < 1e-14, SOURCE))
        theirs = found.gm * 1e9 / AU**3 * YEAR**2
        off = float(np.max(np.abs(gm / theirs - 1)))
        rows.append(claim(f"{name}: largest difference of G M, relative", off, "under 1e-9", off < 1e-9, SOURCE))
    return rows


def main() -> int:
    """Make a file, or print the claims."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--date", default="2000-01-01T12:00", help="TDB")
    parser.add_argument("--moon", action="store_true", help="Earth and Moon apart")
    parser.add_argument("--output", type=Path)
    parser.add_argument("--overwrite", action="store_true")
    given = parser.parse_args()
    if given.output is None:
        return show(claims())
    if given.output.exists() and not given.overwrite:
        raise SystemExit(f"{given.output}: exists already; pass --overwrite to replace it")
    found = ephemeris_states(given.date, APART if given.moon else SOLAR_SYSTEM)
    given.output.write_text(system_file(found, given.moon), encoding="utf-8")
    print(given.output)
    return 0


if __name__ == "__main__":
    try:
        sys.exit(main())
    except InputError as error:
        print(f"solar_system_from_jpl.py: {error}", file=sys.stderr)
        sys.exit(2)

"""JPL's ephemeris: its states at J2000, refused input, and the system files made from it."""

import json
import sys
from datetime import UTC, datetime

import numpy as np
import pytest

from kickdrift.errors import InputError
from kickdrift.model.starts.ephemeris import BODIES, calendar, ephemeris_states, julian_date
from kickdrift.model.units.unit_systems import UNIT_SYSTEMS
from kickdrift.systemfile.reading import load, loads
from kickdrift_validation.folders import DATA

DE421 = DATA / "solar-system" / "de421.json"
STORED = json.loads(DE421.read_text(encoding="utf-8"))["bodies"]
KEYS = {"Earth-Moon": "earthmoon"}
SHORTER = 149597870.6996262 / 149597870.7  # ratio of DE421's AU to the IAU's
G_ASTRO = UNIT_SYSTEMS["astro"].gravity


def stored(names):
    rows = [STORED[KEYS.get(name, name.lower())] for name in names]
    x, v = (np.array([row[key] for row in rows]) for key in ("position", "velocity"))
    return np.array([row["GM"] for row in rows]) * SHORTER**3 * 365.25**2, x * SHORTER, v * SHORTER * 365.25


def test_the_shipped_solar_system_is_the_ephemeris():
    system = load("solar-system")
    assert system.names == ("Sun", "Mercury", "Venus", "Earth-Moon", "Mars", "Jupiter", "Saturn", "Uranus", "Neptune",
                            "Pluto")  # fmt: skip
    gm, x, v = stored(system.names[:9])  # Pluto is not stored, so compare relative to the Sun
    assert system.state.masses[:9] * G_ASTRO == pytest.approx(gm, rel=2e-12)
    for ours, theirs in ((system.state.positions, x), (system.state.velocities, v)):
        assert np.abs((ours - ours[0])[:9] - (theirs - theirs[0])).max() < 2e-14


def test_earth_and_moon_apart_have_the_same_barycentre():
    together, apart = load("solar-system"), load("solar-system-moon")
    assert len(apart) == 11
    earth, moon = apart.names.index("Earth"), apart.names.index("Moon")
    m = apart.state.masses[[earth, moon]]
    at = together.names.index("Earth-Moon")
    assert m.sum() == pytest.approx(together.state.masses[at], rel=1e-12)
    assert m[0] / m[1] == pytest.approx(81.3005690699153, rel=1e-9)
    middle = m @ apart.state.positions[[earth, moon]] / m.sum()
    assert np.abs(middle - together.state.positions[at]).max() < 1e-14


def test_dates():
    assert julian_date("2000-01-01T12:00") == 2451545.0
    assert julian_date("2000-01-02") == 2451545.5
    assert julian_date(datetime(1999, 12, 31, 12, tzinfo=UTC)) == 2451544.0
    assert julian_date(2451545) == 2451545.0
    assert calendar(2451545.25) == "2000-01-01T18:00"
    for bad in ("yesterday", None, float("nan"), True):
        with pytest.raises(InputError, match="date: expected a Julian date or a date such as"):
            julian_date(bad)


def test_a_body_that_is_not_there_gets_the_nearest_name():
    with pytest.raises(InputError, match=r"bodies: 'Plutto' is not one of .*; did you mean 'Pluto'\?"):
        ephemeris_states("2000-01-01", ["Sun", "Plutto"])


@pytest.mark.parametrize("bodies", ["Mars", []])
def test_bodies_are_a_list(bodies):
    with pytest.raises(InputError, match="bodies: expected a list of one or more of Sun, Mercury"):
        ephemeris_states("2000-01-01", bodies)


def test_a_time_zone_is_refused():
    with pytest.raises(InputError, match="date: is in TDB, which has no time zones"):
        julian_date("2000-01-01T12:00+05:00")


def test_without_the_packages_one_line_says_what_to_install(monkeypatch):
    monkeypatch.setitem(sys.modules, "de421", None)
    with pytest.raises(InputError, match=r"needs two packages: pip install 'kickdrift\[ephemeris\]'"):
        ephemeris_states("2000-01-01")


def test_states_of_the_ephemeris():
    pytest.importorskip("de421")
    found = ephemeris_states("2000-01-01T12:00", BODIES)
    gm, x, v = stored(found.names[:9])
    assert found.gm[:9] * 1e9 * (365.25 * 86400) ** 2 / 149597870700.0**3 == pytest.approx(gm, rel=1e-14)
    assert np.abs(found.positions[:9] - x).max() < 1e-14
    assert np.abs(found.velocities[:9] - v).max() < 1e-14
    lower = ephemeris_states(2451545.0, ["moon"])
    assert lower.names == ("Moon",)
    assert np.linalg.norm(lower.positions[0] - found.positions[10]) * 149597870.7 == pytest.approx(402448.6, abs=0.1)


def test_dates_out_of_range():
    pytest.importorskip("de421")
    for when in ("1899-12-03", "2200-02-02", 0.0):
        with pytest.raises(InputError, match=r"date: DE421 reaches from 1899-12-04T00:00 to 2200-02-01T00:00, got"):
            ephemeris_states(when)


def test_the_shipped_files_are_what_the_script_makes():
    pytest.importorskip("de421")
    from kickdrift_validation import solar_system_from_jpl as script

    for moon, name in ((False, "solar-system"), (True, "solar-system-moon")):
        bodies = script.APART if moon else script.SOLAR_SYSTEM
        text = script.system_file(ephemeris_states("2000-01-01T12:00", bodies), moon)
        assert loads(text, name).source == load(name).source

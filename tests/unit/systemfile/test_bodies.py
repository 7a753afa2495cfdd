"""Bodies on orbits and clusters in system files: the Systems, their invariants, and one line for each bad input."""

import math

import numpy as np
import pytest
from scipy.interpolate import CubicHermiteSpline

from kickdrift.errors import InputError
from kickdrift.model.starts.coordinates import about_centre, attracting_masses
from kickdrift.model.starts.elements import elements
from kickdrift.model.starts.plummer import plummer
from kickdrift.run.simulation import Simulation
from kickdrift.systemfile import reading as systemfile
from kickdrift.systemfile.reading import load, loads

BODIES = """
units = "astro"
[particles]
central = { body = "Sun", mass = 1.0 }
elements = [
  { body = "Jupiter", mass = 9.5e-4, a = 5.2, e = 0.048, inc = 1.3, Omega = 100.5, omega = 273.9, M = 20.0 },
  { body = "Saturn", mass = 2.8e-4, a = 9.5, e = 0.054, inc = 2.5, Omega = 113.6, omega = 339.4, M = 317.0 },
  { body = "comet", mass = 0.0, q = 0.9, e = 1.0, inc = "0.5 rad", T = "-30 day" },
]
[[force]]
type = "gravity"
"""
BELT = BODIES.replace("elements = [", 'seed = 4\nelements = [\n  { body = "rock", count = 40, mass = 0.0, a = [2, 3], '
                      "e = [0.0, 0.2], inc = 5.0, M = [0, 360] },")  # fmt: skip
CLUSTER = """
units = "nbody"
[particles]
plummer = { count = 100, seed = 3 }
[[force]]
type = "gravity"
"""
SYSTEMS = ["sun-jupiter", "kepler-e09", "figure-eight", "pythagorean", "solar-system", "solar-system-moon",
           "outer-solar-system", "trappist-1", "two-planets", "plummer-1000", "test-particles-1000"]  # fmt: skip


def changed(text, old, new):
    assert old in text
    return text.replace(old, new, 1)


def gravity_of(system):
    return next((force.G for force in system.forces if force.G is not None), system.units.gravity)


def energy(system):
    x, v, m = system.state.positions, system.state.velocities, system.state.masses
    heavy = np.flatnonzero(m)
    potential = 0.0
    for k, i in enumerate(heavy):
        r = np.linalg.norm(x[heavy[k + 1 :]] - x[i], axis=1)
        potential -= gravity_of(system) * m[i] * math.fsum(m[heavy[k + 1 :]] / r)
    return 0.5 * math.fsum(m * (v**2).sum(axis=1)) + potential


@pytest.mark.parametrize("name", SYSTEMS)
def test_shipped_bodies_have_the_invariants_that_their_files_name(name):
    system = load(name)
    stated = system.invariants
    x, v, m = system.state.positions, system.state.velocities, system.state.masses
    if not any(force.softening for force in system.forces):
        assert energy(system) == pytest.approx(stated["energy"], rel=1e-13)
    if "angular_momentum" in stated:
        turning = (m[:, None] * np.cross(x, v)).sum(axis=0)
        assert turning == pytest.approx(np.array(stated["angular_momentum"]), rel=1e-13, abs=1e-18)
    assert np.abs(m @ x).max() < 1e-14
    assert len(system.names) == (0 if name == "plummer-1000" else len(system))
    if name in ("sun-jupiter", "kepler-e09"):
        orbit = elements(x[1] - x[0], v[1] - v[0], gravity_of(system) * m.sum())
        assert orbit.period(gravity_of(system) * m.sum()) == pytest.approx(stated["period"], rel=1e-13)


@pytest.mark.parametrize("frame", ["heliocentric", "jacobi", "barycentric"])
def test_elements_mean_what_their_frame_says(frame):
    system = loads(BODIES.replace("elements = [", f'frame = "{frame}"\nelements = [', 1))
    x, v, m = system.state.positions, system.state.velocities, system.state.masses
    assert system.names == ("Sun", "Jupiter", "Saturn", "comet")
    mu = system.units.gravity * attracting_masses(m, frame)
    found = elements(about_centre(x, m, frame), about_centre(v, m, frame), mu)
    assert found.a[:2] == pytest.approx([5.2, 9.5], rel=1e-13)
    assert found.e == pytest.approx([0.048, 0.054, 1.0], abs=1e-14)
    assert np.degrees(found.inc) == pytest.approx([1.3, 2.5, math.degrees(0.5)], rel=1e-12)
    assert np.degrees(found.Omega[:2]) == pytest.approx([100.5, 113.6], rel=1e-12)
    assert np.degrees(found.omega[:2]) == pytest.approx([273.9, 339.4], rel=1e-12)
    assert np.degrees(found.M[:2]) == pytest.approx([20.0, 317.0 - 360.0], rel=1e-12)
    assert found.since_pericentre(mu)[2] == pytest.approx(30 / 365.25, rel=1e-12)
    assert np.abs(m @ x).max() < 1e-17
    assert np.abs(m @ v).max() < 1e-17


def test_many_bodies_are_drawn_from_ranges():
    system = loads(BELT)
    assert len(system) == 44
    assert system.names[:3] == ("Sun", "rock 1", "rock 2")
    assert system.seed == 4
    x, v, m = system.state.positions, system.state.velocities, system.state.masses
    found = elements((x - x[0])[1:41], (v - v[0])[1:41], system.units.gravity)
    assert 2.0 < found.a.min() < 2.2 < 2.8 < found.a.max() < 3.0
    assert 0.0 < found.e.min() < 0.05 < 0.15 < found.e.max() < 0.2
    assert np.degrees(found.inc) == pytest.approx(5.0)
    assert np.array_equal(m[1:41], np.zeros(40))
    assert np.array_equal(loads(BELT).state.positions, x)
    assert not np.array_equal(loads(BELT, seed=5).state.positions, x)
    assert loads(BELT, seed=5).seed == 5


def test_a_period_stands_for_a_semi_major_axis():
    system = loads(changed(BODIES, "a = 5.2", 'P = "4332.59 day"'))
    x, v, m = system.state.positions, system.state.velocities, system.state.masses
    mu = system.units.gravity * (m[0] + m[1])
    assert elements(x[1] - x[0], v[1] - v[0], mu).period(mu) == pytest.approx(4332.59 / 365.25, rel=1e-13)


def test_gravitational_parameters_stand_for_masses():
    system = loads(changed(BODIES, "mass = 1.0", 'GM = "132712440040.944 km^3/s^2"'))
    assert system.state.masses[0] == pytest.approx(1.0, rel=1e-14)
    solar = load("solar-system")
    assert solar.state.masses[0] == pytest.approx(1.0, rel=1e-14)
    assert 1 / solar.state.masses[5] == pytest.approx(1047.3486, rel=1e-7)  # IAU 1976, Jupiter with its moons


def test_positions_are_moved_to_the_barycentre_where_the_file_says_so():
    text = """
    units = "nbody"
    [particles]
    positions = [[0.0, 0, 0], [1.0, 0, 0]]
    masses = [3.0, 1.0]
    BARY
    [velocities]
    values = [[0.0, 0, 0], [0, 1.0, 0]]
    [[force]]
    type = "gravity"
    """
    moved = loads(text.replace("BARY", "barycentric = true"))
    assert moved.state.positions.tolist() == [[-0.25, 0, 0], [0.75, 0, 0]]
    assert moved.state.velocities.tolist() == [[0, -0.25, 0], [0, 0.75, 0]]
    assert loads(text.replace("BARY", "")).state.positions[0].tolist() == [0, 0, 0]
    equal = loads(text.replace("BARY", "barycentric = true").replace("masses = [3.0, 1.0]", ""))
    assert equal.state.positions[0].tolist() == [-0.5, 0, 0]
    with pytest.raises(InputError, match="masses: expected numbers, zero or more, with a positive sum"):
        loads(text.replace("BARY", "barycentric = true").replace("[3.0, 1.0]", "[0.0, 0.0]"))


BAD = [
    (BODIES, "e = 0.048", "e = -0.1", "particles.elements[0] (Jupiter).e: expected an eccentricity, zero or more"),
    (BODIES, "e = 0.048", "e = 1.0", "particles.elements[0] (Jupiter).e: a parabola (e = 1) has no semi-major axis"),
    (BODIES, "a = 9.5", "a = -9.5", "particles.elements[1] (Saturn).a: an ellipse (e < 1) has a positive"),
    (BODIES, "a = 9.5", "a = -9.5, q = 1.0", "particles.elements[1]: expected exactly one of a, q, P, got a and q"),
    (BODIES, "M = 20.0", "M = 20.0, f = 1.0", "particles.elements[0]: expected one of f, M, E, T, got f and M"),
    (BODIES, "mass = 9.5e-4, ", "", "particles.elements[0]: expected exactly one of mass, GM, got none"),
    (BODIES, "inc = 1.3", 'inc = "1.3 furlong"', "particles.elements[0].inc: expected an angle such as"),
    (BODIES, "inc = 1.3", 'inc = "1.3"', "particles.elements[0].inc: missing unit"),
    (BODIES, "inc = 1.3", "incl = 1.3", "particles.elements[0].incl: unknown key; did you mean 'inc'?"),
    (BODIES, "a = 5.2", "a = [5.2, 5.3]", "particles.elements[0]: a is a range, which needs count"),
    (BODIES, "mass = 1.0", "mass = 0.0", "particles.central.mass: expected a positive mass"),
    (BODIES, 'central = { body = "Sun", mass = 1.0 }', "", "particles.central: required key is missing"),
    (BODIES, "elements = [", 'frame = "geocentric"\nelements = [', "particles.frame: expected 'heliocentric', 'jacobi' "
     "or 'barycentric', got 'geocentric'"),
    (BODIES, '"astro"', '"lj"', "particles.elements[2].T: lj quantities are plain numbers, got '-30 day'"),
    (BODIES, '"Saturn"', '"Jupiter"', "names: particle 2 is called 'Jupiter'; expected unique names"),
    (BODIES, "[[force]]", "[velocities]\ntemperature = 1.0\nseed = 1\n[[force]]", "plummer and king already set"),
    (BODIES, "a = 5.2, e = 0.048", 'P = "2 yr", e = 1.5', "particles.elements[0] (Jupiter).P: only an ellipse (e < 1)"),
    (BELT, "seed = 4\n", "", "particles: seed is missing; bodies are drawn with a seed"),
    (BODIES, "elements = [", "seed = 1\nelements = [", "particles: seed needs ranges, but there are none"),
    (BELT, "[2, 3]", "[3, 2]", "particles.elements[0].a: expected a range [low, high], got [3, 2]"),
    (BELT, "e = [0.0, 0.2]", "e = [0.9, 1.2]", "particles.elements[0] (rock).a of body"),
    (CLUSTER, "count = 100", "count = 1", "particles.plummer.count: expected a number greater than or equal to 2"),
    (CLUSTER, "count = 100", "count = 100000", "particles.plummer.scaled: expected false above 50000 stars"),
    (CLUSTER, '"nbody"', '"astro"', 'particles.plummer.half_mass_radius: required key is missing (or virial_rad'),
    (CLUSTER, ", seed = 3", "", "particles.plummer.seed: required key is missing"),
]  # fmt: skip


@pytest.mark.parametrize(("text", "old", "new", "message"), BAD, ids=range(len(BAD)))
def test_a_bad_file_gets_one_line_that_names_the_key(text, old, new, message):
    with pytest.raises(InputError) as error:
        loads(changed(text, old, new), "mine")
    assert message in str(error.value)
    assert "\n" not in str(error.value)


def test_elements_need_a_gravitational_constant():
    with pytest.raises(InputError, match="elements: these units do not set G"):
        loads(changed(changed(BODIES, '"astro"', '"lj"'), 'inc = "0.5 rad", T = "-30 day"', "inc = 3.0, T = -1.0"))
    given = changed(changed(BODIES, '"astro"', '"lj"'), 'inc = "0.5 rad", T = "-30 day"', "inc = 3.0, T = -1.0")
    assert len(loads(given + "G = 2.0\n")) == 4


def test_a_plummer_sphere_has_its_energy_and_rests():
    x, v, m = plummer(500, seed=2)
    r = np.linalg.norm(x[:, None] - x[None], axis=2)[np.triu_indices(500, 1)]
    potential, kinetic = -math.fsum(1 / r) / 500**2, 0.5 * float(m @ (v**2).sum(axis=1))
    assert potential == pytest.approx(-0.5, rel=1e-13)
    assert kinetic == pytest.approx(0.25, rel=1e-13)
    assert np.abs(x.mean(axis=0)).max() < 1e-15
    assert np.abs(v.mean(axis=0)).max() < 1e-15
    assert m.sum() == pytest.approx(1.0, rel=1e-14)


def test_a_drawn_sphere_follows_plummers_profile():
    n = 40_000
    x, v, _ = plummer(n, seed=7, scaled=False)
    b = 3 * math.pi / 16
    r, speed = np.linalg.norm(x, axis=1), np.linalg.norm(v, axis=1)
    # Kolmogorov & Smirnov: one draw in a thousand exceeds 1.95 / sqrt(n)
    limit = 1.95 / math.sqrt(n)
    inside = np.sort(r**3 / (r**2 + b**2) ** 1.5)
    assert np.abs(inside - (np.arange(n) + 0.5) / n).max() < limit
    fraction = np.sort(speed / np.sqrt(2 / np.sqrt(r**2 + b**2)))  # divided by the escape speed
    grid = np.linspace(0, 1, 4001)
    density = grid**2 * (1 - grid**2) ** 3.5
    law = np.interp(fraction, grid, np.cumsum(density) / density.sum())
    assert np.abs(law - (np.arange(n) + 0.5) / n).max() < limit + 1e-3
    for directions in (x / r[:, None], v / speed[:, None]):
        assert np.abs(directions.mean(axis=0)).max() < 4 / math.sqrt(3 * n)
        assert np.abs((directions**2).mean(axis=0) - 1 / 3).max() < 4 * 0.3 / math.sqrt(n)
    # virial ratio of the smooth sphere: K = 1/4 (Aarseth, Henon & Wielen 1974), |U| = 3 pi / (32 b) = 1/2
    kinetic = 0.5 * (speed**2).mean()
    assert kinetic == pytest.approx(0.25, abs=4 * 0.5 * (speed**2).std() / math.sqrt(n))


def test_seeds_tell_spheres_apart():
    assert np.array_equal(plummer(10, 1)[0], plummer(10, 1)[0])
    assert not np.array_equal(plummer(10, 1)[0], plummer(10, 2)[0])
    assert loads(CLUSTER, seed=9).seed == 9
    assert systemfile.load("plummer-1000").seed == 1


# Days (BJD - 2450000) and one standard deviation: the posterior of Agol et al. 2021 (doi:10.3847/PSJ/abd022), from
# data/times_obs_and_posterior.txt of github.com/ericagol/TRAPPIST1_Spitzer. The system file has the most likely orbits.
TRANSITS = {
    "b": (7322.517901124098, 1.27e-4),
    "c": (7282.805833542454, 2.31e-4),
    "d": (7560.801873760247, 3.97e-4),
    "e": (7312.7139006264815, 3.72e-4),
    "f": (7321.522391922048, 7.96e-4),
    "g": (7294.772224390297, 9.23e-4),
    "h": (7662.550861221643, 1.45e-3),
}


def test_trappist_1s_planets_transit_when_they_were_seen_to():
    system = load("trappist-1")
    sim = Simulation(system, "gauss-radau15")
    epoch = 7257.93115525
    for name, (published, deviation) in sorted(TRANSITS.items(), key=lambda item: item[1]):
        i, seen = system.names.index(name), []
        sim.run(until=(published - 0.2 - epoch) / 365.25, every=1000)
        sim.run(
            until=(published + 0.2 - epoch) / 365.25, interval=0.05 / 365.25,
            observe=lambda s, i=i, seen=seen: seen.append((s.time, s.state.phase[:, :, i] - s.state.phase[:, :, 0])),
        )  # fmt: skip
        days = np.array([time for time, _ in seen]) * 365.25 + epoch
        (x, y, _), (v, _, _) = np.array([phase for _, phase in seen]).transpose(1, 2, 0)
        (transit,) = CubicHermiteSpline(days, x, v / 365.25).roots(extrapolate=False)
        assert abs(transit - published) < deviation, name
        assert np.interp(transit, days, y) < 0, "the planet must be in front of the star, seen from below"

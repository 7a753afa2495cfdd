"""Systems made in Python: from elements, body by body, from a dict, and as text."""

from __future__ import annotations

import tomllib

import numpy as np
import pytest

import kickdrift as kd
from kickdrift.model.changing import remaining
from kickdrift.model.units.unit_systems import UNIT_SYSTEMS
from kickdrift.systemfile.reading import loads
from tests.refusals import assert_refused
from tests.systems import liquid

SUN = {"name": "Sun", "mass": 1.0, "radius": "695700 km"}
JUPITER = {
    "name": "Jupiter",
    "mass": 9.5e-4,
    "a": 5.2,
    "e": 0.048,
    "inc": 1.3,
    "Omega": 100.5,
    "omega": 273.9,
    "M": 20.0,
}
COMET = {"name": "comet", "mass": 0.0, "q": 0.9, "e": 1.0, "inc": "0.5 rad", "T": "-30 day"}
SATURN = {"name": "Saturn", "GM": "37940585.2 km^3/s^2", "P": "29.4 yr", "e": 0.054, "f": 110.0}
FILE = """
units = "astro"
force = [{ type = "gravity" }]
[particles]
frame = "%s"
central = { name = "Sun", mass = 1.0, radius = "695700 km" }
elements = [
  { name = "Jupiter", mass = 9.5e-4, a = 5.2, e = 0.048, inc = 1.3, Omega = 100.5, omega = 273.9, M = 20.0 },
  { name = "comet", mass = 0.0, q = 0.9, e = 1.0, inc = "0.5 rad", T = "-30 day" },
  { body = "Saturn", GM = "37940585.2 km^3/s^2", P = "29.4 yr", e = 0.054, f = 110.0 },
]
"""


def planets(**options) -> kd.System:
    return kd.System.from_elements([SUN, JUPITER, COMET, SATURN], **options)


def moons() -> kd.System:
    moon = {"name": "Io", "mass": 4.7e-8, "primary": "Jupiter", "a": "421800 km", "e": 0.004, "inc": 2.2, "f": 50.0}
    return kd.System.from_elements([SUN, JUPITER, moon])


# --- from elements ---


@pytest.mark.parametrize("frame", ["heliocentric", "jacobi", "barycentric"])
def test_elements_in_python_are_those_of_a_file(frame):
    made, read = planets(frame=frame), loads(FILE % frame)
    np.testing.assert_array_equal(made.state.phase, read.state.phase)
    np.testing.assert_array_equal(made.state.masses, read.state.masses)
    np.testing.assert_array_equal(made.radii, read.radii)
    assert (made.names, made.forces, made.units) == (read.names, read.forces, read.units)


def test_drawn_bodies_are_those_of_a_file():
    rocks = {"name": "rock", "mass": 0.0, "count": 20, "a": (2.1, 3.3), "M": np.array([0.0, 360.0])}
    made = kd.System.from_elements([SUN, rocks], seed=np.int64(4))
    table = {"central": SUN, "elements": [rocks], "seed": 4}
    read = kd.load({"units": "astro", "particles": table, "force": [{"type": "gravity"}]})
    np.testing.assert_array_equal(made.state.phase, read.state.phase)
    assert (made.seed, made.names[1], len(made)) == (4, "rock 1", 21)


def test_a_moon_is_about_its_primary():
    system = moons()
    found = system["Io"].elements("Jupiter")
    assert found.a == pytest.approx(421800e3 / 149597870700, rel=1e-12)
    assert (found.e, found.inc, found.f) == pytest.approx((0.004, 2.2, 50.0), rel=1e-9)
    assert pytest.approx(1.77 / 365.25, rel=5e-3) == found.P  # Io's period is 1.77 days
    assert system["Jupiter"].elements().a == pytest.approx(5.2, rel=1e-13)
    momentum = system.state.masses @ system.state.velocities
    assert np.abs(momentum).max() < 1e-18


BAD = [
    (([],), {}, "bodies: expected one body or more, got none"),
    ((SUN,), {}, "bodies: expected a list of tables"),
    (([SUN, 3],), {}, "bodies[1]: expected a table, got 3"),
    (([{**SUN, "a": 1.0}],), {}, "bodies[0].a: unknown key"),
    (([SUN, {**JUPITER, "inclination": 1.0}],), {}, "bodies[1].inclination: unknown key"),
    (([SUN, JUPITER, {**COMET, "e": -1.0}],), {}, "bodies[2] (comet).e: expected an eccentricity, zero or more, got"),
    (([SUN, {**JUPITER, "mass": "1 km"}],), {}, "bodies[1].mass: expected a mass"),
    (([SUN, {**JUPITER, "body": "x"}],), {}, "bodies[1]: name: expected name or body, its older key, got both"),
    (
        ([SUN, {**JUPITER, "primary": "Snu"}],),
        {},
        "no earlier body is called 'Snu'; did you mean 'Sun'? (earlier: Sun)",
    ),
    (([SUN, {**JUPITER, "primary": "Sun"}],), {"frame": "jacobi"}, "primary: goes with frame"),
    (([SUN, JUPITER],), {"frame": "jacob"}, "from_elements.frame: expected 'heliocentric'"),
    (([SUN, {**JUPITER, "count": 2, "a": [5, 6]}],), {}, "from_elements: seed is missing"),
    (([{"mass": 1.0}, JUPITER],), {"units": "lj"}, "these units do not set G"),
    (([SUN, JUPITER],), {"units": "au"}, "units: expected one of lj"),
    (([{**SUN, "mass": 0.0}, JUPITER],), {}, "central.mass: expected a positive mass"),
]


@pytest.mark.parametrize(("given", "options", "expected"), BAD, ids=range(len(BAD)))
def test_bad_bodies_get_one_line(given, options, expected):
    with pytest.raises(kd.InputError) as caught:
        kd.System.from_elements(*given, **options)
    assert expected in str(caught.value)


# --- one body more ---


def test_bodies_one_by_one_are_the_same_as_all_at_once():
    system = kd.System.from_elements([SUN]).add(**JUPITER).with_body(barycentric=True, **SATURN)
    expected = kd.System.from_elements([SUN, JUPITER, SATURN])
    assert system.names == expected.names
    np.testing.assert_allclose(system.state.phase, expected.state.phase, rtol=1e-13, atol=1e-14)
    np.testing.assert_array_equal(system.radii, expected.radii)


def test_a_new_body_leaves_the_old_system_as_it_is():
    old = planets()
    new = old.with_body("probe", mass=0.0, position=[1.0, 2.0, 3.0], velocity=("3 km/s", 0.5, 0.0))
    assert (len(old), len(new), new.names[-1]) == (4, 5, "probe")
    np.testing.assert_array_equal(new.state.phase[:, :, :4], old.state.phase)
    assert new["probe"].velocity.tolist() == [pytest.approx(3 / 4.740470463533, rel=1e-9), 0.5, 0.0]
    assert not new["probe"].position.flags.writeable


def test_an_orbit_read_off_a_body_makes_another():
    """A Trojan 60 degrees ahead of Jupiter, with Jupiter's own elements: the elements of the result equal the input."""
    system = planets()
    j = system["Jupiter"].elements()
    system = system.with_body("Trojan", mass=9.5e-4, a=j.a, e=j.e, inc=j.inc, Omega=j.Omega, omega=j.omega, f=j.f)
    for key in ("position", "velocity"):
        there = getattr(system["Jupiter"], key)
        np.testing.assert_allclose(getattr(system["Trojan"], key), there, rtol=1e-12, atol=1e-13)


def test_a_body_gets_an_id_of_its_own_and_a_time_counts():
    system = planets()
    keep = np.array([True, False, True, True])
    left = remaining(system, keep, system.state.phase, system.state.masses, system.radii).at(
        system.state.phase[:, :, keep], 2.0, ids=system.state.ids[keep]
    )
    more = left.with_body(mass=0.0, a=1.0, e=0.5, T=2.0)
    assert more.state.ids.tolist() == [0, 2, 3, 4]
    assert more.names[-1] == "particle 4"
    assert more.state.time == 2.0
    assert more["particle 4"].elements("Sun").f == pytest.approx(0.0, abs=1e-10)  # at its pericentre, T = t


def test_a_particle_more_in_the_plane():
    system = kd.System([[0.0, 0.0], [1.5, 0.0]], box=(6.0, 6.0), dimensions=2, forces=[kd.LennardJones(cutoff=2.5)])
    more = system.with_body(mass=1.0, position=[3.0, 3.0], velocity=[0.5, 0.0])
    assert more.state.positions[2].tolist() == [3.0, 3.0, 0.0]
    with pytest.raises(kd.InputError, match="particles 1 and 2 overlap"):
        system.with_body(mass=1.0, position=[1.6, 0.0])
    with pytest.raises(kd.InputError, match=r"particle 2 has z = 1"):
        system.with_body(mass=1.0, position=[3.0, 3.0, 1.0])


BAD_BODY = [
    ({"name": "Sun", "mass": 0.0, "a": 3.0}, "is called 'Sun'; expected unique names"),
    ({"name": "", "mass": 0.0, "a": 3.0}, "names[4]: expected a name, got ''"),
    ({"mass": 0.0, "aa": 3.0}, "with_body.aa: unknown key; did you mean 'a'?"),
    ({"mass": 0.0, "a": -3.0}, "with_body: a: an ellipse (e < 1) has a positive semi-major axis, got -3.0"),
    ({"mass": 0.0}, "expected exactly one of a, q, P, got none"),
    ({"a": 1.0}, "expected exactly one of mass, GM, got none"),
    ({"mass": 0.0, "position": [1, 2]}, "with_body.position: expected 3 items, got 2"),
    ({"mass": 0.0, "position": [1, 2, 3], "e": 0.5}, "position: excludes the elements of an orbit, got e"),
    ({"mass": 0.0, "a": 1.0, "velocity": [1, 2, 3]}, "velocity: goes with position"),
    ({"mass": 0.0, "a": 1.0, "count": 2}, "one body is added at a time"),
    ({"mass": 0.0, "a": [1.0, 2.0]}, "a is a range"),
    ({"mass": 0.0, "a": 1.0, "primary": "Jupitr"}, "there is no body 'Jupitr'; did you mean 'Jupiter'?"),
    ({"mass": 0.0, "a": 1.0, "primary": 17}, "there is no body 17"),
    ({"mass": 0.0, "a": 1.0, "primary": "comet"}, "mu: expected a positive number"),
]


@pytest.mark.parametrize(("body", "expected"), BAD_BODY, ids=range(len(BAD_BODY)))
def test_a_bad_body_gets_one_line(body, expected):
    with pytest.raises(kd.InputError) as caught:
        planets().with_body(**body)
    assert expected in str(caught.value)


def test_an_orbit_needs_a_central_body_or_a_primary():
    three = kd.System([[0, 0, 0], [1, 0, 0], [0, 1, 0]], forces=[kd.Gravity()], units="nbody")
    with pytest.raises(kd.InputError, match="primary: required, since no body of 'system' has half of all mass"):
        three.with_body(mass=0.0, a=0.1)
    assert three.with_body(mass=0.0, a=0.1, primary=2)[3].elements(2).a == pytest.approx(0.1)


def test_a_body_by_name_or_id():
    system = planets()
    body = system["Saturn"]
    assert (body.name, body.id, body.species, body.radius) == ("Saturn", 3, "A", 0.0)
    assert body.mass == system.state.masses[3]
    assert body.position.tolist() == system.state.positions[3].tolist()
    assert [each.name for each in system] == list(system.names)
    assert system[0].name == "Sun"
    assert liquid()[5].name == "particle 5"
    assert liquid()[5].radius is None
    with pytest.raises(kd.InputError, match=r"no body 'Jupitr'; did you mean 'Jupiter'\? \(known: Sun, Jupiter"):
        system["Jupitr"]
    with pytest.raises(kd.InputError, match=r"there is no particle 64; expected a number from 0 to 63"):
        liquid()[64]
    with pytest.raises(kd.InputError, match=r"got 'Sun'; or system\['Sun'\]"):
        system.body("Sun")
    with pytest.raises(kd.InputError, match="Sun does not orbit itself; give a primary"):
        system["Sun"].elements()


# --- other forces, other velocities ---


def test_other_forces():
    system = planets()
    other = system.with_forces(kd.Gravity(softening=0.1), kd.PostNewtonian())
    assert other.forces == (kd.Gravity(softening=0.1), kd.PostNewtonian())
    assert other.with_forces([kd.Gravity()]).forces == system.forces == (kd.Gravity(),)
    assert other.with_forces().forces == ()
    np.testing.assert_array_equal(other.state.phase, system.state.phase)
    with pytest.raises(kd.InputError, match="gravity: direct summation needs open space"):
        liquid().with_forces(kd.Gravity(G=1.0))
    with pytest.raises(kd.InputError, match=r"forces\[0\]: expected a force"):
        system.with_forces("gravity", 3)


@pytest.mark.parametrize("name", ["lj-1000", "argon-864", "lj-binary-1000"])
def test_velocities_at_a_temperature_have_the_bits_of_a_file(name):
    file = kd.load(name, seed=5)
    species = [file.species[k] for k in file.species_index]
    bare = kd.System(file.state.positions, None, file.state.masses, file.box, file.forces, file.units, species)
    temperature = {"argon-864": "94.4 K", "lj-1000": 1.44}.get(name, 1.0)
    drawn = bare.with_velocities(temperature=temperature, seed=5)
    np.testing.assert_array_equal(drawn.state.velocities, file.state.velocities)
    assert (drawn.seed, bare.seed) == (5, None)


def test_velocities_in_the_plane_and_given_ones():
    grid = 1.2 * np.indices((5, 5)).reshape(2, -1).T
    plane = kd.System(grid, box=(6.0, 6.0), dimensions=2, masses=np.linspace(1, 2, 25))
    drawn = plane.with_velocities(temperature=0.7, seed=1).state.velocities
    assert not drawn[:, 2].any()
    m = plane.state.masses
    assert np.abs(m @ drawn).max() < 1e-13
    assert (m @ (drawn**2).sum(axis=1)) == pytest.approx(2 * 24 * 0.7, rel=1e-14)
    given = plane.with_velocities(grid)
    np.testing.assert_array_equal(given.state.velocities[:, :2], grid)
    for wrong, expected in (
        ({"temperature": 1.0}, "seed and temperature need each other"),
        ({"seed": 1}, "seed and temperature need each other"),
        ({"values": grid, "seed": 1}, "expected values, or a temperature with a seed, got both"),
        ({"values": grid[:3]}, r"expected shape \(25, 3\) like the positions"),
        ({"temperature": -1.0, "seed": 1}, "temperature: expected a finite number, zero or more"),
        ({"temperature": "1 K", "seed": 1}, "lj quantities are plain numbers"),
        ({"temperature": 1.0, "seed": 0.5}, "seed: expected a whole number"),
    ):
        with pytest.raises(kd.InputError, match=expected):
            plane.with_velocities(**wrong)


# --- a dict, and text ---


def test_a_dict_is_a_system_file():
    x = np.array([[0.0, 0.0, 0.0], [1.5, 0.0, 0.0]])
    data = {
        "units": "lj",
        "particles": {"positions": x, "species": ("A", "B")},
        "force": [{"type": "lennard-jones", "species": {"A": {}, "B": {"sigma": np.float32(0.5)}}}],
        "run": {"dt": 0.01, "steps": np.int32(7)},
    }
    system = kd.load(data)
    np.testing.assert_array_equal(system.state.positions, x)
    assert (system.name, system.source, system.run.steps) == ("system", "", 7)
    assert kd.load({"ode": {"problem": "lorenz"}}).equation == "lorenz"
    assert data["particles"]["positions"] is x
    for wrong, expected in (
        ({}, "system: units: required key is missing"),
        ({**data, "particles": {"positions": x[:, :2]}}, r"system: particles.positions\[0\]: expected 3 items, got 2"),
        ({**data, "forces": []}, "system: forces: unknown key"),
        ({**data, ("a", 1): 2}, r"system: \('a', 1\): unknown key"),
    ):
        with pytest.raises(kd.InputError, match=expected):
            kd.load(wrong)
    with pytest.warns(UserWarning, match="seed: this system draws nothing at random"):
        kd.load(data, seed=1)


class Nameless(kd.HarmonicTrap):
    """A class of forces that is not registered."""


def test_a_system_at_a_later_time_comes_back_at_that_time():
    system = planets().at(planets().state.phase, 0.1 + 0.2)
    back = kd.load(tomllib.loads(system.to_toml()))
    assert back.state.time == 0.1 + 0.2
    assert np.array_equal(back.state.phase, system.state.phase)


def test_what_a_file_cannot_say_is_refused_by_name():
    system = planets()
    crossing = kd.Crossing(lambda t, x, v: x[1, 0], "plane")
    rebound_units = type(system.units)("nbody", "au", "d", "msun", "e", "k", 1.0, gravity=3e-4)
    alone = kd.System([[0, 0, 0]])
    x = np.random.default_rng(1).uniform(size=(150_000, 3))
    many = kd.System(x, x)
    for wrong, expected in (
        (alone.with_forces(Nameless(1.0)), r"to_toml: a system file cannot name the force tests\S*\.Nameless"),
        (system.watched([crossing]), "to_toml: a system file cannot say the crossing 'plane'"),
        (kd.System([[0, 0, 0]], units=rebound_units), "to_toml: units: a system file has no units of au, d and msun"),
        (kd.System([[0, 0, 0]], invariants={"f": print}), "invariants.f: a system file cannot hold"),
        (many, "to_toml: 150,000 particles make a text of .* MiB"),
    ):
        with pytest.raises(kd.InputError, match=expected):
            wrong.to_toml()


def test_units_that_say_nothing_have_no_symbol():
    lj, nbody, metal = (UNIT_SYSTEMS[name] for name in ("lj", "nbody", "metal"))
    assert [lj.symbol(each) for each in ("time", "velocity", "pressure", "temperature")] == [
        "τ",
        "σ/τ",
        "ε/σ^3",
        "ε/k_B",
    ]
    assert {nbody.symbol(each) for each in ("time", "energy", "velocity", "temperature", "mass")} == {""}
    assert nbody.symbol("angle") == "deg"
    assert metal.symbol("velocity") == metal.unit("velocity") == "angstrom/ps"


def test_show_prints_a_file_to_edit(kickdrift, tmp_path, monkeypatch):
    code, text, _ = kickdrift("show", "figure-eight")
    assert (code, loads(text).source) == (0, kd.load("figure-eight").source)
    mine = tmp_path / "mine.toml"
    mine.write_text(text, encoding="utf-8")
    code, out, _ = kickdrift("run", mine, "--steps", "3", "--integrator", "leapfrog", "--dt", "0.01")
    assert code == 0
    lines = dict(line.split(maxsplit=1) for line in out.splitlines())
    assert lines["length"] == "3 steps, 0.03"
    assert lines["integrator"] == "leapfrog, dt = 0.01"
    assert_refused(kickdrift("show", "lj-100"), "neither a file nor a shipped system; did you mean")
    code, out, _ = kickdrift("info", mine)
    assert "plain numbers, G = 1" in out

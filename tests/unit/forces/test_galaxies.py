"""Potentials of galaxies: closed forms, text with units, a strength that changes, files, bridges, and bad input."""

from __future__ import annotations

import math

import numpy as np
import pytest

import kickdrift as kd
from kickdrift.errors import InputError
from kickdrift.forces.bound.forces import BoundForces
from kickdrift.systemfile.reading import loads

X = np.array([[8.0, 0.5, 1.0], [12.4, 1.5, 7.1]])
V = np.array([[0.01, 0.2, 0.05], [0.107, -0.243, -0.105]])
HALO = {"kind": "nfw", "mass": 1.3, "a": 0.4}


def accelerations(force, x=X, units="nbody", time=0.0):
    system = kd.System(x, np.zeros_like(x), 0.0, forces=[force], units=units)
    return BoundForces(system).measure(time, system.state.phase).accelerations.T


def numbers(force):
    return [value for part in force.potentials for key, value in part.items() if key != "kind"]


def test_parts_add_up_and_text_has_units():
    """The Milky Way's parts as text with units, from the published masses, are MWPotential2014; the sum is that of
    the parts. Bodies at the centre feel no force."""
    whole = accelerations(kd.Galaxy("MWPotential2014"), units="galactic")
    tables = [
        {"kind": "miyamoto-nagai", "mass": "68193902782.346 Msun", "a": "3 kpc", "b": "280 pc"},
        {"kind": "power-law", "mass": 4501365375.06545, "alpha": 1.8, "cutoff": "1.9 kpc"},
        {"kind": "nfw", "mass": "4.3683325e11 Msun", "a": "16000 pc"},
    ]
    np.testing.assert_allclose(accelerations(kd.Galaxy(tables), units="galactic"), whole, rtol=1e-7)
    parts = sum(accelerations(kd.Galaxy(each), units="galactic") for each in tables)
    np.testing.assert_allclose(parts, whole, rtol=1e-7)
    natural = accelerations(kd.Galaxy("MWPotential2014"), X / 8.0)
    speed = 220.0 * 1000.0 * 1e6 * 365.25 * 86400.0 / 3.0856775814913674e19
    np.testing.assert_allclose(whole, natural * speed**2 / 8.0, rtol=1e-13)
    assert not accelerations(kd.Galaxy(["MWPotential2014", HALO]), np.zeros((1, 3))).any()


def test_the_circle_of_the_sun_has_its_speed():
    assert np.linalg.norm(accelerations(kd.Galaxy("MWPotential2014"), np.array([[0.6, 0.8, 0.0]]))) == pytest.approx(
        1.0
    )


def test_a_strength_multiplies_its_part():
    text = "max(0.5, a)+step(t-1)*select(t-2, cos(t)^2/2, 7)-abs(-0.1); a=sqrt(t+0.2)"
    plain = accelerations(kd.Galaxy(HALO))
    for t in (0.0, 0.7, 2.0, 5.5):
        strength = max(0.5, math.sqrt(t + 0.2)) + (t >= 1) * (math.cos(t) ** 2 / 2 if t != 2 else 7) - 0.1
        found = accelerations(kd.Galaxy(HALO | {"strength": text}), time=t)
        np.testing.assert_allclose(found, strength * plain, rtol=1e-14)


def test_a_run_goes_back_through_a_galaxy_that_changes():
    parts = ["MWPotential2014", {"kind": "bar", "mass": 0.1, "a": 0.3, "b": 0.1, "c": 0.1, "omega": 1.9, "angle": 20,
             "strength": "1-exp(-t)"}]  # fmt: skip
    force = kd.Galaxy(parts)
    assert (force.time_dependent, force.works, kd.Galaxy("MWPotential2014").works) == (True, True, False)
    system = kd.System([[0.7, 0.2, 0.1]], [[0.1, 0.9, 0.2]], 1.0, forces=[force], units="nbody")
    sim = kd.Simulation(system, "velocity-verlet", 0.01)
    sim.run(until=2.0)
    assert np.abs(sim.state.positions - system.state.positions).max() > 0.5
    sim.run(until=0.0)
    np.testing.assert_allclose(sim.state.positions, system.state.positions, atol=1e-12)


FILE = """
units = "galactic"
[particles]
positions = [["8 kpc", 0, 0]]
mass = 0.0
[velocities]
values = [[0, "220 km/s", 0]]
[[force]]
type = "galaxy"
potentials = {}
[run]
dt = 0.5
steps = 10
"""


def test_a_file_keeps_its_galaxy(tmp_path):
    table = '[{ kind = "nfw", mass = "4e11 Msun", a = "16 kpc", strength = "1+0.1*t" }, "MWPotential2014"]'
    system = loads(FILE.format(table))
    assert system.forces[0].potentials[0] == {"kind": "nfw", "mass": 4e11, "a": 16.0, "strength": "1+0.1*t"}
    again = loads(system.to_toml())
    assert again.forces == system.forces
    path = tmp_path / "run.h5md"
    kd.Simulation(system).run(10, output=path)
    with kd.open(path) as found:
        assert found.system().forces == system.forces


def test_the_mass_of_a_galaxy():
    system = kd.System(X, forces=[kd.Galaxy("MWPotential2014")], units="galactic")
    with pytest.raises(InputError, match=r"galaxy: nfw has an infinite mass, which grows as log\(r\)"):
        system.forces[0].mass(system)
    discs = [{"kind": "plummer", "mass": 2.0, "b": 1.0, "strength": "1.5"}, {"kind": "kepler", "mass": 3.0}]
    assert kd.Galaxy(discs).mass(system) == 6.0


@pytest.mark.parametrize(
    ("potentials", "message"),
    [
        ("MWPotential2015", "potentials[0]: expected 'MWPotential2014' or a table, got 'MWPotential2015'; did you"),
        ("nfw", "potentials[0]: expected 'MWPotential2014' or a table, got 'nfw'; a kind needs its parameters: { kind"),
        ([], "potentials: expected one or more tables of potentials, got []"),
        ({"kind": "king"}, "potentials[0].kind: expected one of kepler, "),
        ({"kind": "nfw", "mass": 0.0, "a": 1.0}, "potentials[0].mass: must be positive, got 0"),
        ({"kind": "nfw", "mass": 1.0}, "potentials[0].a: required key is missing for nfw"),
        (
            {"kind": "power-law", "mass": 1.0, "alpha": 1.0},
            "cutoff: required key is missing for power-law; without a c",
        ),
        ({"kind": "power-law", "mass": 1.0, "alpha": 3.0, "cutoff": 1.0}, "potentials[0].alpha: must be less than 3"),
        ({"kind": "kepler", "mass": 1.0, "b": 2.0}, "potentials[0]: kepler has no 'b'; kepler has mass and strength"),
        (HALO | {"strength": "1+x"}, "potentials[0].strength: the formula has the name 'x'; it may have t, the time"),
        (HALO | {"strength": "1+"}, "potentials[0].strength: formula: '1+' is no expression"),
        (HALO | {"strength": 2.0}, "potentials[0].strength: expected a formula of the time t as text, got 2.0"),
    ],
)
def test_bad_potentials_are_named(potentials, message):
    with pytest.raises(InputError) as error:
        kd.Galaxy(potentials)
    assert message in str(error.value)
    assert str(error.value).startswith("galaxy: ")


def test_systems_without_room_for_a_galaxy_are_refused():
    with pytest.raises(InputError, match="galaxy: needs open space, but the box is periodic; a galaxy has no images"):
        kd.System(X, box=(20.0, 20.0, 20.0), forces=[kd.Galaxy(HALO)], units="nbody")
    with pytest.raises(InputError, match="galaxy: units 'lj' define no G; give G"):
        kd.System(X, forces=[kd.Galaxy(HALO)], units="lj")
    with pytest.raises(InputError, match=r"galaxy: potentials\[0\].strength: 'log\(t\)' has no finite value at t = 0"):
        kd.System(X, forces=[kd.Galaxy(HALO | {"strength": "log(t)"})], units="nbody")


def test_galpys_potentials_and_orbits_come_and_go():
    potentials = pytest.importorskip("galpy.potential")
    there = potentials.SoftenedNeedleBarPotential(amp=0.2, a=0.4, b=0.1, c=0.1, pa=0.3, omegab=1.2)
    force = kd.Galaxy.from_galpy([potentials.MWPotential2014, there], "stellar")
    assert [each["kind"] for each in force.potentials] == ["power-law", "miyamoto-nagai", "nfw", "bar"]
    system = kd.System(1000.0 * X, 1000.0 * V, 0.0, forces=[force], units="stellar")
    orbit, parts = system.to_galpy()
    again = kd.System.from_galpy(orbit, parts, "stellar")
    np.testing.assert_allclose(again.state.phase, system.state.phase, rtol=1e-13, atol=1e-12)
    np.testing.assert_allclose(numbers(again.forces[0]), numbers(force), rtol=1e-13)
    with pytest.raises(InputError, match="from_galpy: BurkertPotential has no counterpart; possible are Kepler"):
        kd.Galaxy.from_galpy(potentials.BurkertPotential())
    pytest.importorskip("gala")
    with pytest.raises(InputError, match="to_gala: bar turns, which has no counterpart there"):
        system.to_gala()


def test_galas_potentials_come_and_go():
    potentials = pytest.importorskip("gala.potential")
    there = potentials.MilkyWayPotential(version="v1")
    force = kd.Galaxy.from_gala(there)
    found = accelerations(force, units="galactic")
    np.testing.assert_allclose(
        found, -there.gradient(X.T).value.T * there.gradient(X.T).unit.to("kpc/Myr2"), rtol=1e-13
    )
    system = kd.System(X, V, 0.0, forces=[force], units="galactic")
    np.testing.assert_allclose(numbers(kd.Galaxy.from_gala(system.to_gala()[1])), numbers(force), rtol=1e-13)
    with pytest.raises(InputError, match="from_gala: JaffePotential has no counterpart; possible are Kepler"):
        kd.Galaxy.from_gala(potentials.JaffePotential(m=1.0, c=1.0, units="galactic"))

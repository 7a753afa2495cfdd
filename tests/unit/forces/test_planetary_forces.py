"""Forces of planetary science against formulas in 50 digits; what they conserve, and what they refuse."""

from __future__ import annotations

import math

import numpy as np
import pytest

import kickdrift as kd
from kickdrift.errors import InputError
from kickdrift.forces.bound.forces import BoundForces
from kickdrift.systemfile.reading import loads
from kickdrift_validation import planetary_formulas

NAMES = list(planetary_formulas.FORMULAS)
CLOSED = [name for name in NAMES if not getattr(planetary_formulas.FORMULAS[name].force, "external", False)]


def measured(force, masses=planetary_formulas.MASSES, units="nbody", dimensions=3):
    x, v = planetary_formulas.start()
    system = kd.System(x, v, masses, forces=[force], units=units, dimensions=dimensions)
    return BoundForces(system).measure(0.0, system.state.phase)


@pytest.mark.parametrize("name", NAMES)
def test_accelerations(name):
    assert planetary_formulas.off(name) < 1e-14


@pytest.mark.parametrize("name", CLOSED)
def test_the_total_momentum_stays(name):
    a, m = measured(planetary_formulas.FORMULAS[name].force).accelerations, np.array(planetary_formulas.MASSES)
    assert np.abs(a @ m).max() <= 1e-14 * (np.abs(a) @ m).max()


def test_several_flattened_bodies():
    """Each has a force of its own; the sum is that of both."""
    forces = [kd.Oblateness(0.1, 0.3, j3=0.02), kd.Oblateness(0.2, 0.2, central=1, longitude=30.0, latitude=60.0)]
    x, v = planetary_formulas.start()
    both = kd.System(x, v, planetary_formulas.MASSES, forces=forces, units="nbody")
    total = BoundForces(both).measure(0.0, both.state.phase).accelerations
    np.testing.assert_allclose(total, sum(measured(force).accelerations for force in forces), rtol=1e-13, atol=1e-16)


def test_a_pole_by_its_angles():
    tilted = kd.Oblateness(0.1, 0.3, longitude=40.0, latitude=-20.0)
    lon, lat = math.radians(40.0), math.radians(-20.0)
    pole = (math.cos(lat) * math.cos(lon), math.cos(lat) * math.sin(lon), math.sin(lat))
    np.testing.assert_allclose(
        measured(tilted).accelerations, measured(kd.Oblateness(0.1, 0.3, pole=pole)).accelerations, rtol=1e-13
    )


def orbit(forces, e=0.3, masses=(1.0, 0.02), tilt=0.4):
    """Two bodies at pericentre, with a = 1, about their centre of mass at rest."""
    mu = sum(masses)
    speed = math.sqrt(mu * (1 + e) / (1 - e))
    x = np.array([[0.0, 0, 0], [1 - e, 0, 0]])
    v = np.array([[0.0, 0, 0], [0, speed * math.cos(tilt), speed * math.sin(tilt)]])
    share = masses[1] / mu
    forces = [kd.Gravity(), *forces]
    return kd.System(x - share * x[1], v - share * v[1], masses, forces=forces, units="nbody")


@pytest.mark.parametrize(
    ("force", "bound"),
    [
        (kd.LenseThirring((0.1, 0.2, 0.5), c=10.0), 1e-14),
        (kd.Tides((0.3, 0.4), (0.2, 0.1)), 1e-13),
        (kd.CentralPotential(-0.2, -1.0, 0.7), 1e-13),
        (kd.RadiationPressure(0.3, form="potential"), 1e-13),
        (kd.Oblateness(0.01, 0.3, j3=0.02, j5=0.03, j6=0.01), 1e-13),
    ],
    ids=lambda value: getattr(value, "name", ""),
)
def test_the_energy_stays(force, bound):
    report = kd.Simulation(orbit([force]), "gauss-radau15").run(until=20.0)
    assert report.energy.max_relative_error < bound
    assert report.momentum_error < 1e-14


def test_the_energy_of_all_pairs_in_relativity_stays_to_second_order():
    """The error falls as c^-4."""
    errors = []
    for c in (30.0, 60.0):
        system = orbit([kd.EinsteinInfeldHoffmann(c=c)], masses=(1.0, 0.7))
        errors.append(kd.Simulation(system, "gauss-radau15").run(until=10.0).energy.max_relative_error)
    assert errors[0] / errors[1] == pytest.approx(16.0, rel=0.1)


@pytest.mark.parametrize(
    "force",
    [
        kd.Tides(0.3, 0.2, 0.05, [(0, 0, 0.3), (0, 0.1, 0.5)]),
        kd.Tides(0.3, 0.2, [0.0, 0.05], rotation="pseudo-synchronous"),
        kd.Migration(50.0, 20.0, 30.0),
        kd.NonGravitational([0.0, 0.01], 1.0, 0.02, 0.03),
        kd.GasDrag(0.02, 1.0, slope=1.0, headwind=0.1, aspect=0.2),
        kd.DynamicalFriction(0.02, 0.6, 3.0),
        kd.LenseThirring((0.1, 0.2, 0.5), c=10.0),
        kd.EinsteinInfeldHoffmann(c=20.0),
        kd.PostNewtonian(c=20.0),
        kd.MassChange([-0.05, 0.02]),
    ],
    ids=lambda force: force.name,
)
def test_a_run_back_in_time_returns(force):
    system = orbit([force])
    sim = kd.Simulation(system, "gauss-radau15")
    sim.run(until=3.0)
    assert np.abs(sim.state.velocities - system.state.velocities).max() > 0.01
    sim.run(until=0.0)
    np.testing.assert_allclose(sim.state.positions, system.state.positions, atol=1e-11)


def test_slow_bodies_are_braked_in_proportion_to_their_speed():
    """The two forms of dynamical friction meet; X = 0.3 is the seam."""
    found = []
    for speed in (0.3 - 1e-9, 0.3 + 1e-9):
        system = kd.System(
            [[0, 0, 0], [1, 0, 0]], [[0, 0, 0], [0, speed * math.sqrt(2.0), 0]], [1.0, 0.1],
            forces=[kd.DynamicalFriction(1.0, 1.0, 1.0)], units="nbody",
        )  # fmt: skip
        found.append(BoundForces(system).measure(0.0, system.state.phase).accelerations[1, 1] / speed)
    assert found[0] == pytest.approx(found[1], rel=1e-8)


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: kd.Oblateness(0.1, 1.0, longitude=3.0), "j2: latitude is missing; longitude and latitude of the pole"),
        (
            lambda: kd.Oblateness(0.1, 1.0, pole=(1, 0, 0), longitude=3.0, latitude=1.0),
            "j2: give pole, or its longitude and latitude, not both",
        ),
        (lambda: kd.EinsteinInfeldHoffmann(c=-1.0), "relativity-eih: c must be a positive number, got -1.0"),
        (
            lambda: kd.RadiationPressure([0.1, -0.2]),
            r"radiation-pressure: beta must be zero or more, got \(0.1, -0.2\)",
        ),
        (lambda: kd.RadiationPressure(0.1, form="half"), "radiation-pressure: form: expected one of full, potential"),
        (lambda: kd.NonGravitational(0.1, 0.0), "non-gravitational: scale must be a positive number, got 0.0"),
        (lambda: kd.Tides(0.1, 1.0, -2.0), "tides: tau must be zero or more, got -2.0"),
        (lambda: kd.Tides(0.1, 1.0, rotation="fast"), "tides: rotation: expected one of none, synchronous, pseudo-"),
        (lambda: kd.Migration(tau_e=-2.0), "migration: tau_e must be zero or more, got -2.0"),
        (lambda: kd.Migration(tau_i={"A": -2.0}), "migration: tau_i must be zero or more"),
        (lambda: kd.Migration(1.0, edge=1.0, width=1.5), "migration: width must be under 1, got 1.5"),
        (lambda: kd.GasDrag(-0.1, 1.0), "gas-drag: coefficient must be zero or more, got -0.1"),
        (lambda: kd.GasDrag(0.1, 1.0, pole=(0, 0, 0)), "gas-drag: pole: expected a vector with a direction"),
        (lambda: kd.DynamicalFriction(1.0, 0.0, 1.0), "dynamical-friction: dispersion must be a positive number"),
        (lambda: kd.MassChange(0.1, "fast"), "mass-change: form: expected one of exponential, linear, got 'fast'"),
    ],
)
def test_refused_parameters(make, message):
    with pytest.raises(InputError, match=f"^{message}"):
        make()


@pytest.mark.parametrize(
    ("force", "options", "message"),
    [
        (kd.EinsteinInfeldHoffmann(), {}, "relativity-eih: units 'nbody' define no speed of light; give c"),
        (kd.LenseThirring((0, 0, 1)), {}, "lense-thirring: units 'nbody' define no speed of light; give c"),
        (kd.RadiationPressure(0.1), {}, "radiation-pressure: units 'nbody' define no speed of light; give c"),
        (kd.RadiationReaction(c=3.0), {"masses": [1, 0, 0]}, "relativity-2.5pn: needs 2 or more bodies with a mass"),
        (kd.Migration(3.0), {"units": "lj"}, "migration: units 'lj' define no G; give G"),
        (kd.Migration(3.0, central=1), {"masses": [1, 0, 0]}, "migration: central: particle 1 has no mass"),
        (kd.CentralPotential(1.0, 1.0, central=4), {}, "central-potential: central: there is no body 4; expected 0 to"),
        (kd.NonGravitational(1.0, 1.0), {"box": (9, 9, 9)}, "non-gravitational: needs open space, and the box is per"),
        (kd.RadiationPressure([0.1, 0.2], c=1.0), {}, "radiation-pressure: beta: 2 values for 3 particles; particle 2"),
        (kd.MassChange(0.1), {"gravity": 0.1}, "mass-change: needs gravity without softening, and 'gravity' has soft"),
    ],
    ids=lambda value: getattr(value, "name", ""),
)
def test_refused_systems(force, options, message):
    given = {"units": "nbody", "masses": [1.0, 0.1, 0.0], **options}
    gravity = [kd.Gravity(softening=given.pop("gravity"))] if "gravity" in given else []
    with pytest.raises(InputError, match=f"^{message}"):
        kd.System(np.eye(3), forces=[*gravity, force], **given)


@pytest.mark.parametrize(
    ("given", "message"),
    [
        ({"tau": 0.1}, "spin: Star has a time lag and no spin; give its spin, or rotation = 'none' or 'synchronous'"),
        ({"tau": 0.1, "rotation": "synchronous"}, "spin: the central body, Star, has a time lag and no spin; rotation"),
        ({"tau": [0, 0.1, 0]}, "spin: b has a time lag and no spin"),
        ({"k2": 0.3}, "k2: dust has no mass, so its tide would move it without limit; give 0"),
    ],
)
def test_tides_that_do_not_say_enough(given, message):
    tides = kd.Tides(**{"k2": [0.1, 0.1, 0.0], "radius": 0.1, **given})
    with pytest.raises(InputError, match=f"^tides: {message}"):
        kd.System(np.eye(3), masses=[1, 0.1, 0], forces=[tides], units="nbody", names=["Star", "b", "dust"])


def test_a_splitting_refuses_a_time_lag_and_takes_static_tides():
    spinning = kd.Tides(0.3, 0.1, 0.1, (0, 0, 1.0))
    with pytest.raises(InputError, match=r"velocity-verlet: needs .* 'tides' depends on velocity"):
        kd.Simulation(orbit([spinning]), dt=0.01)
    kd.Simulation(orbit([kd.Tides(0.3, 0.1)]), "wisdom-holman", dt=0.01)


def test_parameters_with_units_in_a_file():
    text = """units = "astro"
[particles]
central = { name = "Sun", mass = 1.0 }
elements = [{ name = "b", mass = 1e-5, a = 0.1 }, { name = "dust", mass = 0.0, a = 1.0 }]
[[force]]
type = "gravity"
[[force]]
type = "tides"
k2 = [0.03, 0.3, 0]
radius = ["695700 km", "20000 km", 0]
tau = ["0.1 s", "600 s", 0]
spin = [[0, 0, "2.9e-6 s^-1"], [0, 0, 0], [0, 0, 0]]
rotation = "pseudo-synchronous"
[[force]]
type = "radiation-pressure"
beta = [0, 0, 0.2]
[[force]]
type = "migration"
tau_a = [0, "1e5 yr", 0]
edge = "0.05 AU"
"""
    system = loads(text)
    tides, radiation, migration = system.forces[1:]
    assert tides.spin[0][2] == pytest.approx(2.9e-6 * 365.25 * 86400, rel=1e-12)
    assert tides.tau[1] == pytest.approx(600 / (365.25 * 86400), rel=1e-12)
    assert (radiation.beta, migration.tau_a, migration.edge) == ((0, 0, 0.2), (0, 1e5, 0), 0.05)
    assert kd.Simulation(system, "gauss-radau15").run(until=0.1).steps > 0

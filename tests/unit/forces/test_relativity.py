"""The 1PN correction against the formula in NumPy, closed forms, and its conserved quantities."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import kickdrift as kd
from kickdrift.errors import InputError
from kickdrift.forces import Gravity, PostNewtonian
from kickdrift.forces.bound.forces import BoundForces
from kickdrift.model.units.unit_systems import UNIT_SYSTEMS


def bodies(seed=0, n=5, units="nbody", **options):
    """Bodies around a heavy body that is neither first nor at rest."""
    rng = np.random.default_rng(seed)
    masses = rng.uniform(0.0, 1e-2, n)
    masses[n // 2], masses[0] = 1.5, 0.0
    force = PostNewtonian(**{"c": 30.0, "G": 2.0, **options})
    return kd.System(rng.normal(size=(n, 3)), rng.normal(size=(n, 3)), masses, forces=[force], units=units)


def formula(system, central, form, c, G):
    """Accelerations (n, 3), for the central body by Newton's third law, and potential energy of the test bodies."""
    x, v, m = system.state.positions, system.state.velocities, system.state.masses
    a, energy, gm = np.zeros_like(x), 0.0, G * m[central]
    for i in range(len(m)):
        if i == central:
            continue
        d, w = x[i] - x[central], v[i] - v[central]
        r = math.sqrt(d @ d)
        if form == "full":
            a[i] = gm / (c**2 * r**3) * ((4 * gm / r - w @ w) * d + 4 * (d @ w) * w)
            s = m[i] / m[central]
            energy += m[i] / c**2 * (0.375 * (w @ w) ** 2 / (1 + s) + 1.5 * gm / r * (w @ w))
            energy += m[i] / c**2 * (0.5 - 1.5 * s) * (gm / r) ** 2
        else:
            a[i] = -6 * gm**2 / (c**2 * r**4) * d
            energy -= 3 * m[i] * gm**2 / (c * r) ** 2
        a[central] -= m[i] / m[central] * a[i]
    return a, energy


@given(st.integers(0, 2**32 - 1), st.integers(2, 12), st.sampled_from(["full", "potential"]), st.floats(1.0, 1e4))
@settings(max_examples=100, deadline=None)
def test_the_formula(seed, n, form, c):
    system = bodies(seed, n, form=form, c=c)
    measured = BoundForces(system).measure(0.0, system.state.phase)
    a, energy = formula(system, n // 2, form, c, 2.0)
    np.testing.assert_allclose(measured.accelerations.T, a, rtol=1e-12, atol=1e-13 * np.abs(a).max())
    assert measured.potential == pytest.approx(energy, rel=1e-12)
    relative = system.state.positions - system.state.positions[n // 2]
    assert measured.virial == pytest.approx((system.state.masses[:, None] * a * relative).sum(), rel=1e-11, abs=1e-300)
    assert measured.pairs == n - 1
    pushes = system.state.masses * measured.accelerations
    assert np.abs(pushes.sum(axis=1)).max() <= 1e-15 * n * np.abs(pushes).sum()


@pytest.mark.parametrize("units", [name for name, units in UNIT_SYSTEMS.items() if units.light])
def test_the_units_own_speed_of_light(units):
    own = UNIT_SYSTEMS[units]
    G = own.gravity or 1e-3
    system = bodies(1, units=units, c=None, G=None if own.gravity else G)
    measured = BoundForces(system).measure(0.0, system.state.phase)
    in_si = {"metal": 1e-10 / 1e-12, "real": 1e-10 / 1e-15, "gromacs": 1e-9 / 1e-12, "si": 1.0}
    in_si["astro"] = 149597870700.0 / (365.25 * 86400)
    parsec = 648000 / np.pi * 149597870700.0
    in_si |= {"stellar": parsec / (1e6 * 365.25 * 86400), "galactic": 1e3 * parsec / (1e6 * 365.25 * 86400)}
    a, _ = formula(system, 2, "full", 299792458.0 / in_si[units], G)
    np.testing.assert_allclose(measured.accelerations.T, a, rtol=1e-12, atol=1e-14 * np.abs(a).max())


def planet(e, mass=0.0, c=30.0, form="full", central=None):
    """A planet at its pericentre, G = total mass = a = 1, barycentric."""
    r, v = 1 - e, math.sqrt((1 + e) / (1 - e))
    share = np.array([1 - mass, -mass])[:, None]  # planet, star
    return kd.System(
        share * [r, 0, 0], share * [0, v, 0], [mass, 1 - mass],
        forces=[Gravity(), PostNewtonian(c, central, form)], units="nbody", names=("planet", "star"),
    )  # fmt: skip


def advance(system, period, gm, revolutions):
    """Advance of the pericentre per revolution, from the direction of r where r . v = 0 after some revolutions."""
    sim = kd.Simulation(system, "dop853", rtol=2.3e-14, atol=1e-17)
    sim.run(until=(revolutions - 0.03) * period)
    while True:
        x, v = (array[0] - array[1] for array in (sim.state.positions, sim.state.velocities))
        ahead = -(x @ v) / (v @ v - gm / np.linalg.norm(x))  # Newton's method on r . v
        if ahead < 1e-9 * period:
            return (math.atan2(x[1], x[0]) + np.cross(x, v)[2] / (x @ x) * ahead) / revolutions
        sim.run(until=sim.time + 0.5 * ahead)


def test_mercury():
    """42.98 arc seconds a century (Nobili & Will 1986, doi:10.1038/320039a0)."""
    a, e, gm = 0.38709893, 0.20563069, UNIT_SYSTEMS["astro"].gravity
    x, v = [[a * (1 - e), 0, 0], [0, 0, 0]], [[0, math.sqrt(gm / a * (1 + e) / (1 - e)), 0], [0, 0, 0]]
    period = 2 * math.pi * math.sqrt(a**3 / gm)
    expected = 6 * math.pi * gm / ((299792.458 * 31557600 / 149597870.7) ** 2 * a * (1 - e**2))
    for form in ("full", "potential"):
        system = kd.System(x, v, [0.0, 1.0], forces=[Gravity(), PostNewtonian(form=form)], units="astro")
        found = advance(system, period, gm, 10)
        assert found == pytest.approx(expected, rel=1e-6)
        assert math.degrees(found) * 3600 * 100 / period == pytest.approx(42.98, abs=0.005)


@pytest.mark.parametrize("e", [0.01, 0.6])
def test_advance_to_first_order(e):
    """The remaining difference falls as c^-2."""
    errors = []
    for c in (300.0, 600.0):
        found = advance(planet(e, c=c), 2 * math.pi, 1.0, 5)
        errors.append(abs(found / (6 * math.pi / (c**2 * (1 - e**2))) - 1))
    assert errors[0] < 20 / 300**2
    assert errors[0] / errors[1] == pytest.approx(4, rel=0.05)


def largest_energy_error(system):
    sim = kd.Simulation(system, "dop853", rtol=1e-12, atol=1e-14)
    sim.run(until=4 * math.pi, interval=0.2)
    return sim.report().energy.max_relative_error


@pytest.mark.parametrize("mass", [0.0, 0.3])
def test_energy_to_order_four(mass):
    """For a planet of any mass, the change is 16 times smaller if c is doubled. Without the correction's own energy the
    factor would be 4."""
    if mass == 0.0:  # a massless body has no energy, so use a tiny mass
        mass = 1e-12
    errors = [largest_energy_error(planet(0.3, mass, c)) for c in (40.0, 80.0)]
    assert errors[0] / errors[1] == pytest.approx(16, rel=0.1)
    assert errors[0] < 100 * 40.0**-4


def test_energy_of_the_potential_form():
    assert largest_energy_error(planet(0.3, 0.3, 20.0, "potential")) < 1e-11


def test_which_methods_take_it():
    with pytest.raises(InputError, match=r"velocity-verlet: needs .* 'relativity-1pn' depends on velocity"):
        kd.Simulation(planet(0.1), "velocity-verlet", dt=0.01)
    kd.Simulation(planet(0.1, form="potential"), "velocity-verlet", dt=0.01)


def test_the_central_body_by_name_or_number():
    by_default, *others = [
        BoundForces(s).measure(0.0, s.state.phase).accelerations
        for s in (planet(0.2, 0.3, central=central) for central in (None, "star", 1, "planet"))
    ]
    assert np.array_equal(others[0], by_default)
    assert np.array_equal(others[1], by_default)
    assert not np.allclose(others[2], by_default, rtol=1e-9)


def test_refusals():
    x, heavy = np.eye(3), [0.0, 1.0, 2.0]
    for force, options, message in [
        (PostNewtonian(), {"units": "nbody"}, "units 'nbody' define no speed of light; give c"),
        (PostNewtonian(), {"units": "metal"}, "units 'metal' define no G; give G"),
        (PostNewtonian(central="Sol"), {"units": "si"}, "central: there is no body 'Sol'; this system's bodies have"),
        (PostNewtonian(central="Sol"), {"units": "si", "names": ["Sun", "a", "b"]}, "central: there is no body 'Sol';"),
        (PostNewtonian(central=3), {"units": "si"}, "central: there is no body 3; expected 0 to 2"),
        (PostNewtonian(central=0), {"units": "si"}, "central: particle 0 has no mass"),
        (PostNewtonian(), {"units": "si", "box": (9, 9, 9)}, "needs open space, and the box is periodic"),
    ]:
        with pytest.raises(InputError, match=f"^relativity-1pn: {message}"):
            kd.System(x, masses=heavy, forces=[force], **options)
    for options, message in [
        ({"c": 0.0}, "c must be a positive number, got 0.0"),
        ({"c": math.nan}, "c: expected a finite number, got nan"),
        ({"G": -1.0}, "G must be a positive number, got -1.0"),
        ({"central": -1}, "central: expected a body's name or its number from 0 on, got -1"),
        ({"central": 1.5}, "central: expected a body's name or its number from 0 on, got 1.5"),
        ({"central": True}, "central: expected a body's name or its number from 0 on, got True"),
        ({"form": "half"}, "form: expected one of full, potential, got 'half'"),
    ]:
        with pytest.raises(InputError, match=f"^relativity-1pn: {message}$"):
            PostNewtonian(**options)

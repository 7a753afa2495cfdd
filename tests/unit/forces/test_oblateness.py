"""Zonal harmonics against Cartesian formulas, the slope of the potential, and secular rates of orbits."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import kickdrift as kd
from kickdrift.errors import InputError
from kickdrift.forces import Gravity, Oblateness
from kickdrift.forces.bound.forces import BoundForces


def bodies(seed=0, n=5, units="nbody", **options):
    """Bodies around a heavy one in their centre."""
    rng = np.random.default_rng(seed)
    masses = rng.uniform(0.0, 1e-2, n)
    masses[n // 2], masses[0] = 1.5, 0.0
    force = Oblateness(**{"j2": 0.01, "radius": 0.3, "G": 2.0, **options})
    return kd.System(rng.normal(size=(n, 3)), masses=masses, forces=[force], units=units)


def potential(d, gm, radius, j2, j4, pole):
    """U / m at d from the body, with NumPy's Legendre polynomials."""
    r = np.linalg.norm(d)
    coefficients = [0.0, 0.0, j2 * (radius / r) ** 2, 0.0, j4 * (radius / r) ** 4]
    return gm / r * np.polynomial.legendre.legval(d @ pole / r, coefficients)


def pull_of_j2(d, gm, radius, j2):
    """Acceleration by J2 for a pole along z (Vallado 2013, Fundamentals of Astrodynamics and Applications, chapter
    8)."""
    r = np.linalg.norm(d)
    z2 = (d[2] / r) ** 2
    return -1.5 * j2 * gm * radius**2 / r**5 * d * np.array([1 - 5 * z2, 1 - 5 * z2, 3 - 5 * z2])


def assert_third_law(system, accelerations, central):
    m = system.state.masses
    others = np.delete(np.arange(len(m)), central)
    expected = -(m[others] * accelerations[:, others]).sum(axis=1) / m[central]
    scale = (m[others] * np.abs(accelerations[:, others])).sum() / m[central]
    np.testing.assert_allclose(accelerations[:, central], expected, rtol=0, atol=1e-14 * scale)


@given(
    st.integers(0, 2**32 - 1),
    st.integers(2, 12),
    st.floats(1e-9, 0.1).flatmap(lambda j: st.sampled_from([j, -j, 0.0])),
    st.floats(0.01, 0.5),
)
@settings(max_examples=100, deadline=None)
def test_j2_in_cartesian_coordinates(seed, n, j2, radius):
    system = bodies(seed, n, j2=j2, radius=radius)
    measured = BoundForces(system).measure(0.0, system.state.phase)
    x, m, c = system.state.positions, system.state.masses, n // 2
    a = np.array([pull_of_j2(x[i] - x[c], 2.0 * m[c], radius, j2) if i != c else np.zeros(3) for i in range(n)])
    scale = np.abs(a).max()
    others = np.delete(np.arange(n), c)
    np.testing.assert_allclose(measured.accelerations.T[others], a[others], rtol=0, atol=1e-13 * scale)
    assert_third_law(system, measured.accelerations, c)
    energies = [m[i] * potential(x[i] - x[c], 2.0 * m[c], radius, j2, 0.0, np.array([0, 0, 1])) for i in others]
    assert measured.potential == pytest.approx(sum(energies), rel=1e-12, abs=1e-13 * np.abs(energies).sum() + 1e-300)
    virial = sum(m[i] * a[i] @ (x[i] - x[c]) for i in others)
    terms = sum(m[i] * np.abs(a[i]) @ np.abs(x[i] - x[c]) for i in others)
    assert measured.virial == pytest.approx(virial, rel=1e-12, abs=1e-13 * terms + 1e-300)
    assert measured.pairs == n - 1


@pytest.mark.parametrize("pole", [(0, 0, 1), (0, 0, -2.5), (1, 2, -3), (1e-200, 0, 0)])
@pytest.mark.parametrize(("j2", "j4"), [(0.02, 0.0), (0.0, -0.03), (0.02, -0.003)])
def test_potential_and_its_slope(pole, j2, j4):
    system, h = bodies(4, j2=j2, j4=j4, pole=pole), 1e-5
    x, m, c = system.state.positions, system.state.masses, 2
    axis = np.array(pole) / np.abs(pole).max()
    axis /= np.linalg.norm(axis)
    of = lambda d: potential(d, 2.0 * m[c], 0.3, j2, j4, axis)  # noqa: E731
    measured = BoundForces(system).measure(0.0, system.state.phase)
    expected = sum(m[i] * of(x[i] - x[c]) for i in range(5) if i != c)
    assert measured.potential == pytest.approx(expected, rel=1e-12)
    for i in (0, 1, 3, 4):
        d, slope = x[i] - x[c], np.zeros(3)
        for k in range(3):
            step = h * np.eye(3)[k]
            slope[k] = (8 * (of(d + step) - of(d - step)) - of(d + 2 * step) + of(d - 2 * step)) / (12 * h)
        np.testing.assert_allclose(measured.accelerations[:, i], -slope, atol=1e-8 * np.abs(slope).max())
    assert_third_law(system, measured.accelerations, c)
    torque = (m[:, None] * np.cross(x, measured.accelerations.T)).sum(axis=0)
    assert abs(torque @ axis) <= 1e-13 * np.abs(torque).max()


def node_and_pericentre(state):
    """Longitude of the node and argument of the pericentre of a test particle, G M = 1."""
    x, v = (array[1] - array[0] for array in (state.positions, state.velocities))
    h = np.cross(x, v)
    e = np.cross(v, h) - x / np.linalg.norm(x)
    node = np.array([-h[1], h[0], 0.0])
    across = np.cross(h, node) / np.linalg.norm(h)
    return math.atan2(node[1], node[0]), math.atan2(e @ across, e @ node)


@pytest.mark.parametrize("inclination", [0.4, 1.2, 2.5])
def test_secular_rates(inclination):
    """The node moves by -3/2 n J2 (R / p)^2 cos i, the pericentre by 3/4 n J2 (R / p)^2 (5 cos^2 i - 1) relative to the
    node (Murray & Dermott 1999, section 6.11), to first order in J2. One look in each revolution hides the short
    periods."""
    e, j2, radius, revolutions = 0.2, 1e-6, 0.5, 20
    speed = math.sqrt((1 + e) / (1 - e))
    v = [0, speed * math.cos(inclination), speed * math.sin(inclination)]
    system = kd.System(
        [[0, 0, 0], [1 - e, 0, 0]], [[0, 0, 0], v], [1.0, 0.0],
        forces=[Gravity(), Oblateness(j2, radius)], units="nbody",
    )  # fmt: skip
    sim = kd.Simulation(system, "dop853", rtol=2.3e-14, atol=1e-17)
    sim.run(until=revolutions * 2 * math.pi)
    node, pericentre = (angle / revolutions for angle in node_and_pericentre(sim.state))
    unit = 2 * math.pi * j2 * (radius / (1 - e**2)) ** 2
    assert node == pytest.approx(-1.5 * unit * math.cos(inclination), rel=1e-4)
    assert pericentre == pytest.approx(0.75 * unit * (5 * math.cos(inclination) ** 2 - 1), rel=1e-4, abs=1e-4 * unit)


def test_what_is_conserved():
    x, v = [[0, 0, 0], [1, 0, 0.1], [-2, 0.5, 0]], [[0, 0, 0], [0, 1, 0.3], [0, -0.6, 0.2]]
    system = kd.System(x, v, [1.0, 0.1, 0.05], forces=[Gravity(), Oblateness(0.05, 0.5, j4=-0.01)], units="nbody")
    sim = kd.Simulation(system, "dop853", rtol=1e-12, atol=1e-14)
    start = sim.sample()
    report = sim.run(until=20.0)
    assert report.energy.max_relative_error < 1e-10
    assert report.momentum_error < 1e-14
    change = sim.sample().angular_momentum - start.angular_momentum
    assert abs(change[2]) < 1e-12
    assert np.abs(change[:2]).max() > 1e-5  # the pole stays fixed


def test_refusals():
    for options, message in [
        ({"j2": math.nan}, "j2: expected a finite number, got nan"),
        ({"j2": "1e-3"}, "j2: expected a finite number, got '1e-3'"),
        ({"radius": 0.0}, "radius must be a positive number, got 0.0"),
        ({"radius": math.inf}, "radius: expected a finite number, got inf"),
        ({"pole": (0, 0, 0)}, r"pole: expected a vector with a direction, got \[0.0, 0.0, 0.0\]"),
        ({"pole": (0, 1)}, r"pole: expected three numbers, got \(0, 1\)"),
        ({"central": -3}, "central: expected a body's name or its number from 0 on, got -3"),
        ({"G": 0.0}, "G must be a positive number, got 0.0"),
    ]:
        with pytest.raises(InputError, match=f"^j2: {message}$"):
            Oblateness(**{"j2": 1e-3, "radius": 1.0, **options})
    for options, force, message in [
        ({"units": "lj"}, {}, "units 'lj' define no G; give G"),
        ({"units": "nbody", "box": (9, 9, 9)}, {}, "needs open space, and the box is periodic"),
        ({"units": "nbody"}, {"central": 9}, "central: there is no body 9; expected 0 to 2"),
    ]:
        with pytest.raises(InputError, match=f"^j2: {message}$"):
            kd.System(np.eye(3), forces=[Oblateness(1e-3, 1.0, **force)], **options)

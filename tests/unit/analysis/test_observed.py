"""Radial velocities and offsets on the sky, rotations of a System, Poincaré sections."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from scipy.optimize import brentq
from scipy.spatial.transform import Rotation

import kickdrift as kd
from kickdrift.errors import InputError

A, E, INC, OMEGA, MASS = 1.3, 0.3, 63.0, 40.0, 1e-3
BODY = {"name": "b", "mass": MASS, "a": A, "e": E, "inc": INC, "omega": OMEGA, "Omega": 20.0, "M": 0.0}
METHOD = "gauss-radau15"


@pytest.fixture(scope="module")
def system() -> kd.System:
    return kd.System.from_elements([{"name": "star", "mass": 1.0}, BODY])


def kepler(system: kd.System, t: float) -> tuple[float, float, float]:
    """Kepler's solution: the star's radial velocity in m/s (Winn 2010, eq. 49), and the planet's distance and true
    anomaly."""
    n = np.sqrt(system.units.gravity * (1.0 + MASS) / A**3)
    mean = n * t
    eccentric = brentq(lambda u: u - E * np.sin(u) - mean, mean - 1.0, mean + 1.0, xtol=1e-15, rtol=1e-15)
    f = 2.0 * np.arctan2(np.sqrt(1 + E) * np.sin(eccentric / 2), np.sqrt(1 - E) * np.cos(eccentric / 2))
    k = MASS / (1.0 + MASS) * n * A * np.sin(np.radians(INC)) / np.sqrt(1.0 - E * E)
    omega = np.radians(OMEGA)
    speed = k * (np.cos(omega + f) + E * np.cos(omega)) * 149597870700.0 / (365.25 * 86400.0)
    return speed, A * (1.0 - E * np.cos(eccentric)), f


def test_velocities_are_those_of_keplers_solution_at_times_in_any_order(system: kd.System) -> None:
    times = np.array([3.2, 0.0, -1.7, 0.4, 3.2])
    found = kd.analysis.radial_velocities(system, times, integrator=METHOD)
    assert found == pytest.approx([kepler(system, t)[0] for t in times], abs=1e-9)
    side = kd.analysis.radial_velocities(system, times, direction=(0.0, 0.0, -1.0), integrator=METHOD)
    assert side == pytest.approx(-found, abs=1e-12)


def test_light_arrives_late_from_behind(system: kd.System) -> None:
    """The planet's light needs its distance behind the barycentre over the speed of light."""
    times = np.array([0.3, 1.0])
    planet = {"body": "b", "integrator": METHOD}
    seen = kd.analysis.radial_velocities(system, times, light_time=True, **planet)
    for t, velocity in zip(times, seen, strict=True):

        def late(left: float, t: float = t) -> float:
            _, r, f = kepler(system, left)
            height = r / (1.0 + MASS) * np.sin(f + np.radians(OMEGA)) * np.sin(np.radians(INC))
            return left - height / system.units.light - t

        left = brentq(late, t - 1e-3, t + 1e-3, xtol=1e-15)
        assert abs(left - t) > 1e-6
        assert velocity == pytest.approx(-kepler(system, left)[0] / MASS, abs=1e-6)
        assert abs(velocity + kepler(system, t)[0] / MASS) > 1e-3


def test_offsets_north_and_east(system: kd.System) -> None:
    _, r, f = kepler(system, 0.4)
    angle, node, inc = f + np.radians(OMEGA), np.radians(20.0), np.radians(INC)
    x = r * (np.cos(node) * np.cos(angle) - np.sin(node) * np.sin(angle) * np.cos(inc))
    y = r * (np.sin(node) * np.cos(angle) + np.cos(node) * np.sin(angle) * np.cos(inc))
    found = kd.analysis.sky_offsets(system, [0.4], "b", about="star", distance="10 pc", integrator=METHOD)
    assert found[0] == pytest.approx([x / 10, y / 10], abs=1e-9)  # 1 AU at 10 pc is 0.1 arcseconds


def test_frames_of_a_file_and_columns(system: kd.System, tmp_path: Path) -> None:
    path = tmp_path / "run.h5md"
    sim = kd.Simulation(system, METHOD)
    sim.run(times=[0.2, 0.7], output=path, columns=[kd.analysis.radial_velocity("star")])
    asked = kd.analysis.radial_velocities(system, [0.0, 0.2, 0.7], integrator=METHOD)
    assert kd.analysis.radial_velocities(path) == pytest.approx(asked, abs=1e-9)
    columns = [each.columns["radial_velocity_star"] for each in sim.record.samples]
    assert columns == pytest.approx(asked, abs=1e-9)


def test_a_rotation_turns_orbits_and_poles() -> None:
    flat = kd.System.from_elements(
        [{"name": "star", "mass": 1.0}, {"name": "b", "mass": 1e-3, "a": 1.0, "e": 0.1}],
        forces=[kd.Gravity(), kd.Oblateness(j2=1e-3, radius=0.01)],
    )
    turn = Rotation.from_euler("xz", [25.0, 70.0], degrees=True)
    turned = flat.rotated(turn)
    assert turned.forces[1].pole == pytest.approx(turn.apply([0.0, 0.0, 1.0]))
    assert kd.Simulation(turned, METHOD).forces() == pytest.approx(
        turn.apply(kd.Simulation(flat, METHOD).forces().copy())
    )
    back = turned.rotated("invariable")
    assert np.abs(back.state.positions[:, 2]).max() < 1e-15
    assert np.abs(back.state.velocities[:, 2]).max() < 1e-14


def test_a_section_lies_on_its_surface(system: kd.System) -> None:
    """The planet passes its node once a turn, where its distance from the star is that of Kepler's ellipse."""
    section = kd.analysis.poincare_section(
        system,
        lambda t, x, v: x[1, 2] - x[0, 2],
        lambda t, x, v: [np.linalg.norm(x[1] - x[0])],
        until=6.0,
        integrator=METHOD,
    )
    assert len(section.times) == 4
    assert np.abs(section.positions[:, 1, 2] - section.positions[:, 0, 2]).max() < 1e-13
    assert section.values[:, 0] == pytest.approx(A * (1 - E * E) / (1 + E * np.cos(np.radians(OMEGA))), rel=1e-9)
    with pytest.raises(InputError, match="two coordinates"):
        section.plot()


def never(t, x, v):
    return 1.0


@pytest.mark.parametrize(
    ("call", "told"),
    [
        (lambda s: kd.analysis.radial_velocities(s), "times: expected a row"),
        (lambda s: kd.analysis.radial_velocities(s, [1.0], "c"), "no body 'c'"),
        (lambda s: kd.analysis.radial_velocities(s, [1.0], direction=(0, 0, 0)), "direction: expected a vector"),
        (lambda s: kd.analysis.sky_offsets(s, [1.0], north=(0, 0, 1)), "north: points at the observer"),
        (
            lambda s: kd.analysis.sky_offsets(s, [1.0], distance="-1 pc", integrator=METHOD),
            "distance: expected a positive",
        ),
        (lambda s: kd.analysis.radial_velocities(kd.load("pythagorean"), [0.1], light_time=True), "speed of light"),
        (lambda s: s.rotated([[1, 0, 0], [0, 1, 0], [0, 0, -1]]), "is no rotation"),
        (lambda s: s.rotated("ecliptic"), "expected a rotation matrix or"),
        (lambda s: kd.load("lj-1000").rotated("invariable"), "periodic box"),
        (lambda s: s.with_forces(kd.UniformField((0, 0, 1))).rotated("invariable"), "acts from outside"),
        (lambda s: kd.analysis.poincare_section(s, never, never, until=1.0, integrator=METHOD), "no crossing"),
    ],
)
def test_bad_input(system: kd.System, call, told: str) -> None:
    with pytest.raises(InputError, match=told):
        call(system)

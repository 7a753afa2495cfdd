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


@pytest.mark.parametrize("height", [-960.0, 960.0])
def test_light_of_a_star_far_from_the_barycentre_takes_longer_than_a_step_of_a_map(height: float) -> None:
    speed = 2.0 * np.pi / np.sqrt(0.1)
    x, v = [[0.0, 0.0, 0.0], [0.1, 0.0, 0.0], [0.0, 0.0, height]], [[0.0] * 3, [0.0, 0.0, speed], [0.0] * 3]
    system = kd.System(x, v, masses=[1.0, 1e-6, 0.15], units="astro", forces=[kd.Gravity()])
    seen = {"star": 0, "until": "30 day", "light_time": True, "bodies": [1]}
    by_map = kd.transits(system, 1, integrator="wisdom-holman", dt="0.2 day", **seen)
    assert by_map.times == pytest.approx(kd.transits(system, 1, integrator="gauss-radau15", **seen).times, abs=1e-9)


def test_transits_are_those_of_keplers_solution_with_light_on_its_way(system: kd.System) -> None:
    """The distance of both images on the sky is least, each at its own time of departure; and the derivatives are
    differences of such times."""
    light, inc, omega = system.units.light, np.radians(INC), np.radians(OMEGA)

    def image(arrives: float, part: float) -> np.ndarray:
        """Place of a body, a part of the distance between both, when the light leaves that arrives."""

        def place(left: float) -> np.ndarray:
            _, r, f = kepler(system, left)
            along, across = np.cos(f + omega), np.sin(f + omega)
            return part * r * np.array([along, across * np.cos(inc), across * np.sin(inc)])

        left = brentq(lambda t: t - place(t)[2] / light - arrives, arrives - 1e-3, arrives + 1e-3, xtol=1e-16)
        return place(left)[:2]

    def rate(arrives: float, h: float = 3e-4) -> float:
        def far(t: float) -> float:
            return float(np.sum((image(t, 1.0 / (1.0 + MASS)) - image(t, -MASS / (1.0 + MASS))) ** 2))

        near = 8.0 * (far(arrives + h) - far(arrives - h))
        return (near - far(arrives + 2 * h) + far(arrives - 2 * h)) / (12.0 * h)

    found = kd.transits(system, "b", until=3.0, light_time=True, bodies="b", masses=True)
    plain = kd.transits(system, "b", until=3.0)
    assert len(found) == len(plain) == 2
    for k in range(2):
        assert found.times[k] == pytest.approx(brentq(rate, found.times[k] - 1e-3, found.times[k] + 1e-3), abs=2e-10)
        assert 1e-6 < plain.times[k] - found.times[k] < A * 1.3 / light
    state = system.state

    def times(change: int, by: float) -> np.ndarray:
        phase, masses = state.phase.copy(), state.masses.copy()
        if change < 6:
            phase[change // 3, change % 3, 1] += by
        else:
            masses[change - 6] += by
        moved = kd.System(phase[0].T, phase[1].T, masses, forces=system.forces, units=system.units)
        return kd.transits(moved, 1, until=3.0, light_time=True, bodies=1).times

    slopes = np.hstack([found.jacobian, found.by_masses])
    late = slopes - np.hstack([plain.jacobian[:, 3:6], plain.jacobian[:, 9:], np.full((2, 2), np.nan)])
    for column in range(8):
        h = 2e-5
        differ = (8.0 * (times(column, h) - times(column, -h)) - times(column, 2 * h) + times(column, -2 * h)) / (
            12 * h
        )
        assert slopes[:, column] == pytest.approx(differ, abs=2e-9)
        assert column > 5 or np.abs(late[:, column]).max() > 2e-8  # more than the differences are off


def test_eclipses_of_a_circle_are_apart_by_more_than_half_a_period() -> None:
    """Kaplan 2010, doi:10.1088/2041-8205/717/2/L108: P/2 + P K (1 - q) / (pi c) with the lighter body's speed K."""
    q, period = 0.3, 0.2
    pair = kd.System.from_elements([{"mass": 1.0}, {"mass": q, "P": period, "inc": 90.0}])
    light, a = pair.units.light, np.linalg.norm(np.diff(pair.state.positions, axis=0))
    here = {"until": 0.5, "light_time": True, "integrator": METHOD}
    apart = kd.transits(pair, 0, 1, **here).times[1] - kd.transits(pair, 1, 0, **here).times[0]
    speed = 2.0 * np.pi * a / (1.0 + q) / period
    late = period * speed * (1.0 - q) / (np.pi * light)
    assert late > 1e-6
    assert min(abs(apart - late - k * period) for k in (-0.5, 0.5, 1.5)) < 1e-3 * late * speed / light + 1e-13


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
    own = [kd.analysis.radial_velocity("star"), kd.analysis.sky_offset("star", (0, 1, 0))]
    sim.run(times=[0.2, 0.7], output=path, columns=own)
    asked = kd.analysis.radial_velocities(system, [0.0, 0.2, 0.7], integrator=METHOD)
    assert kd.analysis.radial_velocities(path) == pytest.approx(asked, abs=1e-9)
    columns = [each.columns["radial_velocity_star"] for each in sim.record.samples]
    assert columns == pytest.approx(asked, abs=1e-9)
    offsets = kd.analysis.sky_offsets(path, body="star", direction=(0, 1, 0))
    assert [each.columns["sky_offset_star"] for each in sim.record.samples] == pytest.approx(offsets, abs=1e-15)


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
        (
            lambda s: kd.transits(kd.load("pythagorean"), 1, until=1.0, light_time=True),
            "light_time: units 'nbody' have",
        ),
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

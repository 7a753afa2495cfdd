"""Transition matrices and transit times against differences of runs, rebound and closed forms."""

from __future__ import annotations

import json
import math
from typing import NamedTuple

import numpy as np
import pytest

import kickdrift as kd
from kickdrift.errors import InputError
from tests.long import rest
from tests.systems import planets_that_meet, slope

MASSES = [1.0, 1e-3, 3e-4]


def run_to(system: kd.System, integrator: str, dt: float | None, time: float = 5.0) -> np.ndarray:
    sim = kd.Simulation(system, integrator, dt)
    sim.run(until=time)
    return np.concatenate([sim.state.positions.ravel(), sim.state.velocities.ravel()])


@pytest.mark.parametrize(
    ("name", "dt"), [("gauss-radau15", None), ("yoshida4", 0.01), ("wisdom-holman", 0.05), ("saba", 0.05)]
)
def test_columns_are_slopes_of_runs(name, dt):
    found = kd.transition_matrix(planets_that_meet(), 5.0, name, dt, masses=True)
    assert found.by_differences == ()
    assert found.symplectic_error < 1e-13
    end = np.concatenate([found.end.positions.ravel(), found.end.velocities.ravel()])
    np.testing.assert_allclose(end, run_to(planets_that_meet(), name, dt), rtol=0, atol=1e-12)
    size = np.abs(found.matrix).max()
    for column, move in ((3, (0, 1, 0)), (9 + 7, (1, 2, 1)), (0, (0, 0, 0))):
        wanted = slope(lambda by, move=move: run_to(planets_that_meet((*move, by)), name, dt))
        np.testing.assert_allclose(found.matrix[:, column], wanted, rtol=0, atol=1e-9 * size)
    for body in (0, 1):
        masses = np.eye(3)[body]
        wanted = slope(lambda by, e=masses: run_to(planets_that_meet(masses=np.array(MASSES) + by * e), name, dt))
        np.testing.assert_allclose(found.by_masses[:, body], wanted, rtol=0, atol=1e-9 * size)


@pytest.mark.long
def test_columns_by_masses_and_parameters_may_grow():
    def system(mass=1.0):
        x, v = [[0.0, 0.0, 0.0], [1.0, 0.0, 0.0]], [[0.0, 0.0, 0.0], [0.0, 1.0, 0.0]]
        return kd.System(x, v, [mass, 1e-3], forces=[kd.Gravity(G=1.0)], units="nbody")

    found = kd.transition_matrix(system(), 800.0, "gauss-radau15", bodies=1, masses=True, parameters="gravity.G")
    size = np.abs(found.by_masses).max()
    assert size > 1200  # deviations are scaled back at 1024
    wanted = slope(lambda by: run_to(system(1.0 + by), "gauss-radau15", None, 800.0), 1e-6)
    np.testing.assert_allclose(found.by_masses[:, 0], wanted, rtol=0, atol=1e-7 * size)
    whole = found.by_masses @ system().state.masses  # all masses grow like G
    np.testing.assert_allclose(found.by_parameters[:, 0], whole, rtol=0, atol=1e-10 * size)


def test_bodies_select_columns_and_a_simulation_goes_on():
    whole = kd.transition_matrix(planets_that_meet(), 1.0, "yoshida4", 0.01)
    part = kd.transition_matrix(planets_that_meet(), 1.0, "yoshida4", 0.01, bodies=["c", 1])
    assert part.bodies == (2, 1)
    np.testing.assert_array_equal(part.matrix, whole.matrix[:, [6, 7, 8, 3, 4, 5, 15, 16, 17, 12, 13, 14]])
    sim = kd.Simulation(planets_that_meet(), "yoshida4", 0.01)
    sim.run(50)
    first, second = kd.transition_matrix(planets_that_meet(), 0.5, "yoshida4", 0.01), kd.transition_matrix(sim, 0.5)
    assert second.integrator == "yoshida4"
    assert second.start.time == 0.5
    np.testing.assert_allclose(second.matrix @ first.matrix, whole.matrix, rtol=0, atol=1e-12)


def test_a_tangent_map_follows_the_corrector_and_the_star_in_any_place():
    order = [1, 0, 2]
    system = planets_that_meet()
    turned = kd.System(
        system.state.positions[order], system.state.velocities[order], system.state.masses[order],
        forces=system.forces, units="nbody",
    )  # fmt: skip
    found = kd.transition_matrix(turned, 5.0, "wisdom-holman", 0.02, corrector=17)
    sim = kd.Simulation(turned, "wisdom-holman", 0.02, corrector=17)
    sim.run(250)
    np.testing.assert_allclose(found.end.positions, sim.state.positions, rtol=0, atol=1e-12)
    exact = kd.transition_matrix(turned, 5.0, "gauss-radau15")
    np.testing.assert_allclose(found.matrix, exact.matrix, rtol=0, atol=1e-6)
    plain = kd.transition_matrix(turned, 5.0, "wisdom-holman", 0.02)
    assert np.abs(found.matrix - exact.matrix).max() < 0.1 * np.abs(plain.matrix - exact.matrix).max()


J2 = kd.Oblateness(j2=1e-2, radius=0.3, pole=(0.1, 0.0, 1.0), G=1.0)
POTENTIAL = kd.PostNewtonian(c=20.0, form="potential", G=1.0)
FIELD = kd.DrivenField((0.01, 0.0, 0.0), frequency=0.7)


@pytest.mark.parametrize(
    ("name", "forces", "given"),
    [
        ("wisdom-holman", [J2], {"corrector": 5}),
        ("saba", [POTENTIAL, FIELD], {}),
        ("wisdom-holman", [J2, FIELD], {"kernel": "lazy"}),
        ("wisdom-holman", [POTENTIAL], {"kernel": "composition", "corrector": 3}),
        ("wisdom-holman", [], {"kernel": "modified-kick", "corrector": 3}),
    ],
)
def test_a_tangent_map_follows_other_forces_and_kernels(name, forces, given):
    order = [1, 0, 2]  # the star in the middle

    def system(move=(0, 0, 0, 0.0)):
        made = planets_that_meet(move)
        x, v = made.state.positions[order], made.state.velocities[order]
        return kd.System(x, v, made.state.masses[order], forces=[kd.Gravity(G=1.0), *forces], units="nbody")

    def end(by):
        sim = kd.Simulation(system((0, 1, 0, by)), name, 0.05, **given)
        sim.run(until=5.0)
        return np.concatenate([sim.state.positions.ravel(), sim.state.velocities.ravel()])

    found = kd.transition_matrix(system(), 5.0, name, 0.05, **given)
    assert found.symplectic_error < 1e-14
    reached = np.concatenate([found.end.positions.ravel(), found.end.velocities.ravel()])
    np.testing.assert_allclose(reached, end(0.0), rtol=0, atol=1e-12)
    size = np.abs(found.matrix).max()
    np.testing.assert_allclose(found.matrix[:, 0], slope(end), rtol=0, atol=1e-9 * size)


def test_a_tangent_map_takes_masses_and_parameters_of_other_forces():
    def system(masses=MASSES, j2=1e-2):
        flat = kd.Oblateness(j2=j2, radius=0.3, pole=(0.1, 0.0, 1.0), G=1.0)
        return planets_that_meet(masses=masses).with_forces(kd.Gravity(G=1.0), flat, POTENTIAL)

    def run(**changed):
        return run_to(system(**changed), "wisdom-holman", 0.05)

    found = kd.transition_matrix(system(), 5.0, "wisdom-holman", 0.05, masses=True, parameters="j2.j2")
    wanted = slope(lambda by: run(j2=1e-2 + by), 1e-3)
    np.testing.assert_allclose(found.by_parameters[:, 0], wanted, rtol=0, atol=1e-9 * np.abs(wanted).max())
    for body, h in ((0, 1e-3), (1, 1e-4)):
        wanted = slope(lambda by, body=body: run(masses=np.array(MASSES) + by * np.eye(3)[body]), h)
        np.testing.assert_allclose(found.by_masses[:, body], wanted, rtol=0, atol=1e-8 * np.abs(wanted).max())


@pytest.mark.long
def test_deviations_follow_epicycles():
    def end(by):
        sim = kd.Simulation(sheet(by), "sei", 0.02)
        sim.run(until=3.0)
        return np.concatenate([sim.state.positions.ravel(), sim.state.velocities.ravel()])

    def sheet(by=0.0):
        x = [[0.1 + by, 0.2, 0.0], [0.9, -0.3, 0.05], [-0.7, 0.6, -0.02]]
        v = [[0.0, -0.15, 0.01], [0.1, -1.4, 0.0], [0.05, 1.0, 0.0]]
        forces = [kd.Hill(omega=1.0, vertical=1.3), kd.Gravity(G=1.0)]
        return kd.System(x, v, [1e-2, 2e-2, 1e-2], forces=forces, units="nbody")

    found = kd.transition_matrix(sheet(), 3.0, "sei", 0.02)
    assert found.symplectic_error < 1e-14
    assert found.by_differences == ()
    np.testing.assert_allclose(found.matrix[:, 0], slope(end), rtol=0, atol=1e-9 * np.abs(found.matrix).max())


def test_a_tangent_map_is_symplectic_over_long_runs():
    found = kd.transition_matrix(planets_that_meet(), 500.0, "wisdom-holman", 0.05)
    assert found.steps == 10_000
    assert found.symplectic_error < 1e-13
    assert kd.transition_matrix(kd.load("trappist-1"), "10 day").integrator == "wisdom-holman"


def test_a_scaled_deviation_is_the_same(monkeypatch):
    plain = kd.transition_matrix(planets_that_meet(), 5.0, "yoshida4", 0.01)
    monkeypatch.setattr("kickdrift.analysis.tangents.varied_run.LARGEST", 2.0)
    scaled = kd.transition_matrix(planets_that_meet(), 5.0, "yoshida4", 0.01)
    np.testing.assert_array_equal(scaled.matrix, plain.matrix)


def test_harmonic_motion_has_a_closed_form():
    k, t = np.array([1.0, 4.0, 0.25]), 1.7
    system = kd.System([[0.3, -0.2, 0.9]], [[0.1, 0.0, 0.4]], forces=[kd.HarmonicTrap(tuple(k))], units="nbody")
    w = np.sqrt(k)
    wanted = np.block(
        [[np.diag(np.cos(w * t)), np.diag(np.sin(w * t) / w)], [np.diag(-w * np.sin(w * t)), np.diag(np.cos(w * t))]]
    )
    found = kd.transition_matrix(system, t, "gauss-radau15")
    np.testing.assert_allclose(found.matrix, wanted, rtol=0, atol=1e-13)


@kd.body_law
class WholeArrays(NamedTuple):
    k: float

    def law(p, x, v, m, t, a):
        a -= p.k * x
        return 0.5 * p.k * np.sum(m * x * x)


@kd.body_law
class WholeColumns(NamedTuple):
    k: float

    def law(p, x, v, m, t, a):
        energy = 0.0
        for i in range(x.shape[1]):
            a[:, i] += -p.k * x[:, i]
            energy += 0.5 * p.k * m[i] * np.sum(x[:, i] ** 2)
        return energy


@kd.body_law
class Accumulated(NamedTuple):
    """A law that adds to an array of plain numbers, which holds no duals."""

    k: float

    works = True

    def law(p, x, v, m, t, a):
        for i in range(x.shape[1]):
            push = np.zeros(3)
            push -= p.k * x[:, i]
            a[:, i] += push


def test_slopes_by_masses_and_parameters_of_all_forces():
    def system(masses=MASSES, j2=1e-2, G=1.0) -> kd.System:
        flat = kd.Oblateness(j2=j2, radius=0.3, pole=(0.1, 0.0, 1.0), G=G)
        return planets_that_meet(masses=masses).with_forces(kd.Gravity(G=1.0), flat, kd.PostNewtonian(c=20.0, G=1.0))

    found = kd.transition_matrix(system(), 2.0, masses=True, parameters=["j2.j2", "j2.G"])
    assert (found.by_masses.shape, found.by_parameters.shape) == ((18, 3), (18, 2))

    def end(**changed):
        return run_to(system(**changed), "gauss-radau15", None, 2.0)

    wanted = [slope(lambda by: end(j2=1e-2 + by), 1e-3), slope(lambda by: end(G=1.0 + by), 1e-2)]
    np.testing.assert_allclose(found.by_parameters.T, wanted, rtol=0, atol=1e-9 * np.abs(wanted).max())
    for body in range(3):
        way = np.eye(3)[body]
        wanted = slope(lambda by, way=way: end(masses=np.array(MASSES) + by * way), 1e-4)
        np.testing.assert_allclose(found.by_masses[:, body], wanted, rtol=0, atol=1e-9 * np.abs(wanted).max())
    with pytest.raises(
        InputError, match=r"parameters: expected FORCE\.KEY with a force of gravity, j2, relativity-1pn"
    ):
        kd.transition_matrix(system(), 2.0, parameters=["j3.radius"])
    with pytest.raises(InputError, match=r"parameters: j2\.pole: expected a parameter that is one number"):
        kd.transition_matrix(system(), 2.0, parameters="j2.pole")


@pytest.mark.parametrize(
    ("law", "error"), [rest(WholeArrays, 1e-13), rest(WholeColumns, 1e-13), rest(Accumulated, 1e-8)]
)
def test_a_law_of_whole_arrays_has_exact_slopes_or_says_that_it_has_none(law, error):
    system = kd.System([[0.3, -0.2, 0.9], [1.0, 0.0, 0.0]], forces=[law(k=1.0)], units="nbody")
    found = kd.transition_matrix(system, 1.7, "gauss-radau15")
    differs = law is Accumulated
    assert found.by_differences == ((law.name,) if differs else ())
    assert (f"by central differences: {law.name}" in str(found)) == differs
    np.testing.assert_allclose(found.matrix[:6, :6], math.cos(1.7) * np.eye(6), rtol=0, atol=error)


@pytest.mark.parametrize(
    ("given", "message"),
    [
        ({"bodies": "d"}, "bodies: there is no body 'd'; names are star, b, c"),
        ({"bodies": [0, 0]}, "bodies: expected one body or more, each once"),
        ({"bodies": 9}, "bodies: there is no body 9"),
        ({"integrator": "hermite4"}, "integrator: hermite4 carries no variations"),
        ({"time": -1.0}, "time must be a positive finite time"),
        ({"integrator": "saba"}, "dt is needed"),
        (
            {"integrator": "wisdom-holman", "dt": 0.1, "coordinates": "democratic-heliocentric"},
            "coordinates: the tangent map of wisdom-holman takes jacobi alone, got democratic-heliocentric",
        ),
    ],
)
def test_what_makes_no_sense_is_said(given, message):
    with pytest.raises(InputError, match=message):
        kd.transition_matrix(planets_that_meet(), **{"time": 1.0, **given})


def test_forces_without_variations_are_refused():
    with pytest.raises(InputError, match="force 'gravity-tree': has no variational equations"):
        kd.transition_matrix(planets_that_meet().with_forces(kd.GravityTree(G=1.0)), 0.1)
    flat = planets_that_meet().with_forces(kd.Gravity(G=1.0), kd.Oblateness(j2=1e-3, radius=0.1, G=1.0))
    with pytest.raises(InputError, match=r"map of wisdom-holman takes none of gravity; .* takes gravity\.G"):
        kd.transition_matrix(flat, 1.0, "wisdom-holman", 0.1, parameters="gravity.G")
    whole = planets_that_meet().with_forces(kd.Gravity(G=1.0), Accumulated(k=1.0))
    for name in ("wisdom-holman", "trace"):
        with pytest.raises(InputError, match=f"{name}: its tangent map needs exact slopes of accumulated"):
            kd.transition_matrix(whole, 1.0, name, 0.1)
    with pytest.raises(InputError, match="takes a System or a Simulation, got str"):
        kd.transition_matrix("two-body", 0.1)


# --- transits ---


def test_keplers_transits_come_once_a_period():
    """For an orbit of two bodies, the time of transit moves with the start as the period and the phase do."""
    x, v = [[0.0, 0, 0], [1.0, 0.0, 0.3]], [[0.0, 0, 0], [0.0, 1.0, 0.0]]

    def moved(half=0, axis=0, by=0.0):
        start = np.array([x, v])
        start[half, 1, axis] += by
        return kd.System(*start, [1.0, 0.0], forces=[kd.Gravity(G=1.0)], units="nbody")

    found = kd.transits(moved(), 1, 0, until=30.0, direction=(0.0, -2.0, 0.0), bodies=1)
    a = 1.0 / (2.0 / math.hypot(1.0, 0.3) - 1.0)
    np.testing.assert_allclose(np.diff(found.times), 2 * math.pi * a**1.5, rtol=1e-12)
    assert found.jacobian.shape == (len(found), 6)
    for half in range(2):
        for axis in range(3):
            wanted = slope(
                lambda by, at=(half, axis): (
                    kd.transits(moved(*at, by), 1, 0, until=30.0, direction=(0, -1, 0), bodies=1).times
                )
            )
            np.testing.assert_allclose(found.jacobian[:, 3 * half + axis], wanted, rtol=1e-8, atol=1e-8)


def test_transits_of_a_simulation_go_on_from_its_time():
    whole = kd.transits(planets_that_meet(), "b", until=14.0, direction=(1, 0, 0))
    sim = kd.Simulation(planets_that_meet(), "gauss-radau15")
    sim.run(until=8.0)
    rest = kd.transits(sim, "b", until=14.0, direction=(1, 0, 0))
    assert len(whole) == len(rest) + 1
    np.testing.assert_allclose(rest.times, whole.times[1:], rtol=1e-13)


def test_transits_are_those_of_rebound():
    rebound = pytest.importorskip("rebound")
    system = kd.load("trappist-1")
    found = kd.transits(system, "c", until="8 day", direction=(0, -1, 0), bodies="c")
    sim = rebound.Simulation()
    sim.G, sim.integrator = system.units.gravity, "ias15"
    for m, x, v in zip(system.state.masses, system.state.positions, system.state.velocities, strict=True):
        sim.add(m=m, x=x[0], y=x[1], z=x[2], vx=v[0], vy=v[1], vz=v[2])
    star, planet = sim.particles[0], sim.particles[2]
    for time in found.times:
        low, high = time - 1e-4, time + 1e-4
        while high - low > 1e-14:
            sim.integrate(0.5 * (low + high))
            rate = (planet.x - star.x) * (planet.vx - star.vx) + (planet.z - star.z) * (planet.vz - star.vz)
            assert planet.y < star.y
            low, high = (sim.t, high) if rate < 0 else (low, sim.t)
        assert abs(low - time) * 365.25 < 1e-10


@pytest.mark.parametrize(
    ("given", "message"),
    [
        ({"planet": "b", "until": 0.1}, "transits: b does not pass in front of star until t = 0.1"),
        ({"planet": "b", "within": 1e-4}, "transits: b does not pass in front of star within 0.0001 on the sky until"),
        ({"planet": "star"}, "planet: star is the star"),
        ({"planet": "d"}, "planet: there is no body 'd'"),
        ({"planet": "b", "until": -1.0}, "until: expected a time after the start, 0, got -1.0"),
        ({"planet": "b", "direction": (0, 0, 0)}, "direction: expected a vector"),
        ({"planet": "b", "integrator": "yoshida4", "dt": 0.1}, "yoshida4 does not know the state inside its steps"),
    ],
)
def test_transits_that_make_no_sense(given, message):
    with pytest.raises(InputError, match=message):
        kd.transits(planets_that_meet(), **{"until": 3.0, "direction": (1, 0, 0), **given})


def test_command(tmp_path, kickdrift):
    file, words = tmp_path / "transits.json", ("transits", "trappist-1", "--direction", "0,-1,0", "--until")
    code, out, _ = kickdrift(*words, "4 day", "b", "--json", file)
    assert not code
    assert "2, with derivatives by 48 numbers of the start" in out
    found = json.loads(file.read_text())
    assert len(found["times"]) == len(found["jacobian"]) == 2
    assert len(found["varied"]) == 48
    assert found["varied"][3:5] + found["varied"][24:26] == ["b.x", "b.y", "TRAPPIST-1.vx", "TRAPPIST-1.vy"]
    assert found["units"] == "astro"
    code, _, err = kickdrift(*words, "1 day", "h")
    assert code == 2
    assert "transits: h does not pass in front of TRAPPIST-1 until t = " in err

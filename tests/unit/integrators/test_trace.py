"""trace: encounters and pericentre passages against gauss-radau15, the way back, massless bodies, refusals."""

from __future__ import annotations

import math

import numpy as np
import pytest

import kickdrift as kd
from kickdrift.errors import InputError
from kickdrift.integrators.trace.method import METHODS, WAYS

DT = 0.4  # of the giants, whose shortest period is 70
INNER = pytest.mark.parametrize("inner", METHODS)


def on_orbits(*bodies, massless=(), forces=(), masses=(), **options) -> kd.System:
    """A star of mass 1 with bodies (mass, a, e, longitude), each at the longitude's eccentric anomaly in the plane."""
    rows = [*bodies, *((0.0, *each) for each in massless)]
    n = len(rows) + 1
    x, v, m = np.zeros((n, 3)), np.zeros((n, 3)), np.ones(n)
    for i, (mass, a, e, angle) in enumerate(rows, 1):
        b, rate = math.sqrt(1 - e * e), math.sqrt((1.0 + mass) / a**3) / (1 - e * math.cos(angle))
        x[i, :2] = a * (math.cos(angle) - e), a * b * math.sin(angle)
        v[i, :2] = -a * math.sin(angle) * rate, a * b * math.cos(angle) * rate
        x[i, 2], m[i] = 0.002 * i * a, mass
    v -= m @ v / m.sum()
    x -= m @ x / m.sum()
    return kd.System(x, v, masses=m, forces=[kd.Gravity(), *forces], units="nbody", **options)


def giants(**given) -> kd.System:
    """Two giants and a third; the first two meet within some turns."""
    return on_orbits((1e-3, 5.0, 0.02, 0.3), (8e-4, 5.7, 0.04, 0.0), (6e-4, 9.0, 0.1, 2.0), **given)


def diver(e=0.98, **given) -> kd.System:
    """A planet that passes close to the star, and another one."""
    return on_orbits((1e-3, 5.0, e, math.pi), (1e-3, 12.0, 0.05, 1.0), **given)


def energy(system, state=None) -> float:
    state = state or system.state
    m, x, v = state.masses, state.positions, state.velocities
    total = 0.5 * float(m @ (v**2).sum(axis=1))
    for i in range(1, len(m)):
        total -= float((m[i] * m[:i] / np.linalg.norm(x[:i] - x[i], axis=1)).sum())
    return total


def back(system, steps, dt, **options) -> float:
    """Largest distance from the start after steps there and back."""
    sim = kd.Simulation(system, "trace", dt=dt, **options)
    sim.run(steps)
    there = sim.state
    turned = kd.System(
        there.positions, -there.velocities, masses=there.masses, forces=system.forces, units=system.units
    )
    again = kd.Simulation(turned, "trace", dt=dt, **options)
    again.run(steps)
    return float(np.abs(again.state.positions - system.state.positions).max())


def met(system, steps, dt, **options):
    """The Simulation after these steps, and how many steps began with near pairs and with passages."""
    sim, pairs, passages = kd.Simulation(system, "trace", dt=dt, **options), 0, 0
    for _ in range(steps):
        sim.run(1)
        near, passing = sim.integration.stepper.flags
        pairs, passages = pairs + (near > 0), passages + (passing > 0)
    return sim, pairs, passages


# --- accuracy ---


@INNER
def test_an_encounter_keeps_the_energy(inner):
    """The map alone loses a hundred times more."""
    system = giants()
    sim, pairs, _ = met(system, 200, 5 * DT, inner=inner)
    assert pairs > 20
    map_alone = kd.Simulation(system, "wisdom-holman", dt=5 * DT, coordinates="democratic-heliocentric")
    map_alone.run(200)
    assert abs(energy(system, sim.state) / energy(system) - 1) < 7e-6
    assert abs(energy(system, map_alone.state) / energy(system) - 1) > 5e-4


@pytest.mark.parametrize("way", ["full", "partial"])
def test_a_passage_near_the_star_keeps_the_energy(way):
    system = diver()
    sim, _, passages = met(system, 60, 2.0, pericentre=way)
    assert passages > 2
    assert abs(energy(system, sim.state) / energy(system) - 1) < 1e-4
    map_alone, *_ = met(system, 60, 2.0, pericentre="none")
    assert abs(energy(system, map_alone.state) / energy(system) - 1) > 1e-3


def test_a_system_without_encounters_is_not_touched():
    system = on_orbits((1e-4, 1.0, 0.01, 0.3), (1e-4, 2.5, 0.04, 1.0))
    sim, pairs, passages = met(system, 50, 0.05)
    assert (pairs, passages) == (0, 0)
    assert sim.integration.stepper._twice == 0
    exact = kd.Simulation(system, "gauss-radau15")
    exact.run(until=sim.time)
    assert np.abs(sim.state.positions - exact.state.positions).max() < 1e-6


def test_order_is_two():
    system, errors = on_orbits((1e-3, 1.0, 0.1, 0.3), (1e-3, 2.0, 0.04, 1.0)), []
    exact = kd.Simulation(system, "gauss-radau15")
    exact.run(until=8.0)
    for dt in (0.1, 0.05, 0.025):
        sim = kd.Simulation(system, "trace", dt=dt)
        sim.run(until=8.0)
        errors.append(np.abs(sim.state.positions - exact.state.positions).max())
    slopes = np.diff(np.log2(errors))
    assert np.all(np.abs(slopes + 2.0) < 0.15)


def test_the_pythagorean_problem_survives():
    """Burrau's bodies of masses 3, 4 and 5 from rest: no body dominates, and two pass at 4e-4 before one leaves."""
    system = kd.System(
        [[1.0, 3.0, 0.0], [-2.0, -1.0, 0.0], [1.0, -1.0, 0.0]], masses=[3.0, 4.0, 5.0], forces=[kd.Gravity()],
        units="nbody",
    )  # fmt: skip
    sim = kd.Simulation(system, "trace", dt=0.01)
    report = sim.run(until=70.0)
    assert "covers the whole orbit" in " ".join(report.warnings)
    assert abs(energy(system, sim.state) / energy(system) - 1) < 0.1
    momentum = sim.state.masses @ sim.state.velocities
    assert np.abs(momentum).max() < 1e-11


# --- the way back ---


@INNER
def test_steps_with_encounters_come_back(inner):
    """Rounding, and bulirsch-stoer's tolerance, grown by an encounter."""
    assert back(giants(), 200, 5 * DT, inner=inner) < {"gauss-radau15": 1e-9, "bulirsch-stoer": 1e-5}[inner]


@pytest.mark.parametrize("way", WAYS)
def test_steps_with_passages_come_back(way):
    assert back(diver(), 60, 2.0, pericentre=way) < 1e-10


def test_massless_bodies_come_back():
    system = giants(massless=[(5.35, 0.03, 5.9), (2.0, 0.97, 3.0), (7.0, 0.1, 1.0)])
    assert back(system, 100, 5 * DT) < 1e-11


# --- massless bodies ---


def test_massless_bodies_change_nothing():
    """The massive bodies have the same bits with and without massless ones, whatever these meet."""
    alone, pairs, _ = met(giants(), 200, 5 * DT)
    crowd, more, passages = met(giants(massless=[(5.35, 0.03, 5.9), (2.0, 0.97, 3.0)]), 200, 5 * DT)
    assert more > pairs
    assert passages > 0
    np.testing.assert_array_equal(crowd.state.positions[:4], alone.state.positions)


@pytest.mark.parametrize("way", ["full", "partial"])
def test_massless_bodies_move_as_with_gauss_radau15(way):
    """One that meets a giant, one that passes near the star, one of both, and one of neither."""
    system = on_orbits(
        (1e-3, 5.0, 0.02, 0.3), (3e-4, 9.0, 0.1, 2.0),
        massless=[(5.3, 0.03, 0.2), (2.0, 0.97, 3.0), (5.0, 0.95, 3.1), (14.0, 0.1, 1.0)],
    )  # fmt: skip
    sim, pairs, passages = met(system, 40, 1.0, pericentre=way)
    assert pairs > 0
    assert passages > 0
    exact = kd.Simulation(system, "gauss-radau15")
    exact.run(until=sim.time)
    assert np.abs(sim.state.positions - exact.state.positions).max() < 2e-3


def test_a_passage_of_a_planet_carries_massless_bodies_along():
    system = diver(massless=[(20.0, 0.1, 1.0), (2.0, 0.3, 2.0)])
    sim, _, passages = met(system, 60, 2.0)
    assert passages > 2
    exact = kd.Simulation(system, "gauss-radau15")
    exact.run(until=sim.time)
    assert np.abs(sim.state.positions - exact.state.positions).max() < 8e-3


# --- runs ---


@pytest.mark.parametrize("forces", [(), (kd.PostNewtonian(c=300.0),)], ids=["gravity", "1pn"])
def test_a_run_in_pieces_and_from_a_file_has_the_same_bits(forces, tmp_path):
    system = giants(massless=[(5.35, 0.03, 5.9)], forces=forces)
    whole = kd.Simulation(system, "trace", dt=5 * DT)
    whole.run(120)
    path = tmp_path / "run.h5md"
    first = kd.Simulation(system, "trace", dt=5 * DT)
    first.run(70, every=7, output=path)
    again = kd.resume(path)
    again.run(50)
    np.testing.assert_array_equal(again.state.positions, whole.state.positions)
    assert again.options["hill_radii"] == 3.0


def test_another_start_in_an_encounter_has_the_bits_of_a_new_simulation():
    """The pairs that were near before are forgotten."""
    sim, pairs, _ = met(giants(), 180, 5 * DT)
    assert pairs > 0
    assert sim.integration.stepper.flags[0] > 0
    sim.state = giants().state
    sim.run(200)
    again = kd.Simulation(giants(), "trace", dt=5 * DT)
    again.run(200)
    np.testing.assert_array_equal(sim.state.positions, again.state.positions)


def test_evaluations_inside_count():
    """So that a comparison shows what encounters cost."""
    quiet = on_orbits((1e-4, 1.0, 0.01, 0.3), (1e-4, 2.5, 0.04, 1.0))
    assert kd.Simulation(quiet, "trace", dt=0.05).run(50).force_evaluations == 50
    assert kd.Simulation(diver(), "trace", dt=2.0).run(50).force_evaluations > 500


# --- other forces ---

STRONG = (
    kd.Oblateness(j2=0.01, radius=0.1), kd.PostNewtonian(c=300.0), kd.PostNewtonian(c=300.0, form="potential"),
    kd.LinearDrag(1e-3),
)  # fmt: skip
NAMED = ("j2", "1pn", "1pn-potential", "drag")
EACH_FORCE = pytest.mark.parametrize("force", STRONG, ids=NAMED)


def off(system, dt, time, **options) -> float:
    """Largest distance of a body from its place by gauss-radau15."""
    sim, exact = kd.Simulation(system, "trace", dt=dt, **options), kd.Simulation(system, "gauss-radau15")
    sim.run(until=time)
    exact.run(until=time)
    return float(np.abs(sim.state.positions - exact.state.positions).max())


@EACH_FORCE
def test_other_forces_act_inside_a_passage(force):
    """Steps of half a period are one passage: the bodies move by all forces together, with no error of a splitting."""
    system = on_orbits((1e-3, 5.0, 0.3, math.pi), (2e-3, 5.8, 0.1, 1.0), forces=[force])
    assert off(system, 30.0, 300.0) < 1e-11


@EACH_FORCE
def test_kicks_by_other_forces_are_of_order_two(force):
    system, dts = on_orbits((1e-3, 5.0, 0.3, math.pi), (2e-3, 9.8, 0.1, 1.0), forces=[force]), (1.0, 0.5, 0.25)
    slopes = np.diff(np.log2([off(system, dt, 50.0, pericentre="none", hill_radii=1e-6) for dt in dts]))
    assert np.all(np.abs(slopes + 2.0) < 0.05)


@pytest.mark.parametrize("force", STRONG[:3], ids=NAMED[:3])
def test_steps_with_other_forces_come_back(force):
    system = giants(forces=[force], massless=[(5.35, 0.03, 5.9), (2.0, 0.97, 3.0), (7.0, 0.1, 1.0)])
    assert back(system, 100, 5 * DT) < 1e-11


def test_a_flattened_planet_pulls_its_massless_moon_inside_the_step():
    """One step is two turns of the moon, which kicks at the ends of the step miss."""
    x = [[0.0, 0.0, 0.0], [5.0, 0.0, 0.0], [5.05, 0.0, 0.01]]
    v = [[0.0, 0.0, 0.0], [0.0, 0.45, 0.0], [0.0, 0.59, 0.02]]
    flat = kd.Oblateness(j2=0.1, radius=0.02, central=1)
    system = kd.System(x, v, masses=[1.0, 1e-3, 0.0], forces=[kd.Gravity(), flat], units="nbody")
    assert off(system, 4.0, 8.0) < 1e-4


@pytest.mark.long
def test_forces_with_pair_lists_stay_kicks():
    """And a force inside acts beside them."""
    weak = kd.LennardJones(epsilon=1e-6, sigma=0.02, cutoff=1.0)
    system = diver(forces=[weak, kd.Oblateness(j2=0.01, radius=0.1)])
    _, _, passages = met(system, 60, 2.0)
    assert passages > 2
    assert back(system, 60, 2.0) < 1e-10
    assert off(system, 2.0, 40.0) < 1e-2


@pytest.mark.parametrize("after", [5, 130])
def test_an_error_in_a_python_force_is_named(after):
    """In a kick, and inside a passage."""
    calls = iter(range(after))

    def push(positions, velocities, time, box):
        next(calls)
        return np.zeros_like(positions), None

    system = diver(forces=[kd.PythonForce(push, works=True)])
    with pytest.raises(kd.RunError, match="push raised StopIteration"):
        kd.Simulation(system, "trace", dt=2.0).run(60)


@pytest.mark.parametrize(
    ("system", "options", "message"),
    [
        (lambda: giants(forces=[kd.LinearDrag(0.1)]), {"inner": METHODS[1]}, "inner: bulirsch-stoer needs accelera"),
        (lambda: giants(), {"hill_radii": -1.0}, "hill_radii must be a positive number"),
        (lambda: giants(), {"pericentre": "half"}, "pericentre 'half' is unknown; known are full, partial, none"),
        (lambda: giants(), {"inner": "rk4"}, "inner 'rk4' is unknown; known are gauss-radau15, bulirsch-stoer"),
        (lambda: giants(), {"corrector": 3}, "corrector: trace does not take it"),
        (lambda: kd.load("lj-1000"), {}, "trace: needs one force 'gravity'"),
        (lambda: kd.load("plummer-1000").under([kd.Gravity(softening=0.1)]), {}, "trace: needs gravity without soften"),
        (lambda: kd.System(np.eye(3), masses=[0, 0, 0], forces=[kd.Gravity()], units="nbody"), {}, "has a mass"),
    ],
)  # fmt: skip
def test_refusals(system, options, message):
    with pytest.raises(InputError, match=message):
        kd.Simulation(system(), "trace", dt=0.1, **options)


# --- events ---


def giants_that_meet(aside=0.1, **given) -> kd.System:
    x = [[0.0, 0.0, 0.0], [5.0, 0.0, 0.0], [5.3, 0.4, aside], [-9.0, 0.0, 0.0]]
    v = [[0.0, 0.0, 0.0], [0.0, 0.45, 0.0], [-0.04, 0.4, 0.0], [0.0, -0.33, 0.0]]
    return kd.System(x, v, masses=[1.0, 1e-3, 1e-3, 6e-4], forces=[kd.Gravity()], units="nbody", **given)


@pytest.mark.parametrize("miss", [0.0, 0.1])
def test_what_happens_inside_a_step_is_found(miss):
    """Two giants on their way to one another, within steps of a third of that time: contact and closest approach are
    where gauss-radau15 has them, to what the third giant does in a step."""
    found = {}
    system = giants_that_meet(miss, radii=[0.005, 3e-3, 3e-3, 1e-3])
    events = [kd.Collision(action="stop"), kd.CloseApproach(0.2)]
    for name, dt in (("gauss-radau15", None), ("trace", 2.0), ("trace", 0.7)):
        sim = kd.Simulation(system, name, dt=dt, events=events)
        report = sim.run(until=14.0)
        rows = [(row["kind"], row["time"], row["distance"]) for row in sim.events]
        found.setdefault(name, []).append((bool(report.stopped), *rows[0]))
    (exact,) = found["gauss-radau15"]
    for stopped, kind, time, distance in found["trace"]:
        assert (stopped, kind) == exact[:2] == ((miss == 0.0), "close-approach" if miss else "collision")
        assert time == pytest.approx(exact[2], abs=1e-4)
        assert distance == pytest.approx(exact[3], rel=1e-4)


@pytest.mark.parametrize(("distance", "step"), [(0.2, 6), (0.02, 7), (0.01, None)])
def test_a_close_approach_may_end_a_run(distance, step):
    """With the step in which the passage begins; a run that goes on does not stop again in the same passage."""
    sim = kd.Simulation(giants_that_meet(), "trace", dt=0.7, events=[kd.CloseApproach(distance, action="stop")])
    report = sim.run(until=14.0)
    assert (sim.steps_done == step, "meet at t" in report.stopped) == (step is not None,) * 2
    assert sim.run(until=28.0).stopped == ""
    assert sum(row["done"] == "stopped" for row in sim.events) == (step is not None)


def test_steps_without_events_change_no_event(monkeypatch):
    """Steps in compiled code until an event, and each step searched in Python, have the same log and the same bits."""
    events = [kd.Collision(action="bounce"), kd.Escape(8.0), kd.CloseApproach(1.5)]
    found = []
    for _ in range(2):
        system = giants_that_meet(0.0, radii=[0.005, 3e-3, 3e-3, 1e-3])
        sim = kd.Simulation(system, "trace", dt=0.7, events=events)
        sim.run(300)
        found.append((sim.events, sim.state.positions))
        monkeypatch.setattr("kickdrift.run.watch.search.Search.quiet_steps", lambda self, inner: None)
    assert found[0][0] == found[1][0]
    assert len(found[0][0]) >= 2
    np.testing.assert_array_equal(found[0][1], found[1][1])

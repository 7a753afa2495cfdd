"""Events of a run: detection, times, and changes of the bodies by collisions and escapes."""

from __future__ import annotations

import json
import math
import re

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import kickdrift as kd
from kickdrift.errors import InputError, RunError
from kickdrift.integrators import integrator
from kickdrift.run.watch.encounters import POINTS, cubic, separation2, turning_points
from kickdrift_validation.problems import kepler
from tests.long import shortened
from tests.methods import METHODS, OF_EACH_FORM

FREE = 1e-30  # a G so small that bodies move straight


def straight(x, v, masses=1.0, radii=None, G=FREE, **more) -> kd.System:
    """Bodies that move straight."""
    return kd.System(x, v, masses=masses, forces=[kd.Gravity(G=G)], units="nbody", radii=radii, **more)


def head_on(**more) -> kd.System:
    """Radii 0.3 and 0.2, relative velocity (-2, 0, 0) from (2, 0, 0): in contact at t = 0.75."""
    return straight([[-1, 0, 0], [1, 0, 0]], [[1, 0, 0], [-1, 0, 0]], [2, 1], [0.3, 0.2], names=["A", "B"], **more)


def ellipse(e: float = 0.3, inclination: float = 0.0) -> kd.System:
    """Kepler's problem from pericentre at t = 0: G = a = total mass = 1, period 2 pi; the node is the x axis."""
    masses = np.array([0.6, 0.4])
    r, v = kepler(0.0, e)
    turn = np.array([[1, 0, 0], [0, math.cos(inclination), -math.sin(inclination)], [0, math.sin(inclination), 0]])
    shares = np.array([-masses[1], masses[0]])[:, None]
    return kd.System(
        shares * (turn @ r), shares * (turn @ v), masses=masses, forces=[kd.Gravity()], units="nbody", names=["S", "P"]
    )


def run_to(sim: kd.Simulation, time: float):
    """Run with any method to at least a time."""
    return sim.run(until=time) if sim.method.chooses_steps else sim.run(math.ceil(time / sim.dt - 1e-9))


def momentum(sim: kd.Simulation) -> np.ndarray:
    return sim.state.masses @ sim.state.velocities


@settings(max_examples=300, deadline=None)
@given(st.lists(st.floats(-10, 10, allow_subnormal=False), min_size=12, max_size=12), st.booleans())
def test_turning_points_are_those_of_the_polynomial(numbers, whole):
    """Compare with a dense search: no minimum of the separation among 2001 points is missed."""
    ends = np.array(numbers).reshape(2, 2, 3)
    if whole:  # zeros at special places
        ends = np.rint(ends)
    y0, y1 = np.zeros((2, 3, 2)), np.zeros((2, 3, 2))
    y0[:, :, 0], y1[:, :, 0] = ends[0], ends[1]
    c, points = np.empty((4, 3)), np.empty(POINTS)
    cubic(y0, y1, 1.0, 0, 1, c)
    count = turning_points(c, points)
    found = points[:count]
    assert found[0] == 0
    assert found[-1] == 1
    assert (np.diff(found) >= 0).all()
    s = np.linspace(0, 1, 2001)
    dense = (
        np.polynomial.polynomial.polyval(s, c).T
        if c.ndim == 1
        else sum(np.polynomial.polynomial.polyval(s, c[:, k]) ** 2 for k in range(3))
    )
    least = min(separation2(c, each) for each in found)
    assert least <= dense.min() * (1 + 1e-9) + 1e-12 * dense.max()


# --- close approaches ---


def test_a_fast_flyby_between_two_step_points_is_seen():
    """Two bodies pass at 0.2 in one step of length 3, which is 1e4 times as long as the passage."""
    system = straight([[-1e3, 0, 0], [1e3, 0.2, 0]], [[1e3, 0, 0], [-1e3, 0, 0]])
    report = kd.Simulation(system, dt=3.0, events=[kd.CloseApproach(0.3)]).run(2)
    (event,) = report.events
    assert event["time"] == pytest.approx(1.0, abs=1e-12)
    assert event["distance"] == pytest.approx(0.2, rel=1e-9)
    assert (event["kind"], event["step"], event["bodies"]) == ("close-approach", 1, ["particle 0", "particle 1"])


def test_a_passage_over_many_steps_is_one_event():
    system = straight([[-1, 0, 0], [1, 0.1, 0], [0, 50, 0]], [[1, 0, 0], [-1, 0, 0], [0, 0, 0]])
    report = kd.Simulation(system, dt=0.07, events=[kd.CloseApproach(0.5)]).run(100)
    (event,) = report.events
    assert (event["time"], event["distance"]) == (pytest.approx(1.0, abs=1e-12), pytest.approx(0.1, rel=1e-12))
    assert event["step"] == math.ceil(1.0 / 0.07)
    assert event["ids"] == [0, 1]


def test_a_passage_that_goes_on_stands_in_the_report():
    """A circular orbit inside the distance is one endless passage, not one for each step."""
    sim = kd.Simulation(ellipse(0.0), dt=0.05, events=[kd.CloseApproach(1.5)])
    report = sim.run(1000)
    (event,) = report.events
    assert event["done"] == "going on"
    assert event["distance"] == pytest.approx(1.0, abs=1e-3)
    assert sim.events == []


def test_bodies_choose_the_pairs():
    x = [[0, 0, 0], [10, 0.1, 0], [20, 0.1, 0], [30, 0.1, 0]]
    v = [[10, 0, 0], [0, 0, 0], [0, 0, 0], [0, 0, 0]]
    system = straight(x, v, names=["A", "B", "C", "D"])
    seen = {}
    for bodies in (None, ["C"], "C", ["A", "B", "D"], [0, 1], ["B", "C"]):
        report = kd.Simulation(system, dt=1.0, events=[kd.CloseApproach(0.5, bodies)]).run(4)
        seen[str(bodies)] = ["".join(event["bodies"]) for event in report.events]
    assert seen == {
        "None": ["AB", "AC", "AD"],
        "['C']": ["AC"],
        "C": ["AC"],
        "['A', 'B', 'D']": ["AB", "AD"],
        "[0, 1]": ["AB"],
        "['B', 'C']": [],
    }


def test_hill_radii():
    """Two planets of 1e-3 at 10 and 10 + d: the mutual Hill radius is (2e-3 / 3)^(1/3) (10 + d / 2)."""
    radius = (2e-3 / 3) ** (1 / 3) * 10.2
    system = straight([[0, 0, 0], [10, -1, 0], [10.4, 1, 0]], [[0, 0, 0], [0, 1, 0], [0, -1, 0]], [1, 1e-3, 1e-3])
    for number, seen in ((0.4 / radius * 1.01, True), (0.4 / radius * 0.99, False)):
        report = kd.Simulation(system, dt=0.3, events=[kd.CloseApproach(number, hill=True)]).run(10)
        assert [event["ids"] for event in report.events] == ([[1, 2]] if seen else [])


def test_a_kepler_ellipse_comes_nearest_at_pericentre():
    sim = kd.Simulation(ellipse(0.3), "dop853", rtol=1e-12, atol=1e-12, events=[kd.CloseApproach(0.9)])
    events = sim.run(until=20.0).events
    assert [event["time"] for event in events] == pytest.approx([0.0, 2 * math.pi, 4 * math.pi, 6 * math.pi], abs=1e-8)
    assert [event["distance"] for event in events] == pytest.approx([0.7] * 4, abs=1e-9)


# --- crossings ---


@pytest.mark.parametrize("name", ["yoshida8", "dop853", "gauss-legendre4"])
def test_pericentres_and_apocentres_of_an_ellipse(name):
    watched = [kd.Crossing.pericentre("P", "S"), kd.Crossing.apocentre("P", "S")]
    exact = integrator(name).adaptive
    options = {"rtol": 1e-12, "atol": 1e-12} if exact else {"dt": 2 * math.pi / 200.5}
    sim = kd.Simulation(ellipse(0.3), name, **options, events=watched)
    run_to(sim, 20.0)
    assert [event["kind"] for event in sim.events] == ["apocentre", "pericentre"] * 3
    times = np.array([event["time"] for event in sim.events])
    errors = np.abs(times - math.pi * np.arange(1, 7))
    assert errors.max() < {"yoshida8": 1e-8, "dop853": 1e-8, "gauss-legendre4": 1e-5}[name]
    distances = [event["distance"] for event in sim.events]
    assert distances == pytest.approx([1.3, 0.7] * 3, abs=1e-5)
    assert all(event["bodies"] == ["P", "S"] for event in sim.events)


def test_the_error_of_a_pericentres_time_falls_as_the_methods_does():
    """The error has order 2 and 4, not the order of the interpolation."""
    for name, order in (("velocity-verlet", 2), ("blanes-moan4", 4)):
        errors = []
        for steps in (100.3, 200.3, 400.3):
            sim = kd.Simulation(ellipse(0.3), name, 2 * math.pi / steps, events=[kd.Crossing.pericentre(1, 0)])
            run_to(sim, 7.0)
            errors.append(abs(sim.events[0]["time"] - 2 * math.pi))
        slopes = np.log2(np.array(errors[:-1]) / errors[1:])
        assert slopes == pytest.approx([order] * 2, abs=0.25)


def test_nodes_of_an_inclined_ellipse():
    """From pericentre on the node the body rises; half a turn later, at apocentre, it descends."""
    watched = [kd.Crossing.ascending_node("P", "S"), kd.Crossing.descending_node("P", "S")]
    sim = kd.Simulation(ellipse(0.3, 0.5), "dop853", rtol=1e-12, atol=1e-12, events=watched)
    sim.run(until=13.0)
    assert [event["kind"] for event in sim.events] == ["descending-node", "ascending-node"] * 2
    times = [event["time"] for event in sim.events]
    assert times == pytest.approx(math.pi * np.arange(1, 5), abs=1e-8)


def test_a_function_of_ones_own():
    system = straight([[0.0, 0, 0], [5, 5, 5]], [[1, 0, 0], [0, 0, 0]])
    seen = []

    def g(t, x, v):
        seen.append((x.shape, v.shape))
        return (x[0, 0] - 0.25) * (x[0, 0] - 1.75)

    found = {}
    for direction in (-1, 0, 1):
        sim = kd.Simulation(system, dt=0.1, events=[kd.Crossing(g, "mark", direction)])
        found[direction] = [event["time"] for event in sim.run(30).events]
    assert found[0] == pytest.approx([0.25, 1.75], abs=1e-12)
    assert (found[-1], found[1]) == ([found[0][0]], [found[0][1]])
    assert set(seen) == {((2, 3), (2, 3))}


def test_a_zero_at_a_step_point_is_one_event():
    system = straight([[0.0, 0, 0], [5, 5, 5]], [[1, 0, 0], [0, 0, 0]])
    rising = kd.Crossing(lambda t, x, v: x[0, 0] - 0.5, "rise")
    touching = kd.Crossing(lambda t, x, v: (x[0, 0] - 0.5) ** 2, "touch")
    starting = kd.Crossing(lambda t, x, v: x[0, 0], "start")
    sim = kd.Simulation(system, dt=0.125, events=[rising, touching, starting])
    assert [(event["kind"], event["time"]) for event in sim.run(16).events] == [("rise", 0.5)]


@pytest.mark.parametrize("name", ["rk4", "dormand-prince45", "radau"])
def test_a_crossing_of_a_problem(name):
    """y'' = -y from (1, 0): cos t is zero at pi / 2 + k pi."""
    problem = kd.Problem(lambda t, y: np.array([y[1], -y[0]]), [1.0, 0.0])
    options = {"dt": 0.01} if not integrator(name).adaptive else {"rtol": 1e-10, "atol": 1e-12}
    sim = kd.Simulation(problem, name, **options, events=[kd.Crossing(lambda t, y: y[0], "zero")])
    run_to(sim, 10.0)
    assert [e["time"] for e in sim.events] == pytest.approx([math.pi * (k + 0.5) for k in range(3)], abs=1e-7)


@pytest.mark.parametrize(
    ("function", "message"),
    [
        (lambda t, x, v: 1 / 0, "event 'mine': step 1 (t = 0): raised ZeroDivisionError: division by zero"),
        (lambda t, x, v: "far", "event 'mine': step 1 (t = 0): returned 'far', which is no number"),
        (lambda t, x, v: x, "event 'mine': step 1 (t = 0): returned array"),
        (lambda t, x, v: 0.3 - t if t < 0.25 else math.nan, "event 'mine': step 3 (t = 0.3): returned nan"),
        (lambda t, x, v: x[0, 0] + "a", "event 'mine': step 1 (t = 0): raised UFuncTypeError"),
    ],
)
def test_a_function_that_fails_is_named(function, message):
    sim = kd.Simulation(head_on(), dt=0.1, events=[kd.Crossing(function, "mine")])
    with pytest.raises(RunError, match=re.escape(message)):
        sim.run(5)


# --- collisions ---


@pytest.mark.parametrize("dt", [0.01, 0.1, 0.75, 3.0])
def test_a_head_on_merger_by_hand(dt):
    """Masses 2 and 1 at +-1 with speeds +-1 become 3 with speed 1/3, at x = -1/3 + t / 3; the energy 4/3 is lost."""
    sim = kd.Simulation(head_on(), dt=dt, events=[kd.Collision()])
    report = sim.run(round(3 / dt))
    (event,) = report.events
    assert event["time"] == pytest.approx(0.75, abs=1e-12)
    assert event["distance"] == pytest.approx(0.5, abs=1e-12)
    assert (event["done"], event["bodies"]) == ("B merged into A", ["A", "B"])
    assert event["energy"] == report.energy_taken == pytest.approx(4 / 3, rel=1e-12)
    state = sim.state
    assert (state.ids.tolist(), state.masses.tolist(), sim.system.names) == ([0], [3.0], ("A",))
    assert state.positions[0] == pytest.approx([-1 / 3 + 1, 0, 0], abs=1e-12)
    assert state.velocities[0] == pytest.approx([1 / 3, 0, 0], abs=1e-15)
    assert sim.system.radii == pytest.approx([(0.3**3 + 0.2**3) ** (1 / 3)], rel=1e-15)
    assert report.particles == 1
    assert (report.energy.initial, report.energy.final) == (pytest.approx(1.5), pytest.approx(1 / 6))
    assert report.energy.max_relative_error < 1e-13
    assert report.momentum_error < 1e-15


def test_a_glancing_bounce_by_hand():
    """Equal spheres of radius 1/2, offset by 1/sqrt 2 along y: the line of centres is at 45 degrees. The component of
    (1, 0) along the line passes to the other sphere."""
    h = math.sqrt(0.5)
    system = straight([[-2, 0, 0], [0, h, 0]], [[1, 0, 0], [0, 0, 0]], radii=0.5)
    sim = kd.Simulation(system, dt=0.3, events=[kd.Collision(action="bounce")])
    report = sim.run(10)
    (event,) = report.events
    assert event["time"] == pytest.approx(2 - h, abs=1e-12)
    assert sim.state.velocities == pytest.approx(np.array([[0.5, -0.5, 0], [0.5, 0.5, 0]]), abs=1e-12)
    after = 3.0 - event["time"]
    assert sim.state.positions[1] == pytest.approx([0.5 * after, h + 0.5 * after, 0], abs=1e-12)
    assert report.energy_taken is None
    assert report.energy.max_relative_error < 1e-14


def test_bodies_that_miss_do_not_touch():
    for offset, touched in ((0.4999, True), (0.5001, False)):
        system = straight([[-100, 0, 0], [100, offset, 0]], [[100, 0, 0], [-100, 0, 0]], radii=[0.3, 0.2])
        report = kd.Simulation(system, dt=2.0, events=[kd.Collision()]).run(1)
        assert bool(report.events) is touched


@pytest.mark.parametrize(("name", "dt"), [("velocity-verlet", 0.3), ("dop853", None)])
def test_stop(name, dt):
    sim = kd.Simulation(head_on(), name, dt, events=[kd.Collision(action="stop")])
    report = run_to(sim, 3.0)
    (event,) = report.events
    assert event["done"] == "stopped"
    assert event["time"] == pytest.approx(0.75, abs=1e-9)
    assert report.stopped == sim.stopped == "A and B touch at t = 0.75"
    assert sim.time == pytest.approx(0.9 if dt else 0.75, abs=1e-9)
    again = sim.run(5)  # their contact is known, so they continue
    assert again.stopped == ""
    assert len(again.events) == 1


def test_a_cradle_bounces_several_times_in_one_step():
    """Newton's cradle along x: the last ball leaves with the first one's speed, within one step."""
    x = [[-5.0, 0, 0], [0, 0, 0], [1.5, 0, 0], [3.0, 0, 0]]
    v = [[1.0, 0, 0], [0, 0, 0], [0, 0, 0], [0, 0, 0]]
    sim = kd.Simulation(straight(x, v, radii=0.5), dt=20.0, events=[kd.Collision(action="bounce")])
    report = sim.run(1)
    assert [event["ids"] for event in report.events] == [[0, 1], [1, 2], [2, 3]]
    assert [event["time"] for event in report.events] == pytest.approx([4.0, 4.5, 5.0], abs=1e-10)
    assert sim.state.velocities == pytest.approx(np.array([[0, 0, 0]] * 3 + [[1.0, 0, 0]]), abs=1e-12)


def test_bodies_that_overlap_at_the_start_merge_at_once():
    system = straight([[0, 0, 0], [0.1, 0, 0], [9, 0, 0]], [[0, 0, 0], [1, 0, 0], [0, 0, 0]], radii=0.5)
    (event,) = kd.Simulation(system, dt=0.1, events=[kd.Collision()]).run(3).events
    assert (event["time"], event["step"]) == (0.0, 1)


def test_massless_bodies_pass_each_other_and_fall_onto_massive_ones():
    x, v = [[-1, 0, 0], [1, 0, 0], [0, 5, 0]], [[1, 0, 0], [-1, 0, 0], [0, -1, 0]]
    sim = kd.Simulation(straight(x, v, [0, 0, 1], 0.1), dt=0.5, events=[kd.Collision()])
    assert sim.run(4).events == []
    x = [[-1, 0, 0], [1, 0.1, 0]]
    sim = kd.Simulation(straight(x, v[:2], [0, 1], 0.1), dt=0.5, events=[kd.Collision()])
    (event,) = sim.run(4).events
    assert event["done"] == "particle 0 merged into particle 1"
    assert sim.state.velocities[0].tolist() == [-1, 0, 0]


def test_balls_that_come_to_rest_say_so():
    """Half the speed at each bounce, with a constant attraction: infinitely many bounces in a finite time."""
    system = straight([[-1, 0, 0], [1, 0, 0]], [[0, 0, 0], [0, 0, 0]], radii=0.4, G=1.0)
    for name, dt in (("velocity-verlet", 0.01), ("dop853", None)):
        sim = kd.Simulation(system, name, dt, events=[kd.Collision(action="bounce", restitution=0.5)])
        with pytest.raises(
            RunError, match=r"more than 1000 collisions at one time, the last of particle 0 and particle 1"
        ):
            run_to(sim, 20.0)


def cloud(seed: int, n: int = 40, G: float = 1e-3) -> kd.System:
    rng = np.random.default_rng(seed)
    x, v = rng.uniform(-1, 1, (n, 3)), rng.normal(size=(n, 3))
    return straight(x, v, rng.uniform(0.5, 2, n), rng.uniform(0.02, 0.08, n), G=G)


@settings(max_examples=8, deadline=None)
@given(st.integers(0, 10**6))
def test_mergers_conserve_what_they_must(seed):
    system = cloud(seed, G=1e-6)  # almost no attraction: an energy error could only come from mergers
    sim = kd.Simulation(system, dt=0.1, events=[kd.Collision()])
    total = system.state.masses.sum()
    at_start = system.state.masses @ system.state.positions, system.state.masses @ system.state.velocities
    report = sim.run(10)
    assert len(sim.state) == 40 - len(report.events)
    assert sim.state.masses.sum() == pytest.approx(total, rel=1e-14)
    scale = float(system.state.masses @ np.linalg.norm(system.state.velocities, axis=1))
    assert np.abs(momentum(sim) - at_start[1]).max() < 1e-14 * scale
    centre = at_start[0] + at_start[1] * sim.time
    assert np.abs(sim.state.masses @ sim.state.positions - centre).max() < 1e-13 * scale
    assert (sim.system.radii**3).sum() == pytest.approx((system.radii**3).sum(), rel=1e-13)
    assert len(set(sim.state.ids.tolist())) == len(sim.state)
    taken = sum(event["energy"] for event in report.events)
    assert (report.energy_taken or 0.0) == pytest.approx(taken, rel=1e-12)
    assert report.energy.max_relative_error < 1e-5  # mergers take a third of the energy


@settings(max_examples=8, deadline=None)
@given(st.integers(0, 10**6))
def test_hard_spheres_keep_energy_and_momentum(seed):
    system = cloud(seed, 20, FREE)
    sim = kd.Simulation(system, dt=0.25, events=[kd.Collision(action="bounce")])
    overlap = np.triu(np.linalg.norm(system.state.positions[:, None] - system.state.positions, axis=2), 1)
    report = sim.run(8)
    assert report.energy.max_relative_error < 1e-13
    assert report.momentum_error < 1e-14
    x, r = sim.state.positions, system.radii
    apart = np.linalg.norm(x[:, None] - x, axis=2) - r[:, None] - r
    started_apart = overlap - r[:, None] - r > 0
    assert apart[np.triu(started_apart, 1)].min() > -1e-9


# --- escapes ---


def escaping(action: str, **more) -> kd.Simulation:
    """A body that leaves two others faster than their escape speed, and a bound body at the same distance."""
    x = [[0, 0, 0], [1, 0, 0], [3, 0, 0], [0, 9, 0]]
    v = [[0, 0, 0], [0, 1, 0], [2, 0, 0], [0.33, 0, 0]]
    system = straight(x, v, [1, 0, 1e-3, 1e-6], G=1.0, names=["sun", "near", "out", "far"])
    return kd.Simulation(system, dt=0.05, events=[kd.Escape(7.0, action=action, **more)])


def test_an_escape_is_logged_once():
    sim = escaping("log")
    report = sim.run(400)
    (event,) = report.events
    assert (event["bodies"], event["done"]) == (["out"], "logged")
    assert 7.0 < event["distance"] < 7.0 + 2 * 0.05
    assert len(sim.state) == 4
    assert escaping("log", about="sun").run(400).events[0]["step"] == pytest.approx(event["step"], abs=1)


def test_an_escape_removes_the_body():
    sim = escaping("remove")
    report = sim.run(400)
    assert sim.state.ids.tolist() == [0, 1, 3]
    assert sim.system.names == ("sun", "near", "far")
    assert report.events[0]["done"] == "removed"
    assert report.energy.max_relative_error < 1e-4
    assert report.momentum_error < 1e-12
    assert report.energy_taken == pytest.approx(1e-3 * (2 - 1 / 3), rel=1e-2)


def test_an_escape_stops_the_run():
    report = escaping("stop").run(400)
    assert report.stopped.startswith("out escapes at t = ")
    assert report.steps == report.events[0]["step"] < 60


# --- the same bits ---


def watched_all(system: kd.System) -> list:
    return [
        kd.CloseApproach(0.5),
        kd.Crossing.pericentre(0, 1),
        kd.Crossing(lambda t, x, v: x[0, 0], "x"),
        kd.Collision(1e-9),
        kd.Escape(1e6),
    ]


@pytest.mark.parametrize("name", shortened(METHODS, OF_EACH_FORM))
def test_every_method_is_watched_without_changing_its_bits(name):
    method = integrator(name)
    system = ellipse(0.3)
    dt = None if method.adaptive else 0.02
    try:
        plain = kd.Simulation(system, name, dt)
    except InputError as error:
        pytest.skip(f"refuses two comparable bodies: {error}")
    watched = kd.Simulation(system, name, dt, events=watched_all(system))
    run_to(plain, 6.9)
    report = run_to(watched, 6.9)
    assert watched.state.phase.tobytes() == plain.state.phase.tobytes()
    assert report.steps == plain.report().steps
    if not method.chooses_steps:  # for an adaptive method, looks inside a step cost evaluations
        assert report.force_evaluations == plain.report().force_evaluations
    found = [event for event in report.events if event["kind"] == "pericentre"]
    if method.order > 1 or method.adaptive:
        assert [event["time"] for event in found] == pytest.approx([2 * math.pi], abs=0.1)


@pytest.mark.parametrize("name", shortened(METHODS, OF_EACH_FORM))
def test_every_method_merges(name):
    """Two bodies fall onto each other and merge; the merged body moves straight, with a third body far away."""
    method = integrator(name)
    system = straight(
        [[0, 0, 0], [1.0, 0.2, 0], [40, 0, 0]], [[0.1, 0, 0], [-0.8, 0, 0], [0, 0, 0]], [1, 1e-3, 1e-9], 0.3, G=1.0
    )
    dt = None if method.adaptive else 0.01
    try:
        sim = kd.Simulation(system, name, dt, events=[kd.Collision()])
    except InputError as error:
        pytest.skip(f"refuses this system: {error}")
    start = momentum(sim)
    report = run_to(sim, 1.0)
    (event,) = report.events
    assert event["time"] == pytest.approx(0.380, abs=0.02)
    assert event["distance"] == pytest.approx(0.6, abs=1e-6)
    assert len(sim.state) == 2
    assert momentum(sim) == pytest.approx(start, abs=1e-6)
    assert sim.time == pytest.approx(1.0, abs=1e-12)


@pytest.mark.parametrize("name", ["velocity-verlet", "dop853", "leapfrog-adaptive"])
def test_runs_in_pieces_give_the_same_bits_and_events(name):
    system = cloud(3, 12)
    watched = [kd.Collision(0.15), kd.CloseApproach(0.6), kd.Crossing(lambda t, x, v: x[0, 0], "x")]

    def begin() -> kd.Simulation:
        return kd.Simulation(system, name, 0.05 if name != "dop853" else None, events=watched)

    whole, pieces, looked = begin(), begin(), begin()
    run_to(whole, 2.0)
    if whole.method.chooses_steps:
        for time in (0.1, 0.10001, 0.7, 1.1, 1.9, 2.0):
            pieces.run(until=time)
            assert all(event["time"] <= time for event in pieces.events)
        looked.run(until=2.0, interval=0.013)
    else:
        for steps in (1, 9, 20, 10):
            pieces.run(steps)
        looked.run(40, every=3, observe=lambda sim: sim.energy())
    assert [event["done"].split()[-2:] for event in whole.events if event["kind"] == "collision"]
    assert pieces.events == looked.events == whole.events
    assert pieces.state.phase.tobytes() == looked.state.phase.tobytes() == whole.state.phase.tobytes()


def test_setting_the_state_begins_anew():
    sim = kd.Simulation(ellipse(0.3), dt=0.02, events=[kd.Crossing.pericentre("P", "S")])
    start = sim.state
    sim.run(400)
    first = sim.events
    sim.state = start
    assert sim.events == []
    sim.run(400)
    assert sim.events == first


def test_events_stay_behind_a_blow_up():
    """The state goes back to the last sample, and later events are dropped: an unstable step reverses y."""
    problem = kd.Problem(lambda t, y: np.array([-1e3 * y[0]]), [1.0])
    sim = kd.Simulation(problem, "euler", 1.0, events=[kd.Crossing(lambda t, y: y[0], "turn")])
    with pytest.raises(RunError, match="blew up"):
        sim.run(200, every=7)
    assert [event["step"] for event in sim.events] == list(range(1, sim.steps_done + 1))
    assert sim.steps_done > 20


# --- files, JSON and system files ---

FILE = """
units = "nbody"
[particles]
positions = [[-1, 0, 0], [1, 0, 0], [0, 9, 0]]
masses = [2, 1, 1]
names = ["A", "B", "C"]
radii = [0.3, 0.2, 0.1]
[velocities]
values = [[1, 0, 0], [-1, 0, 0], [0, 2, 0]]
[[force]]
type = "gravity"
G = 1e-12
[[event]]
type = "collision"
[[event]]
type = "escape"
distance = 12.0
action = "remove"
[[event]]
type = "close-approach"
distance = 1.5
bodies = ["A", "B"]
[run]
dt = 0.1
steps = 30
"""


COLLISION = '[[event]]\ntype = "collision"'


def loaded(text: str) -> kd.System:
    from kickdrift.systemfile.reading import loads

    return loads(text)


def test_a_file_holds_the_events_and_n_bodies(tmp_path):
    path = tmp_path / "run.h5md"
    sim = kd.Simulation(loaded(FILE))
    report = sim.run(10, output=path, every=5)
    report = sim.run(20, output=path)
    with kd.open(path) as run:
        assert run.events == report.events == sim.events
        assert [event["kind"] for event in run.events] == ["collision", "escape"]
        assert [event["bodies"] for event in run.events] == [["A", "B"], ["C"]]
        last = run[-1].positions
        assert last.shape == (3, 3)
        assert last[0] == pytest.approx([2 / 3, 0, 0], abs=1e-10)
        assert last[1].tolist() == last[0].tolist()  # at the survivor's position
        assert np.isnan(last[2]).all()  # removed
        assert run[0].positions[1].tolist() == [1, 0, 0]
        universe = run.universe()
        assert len(universe.trajectory) == len(run) == 7
        assert universe.trajectory[-1].positions.shape == (3, 3)
    from kickdrift.trajectory.read.info import describe, info

    text = describe(info(path))
    assert "collision" in text
    assert "A – B, distance 0.5, B merged into A" in text


def test_a_file_without_its_end_has_its_events(tmp_path):
    """A passage in progress at the end is in the report; the table of events grows with the frames."""
    path = tmp_path / "run.h5md"
    text = FILE.replace('[[event]]\ntype = "collision"\n', "").replace("[1, 0, 0], [0, 9", "[1, 0.1, 0], [0, 9")
    sim = kd.Simulation(loaded(text))
    sim.run(8, output=path, every=1)
    with kd.open(path) as run:
        assert [event["done"] for event in run.events] == ["going on"]
    sim.run(22, output=path)
    with kd.open(path) as run:
        assert [(event["kind"], event["done"]) for event in run.events] == [
            ("escape", "removed"),
            ("close-approach", "passed"),
        ]


def test_a_file_begun_after_a_merger_has_all_bodies(tmp_path):
    """The file equals one that was begun before the merger, and the run continues from either."""
    sim = kd.Simulation(loaded(FILE))
    sim.run(9)
    sim.run(5, output=tmp_path / "run.h5md", every=1)
    with kd.open(tmp_path / "run.h5md") as run:
        assert run.ids.tolist() == [0, 1, 2]
        assert run.names == ("A", "B", "C")
        for frame in run:
            np.testing.assert_array_equal(frame.positions[1], frame.positions[0])


def test_the_command_line_prints_and_writes_them(tmp_path, kickdrift):
    file, out = tmp_path / "three.toml", tmp_path / "run.json"
    file.write_text(FILE)
    code, text, _ = kickdrift("run", file, "--json", out, "--quiet")
    assert code == 0
    assert re.search(r"energy taken +3\.3333333 ", text)
    assert "t = 0.75, A – B, distance 0.5, B merged into A" in text
    written = json.loads(out.read_text())
    assert [event["kind"] for event in written["events"]] == ["collision", "escape"]
    assert written["events"][0]["ids"] == [0, 1]
    assert written["energy_taken"] == pytest.approx(4 / 3 + 2.0)


def test_many_events_are_counted():
    from kickdrift.model.event_log import event_lines

    sim = kd.Simulation(ellipse(0.3), dt=0.05, events=[kd.Crossing(lambda t, x, v: math.sin(9 * t + 0.1), "beat")])
    lines = event_lines(sim.run(400).events)
    assert len(lines) == 21
    assert lines[-1][1] == f"and {len(sim.events) - 20} more events"


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ('type = "escape"', 'type = "escapes"', "event[1].type: expected one of close-approach, collision,"),
        ('type = "escape"', 'kind = "escape"', "event[1].type: required key is missing"),
        ("distance = 12.0", "distance = -1", "event[1].distance: expected a positive length, got -1"),
        ("distance = 12.0", "", "event[1].distance: required key is missing"),
        ('action = "remove"', 'action = "explode"', "event[1].action: expected 'log', 'remove' or 'stop'"),
        ('bodies = ["A", "B"]', 'bodies = ["A", "b"]', "event[2]: close-approach: bodies: there is no body 'b'"),
        ("distance = 1.5", "distance = 0", "event[2]: close-approach: distance must be a positive number, got 0.0"),
        ("radii = [0.3, 0.2, 0.1]", "radii = [0.3, -0.2, 0.1]", "particles.radii[1]: expected a non-negative length"),
        ("radii = [0.3, 0.2, 0.1]", "", "event[0]: collision: radii: required, since the bodies of"),
        ('type = "collision"', 'type = "collision"\nradii = {D = 1.0}', "event[0]: collision: radii: there is no body"),
        ('type = "collision"', 'type = "collision"\nradius = 1.0', "event[0].radius: unknown key"),
        ('type = "collision"', 'type = "pericentre"\nbody = "A"\nabout = "A"', "event[0]: pericentre: expected two"),
        ('[[event]]\ntype = "collision"', "[event]", ""),
    ],
)
def test_bad_tables_name_the_key(old, new, message):
    assert old in FILE
    with pytest.raises(InputError) as caught:
        loaded(FILE.replace(old, new, 1))
    assert message in str(caught.value)
    assert "\n" not in str(caught.value)


def test_lengths_in_files_have_units():
    text = FILE.replace('"nbody"', '"si"').replace(COLLISION, COLLISION + '\nradii = {A = "2 cm"}')
    text = text.replace("distance = 12.0", 'distance = "2 km"').replace("distance = 1.5", "distance = 1.5\nhill = true")
    system = loaded(text)
    assert system.events[0].radii_in(system).tolist() == [0.02, 0, 0]
    assert system.events[1].distance == 2000.0
    assert system.events[2].hill


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: kd.CloseApproach(0.0), "close-approach: distance must be a positive number, got 0.0"),
        (lambda: kd.CloseApproach(math.nan), "close-approach: distance must be a positive number, got nan"),
        (lambda: kd.CloseApproach(1.0, []), "close-approach: bodies: expected one or more, got []"),
        (lambda: kd.Collision(-1.0), "collision: radii must be a length, zero or more, got -1.0"),
        (lambda: kd.Collision([0.1, -2.0]), "collision: radii[1] must be a length, zero or more, got -2.0"),
        (lambda: kd.Collision({"A": "big"}), "collision: radii[A] must be a length, zero or more, got 'big'"),
        (lambda: kd.Collision("big"), "collision: radii must be lengths, got 'big'"),
        (lambda: kd.Collision(1.0, "melt"), "collision: action must be one of merge, bounce, fragment, rule, stop"),
        (lambda: kd.Collision(1.0, "bounce", 1.5), "collision: restitution must be a number from 0 to 1, got 1.5"),
        (lambda: kd.Collision(1.0, "merge", 0.5), "collision: restitution needs action 'bounce', not 'merge'"),
        (lambda: kd.Escape(-1.0), "escape: distance must be a positive number, got -1.0"),
        (lambda: kd.Escape(1.0, action="merge"), "escape: action must be one of log, remove, stop, got 'merge'"),
        (lambda: kd.Crossing(3.0, "three"), "crossing 'three': function must be callable, got 3.0"),
        (lambda: kd.Crossing(abs, ""), "crossing: name must be text of 1 to 64 bytes, got ''"),
        (lambda: kd.Crossing(abs, "abs", 2), "crossing 'abs': direction must be -1, 0 or 1, got 2"),
        (lambda: kd.Crossing(abs, "abs", 1, 0.0), "crossing 'abs': tolerance must lie between 0 and 1, got 0.0"),
        (lambda: head_on(events=[kd.CloseApproach(1.0, ["a"])]), "close-approach: bodies: there is no body 'a'"),
        (lambda: head_on(events=[kd.CloseApproach(1.0, ["A", 0])]), "close-approach: bodies: a body is named twice in"),
        (lambda: head_on(events=[kd.Collision([1.0])]), "collision: radii: expected one number or 2, got 1"),
        (lambda: head_on(events=[kd.Escape(1.0, about=7)]), "escape: about: there is no body 7 (known: A, B)"),
        (lambda: head_on(events=[kd.Crossing.pericentre(0, "A")]), "pericentre: expected two bodies, got 0 twice"),
        (lambda: head_on(events=kd.Escape(1.0)), "events: expected a list of events, got Escape("),
        (lambda: head_on(events=["escape"]), "events: expected CloseApproach, Collision, Escape or Crossing, got"),
        (lambda: straight([[0, 0, 0]], None, radii=[-1]), "radii: particle 0 has radius -1.0; expected a length, zero"),
        (lambda: straight([[0, 0, 0]], None, radii=[1, 2]), "radii: expected one number or 1, got shape (2,)"),
        (lambda: kd.System([[0, 0, 0]], events=[kd.Escape(1.0)]), "escape: only gravity binds bodies, but 'system'"),
        (lambda: kd.System([[0, 0, 0]], events=[kd.Collision()]), "collision: radii: required, since the bodies of"),
        (
            lambda: kd.System([[1, 1, 1]], box=(9, 9, 9), events=[kd.CloseApproach(1.0)]),
            "close-approach: events need open space, but the box is periodic",
        ),
    ],
)
def test_what_makes_no_sense_is_refused(make, message):
    with pytest.raises(InputError) as caught:
        make()
    assert str(caught.value).startswith(message)


def test_springs_do_not_merge():
    joined = kd.System([[0, 0, 0], [1, 0, 0]], forces=[kd.Springs([(0, 1)], 1.0)], radii=0.1)
    with pytest.raises(InputError, match="collision: action 'merge' cannot act on bodies joined by springs"):
        kd.Simulation(joined, dt=0.1, events=[kd.Collision()])


def test_a_problem_takes_crossings_of_y_alone():
    problem = kd.Problem(lambda t, y: -y, [1.0])
    for event in (kd.Collision(1.0), kd.Crossing.pericentre(0, 1)):
        with pytest.raises(InputError, match="needs particles; for a Problem use a Crossing with a function of y"):
            kd.Simulation(problem, events=[event])


def test_a_crossing_shows_the_state_at_each_zero():
    """A Problem and a System: g is zero there, and the states are those of the run."""
    seen: list = []
    rising = kd.Crossing(lambda t, y: y[0], "zero", 1, seen=lambda t, y: seen.append((t, *y)))
    spring = kd.Problem(lambda t, y: [y[1], -y[0]], [0.0, -1.0], name="spring")
    kd.Simulation(spring, "dormand-prince45", rtol=1e-10, atol=1e-10, events=[rising]).run(until=10.0)
    np.testing.assert_allclose(seen, [(np.pi, 0.0, 1.0), (3.0 * np.pi, 0.0, 1.0)], atol=1e-7)
    kept: list = []
    event = kd.Crossing(lambda t, x, v: x[0, 0], "plane", seen=lambda t, x, v: kept.append((t, x, v)))
    kd.Simulation(kd.System([[1.0, 2, 3]], [[-1.0, 0, 0.5]], events=[event]), "velocity-verlet", 0.3).run(5)
    ((t, x, v),) = kept
    np.testing.assert_allclose((t, *x[0], *v[0]), (1.0, 0, 2, 3.5, -1, 0, 0.5), atol=1e-12)
    kept.clear()
    system = kd.System([[1.0, 2, 3]], [[-1.0, 0, 0.5]], forces=[kd.Beside(lambda t, y, bodies: y, [0.0, 1.0])])
    event = kd.Crossing(lambda t, x, v, y: x[0, 0], "plane", seen=lambda t, x, v: kept.append((t, x, v)))
    kd.Simulation(system.watched([event]), "velocity-verlet", 0.3).run(5)
    assert kept[0][1].shape == kept[0][2].shape == (1, 3)  # without the unknowns
    with pytest.raises(InputError, match="seen must be callable"):
        kd.Crossing(lambda t, y: y[0], "zero", seen=3)

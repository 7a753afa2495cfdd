"""Contacts under fixed steps: none lost, none late, and no state from beyond a contact."""

import math

import numpy as np
import pytest

import kickdrift as kd
from kickdrift.run.watch import contacts, parting

TIMES = {("c", "d"): 0.15958477853, ("a", "b"): 0.27947159781}  # by gauss-radau15


def two_pairs(**more) -> kd.System:
    """A star with two pairs of small bodies that meet head-on within a step."""
    s, t = 1 / math.sqrt(5), -1 / math.sqrt(7)
    return kd.System(
        [[0, 0, 0], [5, 0, 0], [5.05, 0, 0], [-7, 0, 0], [-7.04, 0, 0]],
        [[0, 0, 0], [0, s, 0], [-0.1, s, 0], [0, t, 0], [0.1, t, 0]],
        [1, 1e-6, 2e-6, 3e-6, 1e-6], radii=[0.005, 0.01, 0.012, 0.014, 0.01], names=["star", "a", "b", "c", "d"],
        forces=[kd.Gravity()], units="nbody", **more,
    )  # fmt: skip


METHODS = [
    ("leapfrog", 0.5), ("leapfrog", 0.4), ("velocity-verlet", 0.5), ("yoshida4", 0.3), ("forest-ruth", 0.6),
    ("rk4", 0.5), ("wisdom-holman", 0.5), ("saba", 0.5), ("trace", 0.4), ("trace", 0.55), ("trace", 0.6),
    ("hermite4", 0.5),
]  # fmt: skip


@pytest.mark.parametrize(("name", "dt"), METHODS)
def test_both_hits_of_a_step_come_at_their_times(name, dt):
    sim = kd.Simulation(two_pairs(), name, dt, events=[kd.Collision()])
    report = sim.run(until=1.2)
    assert {tuple(event["bodies"]): event["time"] for event in report.events} == pytest.approx(TIMES, abs=1e-9)
    assert report.energy.max_relative_error < 1e-4
    assert sim.system.names == ("star", "b", "c")


def test_many_bodies_take_parts_by_their_own_method(monkeypatch):
    monkeypatch.setattr(contacts, "ALL_PAIRS", 2)
    monkeypatch.setattr(parting, "ALL_PAIRS", 2)
    for name, dt in (("leapfrog", 0.5), ("yoshida4", 0.3)):
        report = kd.Simulation(two_pairs(), name, dt, events=[kd.Collision()]).run(3)
        assert {tuple(event["bodies"]): event["time"] for event in report.events} == pytest.approx(TIMES, abs=2e-4)
        assert report.energy.max_relative_error < 1e-4


@pytest.mark.parametrize(
    "action", [{"action": "bounce"}, {"action": "fragment", "fragment_mass": 4e-7, "reference_density": 0.2}]
)
@pytest.mark.parametrize("name", ["leapfrog", "yoshida4", "trace"])
def test_bodies_leave_a_contact_without_a_kick(name, action):
    sim = kd.Simulation(two_pairs(), name, 0.3, events=[kd.Collision(**action)])
    report = sim.run(10)
    found = [tuple(event["bodies"][:2]) for event in report.events]
    assert found[:2] == [("c", "d"), ("a", "b")]
    assert report.energy.max_relative_error < 1e-3


def test_a_stop_names_the_first_hit():
    for name, dt in (("leapfrog", 0.4), ("trace", 0.4)):
        sim = kd.Simulation(two_pairs(), name, dt, events=[kd.Collision(action="stop")])
        assert sim.run(5).stopped == "c and d touch at t = 0.159584779"


def test_a_test_particle_hits_a_body():
    system = kd.System(
        [[0, 0, 0], [3, 0, 0], [3.03, 0, 0]], [[0, 0, 0], [0, 3**-0.5, 0], [-0.1, 3**-0.5, 0]], [1, 1e-6, 0],
        radii=[0.005, 0.01, 0.0], forces=[kd.Gravity()], units="nbody",
    )  # fmt: skip
    times = [kd.Simulation(system, *each, events=[kd.Collision()]).run(until=1.0).events[0]["time"]
             for each in (("gauss-radau15",), ("leapfrog", 0.5), ("wisdom-holman", 0.5))]  # fmt: skip
    assert times == pytest.approx([times[0]] * 3, abs=1e-9)


@pytest.mark.parametrize("name", ["leapfrog", "trace"])
def test_a_near_miss_changes_no_bit(name):
    """Two bodies pass at 1.1 times the sum of their radii."""
    masses, radii = [1, 1e-6, 1e-6], [0.005, 0.01, 0.01]
    system = kd.System(
        [[0, 0, 0], [5, 0, 0], [5.05, 0.022, 0]], [[0, 0, 0], [0, 5**-0.5, 0], [-0.2, 5**-0.5, 0]], masses, radii=radii,
        forces=[kd.Gravity()], units="nbody",
    )  # fmt: skip
    plain, watched = (kd.Simulation(system, name, 0.5, events=events) for events in ([], [kd.Collision()]))
    plain.run(4)
    assert not watched.run(4).events
    assert watched.state.phase.tobytes() == plain.state.phase.tobytes()


def test_no_stage_of_the_step_before_a_contact_looks_beyond_it():
    """yoshida4 evaluates forces at 1.35 of its step: 1.065 steps lie between the start of this step and the contact."""
    system = kd.System(
        [[0, 0, 0], [5, 0, 0], [5.03, 0, 0]], [[0, 0, 0], [0, 5**-0.5, 0], [-0.1, 5**-0.5, 0]], [1, 4e-8, 1e-9],
        radii=[0.005, 0.001, 0.008], forces=[kd.Gravity()], units="nbody",
    )  # fmt: skip
    (exact,) = kd.Simulation(system, "gauss-radau15", events=[kd.Collision()]).run(until=0.5).events
    report = kd.Simulation(system, "yoshida4", exact["time"] / 3.065, events=[kd.Collision()]).run(4)
    assert [event["time"] for event in report.events] == pytest.approx([exact["time"]], abs=1e-6)
    assert report.energy.max_relative_error < 1e-6


def flyby(apart: float = 0.06) -> kd.System:
    return kd.System(
        [[0, 0, 0], [5, 0, 0], [5 + apart, 0.006, 0]], [[0, 0, 0], [0, 5**-0.5, 0], [-0.1, 5**-0.5, 0]],
        [1, 1e-5, 1e-5], forces=[kd.Gravity()], units="nbody",
    )  # fmt: skip


@pytest.mark.parametrize(("name", "dt"), [("leapfrog", 0.5), ("leapfrog", 0.2), ("yoshida4", 0.4), ("hermite4", 0.4)])
def test_the_least_distance_of_a_close_passage(name, dt):
    """Two bodies bend each other's way within a step; the step's own end may be noise."""
    events = [kd.CloseApproach(0.03, bodies=[1, 2])]
    ((exact,), (found,)) = (
        kd.Simulation(flyby(), *each, events=events).run(until=2.0).events for each in (("gauss-radau15",), (name, dt))
    )
    assert (found["distance"], found["time"]) == pytest.approx((exact["distance"], exact["time"]), rel=1e-3)


def test_a_passage_over_several_steps_resumes_with_the_same_entry(tmp_path):
    def begin() -> kd.Simulation:
        return kd.Simulation(flyby(), "leapfrog", 0.1, events=[kd.CloseApproach(0.04, bodies=[1, 2])])

    whole, file = begin(), str(tmp_path / "run.h5md")
    whole.run(15)
    begin().run(5, output=file)
    resumed = kd.resume(file)
    resumed.run(10)
    assert len(whole.events) == 1
    assert resumed.events == whole.events


@pytest.mark.parametrize(("name", "action"), [("yoshida4", "bounce"), ("trace", "merge")])
def test_cuts_threads_and_files_keep_the_bits(name, action, tmp_path):
    def begin(threads: int = 1) -> kd.Simulation:
        return kd.Simulation(two_pairs(), name, 0.3, events=[kd.Collision(action=action)], threads=threads)

    whole, cut, threads = begin(), begin(), begin(2)
    whole.run(6)
    for _ in range(6):
        cut.run(1)
    threads.run(6)
    file = str(tmp_path / "run.h5md")
    begin().run(1, output=file)
    resumed = kd.resume(file)
    resumed.run(5)
    for other in (cut, threads, resumed):
        assert other.state.phase.tobytes() == whole.state.phase.tobytes()
    assert cut.events == threads.events == whole.events


def test_looks_inside_a_step_with_a_hit_come_from_before_the_hit():
    whole, looked = (kd.Simulation(two_pairs(), "hermite4", 0.5, events=[kd.Collision()]) for _ in range(2))
    whole.run(until=1.0)
    seen = []
    looked.run(until=1.0, interval=0.05, observe=lambda sim: seen.append(sim.state.positions.copy()) or 0.0)
    assert looked.events == whole.events
    assert np.abs(np.array([each[1, 0] for each in seen if len(each) == 5]) - 5).max() < 0.02
    assert looked.state.phase.tobytes() == whole.state.phase.tobytes()


@pytest.mark.parametrize("event", [kd.Crossing(lambda t, x, v: x[0, 0] + 9.0, "far"), kd.Escape(50.0)])
def test_a_failed_step_without_contacts_is_no_good_step(event):
    sim = kd.Simulation(two_pairs(), "leapfrog", 0.3, events=[event])
    sim.run(1)
    stepper = sim.integration.events
    inner, search = stepper.inner, stepper._search
    assert search.scan(inner, inner.y, inner.time, inner.y, inner.time + 0.3)
    assert not search.scan(inner, inner.y, inner.time, inner.y, inner.time + 0.3, good=False)

"""Times between two steps, times with units, and a shortened last step."""

import numpy as np
import pytest

import kickdrift as kd
from kickdrift.errors import InputError
from tests.systems import liquid


def two_bodies():
    """Two bodies on circles about each other, period 2 pi."""
    x, v = [[0.5, 0.0, 0.0], [-0.5, 0.0, 0.0]], [[0.0, 0.5, 0.0], [0.0, -0.5, 0.0]]
    return kd.System(x, v, [0.5, 0.5], forces=[kd.Gravity()], units="nbody")


def test_a_time_between_two_steps_runs_to_the_nearest_and_says_so():
    sim = kd.Simulation(two_bodies(), dt=0.003)
    report = sim.run(until=1.0)
    assert (sim.steps_done, report.time) == (333, pytest.approx(0.999))
    assert report.warnings == ["time 1 is not a multiple of dt = 0.003: runs 333 steps, to 0.999"]
    report = sim.run(until=2.0)
    assert sim.steps_done == 667
    assert report.warnings[1:] == ["time 2 is not a multiple of dt = 0.003: runs 334 steps, to 2.001"]
    assert sim.steps_to(until=3.0) == 333
    assert sim.steps_to(until=3.0, exact="shorten") == 333


def test_a_time_on_the_grid_needs_no_word():
    sim = kd.Simulation(two_bodies(), dt=0.001)
    assert sim.run(until=1.0, exact=True).warnings == []
    assert sim.steps_done == 1000


def test_a_shortened_step_ends_at_the_time_and_leaves_the_run_on_its_grid():
    sim = kd.Simulation(two_bodies(), dt=0.003)
    report = sim.run(until=1.0, exact="shorten")
    angle = np.arctan2(sim.state.positions[0, 1], sim.state.positions[0, 0])
    assert angle == pytest.approx(1.0, abs=1e-6)  # on the circle the angle is the time
    assert (sim.time, sim.state.time, report.time) == (1.0, 1.0, pytest.approx(1.0))
    assert (sim.steps_done, report.steps, report.warnings) == (334, 334, [])
    assert sim.record.samples[-1].time == 1.0
    sim.run(until=2.001)
    plain = kd.Simulation(two_bodies(), dt=0.003)
    plain.run(667)
    assert (sim.state.phase == plain.state.phase).all()
    assert (sim.time, sim.report().steps) == (plain.time, 667)


def test_a_shortened_step_is_the_method_itself_with_that_step():
    sim = kd.Simulation(liquid(), "yoshida4", dt=0.003)
    sim.run(until=0.0305, exact="shorten")
    whole = kd.Simulation(liquid(), "yoshida4", dt=0.003)
    whole.run(10)
    rest = kd.Simulation(liquid(), "yoshida4", dt=0.0005)
    rest.state = whole.state
    rest.run(1)
    assert sim.state.phase == pytest.approx(rest.state.phase, abs=1e-12)


def test_a_file_holds_the_shortened_step_and_can_be_resumed(tmp_path):
    path = tmp_path / "run.h5md"
    sim = kd.Simulation(liquid(), dt=0.005)
    sim.run(until=0.1234, exact="shorten", every=5, output=path)
    with kd.open(path) as run:
        assert run.steps.tolist() == [0, 5, 10, 15, 20, 25]
        assert run.times[-1] == 0.1234
    resumed = kd.resume(path)
    assert (resumed.time, resumed.steps_done) == (0.1234, 25)
    assert (resumed.state.phase == sim.state.phase).all()
    resumed.run(until=0.2)
    plain = kd.Simulation(liquid(), dt=0.005)
    plain.run(40)
    assert (resumed.state.phase == plain.state.phase).all()


def test_events_are_not_watched_in_a_shortened_step():
    sim = kd.Simulation(two_bodies().watched([kd.CloseApproach(0.1)]), dt=0.3)
    with pytest.raises(InputError, match="events are not watched in a shortened step"):
        sim.run(until=1.0, exact="shorten")
    assert sim.steps_done == 0


def test_times_with_units():
    argon = kd.load("argon-864")
    sim = kd.Simulation(argon, dt="2 fs")
    assert sim.dt == pytest.approx(0.002)
    sim.run(until="0.1 ps")
    assert sim.steps_done == 50
    with pytest.raises(InputError, match="dt: expected a time such as"):
        kd.Simulation(argon, dt="2 nm")
    with pytest.raises(InputError, match="until: times of a Problem are plain numbers"):
        kd.Simulation(kd.load("ode-kepler")).run(until="1 s")

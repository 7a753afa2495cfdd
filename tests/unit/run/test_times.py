"""Looks at given times, and ends between two steps: states, files, restarts, runs back in time, refusals."""

import numpy as np
import pytest

import kickdrift as kd
from kickdrift.errors import InputError
from kickdrift.systemfile.reading import loads
from tests.systems import circling, liquid

TIMES = [0.0012, 0.0031, 0.005, 0.0123, 0.02, 0.0211, 0.0212]
NOSE_HOOVER = {"temperature": 1.0, "tau": 0.5, "splitting": "yoshida4"}


def angle(state):
    return np.arctan2(state.positions[0, 1], state.positions[0, 0])


@pytest.mark.parametrize(
    ("name", "options", "error"),
    [("velocity-verlet", {"dt": 0.003}, 1e-6), ("yoshida4", {"dt": 0.01}, 1e-7), ("dop853", {}, 1e-7)],
)
@pytest.mark.parametrize("times", [[0.1, 0.1001, 0.3, 1.0], [-0.1, -0.25, -0.251, -1.0], np.linspace(0.0, 1.0, 7)])
def test_the_states_are_those_at_the_times(name, options, error, times):
    sim, seen = kd.Simulation(circling("A", "B"), name, **options), []
    report = sim.run(times=times, observe=lambda sim: seen.append((sim.time, sim.state.time, angle(sim.state))))
    begin = [] if times[0] == 0.0 else [0.0]
    assert np.array(seen) == pytest.approx(np.transpose([[*begin, *times]] * 3), abs=error)
    assert [sample.time for sample in sim.record.samples] == [time for time, _, _ in seen]
    assert (sim.time, report.time, report.warnings) == (times[-1], pytest.approx(times[-1]), [])


def test_a_shortened_copy_is_the_method_itself_with_that_step():
    """Under a heat bath too: the copy has the memory of the bath, and the noise of the step."""
    for name, options in (("yoshida4", {}), ("nose-hoover", NOSE_HOOVER)):
        sim, seen = kd.Simulation(liquid(), name, dt=0.003, **options), []
        sim.run(times=[0.0305, 0.0312], observe=lambda sim, seen=seen: seen.append(sim.state.phase))
        for length, there in zip((0.0005, 0.0012), seen[1:], strict=True):
            whole, rest = (kd.Simulation(liquid(), name, dt=dt, **options) for dt in (0.003, length))
            whole.run(10)
            rest.state = whole.state
            if options:
                rest.integration.stepper.baths = whole.integration.stepper.baths
            rest.run(1)
            assert there == pytest.approx(rest.state.phase, abs=1e-12)


def test_the_heat_of_a_bath_is_known_inside_a_step():
    sim = kd.Simulation(liquid(), "nose-hoover", dt=0.002, **NOSE_HOOVER)
    sim.run(times=np.linspace(0.0003, 0.0503, 40))
    energies = [sample.energies.total for sample in sim.record.samples]
    assert np.ptp(energies) > 0.05
    assert np.ptp(sim.record.series().total) < 0.002


def test_a_file_has_frames_at_the_times_and_its_run_is_resumed(tmp_path):
    whole, cut = tmp_path / "whole.h5md", tmp_path / "cut.h5md"
    sim = kd.Simulation(liquid(), dt=0.005)
    sim.run(times=TIMES, output=whole)

    def stop(sim):
        if sim.time == TIMES[3]:
            raise RuntimeError("killed")

    with pytest.raises(RuntimeError, match="killed"):
        kd.Simulation(liquid(), dt=0.005).run(times=TIMES, output=cut, observe=stop)
    resumed = kd.resume(cut)
    assert (resumed.time, resumed.steps_done) == (TIMES[3], 3)
    resumed.run()
    with kd.open(whole) as run, kd.open(cut) as other:
        assert run.times.tolist() == other.times.tolist() == [0.0, *TIMES]
        assert run.steps.tolist() == [0, 1, 1, 1, 3, 4, 5, 5]
        assert (run.positions == other.positions).all()
    resumed.run(times=[0.03, 0.0314])
    resumed.run(3)
    with kd.open(cut) as run:
        assert run.times[-5:] == pytest.approx([0.03, 0.0314, 0.04, 0.045, 0.05])
        assert len(run.plan) == 7
    plain = kd.Simulation(liquid(), dt=0.005)
    plain.run(10)
    assert (resumed.state.phase == plain.state.phase).all()


def test_an_adaptive_file_and_a_problem(tmp_path):
    path = tmp_path / "run.h5"
    sim = kd.Simulation(kd.load("ode-kepler"), "dop853")
    sim.run(times=[0.1, 0.5, 2.0], output=path)
    with kd.open(path) as run:
        assert run.times.tolist() == [0.0, 0.1, 0.5, 2.0]
    fine = kd.Simulation(kd.load("ode-kepler"), "dop853", rtol=1e-12, atol=1e-12)
    fine.run(until=2.0)
    assert sim.state.y == pytest.approx(fine.state.y, abs=1e-6)


def test_times_with_units_and_in_a_system_file(tmp_path):
    argon = kd.load("argon-864")
    sim = kd.Simulation(argon, dt="10 fs")
    sim.run(times=["5 fs", 0.01, "0.02 ps"])
    assert [sample.time for sample in sim.record.samples] == pytest.approx([0.0, 0.005, 0.01, 0.02])
    given = argon.with_run(times=["5 fs", 0.03])
    assert given.run.times == pytest.approx((0.005, 0.03))
    assert (given.run.steps, given.run.every) == (None, None)
    assert loads(given.to_toml(), "again").run == given.run
    assert given.with_run(steps=10).run.times is None
    path = tmp_path / "run.h5md"
    kd.Simulation(given).run(times=given.run.times, output=path)
    with kd.open(path) as run:
        assert run.system().run == given.run


@pytest.mark.parametrize(
    ("times", "message"),
    [
        ([], "times: expected one time or more, got none"),
        ("1 ps", "times: expected a row of times, such as [0.5, 1.0], got '1 ps'"),
        (1.0, "times: expected a row of times, such as [0.5, 1.0], got 1.0"),
        ([[1.0]], "times[0]: expected a finite time, got [1.0]"),
        ([0.1, np.nan], "times[1]: expected a finite time, got nan"),
        ([0.1, "x"], "times[1]: expected a finite time, got 'x'"),
        (["1 s"], "times[0]: nbody quantities are plain numbers, got '1 s'"),
        ([0.2, 0.1], "times[1]: 0.1 does not follow 0.2; times rise, or fall for a run back in time"),
        ([0.1, 0.1], "times[1]: 0.1 does not follow 0.1"),
        ([-0.1, 0.1], "times[0]: -0.1 lies before the present, 0"),
        ([0.1, -0.1], "times[0]: 0.1 lies after the present, 0"),
    ],
)
def test_wrong_times(times, message):
    sim = kd.Simulation(circling("A", "B"), dt=0.003)
    with pytest.raises(InputError) as error:
        sim.run(times=times)
    assert str(error.value).startswith(message)
    assert sim.steps_done == 0


@pytest.mark.parametrize("other", [{"steps": 3}, {"until": 1.0}, {"time": 1.0}, {"every": 2}, {"exact": True}])
def test_times_stand_alone(other):
    with pytest.raises(InputError, match=f"run: give times alone: .*, and so does {next(iter(other))}"):
        kd.Simulation(circling("A", "B"), dt=0.003).run(times=[1.0], **other)


def test_where_a_shortened_copy_has_no_meaning():
    pressed = {"temperature": 1.0, "tau": 0.5, "pressure": 1.0, "pressure_tau": 1.0, "compressibility": 0.1}
    sim = kd.Simulation(liquid(), "csvr", dt=0.002, **pressed)
    with pytest.raises(
        InputError, match=r"times: 0.003 lies inside a step of 0.002, and a barostat acts between whole"
    ):
        sim.run(times=[0.002, 0.003])
    sim.run(times=[0.004, 0.01])
    assert sim.steps_done == 5
    merging = circling("A", "B").watched([kd.Collision(action="merge", radii=0.01)])
    with pytest.raises(InputError, match=r"times: 1 lies inside a step of 0\.3, and events change bodies inside"):
        kd.Simulation(merging, dt=0.3).run(times=[1.0])


@pytest.mark.parametrize("name", ["velocity-verlet", "dop853"])
def test_logged_events_are_found_beside_the_times(name):
    system = circling("A", "B").watched([kd.CloseApproach(1.5, action="log")])
    with_times = kd.Simulation(system, name, dt=0.003)
    with_times.run(times=np.linspace(0.1, 2.0, 23))
    plain = kd.Simulation(system, name, dt=0.003)
    plain.run(until=2.0)
    assert with_times.events == plain.events
    assert with_times.going_on() == plain.going_on()


FILE = """
units = "nbody"
particles = { positions = [[0.5, 0, 0], [-0.5, 0, 0]], masses = [0.5, 0.5] }
velocities = { values = [[0, 0.5, 0], [0, -0.5, 0]] }
force = [{ type = "gravity" }]
run = { dt = 0.003, times = [0.1, 0.25] }
"""


def test_times_on_the_command_line(kickdrift, tmp_path):
    given, output = tmp_path / "two.toml", tmp_path / "two.h5md"
    given.write_text(FILE)
    assert kickdrift("run", given, "--output", output)[0] == 0
    status, _, err = kickdrift("resume", output, "--times", "0.3,0.4")
    assert (status, "continues from step 84" in err) == (0, True)
    with kd.open(output) as run:
        assert run.times.tolist() == [0.0, 0.1, 0.25, 0.3, 0.4]
    assert "the run is finished at step 134; --times extend it" in kickdrift("resume", output)[2]
    assert kickdrift("run", given, "--times", "0:1:5", "--output", output, "--overwrite")[0] == 0
    with kd.open(output) as run:
        assert run.times == pytest.approx([0.0, 0.25, 0.5, 0.75, 1.0])
    for words, message in (
        (["--times", "0.1", "--steps", "3"], "give --times or --steps, not both"),
        (["--times", "1:2"], "--times: '1:2' is neither times such as 1,2.5,4 nor START:STOP:COUNT"),
        (["--times", "0.2,0.1"], "times[1]: 0.1 does not follow 0.2"),
        (["--every", "4"], "run: give times alone"),
    ):
        status, out, err = kickdrift("run", given, *words)
        assert (status, out) == (2, "")
        assert message in err
    status, _, err = kickdrift("resume", output, "--steps", "600")
    assert (status, "the run looks at given times; give other --times to extend the run" in err) == (2, True)


@pytest.mark.parametrize(
    ("run", "message"),
    [
        ("times = [0.5, 0.2]", "run: times must rise, got 0.5 before 0.2"),
        ("times = [0.5], steps = 4", "run: expected times or steps, got both"),
        ("times = [0.5], every = 4", "run: expected times or every, got both"),
        ("times = []", "run.times: expected 1 or more items, got 0"),
        ('times = ["1 ps"]', "run.times[0]: nbody quantities are plain numbers, got '1 ps'"),
    ],
)
def test_wrong_times_in_a_file(run, message):
    with pytest.raises(InputError) as error:
        loads(FILE.replace("times = [0.1, 0.25]", run))
    assert message in str(error.value)


def test_a_time_between_two_steps_runs_to_the_nearest_and_says_so():
    sim = kd.Simulation(circling("A", "B"), dt=0.003)
    report = sim.run(until=1.0)
    assert (sim.steps_done, report.time) == (333, pytest.approx(0.999))
    assert report.warnings == ["time 1 is not a multiple of dt = 0.003: runs 333 steps, to 0.999"]
    report = sim.run(until=2.0)
    assert sim.steps_done == 667
    assert report.warnings[1:] == ["time 2 is not a multiple of dt = 0.003: runs 334 steps, to 2.001"]
    assert sim.steps_to(until=3.0) == 333
    assert sim.steps_to(until=3.0, exact="shorten") == 333


def test_a_time_on_the_grid_needs_no_word():
    sim = kd.Simulation(circling("A", "B"), dt=0.001)
    assert sim.run(until=1.0, exact=True).warnings == []
    assert sim.steps_done == 1000


def test_a_shortened_step_ends_at_the_time_and_leaves_the_run_on_its_grid():
    sim = kd.Simulation(circling("A", "B"), dt=0.003)
    report = sim.run(until=1.0, exact="shorten")
    angle = np.arctan2(sim.state.positions[0, 1], sim.state.positions[0, 0])
    assert angle == pytest.approx(1.0, abs=1e-6)  # on the circle the angle is the time
    assert (sim.time, sim.state.time, report.time) == (1.0, 1.0, pytest.approx(1.0))
    assert (sim.steps_done, report.steps, report.warnings) == (334, 334, [])
    assert sim.record.samples[-1].time == 1.0
    sim.run(until=2.001)
    plain = kd.Simulation(circling("A", "B"), dt=0.003)
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
    sim = kd.Simulation(circling("A", "B").watched([kd.CloseApproach(0.1)]), dt=0.3)
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


@pytest.mark.parametrize("method", ["radau", "gauss-radau15", "dormand-prince45"])
def test_ctrl_c_on_the_way_to_the_end_stops_there_and_changes_nothing(method):
    problem = kd.Problem(lambda t, y: [y[1], -y[0]], [1.0, 0.0])
    stopped, whole = (kd.Simulation(problem, method) for _ in range(2))
    stopped.run(steps=3)
    whole.run(steps=3)
    stepper, asked = stopped.integration.stepper, []
    time, y = stepper.time, stepper.y.copy()
    stepper.ahead(time + 1e4, lambda: asked.append(1) or len(asked) > 5)
    assert len(asked) == 6
    assert (stepper.time, stepper.y.tobytes()) == (time, y.tobytes())
    stopped.run(steps=5)
    whole.run(steps=5)
    assert stopped.state.y.tobytes() == whole.state.y.tobytes()

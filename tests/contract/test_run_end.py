"""End of a run for every adaptive method: f is evaluated at no later time, and the division of a run changes no bit.
Longest steps, and tolerances for each component of y."""

import json
import math

import numpy as np
import pytest
from typer.testing import CliRunner

import kickdrift as kd
from kickdrift.cli.main import app
from kickdrift.integrators import INTEGRATORS, integrator
from kickdrift.integrators.options import Options
from kickdrift.systemfile.reading import load

METHODS = [name for name in INTEGRATORS if integrator(name).chooses_steps and not integrator(name).particles_only]
ADAPTIVE = [name for name in METHODS if integrator(name).adaptive]
ARRAYS = [name for name in ADAPTIVE if "atol" in integrator(name).tunable]


class Seen:
    """A right-hand side in plain Python that records its latest time; separable, and undefined beyond time 1."""

    def __init__(self) -> None:
        self.latest = -np.inf

    def __call__(self, t, y):
        self.latest = max(self.latest, t)
        return [y[1], math.sqrt(1.0 - t)]

    def exact(self, t):
        return [2 / 3 * t - 4 / 15 * (1 - (1 - t) ** 2.5), 2 / 3 * (1 - (1 - t) ** 1.5)]


def made(name, f, y0=(0.0, 0.0), **given):
    given = {"dt": 0.03} | given if integrator(name).needs_dt else given
    return kd.Simulation(kd.Problem(f, y0, separable=True, compiled=False), name, **given)


@pytest.mark.parametrize("name", METHODS)
def test_f_is_evaluated_at_no_time_beyond_the_end(name):
    """Run to the last time at which f is defined: at once, in pieces, with looks, after steps, and with an event."""
    event = kd.Crossing(lambda t, y: y[1] - 0.3, "rise")
    for until, interval, events in ((1.0, 1.0, ()), (1.0, 0.13, ()), (1.0, None, [event]), (1.0, 0.21, [event])):
        f = Seen()
        sim = made(name, f, events=events)
        for end in (0.3, 0.3001, 0.9, until):
            sim.run(until=end, interval=interval)
            assert sim.time == end
            assert f.latest <= end
        assert sim.state.y == pytest.approx(f.exact(1.0), abs=1e-2 if name == "leapfrog-adaptive" else 1e-5)
        if events:
            (seen,) = sim.events
            assert f.exact(seen["time"])[1] == pytest.approx(0.3, abs=1e-2 if name == "leapfrog-adaptive" else 1e-5)
    f = Seen()
    sim = made(name, f)
    sim.run(2)
    assert sim.time < 0.5
    sim.run(until=0.5)
    assert f.latest <= 0.5


@pytest.mark.parametrize("name", METHODS)
def test_the_pieces_of_a_run_change_no_bit(name):
    def g(t, y):
        return [y[1], math.cos(3.0 * t) - y[0]]

    def look(sim):
        return sim.state.y

    whole, pieces, resumed = (made(name, g, (1.0, 0.0)) for _ in range(3))
    whole.run(until=2.0)
    for end in (1e-9, 1e-3, 0.5, 0.500001, 1.4, 2.0):
        pieces.run(until=end, interval=0.1, observe=look)
        checkpoint = pieces.checkpoint()
        resumed.restore(checkpoint)
        assert (resumed.time, resumed.steps_done) == (pieces.time, pieces.steps_done)
        assert resumed.state.y.tolist() == pieces.state.y.tolist()
    assert pieces.state.y.tolist() == whole.state.y.tolist()
    assert pieces.steps_done == whole.steps_done == whole.record.steps == pieces.record.steps
    for sim in (whole, pieces, resumed):
        sim.run(5)
    assert whole.time > 2.0
    assert pieces.state.y.tolist() == whole.state.y.tolist() == resumed.state.y.tolist()


def test_a_force_of_the_users_own_that_depends_on_time():
    """A user's force class may depend on time. The engine's forces do not, and their runs are unchanged."""
    system = load("two-body")
    assert not kd.Simulation(system, "dop853").integration.flow.clocked
    assert kd.Simulation(kd.Problem(lambda t, y: -y, [1.0])).integration.flow.clocked


@pytest.mark.parametrize("name", ADAPTIVE)
def test_where_f_is_zero_at_the_start(name):
    sim = kd.Simulation(kd.Problem(lambda t, y: [math.sin(t) - y[0]], [0.0]), name)
    sim.run(until=5.0)
    assert sim.state.y == pytest.approx([(math.exp(-5.0) + math.sin(5.0) - math.cos(5.0)) / 2], abs=1e-7)


@pytest.mark.parametrize("name", ADAPTIVE)
def test_no_step_is_longer_than_max_step(name):
    problem = kd.Problem(lambda t, y: [-y[0], 0.0], [1.0, 1.0])
    free, held = (kd.Simulation(problem, name, **given) for given in ({"rtol": 1e-3}, {"rtol": 1e-3, "max_step": 0.05}))
    times = []
    free.run(until=1.0)
    held.run(until=1.0, every=1, observe=lambda sim: times.append(sim.time))
    assert np.diff(times).max() <= 0.05 * (1 + 1e-12)
    assert held.steps_done >= 20 > free.steps_done
    assert held.report().options["max_step"] == 0.05
    assert Options(**json.loads(json.dumps(held.checkpoint()["options"]))).max_step == 0.05


@pytest.mark.parametrize("name", ARRAYS)
def test_a_tolerance_for_each_component(name):
    """With a loose tolerance for one component, the other one sets the steps. One number and a row of that number
    agree."""

    def f(t, y):
        return [math.cos(t), 30.0 * math.cos(30.0 * t)]

    steps = {}
    for label, rtol, atol in (
        ("one", 1e-5, 1e-6),
        ("row", [1e-5, 1e-5], np.array([1e-6, 1e-6])),
        ("loose", (1e-5, 1e-5), [1e-6, 1e3]),
        ("rtol too", np.array([1e-5, 1e3]), [1e-6, 10.0]),
    ):
        sim = kd.Simulation(kd.Problem(f, [0.0, 0.0], compiled=False), name, rtol=rtol, atol=atol)
        sim.run(until=3.0)
        steps[label] = sim.steps_done
        assert sim.state.y[0] == pytest.approx(math.sin(3.0), abs=1e-2)
    assert steps["one"] == steps["row"]
    assert steps["loose"] < steps["row"]
    assert steps["rtol too"] < steps["row"]
    other = kd.Simulation(kd.Problem(f, [0.0, 0.0], compiled=False), name, rtol=rtol, atol=atol)
    checkpoint = sim.checkpoint()
    other.restore(checkpoint | {"options": json.loads(json.dumps(checkpoint["options"]))})  # as a file returns it
    assert other.state.y.tolist() == sim.state.y.tolist()


@pytest.mark.parametrize(
    ("integrator", "options", "message"),
    [
        ("dop853", {"rtol": [1e-6]}, "rtol: expected one number, or 2 as y has components, got 1"),
        ("bdf", {"atol": [1e-6] * 3}, "atol: expected one number, or 2 as y has components, got 3"),
        ("lsoda", {"rtol": []}, "rtol: expected one number, or 2 as y has components, got 0"),
        ("rosenbrock", {"atol": [1e-6, -1.0]}, "atol[1] must be a positive number, got -1.0"),
        ("dop853", {"atol": np.array([1e-6, np.inf])}, "atol[1] must be a positive number, got inf"),
        ("dop853", {"rtol": np.ones((2, 2))}, "rtol[0] must be a positive number, got [1.0, 1.0]"),
        ("dop853", {"rtol": [1e-6, 1e-16]}, "rtol[1] must be 2.2e-14 or more, got 1e-16: smaller errors drown in"),
        ("dop853", {"rtol": True}, "rtol must be a positive number, got True"),
        ("gauss-radau15", {"rtol": [1e-6, 1e-6]}, "rtol: gauss-radau15 takes one number, got 2"),
        ("dop853", {"max_step": 0.0}, "max_step must be a positive finite time, got 0.0"),
        ("radau", {"max_step": math.inf}, "max_step must be a positive finite time, got inf"),
        ("lsoda", {"max_step": "1"}, "max_step must be a positive finite time, got '1'"),
        ("rk4", {"dt": 0.1, "max_step": 0.1}, "max_step: rk4 does not take it"),
    ],
)
def test_options_that_make_no_sense(integrator, options, message):
    with pytest.raises(kd.InputError) as error:
        kd.Simulation(kd.Problem(lambda t, y: -y, [1.0, 2.0], compiled=False), integrator, **options)
    assert message in str(error.value)
    assert "\n" not in str(error.value)


def test_particles_take_one_tolerance():
    with pytest.raises(kd.InputError, match="atol: expected one number for a System; only a"):
        kd.Simulation(load("two-body"), "dop853", atol=[1e-6] * 12)


def test_in_a_file_and_on_the_command_line(tmp_path):
    path = tmp_path / "robertson.toml"
    path.write_text(
        '[ode]\nproblem = "robertson"\n[run]\nintegrator = "radau"\ntime = 4.0\nmax_step = 0.5\n'
        "rtol = [1e-6, 1e-6, 1e-7]\natol = [1e-10, 1e-14, 1e-10]\n"
    )
    sim = kd.Simulation(load(path))
    assert (sim.options.rtol, sim.options.max_step) == ((1e-6, 1e-6, 1e-7), 0.5)

    def run(*words):
        done = CliRunner().invoke(app, ["run", str(path), "--quiet", "--json", str(tmp_path / "r.json"), *words])
        (tmp_path / "r.json").unlink() if done.exit_code else None
        return done

    done = run("--atol", "1e-9,1e-13,1e-9", "--max-step", "0.25")
    assert done.exit_code == 0, done.output
    found = json.loads((tmp_path / "r.json").read_text())
    assert found["atol"] == [1e-9, 1e-13, 1e-9]
    assert found["rtol"] == [1e-6, 1e-6, 1e-7]
    assert found["options"]["max_step"] == 0.25
    assert found["steps"] >= 16
    for text, line in (
        ("rtol = [1e-6, 0.0]", "run.rtol[1]: expected a number greater than 0, got 0.0"),
        ("rtol = []", "run.rtol: expected 1 or more items, got 0"),
        ('rtol = "small"', "run.rtol: expected a valid number, got 'small'"),
        ("max_step = -1.0", "run.max_step: expected a number greater than 0, got -1.0"),
    ):
        path.write_text(f'[ode]\nproblem = "robertson"\n[run]\ntime = 4.0\n{text}\n')
        with pytest.raises(kd.InputError) as error:
            load(path)
        assert str(error.value).endswith(line)

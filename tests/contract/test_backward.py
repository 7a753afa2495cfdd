"""Runs back in time, of every method: there and back again, against closed forms, and what is refused by name."""

import numpy as np
import pytest

import kickdrift as kd
from kickdrift.errors import InputError
from kickdrift.integrators import integrator
from tests.methods import METHODS
from tests.oracle.kepler import moved
from tests.systems import in_frame, liquid, needed

BACK = [name for name in METHODS if integrator(name).reversible or integrator(name).chooses_steps]
ONCE_ONLY = [name for name in METHODS if name not in BACK]


def planet(name, **options):
    """A planet around a star, eccentricity 0.3, semi-major axis 1 and period 2 pi."""
    system = kd.System(
        [[0.0, 0.0, 0.0], [0.7, 0.0, 0.0]],
        [[0.0, 0.0, 0.0], [0.0, np.sqrt(1.3 / 0.7), 0.0]],
        masses=[1.0, 0.0],
        forces=[kd.Gravity()],
        units="nbody",
    )
    return kd.Simulation(in_frame(name, system), name, 0.01 if integrator(name).needs_dt else None, **options)


@pytest.mark.parametrize("name", BACK)
def test_there_and_back_again(name):
    sim = planet(name)
    start = sim.state
    sim.run(until=2.0)
    there = sim.state
    report = sim.run(until=0.0)
    assert abs(there.positions - start.positions).max() > 1.0
    assert (sim.time, report.time) == (pytest.approx(0.0, abs=1e-12), pytest.approx(-2.0))
    tolerance = 1e-12 if integrator(name).reversible and not integrator(name).chooses_steps else 2e-5
    assert abs(sim.state.phase - start.phase).max() < tolerance
    assert [sample.time for sample in sim.record.samples][:: len(sim.record.samples) - 1] == [2.0, sim.time]


@pytest.mark.parametrize(
    ("name", "options"),
    [("yoshida8", {}), ("dop853", {}), ("gauss-radau15", {}), ("hermite4", {"eta": 1e-3}), ("wisdom-holman", {})],
)
def test_the_past_of_a_planet_is_that_of_kepler(name, options):
    sim = planet(name, **options)
    sim.run(until=-2.0)
    x, v = moved(1.0, -2.0, [0.7, 0.0, 0.0], [0.0, np.sqrt(1.3 / 0.7), 0.0])
    assert sim.state.positions[1] == pytest.approx(x.astype(float), abs=1e-6)
    assert sim.state.velocities[1] == pytest.approx(v.astype(float), abs=1e-6)


def test_whole_numbers_come_back_to_the_last_bit():
    sim = kd.Simulation(liquid(27, 1.5, seed=8), "leapfrog-exact", 0.004)
    start, first = sim.state, sim.method_state
    sim.run(until=0.4)
    sim.run(until=0.0)
    assert (sim.state.phase == start.phase).all()
    assert sim.method_state.same(first)


@pytest.mark.parametrize("name", ["dop853", "radau", "gauss-radau15", "implicit-midpoint"])
def test_the_past_of_a_problem_is_its_closed_form(name):
    """y' = cos(t) y, which depends on time: y = exp(sin t)."""
    problem = kd.Problem(lambda t, y: [np.cos(t) * y[0]], [1.0], jacobian=lambda t, y: [[np.cos(t)]])
    sim = kd.Simulation(problem, name, 1e-3 if integrator(name).needs_dt else None)
    sim.run(until=-1.5)
    assert sim.state.y[0] == pytest.approx(np.exp(np.sin(-1.5)), rel=1e-6)
    assert sim.state.time == pytest.approx(-1.5)


def test_forces_of_velocity_and_time_have_their_mirror_images():
    """A driven particle with drag: x'' = -x'/2 + cos(3 t + 0.4), solved in closed form."""
    rate, omega, phase = 0.5, 3.0, 0.4
    forces = [kd.LinearDrag(rate), kd.DrivenField((1.0, 0.0, 0.0), omega / (2 * np.pi), phase)]
    system = kd.System([[0.3, 0.0, 0.0]], [[0.7, 0.2, 0.0]], forces=forces, units="nbody")
    sim = kd.Simulation(system, "dop853", rtol=1e-12, atol=1e-12)
    sim.run(until=-2.0)

    def driven(t):
        """The velocity of the particular solution."""
        return (rate * np.cos(omega * t + phase) + omega * np.sin(omega * t + phase)) / (rate**2 + omega**2)

    free = 0.7 - driven(0.0)
    assert sim.state.velocities[0] == pytest.approx([free * np.exp(2 * rate) + driven(-2.0), 0.2 * np.exp(2 * rate), 0])


@pytest.mark.parametrize("name", ONCE_ONLY)
def test_other_methods_are_refused_by_name(name):
    sim = kd.Simulation(liquid(64, 2.0), name, 0.004, **needed(name)) if integrator(name).bath else planet(name)
    with pytest.raises(InputError, match=f"^run: {name} is neither reversible nor adaptive"):
        sim.run(until=-1.0)


def test_what_cannot_go_back_is_named():
    x, v = [[0.0, 0.0, 0.0], [1.0, 0.0, 0.0]], [[0.0, 0.0, 0.0], [0.0, 1.0, 0.0]]
    watched = kd.System(x, v, [1.0, 0.0], forces=[kd.Gravity()], units="nbody", events=[kd.CloseApproach(0.1)])
    with pytest.raises(InputError, match=r"^run: events are watched forwards in time only"):
        kd.Simulation(watched, dt=0.01).run(until=-1.0)

    class Wind(kd.LinearDrag):
        name = "wind"
        reversed = None

    windy = kd.System(x, v, [1.0, 0.0], forces=[kd.Gravity(), Wind(0.1)], units="nbody")
    with pytest.raises(InputError, match=r"^run: force 'wind' may depend on velocity and has no reversed"):
        kd.Simulation(windy, "dop853").run(until=-1.0)


@pytest.mark.parametrize(("name", "given"), [("velocity-verlet", {"every": 10}), ("dop853", {})])
def test_a_file_of_a_run_back_in_time(name, given, tmp_path):
    """Its times fall, a killed run is finished with the same bits, and the file takes no run forwards."""
    column = kd.Column("speed", "velocity", (), lambda sim: sim.state.velocities[1, 1])
    sim, path = planet(name), tmp_path / "back.h5md"
    sim.run(until=1.0)
    sim.run(until=-2.0, output=path, columns=[column], **given)
    with kd.open(path) as run:
        assert (np.diff(run.times) < 0).all()
        assert (np.diff(run.steps) > 0).all()
        assert (run.times[0], run.times[-1]) == (1.0, pytest.approx(-2.0))
        assert run[-1].velocities[1, 1] == run.observables["speed"][-1] == sim.state.velocities[1, 1]
        middle = int(run.steps[len(run) // 2])
    with pytest.raises(InputError, match="the run in this file goes back in time"):
        sim.run(until=0.0, output=path, columns=[column])
    again = kd.resume(path, step=middle)
    assert again.time < 1.0
    again.run(until=-2.0)
    assert (again.state.phase == sim.state.phase).all()


def test_a_killed_run_back_in_time_is_finished_in_its_file(tmp_path):
    class Killed(Exception):
        pass

    def stop(sim):
        if sim.steps_done == 150:
            raise Killed

    whole, killed, path = planet("velocity-verlet"), planet("velocity-verlet"), tmp_path / "back.h5md"
    for sim in (whole, killed):
        sim.run(100)
    whole.run(until=0.0, every=10)
    with pytest.raises(Killed):
        killed.run(until=0.0, every=10, output=path, observe=stop)
    resumed = kd.resume(path)
    assert resumed.time == 0.5
    resumed.run()
    assert (resumed.state.phase == whole.state.phase).all()
    with kd.open(path) as run:
        assert run.times == pytest.approx(np.linspace(1.0, 0.0, 11))


def test_a_run_forwards_after_one_back_keeps_its_bits():
    """Forwards again from a state is as a new run from this state."""
    sim = planet("velocity-verlet")
    sim.run(until=-0.5)
    other = planet("velocity-verlet")
    other.state = sim.state
    for each in (sim, other):
        each.run(until=0.5)
    assert (sim.state.phase == other.state.phase).all()
    assert sim.record.samples[0].time == -0.5

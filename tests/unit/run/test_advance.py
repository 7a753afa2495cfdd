"""Steps without a look (``Simulation.advance``), and methods with a state of their own."""

from __future__ import annotations

import numpy as np
import pytest

import kickdrift as kd
from kickdrift.errors import InputError, RunError
from tests.systems import liquid


def kepler(**more) -> kd.System:
    x, v = np.array([[0.0, 0.0, 0.0], [1.0, 0.0, 0.0]]), np.array([[0.0, 0.0, 0.0], [0.0, 1.0, 0.0]])
    return kd.System(x, v, masses=[1.0, 1e-3], forces=[kd.Gravity(G=1.0)], **more)


@pytest.mark.parametrize(("integrator", "dt"), [("velocity-verlet", 0.01), ("dop853", None)])
def test_steps_without_a_look_have_the_bits_of_a_run(integrator, dt):
    whole, mine = (kd.Simulation(kepler(), integrator, dt) for _ in range(2))
    whole.run(57)
    for steps in (1, 0, 16, 40):
        mine.advance(steps)
    assert mine.steps_done == whole.steps_done == 57
    assert mine.time == whole.time
    assert mine.state.phase.tobytes() == whole.state.phase.tobytes()
    assert len(mine.record.samples) == 0
    assert mine.report().steps == 57


def test_a_visit_is_paid_after_each_so_many_steps_and_can_end_them():
    sim, seen = kd.Simulation(kepler(), dt=0.01), []
    sim.advance(25, every=10, visit=lambda sim: seen.append(sim.steps_done))
    assert seen == [10, 20, 25]
    sim.advance(25, every=10, visit=lambda sim: sim.steps_done >= 45)
    assert sim.steps_done == 45
    sim.advance(5, visit=lambda sim: seen.append(sim.steps_done))
    assert seen[3:] == [50]


def test_it_goes_on_into_a_run_and_its_file(tmp_path):
    sim = kd.Simulation(kepler(), dt=0.01)
    sim.run(20, every=10, output=tmp_path / "a.h5md")
    sim.advance(20)
    sim.run(20, every=10, output=tmp_path / "a.h5md")
    whole = kd.Simulation(kepler(), dt=0.01)
    whole.run(60)
    with kd.open(tmp_path / "a.h5md") as run:
        assert run.steps.tolist() == [0, 10, 20, 40, 50, 60]
        np.testing.assert_array_equal(run[-1].positions, whole.state.positions)
    resumed = kd.resume(tmp_path / "a.h5md")
    resumed.advance(5)
    whole.run(5)
    assert resumed.state.phase.tobytes() == whole.state.phase.tobytes()


def test_an_event_ends_the_steps_and_the_next_call_goes_on():
    near = kd.Collision(radii=[0.0, 1.2], action="stop")
    x = np.array([[0.0, 0.0, 0.0], [3.0, 0.0, 0.0]])
    system = kd.System(x, [[0.0, 0.0, 0.0], [-1.0, 0.0, 0.0]], forces=[kd.Gravity(G=1e-9)], events=[near])
    sim = kd.Simulation(system, dt=0.1)
    sim.advance(1000)
    stopped = sim.steps_done
    assert stopped == pytest.approx(18, abs=1)
    assert "touch" in sim.stopped
    sim.advance(3)
    assert (sim.steps_done, sim.stopped) == (stopped + 3, "")


def test_a_blow_up_goes_back_to_the_last_look():
    sim = kd.Simulation(liquid(), dt=0.004)
    sim.run(3)
    good = sim.state
    sim.integration.stepper.dt *= 100
    with pytest.raises(RunError, match="the last good frame is step 3"):
        sim.advance(500)
    assert sim.state.phase.tobytes() == good.phase.tobytes()


def test_what_makes_no_sense_is_refused():
    sim = kd.Simulation(kepler(), dt=0.01)
    for steps in (-1, 1.5, None):
        with pytest.raises(InputError, match="steps"):
            sim.advance(steps)
    with pytest.raises(InputError, match="every"):
        sim.advance(5, every=0, visit=print)
    with pytest.raises(InputError, match="visit must be a function, got 7"):
        sim.advance(5, visit=7)
    with pytest.raises(InputError, match="already running"):
        sim.run(5, observe=lambda sim: sim.advance(1))
    problem = kd.Simulation(kd.Problem(lambda t, y: -y, [1.0]))
    for asked in (problem.forces, problem.accelerations):
        with pytest.raises(InputError, match=f"{asked.__name__}: a Problem has no {asked.__name__}"):
            asked()


def test_accelerations_are_forces_over_masses():
    sim = kd.Simulation(kepler(), dt=0.01)
    found = sim.accelerations()
    np.testing.assert_allclose(found, sim.forces() / np.array([[1.0], [1e-3]]), rtol=1e-15)
    np.testing.assert_allclose(found, [[1e-3, 0, 0], [-1, 0, 0]], atol=1e-15)


def test_the_old_name_of_a_methods_own_state_warns():
    sim = kd.Simulation(liquid(), "leapfrog-exact", dt=0.004)
    with pytest.warns(DeprecationWarning, match=r"lattice is deprecated since 0\.2; use Simulation\.method_state"):
        known = sim.lattice
    assert known.same(sim.method_state)
    sim.run(10)
    with pytest.warns(DeprecationWarning, match="method_state"):
        sim.lattice = known
    assert sim.method_state.same(known)
    assert sim.record.steps == 0


def test_short_calls_do_not_make_the_next_call_long():
    """An equilibration takes ten steps at a time. The run after it still hears Ctrl-C and shows its progress."""
    run = kd.Simulation(kd.load("two-body")).integration
    for _ in range(20):
        run.pace(10, 0.01)
    assert run.chunk == 100
    run.pace(100, 0.001)
    assert run.chunk == 800

"""The System at present, its bodies by name, and what is of the start."""

import pickle

import numpy as np
import pytest

import kickdrift as kd
from kickdrift.errors import InputError
from kickdrift.trajectory.read.frames import FrameSystem
from tests.systems import circling, liquid


def test_a_body_by_name_is_the_body_now():
    sim = kd.Simulation(circling("Io", "Callisto"), dt=0.01)
    sim.run(100)
    assert sim["Callisto"].position.tolist() == sim[1].position.tolist() == sim.state.positions[1].tolist()
    assert sim["Callisto"].velocity.tolist() == sim.state.velocities[1].tolist()
    assert sim["Io"].elements("Callisto").a == pytest.approx(1.0, abs=1e-4)
    assert [body.name for body in sim] == ["Io", "Callisto"]
    assert sim.system["Callisto"].position.tolist() == [-0.5, 0.0, 0.0]
    assert repr(sim.system) == "<System system: 2 particles at time 0>"
    assert repr(sim.now()) == "<System system: 2 particles at time 1>"
    with pytest.raises(InputError, match="did you mean 'Callisto'"):
        sim["Calisto"]


def test_a_run_goes_on_from_the_present_system():
    """The first energy is that of the last look, but for the order of its sum; nothing of the start stays."""
    system = kd.load("lj-1000-switch")
    assert system.invariants
    nvt = kd.Simulation(system, "csvr", temperature=1.0, tau=0.1)
    nvt.run(20)
    now = nvt.now()
    assert (now.state.time, now.state.steps_done, now.equilibration, dict(now.invariants)) == (nvt.time, 0, None, {})
    nve = kd.Simulation(now, "velocity-verlet")
    assert nve.energy().kinetic == nvt.energy().kinetic
    assert nve.energy().potential == pytest.approx(nvt.energy().potential, rel=1e-14)
    nve.run(3)
    assert nve.time == pytest.approx(nvt.time + 3 * nve.dt)
    assert (now.state.phase == nvt.state.phase).all()


def test_runs_in_a_chain_have_different_noise():
    """With the noise of the start again, a chain of equilibrations ended too hot or too cold at every temperature."""
    sim = kd.Simulation(liquid(), "baoab", dt=0.002, temperature=1.0, friction=1.0)
    assert sim.now().seed == liquid().seed
    sim.run(10)
    one = sim.now()
    sim.run(10)
    assert len({one.seed, sim.now().seed, liquid().seed}) == 3


def test_the_box_of_now():
    pressed = {"temperature": 1.0, "tau": 0.5, "pressure": 1.0, "pressure_tau": 0.1, "compressibility": 0.1}
    sim = kd.Simulation(liquid(), "csvr", dt=0.002, **pressed)
    sim.run(50)
    assert sim.now().box == sim.state.box != sim.system.box


def test_bodies_that_merged_are_gone():
    x, v = [[0.5, 0.0, 0.0], [-0.5, 0.0, 0.0], [9.0, 0.0, 0.0]], [[-1.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.1, 0.0]]
    system = kd.System(
        x,
        v,
        [0.5, 0.5, 0.1],
        forces=[kd.Gravity()],
        units="nbody",
        names=["A", "B", "C"],
        radii=0.1,
        events=[kd.Collision(action="merge")],
    )
    sim = kd.Simulation(system, dt=0.01)
    sim.run(until=1.0)
    assert [body.name for body in sim] == ["A", "C"]
    assert sim["A"].mass == 1.0
    assert sim["C"].id == 2


def test_a_problem_has_no_bodies():
    sim = kd.Simulation(kd.load("ode-kepler"))
    for ask in (sim.now, lambda: sim["x"]):
        with pytest.raises(InputError, match="now: a Problem has no bodies"):
            ask()


def test_the_system_of_a_frame_is_a_property_and_the_call_warns(tmp_path):
    sim = kd.Simulation(circling("Io", "Callisto"), dt=0.01)
    sim.run(10, every=5, output=tmp_path / "run.h5md")
    with kd.open(tmp_path / "run.h5md") as run:
        system = run[-1].system
        assert (system.state.phase == sim.state.phase).all()
        with pytest.warns(DeprecationWarning, match=r"frame\.system\(\) is deprecated since 0\.3; use frame\.system"):
            assert run[-1].system().state.time == system.state.time
    assert system["Callisto"].position.tolist() == sim["Callisto"].position.tolist()
    again = pickle.loads(pickle.dumps(system))
    assert isinstance(again, FrameSystem)
    np.testing.assert_array_equal(again.state.phase, system.state.phase)
    assert kd.Simulation(system, dt=0.01).energy() == sim.energy()

"""A Simulation: its state, its arguments, its report, and its failures."""

from __future__ import annotations

import math
import os
import re
import signal
import threading

import numpy as np
import pytest

import kickdrift as kd
from kickdrift.errors import InputError, RunError
from kickdrift.looks.record import Record, even_stretch
from kickdrift.model.run_defaults import RunDefaults
from kickdrift.model.state import State
from tests.oracle.forces import pair_oracle

DT = 0.004
EDGE = (216 / 0.8442) ** (1 / 3)


def liquid(count=216, temperature=1.0, seed=1, density=0.8442, run=None, **force) -> kd.System:
    """Lennard-Jones particles near the sites of a simple cubic lattice."""
    rng = np.random.default_rng(seed)
    edge = round(count ** (1 / 3))
    length = (count / density) ** (1 / 3)
    x = (np.indices((edge,) * 3).reshape(3, -1).T + rng.uniform(0.4, 0.6, (count, 3))) * length / edge
    v = rng.normal(size=(count, 3))
    v -= v.mean(axis=0)
    v *= math.sqrt(temperature * (3 * count - 3) / (v**2).sum())
    forces = [kd.LennardJones(**{"truncation": "switch", **force})]
    return kd.System(x, v, box=(length,) * 3, forces=forces, run=run, name="liquid", seed=seed)


def two_bodies() -> kd.System:
    x, v = [[-0.25, 0.0, 0.0], [0.25, 0.0, 0.0]], [[0.0, -(0.75**0.5), 0.0], [0.0, 0.75**0.5, 0.0]]
    return kd.System(x, v, masses=0.5, forces=[kd.Gravity()], units="nbody", name="two-body")


def bits(sim: kd.Simulation) -> bytes:
    return sim.state.phase.tobytes()


# --- the state ---


def test_state_is_a_copy():
    sim = kd.Simulation(liquid(), dt=DT)
    before = bits(sim)
    sim.state.phase[:] = 7.0
    sim.state.masses[:] = 7.0
    assert bits(sim) == before
    assert np.all(sim.state.masses == 1.0)


def test_a_simulation_without_dt_gives_energy_forces_and_pressure():
    stepping, still = kd.Simulation(liquid(), dt=DT), kd.Simulation(liquid())
    assert still.dt is None
    assert still.energy() == stepping.energy()
    assert still.pressure() == stepping.sample().pressure
    assert still.forces().tobytes() == stepping.forces().tobytes()
    assert still.minimize(steps=20).energy == stepping.minimize(steps=20).energy


def test_arrays_shown_are_read_only():
    sim = kd.Simulation(liquid(), dt=DT)
    for array in (sim.state.positions, sim.state.velocities, sim.state.wrapped(), sim.forces()):
        assert array.shape == (216, 3)
        with pytest.raises(ValueError, match="read-only"):
            array[0, 0] = 1.0


def test_a_simulation_does_not_change_its_system():
    system = liquid()
    before = system.state.phase.copy()
    sim = kd.Simulation(system, dt=DT)
    sim.run(10)
    np.testing.assert_array_equal(system.state.phase, before)
    assert system.state.steps_done == 0
    system.state.phase[:] = 0.0  # the reverse also holds
    assert np.isfinite(sim.energy().total)


def test_positions_are_unwrapped_and_wrapped_on_demand():
    system = kd.System(
        [[0.5, 0.5, 0.5]], [[1.0, 0.0, -2.0]], box=(5, 5, 5), forces=[kd.LennardJones(truncation="switch")]
    )
    sim = kd.Simulation(system, dt=0.01)
    sim.run(1000)
    np.testing.assert_allclose(sim.state.positions, [[10.5, 0.5, -19.5]], atol=1e-11)
    np.testing.assert_allclose(sim.state.wrapped(), [[0.5, 0.5, 0.5]], atol=1e-11)


def test_setting_the_state_goes_on_from_there():
    first, second = (kd.Simulation(liquid(), dt=DT) for _ in range(2))
    first.run(50)
    second.state = first.state
    assert (second.steps_done, second.time) == (50, first.time)
    state = first.state
    first.state = state  # its pair lists start again, too
    state.phase[:] = 0.0  # the run uses a copy
    for sim in (first, second):
        sim.run(50)
    assert bits(first) == bits(second)
    report = second.report()
    assert (report.steps, second.steps_done) == (50, 100)  # conservation counts from the assigned state


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda s: State(s.phase[:, :, :5], s.masses[:5], s.ids[:5], s.box), "expected 216 particles, got 5"),
        (lambda s: State(s.phase * np.nan, s.masses, s.ids, s.box), "must be finite"),
        (lambda s: State(s.phase, s.masses * 2, s.ids, s.box), "ids and masses must equal the system's"),
        (lambda s: State(s.phase, s.masses, s.ids[::-1], s.box), "ids and masses must equal the system's"),
        (lambda s: State(s.phase, s.masses, s.ids, kd.Box(None)), "the box is None"),
    ],
)
def test_a_state_of_something_else_is_refused(change, message):
    sim = kd.Simulation(liquid(), dt=DT)
    before = bits(sim)
    with pytest.raises(InputError, match=message):
        sim.state = change(sim.state)
    assert bits(sim) == before


# --- time and steps ---


def test_time_and_steps():
    sim = kd.Simulation(two_bodies(), dt=0.1)
    assert (sim.time, sim.steps_done, sim.state.time, sim.state.steps_done) == (0.0, 0, 0.0, 0)
    sim.run(10)
    sim.run(until=2.5)
    assert sim.steps_done == sim.state.steps_done == 25
    assert sim.time == sim.state.time == 2.5
    sim.run(until=2.5)  # no step to take
    sim.run(0)
    assert sim.steps_done == 25
    sim.run(10**5)
    assert sim.time == 0.1 * (10**5 + 25)  # not a sum of steps, which would drift


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({}, "give either steps or until"),
        ({"steps": 1, "until": 2.0}, "give either steps or until"),
        ({"steps": -1}, "steps must be a whole number, zero or more, got -1"),
        ({"steps": 1.5}, "steps must be a whole number, zero or more, got 1.5"),
        ({"steps": math.nan}, "steps must be a whole number, zero or more, got nan"),
        ({"steps": math.inf}, "steps must be a whole number, zero or more, got inf"),
        ({"steps": "10"}, "steps must be a whole number, zero or more, got '10'"),
        ({"until": 1.53, "exact": True}, "time 1.53 is not on the grid of steps of 0.1; nearest are 1.5 and 1.6"),
        ({"until": 1.01, "exact": True}, "nearest are 1 and 1.1"),
        ({"until": 0.93, "exact": True}, "nearest are 0.9 and 1"),
        ({"until": 2.0, "exact": "yes"}, "exact must be True, False or \"shorten\", got 'yes'"),
        ({"until": "2 s", "exact": True}, "until: nbody quantities are plain numbers, got '2 s'"),
        ({"until": -math.inf}, "must be a finite time, got -inf"),
        ({"until": math.nan}, "must be a finite time, got nan"),
        ({"until": "1"}, "must be a finite time, got '1'"),
        ({"steps": 1, "every": 0}, "every must be a whole number, one or more, got 0"),
        ({"steps": 1, "every": 2.5}, "every must be a whole number, one or more, got 2.5"),
    ],
)
def test_bad_arguments_of_run(arguments, message):
    sim = kd.Simulation(two_bodies(), dt=0.1)
    sim.run(10)
    with pytest.raises(InputError, match=re.escape(message)):
        sim.run(**arguments)
    assert sim.steps_done == 10


@pytest.mark.parametrize("dt", [0, -0.1, math.nan, math.inf, "fast", [0.1]])
def test_bad_steps(dt):
    with pytest.raises(InputError, match="dt must be a positive finite time"):
        kd.Simulation(two_bodies(), dt=dt)


def test_dt_integrator_and_cadence_come_from_the_file_unless_given():
    with pytest.raises(InputError, match="dt is needed: system 'two-body' has no dt"):
        kd.Simulation(two_bodies()).run(1)
    system = liquid(run=RunDefaults("leapfrog-dkd", 0.003, every=7))
    sim = kd.Simulation(system)
    assert (sim.dt, sim.integrator) == (0.003, "leapfrog-dkd")
    sim.run(21)
    assert [sample.step for sample in sim.record.samples] == [0, 7, 14, 21]
    assert kd.Simulation(system, "rk4", 0.001).dt == 0.001


def test_energy_and_forces_are_those_of_the_oracle():
    sim = kd.Simulation(liquid(), dt=DT)
    sim.run(100)
    there = kd.System(sim.state.positions, box=sim.system.box, forces=sim.system.forces)
    forces, potential, virial, pairs = pair_oracle(there)
    kinetic = 0.5 * (sim.state.velocities**2).sum()
    assert sim.energy() == pytest.approx((kinetic, potential, kinetic + potential), rel=1e-13)
    assert sim.energy().total == sim.energy().kinetic + sim.energy().potential
    np.testing.assert_allclose(sim.forces(), forces, atol=1e-12 * np.abs(forces).max())
    sample = sim.sample()
    assert sample.pairs == pairs
    assert sample.temperature == pytest.approx(2 * kinetic / (3 * 216 - 3), rel=1e-13)
    assert sample.pressure == pytest.approx((2 * kinetic + virial) / (3 * EDGE**3), rel=1e-12)


def test_two_bodies_have_the_closed_forms_energy():
    sim = kd.Simulation(two_bodies(), dt=0.01)
    assert sim.energy() == pytest.approx((0.375, -0.5, -0.125), rel=1e-15)
    np.testing.assert_allclose(sim.forces(), [[1.0, 0.0, 0.0], [-1.0, 0.0, 0.0]], atol=1e-15)
    sample = sim.sample()
    assert math.isnan(sample.temperature)
    assert math.isnan(sample.pressure)
    np.testing.assert_allclose(sample.angular_momentum, [0.0, 0.0, 0.25 * 0.75**0.5], rtol=1e-15)


# --- equilibration ---


def test_equilibrate_reaches_the_temperature_and_starts_anew():
    wanted = 1.1
    sim = kd.Simulation(liquid(count=512, temperature=2.0), dt=DT)
    sim.run(20)
    compiled = sim.record.compile_seconds
    seen = []
    sim.equilibrate(temperature=wanted, time=8.0, progress=lambda done, of: seen.append((done, of)))
    assert (sim.time, sim.steps_done) == (0.0, 0)
    assert sim.record == Record(compile_seconds=compiled, equilibrated="at 1.1 ε/k_B in 8 τ by rescaled velocities")
    assert seen[-1] == (2000, 2000)
    report = sim.run(4000, every=10)
    # The mean over 16 time units has a standard error of 0.004, from ten nearly independent blocks.
    temperatures = np.array([sample.temperature for sample in sim.record.samples])
    blocks = np.array([block.mean() for block in np.array_split(temperatures, 10)])
    error = blocks.std(ddof=1) / math.sqrt(10)
    assert error < 0.01
    assert report.temperature == pytest.approx(wanted, abs=0.03)
    assert (report.steps, report.samples) == (4000, 401)
    assert report.energy.max_relative_error < 1e-3
    assert report.momentum_error < 1e-13


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"temperature": 0.0, "time": 1.0}, "temperature must be positive, got 0"),
        ({"temperature": math.nan, "time": 1.0}, "temperature must be positive, got nan"),
        ({"temperature": 1.0, "time": -1.0}, "time must be positive, got -1"),
        ({"temperature": 1.0, "time": math.inf}, "time must be positive, got inf"),
        ({"temperature": 1.0, "time": 1.0, "interval": 0}, "interval must be a whole number, one or more, got 0"),
    ],
)
def test_bad_arguments_of_equilibrate(arguments, message):
    with pytest.raises(InputError, match=message):
        kd.Simulation(liquid(), dt=DT).equilibrate(**arguments)


def test_what_cannot_be_equilibrated():
    resting = kd.System(liquid().state.positions, box=(EDGE,) * 3, forces=[kd.LennardJones(truncation="switch")])
    with pytest.raises(InputError, match="all velocities are zero"):
        kd.Simulation(resting, dt=DT).equilibrate(1.0, 1.0)
    alone = kd.System([[0.0, 0.0, 0.0]], [[1.0, 0.0, 0.0]], forces=[kd.Gravity()], units="nbody")
    with pytest.raises(InputError, match="one particle has no temperature"):
        kd.Simulation(alone, dt=DT).equilibrate(1.0, 1.0)


# --- failures ---


def closing_in() -> kd.System:
    """Particle 2 flies at particle 5, so fast that it reaches its core after a few steps."""
    x = [[9.0, 9.0, 9.0], [20.0, 0.0, 0.0], [0.0, 0.0, 0.0], [9.0, -9.0, 0.0], [-20.0, 3.0, 0.0], [5.0, 0.0, 0.0]]
    v = np.zeros((6, 3))
    v[2, 0] = 20.0
    return kd.System(x, v, forces=[kd.LennardJones(truncation="switch")], name="closing-in")


def test_blow_up_names_step_particle_neighbour_and_frame(tmp_path):
    path = tmp_path / "run.h5md"
    sim = kd.Simulation(closing_in(), dt=0.0497)
    with pytest.raises(RunError) as caught:
        sim.run(100, every=2, output=path)
    message = str(caught.value)
    assert "\n" not in message
    found = re.fullmatch(
        r"velocity-verlet, dt = 0\.0497: blew up at step (\d+) \(t = ([\d.]+)\): particle (\d) moves at \S+ σ/τ, "
        r"its nearest neighbour was (\d) at (\S+) σ the step before; the last good frame is step (\d+)",
        message,
    )
    assert found, message
    step, time, particle, neighbour, distance, last = found.groups()
    assert {int(particle), int(neighbour)} == {2, 5}
    assert float(distance) < 0.9
    assert int(step) in (5, 6, 7)
    assert int(last) == (int(step) - 1) // 2 * 2
    assert float(time) == pytest.approx(int(step) * 0.0497)
    # The state went back to the last good frame; the file is whole and ends with that frame.
    assert sim.steps_done == int(last)
    with kd.open(path) as run:
        assert [frame.step for frame in run] == list(range(0, int(last) + 1, 2))
        np.testing.assert_array_equal(run[-1].positions, sim.state.positions)
    report = sim.report()
    assert report.steps == sim.steps_done
    # A run with shorter steps continues from this state.
    careful = kd.Simulation(closing_in(), dt=0.0005)
    careful.state = sim.state
    careful.run(500)


@pytest.mark.parametrize("name", ["euler", "rk4", "leapfrog-dkd", "yoshida8"])
@pytest.mark.parametrize("dt", [0.5, 1e10, 1e300])
def test_blow_up_of_any_size_is_one_clear_error(name, dt):
    sim = kd.Simulation(liquid(), name, dt=dt)
    before = bits(sim)
    with pytest.raises(
        RunError, match=r"blew up at step \d+ \(t = .*\): particle \d+ .*; the last good frame is step 0"
    ):
        sim.run(1000, every=1000)
    assert bits(sim) == before
    assert (sim.steps_done, sim.time, sim.report().steps) == (0, 0.0, 0)


def test_blow_up_inside_a_runge_kutta_step_blames_the_stage():
    sim = kd.Simulation(liquid(), "rk4", dt=0.5)
    fastest = np.linalg.norm(sim.state.velocities, axis=1).max()
    with pytest.raises(RunError) as caught:
        sim.run(10)
    speed = float(re.search(r"moves at (\S+) σ", str(caught.value))[1])
    assert speed > 10 * fastest


def test_blow_up_while_equilibrating():
    sim = kd.Simulation(liquid(), dt=0.5)
    before = bits(sim)
    with pytest.raises(RunError, match="blew up at step"):
        sim.equilibrate(1.0, 100.0)
    assert sim.steps_done == 0
    assert bits(sim) == before


def interrupt_soon(seconds: float) -> threading.Timer:
    timer = threading.Timer(seconds, os.kill, (os.getpid(), signal.SIGINT))
    timer.start()
    return timer


def test_ctrl_c_ends_a_run_cleanly(tmp_path):
    path = tmp_path / "run.h5md"
    sim = kd.Simulation(liquid(), dt=DT)
    sim.run(10)
    handler = signal.getsignal(signal.SIGINT)
    timer = interrupt_soon(0.5)
    with pytest.raises(KeyboardInterrupt):
        sim.run(10**7, every=50, output=path)
    timer.join()
    assert signal.getsignal(signal.SIGINT) is handler
    assert 10 < sim.steps_done < 10**7
    assert sim.state.time == sim.steps_done * DT
    with kd.open(path) as run:
        assert run[-1].step == sim.steps_done
        np.testing.assert_array_equal(run[-1].positions, sim.state.positions)
    sim.run(10)  # the run can continue


def test_ctrl_c_while_equilibrating():
    sim = kd.Simulation(liquid(), dt=DT)
    sim.run(1)
    timer = interrupt_soon(0.3)
    with pytest.raises(KeyboardInterrupt):
        sim.equilibrate(1.0, 1e6)
    timer.join()
    sim.run(10)


# --- observers ---


def test_observers_see_each_sample():
    sim = kd.Simulation(two_bodies(), dt=0.1)
    seen = []
    sim.run(10, every=4, observe=lambda s: seen.append((s.steps_done, s.time, s.energy().total)))
    assert [step for step, _, _ in seen] == [0, 4, 8, 10]  # every 4 steps from step 0, and at the start and the end
    assert [time for _, time, _ in seen] == [0.0, 0.4, 0.8, 1.0]
    sim.run(3, observe=lambda s: seen.append((s.steps_done,)))
    assert [entry[0] for entry in seen[4:]] == [10, 11, 12, 13]  # the cadence was for that run only


def test_observers_cannot_change_the_run():
    whole, watched = (kd.Simulation(two_bodies(), dt=0.1) for _ in range(2))
    whole.run(20)

    def meddle(sim):
        with pytest.raises(ValueError, match="read-only"):
            sim.state.positions[0] = 0.0
        sim.state.phase[:] = 0.0  # a copy
        with pytest.raises(InputError, match="read-only while the Simulation runs"):
            sim.state = sim.state
        with pytest.raises(InputError, match="already running"):
            sim.run(1)
        with pytest.raises(InputError, match="already running"):
            sim.equilibrate(1.0, 1.0)

    watched.run(20, every=5, observe=meddle)
    assert bits(watched) == bits(whole)


def test_an_observers_error_passes_and_leaves_a_whole_file(tmp_path):
    def fail(sim):
        if sim.steps_done == 10:
            raise LookupError("enough")

    sim = kd.Simulation(two_bodies(), dt=0.1)
    with pytest.raises(LookupError, match="enough"):
        sim.run(100, every=5, output=tmp_path / "run.h5md", observe=fail)
    with kd.open(tmp_path / "run.h5md") as run:
        assert [frame.step for frame in run] == [0, 5, 10]
    sim.run(10)
    assert sim.steps_done == 20


def test_progress_reaches_the_end():
    seen = []
    kd.Simulation(two_bodies(), dt=0.1).run(50, every=10, progress=lambda done, of: seen.append((done, of)))
    assert seen[-1] == (50, 50)
    assert [done for done, _ in seen] == sorted(done for done, _ in seen)


def test_the_same_simulation_appends_and_no_other(tmp_path):
    path = tmp_path / "run.h5md"
    sim = kd.Simulation(two_bodies(), dt=0.1)
    sim.run(10, output=path, every=5)
    sim.run(10, output=path)
    with kd.open(path) as run:
        assert [frame.step for frame in run] == [0, 5, 10, 15, 20]
    before = path.read_bytes()
    other = kd.Simulation(two_bodies(), dt=0.1)
    with pytest.raises(InputError, match=r"run\.h5md: exists already"):
        other.run(10, output=path)
    assert path.read_bytes() == before
    other.run(10, output=path, every=10, overwrite=True)
    with pytest.raises(InputError, match="belongs to another run"):
        sim.run(10, output=path)
    with kd.open(path) as run:
        assert [frame.step for frame in run] == [0, 10]


# --- the report ---


def test_report_of_a_liquid():
    sim = kd.Simulation(liquid(), dt=DT)
    report = sim.run(500, every=5)
    samples = sim.record.samples
    total = np.array([s.energies.total for s in samples])
    assert (report.system, report.engine, report.integrator) == ("liquid", "native", "velocity-verlet")
    assert (report.particles, report.units, report.dt, report.seed, report.threads) == (216, "lj", DT, 1, 1)
    assert (report.steps, report.time, report.samples) == (500, 500 * DT, 101)
    assert 501 <= report.force_evaluations <= 505  # includes evaluations repeated after a list was full
    assert report.steps_per_second == pytest.approx(500 / report.wall_seconds)
    e = report.energy
    assert (e.initial, e.final, e.relative_to) == (total[0], total[-1], "initial energy")
    scale = abs(total[0])
    assert e.max_relative_error == pytest.approx(np.abs(total - total[0]).max() / scale, rel=1e-12)
    assert e.rms_relative_error == pytest.approx(np.sqrt(np.mean((total - total[0]) ** 2)) / scale, rel=1e-12)
    assert e.verdict in ("bounded", "secular drift", "random walk", "round-off", "not resolvable")
    assert report.momentum_error < 1e-14
    assert report.angular_momentum_error is None
    assert report.temperature == pytest.approx(np.mean([s.temperature for s in samples]), rel=1e-12)
    assert report.pressure == pytest.approx(np.mean([s.pressure for s in samples]), rel=1e-12)
    assert 0.1 < report.ns_per_pair < 1e4


def test_report_of_two_bodies():
    sim = kd.Simulation(two_bodies(), dt=0.001)
    report = sim.run(6283, every=100)
    assert report.temperature is None
    assert report.pressure is None
    assert report.angular_momentum_error < 1e-13
    assert report.momentum_error < 1e-14
    assert report.energy.max_relative_error < 1e-4


def test_a_report_needs_no_run():
    report = kd.Simulation(two_bodies(), dt=0.1).report()
    assert (report.steps, report.samples, report.energy.max_relative_error) == (0, 1, 0.0)
    assert report.energy.verdict == "not resolvable"


def test_drift_is_taken_over_samples_an_even_number_of_steps_apart():
    sim = kd.Simulation(two_bodies(), dt=0.01)
    sim.run(15, every=10)
    sim.run(500, every=5)
    steps = sim.record.series().steps
    steps = steps[even_stretch(steps)].tolist()
    assert steps == list(range(10, 516, 5))


def test_no_forces_at_all():
    sim = kd.Simulation(kd.System([[0.0, 0.0, 0.0]], [[1.0, 2.0, 3.0]]), dt=0.5)
    sim.run(4)
    np.testing.assert_array_equal(sim.state.positions, [[2.0, 4.0, 6.0]])
    assert sim.energy() == (7.0, 0.0, 7.0)

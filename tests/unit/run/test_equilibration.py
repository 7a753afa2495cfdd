"""Equilibration: ramps of temperature, lengths in steps and time, baths of the equilibration alone, and refusals."""

from __future__ import annotations

import numpy as np
import pytest

import kickdrift as kd
from kickdrift.errors import InputError
from kickdrift.model.run_defaults import Equilibration
from kickdrift.run.equilibration import equilibrate_as_told
from kickdrift.systemfile.reading import load
from tests.systems import liquid

BATHS = {
    "baoab": {"friction": 20.0}, "csvr": {"tau": 0.05}, "andersen": {"collision_rate": 20.0},
    "nose-hoover": {"tau": 0.1}, "velocity-verlet": {},
}  # fmt: skip


def gas(count=1500, temperature=2.0) -> kd.System:
    """An ideal gas, whose temperature is the bath's alone."""
    rng = np.random.default_rng(4)
    system = kd.System(rng.uniform(0, 20, (count, 3)), box=(20.0,) * 3).with_run(dt=0.01)
    return system.with_velocities(temperature=temperature, seed=5)


def melt() -> kd.System:
    return liquid(cutoff=1.6).with_run(dt=0.004)


def temperature(sim) -> float:
    return float(2 * sim.energy().kinetic / sim.system.degrees_of_freedom)


@pytest.mark.parametrize("name", BATHS)
def test_a_ramp_is_linear_in_time(name):
    options = BATHS[name] and {"temperature": 1.0, **BATHS[name]}
    sim, seen = kd.Simulation(gas(), name, **options), []

    def look(done, of):
        seen.append((done / of, temperature(sim)))

    sim.equilibrate(2.0, to=1.0, steps=2000, interval=5, progress=look)
    done, found = np.array(seen).T
    assert len(seen) >= 200
    assert done[-1] == 1.0
    expected = 2.0 - done
    spread = 0.12 if name == "nose-hoover" else 4 * np.sqrt(2 / 4500) + 0.06  # the chain lags and swings
    assert np.abs(found / expected - 1)[10:].max() < spread
    slope = np.polyfit(done, found, 1)[0]
    assert slope == pytest.approx(-1.0, abs=0.06)
    assert (sim.steps_done, sim.time) == (0, 0.0)
    if name == "velocity-verlet":
        assert temperature(sim) == pytest.approx(1.0, rel=1e-12)


def test_a_ramp_has_the_same_bits_whoever_looks():
    ends = []
    for progress in (None, lambda done, of: None):
        sim = kd.Simulation(melt(), "baoab", temperature=1.0, friction=1.0)
        sim.equilibrate(2.0, to=1.0, time=0.3, progress=progress)
        sim.run(20)
        ends.append(sim.state.phase)
    np.testing.assert_array_equal(*ends)
    flat = kd.Simulation(melt(), "baoab", temperature=1.0, friction=1.0)
    flat.equilibrate(1.0, time=0.3)
    same = kd.Simulation(melt(), "baoab", temperature=1.0, friction=1.0)
    same.equilibrate(1.0, to=1.0, steps=75)
    np.testing.assert_array_equal(flat.state.phase, same.state.phase)


def test_a_ramp_leaves_the_baths_own_temperature():
    sim = kd.Simulation(gas(), "baoab", temperature=1.0, friction=20.0)
    sim.equilibrate(4.0, to=1.0, steps=200)
    start = sim.state
    sim.run(50)
    other = kd.Simulation(gas(), "baoab", temperature=1.0, friction=20.0)
    other.state = start
    other.run(50)
    np.testing.assert_array_equal(sim.state.phase, other.state.phase)


def test_a_bath_of_the_equilibration_alone():
    """Velocity Verlet goes on from a Langevin bath, without the total momentum that the bath has left."""
    sim = kd.Simulation(gas(temperature=5.0))
    sim.equilibrate(1.0, steps=300, integrator="baoab", friction=20.0)
    assert temperature(sim) == pytest.approx(1.0, abs=5 * np.sqrt(2 / 4500))
    np.testing.assert_allclose(sim.state.masses @ sim.state.velocities, 0.0, atol=1e-10)
    assert sim.integrator == "velocity-verlet"
    own = kd.Simulation(gas(temperature=5.0), "baoab", temperature=1.0, friction=0.01)
    own.equilibrate(1.0, steps=300, friction=20.0)  # the run's bath with another friction
    assert temperature(own) == pytest.approx(1.0, abs=5 * np.sqrt(2 / 4500))
    assert own.options.friction == 0.01
    loud = kd.Simulation(gas(), "csvr", temperature=1.0, tau=0.5)
    loud.equilibrate(1.0, steps=20, integrator="baoab", friction=80.0)
    assert any(line.startswith("equilibrate: friction = 80 times dt") for line in loud.run(1).warnings)


def test_a_run_takes_a_time():
    one, two, three = (kd.Simulation(melt()) for _ in range(3))
    one.run(50)
    two.run(time=0.2)
    for _ in range(2):
        three.run(time=0.1)
    for other in (two, three):
        assert other.steps_done == 50
        np.testing.assert_array_equal(one.state.phase, other.state.phase)
    two.run(time=-0.2)
    assert two.time == pytest.approx(0.0, abs=1e-12)


FILE = """
units = "lj"
[particles]
lattice = "sc"
count = 64
density = 0.8
[velocities]
temperature = 2.0
seed = 1
[[force]]
type = "lennard-jones"
cutoff = 1.6
truncation = "shift"
[run]
dt = 0.004
steps = 10
"""


def written(tmp_path, text):
    path = tmp_path / "liquid.toml"
    path.write_text(FILE + text)
    return path


def test_a_file_says_how_to_equilibrate(tmp_path):
    table = '[equilibrate]\ntemperature = 2.0\nto = 1.0\nsteps = 100\nintegrator = "csvr"\ntau = 0.1\n'
    system = load(written(tmp_path, table))
    wanted = system.equilibration
    assert wanted == Equilibration(2.0, None, 10, 1.0, 100, "csvr", {"tau": 0.1})
    (tmp_path / "again.toml").write_text(system.to_toml())
    assert load(tmp_path / "again.toml").equilibration == wanted
    sim, other = kd.Simulation(system), kd.Simulation(system)
    sim.equilibrate(**wanted.said())
    other.equilibrate(2.0, to=1.0, steps=100, integrator="csvr", tau=0.1)
    np.testing.assert_array_equal(sim.state.phase, other.state.phase)
    sim.run(4, output=tmp_path / "run.h5md")
    with kd.open(tmp_path / "run.h5md") as run:
        assert run.system().equilibration == wanted
    assert "to = 1.0" in str(system)


@pytest.mark.parametrize(
    ("table", "message"),
    [
        ("[equilibrate]\nsteps = 2\n", "equilibrate.temperature: is missing, and .run. has no heat bath with a"),
        ("[equilibrate]\ntemperature = 1.0\n", "equilibrate: expected time or steps, got neither"),
        ("[equilibrate]\ntemperature = 1.0\ntime = 1\nsteps = 2\n", "equilibrate: expected time or steps, got both"),
        ("[equilibrate]\ntemperature = 1.0\nsteps = 2\nt0 = 2.0\n", "equilibrate.t0: unknown key"),
        ("[equilibrate]\ntemperature = 1.0\nsteps = 2\nto = -1.0\n", "equilibrate.to: expected a non-negative temp"),
        ('integrator = "baoab"\ntemperature = 1\ntau = 0.1\n', "run.tau: baoab does not take it; .* has one heat bath"),
        ('integrator = "velocity-verlet"\nfriction = 1\n', "run.friction: velocity-verlet does not take it"),
    ],
)
def test_tables_that_make_no_sense_are_refused(tmp_path, table, message):
    with pytest.raises(InputError, match=message):
        load(written(tmp_path, table))


BATH = {"temperature": 1.0, "friction": 1.0}


def test_an_equilibration_by_the_file_ends_at_the_temperature_of_the_runs_bath(tmp_path):
    bath = 'integrator = "baoab"\ntemperature = 1.5\nfriction = 1.0\n[equilibrate]\nsteps = 20\n'
    system = load(written(tmp_path, bath))
    assert system.equilibration == Equilibration(1.5, None, 10, None, 20)
    own, hot, ramp = kd.Simulation(system), kd.Simulation(system, temperature=2.5), kd.Simulation(system)
    for sim in (own, hot):
        equilibrate_as_told(sim)
    assert own.report().equilibrated == "at 1.5 ε/k_B in 20 steps by baoab"
    assert hot.report().equilibrated == "at 2.5 ε/k_B in 20 steps by baoab"
    assert hot.system.equilibration == Equilibration(2.5, None, 10, None, 20)
    other = kd.Simulation(system, temperature=2.5)
    other.equilibrate(2.5, steps=20)
    np.testing.assert_array_equal(hot.state.phase, other.state.phase)
    ramp.equilibrate(0.5, 0.08, to=1.5)
    assert ramp.report().equilibrated == "from 0.5 to 1.5 ε/k_B in 0.08 τ by baoab"
    assert own.run(5).equilibrated.endswith("by baoab")
    own.state = own.state
    assert own.report().equilibrated == ""
    with pytest.raises(InputError, match=r"temperature = 1.5 is not the heat bath's temperature = 2.5"):
        equilibrate_as_told(kd.Simulation(system, temperature=2.5), exactly=True)


@pytest.mark.parametrize(
    ("name", "options", "arguments", "message"),
    [
        ("baoab", BATH, {"temperature": 2.0, "steps": 9}, "2 is not the heat bath's temperature = 1; .* with to = 1"),
        ("baoab", BATH, {"temperature": 1.0, "to": 2.0, "steps": 9}, "2 is not the heat bath's temperature = 1"),
        (
            "baoab", BATH, {"temperature": 2.0, "steps": 9, "integrator": "csvr", "tau": 1.0},
            "two heat baths: csvr ends at 2, and the run's baoab is at 1; end at the run's temperature",
        ),
        ("baoab", BATH, {"temperature": 1.0, "steps": 9, "tau": 1.0}, "tau: baoab does not take it; .* one heat bath"),
        (
            "velocity-verlet", {}, {"temperature": 1.0, "steps": 9, "friction": 1.0},
            "friction: velocity-verlet does not take it; .* velocity-verlet has no heat bath",
        ),
        ("velocity-verlet", {}, {"temperature": 1.0}, "equilibrate: give time or steps$"),
        ("velocity-verlet", {}, {"temperature": 1.0, "steps": 2, "time": 1.0}, "give time or steps, not both"),
        ("velocity-verlet", {}, {"temperature": 1.0, "steps": 0}, "equilibrate: steps"),
        ("velocity-verlet", {}, {"temperature": 1.0, "steps": 9, "to": 0.0}, "equilibrate: to"),
    ],
)  # fmt: skip
def test_two_baths_and_other_nonsense_are_refused(name, options, arguments, message):
    sim = kd.Simulation(melt(), name, **options)
    before = sim.state
    with pytest.raises(InputError, match=message):
        sim.equilibrate(**arguments)
    np.testing.assert_array_equal(sim.state.phase, before.phase)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"steps": 2, "time": 1.0}, "run: give steps, until or time, not steps and time"),
        ({"until": 2.0, "time": 1.0}, "run: give steps, until or time, not until and time"),
        ({"time": float("nan")}, "run: time must be a finite time"),
    ],
)
def test_two_lengths_are_refused(arguments, message):
    with pytest.raises(InputError, match=message):
        kd.Simulation(melt()).run(**arguments)


def test_a_bath_acts_under_gravity_only_where_it_is_told_to():
    system = kd.System([[0.0, 0, 0], [1, 0, 0]], forces=[kd.Gravity()], units="nbody").with_run(dt=0.01)
    with pytest.raises(InputError, match=r"no sense under gravity: .* or set allow_gravity = true"):
        kd.Simulation(system, "baoab", **BATH)
    told = kd.Simulation(system, "baoab", allow_gravity=True, **BATH)
    assert told.run(5).heat != 0.0


def test_temperatures_may_be_texts_with_units():
    ends = []
    for given in (
        {"temperature": "94.4 K", "time": "0.05 ps", "to": "0.08 kK"},
        {"temperature": 94.4, "time": 0.05, "to": 80.0},
    ):
        sim = kd.Simulation(kd.load("argon-864"), dt="10 fs")
        sim.equilibrate(**given)
        ends.append(sim.state.phase)
    np.testing.assert_array_equal(*ends)
    for given, message in (
        ({"temperature": "1 ps"}, 'equilibrate: temperature: expected a temperature such as "94.4 K", got'),
        ({"temperature": "-5 K"}, "equilibrate: temperature must be positive, got"),
        ({"temperature": 80, "to": "1 m"}, 'equilibrate: to: expected a temperature such as "94.4 K", got'),
    ):
        with pytest.raises(InputError, match=message):
            sim.equilibrate(time=0.05, **given)
    with pytest.raises(InputError, match="equilibrate: temperature: lj quantities are plain numbers, got"):
        kd.Simulation(melt()).equilibrate("94.4 K", steps=1)

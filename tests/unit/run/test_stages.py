"""Stages of a protocol, and ramps of temperature and pressure."""

from __future__ import annotations

import re
from types import SimpleNamespace

import numpy as np
import pytest

import kickdrift as kd
from kickdrift.errors import InputError, RunError
from kickdrift.integrators.options import Options
from kickdrift.run.ramp import STAIRS, Ramp
from kickdrift.systemfile.reading import loads
from tests.long import rest

FILE = """
title = "argon in reduced units"
units = "lj"

[particles]
lattice = "fcc"
count = 108
density = 0.8

[velocities]
temperature = 1.5
seed = 1

[[force]]
type = "lennard-jones"
cutoff = 2.0
truncation = "shift"

[run]
integrator = "nose-hoover"
dt = 0.004
tau = 0.2
temperature = 1.0
every = 10
"""
STAGES = """
[[stage]]
name = "relax"
minimize = { force = 1e-3 }

[[stage]]
name = "heat"
temperature = { from = 1.0, to = 2.0 }
steps = 40

[[stage]]
name = "press"
temperature = 2.0
pressure = { from = 0, to = 2.0 }
barostat = "mtk"
pressure_tau = 1.0
steps = 40

[[stage]]
name = "produce"
integrator = "velocity-verlet"
steps = 30
"""
PRESSED = {"pressure": 1.0, "pressure_to": 3.0, "barostat": "mtk", "pressure_tau": 1.0}


def protocol(stages: str = STAGES) -> kd.System:
    system = loads(FILE + stages)
    assert isinstance(system, kd.System)
    return system


def frames(path) -> np.ndarray:
    with kd.open(path) as run:
        return np.array([frame.positions for frame in run])


# --- ramps ---


@pytest.mark.parametrize("count", [7, 1234])
def test_a_ramp_is_linear_in_the_steps_and_stays_at_its_end(count):
    ramp = Ramp.of(Options(temperature=300.0, temperature_to=2500.0, ramp_steps=count))
    held: list[float] = []
    stepper = SimpleNamespace(steps_done=0, go_to=lambda asked: held.append(asked["temperature"]))
    assert ramp is not None
    while stepper.steps_done < count:
        taken = ramp.begin(stepper, 10**9)
        for step in range(stepper.steps_done, stepper.steps_done + taken):
            part = max(1, -(-count // STAIRS))
            assert abs(held[-1] - (300 + 2200 * (step + 0.5) / count)) <= 2200 * part / (2 * count)
        stepper.steps_done += taken
    assert ramp.begin(stepper, 50) == 50
    assert held[-1] == 2500.0


@pytest.mark.parametrize("pressed", [{}, rest(PRESSED)], ids=["bath", "barostat"])
def test_a_ramp_has_the_same_bits_however_a_run_is_cut_and_keeps_its_energy(pressed, tmp_path):
    system, path = protocol(""), tmp_path / "run.h5md"
    ramp = {"temperature": {"from": 1.0, "to": 2.0}, **pressed}
    whole = kd.Simulation(system, **ramp)
    report = whole.run(120, every=10, output=path)
    assert report.options["ramp_steps"] == 120
    assert "the start of a ramp to 2" in report.temperature_verdict
    assert report.energy.max_relative_error < 2e-3  # less heat and work; 0.2 with the chain's energy of one temperature
    parts = kd.Simulation(system, **ramp, ramp_steps=120)
    for steps in (7, 60, 53):
        parts.run(steps, every=25)
    np.testing.assert_array_equal(parts.state.phase, whole.state.phase)
    resumed = kd.resume(path, step=33)
    resumed.run(120 - 33)
    np.testing.assert_array_equal(resumed.state.phase, whole.state.phase)


def test_a_ramp_of_temperature_heats():
    sim = kd.Simulation(protocol(""), "csvr", tau=0.02, temperature=0.5, temperature_to=3.0)
    sim.run(400, every=4)
    heat = np.array([sample.temperature for sample in sim.record.samples])
    wanted = 0.5 + 2.5 * np.arange(len(heat)) / (len(heat) - 1)
    assert abs((heat - wanted)[20:]).mean() < 0.15


REFUSED = [
    ({"temperature": {"from": 1.0, "to": -2.0}}, r"^temperature_to must be a positive finite temperature, got -2"),
    ({"temperature": {"from": 1.0}}, r"^temperature: a ramp is \{from = 300, to = 2500\}"),
    ({"pressure_to": 2.0}, r"^pressure"),
    ({"ramp_steps": 10}, r"^ramp_steps: is the length of a ramp; give temperature_to or pressure_to too$"),
]


@pytest.mark.parametrize(("options", "words"), REFUSED)
def test_a_ramp_that_makes_no_sense_is_refused(options, words):
    with pytest.raises(InputError, match=words):
        kd.Simulation(protocol(""), **options)


def test_advance_knows_no_length_of_a_ramp():
    sim = kd.Simulation(protocol(""), temperature_to=2.0)
    with pytest.raises(InputError, match="ramp_steps is needed"):
        sim.advance(10)


# --- stages ---


def test_stages_are_runs_from_the_end_of_the_one_before(tmp_path):
    system = protocol()
    found = kd.run_stages(system, output=tmp_path / "lj.h5md")
    assert list(found.reports) == ["relax", "heat", "press", "produce"]
    assert list(found.outputs) == ["heat", "press", "produce"]
    start = system.with_stages()
    state = kd.Simulation(start, dt=0.004)
    state.minimize(force=1e-3)
    relaxed = start.anew(state.state).with_velocities(start.state.velocities, temperature=None)
    heat = kd.Simulation(relaxed, temperature=1.0, temperature_to=2.0)
    heat.run(40)
    press = kd.Simulation(
        heat.now(), temperature=2.0, pressure=0.0, pressure_to=2.0, barostat="mtk", pressure_tau=1.0
    )  # fmt: skip
    press.run(40)
    last = kd.Simulation(press.now(), "velocity-verlet")
    report = last.run(30)
    np.testing.assert_array_equal(last.state.phase, found.system.state.phase)
    assert found.system.state.time == pytest.approx(110 * 0.004)
    assert report.energy.initial == found["produce"].energy.initial
    assert found["heat"].energy.final == found["press"].energy.initial  # to the bit
    assert found["press"].energy.final == pytest.approx(found["produce"].energy.initial, rel=1e-14)  # another list
    assert "Means of the stages" in str(found)


@pytest.mark.parametrize("stopped", [rest("heat"), "press", rest("produce")])
def test_a_protocol_stopped_in_a_stage_goes_on_with_the_same_bits(stopped, tmp_path):
    kd.run_stages(protocol(), output=tmp_path / "whole.h5md")
    stages = [each.name for each in protocol().stages]
    begun: list[str] = []

    def stop(done, of):
        begun.append("")
        if len(stages) and done >= of // 2 and current() == stopped:
            raise KeyboardInterrupt

    def current():
        there = [name for name in stages if (tmp_path / f"cut-{name}.h5md").exists()]
        return there[-1] if there else "relax"

    with pytest.raises(KeyboardInterrupt):
        kd.run_stages(protocol(), output=tmp_path / "cut.h5md", progress=stop)
    rest = kd.run_stages(tmp_path / f"cut-{stopped}.h5md")
    assert list(rest.reports) == stages[stages.index(stopped) :]
    for name in stages[1:]:
        np.testing.assert_array_equal(frames(tmp_path / f"cut-{name}.h5md"), frames(tmp_path / f"whole-{name}.h5md"))


def test_stages_of_python_are_those_of_a_file(tmp_path):
    given = [
        kd.Stage("relax", minimize={"force": 1e-3}),
        kd.Stage("heat", temperature={"from": 1.0, "to": 2.0}, steps=40),
        kd.Stage("produce", integrator="velocity-verlet", steps=10, keep=False),
    ]
    system = protocol("")
    found = kd.run_stages(system, given, output=tmp_path / "own.h5md")
    text = system.with_stages(*given).to_toml()
    again = kd.run_stages(loads(text), output=tmp_path / "file.h5md")
    np.testing.assert_array_equal(found.system.state.phase, again.system.state.phase)
    assert not (tmp_path / "own-produce.h5md").exists()


def test_the_rest_of_a_protocol_takes_nothing_from_the_stage_that_runs(tmp_path):
    """Also as the text of a file: [run] has the keys of the stage then, such as its ramp."""
    whole = kd.run_stages(protocol(), output=tmp_path / "whole.h5md")
    with kd.open(tmp_path / "whole-heat.h5md") as run:
        system = run.system()
    assert [each.name for each in system.stages] == ["heat", "press", "produce"]
    text = system.to_toml()
    assert text.count("inherit = false") == 3
    for each in (system, loads(text)):
        rest = kd.run_stages(each)
        assert "temperature_to" not in rest["press"].options
        assert set(rest["produce"].options) == set(whole["produce"].options)
        np.testing.assert_allclose(rest.system.state.phase, whole.system.state.phase, rtol=0, atol=1e-9)


def test_means_of_stages_have_a_familiar_pressure():
    cold = FILE.replace('"lj"', '"metal"').replace("density = 0.8", "density = 0.8\nmass = 40.0")
    found = kd.run_stages(loads(cold + '[[stage]]\nname = "a"\nsteps = 20\n'))
    assert re.search(r"eV/\S+ = \S+ GPa", str(found))


def test_noise_goes_on_from_stage_to_stage():
    system = protocol("").with_run(integrator="baoab", friction=1.0, seed=5)
    one, two = (
        kd.run_stages(system, [kd.Stage("a", steps=20), kd.Stage("b", steps=20)]),
        kd.run_stages(system, [kd.Stage("a", steps=20), kd.Stage("c", steps=20)]),
    )
    np.testing.assert_array_equal(one.system.state.phase, two.system.state.phase)
    sim = kd.Simulation(system)
    sim.run(20)
    again = kd.Simulation(sim.now().with_run(seed=5))  # begins the same noise anew
    again.run(20)
    assert not np.array_equal(again.state.phase, one.system.state.phase)


BAD = [
    ('[[stage]]\nname = "a"\nsteps = 5\n[[stage]]\nname = "a"\nsteps = 5', "two stages are named a"),
    ('[[stage]]\nname = "a/b"\nsteps = 5', r"stage\[0\]: stage: name must be letters"),
    ("[[stage]]\nsteps = 5", r"stage\[0\].name: required key is missing"),
    ('[[stage]]\nname = "a"\nbox = [9, 9, 9]\nsteps = 5', r"stage\[0\].box: unknown key"),
    ('[[stage]]\nname = "a"\ntemperature = { from = 1, to = -1 }', r"stage\[0\].temperature_to: expected"),
    ('[[stage]]\nname = "a"\ntemperature = { from = 1 }', r"stage\[0\].temperature: a ramp is"),
    ('[[stage]]\nname = "a"\npressure = "1 kcal"', r"stage\[0\].pressure: "),
    ('[[stage]]\nname = "a"\nminimize = true\nsteps = 5', "a stage that minimizes takes no steps in time"),
]


@pytest.mark.parametrize(("text", "words"), BAD)
def test_a_stage_that_makes_no_sense_is_refused(text, words):
    with pytest.raises(InputError, match=words):
        protocol(text)


def test_all_stages_are_checked_before_the_first_runs(tmp_path):
    late = '[[stage]]\nname = "a"\nsteps = 5\n[[stage]]\nname = "b"\nsteps = 5\npressure = 1.0'
    with pytest.raises(InputError, match="stage b: pressure_tau is needed"):
        kd.run_stages(protocol(late), output=tmp_path / "x.h5md")
    with pytest.raises(InputError, match=r"stage b: .*neither steps nor time"):
        kd.run_stages(protocol('[[stage]]\nname = "a"\nsteps = 5\n[[stage]]\nname = "b"'))
    with pytest.raises(InputError, match=r"^stage a: its ramp takes 50 steps and the stage ends after 5; give the"):
        kd.run_stages(protocol('[[stage]]\nname = "a"\nsteps = 5\ntemperature = { from = 1, to = 2, steps = 50 }'))
    with pytest.raises(InputError, match="has no stages"):
        kd.run_stages(protocol(""))
    (tmp_path / "x-produce.h5md").write_text("mine")
    with pytest.raises(InputError, match=r"stage produce: .*x-produce\.h5md: exists already"):
        kd.run_stages(protocol(), output=tmp_path / "x.h5md")
    assert [path.name for path in tmp_path.iterdir()] == ["x-produce.h5md"]


def test_a_stage_that_blows_up_is_named_and_the_files_before_are_whole(tmp_path):
    text = (
        '[[stage]]\nname = "good"\nsteps = 20\n[[stage]]\nname = "bad"\nintegrator = "velocity-verlet"\n'
        "dt = 0.5\nsteps = 500"
    )
    with pytest.raises(RunError, match=r"^stage bad: .*x-bad.h5md has its frames"):
        kd.run_stages(protocol(text), output=tmp_path / "x.h5md")
    assert len(frames(tmp_path / "x-good.h5md")) == 3


def test_a_run_of_a_system_with_stages_is_none_of_them(tmp_path):
    kd.Simulation(protocol(), "velocity-verlet").run(10, output=tmp_path / "one.h5md")
    assert kd.resume(tmp_path / "one.h5md").system.stages == ()
    with pytest.raises(InputError, match="is the file of a single run"):
        kd.run_stages(tmp_path / "one.h5md")


def test_commands_of_single_runs_refuse_stages():
    for command, take in (("compare", kd.compare), ("ensemble", kd.Ensemble)):
        with pytest.raises(InputError, match=rf"^{command}: .* has stages, which only `run` takes; leave out"):
            take(protocol())


def test_the_file_of_a_single_run_is_not_that_of_a_stage(tmp_path):
    kd.Simulation(protocol("")).run(10, output=tmp_path / "one.h5md")
    with pytest.raises(InputError, match="is the file of a single run"):
        kd.run_stages(tmp_path / "one.h5md")


def test_steps_leave_the_looks_of_a_system():
    assert protocol("").with_run(steps=5).run.every == 10


# --- at the command line ---


@pytest.fixture
def folder(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    return tmp_path


def test_one_command_runs_all_stages_and_another_goes_on(kickdrift, folder):
    (folder / "lj.toml").write_text(FILE + STAGES)
    status, out, _ = kickdrift("run", "lj.toml", "--output", "lj.h5md", "--quiet")
    assert status == 0
    assert [line.split()[1] for line in out.splitlines() if line.startswith("stage  ")][:4] == [
        "relax", "heat", "press", "produce",
    ]  # fmt: skip
    assert "Means of the stages" in out
    whole = frames(folder / "lj-produce.h5md")
    (folder / "lj-produce.h5md").unlink()
    assert kickdrift("resume", "lj-press.h5md", "--quiet")[0] == 0
    np.testing.assert_array_equal(frames(folder / "lj-produce.h5md"), whole)


@pytest.mark.parametrize("more", [("--steps", "0"), ("--integrator", "csvr"), ("-o", "temperature=2")])
def test_options_beside_stages_are_refused(kickdrift, folder, more):
    (folder / "lj.toml").write_text(FILE + STAGES)
    status, _, err = kickdrift("run", "lj.toml", *more)
    assert (status, err) == (2, f"kickdrift: {more[0]}: lj.toml has stages; give it there, in [[stage]] or [run]\n")

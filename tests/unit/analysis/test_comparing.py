"""`kd.compare`: the comparison of the command line in Python, and Python files on the command line."""

from __future__ import annotations

import json
import math

import numpy as np
import pytest
from typer.testing import CliRunner

import kickdrift as kd
from kickdrift.analysis.compare.ladder import Row
from kickdrift.cli.main import app
from kickdrift.systemfile.python_file import from_python, load_or_run

RUNNER = CliRunner()

MINE = """
import numpy as np

def f(t, y):
    return np.array([y[1], -y[0]])

def exact(t):
    return [np.cos(t), -np.sin(t)]

y0 = [1.0, 0.0]
t_span = (0.0, 10.0)
"""


def oscillator(t, y):
    return np.array([y[1], -y[0]])


def solution(t):
    return [math.cos(t), -math.sin(t)]


@pytest.fixture(scope="module")
def found():
    return kd.compare(oscillator, "rk4", y0=[1.0, 0.0], t_span=(0.0, 10.0), exact=solution, accuracy=1e-3)


def test_a_function_is_compared(found):
    assert found.system == "oscillator"
    assert found.measure == "closed form"
    assert found.length == found.whole == 10.0
    assert all(isinstance(row, Row) for row in found.rows)
    assert found.slopes["rk4"][0] == pytest.approx(4.0, abs=0.2)
    choice = found.recommendation.choice
    assert choice.method == "rk4"
    sim = kd.Simulation(kd.Problem(oscillator, [1.0, 0.0]), "rk4", dt=choice.dt)
    sim.run(choice.steps)
    assert np.linalg.norm(sim.state.y - solution(10.0)) < 1e-3  # against the closed form, at the end of the run
    assert f"kd.Simulation(system, 'rk4', dt={choice.dt!r}).run({choice.steps})" in str(found)


def test_it_shows_itself(found):
    text = str(found)
    assert text.startswith("oscillator: work against precision, 10\nmethod")
    assert "\nrecommended       rk4, dt = " in text
    assert found._repr_html_().count("<table>") == 3
    assert json.dumps(found.as_json())
    assert len(found.plot().axes) == 2


def test_the_command_prints_the_same_words(tmp_path, found):
    file = tmp_path / "oscillator.py"
    file.write_text(MINE, encoding="utf-8")
    table = tmp_path / "found.json"
    done = RUNNER.invoke(app, ["compare", str(file), "--integrator", "rk4", "--accuracy", "1e-3", "--json", str(table)])
    assert done.exit_code == 0, done.output
    written = json.loads(table.read_text(encoding="utf-8"))
    costs = ("seconds", "growth")
    for row, other in zip(written["rows"], found.as_json()["rows"], strict=True):
        assert {k: v for k, v in row.items() if k not in costs} == {k: v for k, v in other.items() if k not in costs}
    assert written["recommendation"]["choice"]["dt"] == found.recommendation.choice.dt
    assert f"to run it         kickdrift run {file} --integrator rk4 --dt" in done.stdout.replace("\n", "")
    for line in str(found).split("\n"):
        if line.startswith(("wanted", "pilot", "error ", "reference")):
            assert line in done.stdout


def test_the_command_runs_a_file(tmp_path):
    file = tmp_path / "mine.py"
    file.write_text(MINE, encoding="utf-8")
    done = RUNNER.invoke(app, ["run", str(file), "--integrator", "rk4", "--dt", "0.1"])
    assert done.exit_code == 0, done.output
    assert "length            100 steps, 10" in done.stdout
    file.write_text("import kickdrift as kd\nmine = kd.load('kepler-e09')\n", encoding="utf-8")
    assert isinstance(load_or_run(file), kd.System)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("f = 3\n", "expected a function f and y0, or a System or Problem"),
        ("def f(t, y): return y\n", "expected a function f and y0"),
        ("1 / 0\n", "ZeroDivisionError: division by zero"),
        ("def f(t, y): return y\ny0 = [1.0]\nt_span = (1.0, 0.0)\n", "t_span: expected two times, the second one"),
        ("def f(t, y): return y[:0]\ny0 = [1.0]\n", "must return shape"),
        ("import kickdrift as kd\na = b = kd.load('ode-harmonic')\n", "defines a, b; name one of them system or"),
    ],
)
def test_a_file_that_defines_nothing_is_refused(tmp_path, text, message):
    file = tmp_path / "mine.py"
    file.write_text(text, encoding="utf-8")
    with pytest.raises(kd.InputError, match=message) as raised:
        from_python(file)
    assert str(raised.value).startswith(str(file))
    assert "\n" not in str(raised.value)


def test_data_files_alone_are_loaded(tmp_path):
    file = tmp_path / "mine.py"
    file.write_text("raise SystemExit('ran')\n", encoding="utf-8")
    for read in (kd.load, kd.compare):
        with pytest.raises(kd.InputError, match="is a Python program"):
            read(file)
    with pytest.raises(kd.InputError, match="no such file"):
        load_or_run(tmp_path / "other.py")
    with pytest.raises(kd.InputError, match=r"seed: .* makes its own random numbers"):
        load_or_run(file, 1)


@pytest.mark.parametrize(
    ("given", "message"),
    [
        ({"subject": oscillator}, "y0: is needed beside the function oscillator"),
        ({"subject": oscillator, "y0": [1.0, 0.0], "t_span": 3.0}, "t_span: expected two times"),
        ({"subject": oscillator, "y0": [1.0, 0.0], "seed": 1}, "seed: a function draws no velocities"),
        ({"subject": "ode-harmonic", "y0": [1.0]}, "y0: only a plain function takes it"),
        ({"subject": 3}, "compare: takes a System, a Problem, a system's name or a function, got 3"),
        ({"subject": "ode-harmonic", "accuracy": -1.0}, "accuracy must be a positive finite number"),
        ({"subject": "ode-harmonic", "integrators": ["rk5"]}, "integrator 'rk5' is unknown"),
        ({"subject": "ode-harmonic", "progress": 3}, "progress must be True, False or a function, got 3"),
        ({"subject": "ode-harmonic", "corector": 3}, "did you mean 'corrector'"),
    ],
)
def test_bad_input(given, message):
    with pytest.raises(kd.InputError, match=message):
        kd.compare(**given)

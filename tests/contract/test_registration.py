"""The user's own integrators: the docs' page runs as it stands, and bad definitions are refused in one line."""

from __future__ import annotations

import os
import subprocess
import sys

import numpy as np
import pytest

import kickdrift as kd
from kickdrift.errors import InputError
from kickdrift.integrators import INTEGRATORS
from kickdrift.integrators.own.registration import REGISTERED, unregister
from kickdrift_validation.measures import fixed
from kickdrift_validation.problems import henon_heiles, pendulum
from tests.own_methods import NAMES, page_code, registrations

CLI = ("-c", "from kickdrift.cli.main import main; main()")


def run(*arguments: str, **environment: str) -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        [sys.executable, *arguments],
        capture_output=True, text=True, env=os.environ | environment, timeout=300,
    )  # fmt: skip


def test_the_page_runs_as_it_stands():
    done = run("-c", page_code())
    assert done.returncode == 0, done.stderr
    assert 0 < float(done.stdout) < 1e-2


def test_the_pages_methods_are_listed_and_run_from_the_command_line(tmp_path):
    path = tmp_path / "mine.py"
    path.write_text(registrations())
    listed = run(*CLI, "--load", str(path), "list", "integrators")
    assert listed.returncode == 0, listed.stderr
    assert all(name in listed.stdout for name in NAMES)
    words = ("run", "two-body", "--integrator", "mclachlan-atela2", "--steps", "10")
    ran = run(*CLI, *words, KICKDRIFT_LOAD=str(path))
    assert ran.returncode == 0, ran.stderr
    assert "mclachlan-atela2, dt = 0.01" in ran.stdout
    without = run(*CLI, *words)
    assert without.returncode == 2
    assert "'mclachlan-atela2' is unknown" in without.stderr


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("1 / 0", "ZeroDivisionError: division by zero"),
        ("import kickdrift as kd\nkd.register_splitting('x', [0.5, 0.4], [1.0], order=2, source='me')", "0.9, not 1"),
        ("def", "SyntaxError: "),
    ],
)
def test_a_file_that_fails_is_one_line(tmp_path, kickdrift, text, message):
    path, absent = tmp_path / "broken.py", tmp_path / "none.py"
    path.write_text(text)
    code, _, err = kickdrift("--load", path, "list", "integrators")
    assert code == 2
    assert err.startswith(f"kickdrift: {path}: ")
    assert message in err
    assert err.count("\n") == 1
    assert kickdrift("--load", absent, "list", "integrators") == (2, "", f"kickdrift: {absent}: no such file\n")


def test_a_compiled_step_gives_the_bits_of_the_loop():
    ends = []
    for name in ("velocity-verlet", "my-verlet"):
        sim = kd.Simulation(henon_heiles(), name, dt=0.1)
        for steps in (30, 70):
            sim.run(steps)
        ends.append(sim.state.y)
    np.testing.assert_allclose(*ends, rtol=1e-13)


def test_every_method_of_the_page_is_in_the_contract_tests():
    assert set(NAMES) <= set(fixed())
    assert set(NAMES) <= REGISTERED


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"name": "rk4"}, "integrator 'rk4' exists already"),
        ({"name": "heun"}, "integrator 'heun' exists already; overwrite=True replaces it"),
        ({"name": " "}, "name must be one word"),
        ({"kick": [0.5, 0.4]}, "kick weights add up to 0.9, not 1"),
        ({"kick": ["half", 0.5]}, "kick must be a row of numbers"),
        ({"drift": 1.0}, "drift must be a row of numbers"),
        ({"first": "jump"}, "first must be kick or drift"),
        ({"first": "drift"}, "mine: 1 drifts and 2 kicks cannot alternate"),
        ({"kick": (0.25, 0.5, 0.25)}, "mine: 3 kicks and 1 drifts cannot alternate"),
        ({"kick": (), "drift": ()}, "mine: drift weights add up to 0.0, not 1"),
        ({"kick": None}, "mine: give a word, or kick and drift"),
        ({"word": "BAB"}, "mine: give a word, or kick and drift, not both"),
        ({"weights": [0.5, 1.0, 0.5]}, "mine: give a word, or kick and drift"),
        ({"kick": None, "drift": None, "word": ["BAB"]}, "mine: word must be letters of flows"),
        ({"kick": None, "drift": None, "word": "BZB"}, "mine: no flow has the letter 'Z'"),
        ({"kick": None, "drift": None, "word": "BAB", "weights": "abc"}, "mine: weights must be a row of numbers"),
        ({"order": 0}, "order must be a whole number, one or more, got 0"),
        ({"source": ""}, "source must say where"),
    ],
)
def test_splittings_that_make_no_sense_are_refused(change, message):
    row = {"name": "mine", "kick": [0.5, 0.5], "drift": [1.0], "order": 2, "source": "me"}
    before = dict(INTEGRATORS)
    with pytest.raises(InputError) as caught:
        kd.register_splitting(**{**row, **change})
    assert message in str(caught.value)
    assert before == INTEGRATORS


def test_registering_again():
    kd.register_tableau("again", a=[], b=[1.0], order=1, source="me")
    try:
        kd.register_tableau("again", a=[[0.5]], b=[0.0, 1.0], order=2, source="me", overwrite=True)
        assert INTEGRATORS["again"].order == 2
        assert "again" in kd.integrators()
        ends = []
        for name in ("again", "midpoint"):
            sim = kd.Simulation(pendulum(), name, dt=0.1)
            sim.run(10)
            ends.append(sim.state.y)
        np.testing.assert_array_equal(*ends)
    finally:
        unregister("again")
    assert "again" not in kd.integrators()
    with pytest.raises(InputError, match="'rk4' is not registered"):
        unregister("rk4")


def test_an_adaptive_tableau_follows_its_tolerance():
    """Heun's method with Euler's inside."""
    kd.register_tableau(
        "heun-euler", a=[[1.0]], b=[0.5, 0.5], order=2, source="Hairer, Norsett & Wanner 1993, II.4",
        errors=[[-0.5, 0.5, 0.0]], error_order=1,
    )  # fmt: skip
    try:
        errors = []
        for rtol in (1e-4, 1e-6):
            sim = kd.Simulation(pendulum(), "heun-euler", rtol=rtol, atol=rtol)
            sim.run(until=3.0)
            from kickdrift_validation.problems import pendulum_exact

            errors.append(np.abs(sim.state.y - pendulum_exact(3.0)).max())
        assert errors[0] / errors[1] == pytest.approx(100, rel=0.5)
    finally:
        unregister("heun-euler")


def test_a_compiled_step_needs_positions_and_velocities():
    decay = kd.Problem(lambda t, y: [-y[0]], [1.0])
    with pytest.raises(InputError, match="needs accelerations that depend on positions and time alone"):
        kd.Simulation(decay, "my-verlet", dt=0.1)


def test_a_step_outside_of_compiled_code_says_so():
    with pytest.raises(NotImplementedError, match="register_step"):
        kd.accelerations((), 0.0, None, None, None)

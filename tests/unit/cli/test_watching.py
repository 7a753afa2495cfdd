"""Options of ``kickdrift run`` that show a run while it goes on."""

from __future__ import annotations

import re
import socket

import numpy as np
import pytest
from typer.testing import CliRunner

import kickdrift as kd
from kickdrift.cli.main import app
from kickdrift.model.checks.arguments import other_name

RUNNER = CliRunner()
SHORT = ("run", "two-body", "--steps", "5")


def test_the_terminal_says_where_the_page_is():
    found = RUNNER.invoke(app, [*SHORT, "--live"])
    assert found.exit_code == 0, found.output
    assert re.search(r"^live view: http://127\.0\.0\.1:\d+/\?token=[\w-]{32}$", found.stderr, re.MULTILINE)


def test_a_resumed_run_has_a_page_and_a_stream(tmp_path):
    path = str(tmp_path / "run.h5md")
    assert RUNNER.invoke(app, [*SHORT, "--output", path]).exit_code == 0
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        port = str(probe.getsockname()[1])
    found = RUNNER.invoke(app, ["resume", path, "--steps", "10", "--live", "--imd", port])
    assert found.exit_code == 0, found.output
    assert re.search(r"^live view: http://127\.0\.0\.1:\d+/\?token=[\w-]{32}$", found.stderr, re.MULTILINE)
    assert f"streams to imd://127.0.0.1:{port}" in found.stderr
    alone = str(tmp_path / "alone.h5md")
    assert RUNNER.invoke(app, [*SHORT[:2], "--steps", "10", "--output", alone]).exit_code == 0
    with kd.open(path) as one, kd.open(alone) as other:
        np.testing.assert_array_equal(one[-1].positions, other[-1].positions)
    found = RUNNER.invoke(app, ["resume", path, "--steps", "20", "--imd-wait"])
    assert "needs --imd" in str(found.exception)


def test_an_ensemble_says_which_commands_have_a_page():
    found = RUNNER.invoke(app, ["ensemble", "two-body", "--live"], standalone_mode=False)
    assert "No such option" in str(found.exception.message)  # type: ignore[union-attr]
    assert "kickdrift resume" in other_name("option", "live")


@pytest.mark.parametrize("option", ["--live", "--imd"])
def test_a_problem_has_no_page_and_no_stream(option):
    found = RUNNER.invoke(app, ["run", "ode-harmonic", option])
    assert isinstance(found.exception, kd.InputError)
    assert f"{option}: a Problem has no particles" in str(found.exception)


@pytest.mark.parametrize("option", ["--live", "--imd"])
def test_a_taken_port_is_one_line_before_the_run(option, tmp_path):
    path = tmp_path / "run.h5md"
    with socket.socket() as taken:
        taken.bind(("127.0.0.1", 0))
        taken.listen()
        port = str(taken.getsockname()[1])
        for given in ([option, port], [f"{option}={port}"]):
            found = RUNNER.invoke(app, [*SHORT, *given, "--output", str(path)])
            assert isinstance(found.exception, kd.InputError)
            assert f"{option}: port {port} of 127.0.0.1: " in str(found.exception)
            assert not path.exists()


def test_a_port_may_stand_before_the_system_and_be_left_out():
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        port = str(probe.getsockname()[1])
    found = RUNNER.invoke(app, ["run", "--imd", port, *SHORT[1:]])
    assert found.exit_code == 0, found.output
    assert f"streams to imd://127.0.0.1:{port}" in found.stderr
    found = RUNNER.invoke(app, ["run", "--live", *SHORT[1:]])
    assert found.exit_code == 0, found.output


@pytest.mark.parametrize(
    ("given", "why"),
    [
        (["--imd-wait"], "needs --imd"),
        (["--imd", "70000"], "a port is"),
        (["--live", "--quiet"], "--quiet keeps silent"),
    ],
)
def test_options_that_make_no_sense_are_refused(given, why):
    found = RUNNER.invoke(app, [*SHORT, *given])
    assert isinstance(found.exception, kd.InputError)
    assert why in str(found.exception)

"""Objects that print themselves as the command line prints them, and show themselves in notebooks."""

from __future__ import annotations

import io
import json
import pickle
import re
import sys
from types import SimpleNamespace

import numpy as np
import pytest
from typer.testing import CliRunner

import kickdrift as kd
from kickdrift.cli.main import app
from kickdrift.display import card, showing
from tests.systems import liquid

RUNNER = CliRunner()


def printed(*arguments: str) -> str:
    found = RUNNER.invoke(app, list(map(str, arguments)))
    assert found.exit_code == 0, found.output
    return found.stdout


def without_clocks(text: str) -> list[str]:
    """The lines without those of the clock: speed, and the line (or two) that begins with took."""
    lines = text.strip().split("\n")
    clocks = [k for k, line in enumerate(lines) if line.startswith(("speed ", "took "))]
    return [line for k, line in enumerate(lines) if k not in clocks and not (k - 1 in clocks and line.startswith(" "))]


def test_a_report_prints_what_the_command_prints(tmp_path):
    path = tmp_path / "run.h5md"
    sim = kd.Simulation(kd.load("kepler-e09"), "velocity-verlet", dt=0.01)
    report = sim.run(20, every=1, output=path)
    command = printed(
        "run", "kepler-e09", "--integrator", "velocity-verlet", "--dt", "0.01", "--steps", 20, "--every", 1,
        "--output", path, "--overwrite",
    )  # fmt: skip
    assert without_clocks(str(report)) == without_clocks(command)
    assert f"written           {path}" in command
    assert repr(report) == str(report)


def test_a_problems_report_prints_what_the_command_prints():
    report = kd.Simulation(kd.load("ode-harmonic")).run(20)
    assert without_clocks(str(report)) == without_clocks(printed("run", "ode-harmonic", "--steps", 20))


@pytest.mark.parametrize("name", ["kepler-e09", "lj-1000", "ode-harmonic"])
def test_a_system_prints_what_info_prints(name):
    first, *rest = printed("info", name).strip().split("\n")
    assert first == f"system            {name}: valid"
    assert str(kd.load(name)).split("\n") == [f"system            {name}", *rest]


def test_a_simulation_says_what_runs_and_how_far():
    sim = kd.Simulation(kd.load("kepler-e09"), "velocity-verlet", dt=0.01)
    assert repr(sim) == "<Simulation of kepler-e09 with velocity-verlet: 0 steps done>"
    sim.run(3)
    lines = str(sim).split("\n")
    assert lines[0] == "system            kepler-e09"
    assert "integrator        velocity-verlet, dt = 0.01" in "\n".join(lines)
    assert lines[-1].startswith("done              3 steps, time 0.03")
    assert not any(line.startswith("run ") for line in lines)


def test_a_runs_file_prints_what_info_prints(tmp_path):
    path = tmp_path / "run.h5md"
    kd.Simulation(liquid(), dt=0.001).run(2, output=path)
    with kd.open(path) as run:
        assert str(run) == printed("info", path).strip()
        assert repr(run).startswith("<Run ")
        assert "<td" in run._repr_html_()


def test_a_list_prints_what_the_command_prints():
    assert kd.listing("engines").names == kd.engines()
    assert kd.listing("integrators").names == kd.integrators()
    words = " ".join(printed("list", "systems").split())
    for row in kd.listing("systems").rows:
        assert " ".join(" ".join(row).split()) in words
    explained = kd.listing("integrators", "wisdom-holman")
    assert str(explained).startswith("integrator        wisdom-holman")
    assert "corrector" in explained.names
    with pytest.raises(kd.InputError, match=r"expected one of integrators, .*did you mean 'forces'"):
        kd.listing("force")
    with pytest.raises(kd.InputError, match="only integrators are explained"):
        kd.listing("forces", "gravity")


def test_html_escapes_what_a_file_says():
    system = liquid()
    named = kd.System(system.state.positions, name="<b>&\x1b[31m", forces=())
    assert "&lt;b&gt;&amp;\\x1b[31m" in named._repr_html_()
    assert "<b>" not in named._repr_html_()
    table = showing.html_table("<i>", ["<a>"], [["<script>"]])
    assert "<script>" not in table
    assert table.count("&lt;") == 3


def test_a_report_keeps_its_samples_through_pickle_and_out_of_its_json():
    report = kd.Simulation(kd.load("ode-harmonic")).run(20, every=1)
    again = pickle.loads(pickle.dumps(report))
    assert again == report
    assert str(again) == str(report)
    np.testing.assert_array_equal(again.about.series.total, report.about.series.total)
    assert len(again.about.series.times) == report.samples == 21
    assert "about" not in json.loads(json.dumps(report.as_json()))


def test_the_steps_of_a_report_are_a_plain_number_inside_a_step():
    sim = kd.Simulation(kd.load("ode-harmonic"), "dop853")
    json.dumps(sim.run(until=sim.time + 1.0, interval=0.3).as_json())


class Terminal(io.StringIO):
    def isatty(self) -> bool:
        return True


def test_a_run_shows_a_bar_on_a_terminal_only(monkeypatch):
    sim = kd.Simulation(liquid(), dt=0.001)
    for stream, seen in ((Terminal(), True), (io.StringIO(), False)):
        monkeypatch.setattr(sys, "stderr", stream)
        sim.run(2, progress=True)
        sim.equilibrate(1.0, 0.002, progress=True)
        found = stream.getvalue()
        assert ("running" in found) is ("equilibrating" in found) is seen
        assert seen or not found


def test_the_default_shows_nothing(monkeypatch):
    monkeypatch.setattr(sys, "stderr", stream := Terminal())
    kd.Simulation(liquid(), dt=0.001).run(2)
    kd.Simulation(liquid(), dt=0.001).run(2, progress=False)
    assert stream.getvalue() == ""


def test_a_function_is_told_of_the_progress():
    told: list[tuple[int, int]] = []
    kd.Simulation(liquid(), dt=0.001).run(2, progress=lambda *done: told.append(done))
    assert told[-1] == (2, 2)


def test_a_notebook_shows_a_bar_below_its_cell(monkeypatch):
    shown: list[str] = []
    handle = SimpleNamespace(update=shown.append)
    display = SimpleNamespace(HTML=str, display=lambda html, display_id: handle)
    shell = type("ZMQInteractiveShell", (), {})()
    monkeypatch.setitem(sys.modules, "IPython", SimpleNamespace(get_ipython=lambda: shell, display=display))
    monkeypatch.setitem(sys.modules, "IPython.display", display)
    with showing.following(True, "a <label>") as told:
        assert told is not None
        told(1, 4)
        told(2, 4)  # too soon after the first
        told(4, 4)
    assert shown == ["a &lt;label&gt; <progress value=1 max=4></progress> 25 %", ""]


@pytest.mark.parametrize("call", ["run", "equilibrate"])
def test_progress_is_a_bool_or_a_function(call):
    sim = kd.Simulation(liquid(), dt=0.001)
    arguments = (2,) if call == "run" else (1.0, 0.002)
    with pytest.raises(kd.InputError, match=f"{call}: progress must be True, False or a function, got 3"):
        getattr(sim, call)(*arguments, progress=3)


def test_cards_show_the_energy_error_as_a_sparkline(tmp_path):
    sim = kd.Simulation(liquid(), dt=0.001)
    assert "<svg" not in sim._repr_html_()
    assert "<svg" not in sim.system._repr_html_()
    report = sim.run(400, every=1, output=tmp_path / "run.h5md")
    rms = f"energy error: RMS {report.energy.rms_relative_error:.2g} of the initial energy"
    with kd.open(tmp_path / "run.h5md") as run:
        for each in (report, sim, run):
            html = each._repr_html_()
            assert rms in html
            points = re.search(r'points="(.+?)"', html)[1].split()
            assert 200 < len(points) <= 2 * card.POINTS
            assert all(0 <= float(y) <= card.HEIGHT for y in (point.split(",")[1] for point in points))


@pytest.mark.parametrize("values", [[], [0.0], [0.0, 0.0], [1e308, -1e308], [float("nan"), 1.0, float("inf")]])
def test_a_sparkline_of_any_numbers_stays_inside_its_picture(values):
    html = card.sparkline(card.Spark(values, "<b>"))
    assert "&lt;b&gt;" in html
    assert "<b>" not in html
    for point in re.findall(r"[\d.-]+,[\d.-]+", html):
        x, y = map(float, point.split(","))
        assert 0 <= x <= card.WIDTH
        assert 0 <= y <= card.HEIGHT
    assert "nan" not in html

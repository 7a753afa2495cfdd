"""Limits of the command line: too large requests, closed or limited streams, and texts that would control a terminal.
Each gives one clear line."""

from __future__ import annotations

import contextlib
import math
import os
import signal
import subprocess
import sys
import threading
import time
from pathlib import Path

import numpy as np
import pytest

import kickdrift as kd
from kickdrift.batch.batch import Batch
from kickdrift.cli import main as cli
from kickdrift.cli.console import print_table
from kickdrift.disk.interrupt import heard_everywhere, whole
from kickdrift.ensemble.members import members_of, with_values
from kickdrift.errors import InputError, RunError
from kickdrift.model.checks import limits
from kickdrift.model.checks import values as checks
from kickdrift.model.checks.limits import MOST_STEPS
from kickdrift.odes import harmonic_oscillator
from kickdrift.run.plan.plan import check_run, plan_of
from kickdrift.text import LINE, clean, shown
from tests.long import rest
from tests.refusals import assert_refused

PROGRAM = "from kickdrift_main import main; main()"
HUGE = "1" + 30 * "0"
DIGITS = 5000 * "9"


@pytest.fixture(autouse=True)
def folder(tmp_path, monkeypatch):
    """Each test works in its own folder."""
    monkeypatch.chdir(tmp_path)


# --- too much ---


@pytest.mark.parametrize(
    ("arguments", "part"),
    [
        (["--steps", HUGE], "steps must be at most 1,000,000,000,000,000, got 1e+30"),
        (["--steps", DIGITS], "--steps"),
        (["--steps", "²"], "--steps"),
        (["--steps", ""], "--steps"),
        (["--time", "1e308"], "time 1e+308 takes "),
        (["--time", "1e18"], "time 1e+18 takes 2e+18 steps of 0.5; a run has at most"),
        (["--time", "nan"], "finite"),
        (["--time", "-1", "--integrator", "rk4", "--dt", "0.5"], "run: rk4 is neither reversible nor adaptive"),
        (["--every", 2**64], "every must be at most"),
        (["--steps", 10**12, "--every", 1], "run: 1,000,000,000,000 samples take about 909 TiB, and this machine has"),
        (["--time", "1e12", "--interval", "1e-3", "--integrator", "rk45"], "integrator"),
        (["--time", "1e12", "--interval", "1e-3", "--integrator", "dormand-prince45"], "give a larger interval"),
        (["--processes", 10**18], "processes"),
        (["--threads", 10**18], "threads must be 1 to"),
        (["--output", 300 * "a" + ".h5md"], "name too long"),
        (["--json", 300 * "a" + ".json"], "name too long"),
    ],
)
def test_a_run_that_asks_for_too_much(arguments, part, kickdrift):
    assert_refused(kickdrift("run", "sun-jupiter", *arguments), part)


@pytest.mark.parametrize(
    ("arguments", "part"),
    [
        (["--steps", HUGE], "run.steps: expected a number less than or equal to 1000000000000000, got 1000"),
        (["--time", "1e308"], "a run has at most"),
        (["--steps", 10**12, "--every", 1], "samples take"),
        (["--workers", 10**18], "workers must be at most"),
        (["--workers", 10**9], "ensemble: 1,000,000,000 workers take about 181,899 TiB"),
        (["--replicas", 10**18], "members take"),
        (["--replicas", 10**30], "members take"),
        (["--vary", "dt=1:2:²"], "COUNT must be a whole number, one or more, got '²'"),
        (["--vary", "dt=1:2:" + DIGITS], "COUNT must be a whole number"),
        (["--vary", "dt=1:2:" + 12 * "9"], "values take"),
        (["--vary", "dt=-1e308:1e308:3"], "finite"),
        (["--vary", "dt=uniform:-1e308:1e308"], "too far apart"),
        (["--vary", "particles.elements[²].a=1"], "no entry is named '²'"),
        (["--vary", f"particles.elements[{DIGITS}].a=1"], "characters more"),
    ],
)
def test_an_ensemble_that_asks_for_too_much(arguments, part, kickdrift):
    vary = "particles.elements[Jupiter].e=0.04,0.05"
    assert_refused(kickdrift("ensemble", "sun-jupiter", "--vary", vary, *arguments), part)


def test_chaos_for_too_long(kickdrift):
    assert_refused(kickdrift("chaos", "sun-jupiter", "--integrator", "yoshida6", "--time", "1e308"), "at most")


@pytest.mark.parametrize(
    "asked",
    [
        {"steps": 10**30},
        {"steps": 10**5000},
        {"steps": -(10**5000)},
        {"steps": True},
        {"steps": 1, "every": 2**64},
        {"steps": 10**12, "every": 1},
        {"until": 10**400},
        {"until": 1e308},
        {"until": float("nan")},
    ],
)
def test_the_same_from_python(asked):
    sim = kd.Simulation(kd.load("sun-jupiter"))
    with pytest.raises(InputError, match=r"^run: "):
        sim.run(**asked)
    assert sim.steps_done == 0


def test_a_run_within_the_limits_is_planned():
    sim = kd.Simulation(kd.load("sun-jupiter"))
    assert plan_of(sim, MOST_STEPS, None, MOST_STEPS // 100, None, None).end_step == MOST_STEPS
    check_run(sim.system.run)


def test_samples_are_bounded_by_what_the_process_may_have(monkeypatch):
    monkeypatch.setattr(limits, "memory", lambda: 20e6)
    sim = kd.Simulation(kd.load("sun-jupiter"))
    assert plan_of(sim, 5000, None, 1, None, None).every == 1
    with pytest.raises(InputError, match=r"run: 5,001 samples take about 4\.77 MiB, and this machine has 19\.1 MiB"):
        plan_of(sim, 5001, None, 1, None, None)
    with pytest.raises(InputError, match="samples take"):
        Batch([kd.load("two-body")] * 8).run(10_000, every=1)
    with pytest.raises(InputError, match="members take"):
        members_of({}, 2000, 0)


def test_pieces_of_a_batch_change_no_bits(monkeypatch):
    def looks():
        batch = Batch([kd.load("two-body")] * 2)
        batch.run(200, every=3)
        return batch.record(0).series().total.tobytes()

    whole = looks()
    monkeypatch.setattr("kickdrift.batch.members.PIECE_SAMPLES", 7)
    assert looks() == whole


def test_a_list_is_indexed_by_plain_digits_alone():
    data = {"particles": {"elements": [{"a": 1}, {"a": 2}]}}
    assert with_values(data, {"particles.elements[1].a": 5})["particles"]["elements"][1]["a"] == 5
    with pytest.raises(InputError, match="no entry"):
        with_values(data, {f"particles.elements[{2**64}].a": 5})


@pytest.mark.parametrize(("value", "found"), [(2, 2.0), (10**400, math.inf), (-(10**400), -math.inf), ("2", math.nan)])
def test_numbers(value, found):
    assert checks.number(value) == found or math.isnan(found)


# --- texts ---


@pytest.mark.parametrize(
    ("text", "cleaned"),
    [
        ("Zürich 漢字 नाम שם", "Zürich 漢字 नाम שם"),
        ("\x1b[31mred\x07", "\\x1b[31mred\\x07"),
        ("two\nlines\r", "two\\nlines\\r"),
        ("a\u202eb\u200bc\u2028d", "a\\u202eb\\u200bc\\u2028d"),
        ("\x9b1m", "\\x9b1m"),
        ("name\udcff", "name\\xff"),
    ],
)
def test_control_characters_are_escaped(text, cleaned):
    assert clean(text) == cleaned
    assert clean(cleaned) == cleaned
    assert str(InputError(text)) == cleaned


def test_long_texts_are_cut_in_the_middle():
    cut = clean("key" + 10**6 * "\x1b" + ": unknown key")
    assert len(cut) <= LINE
    assert cut.startswith("key\\x1b")
    assert cut.endswith(": unknown key")
    assert clean(cut) == cut
    assert len(shown(10**5000)) < 60


EVIL = """
units = "lj"
[particles]
positions = [[0, 0, 0], [1.1, 0, 0]]
mass = 1.0
species = "漢red\\u202e"
[box]
periodic = false
[[force]]
type = "lennard-jones"
[run]
dt = 0.001
steps = 10
"""


def test_texts_of_files_do_not_steer_a_terminal(kickdrift, tmp_path):
    (tmp_path / "evil.toml").write_text(EVIL, encoding="utf-8")
    assert kickdrift("run", "evil.toml", "--output", "evil.h5md")[0] == 0
    for file in ("evil.toml", "evil.h5md"):
        status, out, err = kickdrift("info", file, *(["--all"] if file.endswith(".h5md") else []))
        assert (status, err) == (0, "")
        assert "漢red\\u202e" in out
        assert "\u202e" not in out
    (tmp_path / "evil.toml").write_text(EVIL.replace("red", "\\u001b[31mred"), encoding="utf-8")
    assert_refused(kickdrift("info", "evil.toml"), "species[0]: expected a name without control characters")
    (tmp_path / "evil.toml").write_text(EVIL + '["\\u001b]0;title\\u0007"]\n', encoding="utf-8")
    assert_refused(kickdrift("info", "evil.toml"), "\\x1b]0;title\\x07: unknown key")


def test_cells_of_a_table_are_clean(capsys):
    print_table("\x1b[1mtitle", ["na\nme"], [[":heart: [red]x\x07"], [500 * "a"]])
    out = capsys.readouterr().out
    assert "\x1b" not in out
    assert "\x07" not in out
    assert ":heart: [red]x\\x07" in out
    assert out.count("a") < 300


def program(*arguments, shell="", **environment) -> subprocess.CompletedProcess:
    """The program in its own process, with streams changed by shell syntax."""
    words = ["sh", "-c", f'exec "$@" {shell}', "sh", sys.executable, "-W", "error", "-c", PROGRAM, *arguments]
    return subprocess.run(words, capture_output=True, env=os.environ | environment)


@pytest.mark.parametrize(
    ("shell", "arguments", "status"),
    [
        rest("2>&-", ["info", "nothing.toml"], 2),
        rest(">&-", ["info", "sun-jupiter"], 0),
        (">&- 2>&- <&-", ["info", "sun-jupiter"], 0),
        ("> /dev/full", ["info", "sun-jupiter"], 1),
        rest("2> /dev/full", ["info", "nothing.toml"], 2),
    ],
)
def test_closed_and_full_streams(shell, arguments, status):
    if "/dev/full" in shell and not os.path.exists("/dev/full"):
        pytest.skip("no /dev/full")
    done = program(*arguments, shell=shell)
    assert (done.returncode, done.stdout) == (status, b"")
    assert done.stderr.count(b"\n") <= 1
    assert b"Traceback" not in done.stderr


def test_letters_that_a_stream_does_not_know_are_replaced():
    done = program("list", "integrators", PYTHONIOENCODING="ascii")
    assert (done.returncode, done.stderr) == (0, b"")
    done = program("info", "漢字.toml", PYTHONIOENCODING="cp1252")
    assert (done.returncode, done.stdout) == (2, b"")
    assert done.stderr == b"kickdrift: \\u6f22\\u5b57.toml: no such file\n"


# --- Ctrl-C and bugs ---


def test_ctrl_c_while_the_program_is_imported():
    code = (
        "import os, sys, signal; signal.signal(signal.SIGINT, signal.default_int_handler)\n"  # lost in background jobs
    )
    code += "from kickdrift_main import main\nclass Finder:\n def find_spec(self, name, *_):\n"
    code += "  if name == 'kickdrift.cli.main': os.kill(os.getpid(), signal.SIGINT)\n"
    code += "sys.meta_path.insert(0, Finder()); main()"
    done = subprocess.run([sys.executable, "-W", "error", "-c", code], capture_output=True, text=True)
    assert (done.returncode, done.stdout, done.stderr) == (130, "", "kickdrift: interrupted\n")


def test_ctrl_c_in_a_callback_comes_again():
    class Callback:
        def __del__(self):
            signal.raise_signal(signal.SIGINT)

    def interrupted():
        callback = Callback()
        del callback
        for _ in range(3000):
            time.sleep(0.01)

    before = sys.unraisablehook
    handler = signal.signal(signal.SIGINT, signal.default_int_handler)  # a background job lacks this handler
    try:
        with pytest.raises(KeyboardInterrupt), heard_everywhere():
            interrupted()
    finally:
        signal.signal(signal.SIGINT, handler)
    assert sys.unraisablehook is before


def test_a_bug_is_one_line_and_can_be_found(kickdrift, monkeypatch):
    def broken(*_, **files):
        raise ValueError("two\nlines\x1b")

    monkeypatch.setattr("kickdrift.load", broken)
    status, out, err = kickdrift("info", "sun-jupiter")
    assert (status, out, err.count("\n")) == (1, "", 1)
    assert "a bug in kickdrift, please report it: ValueError: two\\nlines\\x1b (KICKDRIFT_TRACEBACK=1" in err
    monkeypatch.setenv("KICKDRIFT_TRACEBACK", "1")
    with pytest.raises(ValueError, match="two"):
        cli.main()


def test_no_memory_is_one_line(kickdrift, monkeypatch):
    def greedy(*_, **files):
        raise MemoryError

    monkeypatch.setattr("kickdrift.load", greedy)
    assert kickdrift("info", "sun-jupiter") == (1, "", "kickdrift: not enough memory\n")


@pytest.mark.parametrize("count", [10**12, 9 * 10**18, 10**30])
def test_a_benchmark_of_too_many_particles_is_refused(kickdrift, count):
    status, out, err = kickdrift("bench", "lj-energy", "--steps", 1, "--particles", count)
    assert (status, out) == (2, "")
    assert "particles take" in err
    assert err.count("\n") == 1


def test_samples_of_a_run_of_unknown_length_stop_at_the_memory(monkeypatch):
    sim = kd.Simulation(harmonic_oscillator(), integrator="dormand-prince45")
    sim.run(until=1.0, every=1)
    monkeypatch.setattr("kickdrift.looks.observers.COUNTED", 64)
    monkeypatch.setattr(limits, "memory", lambda: 4 * 1000 * 100)
    with pytest.raises(
        RunError, match=r"^stopped at step \d+ .*: run: 128 samples take .* give a larger every or interval"
    ):
        sim.run(until=1e9, every=1)
    assert len(sim.record.samples) == 128
    assert sim.report().steps == sim.steps_done


# --- processes of an ensemble ---


def test_ctrl_c_waits_for_what_is_to_be_whole_and_its_processes_never_hear_it():
    asks = "import signal; print(signal.SIGINT in signal.pthread_sigmask(signal.SIG_BLOCK, []))"
    heard = []

    def interrupted() -> None:
        with whole():
            signal.raise_signal(signal.SIGINT)
            heard.append(subprocess.run([sys.executable, "-c", asks], capture_output=True, text=True).stdout)

    with pytest.raises(KeyboardInterrupt):
        interrupted()
    assert heard == ["True\n"]
    assert signal.SIGINT not in signal.pthread_sigmask(signal.SIG_BLOCK, [])


def test_ctrl_c_while_workers_start_waits_until_they_are_there(monkeypatch):
    import distributed

    from kickdrift.ensemble import running

    came = []

    class Begun(contextlib.AbstractContextManager):
        def __init__(self, *_, **__):
            signal.pthread_kill(threading.get_ident(), signal.SIGINT)  # another thread would receive it late
            came.append("begun")

        def __exit__(self, *_):
            came.append("ended")

    monkeypatch.setattr(distributed, "LocalCluster", Begun)
    monkeypatch.setattr(distributed, "Client", lambda *_, **__: contextlib.nullcontext())
    with pytest.raises(KeyboardInterrupt), running.workers(1):
        pass
    assert came == ["begun", "ended"]


def test_what_tracks_semaphores_is_quiet():
    code = "from multiprocessing import resource_tracker as t; from kickdrift.ensemble.running import quiet_tracker\n"
    code += "quiet_tracker(); t.unregister('nothing', 'semaphore')"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True)
    assert (done.returncode, done.stdout, done.stderr) == (0, "", "")


def test_workers_that_cannot_be_started_are_one_line(monkeypatch):
    import distributed

    from kickdrift.ensemble import running

    def dies(**_):
        raise RuntimeError("Nanny failed to start.")

    monkeypatch.setattr(distributed, "LocalCluster", dies)
    ended = pytest.raises(RunError, match="the workers cannot be started: RuntimeError: Nanny failed")
    with ended, contextlib.ExitStack() as stack:
        stack.enter_context(running.workers(1))


def test_a_message_keeps_the_end_of_a_long_path():
    folders = "a/" * 60
    assert shown(f"{folders}cu.eam").endswith("a/cu.eam'")
    assert shown(f"{folders}cu.eam").startswith("'...")
    assert shown("x" * 80).endswith("x...")


def test_a_new_file_names_itself(kickdrift):
    for kind, name in (("liquid", "mine.toml"), ("water", "other.toml")):
        kickdrift("new", kind, "--output", name)
        text = Path(name).read_text()
        assert f"kickdrift run {name}" in text
        assert f"{kind}.toml" not in text


def test_relax_writes_what_export_writes(kickdrift):
    kickdrift("relax", "lj-1000-switch", "--output", "r.toml")
    kickdrift("relax", "lj-1000-switch", "--output", "r.extxyz")
    assert np.allclose(kd.load("r.extxyz").state.positions, kd.load("r.toml").state.positions, atol=1e-7)
    assert_refused(kickdrift("relax", "lj-1000-switch", "--output", "r.foo"), ".extxyz")
    assert not Path("r.foo").exists()


def test_a_figure_gives_its_numbers(kickdrift):
    bath = {"temperature": 1.0, "friction": 1.0}
    barostat = {"barostat": "c-rescale", "pressure": 1.0, "pressure_tau": 1.0, "compressibility": 0.1}
    sim = kd.Simulation(kd.load("lj-1000-switch"), "baoab", 0.005, **bath, **barostat)
    sim.run(20, every=5, output="run.h5md")
    kickdrift("plot", "run.h5md", "--column", "density", "--csv", "density.csv")
    table = np.genfromtxt("density.csv", delimiter=",", names=True)
    with kd.open("run.h5md") as run:
        assert np.array_equal(table["x"], run.sample_times)
        assert np.array_equal(table["y"], 1000 / run.observables["volume"])
    assert_refused(kickdrift("plot", "run.h5md", "--output", "b.png", "--csv", "b.txt"), ".csv")
    assert not Path("b.png").exists()
    assert kickdrift("plot", "--stability", "leapfrog", "--csv", "b.csv")[0] == 0
    x, y = np.genfromtxt("b.csv", delimiter=",", skip_header=1, usecols=(-2, -1)).T
    half = len(x) // 2  # the method's curve, half the trace 1 - (omega dt)²/2, and the exact one
    assert np.allclose(y[:half], 1 - x[:half] ** 2 / 2)
    assert np.allclose(y[half:], np.cos(x[half:]))
    assert_refused(
        kickdrift("plot", "--stability", "rk4", "--output", "c.png", "--csv", "c.csv"), "c.csv: this figure has areas"
    )
    assert_refused(kickdrift("plot", "ode-pendulum", "--csv", "c.csv"), "--csv is for files, and FILE is a system file")

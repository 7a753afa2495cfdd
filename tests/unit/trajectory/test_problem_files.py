"""The file of a Problem's run: what is in it, resuming with the same bits, kills, damage, and tables."""

from __future__ import annotations

import json
import re
import shutil
from dataclasses import replace

import h5py
import numpy as np
import pandas
import pytest

import kickdrift as kd
from kickdrift.disk import kinds
from kickdrift.errors import InputError, RunError
from kickdrift.trajectory.problems.reader import ProblemRun, describe, info
from kickdrift.trajectory.problems.record import problem_hash
from kickdrift.trajectory.problems.table import ProblemTable
from kickdrift.trajectory.read.info import with_end

PENDULUM = kd.load("ode-pendulum")
LORENZ = kd.load("ode-lorenz")


def spring(stiffness: float = 2.0, start=(1.0, 0.0)) -> kd.Problem:
    """A Problem made in Python, which a file cannot hold."""
    return kd.Problem(lambda t, y: (y[1], -stiffness * y[0]), start, separable=True, compiled=False, name="spring")


@pytest.fixture
def path(tmp_path):
    return tmp_path / "run.h5"


# --- content of the file ---


def test_a_file_holds_what_the_run_saw(path):
    seen = []
    sim = kd.Simulation(PENDULUM)
    report = sim.run(60, every=7, output=path, observe=lambda sim: seen.append((sim.steps_done, sim.time, sim.state.y)))
    with kd.open(path) as run:
        assert isinstance(run, ProblemRun)
        assert len(run) == len(seen) == 10
        np.testing.assert_array_equal(run.steps, [step for step, _, _ in seen])
        np.testing.assert_array_equal(run.times, [time for _, time, _ in seen])
        np.testing.assert_array_equal(run.y, [y for _, _, y in seen])
        np.testing.assert_array_equal(run.energies, [PENDULUM.energy(t, y) for _, t, y in seen])
        assert run.report["steps"] == report.steps == 60
        assert run.report["energy"]["final"] == run.energies[-1]
        assert (run.closed, run.unchanged, bool(run.damage()), run.every) == (True, True, False, 7)
        assert run.method["integrator"] == "velocity-verlet"
        assert run.source == PENDULUM.source
        again = run.problem()
        assert (again.equation, again.parameters, again.run) == ("pendulum", {"omega": 1.0}, PENDULUM.run)
        table = run.to_pandas()
    assert [*table] == ["time", "y0", "y1", "energy"]
    np.testing.assert_array_equal(table["y1"], [y[1] for _, _, y in seen])


def test_the_file_is_as_the_page_says(path):
    kd.Simulation(PENDULUM).run(20, every=5, output=path)
    with h5py.File(path) as file:
        own = file["kickdrift"]
        assert list(file) == ["kickdrift"]
        assert own.attrs["schema"] == 2
        assert own["committed"][()].tolist() == [0, 5, 0]
        assert own["samples/y"].shape == (5, 2)
        assert own["samples/energy"].shape == own["samples/time"].shape == (5,)
        assert own["problem/y0"][()].tolist() == [2.0, 0.0]
        assert own["closed"][0] == 1
        assert own["checksums/sample"].shape == (5,)


def test_columns_and_an_equation_without_energy(path):
    column = kd.Column("radius", "", (), lambda sim: float(np.hypot(*sim.state.y[:2])))
    kd.Simulation(LORENZ, "rk4", dt=0.01).run(50, every=10, output=path, columns=[column])
    with kd.open(path) as run:
        assert run.energies is None
        assert run.columns == {"radius": ((), "")}
        np.testing.assert_array_equal(run.observables["radius"], np.hypot(run.y[:, 0], run.y[:, 1]))
    with pytest.raises(InputError, match="was begun with columns of the user"):
        kd.resume(path).run(10)
    kd.resume(path).run(10, columns=[column])
    with kd.open(path) as run:
        assert run.steps.tolist() == [0, 10, 20, 30, 40, 50, 60]
    for name in ("energy", "y", "y3"):
        bad = kd.Column(name, "", (), lambda sim: 0.0)
        with pytest.raises(InputError, match=f"column '{name}': a Problem's file uses this name"):
            kd.Simulation(LORENZ).run(10, output=path, overwrite=True, columns=[bad])


def test_what_is_in_a_file_is_told(path):
    kd.Simulation(PENDULUM).run(60, every=10, output=path)
    with kd.open(path) as run:
        found, text = info(run), describe(run)
    assert (found["problem"], found["unknowns"], found["samples"], found["steps"]) == ("ode-pendulum", 2, 7, [0, 60])
    for line in ("pendulum: omega = 1", "velocity-verlet", "0 to 3, steps 0 to 60", "properly, with a report"):
        assert line in text
    assert "was changed" not in text
    assert ("problem", "was changed after the run began, by its hash: the run cannot go on") in with_end(
        found | {"unchanged": False}, []
    )


# --- resuming ---

METHODS = {
    "fixed": (PENDULUM, {"integrator": "velocity-verlet"}, {"steps": 400}, {"steps": 1000}),
    "tolerance": (LORENZ, {"integrator": "dormand-prince45"}, {"until": 4.0}, {"until": 9.0}),
    "interval": (LORENZ, {"integrator": "dop853"}, {"until": 4.0, "interval": 0.5}, {"until": 9.0, "interval": 0.5}),
    "implicit": (LORENZ, {"integrator": "rosenbrock"}, {"until": 1.0}, {"until": 2.0}),
}


@pytest.mark.parametrize("suffix", [".h5", ".csv"])
def test_a_notebook_shows_a_card_with_the_energy(path, suffix):
    output = path.with_suffix(suffix)
    kd.Simulation(kd.load("ode-kepler")).run(time=1.0, output=output)
    with kd.open(output) as run:
        html, text = run._repr_html_(), str(run)
    assert "<svg" in html
    assert "energy error" in html
    assert "ode-kepler: 4 unknowns" in text or "unknowns          4" in text


@pytest.mark.parametrize("name", METHODS)
def test_a_resumed_run_has_the_same_bits(path, name):
    problem, given, part, whole = METHODS[name]
    first = kd.Simulation(problem, **given)
    first.run(**part, output=path)
    resumed = kd.resume(path)
    assert resumed.record.warnings == []
    np.testing.assert_array_equal(resumed.state.y, first.state.y)
    left = {"steps": whole["steps"] - part["steps"]} if "steps" in whole else whole
    resumed.run(**left)
    uninterrupted = kd.Simulation(problem, **given)
    uninterrupted.run(**whole)
    assert resumed.steps_done == uninterrupted.steps_done
    np.testing.assert_array_equal(resumed.state.y, uninterrupted.state.y)
    with kd.open(path) as run:
        np.testing.assert_array_equal(run.y[-1], uninterrupted.state.y)
        assert not run.damage()


def test_a_run_resumes_at_an_earlier_step(path):
    sim = kd.Simulation(PENDULUM)
    sim.run(300, every=50, output=path)
    earlier = kd.resume(path, step=120)
    whole = kd.Simulation(PENDULUM)
    whole.run(120)
    np.testing.assert_array_equal(earlier.state.y, whole.state.y)
    assert earlier.output is None
    assert earlier.report().energy.initial == PENDULUM.energy(0.0, PENDULUM.y0)


def test_a_killed_run_goes_on_with_the_same_bits(path, tmp_path):
    """The file is copied in the middle of the run, as a kill would leave it."""
    left = tmp_path / "left.h5"

    def kill(sim):
        if sim.steps_done == 600:
            shutil.copy(path, left)

    sim = kd.Simulation(PENDULUM)
    sim.run(1000, every=20, output=path, file=kd.FileOptions(flush=1e-9), observe=kill)
    with kd.open(left) as run:
        assert not run.closed
        assert run.report is None
        assert 0 < len(run) <= 31
        assert not run.damage()
    resumed = kd.resume(left)
    assert resumed.steps_done <= 600
    resumed.run()
    np.testing.assert_array_equal(resumed.state.y, sim.state.y)
    with kd.open(path) as one, kd.open(left) as other:
        np.testing.assert_array_equal(other.y, one.y)
        np.testing.assert_array_equal(other.energies, one.energies)


def test_a_damaged_end_is_computed_again(path):
    kd.Simulation(PENDULUM).run(200, every=20, output=path)
    with kd.open(path) as run:
        truth = run.y
    with h5py.File(path, "r+") as file:
        file["kickdrift/samples/y"][10, 1] += 1e-9
    with kd.open(path) as run:
        assert run.damage().samples == [10]
        with pytest.raises(InputError, match="damaged: sample 10 is not what was written"):
            run.y
    sim = kd.resume(path)
    assert sim.steps_done == 180
    assert "the file's end is damaged" in sim.record.warnings[0]
    sim.run()
    with kd.open(path) as run:
        np.testing.assert_array_equal(run.y, truth)


def test_a_changed_problem_is_refused(path):
    kd.Simulation(PENDULUM).run(20, output=path)
    with h5py.File(path, "r+") as file:
        file["kickdrift/problem/y0"][0] = 2.5
    with kd.open(path) as run:
        assert not run.unchanged
        with pytest.raises(InputError, match="damaged: its Problem was changed"):
            run.problem()
    with pytest.raises(InputError, match="its Problem was changed after the run began"):
        kd.resume(path)


def test_a_problem_made_in_python_is_given_again(path):
    sim = kd.Simulation(spring(), "leapfrog", dt=0.1)
    sim.run(40, output=path)
    refused = {
        "its Problem was made in Python, and a file holds no functions": {},
        "belongs to another Problem: f has other values": {"problem": spring(3.0)},
        "belongs to another Problem: y0 differ": {"problem": spring(start=(1.5, 0.0))},
        "belongs to another Problem: the number of unknowns, y0, separable differ": {"problem": LORENZ},
        "is the run of a Problem, not of a System": {"system": kd.load("two-body")},
        "problem: expected a Problem": {"problem": "spring"},
    }
    for message, given in refused.items():
        with pytest.raises(InputError, match=message):
            kd.resume(path, **given)
    resumed = kd.resume(path, problem=spring())
    resumed.run(60)
    sim.run(60)
    np.testing.assert_array_equal(resumed.state.y, sim.state.y)


def test_an_equation_with_another_f_is_one_made_in_python(path):
    other = replace(PENDULUM, f=lambda t, y: (y[1], -y[0]), energy=None, compiled=False)
    kd.Simulation(other).run(10, output=path)
    with pytest.raises(InputError, match="was made in Python"):
        kd.resume(path)


def test_events_are_given_again(path):
    crossing = kd.Crossing(lambda t, y: y[0], "bottom", -1)
    sim = kd.Simulation(PENDULUM, events=[crossing])
    sim.run(200, output=path)
    with kd.open(path) as run:
        assert [each["time"] for each in run.events] == [each["time"] for each in sim.events]
        assert run.events
    with pytest.raises(InputError, match="its run watched for bottom; give the same"):
        kd.resume(path)
    resumed = kd.resume(path, events=[crossing])
    for each in (sim, resumed):
        each.run(200)
    assert [each["time"] for each in resumed.events] == [each["time"] for each in sim.events]


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"equation": "os.system"}, "equation 'os.system' does not ship"),
        ({"parameters": {"mass": 1.0}}, "ode.mass: unknown key"),
        ({"parameters": {"omega": "1.0"}}, "ode.omega: "),
        ({"parameters": {"omega": -1.0}}, "omega: expected a positive number"),
        ({"run": {"integrator": "rk4", "dt": -1.0}}, "damaged: kickdrift/problem/record: run.dt"),
        ({"unknowns": 3}, "damaged: kickdrift/samples: expected a series y of 3 numbers"),
        ({"unknowns": 10**12}, "damaged: kickdrift/problem/record: unknowns"),
        ({"t0": "now"}, "damaged: kickdrift/problem/record: t0"),
    ],
)
def test_a_file_of_a_stranger_names_no_code(path, changes, message):
    """The record is data: names are looked up in the table of equations, and values are checked."""
    kd.Simulation(PENDULUM).run(10, output=path)
    with h5py.File(path, "r+") as file:
        own = file["kickdrift"]
        record = json.loads(own["problem/record"].asstr()[()]) | changes
        own["problem/record"][()] = json.dumps(record)
        own.attrs["sha256"] = problem_hash(file)
    with pytest.raises(InputError, match=re.escape(message)) as caught:
        kd.resume(path)
    assert str(caught.value).count("\n") == 0


# --- tables ---


@pytest.mark.parametrize("suffix", [".csv", ".parquet"])
def test_a_table_has_every_bit(tmp_path, path, suffix):
    table = tmp_path / f"run{suffix}"
    column = kd.Column("twice", "", (2,), lambda sim: 2.0 * sim.state.y)
    for output in (path, table):
        kd.Simulation(PENDULUM).run(90, every=10, output=output, columns=[column])
    with kd.open(path) as run, kd.open(table) as found:
        assert isinstance(found, ProblemTable)
        assert len(found) == len(run) == 10
        assert [*found.series()] == ["time", "y0", "y1", "energy", "twice_0", "twice_1"]
        for name, values in run.series().items():
            np.testing.assert_array_equal(found.series()[name], values)
        np.testing.assert_array_equal(found.y, run.y)
    read = np.genfromtxt(table, delimiter=",", names=True) if suffix == ".csv" else pandas.read_parquet(table)
    np.testing.assert_array_equal(read["energy"], found.energies)
    assert (found.report is None) == (suffix == ".csv")
    assert found.name == ("" if suffix == ".csv" else "ode-pendulum")
    with pytest.raises(InputError, match="is a table, which holds no checkpoint"):
        kd.resume(table)


def test_a_table_is_whole_or_absent(tmp_path):
    table = tmp_path / "run.csv"
    sim = kd.Simulation(PENDULUM)
    sim.run(10, output=table, observe=lambda sim: [*tmp_path.iterdir()] and pytest.fail("written before the end"))
    whole = table.read_bytes()
    with pytest.raises(InputError, match="exists already"):
        sim.run(10, output=table)
    assert table.read_bytes() == whole
    sim.run(10, output=table, overwrite=True)
    assert table.read_bytes() != whole
    table.write_text("my own,table\n1,2\n", encoding="utf-8")
    with pytest.raises(InputError, match="is not the table of a Problem's run that kickdrift wrote"):
        sim.run(10, output=table, overwrite=True)
    with pytest.raises(InputError, match="is not the table of a Problem's run"):
        kd.open(table)


def test_a_run_that_fails_leaves_what_it_has_seen(tmp_path):
    growing = kd.Problem(lambda t, y: (y[0] ** 2,), [1.0], compiled=False)
    for name in ("run.h5", "run.csv"):
        with pytest.raises(RunError, match="step 22"):
            kd.Simulation(growing, "euler", dt=0.1).run(100, every=1, output=tmp_path / name)
        with kd.open(tmp_path / name) as run:
            assert run.report is None
            assert len(run) > 5
            assert np.isfinite(run.y).all()


# --- kinds of files ---


def test_files_of_other_kinds_are_told_apart(path, tmp_path):
    kd.Simulation(PENDULUM).run(10, output=path)
    kd.Simulation(PENDULUM).run(10, output=tmp_path / "run.parquet")
    assert kinds.is_ours(path, kinds.PROBLEM)
    assert not kinds.is_ours(path, kinds.TABLE)
    assert not kinds.is_ours(path, kinds.RUN)
    assert not kinds.is_ours(tmp_path / "run.parquet", kinds.TABLE)
    ensemble = tmp_path / "ensemble.h5"
    with h5py.File(ensemble, "w") as file:
        file.attrs["kickdrift"], file.attrs["columns"] = "{}", ["member"]
        file["table/member"] = [0]
    assert kinds.is_ours(ensemble, kinds.TABLE)
    assert not kinds.is_ours(ensemble, kinds.PROBLEM)
    with pytest.raises(InputError, match=r"is the table of an ensemble, which kd.Ensemble.read opens"):
        kd.open(ensemble)
    with pytest.raises(InputError, match=r"is not the file of a Problem's run that kickdrift wrote"):
        kd.Simulation(PENDULUM).run(10, output=ensemble, overwrite=True)
    renamed = tmp_path / "run.h5md"
    shutil.copy(path, renamed)
    with pytest.raises(InputError, match="is the file of a Problem's run, which has no particles"):
        kd.open(renamed)


@pytest.mark.parametrize("name", ["run.h5md", "run.dat", "run"])
def test_a_suffix_of_another_kind_is_refused(tmp_path, name):
    with pytest.raises(InputError, match=r"the name of a Problem's run must end in \.h5, \.csv, \.parquet"):
        kd.Simulation(PENDULUM).run(10, output=tmp_path / name)
    with pytest.raises(InputError, match=r"must end in \.h5md"):
        kd.Simulation(kd.load("two-body")).run(10, output=tmp_path / "run.csv")
    assert not [*tmp_path.iterdir()]


def test_options_of_frames_are_refused(path):
    with pytest.raises(InputError, match="store: is for the frames of particles"):
        kd.Simulation(PENDULUM).run(10, output=path, file=kd.FileOptions(store="float32"))
    with pytest.raises(InputError, match="a table has no options"):
        kd.Simulation(PENDULUM).run(10, output=path.with_suffix(".csv"), file=kd.FileOptions(flush=1.0))


def test_the_commands(kickdrift, tmp_path):
    run, table = tmp_path / "run.h5", tmp_path / "run.csv"
    assert kickdrift("run", "ode-pendulum", "--steps", "100", "--output", run)[0] == 0
    status, out, err = kickdrift("resume", run, "--time", "10")
    assert (status, f"{run}: continues from step 100" in err) == (0, True)
    assert "200 steps" in out
    status, out, _ = kickdrift("info", run)
    assert (status, "200 steps, 10\n" in out, "the run is finished" in out) == (0, True, True)
    status, out, _ = kickdrift("info", run, "--all")
    assert (status, "steps 0 to 200" in out) == (0, True)
    assert kickdrift("run", "ode-pendulum", "--steps", "100", "--output", table)[0] == 0
    status, out, _ = kickdrift("info", table)
    assert (status, "unknowns    2" in out) == (0, True)
    before = table.read_bytes()
    refused = [
        (("resume", table), "is a table, which holds no checkpoint"),
        (("run", "ode-pendulum", "--output", tmp_path / "a.h5md"), "must end in .h5, .csv, .parquet"),
        (("run", "lj-1000", "--output", tmp_path / "a.h5"), "must end in .h5md"),
        (("run", "ode-pendulum", "--output", tmp_path / "a.foo"), "must end in .h5md, .h5, .csv, .parquet"),
        (("run", "ode-pendulum", "--output", table), "exists already"),
        (("export", run, tmp_path / "a.dcd"), "is the file of a Problem's run, which has no particles"),
    ]
    for words, message in refused:
        status, _, err = kickdrift(*words)
        assert (status, err.count("\n")) == (2, 1), err
        assert message in err
    assert table.read_bytes() == before

"""Ensembles on real workers: rows equal those of single runs, whatever happens to the workers."""

from __future__ import annotations

import functools
import json
import os
import re
import signal
import subprocess
import sys
from pathlib import Path

import numpy as np
import psutil
import pytest
from typer.testing import CliRunner

import kickdrift as kd
from kickdrift.batch.batch import Batch
from kickdrift.cli.main import app
from kickdrift.ensemble import running, table
from kickdrift.errors import InputError, RunError

STEPS = 40
SYSTEM = """units = "nbody"
[particles]
central = {{ body = "Star", mass = 1.0 }}
elements = [{{ body = "b", mass = 1e-3, a = 1.0, e = 0.1 }}, {{ body = "c", mass = 1e-4, a = 1.7, M = 60.0 }}]
[[force]]
type = "gravity"
[run]
integrator = "leapfrog"
dt = 0.05
steps = {steps}
every = 20
"""
VARY = {"particles.elements[c].a": [1.5, 1.6, 1.7], "particles.elements[b].e": "uniform:0:0.2"}


@pytest.fixture(scope="module")
def client():
    with running.workers(2) as found:
        yield found


@pytest.fixture
def system(tmp_path) -> Path:
    path = tmp_path / "planets.toml"
    path.write_text(SYSTEM.format(steps=STEPS))
    return path


def same(one, other) -> bool:
    """Whether two tables are equal except for the wall time."""
    columns = [name for name in one.columns if name != "wall_seconds"]
    return list(one.columns) == list(other.columns) and one[columns].equals(other[columns])


def kinetic(sim):
    return sim.energy().kinetic


def test_rows_are_the_runs_that_the_seeds_and_values_give(system, client):
    ensemble = kd.Ensemble(system, VARY, replicas=2, seed=5)
    found = ensemble.run(client)
    assert found["member"].tolist() == list(range(6))
    assert (found["status"] == "done").all()
    assert found["particles.elements[c].a"].tolist() == [1.5, 1.6, 1.7] * 2
    row = found.iloc[4]
    text = SYSTEM.format(steps=STEPS).replace("e = 0.1", f"e = {float(row['particles.elements[b].e'])!r}")
    path = system.with_name("one.toml")
    path.write_text(text.replace("a = 1.7", "a = 1.6"))
    report = kd.Simulation(kd.load(path)).run(STEPS)
    assert report.energy is not None
    batch = Batch([kd.load(path)])
    batch.run(STEPS)
    assert row["energy_max_relative_error"] == batch.report(0).energy.max_relative_error
    for name, value in {
        "energy_max_relative_error": report.energy.max_relative_error,
        "energy_drift": report.energy.drift_per_unit_time,
        "angular_momentum_error": report.angular_momentum_error,
        "steps": report.steps,
        "time": report.time,
    }.items():
        assert row[name] == pytest.approx(value, rel=1e-6, abs=1e-13), name  # side by side, sums have another order


def test_the_table_does_not_depend_on_the_workers_or_the_size(system, client):
    few, many = (kd.Ensemble(system, VARY, replicas=n, seed=5).run(client) for n in (1, 3))
    with running.workers(1) as alone:
        assert same(kd.Ensemble(system, VARY, replicas=3, seed=5).run(alone), many)
    assert same(many.iloc[:3].reset_index(drop=True), few)
    other = kd.Ensemble(system, VARY, seed=6).run(client)
    assert not np.isclose(other["particles.elements[b].e"], few["particles.elements[b].e"]).any()


def test_what_is_drawn_is_drawn_by_each_members_seed(client):
    found = kd.Ensemble("lj-1000", replicas=2, steps=2, every=2).run(client)
    reports = [kd.Simulation(kd.load("lj-1000", seed=seed)).run(2, every=2) for seed in found["seed"].tolist()]
    assert found["pressure"].tolist() == [report.pressure for report in reports]
    seeded = kd.Ensemble("lj-1000", {"velocities.seed": [7, 7]}, steps=2, every=2).run(client)
    assert seeded["pressure"][0] == seeded["pressure"][1]


def test_failures_are_rows_with_their_last_state(system, client):
    vary = {"particles.elements[b].e": [0.1, 1.5, 0.1], "dt": [0.05, 1e200]}
    found = kd.Ensemble(system, vary).run(client)
    assert found["status"].tolist() == ["done", "failed", "failed", "failed", "done", "failed"]
    assert "an ellipse" in found["error"][2] or "semi-major axis" in found["error"][2]
    assert "elements[0] (b)" in found["error"][2]
    assert "blew up at step" in found["error"][1]
    assert found["last_step"][1] == 0
    start = kd.load(system).state
    assert np.array_equal(np.reshape(found["last_positions"][1], (3, 3)), start.positions)
    assert np.array_equal(np.reshape(found["last_velocities"][1], (3, 3)), start.velocities)
    assert found["last_positions"][0] is None
    assert np.isnan(found["energy_max_relative_error"][1])


def test_measures_of_the_users_own(system, client):
    found = kd.Ensemble(system, {"dt": [0.05, 0.1]}, measure=kinetic).run(client)
    assert found["kinetic"][0] == kinetic(after_run(system))
    pair = kd.Ensemble(system, measure=lambda sim: {"x": np.float64(1.5), "name": "a"}).run(client)
    assert (pair["x"][0], pair["name"][0]) == (1.5, "a")
    failed = kd.Ensemble(system, {"dt": [0.05, 0.1]}, measure=lambda sim: 1 / (sim.dt - 0.05)).run(client)
    assert failed["status"].tolist() == ["failed", "done"]
    assert failed["error"][0] == "ZeroDivisionError: float division by zero"


def after_run(system) -> kd.Simulation:
    sim = kd.Simulation(kd.load(system))
    sim.run(STEPS)
    return sim


@pytest.mark.long
def test_megno_is_that_of_one_run(system, client):
    found = kd.Ensemble(system, {"particles.elements[c].a": [1.3, 1.7]}, measure="megno", integrator="yoshida4", seed=3)
    row = found.run(client).iloc[1]
    alone = kd.megno(kd.load(system), integrator="yoshida4", dt=0.05, seed=int(row["seed"]))
    assert row["megno"] == pytest.approx(alone.megno, rel=1e-9)
    assert row["verdict"] == alone.verdict


def test_systems_from_a_function_and_systems_made_already(system, client):
    def trap(stiffness: float, seed: int) -> kd.System:
        x = np.random.default_rng(seed).normal(size=(2, 3))
        return kd.System(x, forces=[kd.HarmonicTrap(stiffness)])

    ensemble = kd.Ensemble(trap, {"stiffness": [1.0, 4.0]}, replicas=2, steps=10, dt=[0.01][0], every=10)
    found = ensemble.run(client)
    assert (found["status"] == "done").all()
    sim = kd.Simulation(trap(4.0, int(found["seed"][3])), "velocity-verlet", 0.01)
    assert found["energy_max_relative_error"][3] == sim.run(10, every=10).energy.max_relative_error
    made = kd.Ensemble(kd.load(system), {"integrator": ["leapfrog", "yoshida4"]}).run(client)
    assert made["integrator"].tolist() == ["leapfrog", "yoshida4"]
    assert made["energy_max_relative_error"][1] < made["energy_max_relative_error"][0]


@pytest.mark.parametrize("suffix", table.SUFFIXES)
def test_an_ensemble_goes_on_where_it_stopped(system, client, suffix):
    output = system.with_name(f"out{suffix}")
    ensemble = kd.Ensemble(system, VARY, replicas=2)
    truth = ensemble.run(client)

    def stop(done: int, of: int, failed: int) -> None:
        if done >= 2:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        ensemble.run(client, output=output, progress=stop)
    journal = output.with_name(f"{output.name}.journal")
    kept = journal.read_text().splitlines()
    assert not output.exists()
    assert len(kept) >= 3
    with journal.open("a") as file:
        file.write('{"member": 5, "sta')  # as a kill may leave the file
    seen: list[int] = []
    found = ensemble.run(client, output=output, progress=lambda done, of, failed: seen.append(done))
    assert seen[0] == len(kept) - 1
    assert same(found, truth)
    assert not journal.exists()
    read = kd.Ensemble.read(output)
    assert same(read.drop(columns="wall_seconds"), found.drop(columns="wall_seconds"))
    assert read.attrs["kickdrift"]["source"] == system.read_text()
    assert read.attrs["kickdrift"]["grids"] == {"particles.elements[c].a": [1.5, 1.6, 1.7]}
    more = kd.Ensemble(system, VARY, replicas=3).run(client, output=output)
    assert same(more.iloc[:6].reset_index(drop=True), truth)
    with pytest.raises(InputError, match="holds 9 members of this ensemble, more than the requested 6"):
        ensemble.run(client, output=output)
    with pytest.raises(InputError, match="another seed; use --overwrite"):
        kd.Ensemble(system, VARY, seed=1).run(client, output=output)
    system.write_text(SYSTEM.format(steps=STEPS + 1))
    with pytest.raises(InputError, match="another system; use --overwrite"):
        kd.Ensemble(system, VARY).run(client, output=output)
    assert len(kd.Ensemble(system, VARY).run(client, output=output, overwrite=True)) == 3


def test_members_that_failed_and_texts_go_on_as_they_were(system, client, tmp_path):
    def told(sim):
        return {"word": "far" if sim.dt > 0.06 else None, "truth": sim.dt > 0.06, "list": 2**70}

    for suffix in table.SUFFIXES:
        output = tmp_path / f"out{suffix}"
        ensembles = [
            kd.Ensemble(system, {"dt": [0.05, 0.1, 1e200], "particles.elements[b].e": "uniform:0:0.1"},
                        replicas=n, measure=told) for n in (1, 2)
        ]  # fmt: skip
        first = ensembles[0].run(client, output=output)
        assert same(ensembles[0].run(client, output=output), first)
        begun = first.attrs["kickdrift"]["begun"]
        more = ensembles[1].run(client, output=output)
        assert more["status"].tolist() == ["done", "done", "failed"] * 2
        assert same(more, ensembles[1].run(client))
        assert more["word"].tolist()[:2] == first["word"].tolist()[:2]
        assert (more.attrs["kickdrift"]["begun"], more.attrs["kickdrift"]["replicas"]) == (begun, 2)


def test_lists_of_any_kind_are_values(client, tmp_path):
    start = [[[0.1, 0.0, 0.0], [-0.1, 0.0, 0.0]], [[0.2, 0.0, 0.0], [-0.2, 0.0, 0.0]]]
    for suffix in table.SUFFIXES:
        found = kd.Ensemble("two-body", {"velocities.values": start}, steps=4).run(
            client, output=tmp_path / f"out{suffix}"
        )
        assert [json.loads(text) for text in found["velocities.values"]] == start
        assert same(kd.Ensemble.read(tmp_path / f"out{suffix}"), found)


def test_an_ensemble_of_an_ode(client):
    found = kd.Ensemble("ode-lorenz", {"ode.rho": [20.0, 28.0]}, time=1.0).run(client)
    assert (found["status"] == "done").all()
    sim = kd.Simulation(kd.load("ode-lorenz"))
    sim.run(until=1.0)
    assert found[["y0", "y1", "y2"]].to_numpy()[1].tolist() == sim.state.y.tolist()


def test_another_function_or_system_is_another_ensemble(system, client, tmp_path):
    def times(factor):
        return lambda sim: factor * sim.time

    def helper(sim):
        return kinetic(sim)

    output = tmp_path / "out.parquet"
    made = kd.load(system)
    kd.Ensemble(made, measure=times(2.0)).run(client, output=output)
    assert len(kd.Ensemble(made, measure=times(2.0)).run(client, output=output)) == 1
    for other in (times(3.0), helper, functools.partial(helper)):
        with pytest.raises(InputError, match="another measure"):
            kd.Ensemble(made, measure=other).run(client, output=output)
    state = made.state
    heavier = kd.System(state.positions, state.velocities, state.masses * 2, forces=made.forces, units="nbody",
                        run=made.run, name=made.name)  # fmt: skip
    with pytest.raises(InputError, match="another system"):
        kd.Ensemble(heavier, measure=times(2.0)).run(client, output=output)
    with pytest.raises(InputError, match="another system"):
        kd.Ensemble(made.with_run(dt=0.01), measure=times(2.0)).run(client, output=output)
    with pytest.raises(InputError, match="another trajectories"):
        kd.Ensemble(made, measure=times(2.0)).run(client, output=output, trajectories=tmp_path / "frames")


def test_a_time_replaces_the_steps_of_a_system(system, client):
    found = kd.Ensemble(kd.load(system), {"time": [1.0, 2.0]}).run(client)
    assert found["steps"].tolist() == [20, 40]
    assert found["time"].tolist() == [1.0, 2.0]


def test_only_one_process_writes_a_table(system, client, tmp_path):
    output = tmp_path / "out.parquet"
    ensemble = kd.Ensemble(system, VARY)

    def again(done: int, of: int, failed: int) -> None:
        with pytest.raises(InputError, match="another process is at work on it"):
            ensemble.run(client, output=output)

    ensemble.run(client, output=output, progress=again)
    assert [path.name for path in tmp_path.iterdir() if "out" in path.name] == ["out.parquet"]


@pytest.mark.parametrize(
    ("vary", "options", "said"),
    [
        ({"member": [1]}, {}, "vary: member: every table has a column of this name"),
        ({"dt": [0.1], "run.dt": [0.2]}, {}, "vary: run.dt: is given twice, as dt too"),
        ({"run.dt": [0.1]}, {"dt": 0.2}, "vary: run.dt: is given twice, as dt too"),
        ({"dt": [float("nan")]}, {}, "expected finite numbers"),
        ({"dt": "0.1,"}, {}, "expected values between the commas"),
        ({"masses[²]": [1]}, {}, "there is no 'masses'"),
    ],
)
def test_keys_and_values_that_make_no_sense(system, vary, options, said):
    with pytest.raises(InputError, match=re.escape(said)):
        kd.Ensemble(system, vary, **options)


def test_seeds_on_a_grid_leave_nothing_to_replicas():
    with pytest.raises(InputError, match="is random"):
        kd.Ensemble("lj-1000", {"velocities.seed": [1, 2]}, replicas=2)


def test_columns_of_a_run_are_not_measured(system, client):
    found = kd.Ensemble(system, measure=lambda sim: {"time": 1.0}).run(client)
    assert found["error"][0] == "measure: time: every run has a column of this name; choose another"


def test_trajectories_of_the_members(system, client):
    folder = system.with_name("frames")
    found = kd.Ensemble(system, {"particles.elements[b].e": [0.0, 0.1]}).run(client, trajectories=folder)
    with kd.open(folder / "member-000001.h5md") as run:
        assert len(run) == 3
        assert "e = 0.1" in run.system_source
        assert run[0].step == 0
    assert (found["status"] == "done").all()
    assert sorted(path.name for path in folder.iterdir()) == ["member-000000.h5md", "member-000001.h5md"]
    with pytest.raises(InputError, match=r"member-000000.h5md exists already"):
        kd.Ensemble(system, {"particles.elements[b].e": [0.0, 0.1]}).run(client, trajectories=folder)


@pytest.mark.long
def test_a_member_that_kills_its_workers_is_lost_and_the_others_are_done(system, tmp_path):
    def deadly(sim):
        if sim.dt == 0.1:
            os.kill(os.getpid(), signal.SIGKILL)
        return 1.0

    output = tmp_path / "out.parquet"
    ensemble = kd.Ensemble(system, {"dt": [0.05, 0.1, 0.025]}, steps=4, measure=deadly)
    found = ensemble.run(workers=2, output=output)
    assert found["status"].tolist() == ["done", "lost", "done"]
    assert found["error"][1] == "each worker that ran it died"


@pytest.mark.long
def test_workers_that_die_are_replaced(system):
    vary = {"particles.elements[c].a": "1.5:1.7:16"}
    ensemble = kd.Ensemble(system, vary, steps=1000, every=1)
    killed: list[int] = []

    def kill(done: int, of: int, failed: int) -> None:
        if done > 5 * len(killed) and len(killed) < 2:
            children = [child for child in psutil.Process().children() if "spawn_main" in " ".join(child.cmdline())]
            killed.append(children[0].pid)
            os.kill(killed[-1], signal.SIGKILL)

    found = ensemble.run(workers=2, progress=kill)
    assert len(killed) == 2
    assert same(found, ensemble.run(workers=2))


def test_the_command_line(system, tmp_path):
    output = tmp_path / "map.parquet"
    command = ["ensemble", str(system), "--vary", "particles.elements[c].a=1.5:1.7:2", "--vary", "dt=0.05,0.1",
               "--workers", "1", "--output", str(output)]  # fmt: skip
    done = CliRunner().invoke(app, command)
    assert done.exit_code == 0, done.output
    assert "4 members, root seed 0" in done.output
    assert "4 done" in done.output
    again = CliRunner().invoke(app, command)
    assert again.exit_code == 0
    assert "4 of 4 members are already done" in again.output
    assert len(kd.Ensemble.read(output)) == 4
    assert CliRunner().invoke(app, ["info", str(output)]).stdout == done.stdout
    failing = CliRunner().invoke(app, ["ensemble", str(system), "--vary", "dt=1e200,1e201", "--workers", "1"])
    assert failing.exit_code == 1
    assert failing.output.count("blew up at step") == 2


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (["--vary", "dt"], "expected KEY=VALUES"),
        (["--vary", "dt=0.1", "--vary", "dt=0.2"], "dt is given twice"),
        (["--vary", "dt=0.1", "--dt", "0.2"], "vary: dt: is given twice, as dt too"),
        (["--vary", "dx=0.1"], "dx: unknown key"),
        (["--vary", "temprature=1,2"], "vary: temprature: there is no such key; did you mean 'temperature'?"),
        (["--vary", "temperature=1,2"], "does not take it; baoab, obabo"),
        (["--replicas", "2"], "is random"),
        (["--vary", "particles.elements[b].m=1"], "unknown key"),
        (["--scheduler", "nowhere"], "--scheduler nowhere: cannot be reached"),
        (["--scheduler", "tcp://127.0.0.1:1", "--workers", "2"], "give --workers or --scheduler"),
        (["--measure", "f.py:g"], "there is no Python file f.py"),
        (["--output", "out.csv"], "must end in .parquet, .h5"),
        (["--integrator", "leap"], "leap"),
    ],
)
def test_bad_input_is_one_line(system, arguments, said, kickdrift):
    code, out, err = kickdrift("ensemble", system, *arguments)
    assert code == 2, err
    assert said in err
    assert err.count("\n") == 1
    assert out == ""


def test_a_scheduler_that_is_not_there(monkeypatch):
    monkeypatch.setattr(running, "PATIENCE", 0.2)
    with (
        pytest.raises(InputError, match=r"--scheduler tcp://127.0.0.1:1: cannot be reached"),
        running.workers(scheduler="tcp://127.0.0.1:1"),
    ):
        pass


def test_measures_that_workers_cannot_load(system, client):
    import types

    module = types.ModuleType("nowhere_to_be_found")
    exec("def measure(sim): return 1.0", vars(module))
    sys.modules[module.__name__] = module
    try:
        with pytest.raises(InputError, match="the workers cannot load the members' code: No module named 'nowhere"):
            kd.Ensemble(system, measure=module.measure).run(client)
    finally:
        del sys.modules[module.__name__]


def test_workers_with_another_kickdrift(system, client, monkeypatch):
    monkeypatch.setattr("kickdrift.ensemble.work.VERSION", "0.0.1")
    with pytest.raises(InputError, match=r"has kickdrift \d.*, this process has 0\.0\.1"):
        kd.Ensemble(system).run(client)


@pytest.mark.long
def test_a_script_needs_no_guard(system, tmp_path):
    script = tmp_path / "script.py"
    script.write_text(
        "import kickdrift as kd\n"
        "def speed(sim):\n    return float(abs(sim.state.velocities).max())\n"
        f"table = kd.Ensemble({str(system)!r}, {{'dt': [0.05, 0.1]}}, measure=speed).run(workers=1)\n"
        "print(table['speed'].notna().all(), __file__)\n"
    )
    done = subprocess.run([sys.executable, "-W", "error", str(script)], capture_output=True, text=True)
    assert done.stdout.split() == ["True", str(script)], done.stderr


def test_a_journal_that_is_none(system, client, tmp_path):
    output = tmp_path / "out.parquet"
    journal = tmp_path / "out.parquet.journal"
    journal.write_text("hello\n")
    with pytest.raises(InputError, match="is no journal of an ensemble"):
        kd.Ensemble(system, VARY).run(client, output=output)
    journal.write_text(json.dumps({"identity": {}}) + "\n")
    with pytest.raises(InputError, match="holds an ensemble with another"):
        kd.Ensemble(system, VARY).run(client, output=output)
    assert RunError.exit_status == 1


@pytest.mark.long
def test_a_notebook_shows_a_table_with_the_energy_errors(tmp_path):
    pd = pytest.importorskip("pandas")
    made = table.frame(
        [
            {"member": k, "status": "done" if k else "failed", "energy_rms_relative_error": 1e-5 * k or None}
            for k in range(4)
        ],
        {"name": "x"},
    )
    html = made._repr_html_()
    assert "3 of 4 members done; RMS energy error by member" in html
    assert "<polyline" in html
    assert "<table" in html
    assert type(made[["member"]]) is pd.DataFrame
    table.write(made, tmp_path / "x.parquet")
    again = table.read(tmp_path / "x.parquet")
    assert again._repr_html_() == html
    assert again.attrs == made.attrs

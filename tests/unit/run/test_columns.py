"""The user's own columns: written at each look, read back, shown, and refused if they make no sense."""

from __future__ import annotations

import numpy as np
import pytest
from typer.testing import CliRunner

import kickdrift as kd
from kickdrift.cli.main import app
from kickdrift.errors import InputError, RunError
from kickdrift.looks import observers
from kickdrift.looks.columns import KNOWN, OWN
from kickdrift.trajectory.read.info import describe, info
from tests.systems import liquid


def gyration(sim) -> float:
    x = sim.state.positions
    return float(np.sqrt(((x - x.mean(axis=0)) ** 2).sum(axis=1).mean()))


def inertia(sim) -> np.ndarray:
    x = sim.state.positions
    return x.T @ x


RADIUS = kd.Column("radius_of_gyration", "length", (), gyration)
INERTIA = kd.Column("inertia", "", (3, 3), inertia)
FAST = kd.Column("fastest", "velocity", (2,), lambda sim: np.sort(np.linalg.norm(sim.state.velocities, axis=1))[-2:])


def kickdrift(*words):
    return CliRunner().invoke(app, [*map(str, words)])


def make() -> kd.Simulation:
    return kd.Simulation(liquid(), dt=0.004)


def test_they_are_written_and_read_back(tmp_path):
    sim, seen = make(), []
    sim.run(
        30, every=10, output=tmp_path / "a.h5md", columns=[RADIUS, INERTIA, FAST],
        observe=lambda sim: seen.append((gyration(sim), inertia(sim))),
    )  # fmt: skip
    with kd.open(tmp_path / "a.h5md") as run:
        radii, tensors = (np.array(each) for each in zip(*seen, strict=True))
        np.testing.assert_array_equal(run.observables["radius_of_gyration"], radii)
        np.testing.assert_array_equal(run.observables["inertia"], tensors)
        np.testing.assert_array_equal(run[1:3].observables["inertia"], tensors[1:3])
        assert run[-1:].observables["fastest"].shape == (1, 2)
        assert run.columns == {
            "radius_of_gyration": ((), "sigma"), "inertia": ((3, 3), ""), "fastest": ((2,), "sigma/tau")
        }  # fmt: skip
        assert run.unit_of("total_energy") == "epsilon"
        frame = run.to_pandas()
        assert frame["radius_of_gyration"].tolist() == radii.tolist()
        assert frame["inertia_x_z"].tolist() == tensors[:, 0, 2].tolist()
        assert frame["fastest_1"].tolist() == run.observables["fastest"][:, 1].tolist()
        assert frame.attrs["units"]["radius_of_gyration"] == "sigma"
        assert frame.attrs["units"]["total_energy"] == "epsilon"
        table = run.to_xarray()
        assert table["inertia"].shape == (4, 3, 3)
        assert table["fastest"].attrs["units"] == "sigma/tau"
    assert [sample.columns["radius_of_gyration"] for sample in sim.record.samples] == radii.tolist()
    assert info(tmp_path / "a.h5md")["columns"]["fastest"] == {"shape": [2], "unit": "sigma/tau"}
    lines = describe(info(tmp_path / "a.h5md")).splitlines()
    assert any(line.split()[0] == "radius_of_gyration" and line.endswith(" σ") for line in lines)


def test_they_change_no_bits_and_no_file_without_them(tmp_path):
    plain, with_columns = make(), make()
    plain.run(50, every=5)
    with_columns.run(50, every=5, columns=[RADIUS, INERTIA])
    assert plain.state.phase.tobytes() == with_columns.state.phase.tobytes()
    assert plain.record.looks.rows[:11].tobytes() == with_columns.record.looks.rows[:11].tobytes()
    assert plain.record.samples[3].columns == {}


@pytest.mark.parametrize("integrator", ["dop853", "gauss-radau15"])
def test_an_adaptive_run_has_them_at_its_own_looks(integrator, tmp_path):
    sim = kd.Simulation(kd.load("solar-system"), integrator)
    clock = kd.Column("clock", "time", (), lambda sim: sim.time)
    sim.run(until=sim.time + 0.1, interval=0.01, output=tmp_path / "a.h5md", columns=[clock])
    with kd.open(tmp_path / "a.h5md") as run:
        np.testing.assert_array_equal(run.observables["clock"], run.sample_times)
        assert run.columns["clock"] == ((), "yr")


def test_a_problem_keeps_them_in_its_samples():
    problem = kd.Problem(lambda t, y: [y[1], -y[0]], [1.0, 0.0])
    sim = kd.Simulation(problem, "rk4", dt=0.1)
    sim.run(10, every=5, columns=[kd.Column("amplitude", "", (), lambda sim: np.hypot(*sim.state.y))])
    assert [sample.step for sample in sim.record.samples] == [0, 5, 10]
    np.testing.assert_allclose([s.columns["amplitude"] for s in sim.record.samples], 1.0, atol=1e-5)


def test_nan_and_infinity_are_numbers(tmp_path):
    path = tmp_path / "a.h5md"
    odd = kd.Column("odd", "", (), lambda sim: np.nan if sim.steps_done else np.inf)
    make().run(10, every=10, output=path, columns=[odd])
    with kd.open(path) as run:
        np.testing.assert_array_equal(run.observables["odd"], [np.inf, np.nan])
    found = kickdrift("info", path, "--all")
    assert found.exit_code == 0
    assert "inf → nan" in found.output


def test_a_run_goes_on_with_the_same_columns(tmp_path):
    path, sim = tmp_path / "a.h5md", make()
    sim.run(20, every=10, output=path, columns=[RADIUS, FAST])
    before = path.read_bytes()
    other = kd.Column("fastest", "velocity", (3,), lambda sim: np.zeros(3))
    refused = [
        ((), r"a\.h5md: was begun with columns .*radius_of_gyration, fastest.*kd\.resume\(file\)\.run\(columns="),
        ([RADIUS], "was begun with the columns radius_of_gyration, fastest, got radius_of_gyration"),
        ([RADIUS, other], r"column 'fastest' was begun with shape \(2,\) and unit 'sigma/tau', got \(3,\)"),
    ]
    for columns, culprit in refused:
        with pytest.raises(InputError, match=culprit):
            sim.run(10, output=path, columns=columns)
        assert path.read_bytes() == before
    sim.run(10, output=path, columns=[FAST, RADIUS])
    with kd.open(path) as run:
        assert run.sample_steps.tolist() == [0, 10, 20, 30]
        assert np.isfinite(run.observables["fastest"]).all()
    plain = make()
    plain.run(10, every=10, output=tmp_path / "plain.h5md")
    with pytest.raises(InputError, match="was begun without columns, got fastest"):
        plain.run(10, output=tmp_path / "plain.h5md", columns=[FAST])


def test_resume_needs_them_again(tmp_path):
    path, whole = tmp_path / "a.h5md", make()
    whole.run(20, every=10, output=path, columns=[RADIUS])
    before = path.read_bytes()
    refused = kickdrift("resume", path, "--steps", "40")
    assert isinstance(refused.exception, InputError)
    assert "radius_of_gyration" in str(refused.exception)
    assert path.read_bytes() == before
    assert kickdrift("resume", path).exit_code == 0  # the run is finished
    sim = kd.resume(path)
    assert [sample.columns for sample in sim.record.samples] == [sample.columns for sample in whole.record.samples]
    sim.run(20, columns=[RADIUS])
    whole.run(20, columns=[RADIUS])
    with kd.open(path) as run:
        wanted = [sample.columns["radius_of_gyration"] for sample in whole.record.samples if sample.step % 10 == 0]
        assert run.observables["radius_of_gyration"].tolist() == wanted
    kd.resume(path).run(10, output=tmp_path / "b.h5md")
    with kd.open(tmp_path / "b.h5md") as run:
        assert run.columns == {}


@pytest.mark.parametrize(
    ("given", "culprit"),
    [
        (lambda sim: [1.0, 2.0], r"returned an array of shape \(2,\); expected \(\)"),
        (lambda sim: "fast", "returned 'fast'; expected a number"),
        (lambda sim: None, "returned None; expected a number"),
        (lambda sim: 1j, "returned 1j; expected a number"),
        (lambda sim: [[1.0], [1.0, 2.0]], r"returned .*; expected a number or an array of numbers"),
        (lambda sim: 1 / 0, "raised ZeroDivisionError: division by zero"),
        (lambda sim: setattr(sim, "state", sim.state), "raised InputError: state: is read-only"),
        (lambda sim: sim.run(5), "raised InputError: run: the Simulation is already running"),
    ],
)
def test_a_function_that_returns_something_else_is_named_at_the_first_look(given, culprit, tmp_path):
    sim, path = make(), tmp_path / "a.h5md"
    make().run(10, output=tmp_path / "old.h5md")
    old = (tmp_path / "old.h5md").read_bytes()
    for target, more in ((path, {}), (tmp_path / "old.h5md", {"overwrite": True})):
        with pytest.raises(InputError, match=rf"column 'mine': step 0 \(t = 0\): {culprit}"):
            sim.run(10, output=target, columns=[RADIUS, kd.Column("mine", "", (), given)], **more)
    assert not path.exists()
    assert (tmp_path / "old.h5md").read_bytes() == old
    assert sim.steps_done == 0
    assert not sim.running


def test_a_later_failure_leaves_a_file_that_goes_on(tmp_path):
    path, sim = tmp_path / "a.h5md", make()
    late = kd.Column("late", "", (), lambda sim: [1.0] if sim.steps_done == 20 else 1.0)
    with pytest.raises(RunError, match=r"column 'late': step 20 \(t = 0\.08\): returned an array of shape \(1,\)"):
        sim.run(40, every=10, output=path, columns=[late])
    with kd.open(path) as run:
        assert run.sample_steps.tolist() == [0, 10]
        assert not run.closed
    resumed = kd.resume(path)
    resumed.run(columns=[kd.Column("late", "", (), lambda sim: 2.0)])
    with kd.open(path) as run:
        assert run.observables["late"].tolist() == [1.0, 1.0, 2.0, 2.0, 2.0]


@pytest.mark.parametrize(
    ("column", "culprit"),
    [
        (("total_energy", "energy", (), gyration), "column 'total_energy': kickdrift uses this name itself"),
        (("momentum_x", "", (), gyration), "'momentum_x': kickdrift uses this name itself"),
        (("time", "time", (), gyration), "'time': kickdrift uses this name itself"),
        (("a/b", "", (), gyration), "its name must be a letter and up to 59"),
        ((7, "", (), gyration), "its name must be .*, got 7"),
        (("mine", None, (), gyration), "column 'mine': unit must be text, got None"),
        (("mine", "", (3, 0), gyration), r"column 'mine': shape must be .*, got \(3, 0\)"),
        (("mine", "", "3", gyration), "column 'mine': shape must be .*, got '3'"),
        (("mine", "", (200, 200), gyration), "has 40,000 numbers; the limit is 10,000"),
        (("mine", "", (), 1.0), "column 'mine': function must be a function, got 1.0"),
    ],
)
def test_a_column_that_makes_no_sense_is_refused(column, culprit):
    with pytest.raises(InputError, match=culprit):
        kd.Column(*column)


def test_a_run_refuses_columns_that_do_not_go_together():
    double = kd.Column("radius_of_gyration", "", (), gyration)
    first, part = kd.Column("spin", "", (3,), gyration), kd.Column("spin_x", "", (), gyration)
    for columns, culprit in (
        ([RADIUS, double], "'radius_of_gyration': 'radius_of_gyration' is taken: there are two of that name"),
        ([first, part], "'spin_x' is taken"),
        (RADIUS, "columns must be a list of kd.Column, got Column"),
        ({"mine": gyration}, "columns must be a list of kd.Column; it holds 'mine'"),
        ([kd.Column("mine", "parsnip", (), gyration)], "column 'mine': unit: unknown unit 'parsnip'"),
        ([kd.Column("mine", "energi", (), gyration)], "column 'mine': unit: unknown unit 'energi'.*"),
        ([kd.Column("mine", "9**9**9", (), gyration)], "column 'mine': unit: cannot read the unit"),
    ):
        with pytest.raises(InputError, match=culprit):
            make().run(10, columns=columns)
    assert make().run(0, columns=[kd.Column("mine", "kcal/mol", 1, lambda sim: [2])]).steps == 0


def test_too_many_numbers_for_the_memory_are_refused():
    large = kd.Column("large", "", (100, 100), lambda sim: np.zeros((100, 100)))
    with pytest.raises(InputError, match=r"samples with their columns take .* look less often"):
        make().run(10**6, every=1, columns=[large])


def test_kickdrifts_own_are_rows_of_the_same_table():
    sample = make().sample()
    found = sample.observables()
    fixed = [column for column in OWN if column.name != "volume"]  # a column of barostats alone
    assert list(found) == [column.name for column in fixed]
    for column in fixed:
        assert np.shape(found[column.name]) == column.shape
    assert list(sample.observables(taken=True)) == [name for name in KNOWN if name != "volume"]


def test_a_file_of_a_version_with_fewer_columns_goes_on_with_these(tmp_path, monkeypatch):
    path = tmp_path / "a.h5md"
    with monkeypatch.context() as earlier:
        earlier.setattr(observers, "OWN", tuple(own for own in OWN if own.name != "pairs"))
        make().run(20, every=10, output=path)
    kd.resume(path).run(20)
    with kd.open(path) as run:
        assert run.sample_steps.tolist() == [0, 10, 20, 30, 40]
        assert len(run.observables["total_energy"]) == 5
        assert "pairs" not in run.observables


def test_a_figure_of_one(tmp_path):
    path = tmp_path / "a.h5md"
    make().run(20, every=5, output=path, columns=[RADIUS, INERTIA])
    for name in ("radius_of_gyration", "inertia", "pressure"):
        assert kickdrift("plot", path, "--column", name, "--output", tmp_path / f"{name}.png").exit_code == 0
        assert (tmp_path / f"{name}.png").stat().st_size > 5000
    refused = kickdrift("plot", path, "--column", "radius", "--output", tmp_path / "none.png")
    assert "radius_of_gyration" in str(refused.exception)
    assert not (tmp_path / "none.png").exists()


def test_a_figure_without_a_column_names_the_columns(tmp_path):
    path = tmp_path / "a.h5md"
    sim = make()
    sim.run(20, every=5, output=path, columns=[RADIUS, INERTIA])
    drawn = kickdrift("plot", path)
    assert (drawn.exit_code, drawn.stdout) == (0, f"{path.with_suffix('.png')}\n")
    said = drawn.stderr.splitlines()[-1]  # after what is compiled, if anything is
    assert said == f"{path}: --column NAME draws a column of this run: radius_of_gyration, inertia"
    assert "--column" not in kickdrift("plot", path, "--kind", "energies", "--overwrite").stderr
    make().run(20, every=5, output=tmp_path / "b.h5md")
    assert "--column" not in kickdrift("plot", tmp_path / "b.h5md").stderr

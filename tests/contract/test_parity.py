"""What the command line can do exists in Python, and the other way round."""

from __future__ import annotations

import importlib
import inspect
import re
from typing import Any

import pytest
import typer

import kickdrift as kd
from kickdrift import analysis
from kickdrift.cli.main import app
from kickdrift.integrators.asked import known_options
from kickdrift.trajectory.read.reader import Run
from tests.folders import TOP

PAGE = TOP / "docs" / "api.md"

# The twins of each command: an option has the name of a parameter of one of them, --quiet that of `progress`.
TWINS = {
    "run": "Simulation Simulation.run FileOptions load", "resume": "resume Simulation.run FileOptions",
    "relax": "Simulation Simulation.minimize load", "compare": "compare load",
    "compare-engines": "analysis.compare_engines load", "chaos": "megno", "transits": "transits",
    "certify": "analysis.ensemble_checks analysis.engine_checks Simulation load", "analyze": "analysis.orbit_report",
    "cluster": "analysis.cluster_report",
    "ensemble": "Ensemble Ensemble.run", "plot": "open().plot Problem.plot Simulation Simulation.run",
    "movie": "movie", "export": "export load", "view": "open().view", "info": "open load", "show": "load",
    "new": "template", "schema": "", "cite": "cite", "doctor": "doctor", "list": "listing",
}  # fmt: skip
# Options with another name in Python: a parameter, or a name from `kickdrift` on.
OTHERS: dict[str, dict[str, str]] = {
    "run": {"--equilibrate": "Simulation.equilibrate", "--frame": "open().system", "--json": "Report.as_json"},
    "resume": {"file": "resume(path)", "--json": "Report.as_json"},
    "relax": {
        "--output": "System.to_toml", "--strain": "analysis.elastic_constants(strain)", "--frame": "open().system",
        "--json": "Minimum.as_json",
    },
    "compare": {
        "system": "compare(subject)", "--integrator": "compare(integrators)", "--json": "Comparison.as_json",
        "--plot": "Comparison.plot",
    },
    "compare-engines": {
        "--engine": "analysis.compare_engines(engines)", "--frame": "open().system",
        "--json": "analysis.EngineComparison.as_json",
    },
    "chaos": {"--spectrum": "lyapunov_spectrum(count)", "--json": "ChaosReport.as_json"},
    "transits": {"--json": "Transits.as_json"},
    "certify": {
        "--topology": "analysis.ensemble_checks(runs)", "--forces": "analysis.force_checks(subject)",
        "--calculator": "analysis.force_checks(subject)", "--plot": "analysis.ForceChecks.plot",
        "--json": "analysis.EnsembleChecks.as_json",
    },
    "analyze": {"--plot": "analysis.OrbitReport.plot", "--json": "analysis.OrbitReport.as_json"},
    "cluster": {
        "subject": "analysis.cluster_report(source)", "--fraction": "analysis.cluster_report(fractions)",
        "--plot": "analysis.ClusterReport.plot", "--json": "analysis.ClusterReport.as_json",
    },
    "ensemble": {
        **dict.fromkeys(("--integrator", "--dt", "--steps", "--time", "--every"), "Ensemble(settings)"),
        "--scheduler": "Ensemble.run(client)",
    },
    "plot": {
        "file": "open(path)", "--stability": "stability(integrators)", "--integrator": "Problem.plot(integrators)",
    },
    "movie": {"file": "movie(path)"},
    "export": {"file": "export(path)", "--frame": "open().system"},
    "view": {"file": "open(path)"},
    "info": {"file": "open(path)", "--all": "open().as_json", "--json": "open().as_json"},
    "show": {"system": "load(name_or_path)", "--frame": "open().system"},
    "new": {"--quiet": "template"},
    "cite": {"name": "cite(name_or_path)"},
    "doctor": {"--json": "Installation.as_json"},
    "list": {"--json": "Listing.as_json"},
}  # fmt: skip

# Options that need no twin: a figure in Python is saved by the user, who names the file and may replace it; its
# numbers are arrays; and a list has all its columns.
OF_FILES = {
    "plot": {"--output", "--overwrite", "--csv"}, "compare": {"--overwrite"},
    "compare-engines": {"--overwrite", "--quiet"}, "chaos": {"--overwrite"}, "info": {"--overwrite"},
    "relax": {"--overwrite"}, "list": {"--all", "--overwrite"}, "certify": {"--overwrite"},
    "analyze": {"--overwrite", "--quiet"}, "cluster": {"--overwrite", "--quiet"}, "transits": {"--overwrite"},
    "view": {"--output", "--overwrite", "--open", "--quiet"},
    "new": {"--output", "--schema"}, "doctor": {"--overwrite"},
}  # fmt: skip
OLD = {"--precision"}  # hidden: the old name of --store

# Commands whose twins are not public names: those for kickdrift's developers, and the page of a view.
DEVELOPERS = {
    "bench lj-energy": "kickdrift.analysis.compare.bench.lj_energy",
    "bench speed": "kickdrift_validation.performance.speed.measure",
    "bench lammps": "kickdrift_validation.performance.published.measure",
    "bench compile": "kickdrift_validation.performance.compiling.measure",
    "validate": "kickdrift_validation.runner.validate",
    "page": "kickdrift.pages.page.write_page",
}

# Public names that the command line has in another form.
ELSEWHERE = {
    "a table of a system file": (
        "Body", "Box", "CloseApproach", "Collision", "Constraint", "Crossing", "Escape", "Fixed", "Stage",
        "Topology", "VirtualSite", "cluster",
        *(name for name in kd.__all__ if kd._HOMES.get(name) == "forces"),
    ),
    "-o KEY=VALUE": ("integrator", "Option"),
    "--load FILE.py": (
        "accelerations", "angle_law", "body_law", "bond_law", "dihedral_law", "field_law", "improper_law", "pair_law",
        "register_force", "register_splitting", "register_step", "register_tableau",
    ),
    "FILE.py in a system's place": ("Solution", "solve"),
    "run and resume of a file with [[stage]]": ("StageReports", "run_stages"),
    "list": ("engines", "integrators"),
    "schema": ("json_schema",),
    "exit status": ("InputError", "KickdriftError", "RunError"),
    "only in Python: values of a running Simulation, orbits of the present, and series of one's own": (
        "Column", "Energies", "Orbit", "OrbitTable", "Sphere", "State", "frequencies",
    ),
    "only in Python: derivatives of a motion": ("TransitionMatrix", "transition_matrix"),
    "chaos --spectrum": ("LyapunovSpectrum",),
}  # fmt: skip


def commands() -> dict[str, Any]:
    """Every command by its words."""
    found: dict[str, Any] = {}

    def walk(group: Any, words: tuple[str, ...]) -> None:
        for word, command in group.commands.items():
            if hasattr(command, "commands"):
                walk(command, (*words, word))
            else:
                found[" ".join((*words, word))] = command

    walk(typer.main.get_command(app), ())
    return found


def options(command: Any) -> list[str]:
    """Arguments by name, and options by the first of their names; without -o and those that it can set."""
    known = {f"--{name.replace('_', '-')}" for name in known_options()} | {"-o", "--mixed"}
    known -= {"--seed"}  # the seed of the system, which the noise of a heat bath takes unless -o seed says otherwise
    known -= {"--temperature", "--pressure"}  # what certify expects of a run
    return [each.opts[0] for each in command.params if each.opts[0] not in known | OLD]


def twin(text: str) -> Any:
    """What a text such as ``Simulation.run(steps)`` names; fails if it is not there."""
    path, _, parameter = text.replace("open()", "@").rstrip(")").partition("(")
    found: Any = kd
    for part in path.split("."):
        found = Run if part == "@" else getattr(found, part)
    if parameter:
        assert parameter in inspect.signature(found).parameters, text
    return found


def table() -> dict[str, list[str]]:
    """The table of the page: each command, and the Python names beside it."""
    rows = re.findall(
        r"^\| `kickdrift ([a-z -]+?)[ A-Z.]*` \| (.+) \|$", PAGE.read_text(encoding="utf-8"), re.MULTILINE
    )
    return {command: re.findall(r"`([\w.]+)", names) for command, names in rows}


def test_every_command_stands_in_the_table_or_is_for_developers():
    assert set(TWINS) | set(DEVELOPERS) == set(commands())
    assert set(table()) == set(TWINS)


@pytest.mark.parametrize("command", TWINS)
def test_every_option_has_a_twin_that_exists(command):
    taken = {name for text in TWINS[command].split() for name in inspect.signature(twin(text)).parameters}
    others = OTHERS.get(command, {})
    there = set(options(commands()[command])) - OF_FILES.get(command, set())
    assert set(others) <= there
    for each in there - set(others):
        name = each.removeprefix("--").replace("-", "_")
        assert ("progress" if name == "quiet" else name) in taken, each
    for text in others.values():
        assert twin(text) is not None


@pytest.mark.parametrize("command", TWINS)
def test_the_names_of_the_page_exist(command):
    assert table()[command]
    for name in table()[command]:
        first, *rest = name.split(".")
        begin = {"kd": kd, "run": Run, "sim": kd.Simulation, "report": kd.Report}
        begin |= {"found": kd.Comparison, "system": kd.System}
        found = begin[first]
        for part in rest:
            found = getattr(found, part)


@pytest.mark.parametrize("command", DEVELOPERS)
def test_the_twins_of_developers_commands_exist(command):
    module, _, name = DEVELOPERS[command].rpartition(".")
    assert callable(getattr(importlib.import_module(module), name))


def test_every_public_name_has_a_place_on_the_command_line():
    texts = [*" ".join(TWINS.values()).split(), *(text for rows in OTHERS.values() for text in rows.values())]
    named = {re.split(r"[.(]", text)[0] for text in texts}
    listed = {name for names in ELSEWHERE.values() for name in names}
    assert named | listed == set(kd.__all__)
    assert not named & listed


def test_public_names_alone_show():
    shown = {name for name in dir(kd) if not name.startswith("__")}
    assert shown == set(kd.__all__)
    assert all(getattr(kd, name) is not None for name in dir(kd))
    assert {name for name in dir(analysis) if not name.startswith("__")} == set(analysis.__all__)


def test_help_shows_public_names_alone():
    import pydoc

    text = pydoc.render_doc(kd, renderer=pydoc.plaintext)
    functions = re.findall(r"^    (\w+)\(", text.split("\nFUNCTIONS\n")[1].split("\nDATA\n")[0], flags=re.MULTILINE)
    classes = re.findall(r"^    class (\w+)", text, flags=re.MULTILINE)
    assert set(functions) | set(classes) | {"analysis"} == set(kd.__all__)

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

# The Python name of each option: a parameter of the command's twin, or a name from `kickdrift` on.
OPTIONS: dict[str, dict[str, str]] = {
    "run": {
        "system": "Simulation(system)",
        "--integrator": "Simulation(integrator)",
        "--dt": "Simulation(dt)",
        "--steps": "Simulation.run(steps)",
        "--time": "Simulation.run(time)",
        "--times": "Simulation.run(times)",
        "--every": "Simulation.run(every)",
        "--interval": "Simulation.run(interval)",
        "--exact": "Simulation.run(exact)",
        "--output": "Simulation.run(output)",
        "--overwrite": "Simulation.run(overwrite)",
        "--flush": "FileOptions(flush)",
        "--store": "FileOptions(store)",
        "--compress": "FileOptions(compress)",
        "--write": "FileOptions(write)",
        "--seed": "load(seed)",
        "--equilibrate": "Simulation.equilibrate",
        "--threads": "Simulation(threads)",
        "--engine": "Simulation(engine)",
        "--processes": "Simulation(processes)",
        "--hosts": "Simulation(hosts)",
        "--live": "Simulation.run(live)",
        "--imd": "Simulation.run(imd)",
        "--imd-wait": "Simulation.run(imd_wait)",
        "--json": "Report.as_json",
        "--quiet": "Simulation.run(progress)",
    },
    "resume": {
        "file": "resume(path)",
        "--steps": "Simulation.run(steps)",
        "--time": "Simulation.run(time)",
        "--times": "Simulation.run(times)",
        "--threads": "resume(threads)",
        "--hosts": "resume(hosts)",
        "--flush": "FileOptions(flush)",
        "--live": "Simulation.run(live)",
        "--imd": "Simulation.run(imd)",
        "--imd-wait": "Simulation.run(imd_wait)",
        "--json": "Report.as_json",
        "--overwrite": "Simulation.run(overwrite)",
        "--quiet": "Simulation.run(progress)",
    },
    "relax": {
        "system": "Simulation(system)",
        "--output": "System.to_toml",
        "--force": "Simulation.minimize(force)",
        "--steps": "Simulation.minimize(steps)",
        "--method": "Simulation.minimize(method)",
        "--max-displacement": "Simulation.minimize(max_displacement)",
        "--seed": "load(seed)",
        "--threads": "Simulation(threads)",
        "--json": "Minimum.as_json",
        "--quiet": "Simulation.minimize(progress)",
    },
    "compare": {
        "system": "compare(subject)",
        "--integrator": "compare(integrators)",
        "--time": "compare(time)",
        "--accuracy": "compare(accuracy)",
        "--length": "compare(length)",
        "--seed": "compare(seed)",
        "--threads": "compare(threads)",
        "--json": "Comparison.as_json",
        "--plot": "Comparison.plot",
        "--quiet": "compare(progress)",
    },
    "chaos": {
        "system": "megno(system)",
        "--time": "megno(time)",
        "--integrator": "megno(integrator)",
        "--spectrum": "lyapunov_spectrum(count)",
        "--dt": "megno(dt)",
        "--seed": "megno(seed)",
        "--threads": "megno(threads)",
        "--json": "ChaosReport.as_json",
        "--quiet": "megno(progress)",
    },
    "transits": {
        "system": "transits(system)",
        "planet": "transits(planet)",
        "--until": "transits(until)",
        "--star": "transits(star)",
        "--direction": "transits(direction)",
        "--within": "transits(within)",
        "--masses": "transits(masses)",
        "--elements": "transits(elements)",
        "--integrator": "transits(integrator)",
        "--dt": "transits(dt)",
        "--threads": "transits(threads)",
        "--json": "Transits.as_json",
        "--quiet": "transits(progress)",
    },
    "certify": {
        "runs": "analysis.ensemble_checks(runs)",
        "--temperature": "analysis.ensemble_checks(temperature)",
        "--pressure": "analysis.ensemble_checks(pressure)",
        "--constraints": "analysis.ensemble_checks(constraints)",
        "--topology": "analysis.ensemble_checks(runs)",
        "--engine": "analysis.engine_checks(engine)",
        "--forces": "analysis.force_checks(subject)",
        "--calculator": "analysis.force_checks(subject)",
        "--plot": "analysis.ForceChecks.plot",
        "--integrator": "analysis.engine_checks(integrator)",
        "--steps": "analysis.engine_checks(steps)",
        "--every": "analysis.engine_checks(every)",
        "--dt": "Simulation(dt)",
        "--json": "analysis.EnsembleChecks.as_json",
        "--quiet": "analysis.engine_checks(progress)",
    },
    "analyze": {
        "run": "analysis.orbit_report(run)",
        "--frame": "analysis.orbit_report(frame)",
        "--plane": "analysis.orbit_report(plane)",
        "--until": "analysis.orbit_report(until)",
        "--plot": "analysis.OrbitReport.plot",
        "--json": "analysis.OrbitReport.as_json",
    },
    "ensemble": {
        "system": "Ensemble(system)",
        "--vary": "Ensemble(vary)",
        "--replicas": "Ensemble(replicas)",
        "--seed": "Ensemble(seed)",
        "--measure": "Ensemble(measure)",
        "--integrator": "Ensemble(settings)",
        "--dt": "Ensemble(settings)",
        "--steps": "Ensemble(settings)",
        "--time": "Ensemble(settings)",
        "--every": "Ensemble(settings)",
        "--workers": "Ensemble.run(workers)",
        "--scheduler": "Ensemble.run(client)",
        "--output": "Ensemble.run(output)",
        "--overwrite": "Ensemble.run(overwrite)",
        "--trajectories": "Ensemble.run(trajectories)",
        "--quiet": "Ensemble.run(progress)",
    },
    "plot": {
        "file": "open(path)",
        "--kind": "open().plot(kind)",
        "--stability": "stability(integrators)",
        "--column": "open().plot(column)",
        "--integrator": "Problem.plot(integrators)",
        "--dt": "Simulation(dt)",
        "--time": "Problem.plot(time)",
        "--quiet": "Simulation.run(progress)",
    },
    "movie": {
        "file": "movie(path)",
        "output": "movie(output)",
        "--azimuth": "movie(azimuth)",
        "--elevation": "movie(elevation)",
        "--turn": "movie(turn)",
        "--zoom": "movie(zoom)",
        "--colour": "movie(colour)",
        "--fps": "movie(fps)",
        "--duration": "movie(duration)",
        "--every": "movie(every)",
        "--size": "movie(size)",
        "--dark": "movie(dark)",
        "--overwrite": "movie(overwrite)",
        "--quiet": "movie(progress)",
    },
    "export": {
        "file": "export(path)",
        "output": "export(output)",
        "--unwrapped": "export(unwrapped)",
        "--start": "export(start)",
        "--stop": "export(stop)",
        "--step": "export(step)",
        "--overwrite": "export(overwrite)",
        "--quiet": "export(progress)",
    },
    "view": {
        "file": "open(path)",
        "--frames": "open().view(frames)",
        "--colour": "open().view(colour)",
        "--size": "open().view(size)",
    },
    "info": {"file": "open(path)", "--all": "open().as_json", "--json": "open().as_json"},
    "show": {"system": "load(name_or_path)", "--frame": "open().system"},
    "new": {"kind": "template(kind)", "--quiet": "template"},
    "schema": {},
    "cite": {"name": "cite(name_or_path)"},
    "doctor": {"--json": "Installation.as_json"},
    "list": {"what": "listing(what)", "name": "listing(name)", "--json": "Listing.as_json"},
}

# Options that need no twin: a figure in Python is saved by the user, who names the file and may replace it, and a list
# has all its columns.
OF_FILES = {
    "plot": {"--output", "--overwrite"}, "compare": {"--overwrite"}, "chaos": {"--overwrite"}, "info": {"--overwrite"},
    "relax": {"--overwrite"}, "list": {"--all", "--overwrite"}, "certify": {"--overwrite"},
    "analyze": {"--overwrite", "--quiet"}, "transits": {"--overwrite"},
    "view": {"--output", "--overwrite", "--open", "--quiet"},
    "new": {"--output", "--schema"}, "doctor": {"--overwrite"},
}  # fmt: skip
OLD = {"--precision"}  # hidden: the old name of --store

# Commands whose twins are not public names: those for kickdrift's developers, and the page of a view.
DEVELOPERS = {
    "bench lj-energy": "kickdrift.analysis.compare.bench.lj_energy",
    "bench speed": "kickdrift_validation.performance.speed.measure",
    "validate": "kickdrift_validation.runner.validate",
}

# Public names that the command line has in another form.
ELSEWHERE = {
    "a table of a system file": (
        "Body", "Box", "CloseApproach", "Collision", "Crossing", "Escape", "Topology",
        *(name for name in kd.__all__ if kd._HOMES.get(name) == "forces"),
    ),
    "-o KEY=VALUE": ("integrator", "Option"),
    "--load FILE.py": (
        "accelerations", "angle_law", "body_law", "bond_law", "dihedral_law", "field_law", "improper_law", "pair_law",
        "register_force", "register_splitting", "register_step", "register_tableau",
    ),
    "FILE.py in a system's place": ("Solution", "solve"),
    "list": ("engines", "integrators"),
    "doctor": ("doctor",),
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
    assert set(OPTIONS) | set(DEVELOPERS) == set(commands())
    assert set(table()) == set(OPTIONS)


@pytest.mark.parametrize("command", OPTIONS)
def test_every_option_has_a_twin_that_exists(command):
    there = options(commands()[command])
    assert set(there) - OF_FILES.get(command, set()) == set(OPTIONS[command])
    for text in OPTIONS[command].values():
        assert twin(text) is not None


@pytest.mark.parametrize("command", OPTIONS)
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
    named = {re.split(r"[.(]", text)[0] for rows in OPTIONS.values() for text in rows.values()}
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

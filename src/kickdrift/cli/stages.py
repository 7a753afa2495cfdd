"""The stages of a protocol, for the commands ``run`` and ``resume``."""

from __future__ import annotations

import shlex
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

import kickdrift as kd
from kickdrift.cli.console import print_lines, print_table, progress_bar, say
from kickdrift.cli.watching import Interrupted, warn_of_version
from kickdrift.disk.outputs import write_json
from kickdrift.display.showing import lines_of, tables_of
from kickdrift.errors import InputError

if TYPE_CHECKING:
    from kickdrift.run.stages import StageRun


def has_stages(file: Path) -> bool:
    """Tell whether the file of a run is that of a stage."""
    with kd.open(file) as run:
        return bool(getattr(run, "system_record", {}).get("stages"))


def refuse_beside_stages(name: str, given: Mapping[str, Any]) -> None:
    """Refuse options of ``run`` that each stage says for itself."""
    for key, value in given.items():
        if value is not None and value is not False and value != {}:
            flag = key if key.startswith("-") else f"--{key.replace('_', '-')}"
            raise InputError(f"{flag}: {name} has stages; give it there, in [[stage]] or [run]")


def run_stages(
    stages: Iterator[StageRun], json_file: Path | None, quiet: bool, overwrite: bool, goes_on: bool = False
) -> None:
    """Run each stage, print its report, and at the end the means of all. ``goes_on`` tells whether the first stage had
    begun before."""
    reports: dict[str, Any] = {}
    outputs: dict[str, Path] = {}
    last: StageRun | None = None
    for each in stages:
        name, begun = each.stage.name, each.sim.steps_done if each.sim else 0
        if goes_on and last is None:
            say(f"{each.output}: stage {name} continues from step {begun}", quiet)
        if each.sim is not None:
            warn_of_version(each.sim, quiet)
        try:
            with progress_bar(quiet) as bar:
                reports[name] = each.run(bar(f"stage {name}"))
        except KeyboardInterrupt:
            raise Interrupted(_kept(each, outputs)) from None
        if each.output is not None:
            outputs[name] = each.output
        print_lines([("stage", name), *lines_of(reports[name]), ("", "")])
        last = each
    assert last is not None
    found = kd.StageReports(reports, outputs, last.system)
    try:
        write_json(json_file, found.as_json(), overwrite=overwrite)
    finally:
        for title, columns, rows in tables_of(found):
            print_table(title, columns, rows)


def _kept(stopped: StageRun, outputs: Mapping[str, Path]) -> str:
    """What an interrupted protocol keeps, and how to go on."""
    where = f"stopped in stage {stopped.stage.name}"
    if stopped.sim is not None:
        where += f" at step {stopped.sim.steps_done:,}"
    held = stopped.output is not None and stopped.output.exists()
    files = [stopped.output] if held else [*outputs.values()][-1:]
    if not files:
        return f"{where}; nothing is kept"
    return f"{where}; continue with: kickdrift resume {shlex.quote(str(files[0]))}"

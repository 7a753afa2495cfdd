"""The command ``list``."""

from __future__ import annotations

import sys
from enum import StrEnum
from pathlib import Path
from typing import Annotated

import typer

from kickdrift.cli.console import print_lines, print_table, say, verbatim
from kickdrift.cli.options import JsonOption, OverwriteOption
from kickdrift.disk.outputs import refuse_outputs, write_json
from kickdrift.display.showing import lines_of, tables_of
from kickdrift.errors import InputError


class Lists(StrEnum):
    """Lists that ``kickdrift list`` can show."""

    integrators = "integrators"
    forces = "forces"
    systems = "systems"
    engines = "engines"


HINTS = {
    Lists.integrators: "kickdrift list integrators NAME explains a method; kickdrift compare SYSTEM measures methods",
    Lists.systems: "kickdrift run NAME runs a system; kickdrift show NAME prints its file, to edit",
}  # what to do next, on a terminal


def show(
    system: Annotated[
        str, typer.Argument(metavar="SYSTEM", help="A shipped system's name, a system file, or a run's .h5md.")
    ],
    frame: Annotated[
        int | None, typer.Option(metavar="K", help="Frame of a run's file, from 0 on (default: the last one).")
    ] = None,
) -> None:
    """Print a system file's text, to save and edit: kickdrift show lj-1000 > mine.toml. For a run's file: the system
    of a frame, in the box of that moment, at time 0."""
    from kickdrift.systemfile.files import find, parsed

    if Path(system).suffix == ".h5md":
        verbatim(frame_text(system, frame))
        return
    if frame is not None:
        raise InputError(f"{system}: --frame is for the file of a run")
    verbatim(parsed(find(system))[0])


def frame_text(path: str, number: int | None) -> str:
    """Text of a system file of a frame of a run's file, at time 0."""
    from kickdrift.trajectory.read.reader import open as opened

    with opened(path) as run:
        k = len(run) - 1 if number is None else number
        if not 0 <= k < len(run):
            raise InputError(f"{path}: has no frame {k}; it holds {len(run)}")
        found = run[k].system
        return found.at(found.state.phase, 0.0).to_toml()


def list_(
    what: Annotated[Lists, typer.Argument(metavar="WHAT", help=f"{', '.join(Lists)}.")],
    name: Annotated[str | None, typer.Argument(metavar="[NAME]", help="Explain this integrator.")] = None,
    all_: Annotated[bool, typer.Option("--all", help="Every column, whatever the terminal's width.")] = False,
    json_file: JsonOption = None,
    overwrite: OverwriteOption = False,
) -> None:
    """List integrators, forces, systems or engines, or explain an integrator and its options."""
    refuse_outputs({"json": json_file}, overwrite)
    from kickdrift.run.listing import listing

    found = listing(str(what), name)
    print_lines(lines_of(found))
    for title, columns, rows in tables_of(found):
        print_table(title, columns, rows, whole=all_)
    write_json(json_file, found.as_json(), overwrite=overwrite)
    if what in HINTS and name is None and sys.stderr is not None and sys.stderr.isatty():
        say(HINTS[what])

"""The command ``list``."""

from __future__ import annotations

import sys
from enum import StrEnum
from typing import Annotated

import typer

from kickdrift.cli.console import print_lines, print_table, say, verbatim
from kickdrift.cli.options import JsonOption, OverwriteOption
from kickdrift.disk.outputs import refuse_outputs, write_json
from kickdrift.display.showing import lines_of, tables_of


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
    system: Annotated[str, typer.Argument(metavar="SYSTEM", help="A shipped system's name, or a system file.")],
) -> None:
    """Print a system file's text, to save and edit: kickdrift show lj-1000 > mine.toml."""
    from kickdrift.systemfile.files import find, parsed

    verbatim(parsed(find(system))[0])


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

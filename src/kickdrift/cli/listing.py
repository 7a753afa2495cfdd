"""The command ``list``."""

from __future__ import annotations

from enum import StrEnum
from typing import Annotated

import typer

from kickdrift.cli.console import print_lines, print_table, verbatim
from kickdrift.cli.options import JsonOption, OverwriteOption
from kickdrift.cli.printing import LISTINGS
from kickdrift.disk.outputs import refuse_outputs, write_json
from kickdrift.errors import InputError
from kickdrift.text import VALUE, clean


class Lists(StrEnum):
    """Lists that ``kickdrift list`` can show."""

    integrators = "integrators"
    forces = "forces"
    systems = "systems"
    engines = "engines"


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
    if name is not None:
        from kickdrift.cli.printing_methods import OPTION_COLUMNS, method_lines, option_rows

        if what is not Lists.integrators:
            raise InputError(f"list {what} {clean(name, VALUE)}: only integrators are explained by name")
        lines, rows = method_lines(name), option_rows(name)
        print_lines(lines)
        print_table("options", OPTION_COLUMNS, rows)
        options = [dict(zip(OPTION_COLUMNS, row, strict=True)) for row in rows]
        write_json(json_file, {**dict(lines), "options": options}, overwrite=overwrite)
        return
    columns, rows = LISTINGS[what]()
    print_table(None, columns, rows, whole=all_)
    listed = [dict(zip(columns, row, strict=True)) for row in rows]
    write_json(json_file, {str(what): listed}, overwrite=overwrite)

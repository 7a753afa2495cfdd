"""The command ``list``."""

from __future__ import annotations

from enum import StrEnum
from typing import Annotated

import typer

from kickdrift.cli.console import print_table, verbatim
from kickdrift.cli.printing import (
    LISTINGS,
)
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
    what: Annotated[Lists, typer.Argument()],
    name: Annotated[str | None, typer.Argument(metavar="[NAME]", help="Explain this integrator.")] = None,
) -> None:
    """List integrators, forces, systems or engines, or explain an integrator and its options."""
    if name is not None:
        from kickdrift.cli.printing_methods import print_method

        if what is not Lists.integrators:
            raise InputError(f"list {what} {clean(name, VALUE)}: only integrators are explained by name")
        print_method(name)
        return
    columns, rows = LISTINGS[what]()
    print_table(None, columns, rows)

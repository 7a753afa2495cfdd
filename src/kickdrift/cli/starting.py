"""The commands ``new``, ``schema``, ``cite`` and ``doctor``."""

from __future__ import annotations

import os
from pathlib import Path
from typing import Annotated

import typer

from kickdrift.cli.console import print_lines, print_table, say, verbatim
from kickdrift.cli.options import JsonOption, OverwriteOption, QuietOption
from kickdrift.disk.files import shown_path
from kickdrift.disk.kinds import JSON, SYSTEM
from kickdrift.disk.outputs import refuse_outputs, write_json, write_system, written_whole
from kickdrift.display.showing import lines_of, tables_of
from kickdrift.errors import InputError

SCHEMA = "system-file.schema.json"  # also the name that shipped files give


def new(
    kind: Annotated[str, typer.Argument(metavar="[KIND]", help="liquid, bath, mixture, planets or ode.")] = "liquid",
    output: Annotated[Path | None, typer.Option(metavar="FILE.toml", help="Default: KIND.toml in this folder.")] = None,
    schema: Annotated[
        bool,
        typer.Option("--schema", help="Write the schema beside the file, and name it in the first line for editors."),
    ] = False,
    quiet: QuietOption = False,
) -> None:
    """Write a commented system file to start from. No file is replaced."""
    from kickdrift.systemfile.json_schema import json_schema_text
    from kickdrift.systemfile.templates import template

    text = template(kind)
    target = Path(f"{kind}.toml") if output is None else output
    if os.path.lexists(target):
        raise InputError(
            f"{shown_path(target)}: exists already, and new replaces no file; give another name by --output"
        )
    refuse_outputs({"output": target}, False, output=SYSTEM)
    beside = target.with_name(SCHEMA)
    if schema:
        refuse_outputs({"output": None if os.path.lexists(beside) else beside}, False, output=JSON)
        text = f"#:schema ./{SCHEMA}\n{text}"
    write_system(target, text, overwrite=False)
    if schema and os.path.lexists(beside):
        say(f"{shown_path(beside)} was there already", quiet)
    elif schema:
        with written_whole(beside, JSON, overwrite=False) as part:
            part.write_text(json_schema_text(), encoding="utf-8")
    say(f"wrote {target}; run it with: kickdrift run {target}", quiet)


def schema() -> None:
    """Print the JSON schema of system files, by which editors complete keys and check values. A file names its schema
    in the first line: #:schema ./system-file.schema.json is the file of that name in the same folder."""
    from kickdrift.systemfile.json_schema import json_schema_text

    verbatim(json_schema_text())


def cite(
    name: Annotated[
        str, typer.Argument(metavar="FILE|NAME", help="A run's file, a system, a method, a force or an engine.")
    ],
) -> None:
    """Print BibTeX entries for what a run used, or for a system, a method, a force or an engine."""
    from kickdrift.trajectory.citing import cite as cited

    verbatim(cited(name) + "\n")


def doctor(json_file: JsonOption = None, overwrite: OverwriteOption = False) -> None:
    """Print versions, processor, lanes, threads, the state of compiled code, and what is missing."""
    refuse_outputs({"json": json_file}, overwrite)
    from kickdrift.analysis.compare.doctor import doctor as found_by

    found = found_by()
    print_lines(lines_of(found))
    for title, columns, rows in tables_of(found):
        print_table(title, columns, rows)
    write_json(json_file, found.as_json(), overwrite=overwrite)
    if found.problems:
        raise typer.Exit(1)

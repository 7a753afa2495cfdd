"""The command ``relax``."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any

import typer

from kickdrift.cli.amounts import amount, whole
from kickdrift.cli.console import print_lines, progress_bar, say
from kickdrift.cli.options import JsonOption, OverwriteOption, QuietOption, SubjectArgument, ThreadsOption
from kickdrift.disk import kinds
from kickdrift.disk.outputs import refuse_outputs, write_json, write_system
from kickdrift.display.showing import lines_of
from kickdrift.errors import InputError


def relax(
    system: SubjectArgument,
    output: Annotated[
        Path | None, typer.Option(metavar="FILE.toml", help="Write the relaxed system as a system file.")
    ] = None,
    force: Annotated[
        Any,
        typer.Option(
            metavar="F",
            parser=amount("a force such as 1e-6, or '1e-6 eV/angstrom'"),
            help="Tolerance of the largest force on a particle (default 1e-6).",
        ),
    ] = None,
    steps: Annotated[int | None, typer.Option(metavar="N", parser=whole(0), help="Most steps (default 10000).")] = None,
    method: Annotated[str | None, typer.Option(metavar="NAME", help="fire (default) or l-bfgs.")] = None,
    max_displacement: Annotated[
        Any,
        typer.Option(
            metavar="X",
            parser=amount("a length such as 0.1, or '0.3 angstrom'"),
            help="Longest step of a particle (default: a tenth of the shortest sigma).",
        ),
    ] = None,
    seed: Annotated[int | None, typer.Option(metavar="S", min=0, help="Seed of random velocities.")] = None,
    threads: ThreadsOption = 1,
    json_file: JsonOption = None,
    overwrite: OverwriteOption = False,
    quiet: QuietOption = False,
) -> None:
    """Move particles to a minimum of their potential energy, also from a random start with overlaps. The relaxed system
    keeps the velocities of the file."""
    refuse_outputs({"output": output, "json": json_file}, overwrite, [system], kinds.SYSTEM)
    from kickdrift.forces.bound.forces import check_threads
    from kickdrift.model.system import System
    from kickdrift.run.minimization import minimum
    from kickdrift.systemfile.python_file import load_or_run

    start = load_or_run(system, seed, overlaps=True)
    if not isinstance(start, System):
        raise InputError(f"{system}: is an ODE; relax needs particles")
    if output is not None:
        start.at(start.state.phase, 0.0).to_toml()  # refuses a system that no file can hold, before any work
    asked = {"force": force, "steps": steps, "method": method, "max_displacement": max_displacement}
    given = {key: value for key, value in asked.items() if value is not None}
    with progress_bar(quiet) as bar:
        found = minimum(start, check_threads(threads), **given, progress=bar("minimizing"))
    if not found.converged:
        say(f"warning: not converged: {found.trouble}", quiet)
    try:
        write_system(output, found.system.to_toml() if output else "", overwrite=overwrite)
        write_json(json_file, found.as_json(), overwrite=overwrite)
    finally:
        print_lines([*lines_of(found), *([("written", str(output))] if output else [])])
    if not found.converged:
        raise typer.Exit(1)

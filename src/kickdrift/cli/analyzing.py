"""The command ``analyze``."""

from __future__ import annotations

from enum import StrEnum
from pathlib import Path
from typing import Annotated, Any

import typer

from kickdrift.cli.amounts import length
from kickdrift.cli.console import busy, out
from kickdrift.cli.options import JsonOption, OverwriteOption, QuietOption
from kickdrift.cli.printing import show_found
from kickdrift.disk.outputs import refuse_outputs


class Frames(StrEnum):
    """Origins of orbits."""

    jacobi = "jacobi"
    heliocentric = "heliocentric"
    barycentric = "barycentric"


class Planes(StrEnum):
    """Reference planes of orbits."""

    invariable = "invariable"
    file = "file"


def analyze(
    run: Annotated[Path, typer.Argument(metavar="RUN.h5md", help="A run's file, of bodies under gravity.")],
    frame: Annotated[
        Frames, typer.Option(metavar="NAME", help=f"Origin of the orbits: {', '.join(Frames)}.")
    ] = Frames.jacobi,
    plane: Annotated[
        Planes, typer.Option(metavar="NAME", help=f"Plane of inclinations and nodes: {', '.join(Planes)}.")
    ] = Planes.invariable,
    order: Annotated[
        int, typer.Option(metavar="N", min=1, help="Largest p - q of resonances p : q of mean motions.")
    ] = 4,
    until: Annotated[
        Any, typer.Option(metavar="T", parser=length, help="Last time to use, such as '20 Myr' (default: all).")
    ] = None,
    plot: Annotated[
        Path | None, typer.Option(metavar="FILE.png", help="Draw the orbits' frequencies and librating angles.")
    ] = None,
    json_file: JsonOption = None,
    overwrite: OverwriteOption = False,
    quiet: QuietOption = False,
) -> None:
    """Find the proper frequencies of each orbit, their secular periods, and resonant angles that librate."""
    refuse_outputs({"json": json_file, "plot": plot}, overwrite, [run])
    from kickdrift.analysis.orbits.secular_run import orbit_report

    with busy(f"analysing {run}", quiet):
        found = orbit_report(run, str(frame), str(plane), order, until)
    show_found(found, json_file, overwrite)
    if plot is not None:
        from kickdrift.plots.runs import checked_target, save_figure

        with busy(f"drawing {plot}", quiet):
            drawn = save_figure(found.plot(), checked_target(plot, overwrite))
        out(str(drawn))

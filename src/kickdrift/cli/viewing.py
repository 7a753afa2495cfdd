"""The command ``view``, which writes a page with particles that turn in a browser."""

from __future__ import annotations

import os
import sys
from pathlib import Path
from typing import Annotated

import typer

from kickdrift.cli.console import out, progress_bar, say
from kickdrift.cli.options import OverwriteOption, QuietOption


def view(
    file: Annotated[
        str, typer.Argument(metavar="FILE", help="A run's .h5md, a system file, or the name of a shipped system.")
    ],
    output: Annotated[
        Path | None,
        typer.Option(
            "--output",
            "-o",
            metavar="FILE.html",
            help="Default: FILE.html beside a run or a system file, NAME.html here for a shipped system.",
        ),
    ] = None,
    frames: Annotated[
        int | None,
        typer.Option(metavar="N", min=1, help="Most frames, spread evenly (default 501; 2001 for a few bodies)."),
    ] = None,
    colour: Annotated[
        str | None,
        typer.Option(
            metavar="NAME", help="First colours: species or body, speed, 'kinetic energy', or a column of the run."
        ),
    ] = None,
    size: Annotated[float, typer.Option(metavar="X", help="Factor of the spheres' sizes.")] = 1.0,
    open_: Annotated[
        bool | None, typer.Option("--open/--no-open", help="Open the page in a browser (default: with a display).")
    ] = None,
    overwrite: OverwriteOption = False,
    quiet: QuietOption = False,
) -> None:
    """Write one HTML page that shows a run in a browser, without a network: particles that turn, the box, orbits,
    curves and the report. A system file shows its start."""
    from kickdrift.systemfile.files import is_shipped
    from kickdrift.view.page import write_with_scene

    shipped = is_shipped(file) and not os.path.lexists(file)
    target = output or (Path(f"{Path(file).stem}.html") if shipped else Path(file).with_suffix(".html"))
    with progress_bar(quiet):
        page, scene = write_with_scene(file, target, frames, colour, size, overwrite)
    for note in scene["notes"]:
        say(note, quiet)
    out(str(page))
    if open_ or (open_ is None and has_display()):
        import webbrowser

        if not (has_display() and webbrowser.open(page.absolute().as_uri())):
            say(f"no browser could be opened; open {page} yourself", quiet)
    elif open_ is None:
        say("no display: open the page in any browser; it needs no network", quiet)


def has_display() -> bool:
    """Whether this session can show a window."""
    if os.environ.get("CI"):
        return False
    return sys.platform in ("darwin", "win32") or bool(os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY"))

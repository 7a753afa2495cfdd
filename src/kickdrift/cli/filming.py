"""The command ``movie``."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any

import typer

from kickdrift.cli.amounts import whole
from kickdrift.cli.console import out, progress_bar, say
from kickdrift.cli.options import OverwriteOption, QuietOption
from kickdrift.text import counted


def _pixels(text: Any) -> Any:
    """Width and height of a text such as 960x720; `kickdrift.movie` checks them."""
    parts = str(text).lower().split("x")
    return tuple(int(each) if each.isdecimal() else each for each in parts)


def movie(
    file: Annotated[Path, typer.Argument(metavar="FILE.h5md", help="A run's file.")],
    output: Annotated[Path, typer.Argument(metavar="OUT", help="The suffix sets the format: mp4, webm or gif.")],
    azimuth: Annotated[float, typer.Option(metavar="DEG", help="Angle of the camera about the z axis.")] = 30.0,
    elevation: Annotated[
        float, typer.Option(metavar="DEG", help="Angle of the camera above the x-y plane; 90 is from above.")
    ] = 25.0,
    turn: Annotated[float, typer.Option(metavar="DEG", help="Angle by which the camera turns during the film.")] = 0.0,
    zoom: Annotated[float, typer.Option(metavar="X", help="Magnification.")] = 1.0,
    colour: Annotated[
        str | None,
        typer.Option(
            metavar="NAME",
            help="species, speed, body, or a colour such as tomato or #0072B2 (default: the most informative one).",
        ),
    ] = None,
    fps: Annotated[float, typer.Option(metavar="N", help="Pictures a second.")] = 25.0,
    duration: Annotated[
        float | None,
        typer.Option(
            metavar="SECONDS", help="Length of the film (default: each frame of the run once, at most 20 seconds)."
        ),
    ] = None,
    every: Annotated[
        int | None, typer.Option(metavar="K", parser=whole(1), help="Show every K-th frame of the run, once each.")
    ] = None,
    size: Annotated[
        Any, typer.Option(metavar="WxH", parser=_pixels, help="Width and height in pixels (default 960x720).")
    ] = "960x720",
    dark: Annotated[
        bool | None, typer.Option("--dark/--light", help="Background (default: dark for planets, else light).")
    ] = None,
    overwrite: OverwriteOption = False,
    quiet: QuietOption = False,
) -> None:
    """Make a film of a run: spheres in their box, or planets with trails and names. MP4 and WebM need ffmpeg, which
    pip install 'kickdrift[movie]' installs; GIF needs nothing more."""
    from kickdrift.plots.movie import movie as filmed

    with progress_bar(quiet) as bar:
        found = filmed(
            file, output, azimuth=azimuth, elevation=elevation, turn=turn, zoom=zoom, colour=colour, fps=fps,
            duration=duration, every=every, size=size, dark=dark, overwrite=overwrite, progress=bar("drawing"),
        )  # fmt: skip
    for note in found.notes:
        say(note, quiet)
    width, height = found.size
    seconds = found.frames / found.fps
    out(f"{found.path}: {counted(found.frames, 'picture')} of {width} x {height} pixels, {seconds:.3g} s")

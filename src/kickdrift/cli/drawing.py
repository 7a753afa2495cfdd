"""The commands ``plot``, ``view`` and ``movie``."""

from __future__ import annotations

import os
import sys
from collections.abc import Sequence
from enum import StrEnum
from pathlib import Path
from typing import Annotated, Any

import typer

import kickdrift as kd
from kickdrift.cli.console import busy, out, print_table, progress_bar, say
from kickdrift.cli.files import TABLES, is_problem
from kickdrift.cli.options import Overwrite, Quiet, argument, option, whole, with_options
from kickdrift.errors import InputError
from kickdrift.integrators.asked import integrator
from kickdrift.model.problem import Problem
from kickdrift.systemfile.files import is_shipped
from kickdrift.text import counted


class Figures(StrEnum):
    """Figures of a run that ``kickdrift plot`` can draw."""

    orbits = "orbits"
    energies = "energies"
    cluster = "cluster"
    rdf = "rdf"
    msd = "msd"
    vacf = "vacf"
    structure_factor = "structure-factor"


@with_options("dt", "rtol", "atol")
def plot(
    file: Annotated[
        Path | None,
        argument(
            "[FILE]",
            "A run's .h5md; a .h5, .csv or .parquet of an ODE or an ensemble; or an ODE's system file or name.",
        ),
    ] = None,
    output: Annotated[
        Path | None, option("FILE.png", "Also .pdf or .svg. Default: FILE.png beside the file, or stability.png.")
    ] = None,
    kind: Annotated[
        Figures | None, option("NAME", f"{', '.join(Figures)} (default: orbits under gravity, else energies).")
    ] = None,
    stability: Annotated[
        list[str] | None, option("NAME", "Draw an integrator's stability region, without a run; repeat for several.")
    ] = None,
    column: Annotated[
        str | None, option("NAME", "Column of a run, or of an ensemble's table (default: the most informative).")
    ] = None,
    csv: Annotated[Path | None, option("FILE.csv", "Also write the numbers of the figure's lines.")] = None,
    integrator: Annotated[
        list[str] | None, option("NAME", "Run an ODE's system file with this method and draw it; repeat for several.")
    ] = None,
    options: Any = None,
    time: Annotated[float | None, option("T", "Length of these runs (default: the system file's).")] = None,
    overwrite: Overwrite = False,
    quiet: Quiet = False,
) -> None:
    """Draw a run, an ensemble, a potential's file or stability regions. A run gives orbits and elements; or energies,
    error, temperature and radial distribution function; or one observable with error bars; or one column against time.
    The run of an ODE gives y against time, the phase portrait and the energy error. The name of an ODE's system file
    gives these of several methods side by side. An ensemble gives a map, a curve, points or a histogram. A potential
    gives the energies of crystals."""
    from kickdrift.analysis.crystals.potential import is_potential

    if stability and (file or kind or column):
        raise InputError("give FILE or --stability, not both")
    if file and _is_system(file):
        if csv:
            raise InputError("--csv is for files, and FILE is a system file; run it with --output")
        if kind or column:
            raise InputError(f"--{'kind' if kind else 'column'} is for a run's file, and FILE is a system file")
        out(str(_plot_methods(file, output, integrator, options, time, overwrite, quiet)))
        return
    if file and is_potential(file):
        from kickdrift.plots.potentials import plot_potential

        if kind or column:
            raise InputError(f"--{'kind' if kind else 'column'} is for a run's file, and FILE is a potential")
        with busy(f"drawing {file}", quiet):
            drawn = plot_potential(file, output or Path(f"{file}.png"), numbers=csv, overwrite=overwrite)
        out(str(drawn))
        return
    if integrator or options or time is not None:
        raise InputError("--integrator, --time and options of a method are for an ODE's system file or name")
    if file and is_problem(file):
        from kickdrift.plots.problems import plot_problem

        if kind:
            raise InputError("--kind is for a run's .h5md, and FILE is the run of an ODE")
        with busy(f"drawing {file}", quiet):
            target = output or file.with_suffix(".png")
            drawn = plot_problem(file, target, column, numbers=csv, overwrite=overwrite)
        out(str(drawn))
        return
    of_ensemble = file is not None and file.suffix.lower() in TABLES
    if of_ensemble and kind:
        raise InputError("--kind is for a run's .h5md, and FILE is the table of an ensemble")
    if kind and column:
        raise InputError("give --kind or --column, not both")
    if stability:
        from kickdrift.plots.stability import plot_stability

        with busy(f"drawing {stability}", quiet):
            target = output or Path("stability.png")
            drawn = plot_stability(stability, target, numbers=csv, overwrite=overwrite)
        out(str(drawn))
        print_stability(stability)
    elif file and of_ensemble:
        from kickdrift.plots.ensemble import plot_ensemble

        with busy(f"drawing {file}", quiet):
            target = output or file.with_suffix(".png")
            drawn = plot_ensemble(file, target, column, numbers=csv, overwrite=overwrite)
        out(str(drawn))
    elif file:
        from kickdrift.plots.figures import plot_file

        target = output or file.with_suffix(".png")
        with busy(f"drawing {file}", quiet):
            drawn = plot_file(file, target, kind and str(kind), column, numbers=csv, overwrite=overwrite)
        out(str(drawn))
        if not kind and not column:
            name_columns(file)
    else:
        raise InputError("give FILE, or --stability NAME to draw an integrator")


def print_stability(names: Sequence[str]) -> None:
    """Print the longest stable step of each method, from its coefficients."""
    from kickdrift.plots.stability import number

    columns = ["omega dt", "real lambda dt", "imaginary lambda dt"]
    chosen = dict.fromkeys(integrator(integrator(name).method.name) for name in names)
    limits = [(each.name, each.stability) for each in chosen]
    rows = [[name, *(number(found[key]) if key in found else "" for key in columns)] for name, found in limits]
    print_table(None, ["method", *columns], rows)


def _is_system(file: Path) -> bool:
    """Whether FILE names a system file rather than a run."""
    return file.suffix == ".toml" or is_shipped(str(file))


def _plot_methods(
    file: Path,
    output: Path | None,
    integrators: list[str] | None,
    options: dict[str, Any],
    time: float | None,
    overwrite: bool,
    quiet: bool,
) -> Path:
    """Run the Problem of a system file with each method, and draw them."""
    from kickdrift.plots.problems import plot_methods

    problem = kd.load(str(file))
    if not isinstance(problem, Problem):
        raise InputError(f"{file}: is a system of particles; run it with --output run.h5md and plot that file")
    with progress_bar(quiet) as bar:
        return plot_methods(
            problem, integrators or (), output or file.with_suffix(".png"), time=time, options=options,
            overwrite=overwrite, progress=bar("running"),
        )  # fmt: skip


def name_columns(file: Path) -> None:
    """Name a run's own columns, which no figure but ``--column`` draws."""
    from kickdrift.trajectory.read import reader

    with reader.open(file) as run:
        if run.columns:
            say(f"{file}: --column NAME draws a column of this run: {', '.join(run.columns)}")


def view(
    file: Annotated[str, argument("FILE", "A run's .h5md, a system file, or the name of a shipped system.")],
    output: Annotated[
        Path | None,
        option(
            "FILE.html",
            "Default: FILE.html beside a run or a system file, NAME.html here for a shipped system.",
            "--output",
            "-o",
        ),
    ] = None,
    frames: Annotated[
        int | None, option("N", "Most frames, spread evenly (default 501; 2001 for a few bodies).", min=1)
    ] = None,
    colour: Annotated[
        str | None, option("NAME", "First colours: species or body, speed, 'kinetic energy', or a column of the run.")
    ] = None,
    size: Annotated[float, option("X", "Factor of the spheres' sizes.")] = 1.0,
    open_: Annotated[
        bool | None, typer.Option("--open/--no-open", help="Open the page in a browser (default: with a display).")
    ] = None,
    overwrite: Overwrite = False,
    quiet: Quiet = False,
) -> None:
    """Write one HTML page that shows a run in a browser, without a network: particles that turn, the box, orbits,
    curves and the report. A system file shows its start."""
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


def page(
    name: Annotated[str, argument("PAGE", "which-integrator, stability, chaos, liquid, planets, or a system.")],
    output: Annotated[Path | None, option("FILE.html", "Default: PAGE.html here.", "--output", "-o")] = None,
    overwrite: Overwrite = False,
    quiet: Quiet = False,
) -> None:
    """Write one HTML page that computes in a browser, without Python or a network: kickdrift's own step loops,
    compiled to WebAssembly. It needs the linker of Debian's lld or PyPI's ziglang."""
    from kickdrift.pages.page import write_page

    with progress_bar(quiet):
        out(str(write_page(name, output or Path(f"{Path(name).stem}.html"), overwrite=overwrite)))


def has_display() -> bool:
    """Whether this session can show a window."""
    if os.environ.get("CI"):
        return False
    return sys.platform in ("darwin", "win32") or bool(os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY"))


def _pixels(text: Any) -> Any:
    """Width and height of a text such as 960x720; `kickdrift.movie` checks them."""
    parts = str(text).lower().split("x")
    return tuple(int(each) if each.isdecimal() else each for each in parts)


def movie(
    file: Annotated[Path, argument("FILE.h5md", "A run's file.")],
    output: Annotated[
        Path | None,
        argument(
            "[OUT]", "The suffix sets the format: mp4, webm or gif. Default: FILE.mp4, or FILE.gif without ffmpeg."
        ),
    ] = None,
    azimuth: Annotated[float, option("DEG", "Angle of the camera about the z axis.")] = 30.0,
    elevation: Annotated[float, option("DEG", "Angle of the camera above the x-y plane; 90 is from above.")] = 25.0,
    turn: Annotated[float, option("DEG", "Angle by which the camera turns during the film.")] = 0.0,
    zoom: Annotated[float, option("X", "Magnification.")] = 1.0,
    colour: Annotated[
        str | None,
        option("NAME", "species, molecule, speed, body, or a colour such as tomato (default: the most telling one)."),
    ] = None,
    fps: Annotated[float, option("N", "Pictures a second.")] = 25.0,
    duration: Annotated[
        float | None, option("SECONDS", "Length of the film (default: each frame of the run once, at most 20 seconds).")
    ] = None,
    every: Annotated[int | None, option("K", "Show every K-th frame of the run, once each.", parser=whole(1))] = None,
    size: Annotated[Any, option("WxH", "Width and height in pixels (default 960x720).", parser=_pixels)] = "960x720",
    dark: Annotated[
        bool | None, typer.Option("--dark/--light", help="Background (default: dark for planets, else light).")
    ] = None,
    overwrite: Overwrite = False,
    quiet: Quiet = False,
) -> None:
    """Make a film of a run: spheres in their box, or planets with trails and names. MP4 and WebM need ffmpeg, which
    pip install 'kickdrift[movie]' brings; GIF needs nothing."""
    from kickdrift.plots.movie import ffmpeg

    target = output or file.with_suffix(".mp4" if ffmpeg() else ".gif")
    with progress_bar(quiet) as bar:
        found = kd.movie(
            file, target, azimuth=azimuth, elevation=elevation, turn=turn, zoom=zoom, colour=colour, fps=fps,
            duration=duration, every=every, size=size, dark=dark, overwrite=overwrite, progress=bar("drawing"),
        )  # fmt: skip
    for note in found.notes:
        say(note, quiet)
    width, height = found.size
    seconds = found.frames / found.fps
    out(f"{found.path}: {counted(found.frames, 'picture')} of {width} x {height} pixels, {seconds:.3g} s")

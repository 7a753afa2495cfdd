"""The commands ``plot``, ``export`` and ``info``, which read a run's file."""

from __future__ import annotations

import os
from enum import StrEnum
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from kickdrift.cli.console import busy, out, print_lines, progress_bar, say
from kickdrift.cli.options import (
    JsonOption,
    OverwriteOption,
    QuietOption,
    with_options,
)
from kickdrift.cli.printing import (
    print_stability,
    print_system,
)
from kickdrift.disk.outputs import refuse_outputs, write_json
from kickdrift.errors import InputError
from kickdrift.text import counted

if TYPE_CHECKING:
    from kickdrift.model.problem import Problem
    from kickdrift.model.system import System


TABLES = (".parquet", ".h5")  # suffixes of ensembles' tables


class Figures(StrEnum):
    """Figures of a run that ``kickdrift plot`` can draw."""

    orbits = "orbits"
    energies = "energies"
    rdf = "rdf"
    msd = "msd"
    vacf = "vacf"
    structure_factor = "structure-factor"


@with_options("dt", "rtol", "atol")
def plot(
    file: Annotated[
        Path | None,
        typer.Argument(
            metavar="[FILE]",
            help="A run's .h5md; a .h5, .csv or .parquet of an ODE or an ensemble; or an ODE's system file or name.",
        ),
    ] = None,
    output: Annotated[
        Path | None, typer.Option(metavar="FILE.png", help="Default: FILE.png beside the file, or stability.png.")
    ] = None,
    kind: Annotated[
        Figures | None,
        typer.Option(metavar="NAME", help=f"{', '.join(Figures)} (default: orbits under gravity, else energies)."),
    ] = None,
    stability: Annotated[
        list[str] | None,
        typer.Option(metavar="NAME", help="Draw an integrator's stability region, without a run; repeat for several."),
    ] = None,
    column: Annotated[
        str | None,
        typer.Option(
            metavar="NAME", help="Column of a run, or of an ensemble's table (default: the most informative)."
        ),
    ] = None,
    integrator: Annotated[
        list[str] | None,
        typer.Option(metavar="NAME", help="Run an ODE's system file with this method and draw it; repeat for several."),
    ] = None,
    options: Any = None,
    time: Annotated[
        float | None, typer.Option(metavar="T", help="Length of these runs (default: the system file's).")
    ] = None,
    overwrite: OverwriteOption = False,
    quiet: QuietOption = False,
) -> None:
    """Draw a run, an ensemble or stability regions. A run gives orbits and elements; or energies, error, temperature
    and radial distribution function; or one observable with error bars; or one column against time. The run of an ODE
    gives y against time, the phase portrait and the energy error. The name of an ODE's system file gives these of
    several methods side by side. An ensemble gives a map, a curve, points or a histogram."""
    if stability and (file or kind or column):
        raise InputError("give FILE or --stability, not both")
    if file and _is_system(file):
        if kind or column:
            raise InputError(f"--{'kind' if kind else 'column'} is for a run's file, and FILE is a system file")
        out(str(_plot_methods(file, output, integrator, options, time, overwrite, quiet)))
        return
    if integrator or options or time is not None:
        raise InputError("--integrator, --time and options of a method are for an ODE's system file or name")
    if file and _is_problem(file):
        from kickdrift.plots.problems import plot_problem

        if kind:
            raise InputError("--kind is for a run's .h5md, and FILE is the run of an ODE")
        with busy(f"drawing {file}", quiet):
            drawn = plot_problem(file, output or file.with_suffix(".png"), column, overwrite=overwrite)
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
            drawn = plot_stability(stability, output or Path("stability.png"), overwrite=overwrite)
        out(str(drawn))
        print_stability(stability)
    elif file and of_ensemble:
        from kickdrift.plots.ensemble import plot_ensemble

        with busy(f"drawing {file}", quiet):
            drawn = plot_ensemble(file, output or file.with_suffix(".png"), column, overwrite=overwrite)
        out(str(drawn))
    elif file:
        from kickdrift.plots.figures import plot_file

        target = output or file.with_suffix(".png")
        with busy(f"drawing {file}", quiet):
            drawn = plot_file(file, target, kind and str(kind), column, overwrite=overwrite)
        out(str(drawn))
        if not kind and not column:
            name_columns(file)
    else:
        raise InputError("give FILE, or --stability NAME to draw an integrator")


def _is_system(file: Path) -> bool:
    """Whether FILE names a system file rather than a run."""
    from kickdrift.systemfile.files import is_shipped

    return file.suffix == ".toml" or is_shipped(str(file))


def _is_problem(file: Path) -> bool:
    """Whether FILE is the run of a Problem, or its table."""
    from kickdrift.trajectory.opened import is_problem

    return file.suffix.lower() in (*TABLES, ".csv") and is_problem(file)


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
    from kickdrift.model.problem import Problem
    from kickdrift.plots.problems import plot_methods
    from kickdrift.systemfile.reading import load

    problem = load(str(file))
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


def export(
    file: Annotated[Path, typer.Argument(metavar="FILE.h5md", help="A run's file.")],
    output: Annotated[
        Path,
        typer.Argument(
            metavar="OUT", help="The suffix sets the format: dcd, xtc, trr, xyz, pdb, extxyz, traj, data, bin."
        ),
    ],
    unwrapped: Annotated[
        bool,
        typer.Option("--unwrapped/--wrapped", help="Unwrapped positions as in the run, or positions inside the box."),
    ] = False,
    start: Annotated[int | None, typer.Option(metavar="A", help="First frame, from 0; negative from the end.")] = None,
    stop: Annotated[int | None, typer.Option(metavar="B", help="First frame after the chosen ones.")] = None,
    step: Annotated[int | None, typer.Option(metavar="C", min=1, help="Only every C-th frame.")] = None,
    overwrite: OverwriteOption = False,
    quiet: QuietOption = False,
) -> None:
    """Write a run's frames for other programs, and print what the format loses."""
    from kickdrift.trajectory.export.export import export as write

    with progress_bar(quiet) as bar:
        done = write(
            file, output, unwrapped=unwrapped, start=start, stop=stop, step=step, overwrite=overwrite,
            progress=bar("exporting"),
        )  # fmt: skip
    say("; ".join([done.losses, *done.notes]), quiet)
    out(f"{done.path}: {counted(done.frames, 'frame')} of {counted(done.particles, 'particle')}")


def info(
    file: Annotated[
        str, typer.Argument(metavar="FILE", help="A run's file, an ensemble's table, or a system file or name.")
    ],
    all_: Annotated[bool, typer.Option("--all", help="Everything that a run's file holds.")] = False,
    json_file: JsonOption = None,
    overwrite: OverwriteOption = False,
) -> None:
    """Describe a run's file or an ensemble's table, or check a system file without running it."""
    refuse_outputs({"json": json_file}, overwrite, [file])
    from kickdrift.systemfile.files import is_shipped
    from kickdrift.systemfile.reading import load

    if Path(file).suffix == ".h5md" and not os.path.lexists(file):
        raise InputError(f"{file}: no such file")
    if _is_problem(Path(file)):
        _info_of_problem(file, all_, json_file, overwrite)
        return
    archive = Path(file).suffix.lower() == ".bin"
    of_run = (
        not archive
        and os.path.lexists(file)
        and Path(file).suffix.lower() not in (*TABLES, ".toml")
        and not is_shipped(file)
    )
    if (all_ or json_file is not None) and not of_run:
        raise InputError(f"{file}: {'--all' if all_ else '--json'} is for the file of a run")
    if Path(file).suffix.lower() in TABLES:
        from kickdrift.cli.printing_ensemble import print_ensemble
        from kickdrift.ensemble import Ensemble

        print_ensemble(Ensemble.read(file), Path(file))
        return
    if not of_run:
        system = load(file)
        check_run(system)
        print_system(system)
        return
    from kickdrift.trajectory.overview import overview
    from kickdrift.trajectory.read.info import WIDTH, described
    from kickdrift.trajectory.read.info import info as found

    if all_ or json_file is not None:
        with busy(f"reading {file}"):
            content = found(file)
    if all_:
        rows = described(content)
        out(content["file"])
        print_lines(rows, min(WIDTH, max(len(key) for key, _ in rows)))
    else:
        with busy(f"reading {file}"):
            lines = overview(file)
        print_lines(lines)
    if json_file is not None:
        write_json(json_file, content, overwrite=overwrite)


def _info_of_problem(file: str, whole: bool, json_file: Path | None, overwrite: bool) -> None:
    """Describe the file of a Problem's run, or its table."""
    from kickdrift.trajectory.opened import open as opened
    from kickdrift.trajectory.overview import overview_of_problem
    from kickdrift.trajectory.problems.reader import ProblemRun, describe_any
    from kickdrift.trajectory.problems.reader import info as found

    with opened(file) as run:
        table = not isinstance(run, ProblemRun)
        if table and json_file is not None:
            raise InputError(f"{file}: --json is for the file of a run, and FILE is a table")
        if whole or table:
            for line in describe_any(run).split("\n"):
                out(line)
        else:
            print_lines(overview_of_problem(run))
        if json_file is not None:
            write_json(json_file, found(run), overwrite=overwrite)


def check_run(system: System | Problem) -> None:
    """Raise InputError if a system's [run] names no method, or options that the method does not take."""
    from kickdrift.integrators import integrator
    from kickdrift.integrators.asked import settled

    if system.run.integrator is not None:
        try:
            settled(integrator(system.run.integrator), {}, system.run, getattr(system, "units", None))
        except InputError as error:
            raise InputError(f"run: {error}") from None

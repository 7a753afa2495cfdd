"""The commands ``plot``, ``export`` and ``info``, which read a run's file."""

from __future__ import annotations

import os
from enum import StrEnum
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from kickdrift.cli.console import out, progress_bar, say
from kickdrift.cli.options import (
    OverwriteOption,
    QuietOption,
)
from kickdrift.cli.printing import (
    print_stability,
    print_system,
)
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


def plot(
    file: Annotated[
        Path | None, typer.Argument(metavar="[FILE]", help="A run's .h5md, or the .parquet or .h5 of an ensemble.")
    ] = None,
    output: Annotated[
        Path | None, typer.Option(metavar="FILE.png", help="Default: FILE.png beside the file, or stability.png.")
    ] = None,
    kind: Annotated[
        Figures | None, typer.Option(help="Figure of a run (default: orbits under gravity, else energies).")
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
    overwrite: OverwriteOption = False,
) -> None:
    """Draw a run, an ensemble or stability regions. A run gives orbits and elements; or energies, error, temperature
    and radial distribution function; or one observable with error bars; or one column against time. An ensemble gives
    a map, a curve, points or a histogram."""
    if stability and (file or kind or column):
        raise InputError("give FILE or --stability, not both")
    of_ensemble = file is not None and file.suffix.lower() in TABLES
    if of_ensemble and kind:
        raise InputError("--kind is for a run's .h5md, and FILE is the table of an ensemble")
    if kind and column:
        raise InputError("give --kind or --column, not both")
    if stability:
        from kickdrift.plots.stability import plot_stability

        out(str(plot_stability(stability, output or Path("stability.png"), overwrite=overwrite)))
        print_stability(stability)
    elif file and of_ensemble:
        from kickdrift.plots.ensemble import plot_ensemble

        out(str(plot_ensemble(file, output or file.with_suffix(".png"), column, overwrite=overwrite)))
    elif file:
        from kickdrift.plots.figures import plot_file

        target = output or file.with_suffix(".png")
        out(str(plot_file(file, target, kind and str(kind), column, overwrite=overwrite)))
    else:
        raise InputError("give FILE, or --stability NAME to draw an integrator")


def export(
    file: Annotated[Path, typer.Argument(metavar="FILE.h5md", help="A run's file.")],
    output: Annotated[
        Path,
        typer.Argument(metavar="OUT", help="The suffix sets the format: dcd, xtc, trr, xyz, pdb, extxyz, traj."),
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
    from kickdrift.trajectory.export import export as write

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
) -> None:
    """Describe a run's file or an ensemble's table, or check a system file without running it."""
    from kickdrift.systemfile.files import is_shipped
    from kickdrift.systemfile.reading import load

    if Path(file).suffix == ".h5md" and not os.path.lexists(file):
        raise InputError(f"{file}: no such file")
    if Path(file).suffix.lower() in TABLES:
        from kickdrift.cli.printing_ensemble import print_ensemble
        from kickdrift.ensemble import Ensemble

        print_ensemble(Ensemble.read(file), Path(file))
        return
    if Path(file).suffix == ".toml" or is_shipped(file) or not os.path.lexists(file):
        system = load(file)
        check_run(system)
        print_system(system)
        return
    from kickdrift.trajectory.info import describe
    from kickdrift.trajectory.info import info as found

    for line in describe(found(file)).split("\n"):
        out(line)


def check_run(system: System | Problem) -> None:
    """Raise InputError if a system's [run] names no method, or options that the method does not take."""
    from kickdrift.integrators import integrator
    from kickdrift.integrators.asked import settled

    if system.run.integrator is not None:
        try:
            settled(integrator(system.run.integrator), {}, system.run)
        except InputError as error:
            raise InputError(f"run: {error}") from None

"""The commands ``compare`` and ``chaos``."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any

import typer

from kickdrift.cli.console import print_lines, print_table, progress_bar, say
from kickdrift.cli.options import (
    JsonOption,
    OverwriteOption,
    QuietOption,
    SubjectArgument,
    ThreadsOption,
    with_options,
)
from kickdrift.disk.outputs import refuse_outputs, write_json
from kickdrift.display.showing import lines_of, tables_of


@with_options()
def compare(
    system: SubjectArgument,
    integrator: Annotated[
        list[str] | None,
        typer.Option(metavar="NAME", help="Integrator; repeat for several (default: a suitable choice)."),
    ] = None,
    options: Any = None,
    time: Annotated[
        float | None, typer.Option(metavar="T", help="Length of the pilot runs (default: about a minute's worth).")
    ] = None,
    accuracy: Annotated[
        float | None, typer.Option(metavar="X", help="Wanted relative error: recommend a method and a step.")
    ] = None,
    length: Annotated[
        float | None, typer.Option(metavar="T", help="Length of the planned run (default: the file's).")
    ] = None,
    seed: Annotated[int | None, typer.Option(metavar="S", min=0, help="Seed of random velocities.")] = None,
    threads: ThreadsOption = 1,
    json_file: JsonOption = None,
    plot: Annotated[
        Path | None, typer.Option(metavar="FILE.png", help="Draw error against evaluations and seconds.")
    ] = None,
    overwrite: OverwriteOption = False,
    quiet: QuietOption = False,
) -> None:
    """Measure work against precision: the error and the cost of each integrator over steps or tolerances."""
    refuse_outputs({"json": json_file, "plot": plot}, overwrite, [system])
    from kickdrift.analysis.comparing import compared
    from kickdrift.systemfile.python_file import load_or_run

    subject = load_or_run(system, seed)
    notice = "compiling (the first time on a machine takes longest) and comparing: about a minute …"
    with progress_bar(quiet) as bar:
        found = compared(
            subject, integrator, bar, time, accuracy, length, threads, options, system, lambda: say(notice, quiet)
        )
    for title, columns, rows in tables_of(found):
        print_table(title, columns, rows)
    print_lines(lines_of(found))
    write_json(json_file, found.as_json(), overwrite=overwrite)
    if plot:
        from kickdrift.plots.compare import plot_comparison

        plot_comparison(found, plot, overwrite=overwrite)
    if found.recommendation and found.recommendation.choice is None:
        raise typer.Exit(1)


@with_options("dt", "rtol", "atol")
def chaos(
    system: SubjectArgument,
    time: Annotated[float | None, typer.Option(metavar="T", help="Length of the run (default: the file's).")] = None,
    integrator: Annotated[
        str | None, typer.Option(metavar="NAME", help="Default: the file's if it can carry deviations, else dop853.")
    ] = None,
    options: Any = None,
    seed: Annotated[int, typer.Option(metavar="S", min=0, help="Seed of the first deviation.")] = 0,
    threads: ThreadsOption = 1,
    json_file: JsonOption = None,
    overwrite: OverwriteOption = False,
    quiet: QuietOption = False,
) -> None:
    """Tell regular from chaotic motion: MEGNO and the largest Lyapunov exponent from the variational equations."""
    refuse_outputs({"json": json_file}, overwrite, [system])
    from kickdrift.analysis.chaos import megno
    from kickdrift.systemfile.python_file import load_or_run

    subject = load_or_run(system)
    with progress_bar(quiet) as bar:
        found = megno(subject, time, integrator, seed=seed, threads=threads, progress=bar("running"), **options)
    try:
        write_json(json_file, found.as_json(), overwrite=overwrite)
    finally:
        print_lines(lines_of(found))

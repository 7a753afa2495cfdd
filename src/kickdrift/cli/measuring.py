"""The commands ``compare`` and ``chaos``."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any

import typer

from kickdrift.cli.amounts import in_units
from kickdrift.cli.amounts import length as span
from kickdrift.cli.console import progress_bar, say
from kickdrift.cli.options import (
    JsonOption,
    OverwriteOption,
    QuietOption,
    SystemArgument,
    ThreadsOption,
    with_options,
)
from kickdrift.cli.printing import (
    print_chaos,
)
from kickdrift.disk.outputs import refuse_outputs, write_json


@with_options()
def compare(
    system: SystemArgument,
    integrator: Annotated[
        list[str] | None,
        typer.Option(metavar="NAME", help="Integrator; repeat for several (default: a suitable choice)."),
    ] = None,
    options: Any = None,
    time: Annotated[
        Any, typer.Option(metavar="T", parser=span, help="Length of the pilot runs (default: about a minute's worth).")
    ] = None,
    accuracy: Annotated[
        float | None, typer.Option(metavar="X", help="Wanted relative error: recommend a method and a step.")
    ] = None,
    length: Annotated[
        Any, typer.Option(metavar="T", parser=span, help="Length of the planned run (default: the file's).")
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
    from kickdrift.analysis import work_precision as work
    from kickdrift.analysis.compared_methods import chosen_methods
    from kickdrift.analysis.recommendation import recommendation
    from kickdrift.cli.printing_compare import print_comparison, print_recommendation
    from kickdrift.integrators.asked import in_units as options_in_units
    from kickdrift.integrators.asked import known_options
    from kickdrift.integrators.option import DT
    from kickdrift.model.system import System
    from kickdrift.systemfile.reading import load

    subject = load(system, seed)
    time, length = in_units(time, subject, "--time"), in_units(length, subject, "--length")
    units = subject.units if isinstance(subject, System) else None
    options = options_in_units(options, [DT, *known_options().values()], units)
    work.check_arguments(time, length, accuracy, threads)
    if isinstance(subject, System):
        subject = subject.watched(())  # every method and step is compared with one reference trajectory
    chosen_methods(subject, integrator, options)
    say("comparing: about a minute …", quiet)
    with progress_bar(quiet) as bar:
        start = work.equilibrated(subject, threads, bar)
        found = work.work_precision(
            subject, integrator, time, whole=length, accuracy=accuracy, start=start, threads=threads, options=options,
            progress=bar("comparing"),
        )  # fmt: skip
    advice = recommendation(found, accuracy) if accuracy is not None else None
    print_comparison(found)
    if advice:
        print_recommendation(advice, system, found.time_unit)
    content = found.as_json() | {"recommendation": advice.as_json() if advice else None}
    write_json(json_file, content, overwrite=overwrite)
    if plot:
        from kickdrift.plots.compare import plot_comparison

        plot_comparison(found, plot, overwrite=overwrite)
    if advice and advice.choice is None:
        raise typer.Exit(1)


@with_options("dt", "rtol", "atol")
def chaos(
    system: SystemArgument,
    time: Annotated[
        Any, typer.Option(metavar="T", parser=span, help="Length of the run, such as '5 yr' (default: the file's).")
    ] = None,
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
    from kickdrift.systemfile.reading import load

    subject = load(system)
    time = in_units(time, subject, "--time")
    with progress_bar(quiet) as bar:
        found = megno(subject, time, integrator, seed=seed, threads=threads, progress=bar("running"), **options)
    try:
        write_json(json_file, found.as_json(), overwrite=overwrite)
    finally:
        print_chaos(found)

"""The commands ``bench`` and ``validate``."""

from __future__ import annotations

from importlib.util import find_spec
from pathlib import Path
from typing import Annotated, Any

import typer

from kickdrift.cli.amounts import whole
from kickdrift.cli.console import print_table, progress_bar, say
from kickdrift.cli.options import (
    JsonOption,
    OverwriteOption,
    QuietOption,
    ThreadsOption,
)
from kickdrift.cli.printing import (
    duration,
    print_benchmark,
    print_claims,
)
from kickdrift.disk.outputs import refuse_outputs, write_json
from kickdrift.errors import InputError


def bench_lj_energy(
    particles: Annotated[
        int, typer.Option(metavar="N", min=1, help="Number of particles; a cube such as 1000.")
    ] = 1000,
    steps: Annotated[
        int | None,
        typer.Option(
            metavar="N", parser=whole(1), help="Steps of 0.005 (default 2000; the full benchmark has 1000000)."
        ),
    ] = None,
    integrator: Annotated[
        list[str] | None, typer.Option(metavar="NAME", help="Integrator; repeat for several.")
    ] = None,
    threads: ThreadsOption = 1,
    json_file: JsonOption = None,
    plot: Annotated[Path | None, typer.Option(metavar="FILE.png", help="Draw the energy errors against time.")] = None,
    overwrite: OverwriteOption = False,
    quiet: QuietOption = False,
) -> None:
    """The Lennard-Jones energy benchmark: energy error and drift of integrators, at equal step and at equal cost."""
    refuse_outputs({"json": json_file, "plot": plot}, overwrite)
    from kickdrift.analysis.compare import bench
    from kickdrift.forces.bound.forces import check_threads
    from kickdrift.integrators import integrator as method_named

    methods = list(dict.fromkeys(method_named(name).name for name in integrator or bench.METHODS))
    check_threads(threads)
    system = bench.benchmark_system(particles)
    say("timing a short pilot run …", quiet)
    plan = bench.plan(system, methods, steps if steps is not None else bench.DEFAULT_STEPS, threads)
    say(f"expected time: {duration(plan.seconds)}", quiet)
    with progress_bar(quiet) as bar:
        bars: dict[str, Any] = {}

        def progress(label: str, done: int, of: int) -> None:
            if label not in bars:
                bars[label] = bar(label)
            bars[label](done, of)

        rows, seconds = bench.timed(lambda: bench.lj_energy(system, plan, threads, progress))
    print_benchmark(rows, len(system), seconds)
    if plan.runs[0][3] >= bench.FULL_STEPS:
        print_claims(rows, bench.CLAIMED)
    write_json(json_file, bench.as_json(system, rows, seconds, threads), overwrite=overwrite)
    if plot:
        from kickdrift.plots.runs import plot_benchmark

        drawn = [
            {
                "table": row.table,
                "method": row.method,
                "dt": row.dt,
                "times": row.times,
                "relative_error": row.relative_error,
                "verdict": row.report.energy.verdict if row.report else "blew up",
            }
            for row in rows
        ]
        plot_benchmark(drawn, plot, overwrite=overwrite)


def bench_speed(
    only: Annotated[
        list[str] | None,
        typer.Option(metavar="GROUP", help="Group to run; repeat for several (default: the usual groups). See --list."),
    ] = None,
    turns: Annotated[int, typer.Option(metavar="N", min=2, help="Turns per program; the median is reported.")] = 7,
    seconds: Annotated[float, typer.Option(metavar="X", min=0.001, help="Seconds per turn.")] = 0.4,
    listing: Annotated[bool, typer.Option("--list", help="List the groups and run none.")] = False,
    json_file: JsonOption = None,
    overwrite: OverwriteOption = False,
    quiet: QuietOption = False,
) -> None:
    """Time kickdrift beside every other installed program, in turns on the same systems, with each energy error."""
    refuse_outputs({"json": json_file}, overwrite)
    need_validation("bench speed")
    from kickdrift_validation.performance import speed

    entries = speed.chosen(only or ())
    if listing:
        print_table(None, *speed.listed())
        return
    length = duration(speed.expected_seconds(entries, turns, seconds))
    say(f"expected time: {length}, plus compilation where it is needed", quiet)
    with progress_bar(quiet) as bar:
        found = speed.measure(entries, turns, seconds, bar)
    for line in speed.left_out(found):
        say(f"left out: {line}", quiet)
    try:
        write_json(json_file, found, overwrite=overwrite)
    finally:
        speed.print_found(found)


def validate(
    names: Annotated[
        list[str] | None,
        typer.Argument(metavar="NAME", help="Scripts (default: all). See --list."),
    ] = None,
    long: Annotated[bool, typer.Option("--long", help="Run every claim (default: some minutes' worth).")] = False,
    jobs: Annotated[int, typer.Option(metavar="K", min=1, help="Scripts that run at once.")] = 2,
    report: Annotated[
        Path | None, typer.Option(metavar="FILE.md", help="File of the report; its figures go into a folder beside it.")
    ] = None,
    listing: Annotated[bool, typer.Option("--list", help="List the scripts and run none.")] = False,
    quiet: QuietOption = False,
) -> None:
    """Compare kickdrift with other people's programs and data and write a report; exit status 1 if a claim fails."""
    need_validation("validate")
    from kickdrift_validation import runner

    if listing:
        runner.listed()
        return
    raise typer.Exit(runner.validate(names or (), long, jobs, report, quiet))


def need_validation(command: str) -> None:
    """Raise InputError if the package of the validation scripts is missing."""
    if find_spec("kickdrift_validation") is None:
        raise InputError(f"{command}: this copy of kickdrift lacks the package kickdrift_validation")

"""The commands ``bench`` and ``validate``."""

from __future__ import annotations

from dataclasses import asdict
from importlib.util import find_spec
from pathlib import Path
from typing import Annotated, Any

import typer

from kickdrift.cli.console import out, print_table, progress_bar, say
from kickdrift.cli.options import Json, Overwrite, Quiet, Threads, argument, option, turn_seconds, whole
from kickdrift.disk.outputs import refuse_outputs, write_json
from kickdrift.errors import InputError
from kickdrift.integrators import integrator as method_named
from kickdrift.looks.report_lines import drift_text
from kickdrift.text import duration


def bench_lj_energy(
    particles: Annotated[int, option("N", "Number of particles; a cube such as 1000.", min=1)] = 1000,
    steps: Annotated[
        int | None, option("N", "Steps of 0.005 (default 2000; the full benchmark has 1000000).", parser=whole(1))
    ] = None,
    integrator: Annotated[list[str] | None, option("NAME", "Integrator; repeat for several.")] = None,
    threads: Threads = 1,
    json_file: Json = None,
    plot: Annotated[Path | None, option("FILE.png", "Draw the energy errors against time.")] = None,
    overwrite: Overwrite = False,
    quiet: Quiet = False,
) -> None:
    """The Lennard-Jones energy benchmark: energy error and drift of integrators, at equal step and at equal cost."""
    refuse_outputs({"json": json_file, "plot": plot}, overwrite)
    from kickdrift.analysis.compare import bench
    from kickdrift.forces.bound.forces import check_threads

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
        list[str] | None, option("GROUP", "Group to run; repeat for several (default: the usual groups). See --list.")
    ] = None,
    turns: Annotated[int, option("N", "Turns per program; the median is reported.", min=2)] = 7,
    seconds: Annotated[float, option("X", "Seconds per turn.", parser=turn_seconds)] = 0.4,
    listing: Annotated[bool, typer.Option("--list", help="List the groups and run none.")] = False,
    json_file: Json = None,
    overwrite: Overwrite = False,
    quiet: Quiet = False,
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


def bench_lammps(
    only: Annotated[
        list[str] | None, option("NAME", "lj, chain, eam or rhodo; repeat for several (default: all four).")
    ] = None,
    multiples: Annotated[
        tuple[float, float, float],
        typer.Option("--multiples", metavar="X Y Z", help="Box of 32,000 atoms times these, along each axis."),
    ] = (1.0, 1.0, 1.0),
    turns: Annotated[int, option("N", "Turns per program; the median is reported.", min=2)] = 7,
    seconds: Annotated[float, option("X", "Seconds per turn.", parser=turn_seconds)] = 1.0,
    json_file: Json = None,
    overwrite: Overwrite = False,
    quiet: Quiet = False,
) -> None:
    """LAMMPS' published benchmarks, in LAMMPS and kickdrift on one core, in turns from the same atoms."""
    refuse_outputs({"json": json_file}, overwrite)
    need_validation("bench lammps")
    from kickdrift_validation.performance import published
    from kickdrift_validation.performance.turns import Missing

    found = []
    for name in published.chosen(only or ()):
        try:
            found.append(published.measure(name, multiples, turns, seconds))
        except Missing as missing:
            raise InputError(f"bench lammps: {missing}") from None
    print_table(None, published.COLUMNS, [each.cells for each in found])
    for name, why in published.OUT.items():
        say(f"{name} {why}", quiet)
    rows = [{**each._asdict(), "ratio": each.ratio._asdict()} for each in found]
    write_json(json_file, {"benchmark": "lammps", "rows": rows}, overwrite=overwrite)


def bench_compile(
    only: Annotated[list[str] | None, option("NAME", "Command; repeat for several (default: all twelve).")] = None,
    listing: Annotated[bool, typer.Option("--list", help="List the commands and run none.")] = False,
    json_file: Json = None,
    overwrite: Overwrite = False,
    quiet: Quiet = False,
) -> None:
    """What compiling costs: usual commands, each from an empty folder of compiled code, one after another."""
    refuse_outputs({"json": json_file}, overwrite)
    need_validation("bench compile")
    from kickdrift_validation.performance import compiling

    names = compiling.chosen(only or ())
    if listing:
        print_table(None, ["name", "command"], [[name, compiling.COMBINATIONS[name]] for name in names])
        return
    found = []
    with progress_bar(quiet) as bar:
        told = bar("compiling")
        for k, name in enumerate(names):
            told(k, len(names))
            found.append(compiling.measure(name))
    print_table(None, compiling.COLUMNS, [each.cells for each in found])
    write_json(json_file, {"benchmark": "compile", "rows": [each._asdict() for each in found]}, overwrite=overwrite)


def validate(
    names: Annotated[list[str] | None, argument("NAME", "Scripts (default: all). See --list.")] = None,
    long: Annotated[bool, typer.Option("--long", help="Run every claim (default: some minutes' worth).")] = False,
    jobs: Annotated[int, option("K", "Scripts that run at once.", min=1)] = 2,
    report: Annotated[
        Path | None, option("FILE.md", "File of the report; its figures go into a folder beside it.")
    ] = None,
    listing: Annotated[bool, typer.Option("--list", help="List the scripts and run none.")] = False,
    quiet: Quiet = False,
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


def print_benchmark(rows: list[Any], particles: int, seconds: float) -> None:
    """Print the benchmark's two tables on standard output."""
    titles = {"same step": "Equal step", "same cost": "Equal cost: 1000 force evaluations per unit of time"}
    columns = ["method", "dt", "RMS error", "largest", "drift per unit time", "steps/s", "verdict"]
    for table, title in titles.items():
        body = []
        for row in rows:
            if row.table == table and row.report:
                e = row.report.energy
                body.append(
                    [
                        row.method,
                        f"{row.dt:g}",
                        f"{100 * e.rms_relative_error:.2g} %",
                        f"{100 * e.max_relative_error:.2g} %",
                        drift_text(asdict(e)) or "–",
                        f"{row.report.steps_per_second:,.0f}",
                        e.verdict,
                    ]
                )
            elif row.table == table:
                body.append([row.method, f"{row.dt:g}", "–", "–", "–", "–", row.failure])
        print_table(title, columns, body)
    out(
        f"{particles:,} particles, errors relative to |E(0)|; velocity-verlet is leapfrog in its kick-drift-kick form. "
        f"Time: {duration(seconds)}."
    )


def print_claims(rows: list[Any], claimed: dict[str, str]) -> None:
    """Print the literature's claims on the full benchmark beside the measured values, on standard output."""
    body = []
    for row in rows:
        if row.method in claimed:
            e = row.report.energy if row.report else None
            measured = f"{100 * e.rms_relative_error:.2g} %, {e.verdict}" if e else str(row.failure)
            body.append([row.method, f"{row.dt:g}", claimed[row.method], measured])
    print_table("RMS energy error over 10^6 steps", ["method", "dt", "claimed in the literature", "measured"], body)

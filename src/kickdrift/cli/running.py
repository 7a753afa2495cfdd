"""The commands ``run`` and ``resume``."""

from __future__ import annotations

from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from kickdrift.cli.amounts import in_units, length, row, whole
from kickdrift.cli.console import busy, print_lines, progress_bar, say
from kickdrift.cli.equilibrating import with_keys
from kickdrift.cli.interruption import Interruption
from kickdrift.cli.options import (
    FlushOption,
    HostsOption,
    JsonOption,
    OverwriteOption,
    QuietOption,
    SubjectArgument,
    ThreadsOption,
    method_names,
    with_options,
)
from kickdrift.cli.watching import ImdOption, ImdWaitOption, LiveOption, check_watching, watched
from kickdrift.disk.outputs import refuse_outputs, write_json
from kickdrift.display.showing import lines_of
from kickdrift.errors import InputError
from kickdrift.text import shown

if TYPE_CHECKING:
    from kickdrift.run.report.report import Report
    from kickdrift.run.simulation import Simulation
    from kickdrift.trajectory.layout.options import FileOptions


TimesOption = Annotated[
    Any,
    typer.Option(
        metavar="T,…",
        parser=row,
        help="Samples and frames at exactly these times, which rise: 1,2.5,4 or START:STOP:COUNT. The run ends at the "
        "last one.",
    ),
]


@with_options(
    "dt", "rtol", "atol", "max_step", "compensated", "precision", "coordinates", "corrector", "order", "eta", "scheme"
)
def run(
    system: SubjectArgument,
    integrator: Annotated[
        str | None,
        typer.Option(metavar="NAME", help="See: kickdrift list integrators.", autocompletion=method_names),
    ] = None,
    options: Any = None,
    steps: Annotated[
        int | None, typer.Option(metavar="N", parser=whole(0), help="Number of steps, such as 1e6.")
    ] = None,
    time: Annotated[
        Any,
        typer.Option(
            metavar="T",
            parser=length,
            help="Length of the run in time, such as '5 ps', instead of --steps; negative for a run back in time.",
        ),
    ] = None,
    exact: Annotated[
        str | None,
        typer.Option(
            metavar="NAME",
            help="With fixed steps, a --time between two steps: false runs to the nearest (default), true is an error, "
            "shorten shortens the last step.",
        ),
    ] = None,
    every: Annotated[
        int | None, typer.Option(metavar="K", parser=whole(1), help="Steps between samples and frames.")
    ] = None,
    interval: Annotated[
        Any,
        typer.Option(metavar="T", parser=length, help="Time between samples and frames, for adaptive methods."),
    ] = None,
    times: TimesOption = None,
    output: Annotated[
        Path | None, typer.Option(metavar="FILE", help="Write the trajectory: .h5md; of an ODE .h5, .csv or .parquet.")
    ] = None,
    overwrite: OverwriteOption = False,
    flush: FlushOption = None,
    store: Annotated[
        str | None, typer.Option(metavar="NAME", help="Type of stored frames: float64 (default), float32.")
    ] = None,
    old_store: Annotated[str | None, typer.Option("--precision", hidden=True)] = None,
    compress: Annotated[bool, typer.Option("--compress", help="Compress the file at the end; lossless.")] = False,
    write: Annotated[
        str | None, typer.Option(metavar="NAMES", help="Further data in frames: forces, images, or forces,images.")
    ] = None,
    seed: Annotated[int | None, typer.Option(metavar="S", min=0, help="Seed of random velocities.")] = None,
    equilibrate: Annotated[
        list[str] | None,
        typer.Option(
            "--equilibrate",
            "-e",
            metavar="KEY=VALUE",
            help="A key of the table [equilibrate]: temperature=2, to=1 and time=5 cool from 2 to 1. Repeatable.",
        ),
    ] = None,
    threads: ThreadsOption = 1,
    engine: Annotated[str, typer.Option(metavar="NAME", help="See: kickdrift list engines.")] = "native",
    processes: Annotated[
        int | None,
        typer.Option(
            metavar="N", min=1, help="Number of processes, for an engine that can use several: lammps (default: 1)."
        ),
    ] = None,
    hosts: HostsOption = None,
    imd: ImdOption = None,
    imd_wait: ImdWaitOption = False,
    live: LiveOption = None,
    json_file: JsonOption = None,
    quiet: QuietOption = False,
) -> None:
    """Run a system and report how well it conserved energy and momentum."""
    from kickdrift.engines import engine as engine_named
    from kickdrift.model.system import System
    from kickdrift.systemfile.python_file import load_or_run

    engine_named(engine)
    _refuse_both(steps=steps, time=time)
    for key, value in {"steps": steps, "time": time, "every": every, "interval": interval, "exact": exact}.items():
        _refuse_both(**{"times": times, key: value})
    refuse_outputs({"output": output, "json": json_file}, overwrite, [system])
    if old_store is not None:
        if store is not None:
            raise InputError("give --store; --precision is its old name")
        say("warning: --precision is deprecated since 0.2 and goes in 0.3; use --store", quiet)
        store = old_store
    given = {"flush": flush, "store": store, "compress": compress or None}
    file = file_options(output, given | {"write": write and tuple(each.strip() for each in write.split(","))})
    chosen = with_keys(load_or_run(system, seed), equilibrate or [])

    from kickdrift.run.files import check_suffix
    from kickdrift.run.plan.lengths import SHORTEN
    from kickdrift.run.simulation import Simulation
    from kickdrift.run.times import length_of

    choices: dict[str, Any] = {"true": True, "false": False, SHORTEN: SHORTEN}
    if exact is not None and exact not in choices:
        raise InputError(f"--exact {shown(exact)} is unknown; known are {', '.join(choices)}")
    if output is not None:
        check_suffix(chosen, str(output))
    ending = choices[exact or "false"]
    time, interval = in_units(time, chosen, "--time"), in_units(interval, chosen, "--interval")

    check_watching(chosen, live, imd, imd_wait, quiet)
    sim = Simulation(chosen, integrator, threads=threads, engine=engine, processes=processes, hosts=hosts, **options)
    wanted_length = partial(length_of, sim, system, steps, time, ending, times)
    wanted_length()  # or its error, before anything runs
    warn_of_version(sim, quiet)
    stopped = Interruption(output, isinstance(chosen, System))
    with stopped, watched(sim, live, imd, imd_wait, quiet), progress_bar(quiet) as bar:
        if isinstance(chosen, System) and chosen.equilibration:
            sim.equilibrate(**chosen.equilibration.said(), progress=bar("equilibrating"))
        ahead = wanted_length()
        last = in_units((ahead.get("times") or [ahead.get("until")])[-1], chosen, "--times")
        stopped.begins(sim, ahead.get("steps"), last)
        report = sim.run(
            **ahead, every=every, interval=interval, output=output, overwrite=overwrite, file=file,
            progress=bar("running"), imd=imd, imd_wait=imd_wait,
        )  # fmt: skip
    show(report, sim, output, json_file, quiet, overwrite)


def _refuse_both(**given: Any) -> None:
    """Refuse two options that say the same."""
    if all(value is not None for value in given.values()):
        one, other = given
        raise InputError(f"give --{one} or --{other}, not both")


def file_options(output: Path | None, given: dict[str, Any]) -> FileOptions | None:
    """Options of the output file; None without any."""
    from kickdrift.trajectory.layout.options import FileOptions

    asked = {key: value for key, value in given.items() if value is not None}
    if asked and output is None:
        raise InputError(f"--{next(iter(asked))}: needs --output")
    return FileOptions(**asked) if asked else None


def resume(
    file: Annotated[Path, typer.Argument(metavar="FILE", help="A run's .h5md, or the .h5 of an ODE, finished or not.")],
    steps: Annotated[
        int | None,
        typer.Option(metavar="N", parser=whole(0), help="Continue to this step, counted from the run's start."),
    ] = None,
    time: Annotated[
        Any,
        typer.Option(
            metavar="T", parser=length, help="Continue to this time since the run's start, instead of --steps."
        ),
    ] = None,
    times: TimesOption = None,
    threads: Annotated[
        int | None,
        typer.Option(metavar="K", min=1, help="Threads (default: as in the run); they do not change the results."),
    ] = None,
    hosts: HostsOption = None,
    flush: FlushOption = None,
    imd: ImdOption = None,
    imd_wait: ImdWaitOption = False,
    live: LiveOption = None,
    json_file: JsonOption = None,
    overwrite: Annotated[bool, typer.Option("--overwrite", help="Replace the JSON file.")] = False,
    quiet: QuietOption = False,
) -> None:
    """Finish an interrupted run or extend a finished one, with the same bits as an uninterrupted run."""
    _refuse_both(steps=steps, time=time)
    _refuse_both(times=times, steps=steps)
    _refuse_both(times=times, time=time)
    refuse_outputs({"json": json_file}, overwrite, [file])
    from kickdrift.run.resuming import continued
    from kickdrift.run.resuming import resume as taken_up
    from kickdrift.trajectory.opened import open as opened

    with Interruption(file, resumed=True) as stopped:
        with busy(f"reading {file}", quiet):
            sim = taken_up(file, threads=threads, hosts=hosts)
        check_watching(sim.system, live, imd, imd_wait, quiet)
        warn_of_version(sim, quiet)
        with opened(file) as run:
            options, closed = None if flush is None else replace(run.options, flush=flush), run.closed
        if sim.plan is None:
            raise InputError(f"{file}: the length of the run is not known; give --steps or --time")
        sim.plan = continued(sim, steps, in_units(time, sim.system, "--time"), times)
        if sim.plan.over(sim) and closed:
            more = "--times" if sim.plan.times else "--steps or --time"
            say(f"{file}: the run is finished at step {sim.steps_done}; {more} extend it", quiet)
            report = sim.report()
        else:
            with watched(sim, live, imd, imd_wait, quiet), progress_bar(quiet) as bar:
                say(f"{file}: continues from step {sim.steps_done}", quiet)
                stopped.begins(sim, sim.plan.end_step, sim.plan.end_time)
                report = sim.run(progress=bar("running"), file=options, imd=imd, imd_wait=imd_wait)
    show(report, sim, file, json_file, quiet, overwrite)


def warn_of_version(sim: Simulation, quiet: bool) -> None:
    """Warn of an untested version of an engine, and of what the system lacks, before the first step."""
    from kickdrift.engines import ENGINES
    from kickdrift.run.report.warnings import begins_badly

    for warning in [*ENGINES[sim.engine].warnings, *begins_badly(sim.system)]:
        say(f"warning: {warning}", quiet)


def show(
    report: Report, sim: Simulation, output: Path | None, json_file: Path | None, quiet: bool, overwrite: bool
) -> None:
    """Print a run's report with its warnings, and write the report on request."""
    try:
        write_json(json_file, report.as_json(), overwrite=overwrite)
    finally:  # a full disk does not lose the results
        print_lines(lines_of(report.written_to(output)))

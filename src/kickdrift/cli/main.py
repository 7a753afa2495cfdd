"""The command line: parse, call one function, print. Results go to standard output, the rest to standard error."""

from __future__ import annotations

import errno
import os
import sys
from dataclasses import replace
from enum import StrEnum
from importlib.util import find_spec
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from kickdrift.cli.console import open_streams, out, print_table, progress_bar, say
from kickdrift.cli.ensemble import ensemble
from kickdrift.cli.options import (
    AtolOption,
    FlushOption,
    JsonOption,
    OverwriteOption,
    QuietOption,
    RtolOption,
    SystemArgument,
    ThreadsOption,
    tolerance,
)
from kickdrift.cli.printing import (
    LISTINGS,
    counted,
    duration,
    print_benchmark,
    print_chaos,
    print_claims,
    print_report,
    print_stability,
    print_system,
)
from kickdrift.disk.interrupt import heard_everywhere
from kickdrift.disk.outputs import reason, refuse_outputs, write_json
from kickdrift.errors import InputError, KickdriftError

if TYPE_CHECKING:
    from kickdrift.model.problem import Problem
    from kickdrift.model.system import System
    from kickdrift.run.report import Report
    from kickdrift.run.simulation import Simulation
    from kickdrift.trajectory.options import FileOptions

app = typer.Typer(
    name="kickdrift",
    help="Molecular dynamics and N-body simulation in which you choose and measure the integrator.",
    no_args_is_help=True,
    add_completion=False,
    pretty_exceptions_enable=False,
    context_settings={"help_option_names": ["-h", "--help"]},
)
bench_app = typer.Typer(help="Benchmarks.", no_args_is_help=True)
app.add_typer(bench_app, name="bench")
app.command()(ensemble)

INTERRUPTED = 130
BAD_NAMES = (errno.ENAMETOOLONG, errno.ELOOP, errno.EILSEQ, errno.ENOTDIR, errno.EISDIR, errno.ENOENT)
TRACEBACK = "KICKDRIFT_TRACEBACK"  # the environment variable that shows the source of a bug
TABLES = (".parquet", ".h5")  # suffixes of ensembles' tables


class Figures(StrEnum):
    """Figures of a run that ``kickdrift plot`` can draw."""

    orbits = "orbits"
    energies = "energies"
    rdf = "rdf"
    msd = "msd"
    vacf = "vacf"
    structure_factor = "structure-factor"


class Lists(StrEnum):
    """Lists that ``kickdrift list`` can show."""

    integrators = "integrators"
    forces = "forces"
    systems = "systems"
    engines = "engines"


@app.callback()
def options(
    load: Annotated[
        list[Path] | None,
        typer.Option(
            "--load",
            metavar="FILE.py",
            envvar="KICKDRIFT_LOAD",
            help="First load a Python file that registers methods or forces.",
        ),
    ] = None,
) -> None:
    """Options before the command."""
    from kickdrift.integrators.registration import load_file

    for path in load or []:
        load_file(path)


@app.command()
def run(
    system: SystemArgument,
    integrator: Annotated[str | None, typer.Option(metavar="NAME", help="See: kickdrift list integrators.")] = None,
    dt: Annotated[
        float | None,
        typer.Option(metavar="X", help="Step in the system's unit of time; the first step of adaptive methods."),
    ] = None,
    rtol: RtolOption = None,
    atol: AtolOption = None,
    max_step: Annotated[float | None, typer.Option(metavar="X", help="Longest step of adaptive methods.")] = None,
    compensated: Annotated[
        bool, typer.Option("--compensated", help="Use compensated summation for positions and velocities.")
    ] = False,
    mixed: Annotated[
        bool | None,
        typer.Option("--mixed/--double", help="Pairs in float32 and everything else in float64, or all in float64."),
    ] = None,
    coordinates: Annotated[
        str | None, typer.Option(metavar="NAME", help="For wisdom-holman and saba: jacobi, democratic-heliocentric.")
    ] = None,
    corrector: Annotated[
        int | None, typer.Option(metavar="ORDER", help="Symplectic corrector of wisdom-holman: 3, 5, 7, 11, 17.")
    ] = None,
    order: Annotated[str | None, typer.Option(metavar="NAME", help="Order of saba, such as 10,4.")] = None,
    eta: Annotated[float | None, typer.Option(metavar="X", help="Accuracy of hermite4's steps.")] = None,
    scheme: Annotated[str | None, typer.Option(metavar="NAME", help="Steps of hermite4: shared, block.")] = None,
    steps: Annotated[int | None, typer.Option(metavar="N", min=0, help="Number of steps.")] = None,
    time: Annotated[
        float | None, typer.Option(metavar="T", help="Length of the run in time, instead of --steps.")
    ] = None,
    every: Annotated[int | None, typer.Option(metavar="K", min=1, help="Steps between samples and frames.")] = None,
    interval: Annotated[
        float | None,
        typer.Option(metavar="T", help="Time between samples and frames, for adaptive methods."),
    ] = None,
    output: Annotated[Path | None, typer.Option(metavar="FILE.h5md", help="Write the trajectory.")] = None,
    overwrite: OverwriteOption = False,
    flush: FlushOption = None,
    precision: Annotated[
        str | None, typer.Option(metavar="NAME", help="Type of stored frames: float64 (default), float32.")
    ] = None,
    compress: Annotated[bool, typer.Option("--compress", help="Compress the file at the end; lossless.")] = False,
    write: Annotated[
        str | None, typer.Option(metavar="NAMES", help="Further data in frames: forces, images, or forces,images.")
    ] = None,
    seed: Annotated[int | None, typer.Option(metavar="S", min=0, help="Seed of the drawn velocities.")] = None,
    threads: ThreadsOption = 1,
    engine: Annotated[str, typer.Option(metavar="NAME", help="See: kickdrift list engines.")] = "native",
    processes: Annotated[
        int, typer.Option(metavar="N", min=1, help="Number of processes, for an engine that can use several: lammps.")
    ] = 1,
    json_file: JsonOption = None,
    quiet: QuietOption = False,
) -> None:
    """Run a system and report how well it conserved energy and momentum."""
    from kickdrift.engines import engine as engine_named
    from kickdrift.model.system import System
    from kickdrift.systemfile.reading import load

    engine_named(engine)
    if steps is not None and time is not None:
        raise InputError("give --steps or --time, not both")
    refuse_outputs({"output": output, "json": json_file}, overwrite, [system])
    given = {"flush": flush, "precision": precision, "compress": compress or None}
    file = file_options(output, given | {"write": write and tuple(each.strip() for each in write.split(","))})
    chosen = load(system, seed)

    from kickdrift.run.plan import length_of
    from kickdrift.run.simulation import Simulation

    sim = Simulation(
        chosen, integrator, dt, threads, engine=engine, processes=processes,
        rtol=tolerance("rtol", rtol), atol=tolerance("atol", atol), max_step=max_step, compensated=compensated,
        coordinates=coordinates, corrector=corrector, order=order, eta=eta, scheme=scheme,
        precision=None if mixed is None else "mixed" if mixed else "double",
    )  # fmt: skip
    length = length_of(sim, system, steps, time)
    warn_of_version(sim, quiet)
    with progress_bar(quiet) as bar:
        if isinstance(chosen, System) and chosen.equilibration:
            wanted = chosen.equilibration
            sim.equilibrate(wanted.temperature, wanted.time, wanted.interval, bar("equilibrating"))
        report = sim.run(
            **length, every=every, interval=interval, output=output, overwrite=overwrite, file=file,
            progress=bar("running"),
        )  # fmt: skip
    show(report, sim, output, json_file, quiet, overwrite)


def file_options(output: Path | None, given: dict[str, Any]) -> FileOptions | None:
    """Options of the output file; None without any."""
    from kickdrift.trajectory.options import FileOptions

    asked = {key: value for key, value in given.items() if value is not None}
    if asked and output is None:
        raise InputError(f"--{next(iter(asked))}: needs --output")
    return FileOptions(**asked) if asked else None


@app.command()
def resume(
    file: Annotated[Path, typer.Argument(metavar="FILE.h5md", help="The file of a run, finished or not.")],
    steps: Annotated[
        int | None, typer.Option(metavar="N", min=0, help="Continue to this step, counted from the run's start.")
    ] = None,
    time: Annotated[
        float | None, typer.Option(metavar="T", help="Continue to this time since the run's start, instead of --steps.")
    ] = None,
    threads: Annotated[
        int | None,
        typer.Option(metavar="K", min=1, help="Threads (default: as in the run); they do not change the results."),
    ] = None,
    flush: FlushOption = None,
    json_file: JsonOption = None,
    overwrite: Annotated[bool, typer.Option("--overwrite", help="Replace the JSON file.")] = False,
    quiet: QuietOption = False,
) -> None:
    """Finish an interrupted run or extend a finished one, with the same bits as an uninterrupted run."""
    if steps is not None and time is not None:
        raise InputError("give --steps or --time, not both")
    refuse_outputs({"json": json_file}, overwrite, [file])
    from kickdrift.run.resuming import continued
    from kickdrift.run.resuming import resume as taken_up
    from kickdrift.trajectory.reader import open as opened

    sim = taken_up(file, threads=threads)
    warn_of_version(sim, quiet)
    with opened(file) as run:
        options, closed = None if flush is None else replace(run.options, flush=flush), run.closed
    if sim.plan is None:
        raise InputError(f"{file}: the length of the run is not known; give --steps or --time")
    sim.plan = continued(sim, steps, time)
    if sim.plan.over(sim) and closed:
        say(f"{file}: the run is finished at step {sim.steps_done}; --steps or --time extend it", quiet)
        report = sim.report()
    else:
        with progress_bar(quiet) as bar:
            say(f"{file}: continues from step {sim.steps_done}", quiet)
            report = sim.run(progress=bar("running"), file=options)
    show(report, sim, file, json_file, quiet, overwrite)


def warn_of_version(sim: Simulation, quiet: bool) -> None:
    """Warn of an untested version of an engine before the first step."""
    from kickdrift.engines import ENGINES

    for warning in ENGINES[sim.engine].warnings:
        say(f"warning: {warning}", quiet)


def show(
    report: Report, sim: Simulation, output: Path | None, json_file: Path | None, quiet: bool, overwrite: bool
) -> None:
    """Print a run's warnings and report, and write the report on request."""
    from kickdrift.engines import ENGINES

    for warning in report.warnings:
        if warning not in ENGINES[sim.engine].warnings:  # printed before
            say(f"warning: {warning}", quiet)
    try:
        write_json(json_file, report.as_json(), overwrite=overwrite)
    finally:  # a full disk does not lose the results
        print_report(report, sim, output)


@bench_app.command("lj-energy")
def bench_lj_energy(
    particles: Annotated[
        int, typer.Option(metavar="N", min=1, help="Number of particles; a cube such as 1000.")
    ] = 1000,
    steps: Annotated[
        int | None,
        typer.Option(metavar="N", min=1, help="Steps of 0.005 (default 2000; the full benchmark has 1000000)."),
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
    from kickdrift.analysis import bench
    from kickdrift.forces.bound import check_threads
    from kickdrift.integrators import integrator as method_named

    methods = list(dict.fromkeys(method_named(name).name for name in integrator or bench.METHODS))
    check_threads(threads)
    system = bench.benchmark_system(particles)
    say("compiling (the first time on a machine takes longest) and timing a short pilot run …", quiet)
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


@bench_app.command("speed")
def bench_speed(
    only: Annotated[
        list[str] | None,
        typer.Option(
            metavar="GROUP", help="Group of programs; repeat for several (default: the usual groups). See --list."
        ),
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


@app.command()
def compare(
    system: SystemArgument,
    integrator: Annotated[
        list[str] | None,
        typer.Option(metavar="NAME", help="Integrator; repeat for several (default: a suitable choice)."),
    ] = None,
    time: Annotated[
        float | None, typer.Option(metavar="T", help="Length of the pilot runs (default: about a minute's worth).")
    ] = None,
    accuracy: Annotated[
        float | None, typer.Option(metavar="X", help="Wanted relative error: recommend a method and a step.")
    ] = None,
    length: Annotated[
        float | None, typer.Option(metavar="T", help="Length of the planned run (default: the file's).")
    ] = None,
    seed: Annotated[int | None, typer.Option(metavar="S", min=0, help="Seed of the drawn velocities.")] = None,
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
    from kickdrift.analysis.recommendation import recommendation
    from kickdrift.cli.printing_compare import print_comparison, print_recommendation
    from kickdrift.model.system import System
    from kickdrift.systemfile.reading import load

    work.check_arguments(time, length, accuracy, threads)
    subject = load(system, seed)
    if isinstance(subject, System):
        subject = subject.watched(())  # every method and step is compared with one reference trajectory
    work.chosen(subject, integrator)
    say("compiling (the first time on a machine takes longest) and comparing: about a minute …", quiet)
    with progress_bar(quiet) as bar:
        start = work.equilibrated(subject, threads, bar)
        found = work.work_precision(
            subject, integrator, time, whole=length, accuracy=accuracy, start=start, threads=threads,
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


@app.command()
def chaos(
    system: SystemArgument,
    time: Annotated[float | None, typer.Option(metavar="T", help="Length of the run (default: the file's).")] = None,
    integrator: Annotated[
        str | None, typer.Option(metavar="NAME", help="Default: the file's if it can carry deviations, else dop853.")
    ] = None,
    dt: Annotated[float | None, typer.Option(metavar="X", help="Step of fixed-step methods.")] = None,
    rtol: Annotated[float | None, typer.Option(metavar="X", help="Relative tolerance of adaptive methods.")] = None,
    atol: Annotated[float | None, typer.Option(metavar="X", help="Absolute tolerance of adaptive methods.")] = None,
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
    with progress_bar(quiet) as bar:
        found = megno(
            subject, time, integrator, dt, seed=seed, threads=threads, rtol=rtol, atol=atol, progress=bar("running")
        )
    try:
        write_json(json_file, found.as_json(), overwrite=overwrite)
    finally:
        print_chaos(found)


@app.command()
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
        str | None, typer.Option(metavar="NAME", help="Column of an ensemble's table (default: the most informative).")
    ] = None,
    overwrite: OverwriteOption = False,
) -> None:
    """Draw a run, an ensemble or stability regions. A run gives orbits and elements; or energies, error, temperature
    and radial distribution function; or one observable with error bars. An ensemble gives a map, a curve, points or a
    histogram."""
    if stability and (file or kind or column):
        raise InputError("give FILE or --stability, not both")
    of_ensemble = file is not None and file.suffix.lower() in TABLES
    if file and (kind if of_ensemble else column):
        raise InputError("--kind is for a run's .h5md, --column for an ensemble's .parquet or .h5")
    if stability:
        from kickdrift.plots.stability import plot_stability

        out(str(plot_stability(stability, output or Path("stability.png"), overwrite=overwrite)))
        print_stability(stability)
    elif file and of_ensemble:
        from kickdrift.plots.ensemble import plot_ensemble

        out(str(plot_ensemble(file, output or file.with_suffix(".png"), column, overwrite=overwrite)))
    elif file:
        from kickdrift.plots.orbits import has_orbits, plot_orbits
        from kickdrift.plots.runs import plot_run

        target = output or file.with_suffix(".png")
        if kind not in (None, Figures.orbits, Figures.energies):
            from kickdrift.plots.observables import plot_observable

            out(str(plot_observable(file, str(kind), target, overwrite=overwrite)))
            return
        orbits = kind is Figures.orbits or (kind is None and has_orbits(file))
        draw = plot_orbits if orbits else plot_run
        out(str(draw(file, target, overwrite=overwrite)))
    else:
        raise InputError("give FILE, or --stability NAME to draw an integrator")


@app.command()
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


@app.command()
def info(
    file: Annotated[
        str, typer.Argument(metavar="FILE", help="A run's file, an ensemble's table, or a system file or name.")
    ],
) -> None:
    """Describe a run's file or an ensemble's table, or check a system file without running it."""
    from kickdrift.systemfile.reading import is_shipped, load

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
    from kickdrift.integrators.options import Options

    if system.run.integrator is not None:
        try:
            integrator(system.run.integrator).checked(Options().or_else(system.run), Options())
        except InputError as error:
            raise InputError(f"run: {error}") from None


@app.command()
def validate(
    names: Annotated[
        list[str] | None,
        typer.Argument(metavar="NAME", help="Scripts or groups of scripts (default: all). See --list."),
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


@app.command("list")
def list_(what: Annotated[Lists, typer.Argument()]) -> None:
    """List integrators, forces, systems or engines."""
    columns, rows = LISTINGS[what]()
    print_table(None, columns, rows)


def main() -> None:
    """The program: exit status 0 done, 1 the run failed, 2 bad input, 130 Ctrl-C."""
    usage_error: Any = typer.BadParameter.__base__  # from click, or from typer's own copy of click
    try:
        open_streams()
        with heard_everywhere():
            status = app(prog_name="kickdrift", standalone_mode=False)
    except KickdriftError as error:
        say(f"kickdrift: {error}")
        status = error.exit_status
    except usage_error as error:
        if text := " ".join(error.format_message().split()):  # empty without arguments, when help was shown
            command = error.ctx.command_path if error.ctx else "kickdrift"
            say(f"kickdrift: {text.rstrip('.')} (see {command} --help)")
        status = 2
    except (KeyboardInterrupt, typer.Abort):
        status = INTERRUPTED
    except BrokenPipeError:
        forget_output()
        status = 1
    except OSError as error:
        where = "" if error.filename is None else f"{error.filename}: "
        say(f"kickdrift: {where}{reason(error)}")
        status = 2 if error.errno in BAD_NAMES else 1
    except MemoryError:
        say("kickdrift: not enough memory")
        status = 1
    except Exception as error:
        if os.environ.get(TRACEBACK):
            raise
        what = f"{type(error).__name__}: {error}".rstrip(": ")
        say(f"kickdrift: this is a bug in kickdrift, please report it: {what} ({TRACEBACK}=1 shows where)")
        status = 1
    if status == INTERRUPTED:  # typer turns a KeyboardInterrupt into an exit
        say("kickdrift: interrupted; all written files are whole")
    written = everything_written(quiet=bool(status))
    sys.exit(status or written)


def everything_written(quiet: bool) -> int:
    """Flush standard output; return the exit status, 1 if that fails."""
    try:
        sys.stdout.flush()
    except OSError as error:
        forget_output()
        if not isinstance(error, BrokenPipeError):
            say(f"kickdrift: standard output cannot be written: {reason(error)}", quiet)
        return 1
    return 0


def forget_output() -> None:
    """Send the rest of standard output to the null device, so that Python does not try again at exit."""
    os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())

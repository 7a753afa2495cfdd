"""The command line: parse, call one function, print. Results on standard output, all else on standard error."""

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
    FlushOption,
    JsonOption,
    OverwriteOption,
    QuietOption,
    SystemArgument,
    ThreadsOption,
    with_options,
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
from kickdrift.text import VALUE, clean

if TYPE_CHECKING:
    from kickdrift.model.problem import Problem
    from kickdrift.model.system import System
    from kickdrift.run.report import Report
    from kickdrift.run.simulation import Simulation
    from kickdrift.trajectory.options import FileOptions

app = typer.Typer(
    name="kickdrift",
    help="Molecular dynamics and N-body simulation in which the integrator is a measured choice.",
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
TRACEBACK = "KICKDRIFT_TRACEBACK"  # the environment variable that shows where an error that is a bug came from
TABLES = (".parquet", ".h5")  # of ensembles


class Figures(StrEnum):
    """What ``kickdrift plot`` can draw of a run."""

    orbits = "orbits"
    energies = "energies"
    rdf = "rdf"
    msd = "msd"
    vacf = "vacf"
    structure_factor = "structure-factor"


class Lists(StrEnum):
    """What ``kickdrift list`` can show."""

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
            help="First run a file that registers methods, forces.",
        ),
    ] = None,
) -> None:
    """What goes before the command."""
    from kickdrift.integrators.registration import load_file

    for path in load or []:
        load_file(path)


@app.command()
@with_options(
    "dt", "rtol", "atol", "max_step", "compensated", "precision", "coordinates", "corrector", "order", "eta", "scheme"
)
def run(
    system: SystemArgument,
    integrator: Annotated[str | None, typer.Option(metavar="NAME", help="See: kickdrift list integrators.")] = None,
    options: Any = None,
    steps: Annotated[int | None, typer.Option(metavar="N", min=0, help="Steps to take.")] = None,
    time: Annotated[float | None, typer.Option(metavar="T", help="Time to run for, instead of --steps.")] = None,
    every: Annotated[int | None, typer.Option(metavar="K", min=1, help="Steps between samples and frames.")] = None,
    interval: Annotated[
        float | None,
        typer.Option(metavar="T", help="Time between them instead, for adaptive methods."),
    ] = None,
    output: Annotated[Path | None, typer.Option(metavar="FILE.h5md", help="Write the trajectory.")] = None,
    overwrite: OverwriteOption = False,
    flush: FlushOption = None,
    store: Annotated[
        str | None, typer.Option(metavar="NAME", help="Numbers in the frames: float64 (default), float32.")
    ] = None,
    old_store: Annotated[str | None, typer.Option("--precision", hidden=True)] = None,
    compress: Annotated[bool, typer.Option("--compress", help="Compress the file at the end; lossless.")] = False,
    write: Annotated[
        str | None, typer.Option(metavar="NAMES", help="What else frames hold: forces, images, or forces,images.")
    ] = None,
    seed: Annotated[int | None, typer.Option(metavar="S", min=0, help="Seed of the drawn velocities.")] = None,
    threads: ThreadsOption = 1,
    engine: Annotated[str, typer.Option(metavar="NAME", help="See: kickdrift list engines.")] = "native",
    processes: Annotated[
        int, typer.Option(metavar="N", min=1, help="Processes, of an engine that runs on several: lammps.")
    ] = 1,
    json_file: JsonOption = None,
    quiet: QuietOption = False,
) -> None:
    """Run a system and say how well it conserved energy and momentum."""
    from kickdrift.engines import engine as engine_named
    from kickdrift.model.system import System
    from kickdrift.systemfile.reading import load

    engine_named(engine)
    if steps is not None and time is not None:
        raise InputError("give --steps or --time, not both")
    refuse_outputs({"output": output, "json": json_file}, overwrite, [system])
    if old_store is not None:
        if store is not None:
            raise InputError("give --store; --precision is its old name")
        say("warning: --precision is --store since 0.2, and goes in 0.3", quiet)
        store = old_store
    given = {"flush": flush, "store": store, "compress": compress or None}
    file = file_options(output, given | {"write": write and tuple(each.strip() for each in write.split(","))})
    chosen = load(system, seed)

    from kickdrift.run.plan import length_of
    from kickdrift.run.simulation import Simulation

    sim = Simulation(chosen, integrator, threads=threads, engine=engine, processes=processes, **options)
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
    """How the output is written; None where no option says so."""
    from kickdrift.trajectory.options import FileOptions

    asked = {key: value for key, value in given.items() if value is not None}
    if asked and output is None:
        raise InputError(f"--{next(iter(asked))}: says how --output is written; give that too")
    return FileOptions(**asked) if asked else None


@app.command()
def resume(
    file: Annotated[Path, typer.Argument(metavar="FILE.h5md", help="The file of a run, finished or not.")],
    steps: Annotated[
        int | None, typer.Option(metavar="N", min=0, help="Go on to this step, counted from the run's start.")
    ] = None,
    time: Annotated[
        float | None, typer.Option(metavar="T", help="Go on to this time since the run's start, instead of --steps.")
    ] = None,
    threads: Annotated[
        int | None, typer.Option(metavar="K", min=1, help="Default: the run's; the results do not depend on it.")
    ] = None,
    flush: FlushOption = None,
    json_file: JsonOption = None,
    overwrite: Annotated[bool, typer.Option("--overwrite", help="Replace the JSON file.")] = False,
    quiet: QuietOption = False,
) -> None:
    """Finish a run that was interrupted, or make it longer: the same bits as without the interruption."""
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
        raise InputError(f"{file}: does not say how far the run was to go; give --steps or --time")
    sim.plan = continued(sim, steps, time)
    if sim.plan.over(sim) and closed:
        say(f"{file}: is finished, at step {sim.steps_done}; --steps or --time make it longer", quiet)
        report = sim.report()
    else:
        with progress_bar(quiet) as bar:
            say(f"{file}: goes on from step {sim.steps_done}", quiet)
            report = sim.run(progress=bar("running"), file=options)
    show(report, sim, file, json_file, quiet, overwrite)


def warn_of_version(sim: Simulation, quiet: bool) -> None:
    """Say before the first step that a program's version was not tested."""
    from kickdrift.engines import ENGINES

    for warning in ENGINES[sim.engine].warnings:
        say(f"warning: {warning}", quiet)


def show(
    report: Report, sim: Simulation, output: Path | None, json_file: Path | None, quiet: bool, overwrite: bool
) -> None:
    """A run's warnings and report, printed and where it was asked for written."""
    from kickdrift.engines import ENGINES

    for warning in report.warnings:
        if warning not in ENGINES[sim.engine].warnings:  # which was said before
            say(f"warning: {warning}", quiet)
    try:
        write_json(json_file, report.as_json(), overwrite=overwrite)
    finally:  # what was computed is not lost to a full disk
        print_report(report, sim, output)


@bench_app.command("lj-energy")
def bench_lj_energy(
    particles: Annotated[int, typer.Option(metavar="N", min=1, help="Particles; a cube of a whole number.")] = 1000,
    steps: Annotated[
        int | None, typer.Option(metavar="N", min=1, help="Steps of 0.005 (default 2000; in full 1000000).")
    ] = None,
    integrator: Annotated[list[str] | None, typer.Option(metavar="NAME", help="Repeat for several.")] = None,
    threads: ThreadsOption = 1,
    json_file: JsonOption = None,
    plot: Annotated[Path | None, typer.Option(metavar="FILE.png", help="Draw the energy errors against time.")] = None,
    overwrite: OverwriteOption = False,
    quiet: QuietOption = False,
) -> None:
    """The Lennard-Jones energy benchmark: energy error and drift of the integrators, at one step and at one cost."""
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
        list[str] | None, typer.Option(metavar="GROUP", help="Repeat for several; default the usual ones. See --list.")
    ] = None,
    turns: Annotated[int, typer.Option(metavar="N", min=2, help="Of each program; medians are over them.")] = 7,
    seconds: Annotated[float, typer.Option(metavar="X", min=0.001, help="Length of a turn.")] = 0.4,
    listing: Annotated[bool, typer.Option("--list", help="List the groups, run none.")] = False,
    json_file: JsonOption = None,
    overwrite: OverwriteOption = False,
    quiet: QuietOption = False,
) -> None:
    """Speed beside every other program that is installed, in turns on the same systems; the energy error of each."""
    refuse_outputs({"json": json_file}, overwrite)
    need_validation("bench speed")
    from kickdrift_validation.performance import speed

    entries = speed.chosen(only or ())
    if listing:
        print_table(None, *speed.listed())
        return
    length = duration(speed.expected_seconds(entries, turns, seconds))
    say(f"expected time: {length}, and more where something has to be compiled first", quiet)
    with progress_bar(quiet) as bar:
        found = speed.measure(entries, turns, seconds, bar)
    for line in speed.left_out(found):
        say(f"left out: {line}", quiet)
    try:
        write_json(json_file, found, overwrite=overwrite)
    finally:
        speed.print_found(found)


@app.command()
@with_options()
def compare(
    system: SystemArgument,
    integrator: Annotated[
        list[str] | None, typer.Option(metavar="NAME", help="Repeat for several; default a choice that suits.")
    ] = None,
    options: Any = None,
    time: Annotated[
        float | None, typer.Option(metavar="T", help="Length of the pilot runs (default: what about a minute allows).")
    ] = None,
    accuracy: Annotated[
        float | None, typer.Option(metavar="X", help="Relative error wanted: recommend what to run.")
    ] = None,
    length: Annotated[
        float | None, typer.Option(metavar="T", help="Length of the run in mind (default: the file's).")
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
    """Work against precision: the error of each integrator over steps or tolerances, and what it costs."""
    refuse_outputs({"json": json_file, "plot": plot}, overwrite, [system])
    from kickdrift.analysis import work_precision as work
    from kickdrift.analysis.recommendation import recommendation
    from kickdrift.cli.printing_compare import print_comparison, print_recommendation
    from kickdrift.model.system import System
    from kickdrift.systemfile.reading import load

    work.check_arguments(time, length, accuracy, threads)
    subject = load(system, seed)
    if isinstance(subject, System):
        subject = subject.watched(())  # trajectories of all methods and steps are compared with one reference
    work.chosen(subject, integrator, options)
    say("compiling (the first time on a machine takes longest) and comparing: about a minute …", quiet)
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


@app.command()
@with_options("dt", "rtol", "atol")
def chaos(
    system: SystemArgument,
    time: Annotated[float | None, typer.Option(metavar="T", help="Time to run for (default: the file's).")] = None,
    integrator: Annotated[
        str | None, typer.Option(metavar="NAME", help="Default: the file's where it can, else dop853.")
    ] = None,
    options: Any = None,
    seed: Annotated[int, typer.Option(metavar="S", min=0, help="Seed of the first deviation.")] = 0,
    threads: ThreadsOption = 1,
    json_file: JsonOption = None,
    overwrite: OverwriteOption = False,
    quiet: QuietOption = False,
) -> None:
    """Is the motion regular or chaotic: MEGNO and the largest Lyapunov exponent, from the variational equations."""
    refuse_outputs({"json": json_file}, overwrite, [system])
    from kickdrift.analysis.chaos import megno
    from kickdrift.systemfile.reading import load

    subject = load(system)
    with progress_bar(quiet) as bar:
        found = megno(subject, time, integrator, seed=seed, threads=threads, progress=bar("running"), **options)
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
        Figures | None, typer.Option(help="Of a run; default orbits where there is gravity, else energies.")
    ] = None,
    stability: Annotated[
        list[str] | None,
        typer.Option(metavar="NAME", help="Draw where an integrator is stable, no run; repeat for several."),
    ] = None,
    column: Annotated[
        str | None, typer.Option(metavar="NAME", help="Of an ensemble's table (default: what tells most).")
    ] = None,
    overwrite: OverwriteOption = False,
) -> None:
    """Draw a run (its bodies' orbits and elements; or energies, error, temperature and radial distribution function;
    or one observable with error bars), an ensemble (a map, a curve, points or a histogram), or where integrators are
    stable."""
    if stability and (file or kind or column):
        raise InputError("give FILE or --stability, not both")
    of_ensemble = file is not None and file.suffix.lower() in TABLES
    if file and (kind if of_ensemble else column):
        raise InputError("--kind is of a run's .h5md, --column of the .parquet or .h5 of an ensemble")
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
        raise InputError("give FILE, or --stability NAME for a figure of an integrator")


@app.command()
def export(
    file: Annotated[Path, typer.Argument(metavar="FILE.h5md", help="A run's file.")],
    output: Annotated[
        Path,
        typer.Argument(metavar="OUT", help="The suffix says what: dcd, xtc, trr, xyz, pdb, extxyz, traj."),
    ],
    unwrapped: Annotated[
        bool, typer.Option("--unwrapped/--wrapped", help="Positions as the run has them, or inside the box.")
    ] = False,
    start: Annotated[int | None, typer.Option(metavar="A", help="First frame, from 0; negative from the end.")] = None,
    stop: Annotated[int | None, typer.Option(metavar="B", help="The frame to end before.")] = None,
    step: Annotated[int | None, typer.Option(metavar="C", min=1, help="Only every C-th frame.")] = None,
    overwrite: OverwriteOption = False,
    quiet: QuietOption = False,
) -> None:
    """Write a run's frames for other programs, and say what their format loses."""
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
    """Say what a run's file or an ensemble's table holds, or check a system file without running it."""
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
    """An InputError where a system's [run] names no method, or options that the method does not take."""
    from kickdrift.integrators import integrator
    from kickdrift.integrators.asked import settled

    if system.run.integrator is not None:
        try:
            settled(integrator(system.run.integrator), {}, system.run)
        except InputError as error:
            raise InputError(f"run: {error}") from None


@app.command()
def validate(
    names: Annotated[
        list[str] | None, typer.Argument(metavar="NAME", help="Scripts, or a group of them; default all. See --list.")
    ] = None,
    long: Annotated[bool, typer.Option("--long", help="All claims, not those that take minutes in all.")] = False,
    jobs: Annotated[int, typer.Option(metavar="K", min=1, help="Scripts to run at a time.")] = 2,
    report: Annotated[
        Path | None, typer.Option(metavar="FILE.md", help="Where the report goes, its figures in a folder beside it.")
    ] = None,
    listing: Annotated[bool, typer.Option("--list", help="List the scripts, run none.")] = False,
    quiet: QuietOption = False,
) -> None:
    """Compare kickdrift with programs and data that others made, and write a report; exit status 1 if a claim fails."""
    need_validation("validate")
    from kickdrift_validation import runner

    if listing:
        runner.listed()
        return
    raise typer.Exit(runner.validate(names or (), long, jobs, report, quiet))


def need_validation(command: str) -> None:
    """Raise an InputError where the package of the comparisons with other programs is absent."""
    if find_spec("kickdrift_validation") is None:
        raise InputError(f"{command}: this copy of kickdrift came without the package kickdrift_validation")


@app.command("list")
def list_(
    what: Annotated[Lists, typer.Argument()],
    name: Annotated[str | None, typer.Argument(metavar="[NAME]", help="Explain this integrator.")] = None,
) -> None:
    """List what there is, or explain an integrator and its options."""
    if name is not None:
        from kickdrift.cli.printing_methods import print_method

        if what is not Lists.integrators:
            raise InputError(f"list {what} {clean(name, VALUE)}: only integrators are explained by name")
        print_method(name)
        return
    columns, rows = LISTINGS[what]()
    print_table(None, columns, rows)


def main() -> None:
    """The program: exit status 0 done, 1 the run failed, 2 bad input, 130 Ctrl-C."""
    usage_error: Any = typer.BadParameter.__base__  # click's, or that of typer's own copy of click
    try:
        open_streams()
        with heard_everywhere():
            status = app(prog_name="kickdrift", standalone_mode=False)
    except KickdriftError as error:
        say(f"kickdrift: {error}")
        status = error.exit_status
    except usage_error as error:
        if text := " ".join(error.format_message().split()):  # without any arguments it is empty, and help was shown
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
        say("kickdrift: there is not enough memory for this")
        status = 1
    except Exception as error:
        if os.environ.get(TRACEBACK):
            raise
        what = f"{type(error).__name__}: {error}".rstrip(": ")
        say(f"kickdrift: this is a bug in kickdrift, please report it: {what} ({TRACEBACK}=1 shows where)")
        status = 1
    if status == INTERRUPTED:  # typer makes an exit of a KeyboardInterrupt
        say("kickdrift: interrupted; what was written is whole")
    written = everything_written(quiet=bool(status))
    sys.exit(status or written)


def everything_written(quiet: bool) -> int:
    """Write what standard output still keeps; the exit status, 1 where that fails."""
    try:
        sys.stdout.flush()
    except OSError as error:
        forget_output()
        if not isinstance(error, BrokenPipeError):
            say(f"kickdrift: standard output cannot be written: {reason(error)}", quiet)
        return 1
    return 0


def forget_output() -> None:
    """Send the rest of standard output nowhere, so that Python does not try once more at its end."""
    os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())

"""The command line: parse, call one function, print. Results go to standard output, everything else to standard
error."""

from __future__ import annotations

import json
import math
import os
import sys
import tempfile
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from enum import StrEnum
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from kickdrift.errors import InputError, KickdriftError, RunError

if TYPE_CHECKING:
    from kickdrift.report import EnergyReport, Report
    from kickdrift.simulation import Simulation
    from kickdrift.system import System

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

SystemArgument = Annotated[
    str, typer.Argument(metavar="SYSTEM.toml", help="A system file, or the name of one that ships.")
]
JsonOption = Annotated[
    Path | None, typer.Option("--json", metavar="FILE", help="Write the results as one JSON object.")
]
OverwriteOption = Annotated[bool, typer.Option("--overwrite", help="Replace files that exist.")]
ThreadsOption = Annotated[int, typer.Option(metavar="K", min=1, help="Threads; the results do not depend on it.")]
QuietOption = Annotated[bool, typer.Option("--quiet", help="Nothing on standard error but errors.")]
SUFFIXES = {"output": (".h5md",), "plot": (".png", ".pdf", ".svg")}  # as the writers of these files have them
INTERRUPTED = 130


class Lists(StrEnum):
    """What ``kickdrift list`` can show."""

    integrators = "integrators"
    forces = "forces"
    systems = "systems"
    engines = "engines"


@app.command()
def run(
    system: SystemArgument,
    integrator: Annotated[str | None, typer.Option(metavar="NAME", help="See: kickdrift list integrators.")] = None,
    dt: Annotated[float | None, typer.Option(metavar="X", help="Step, in the system's unit of time.")] = None,
    steps: Annotated[int | None, typer.Option(metavar="N", min=0, help="Steps to take.")] = None,
    time: Annotated[float | None, typer.Option(metavar="T", help="Time to reach, instead of --steps.")] = None,
    every: Annotated[int | None, typer.Option(metavar="K", min=1, help="Steps between samples and frames.")] = None,
    output: Annotated[Path | None, typer.Option(metavar="FILE.h5md", help="Write the trajectory.")] = None,
    overwrite: OverwriteOption = False,
    seed: Annotated[int | None, typer.Option(metavar="S", min=0, help="Seed of the drawn velocities.")] = None,
    threads: ThreadsOption = 1,
    engine: Annotated[str, typer.Option(metavar="NAME", help="See: kickdrift list engines.")] = "native",
    json_file: JsonOption = None,
    quiet: QuietOption = False,
) -> None:
    """Run a system and say how well it conserved energy and momentum."""
    from kickdrift.systemfile import load

    if engine not in ENGINES:
        raise InputError(f"--engine {engine!r} is not one of {', '.join(ENGINES)}")
    if steps is not None and time is not None:
        raise InputError("give --steps or --time, not both")
    refuse_outputs({"output": output, "json": json_file}, overwrite)
    chosen = load(system, seed)
    if steps is None and time is None:
        steps, time = chosen.run.steps, chosen.run.time
    if steps is None and time is None:
        raise InputError(f"{system}: [run] names neither steps nor time; give --steps or --time")

    from kickdrift.simulation import Simulation

    sim = Simulation(chosen, integrator, dt, threads)
    steps = sim.steps_to(steps, time)
    with progress_bar(quiet) as bar:
        if chosen.equilibration:
            wanted = chosen.equilibration
            sim.equilibrate(wanted.temperature, wanted.time, wanted.interval, bar("equilibrating"))
        report = sim.run(steps, every=every, output=output, overwrite=overwrite, progress=bar("running"))
    try:
        write_json(json_file, report.as_json())
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
    from kickdrift import bench
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
    write_json(json_file, bench.as_json(system, rows, seconds, threads))
    if plot:
        from kickdrift.plots import plot_benchmark

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


@app.command()
def plot(
    file: Annotated[Path, typer.Argument(metavar="FILE.h5md", help="A run's file.")],
    output: Annotated[Path | None, typer.Option(metavar="FILE.png", help="Default: FILE.png beside the file.")] = None,
    overwrite: OverwriteOption = False,
) -> None:
    """Draw a run: energies, energy error, temperature, radial distribution function."""
    from kickdrift.plots import plot_run

    print(plot_run(file, output or file.with_suffix(".png"), overwrite=overwrite))


@app.command()
def info(file: Annotated[str, typer.Argument(metavar="FILE", help="A run's file, or a system file or name.")]) -> None:
    """Say what a run's file holds, or check a system file without running it."""
    if Path(file).suffix == ".toml" or not os.path.exists(file):
        from kickdrift.systemfile import load

        print_system(load(file))
        return
    from kickdrift.trajectory.info import describe
    from kickdrift.trajectory.info import info as found

    print(describe(found(file)))


@app.command("list")
def list_(what: Annotated[Lists, typer.Argument()]) -> None:
    """List what there is."""
    columns, rows = LISTINGS[what]()
    print_table(None, columns, rows)


def list_integrators() -> tuple[list[str], list[list[str]]]:
    """Every integrator and what is known of it."""
    from kickdrift.integrators import INTEGRATORS

    yes = {True: "yes", False: "no"}
    columns = ["name", "family", "order", "evaluations", "symplectic", "reversible", "adaptive", "use"]
    rows = [
        [
            name,
            method.family,
            str(method.order),
            str(method.evaluations),
            yes[method.symplectic],
            yes[method.reversible],
            yes[method.adaptive],
            method.use if name == method.name else f"the same as {method.name}",
        ]
        for name, method in INTEGRATORS.items()
    ]
    return columns, rows


def list_forces() -> tuple[list[str], list[list[str]]]:
    """Every force and its parameters."""
    import inspect

    from kickdrift.forces import FORCES

    rows = [
        [name, ", ".join(inspect.signature(force).parameters), (force.__doc__ or "").split("\n")[0]]
        for name, force in FORCES.items()
    ]
    return ["name", "parameters", "what"], rows


def list_systems() -> tuple[list[str], list[list[str]]]:
    """Every system file that ships."""
    from kickdrift.systemfile import describe, shipped

    found = [describe(path) for path in shipped().values()]
    return ["name", "units", "title"], [[each.name, each.units, each.title] for each in found]


ENGINES = {"native": "kickdrift's own compiled kernels"}
LISTINGS: dict[str, Callable[[], tuple[list[str], list[list[str]]]]] = {
    "integrators": list_integrators,
    "forces": list_forces,
    "systems": list_systems,
    "engines": lambda: (["name", "what"], [[name, what] for name, what in ENGINES.items()]),
}


def print_report(report: Report, sim: Simulation, output: Path | None) -> None:
    """A run's summary on standard output."""
    units, energy = sim.system.units, report.energy
    lines = [
        ("system", f"{report.system}: {report.particles:,} particles, units {report.units}"),
        ("integrator", f"{report.integrator}, dt = {report.dt:g} {units.time}"),
        ("length", f"{report.steps:,} steps, {report.time:g} {units.time}"),
        ("energy", f"{energy.initial:.8g} at the start, {energy.final:.8g} {units.energy} at the end"),
        (
            "energy error",
            f"{energy.rms_relative_error:.2e} RMS, {energy.max_relative_error:.2e} largest, of {energy.relative_to}",
        ),
        ("energy drift", drift_text(energy, f" per {units.time}: {energy.verdict}") or energy.verdict),
        ("momentum error", f"{report.momentum_error:.1e} of the sum of m |v|"),
    ]
    if report.angular_momentum_error is not None:
        lines.append(("angular momentum", f"error {report.angular_momentum_error:.1e} of the sum of m |x × v|"))
    if report.temperature is not None:
        lines.append(("temperature", f"{report.temperature:.5g} {units.temperature} (mean)"))
    if report.pressure is not None:
        lines.append(("pressure", f"{report.pressure:.5g} {units.energy}/{units.length}^3 (mean)"))
    per_pair = f", {report.ns_per_pair:.1f} ns per pair" if report.ns_per_pair else ""
    lines.append(("speed", f"{report.steps_per_second:,.0f} steps/s on {counted(report.threads, 'thread')}{per_pair}"))
    if output:
        lines.append(("written", str(output)))
    for key, text in lines:
        print(f"{key:17} {text}")


def drift_text(energy: EnergyReport, ending: str = "") -> str:
    """The slope, its interval and the ending; nothing where no interval can be told."""
    if not math.isfinite(energy.drift_error):
        return ""
    return f"{energy.drift_per_unit_time:+.1e} ± {energy.drift_error:.1e}{ending}"


def print_benchmark(rows: list[Any], particles: int, seconds: float) -> None:
    """The benchmark's two tables on standard output."""
    titles = {
        "same step": "The same step",
        "same cost": "The same cost: 1000 force evaluations per unit of time",
    }
    columns = ["method", "dt", "RMS error", "largest", "drift per unit time", "verdict", "steps/s"]
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
                        drift_text(e) or "–",
                        e.verdict,
                        f"{row.report.steps_per_second:,.0f}",
                    ]
                )
            elif row.table == table:
                body.append([row.method, f"{row.dt:g}", "–", "–", "–", row.failure, "–"])
        print_table(title, columns, body)
    print(
        f"{particles:,} particles, errors relative to |E(0)|; leapfrog in its kick-drift-kick form is velocity-verlet. "
        f"Took {duration(seconds)}."
    )


def print_claims(rows: list[Any], claimed: dict[str, str]) -> None:
    """What is claimed of the full benchmark beside what was measured, on standard output."""
    body = []
    for row in rows:
        if row.method in claimed:
            e = row.report.energy if row.report else None
            measured = f"{100 * e.rms_relative_error:.2g} %, {e.verdict}" if e else str(row.failure)
            body.append([row.method, f"{row.dt:g}", claimed[row.method], measured])
    print_table("RMS energy error over 10^6 steps", ["method", "dt", "claimed in the literature", "measured"], body)


def print_system(system: System) -> None:
    """What a system file says, checked."""
    units = system.units
    box = (
        "open"
        if system.box.lengths is None
        else " x ".join(f"{edge:.6g}" for edge in system.box.lengths) + f" {units.length}"
    )
    print(f"{'system':17} {system.name}: valid")
    print(f"{'particles':17} {len(system):,} ({', '.join(system.species)})")
    print(f"{'box':17} {box}")
    print(
        f"{'units':17} {units.name}: length {units.length}, time {units.time}, mass {units.mass}, energy {units.energy}"
    )
    for force in system.forces:
        print(f"{'force':17} {force}")
    given = {key: value for key, value in vars(system.run).items() if value is not None}
    print(f"{'run':17} {', '.join(f'{key} = {value}' for key, value in given.items())}")
    if system.equilibration:
        print(
            f"{'equilibrate':17} {', '.join(f'{key} = {value}' for key, value in vars(system.equilibration).items())}"
        )


def print_table(title: str | None, columns: list[str], rows: list[list[str]]) -> None:
    """A table on standard output, as wide as it needs to be where that is no terminal."""
    from rich import box
    from rich.console import Console
    from rich.table import Table

    console = Console(width=None if sys.stdout.isatty() else 200)
    table = Table(*columns, title=title, title_justify="left", box=box.SIMPLE_HEAD)
    for row in rows:
        table.add_row(*row)
    console.print(table)


@contextmanager
def progress_bar(quiet: bool) -> Iterator[Callable[[str], Callable[[int, int], None]]]:
    """Inside, ``bar(label)`` gives a function (done, of) that moves a bar on standard error, if that is a terminal."""
    if quiet or not sys.stderr.isatty():
        yield lambda label: _nothing
        return
    from rich.console import Console
    from rich.progress import BarColumn, Progress, TextColumn, TimeRemainingColumn

    layout = (
        TextColumn("{task.description}"),
        BarColumn(),
        TextColumn("{task.percentage:3.0f} %"),
        TimeRemainingColumn(),
    )
    with Progress(*layout, console=Console(stderr=True), transient=True) as progress:

        def bar(label: str) -> Callable[[int, int], None]:
            task = progress.add_task(label, total=None)
            return lambda done, of: progress.update(task, completed=done, total=of)

        yield bar


def _nothing(done: int, of: int) -> None:
    """A bar that is not shown."""


def refuse_outputs(paths: dict[str, Path | None], overwrite: bool) -> None:
    """An InputError where a file that an option asks for exists, or cannot be written, before any work is done."""
    taken: dict[Path, str] = {}
    for option, path in paths.items():
        if path is None:
            continue
        folder = path.absolute().parent
        if path.suffix not in SUFFIXES.get(option, (path.suffix,)):
            raise InputError(f"--{option} {path}: the name must end in {' or '.join(SUFFIXES[option])}")
        if path.is_dir():
            raise InputError(f"--{option} {path}: is a folder")
        if path.exists() and not overwrite:
            raise InputError(f"--{option} {path}: exists already; give --overwrite to replace it")
        if not folder.is_dir():
            raise InputError(f"--{option} {path}: there is no folder {folder}")
        if other := taken.get(path.resolve()):
            raise InputError(f"--{option} {path}: is the file of --{other} too")
        taken[path.resolve()] = option
        try:
            with tempfile.TemporaryFile(dir=folder):
                pass
        except OSError as error:
            raise InputError(f"--{option} {path}: cannot be written: {reason(error)}") from None


def reason(error: OSError) -> str:
    """Why the system refused."""
    return (error.strerror or str(error)).lower()


def write_json(path: Path | None, content: dict[str, Any]) -> None:
    """One JSON object, where it was asked for; the file is whole or not there."""
    if path is None:
        return
    part = path.with_name(f".{path.name}.{os.getpid()}.part")
    try:
        part.write_text(json.dumps(content, indent=2) + "\n", encoding="utf-8")
        os.replace(part, path)
    except OSError as error:
        raise RunError(f"{path}: cannot be written: {reason(error)}") from None
    finally:
        part.unlink(missing_ok=True)


def say(text: str, quiet: bool = False) -> None:
    """A message on standard error."""
    if not quiet:
        print(text, file=sys.stderr)


def counted(number: int, noun: str) -> str:
    """ "1 thread", "2 threads"."""
    return f"{number} {noun}" if number == 1 else f"{number} {noun}s"


def duration(seconds: float) -> str:
    """Seconds as a person says them."""
    if seconds < 90:
        return f"{seconds:.0f} s"
    return f"{seconds / 60:.0f} min" if seconds < 5400 else f"{seconds / 3600:.1f} h"


def main() -> None:
    """The program: exit status 0 done, 1 the run failed, 2 bad input, 130 Ctrl-C."""
    usage_error: Any = typer.BadParameter.__base__  # click's, or that of typer's own copy of click
    try:
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
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        status = 1
    except OSError as error:
        say(f"kickdrift: {error}")
        status = 1
    if status == INTERRUPTED:  # typer makes an exit of a KeyboardInterrupt
        say("kickdrift: interrupted; what was written is whole")
    sys.exit(status or 0)

"""The commands ``compare``, ``compare-engines``, ``chaos``, ``transits``, ``certify`` and ``analyze``."""

from __future__ import annotations

from enum import StrEnum
from pathlib import Path
from typing import Annotated, Any

import typer

import kickdrift as kd
from kickdrift.cli import options as opt
from kickdrift.cli.console import busy, out, print_lines, progress_bar, say, show_found
from kickdrift.cli.options import argument, in_units, option, subject_of, with_files, with_options
from kickdrift.cli.options import length as span
from kickdrift.disk.outputs import refuse_outputs, write_json
from kickdrift.display.showing import lines_of
from kickdrift.errors import InputError
from kickdrift.forces import FORCES
from kickdrift.jit.cache.notices import compiling_for
from kickdrift.model.checks.limits import whole_text
from kickdrift.systemfile.files import PARAMETERS, is_shipped
from kickdrift.text import shown


@with_files
@with_options()
def compare(
    system: opt.Subject,
    integrator: Annotated[
        list[str] | None, option("NAME", "Integrator; repeat for several (default: a suitable choice).")
    ] = None,
    options: Any = None,
    time: Annotated[
        Any, option("T", "Length of the pilot runs (default: about a minute's worth).", parser=span)
    ] = None,
    accuracy: Annotated[float | None, option("X", "Wanted relative error: recommend a method and a step.")] = None,
    length: Annotated[Any, option("T", "Length of the planned run (default: the file's).", parser=span)] = None,
    seed: Annotated[int | None, option("S", "Seed of random velocities.", min=0)] = None,
    files: Any = None,
    threads: opt.Threads = 1,
    json_file: opt.Json = None,
    plot: Annotated[Path | None, option("FILE.png", "Draw error against evaluations and seconds.")] = None,
    overwrite: opt.Overwrite = False,
    quiet: opt.Quiet = False,
) -> None:
    """Measure work against precision: the error and the cost of each integrator over steps or tolerances. For methods
    with a heat bath: the errors of mean energies and pressure over steps; -o dt=X sets the longest step."""
    refuse_outputs({"json": json_file, "plot": plot}, overwrite, [system])
    from kickdrift.analysis.compare.comparing import compared

    subject = subject_of(system, seed, **files)
    time, length = in_units(time, subject, "--time"), in_units(length, subject, "--length")
    notice = "comparing: about a minute …"
    with progress_bar(quiet) as bar:
        found = compared(
            subject, integrator, bar, time, accuracy, length, threads, options, system, lambda: say(notice, quiet)
        )
    show_found(found, json_file, overwrite)
    if plot:
        from kickdrift.plots.results import plot_comparison

        with busy(f"drawing {plot}", quiet):
            plot_comparison(found, plot, overwrite=overwrite)
    if found.recommendation and found.recommendation.choice is None:
        raise typer.Exit(1)


@with_files
def compare_engines(
    system: opt.Subject,
    engine: Annotated[list[str] | None, option("NAME", "Engine; repeat for several (default: all).")] = None,
    frame: opt.Frame = None,
    files: Any = None,
    seed: Annotated[int | None, option("S", "Seed of random velocities.", min=0)] = None,
    json_file: opt.Json = None,
    overwrite: opt.Overwrite = False,
    quiet: opt.Quiet = False,
) -> None:
    """Energies by term, forces and pressures of one system in every engine that takes it, and where they differ
    most."""
    refuse_outputs({"json": json_file}, overwrite, [system])
    from kickdrift.analysis.compare.engine_forces import compare_engines as compared

    subject = subject_of(system, seed, frame=frame, **files)
    with busy("computing forces in each engine", quiet):
        found = compared(subject, engine)
    show_found(found, json_file, overwrite)


@with_options("dt", "rtol", "atol")
def chaos(
    system: opt.Subject,
    time: Annotated[Any, option("T", "Length of the run, such as '5 yr' (default: the file's).", parser=span)] = None,
    integrator: Annotated[
        str | None, option("NAME", "Default: the file's if it can carry deviations, else dop853.")
    ] = None,
    options: Any = None,
    spectrum: Annotated[
        str | None, option("K", "Lyapunov spectrum instead: the K largest exponents, or all of them.")
    ] = None,
    seed: Annotated[int, option("S", "Seed of the first deviation.", min=0)] = 0,
    threads: opt.Threads = 1,
    json_file: opt.Json = None,
    overwrite: opt.Overwrite = False,
    quiet: opt.Quiet = False,
) -> None:
    """Tell regular from chaotic motion: MEGNO and the largest Lyapunov exponent from the variational equations, or the
    Lyapunov spectrum."""
    refuse_outputs({"json": json_file}, overwrite, [system])

    subject = subject_of(system)
    time = in_units(time, subject, "--time")
    if spectrum is not None and spectrum != "all" and not whole_text(spectrum):
        raise InputError(f"--spectrum: expected a number of exponents, or all, got {shown(spectrum)}")
    with progress_bar(quiet) as bar:
        given: Any = {"seed": seed, "threads": threads, "progress": bar("running"), **options}
        found: Any
        if spectrum is None:
            found = kd.megno(subject, time, integrator, **given)
        else:
            count = None if spectrum == "all" else int(spectrum)
            found = kd.lyapunov_spectrum(subject, time, integrator, count=count, **given)
    try:
        write_json(json_file, found.as_json(), overwrite=overwrite)
    finally:
        print_lines(lines_of(found))


@with_options("dt", "rtol", "atol")
def transits(
    system: opt.Subject,
    planet: Annotated[str, argument("PLANET", "Name or number of the planet.")],
    until: Annotated[Any, option("T", "Last time, such as '40 day'.", parser=span)],
    star: Annotated[str | None, option("NAME", "Name or number of the star (default: the most massive body).")] = None,
    direction: Annotated[str, option("X,Y,Z", "Direction from the system towards the observer.")] = "0,0,1",
    within: Annotated[
        str | None, option("D", "Largest distance on the sky (default: the sum of both radii, if there are any).")
    ] = None,
    light_time: Annotated[bool, typer.Option("--light-time", help="Times at which light arrives.")] = False,
    masses: Annotated[bool, typer.Option("--masses", help="Differentiate by the masses, too.")] = False,
    elements: Annotated[
        list[str] | None, option("BODY.KEY", "Orbital element to differentiate by, such as b.e; repeat for several.")
    ] = None,
    integrator: Annotated[str | None, option("NAME", "Default: the file's if it suits, else gauss-radau15.")] = None,
    options: Any = None,
    threads: opt.Threads = 1,
    json_file: opt.Json = None,
    overwrite: opt.Overwrite = False,
    quiet: opt.Quiet = False,
) -> None:
    """Find the times at which a planet passes in front of its star; --json has their derivatives by the start."""
    refuse_outputs({"json": json_file}, overwrite, [system])

    subject: Any = subject_of(system)
    with progress_bar(quiet) as bar:
        found = kd.transits(
            subject, _body(planet), None if star is None else _body(star), until=until, direction=_numbers(direction),
            within=_amount(within), light_time=light_time, masses=masses, elements=elements or (),
            integrator=integrator, threads=threads, progress=bar("running"), **options,
        )  # fmt: skip
    show_found(found, json_file, overwrite)


def _body(text: str) -> str | int:
    """A body's number, or its name."""
    number = whole_text(text)
    return text if number is None else number


def _numbers(text: str) -> list[float]:
    try:
        return [float(part) for part in text.split(",")]
    except ValueError:
        raise InputError(f"--direction: expected three numbers X,Y,Z, got {shown(text)}") from None


def _amount(text: str | None) -> Any:
    """A number, or a text with a unit."""
    try:
        return None if text is None else float(text)
    except ValueError:
        return text


@with_files
@with_options("dt")
def certify(
    runs: Annotated[
        list[str],
        argument("RUN|SYSTEM", "A run's .h5md, or two at neighbouring temperatures; or a system, for its forces."),
    ],
    temperature: Annotated[
        list[float] | None, option("T", "Temperature (default: the heat bath's); repeat for two runs.")
    ] = None,
    pressure: Annotated[list[float] | None, option("P", "Pressure of a barostat; repeat for two runs.")] = None,
    constraints: Annotated[int, option("N", "Rigid bonds and angles in runs of other programs.", min=0)] = 0,
    topology: Annotated[
        Path | None, option("FILE", "Topology of other programs' trajectories, which MDAnalysis then reads.")
    ] = None,
    engine: Annotated[
        str | None, option("NAME", "Run a system on this engine first; see: kickdrift list engines.")
    ] = None,
    forces: Annotated[bool, typer.Option("--forces", help="With --engine: test its forces in place of a run.")] = False,
    files: Any = None,
    calculator: Annotated[
        str | None, option("NAME", "ASE calculator, such as ase.calculators.emt.EMT, for a structure file.")
    ] = None,
    plot: Annotated[Path | None, option("FILE.png", "Draw the tests of forces.")] = None,
    integrator: Annotated[str | None, option("NAME", "Integrator of the engine's run.")] = None,
    options: Any = None,
    steps: Annotated[int | None, option("N", "Steps of the engine's run.", min=1)] = None,
    every: Annotated[int | None, option("K", "Steps between its samples.", min=1)] = None,
    json_file: opt.Json = None,
    overwrite: opt.Overwrite = False,
    quiet: opt.Quiet = False,
) -> None:
    """Test whether runs sample the canonical ensemble: kinetic energies, axes and species, and the ratio of two runs.
    For a system, test whether its forces are safe for dynamics. The exit status is 1 if a test fails."""
    if forces or calculator or (engine is None and len(runs) == 1 and _names_forces(runs[0])):
        _certify_forces(runs, calculator, engine, options, files, steps, json_file, plot, overwrite, quiet)
        return
    of_engine = [integrator, steps, every, *options.values()]
    if engine is None and any(each is not None for each in of_engine):
        raise InputError("--integrator, --dt, --steps, --every and -o are for --engine: a file has its own")
    if engine is not None and (len(runs) > 1 or topology or pressure or constraints):
        raise InputError("--engine runs one system; give no second run, --topology, --pressure or --constraints")
    if plot is not None:
        raise InputError("--plot draws the tests of a system's forces, not those of runs")
    refuse_outputs({"json": json_file}, overwrite, list(runs))
    from kickdrift.analysis.certify.certifying import engine_checks, ensemble_checks

    if engine is not None:
        with progress_bar(quiet) as bar:
            subject: Any = subject_of(runs[0], **files)
            given = {"temperature": temperature, **options} if temperature else options
            found = engine_checks(subject, engine, integrator, steps, every, bar("running"), **given)
    else:
        sources: list[Any] = list(runs)
        if topology is not None:
            from kickdrift.trajectory.read.universe import mdanalysis

            sources = [mdanalysis("--topology").Universe(str(topology), each) for each in runs]
        with busy("testing", quiet):
            found = ensemble_checks(sources, temperature, pressure, constraints=constraints)
    _print_page(found, json_file, overwrite)


def _print_page(found: Any, json_file: Path | None, overwrite: bool) -> None:
    """Show a certificate and write it as JSON; exit status 1 if a test failed."""
    show_found(found, json_file, overwrite)
    if not found.passed:
        raise typer.Exit(1)


def _names_forces(name: str) -> bool:
    """Whether an argument names forces: a system file, a Python file, a file of a force field, a shipped system, or a
    pair force."""
    return Path(name).suffix.lower() in (".toml", ".py", "", *PARAMETERS)


def _certify_forces(
    systems: list[str],
    calculator: str | None,
    engine: str | None,
    options: dict[str, Any],
    files: dict[str, Any],
    steps: int | None,
    json_file: Any,
    plot: Path | None,
    overwrite: bool,
    quiet: bool,
) -> None:
    """Test the forces of a system, a pair force by its name, or a calculator on the atoms of a structure file."""
    if len(systems) > 1:
        raise InputError(f"certify: tests the forces of one system, got {len(systems)}")
    if further := [key for key, value in options.items() if value is not None and key != "dt"]:
        raise InputError(f"-o {further[0]}: the tests of forces take no options of an integrator")
    refuse_outputs({"json": json_file, "plot": plot}, overwrite, systems)
    from kickdrift.analysis.certify.force_testing import STEPS, force_checks

    with progress_bar(quiet) as bar, compiling_for(f"the forces of {systems[0]}"):
        subject = _tested(systems[0], calculator, files)
        found = force_checks(
            subject,
            engine=engine,
            dt=options.get("dt"),
            steps=STEPS if steps is None else steps,
            progress=bar("testing"),
        )
    if plot is not None:
        from kickdrift.plots.drawing import checked_target, save_figure
        from kickdrift.plots.results import force_figure

        with busy(f"drawing {plot}", quiet):
            save_figure(force_figure(found), checked_target(plot, overwrite))
    _print_page(found, json_file, overwrite)


def _tested(name: str, calculator: str | None, files: dict[str, Any]) -> Any:
    """The subject of ``force_checks``: Atoms with a calculator, a force, or a System."""
    if calculator is not None:
        from kickdrift.forces.seam.named import found, load_module

        load_module(calculator.rpartition(".")[0] or calculator)
        system: Any = subject_of(name, **files)
        return system.remade(forces=[kd.CalculatorForce(found("--calculator", calculator, callable))])
    if name in FORCES and not is_shipped(name) and not Path(name).exists():
        return FORCES[name]()
    return subject_of(name, **files)


Frames = StrEnum("Frames", "jacobi heliocentric barycentric")  # origins of orbits
Planes = StrEnum("Planes", "invariable file")  # reference planes of orbits


def analyze(
    run: Annotated[Path, argument("RUN.h5md", "A run's file, of bodies under gravity.")],
    frame: Annotated[Frames, option("NAME", f"Origin of the orbits: {', '.join(Frames)}.")] = Frames.jacobi,
    plane: Annotated[
        Planes, option("NAME", f"Plane of inclinations and nodes: {', '.join(Planes)}.")
    ] = Planes.invariable,
    order: Annotated[int, option("N", "Largest p - q of resonances p : q of mean motions.", min=1)] = 4,
    until: Annotated[Any, option("T", "Last time to use, such as '20 Myr' (default: all).", parser=span)] = None,
    plot: Annotated[Path | None, option("FILE.png", "Draw the orbits' frequencies and librating angles.")] = None,
    json_file: opt.Json = None,
    overwrite: opt.Overwrite = False,
    quiet: opt.Quiet = False,
) -> None:
    """Find the proper frequencies of each orbit, their secular periods, and resonant angles that librate."""
    refuse_outputs({"json": json_file, "plot": plot}, overwrite, [run])
    from kickdrift.analysis.orbits.secular_run import orbit_report

    with busy(f"analysing {run}", quiet):
        found = orbit_report(run, str(frame), str(plane), order, until)
    show_found(found, json_file, overwrite)
    _draw_found(found, plot, overwrite, quiet)


def _draw_found(found: Any, plot: Path | None, overwrite: bool, quiet: bool) -> None:
    """Draw a report, if a file is given, and print the file's name."""
    if plot is None:
        return
    from kickdrift.plots.drawing import checked_target, save_figure

    with busy(f"drawing {plot}", quiet):
        drawn = save_figure(found.plot(), checked_target(plot, overwrite))
    out(str(drawn))


def cluster(
    subject: Annotated[str, argument("RUN|SYSTEM", "A run's .h5md, or a system, of stars under gravity.")],
    fraction: Annotated[
        list[float] | None,
        option("X", "Share of the bound mass for a Lagrangian radius; repeat for several (default: 0.01 to 0.9)."),
    ] = None,
    neighbours: Annotated[int, option("N", "Neighbours of a star for its density.", min=3)] = 6,
    coulomb: Annotated[float, option("X", "Factor of N in Coulomb's logarithm.")] = 0.11,
    tidal_radius: Annotated[
        float | None, option("R", "Tidal radius (default: by the system's fields); stars beyond twice R escape.")
    ] = None,
    plot: Annotated[Path | None, option("FILE.png", "Draw radii, core density and binaries against time.")] = None,
    json_file: opt.Json = None,
    overwrite: opt.Overwrite = False,
    quiet: opt.Quiet = False,
) -> None:
    """Find a star cluster's Lagrangian radii, core radius and density, half-mass relaxation time, anisotropy, binaries
    and escapers: over the frames of a run, or of a system's start."""
    refuse_outputs({"json": json_file, "plot": plot}, overwrite, [subject])
    from kickdrift.analysis.clusters.cluster import FRACTIONS
    from kickdrift.analysis.clusters.report import cluster_report

    source: Any = subject if opt.is_run(subject) else subject_of(subject)
    with busy(f"analysing {subject}", quiet):
        found = cluster_report(
            source, fraction or FRACTIONS, neighbours=neighbours, coulomb=coulomb, tidal_radius=tidal_radius
        )
    show_found(found, json_file, overwrite)
    _draw_found(found, plot, overwrite, quiet)

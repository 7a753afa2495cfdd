"""The commands ``run``, ``resume`` and ``relax``."""

from __future__ import annotations

from dataclasses import replace
from functools import partial
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Annotated, Any

import typer

import kickdrift as kd
from kickdrift.cli import options as opt
from kickdrift.cli.console import busy, print_lines, progress_bar, say, show_found
from kickdrift.cli.options import (
    amount,
    argument,
    in_units,
    length,
    method_names,
    option,
    row,
    subject_of,
    whole,
    with_options,
)
from kickdrift.cli.stages import has_stages, refuse_beside_stages, run_stages
from kickdrift.cli.watching import (
    ImdOption,
    ImdWaitOption,
    Interruption,
    LiveOption,
    check_watching,
    warn_of_version,
    watched,
)
from kickdrift.disk import kinds
from kickdrift.disk.outputs import refuse_outputs, write_json, write_system
from kickdrift.display.showing import lines_of
from kickdrift.engines import engine as engine_named
from kickdrift.errors import InputError
from kickdrift.integrators.asked import known_options
from kickdrift.integrators.options import COORDINATES
from kickdrift.model.checks.limits import whole_text
from kickdrift.model.problem import Problem
from kickdrift.model.system import System
from kickdrift.systemfile.files import PARAMETERS
from kickdrift.text import shown

WHOLE = ("steps", "interval")


def with_keys(chosen: System | Problem, pairs: list[str]) -> System | Problem:
    """The system with keys of [equilibrate] from texts KEY=VALUE, over those of its file."""
    from kickdrift.systemfile.schema_run import EquilibrateTable, equilibration_of

    if not pairs:
        return chosen
    if not isinstance(chosen, System):
        raise InputError("--equilibrate: a Problem has no temperature")
    given: dict[str, Any] = {}
    for text in pairs:
        key, equals, value = (part.strip() for part in text.partition("="))
        if not (equals and key and value):
            raise InputError(f"--equilibrate: expected KEY=VALUE, such as temperature=1, got {shown(text)}")
        if key in given:
            raise InputError(f"--equilibrate {key}: is given twice")
        known = None if key in EquilibrateTable.model_fields else known_options().get(key)
        given[key] = known.parsed(value) if known else _number(key, value)
    said = chosen.equilibration.said() if chosen.equilibration else {}
    for one, other in (("steps", "time"), ("time", "steps")):
        if one in given and other not in given:
            said.pop(other, None)
    return chosen.with_equilibration(equilibration_of(said | given, chosen.units, chosen.run))


def _number(key: str, text: str) -> int | float | str:
    """The number that a text is, whole where it must be, or the text itself."""
    whole = whole_text(text)
    if whole is not None:
        return whole
    try:
        found = float(text)
    except ValueError:
        return text
    return int(found) if key in WHOLE and found.is_integer() else found


TimesOption = Annotated[
    Any,
    option(
        "T,…",
        "Samples and frames at exactly these times, which rise: 1,2.5,4 or START:STOP:COUNT. The run ends at the "
        "last one.",
        parser=row,
    ),
]


@with_options(
    "dt", "rtol", "atol", "max_step", "compensated", "precision", "coordinates", "corrector", "order", "eta", "scheme"
)
def run(
    system: opt.Subject,
    integrator: Annotated[
        str | None, option("NAME", "See: kickdrift list integrators.", autocompletion=method_names)
    ] = None,
    options: Any = None,
    steps: Annotated[int | None, option("N", "Number of steps, such as 1e6.", parser=whole(0))] = None,
    time: Annotated[
        Any,
        option(
            "T",
            "Length of the run in time, such as '5 ps', instead of --steps; negative for a run back in time.",
            parser=length,
        ),
    ] = None,
    exact: Annotated[
        str | None,
        option(
            "NAME",
            "With fixed steps, a --time between two steps: false runs to the nearest (default), true is an error, "
            "shorten shortens the last step.",
        ),
    ] = None,
    every: Annotated[int | None, option("K", "Steps between samples and frames.", parser=whole(1))] = None,
    interval: Annotated[
        Any, option("T", "Time between samples and frames, for adaptive methods.", parser=length)
    ] = None,
    times: TimesOption = None,
    output: Annotated[
        Path | None, option("FILE", "Write the trajectory: .h5md; of an ODE .h5, .csv or .parquet.")
    ] = None,
    overwrite: opt.Overwrite = False,
    flush: opt.Flush = None,
    store: Annotated[str | None, option("NAME", "Type of stored frames: float64 (default), float32.")] = None,
    old_store: Annotated[str | None, typer.Option("--precision", hidden=True)] = None,
    compress: Annotated[bool, typer.Option("--compress", help="Compress the file at the end; lossless.")] = False,
    write: Annotated[str | None, option("NAMES", "Further data in frames: forces, images, or forces,images.")] = None,
    seed: Annotated[int | None, option("S", "Seed of random velocities.", min=0)] = None,
    frame: opt.Frame = None,
    force_field: opt.ForceField = None,
    cutoff: opt.Cutoff = None,
    rigid: opt.Rigid = None,
    equilibrate: Annotated[
        list[str] | None,
        option(
            "KEY=VALUE",
            "A key of the table [equilibrate]: temperature=2, to=1 and time=5 cool from 2 to 1. Repeatable.",
            "--equilibrate",
            "-e",
        ),
    ] = None,
    threads: opt.Threads = 1,
    engine: Annotated[str, option("NAME", "See: kickdrift list engines.")] = "native",
    processes: Annotated[
        int | None, option("N", "Number of processes, for an engine that can use several: lammps (default: 1).", min=1)
    ] = None,
    hosts: opt.Hosts = None,
    imd: ImdOption = None,
    imd_wait: ImdWaitOption = False,
    live: LiveOption = None,
    json_file: opt.Json = None,
    quiet: opt.Quiet = False,
) -> None:
    """Run a system and report how well it conserved energy and momentum."""
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
    files: dict[str, Any] = {"force_field": force_field or None, "cutoff": cutoff, "rigid": rigid}
    origin = options.get(COORDINATES.name)  # an option of the method, or a file
    if origin is not None and (Path(system).suffix.lower() in PARAMETERS or Path(origin).suffix):
        files["coordinates"] = options.pop(COORDINATES.name)
    chosen = with_keys(subject_of(system, seed, frame=frame, **files), equilibrate or [])

    from kickdrift.run.stages import protocol

    if isinstance(chosen, System) and chosen.stages:
        alone = {
            "integrator": integrator, "-o": options, "steps": steps, "time": time, "exact": exact, "every": every,
            "interval": interval, "times": times, "engine": engine != "native", "processes": processes, "hosts": hosts,
            "imd": imd, "live": live,
        }  # fmt: skip
        refuse_beside_stages(system, alone)
        stages = protocol(chosen, output=output, overwrite=overwrite, threads=threads, file=file)
        run_stages(stages, json_file, quiet, overwrite)
        return

    from kickdrift.run.equilibration import equilibrate_as_told
    from kickdrift.run.files import check_suffix
    from kickdrift.run.plan.lengths import SHORTEN
    from kickdrift.run.times import length_of

    choices: dict[str, Any] = {"true": True, "false": False, SHORTEN: SHORTEN}
    if exact is not None and exact not in choices:
        raise InputError(f"--exact {shown(exact)} is unknown; known are {', '.join(choices)}")
    if output is not None:
        check_suffix(chosen, str(output))
    ending = choices[exact or "false"]
    time, interval = in_units(time, chosen, "--time"), in_units(interval, chosen, "--interval")

    check_watching(chosen, live, imd, imd_wait, quiet)
    sim = kd.Simulation(chosen, integrator, threads=threads, engine=engine, processes=processes, hosts=hosts, **options)
    wanted_length = partial(length_of, sim, system, steps, time, ending, times)
    wanted_length()  # or its error, before anything runs
    warn_of_version(sim, quiet)
    stopped = Interruption(output, isinstance(chosen, System))
    with stopped, watched(sim, live, imd, imd_wait, quiet), progress_bar(quiet) as bar:
        if isinstance(chosen, System) and chosen.equilibration:
            exactly = any(text.split("=")[0].strip() in ("temperature", "to") for text in equilibrate or [])
            equilibrate_as_told(sim, exactly, bar("equilibrating"))
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


def file_options(output: Path | None, given: dict[str, Any]) -> kd.FileOptions | None:
    """Options of the output file; None without any."""
    asked = {key: value for key, value in given.items() if value is not None}
    if asked and output is None:
        raise InputError(f"--{next(iter(asked))}: needs --output")
    return kd.FileOptions(**asked) if asked else None


def resume(
    file: Annotated[Path, argument("FILE", "A run's .h5md, or the .h5 of an ODE, finished or not.")],
    steps: Annotated[
        int | None, option("N", "Continue to this step, counted from the run's start.", parser=whole(0))
    ] = None,
    time: Annotated[
        Any, option("T", "Continue to this time since the run's start, instead of --steps.", parser=length)
    ] = None,
    times: TimesOption = None,
    threads: Annotated[
        int | None, option("K", "Threads (default: as in the run); they do not change the results.", min=1)
    ] = None,
    hosts: opt.Hosts = None,
    flush: opt.Flush = None,
    imd: ImdOption = None,
    imd_wait: ImdWaitOption = False,
    live: LiveOption = None,
    json_file: opt.Json = None,
    overwrite: Annotated[bool, typer.Option("--overwrite", help="Replace the JSON file.")] = False,
    quiet: opt.Quiet = False,
) -> None:
    """Finish an interrupted run or extend a finished one, with the same bits as an uninterrupted run."""
    _refuse_both(steps=steps, time=time)
    _refuse_both(times=times, steps=steps)
    _refuse_both(times=times, time=time)
    refuse_outputs({"json": json_file}, overwrite, [file])
    from kickdrift.run.resuming import continued
    from kickdrift.run.stages import protocol

    if has_stages(file):
        alone = {"steps": steps, "time": time, "times": times, "hosts": hosts, "imd": imd, "live": live}
        refuse_beside_stages(str(file), alone)
        run_stages(protocol(file, threads=threads), json_file, quiet, overwrite, goes_on=True)
        return
    with Interruption(file, resumed=True) as stopped:
        with busy(f"reading {file}", quiet):
            sim = kd.resume(file, threads=threads, hosts=hosts)
        check_watching(sim.system, live, imd, imd_wait, quiet)
        warn_of_version(sim, quiet)
        with kd.open(file) as run:
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


def show(
    report: kd.Report, sim: kd.Simulation, output: Path | None, json_file: Path | None, quiet: bool, overwrite: bool
) -> None:
    """Print a run's report with its warnings, and write the report on request."""
    try:
        write_json(json_file, report.as_json(), overwrite=overwrite)
    finally:  # a full disk does not lose the results
        print_lines(lines_of(report.written_to(output)))


@opt.with_files
def relax(
    system: opt.Subject,
    output: Annotated[
        Path | None,
        option("FILE.toml", "Write the relaxed system: a system file, or what export writes."),
    ] = None,
    force: Annotated[
        Any,
        option(
            "F",
            "Tolerance of the largest force on a particle (default 1e-6).",
            parser=amount("a force such as 1e-6, or '1e-6 eV/angstrom'"),
        ),
    ] = None,
    steps: Annotated[int | None, option("N", "Most steps (default 10000).", parser=whole(0))] = None,
    method: Annotated[str | None, option("NAME", "fire (default) or l-bfgs.")] = None,
    max_displacement: Annotated[
        Any,
        option(
            "X",
            "Longest step of a particle (default: a tenth of the shortest sigma).",
            parser=amount("a length such as 0.1, or '0.3 angstrom'"),
        ),
    ] = None,
    soft: Annotated[
        bool, typer.Option("--soft", help="First part chains that cross, by soft potentials of growing strength.")
    ] = False,
    strain: Annotated[
        float | None, option("E", "Also measure the elastic constants of a crystal, by strains up to E, such as 0.001.")
    ] = None,
    seed: Annotated[int | None, option("S", "Seed of random velocities.", min=0)] = None,
    frame: opt.Frame = None,
    files: Any = None,
    threads: opt.Threads = 1,
    json_file: opt.Json = None,
    overwrite: opt.Overwrite = False,
    quiet: opt.Quiet = False,
) -> None:
    """Move particles to a minimum of their potential energy, also from a random start with overlaps. The relaxed system
    keeps the velocities of the file."""
    from kickdrift.analysis.crystals.elastic import check_crystal, elastic_constants
    from kickdrift.trajectory.export.formats import FORMATS

    exported = output is not None and output.suffix.lower() in FORMATS
    kind = kinds.export(output.suffix, tuple(FORMATS)) if output is not None and exported else kinds.SYSTEM
    kind = kind if exported else kind._replace(suffixes=(".toml", *FORMATS))
    refuse_outputs({"output": output, "json": json_file}, overwrite, [system], kind)
    from kickdrift.forces.bound.forces import check_threads
    from kickdrift.run.minimization import minimum

    start = subject_of(system, seed, overlaps=True, frame=frame, **files)
    if not isinstance(start, System):
        raise InputError(f"{system}: is an ODE; relax needs particles")
    if strain is not None:
        check_crystal(start, strain)
    if output is not None and not exported:
        start.at(start.state.phase, 0.0).to_toml()  # refuses a system that no file can hold, before any work
    asked = {"force": force, "steps": steps, "method": method, "max_displacement": max_displacement}
    given = {key: value for key, value in asked.items() if value is not None}
    with progress_bar(quiet) as bar:
        found = minimum(start, check_threads(threads), **given, soft=soft, progress=bar("minimizing"))
    elastic = None
    if not found.converged:
        say(f"warning: not converged: {found.trouble}", quiet)
    elif strain is not None:
        with busy("straining the crystal", quiet):
            elastic = elastic_constants(found.system, strain, threads)
    try:
        if output is not None and exported:
            _export(found.system, output, overwrite)
        else:
            write_system(output, found.system.to_toml() if output else "", overwrite=overwrite)
        more = {} if elastic is None else {"elastic": elastic.as_json()}
        write_json(json_file, found.as_json() | more, overwrite=overwrite)
    finally:
        print_lines([*lines_of(found), *([("written", str(output))] if output else [])])
        if elastic is not None:
            show_found(elastic, None, overwrite)
    if not found.converged:
        raise typer.Exit(1)


def _export(system: System, output: Path, overwrite: bool) -> None:
    """Write a System as ``export`` writes the last frame of a run."""
    with TemporaryDirectory() as folder:
        path = Path(folder) / "relaxed.h5md"
        kd.Simulation(system, "velocity-verlet", system.run.dt or 1.0).run(0, output=path)
        for note in kd.export(path, output, overwrite=overwrite).notes:
            say(f"{output}: {note}")

"""The commands ``export``, ``info``, ``show``, ``list``, ``new``, ``schema``, ``cite`` and ``doctor``."""

from __future__ import annotations

import os
import sys
from enum import StrEnum
from pathlib import Path
from typing import Annotated, Any, cast

import typer

import kickdrift as kd
from kickdrift.cli.console import busy, out, print_lines, progress_bar, say, show_found, verbatim
from kickdrift.cli.options import (
    Frame,
    Json,
    Overwrite,
    Quiet,
    argument,
    is_run,
    option,
    subject_of,
    system_of_frame,
    with_files,
)
from kickdrift.disk.files import shown_path
from kickdrift.disk.foreign import is_lammps_input
from kickdrift.disk.kinds import JSON, SYSTEM
from kickdrift.disk.outputs import refuse_outputs, write_json, write_system, written_whole
from kickdrift.display.showing import lines_of
from kickdrift.errors import InputError
from kickdrift.integrators import integrator
from kickdrift.integrators.asked import settled
from kickdrift.model.problem import Problem
from kickdrift.model.system import System
from kickdrift.systemfile.files import PARAMETERS, STRUCTURES, find, is_shipped, parsed
from kickdrift.text import counted

TABLES = (".parquet", ".h5")  # suffixes of ensembles' tables
LAMMPS_INPUTS = (".in", ".lammps")  # suffixes of LAMMPS' inputs, beside names that begin with in.
SCHEMA = "system-file.schema.json"  # also the name that shipped files give


@with_files
def export(
    file: Annotated[Path, argument("FILE.h5md", "A run's file; or a system, for files of LAMMPS or GROMACS.")],
    output: Annotated[
        Path,
        argument(
            "OUT",
            "The suffix sets the format: dcd, xtc, trr, xyz, pdb, extxyz, traj, data, bin; in.NAME or NAME.in is an "
            "input of LAMMPS, and NAME.top the topology of GROMACS beside NAME.gro.",
        ),
    ],
    unwrapped: Annotated[
        bool,
        typer.Option("--unwrapped/--wrapped", help="Unwrapped positions as in the run, or positions inside the box."),
    ] = False,
    start: Annotated[int | None, option("A", "First frame, from 0; negative from the end.")] = None,
    stop: Annotated[int | None, option("B", "First frame after the chosen ones.")] = None,
    step: Annotated[int | None, option("C", "Only every C-th frame.", min=1)] = None,
    frame: Frame = None,
    files: Any = None,
    overwrite: Overwrite = False,
    quiet: Quiet = False,
) -> None:
    """Write a run's frames for other programs, and print what the format loses. Or write a system, or a frame of a run
    with its forces, as an input of LAMMPS or a topology of GROMACS."""
    gromacs = output.suffix.lower() == ".top"
    if gromacs or output.name.startswith("in.") or output.suffix.lower() in LAMMPS_INPUTS:
        what = "a topology of GROMACS" if gromacs else "an input of LAMMPS"
        if unwrapped or not start is stop is step is None:
            raise InputError(f"{what} has one --frame; --unwrapped, --start, --stop and --step are for others")
        made = subject_of(str(file), frame=frame, **files)
        if not isinstance(made, System):
            raise InputError(f"{file}: is an ODE; {'GROMACS' if gromacs else 'LAMMPS'} moves particles")
        for each in (made.to_gromacs if gromacs else made.to_lammps)(output, overwrite).files:
            out(str(each))
        return
    if any(value is not None for value in files.values()):
        raise InputError("files of force fields are for in.NAME and NAME.in of LAMMPS, and for NAME.top")
    if frame is not None:
        if not start is stop is step is None:
            raise InputError("--frame is one frame; --start, --stop and --step choose others")
        start, stop = frame, frame + 1 or None
    with progress_bar(quiet) as bar:
        done = kd.export(
            file, output, unwrapped=unwrapped, start=start, stop=stop, step=step, overwrite=overwrite,
            progress=bar("exporting"),
        )  # fmt: skip
    say("; ".join([done.losses, *done.notes]), quiet)
    out(f"{done.path}: {counted(done.frames, 'frame')} of {counted(done.particles, 'particle')}")


@with_files
def info(
    file: Annotated[
        str, argument("FILE", "A run's file, an ensemble's table, a system file or name, or a potential's file.")
    ],
    all_: Annotated[bool, typer.Option("--all", help="Everything that a run's file holds.")] = False,
    files: Any = None,
    json_file: Json = None,
    overwrite: Overwrite = False,
) -> None:
    """Describe a run's file, an ensemble's table or a potential's file, or check a system file without running it."""
    from kickdrift.analysis.crystals.potential import is_potential, potential_file

    refuse_outputs({"json": json_file}, overwrite, [file])
    if Path(file).suffix == ".h5md" and not os.path.lexists(file):
        raise InputError(f"{file}: no such file")
    if is_potential(file):
        if all_ or json_file is not None:
            raise InputError(f"{file}: {'--all' if all_ else '--json'} is for the file of a run")
        with busy(f"crystals of {file}"):
            lines = potential_file(file).lines()
        print_lines(lines)
        return
    if is_problem(Path(file)):
        _info_of_problem(file, all_, json_file, overwrite)
        return
    archive = Path(file).suffix.lower() == ".bin"
    of_run = (
        not archive
        and os.path.lexists(file)
        and Path(file).suffix.lower() not in (*TABLES, *PARAMETERS, *STRUCTURES, ".toml")
        and not is_shipped(file)
        and not is_lammps_input(file)
    )
    if (all_ or json_file is not None) and not of_run:
        raise InputError(f"{file}: {'--all' if all_ else '--json'} is for the file of a run")
    if Path(file).suffix.lower() in TABLES:
        from kickdrift.cli.ensemble import print_ensemble

        print_ensemble(kd.Ensemble.read(file), Path(file))
        return
    if not of_run:
        from kickdrift.run.report.charges import charge_warnings, charges_of
        from kickdrift.run.report.warnings import unused_warnings

        system = kd.load(file, **files)
        check_run(system)
        (key, name), *rest = lines_of(system)
        charged = charges_of(system)
        more = [] if charged is None else charged.lines(cast(System, system).units.symbol("length"))
        warnings = [("warning", told) for told in (*unused_warnings(system), *charge_warnings(system))]
        print_lines([(key, f"{name}: valid"), *rest, *more, *warnings])
        return
    from kickdrift.trajectory.overview import overview
    from kickdrift.trajectory.read.info import WIDTH, described
    from kickdrift.trajectory.read.info import info as found

    if all_ or json_file is not None:
        with busy(f"reading {file}"):
            content = found(file)
    if all_:
        rows = described(content)
        out(content["file"])
        print_lines(rows, min(WIDTH, max(len(key) for key, _ in rows)))
    else:
        with busy(f"reading {file}"):
            lines = overview(file)
        print_lines(lines)
    if json_file is not None:
        write_json(json_file, content, overwrite=overwrite)


def is_problem(file: Path) -> bool:
    """Whether FILE is the run of a Problem, or its table."""
    from kickdrift.trajectory import opened

    return file.suffix.lower() in (*TABLES, ".csv") and opened.is_problem(file)


def _info_of_problem(file: str, whole: bool, json_file: Path | None, overwrite: bool) -> None:
    """Describe the file of a Problem's run, or its table."""
    from kickdrift.trajectory.overview import overview_of_problem
    from kickdrift.trajectory.problems.reader import ProblemRun, describe_any
    from kickdrift.trajectory.problems.reader import info as found

    with kd.open(file) as run:
        table = not isinstance(run, ProblemRun)
        if table and json_file is not None:
            raise InputError(f"{file}: --json is for the file of a run, and FILE is a table")
        if whole or table:
            for line in describe_any(run).split("\n"):
                out(line)
        else:
            print_lines(overview_of_problem(run))
        if json_file is not None:
            write_json(json_file, found(run), overwrite=overwrite)


def check_run(system: System | Problem) -> None:
    """Raise InputError if a system's [run] names no method, or options that the method does not take."""
    if system.run.integrator is not None:
        try:
            settled(integrator(system.run.integrator), {}, system.run, getattr(system, "units", None))
        except InputError as error:
            raise InputError(f"run: {error}") from None


Lists = StrEnum("Lists", "integrators forces systems engines")
HINTS = {
    Lists.integrators: "kickdrift list integrators NAME explains a method; kickdrift compare SYSTEM measures methods",
    Lists.systems: "kickdrift run NAME runs a system; kickdrift show NAME prints its file, to edit",
}  # what to do next, on a terminal


def show(
    system: Annotated[str, argument("SYSTEM", "A shipped system's name, a system file, or a run's .h5md.")],
    frame: Frame = None,
) -> None:
    """Print a system file's text, to save and edit: kickdrift show lj-1000 > mine.toml. For a run's file: the system
    of a frame, in the box and at the time of that moment."""
    if is_run(system):
        verbatim(system_of_frame(system, frame).to_toml())
        return
    if frame is not None:
        raise InputError(f"{system}: --frame is for the file of a run of particles")
    verbatim(parsed(find(system))[0])


def list_(
    what: Annotated[Lists, argument("WHAT", f"{', '.join(Lists)}.")],
    name: Annotated[str | None, argument("[NAME]", "Explain this integrator.")] = None,
    all_: Annotated[bool, typer.Option("--all", help="Every column, whatever the terminal's width.")] = False,
    json_file: Json = None,
    overwrite: Overwrite = False,
) -> None:
    """List integrators, forces, systems or engines, or explain an integrator and its options."""
    refuse_outputs({"json": json_file}, overwrite)
    found = kd.listing(str(what), name)
    show_found(found, json_file, overwrite, whole=all_)
    if what in HINTS and name is None and sys.stderr is not None and sys.stderr.isatty():
        say(HINTS[what])


def new(
    kind: Annotated[
        str, argument("[KIND]", "liquid, bath, mixture, polymer, water, planets, cluster or ode.")
    ] = "liquid",
    output: Annotated[Path | None, option("FILE.toml", "Default: KIND.toml in this folder.")] = None,
    model: Annotated[
        str | None,
        option("NAME", "Another model of the kind: tip4p2005 for water, else SPC/E; king for cluster, else Plummer's."),
    ] = None,
    schema: Annotated[
        bool,
        typer.Option("--schema", help="Write the schema beside the file, and name it in the first line for editors."),
    ] = False,
    quiet: Quiet = False,
) -> None:
    """Write a commented system file to start from. No file is replaced."""
    from kickdrift.systemfile.json_schema import json_schema_text

    target = Path(f"{kind}.toml") if output is None else output
    text = kd.template(kind, model).replace(f" {kind}.toml", f" {target}")
    if os.path.lexists(target):
        raise InputError(
            f"{shown_path(target)}: exists already, and new replaces no file; give another name by --output"
        )
    refuse_outputs({"output": target}, False, output=SYSTEM)
    beside = target.with_name(SCHEMA)
    if schema:
        refuse_outputs({"output": None if os.path.lexists(beside) else beside}, False, output=JSON)
        text = f"#:schema ./{SCHEMA}\n{text}"
    write_system(target, text, overwrite=False)
    if schema and os.path.lexists(beside):
        say(f"{shown_path(beside)} was there already", quiet)
    elif schema:
        with written_whole(beside, JSON, overwrite=False) as part:
            part.write_text(json_schema_text(), encoding="utf-8")
    say(f"wrote {target}; run it with: kickdrift run {target}", quiet)


def schema() -> None:
    """Print the JSON schema of system files, by which editors complete keys and check values. A file names its schema
    in the first line: #:schema ./system-file.schema.json is the file of that name in the same folder."""
    from kickdrift.systemfile.json_schema import json_schema_text

    verbatim(json_schema_text())


def cite(
    name: Annotated[str, argument("FILE|NAME", "A run's file, a system, a method, a force or an engine.")],
) -> None:
    """Print BibTeX entries for what a run used, or for a system, a method, a force or an engine."""
    verbatim(kd.cite(name) + "\n")


def doctor(json_file: Json = None, overwrite: Overwrite = False) -> None:
    """Print versions, processor, lanes, threads, the state of compiled code, and what is missing."""
    refuse_outputs({"json": json_file}, overwrite)
    found = kd.doctor()
    show_found(found, json_file, overwrite)
    if found.problems:
        raise typer.Exit(1)

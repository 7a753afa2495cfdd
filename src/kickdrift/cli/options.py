"""Arguments and options of several commands, and readers of their values: 1e6, or "5 ps"."""

from __future__ import annotations

import inspect
import math
from collections.abc import Callable
from functools import wraps
from pathlib import Path
from typing import Annotated, Any

import numpy as np
import typer

from kickdrift.cli.console import hush, results_on_stderr
from kickdrift.disk.outputs import STDOUT
from kickdrift.errors import InputError
from kickdrift.integrators import INTEGRATORS
from kickdrift.integrators.asked import known_options, parsed, takers
from kickdrift.integrators.options import DOUBLE, DT, MIXED, PRECISION, Option
from kickdrift.model.checks.limits import whole_text
from kickdrift.model.system import System
from kickdrift.model.units.quantities import has_unit, time_in
from kickdrift.systemfile.files import shipped
from kickdrift.text import shown


def whole(least: int) -> Callable[[str], int]:
    """Return the reader of a whole number, ``least`` or more: 1000000, 1e6 or 1_000_000."""

    def read(text: str) -> int:
        found: float | None = whole_text(text)
        if found is None:
            try:
                found = float(text)
            except ValueError:
                found = math.nan
        if not (isinstance(found, int) or found.is_integer()) or found < least:
            raise typer.BadParameter(f"{shown(text)} is not a whole number, {least} or more.")
        return int(found)

    return read


def turn_seconds(text: str) -> float:
    """Read the seconds of a turn: 0.001 or more, and finite."""
    try:
        found = float(text)
    except ValueError:
        found = math.nan
    if not 0.001 <= found < math.inf:
        raise typer.BadParameter(f"{shown(text)} is no number of seconds, 0.001 or more.")
    return found


def amount(expected: str) -> Callable[[str], Any]:
    """Return the reader of a number in the system's unit, or of a text with a unit. ``expected`` gives examples."""

    def read(text: str) -> Any:
        try:
            return float(text)
        except ValueError:
            if not has_unit(text):
                raise typer.BadParameter(f"{shown(text)} is not {expected}.") from None
            return text

    return read


def row(text: str) -> list[Any]:
    """Read times with commas between them, or START:STOP:COUNT for evenly spaced times."""
    start, *rest = text.split(":")
    if not rest:
        return [length(part.strip()) for part in text.split(",")]
    try:
        stop, count = rest
        return [float(value) for value in np.linspace(float(start), float(stop), whole(1)(count))]
    except (ValueError, OverflowError, MemoryError, typer.BadParameter):
        raise typer.BadParameter(f"{shown(text)} is neither times such as 1,2.5,4 nor START:STOP:COUNT.") from None


length = amount("a time such as 10, or '10 fs'")  # a text with a unit is for ``in_units``


def in_units(value: Any, subject: Any, flag: str) -> float | None:
    """A time in the units of a System, from a number or a text; an InputError names the flag."""
    found: float | None = time_in(value, subject.units if isinstance(subject, System) else None, flag)
    return found


def subject_of(
    name: str, seed: int | None = None, overlaps: bool = False, frame: int | None = None, **files: Any
) -> Any:
    """The System or Problem of a command's argument. A Python file is run, and the file of a run has a System for each
    frame. ``files`` go with files of force fields, see `kickdrift.load`."""
    from kickdrift.systemfile.python_file import load_or_run
    from kickdrift.systemfile.reading import refuse_files

    if is_run(name):
        if seed is not None:
            raise InputError("--seed: a frame draws no velocities; for a heat bath give -o seed=S")
        refuse_files(name, files)
        return system_of_frame(name, frame)
    if frame is not None:
        raise InputError(f"{name}: --frame is for the file of a run of particles")
    return load_or_run(name, seed, overlaps, **files)


def is_run(name: str) -> bool:
    """Tell whether a name is that of a run's file."""
    return Path(name).suffix.lower() == ".h5md"


def system_of_frame(path: str, number: int | None = None) -> Any:
    """The System at a frame of a run's file, counted from 0, or from -1 backwards; the last one by default."""
    from kickdrift.trajectory.opened import opened_at

    with opened_at(path, number) as frame:
        return frame.system


def option(metavar: str, help: str, *names: str, **more: Any) -> Any:
    """An option whose value ``metavar`` stands for in the help."""
    return typer.Option(*names, metavar=metavar, help=help, **more)


def argument(metavar: str, help: str, **more: Any) -> Any:
    """An argument that ``metavar`` stands for in the help."""
    return typer.Argument(metavar=metavar, help=help, **more)


def system_names(incomplete: str) -> list[str]:
    """Names of shipped systems that begin so, for completion in a shell; without any, the shell completes files."""
    return [name for name in shipped() if name.startswith(incomplete)]


def method_names(incomplete: str) -> list[str]:
    """Names of integrators that begin so, for completion in a shell."""
    return [name for name in INTEGRATORS if name.startswith(incomplete)]


SystemFile = Annotated[
    str, argument("SYSTEM.toml", "A system file, or the name of a shipped system.", autocompletion=system_names)
]
Subject = Annotated[
    str,
    argument(
        "SYSTEM",
        "A system file, the name of a shipped system, the .h5md of a run, whose last frame is the start, or a Python "
        "file, which is run: it defines f and y0, or a System.",
        autocompletion=system_names,
    ),
]


def _alone(path: Path | None) -> Path | None:
    """Keep standard output for the JSON object, if the object goes there."""
    if path == STDOUT:
        results_on_stderr()
    return path


Hosts = Annotated[
    Path | None, option("FILE", "Machines for the processes: lines of NAME or NAME:COUNT, as mpiexec takes them.")
]
Json = Annotated[
    Path | None,
    option(
        "FILE", "Write the results as one JSON object; - is standard output, which then holds nothing else.", "--json",
        callback=_alone,
    ),
]  # fmt: skip
Frame = Annotated[
    int | None, option("K", "Frame of a run's file, counted from 0, or from -1 backwards (default: the last one).")
]
ForceField = Annotated[
    list[str] | None,
    option("FILE", "File of a force field for a .pdb, .psf or .top, which OpenMM reads. Repeatable.", "--force-field"),
]
Cutoff = Annotated[
    Any,
    option(
        "X",
        "Cutoff of pairs for a file of a force field (default 1 nm).",
        parser=amount("a length such as '9 angstrom'"),
    ),
]
Rigid = Annotated[
    str | None, option("NAME", "Rigid bonds for a file of a force field: hydrogen (default), water, none.")
]
Overwrite = Annotated[bool, typer.Option("--overwrite", help="Replace files that kickdrift wrote.")]
Threads = Annotated[int, option("K", "Threads; they do not change the results.", min=1)]


def _quietly(quiet: bool) -> bool:
    if quiet:
        hush()
    return quiet


Quiet = Annotated[bool, typer.Option("--quiet", callback=_quietly, help="Print only errors on standard error.")]
Flush = Annotated[
    float | None, option("SECONDS", "Seconds between writes to disk; a kill loses at most this much (default 10).")
]

_FILE_FLAGS: dict[str, Any] = {
    "coordinates": Annotated[
        str | None, option("FILE", "The file of coordinates of a .prmtop, .parm7, .top or .psf.", "--coordinates")
    ],
    "force_field": ForceField,
    "cutoff": Cutoff,
    "rigid": Rigid,
}  # fmt: skip


def with_files(command: Callable[..., None]) -> Callable[..., None]:
    """Decorator of a command: flags for files of force fields, whose values come as one dict in the command's parameter
    ``files``, for `subject_of`."""

    @wraps(command)
    def wrapped(**given: Any) -> None:
        files = {name: given.pop(name) for name in _FILE_FLAGS}
        command(**given, files=files | {"force_field": files["force_field"] or None})

    parameters: list[inspect.Parameter] = []
    for each in inspect.signature(command, eval_str=True).parameters.values():
        if each.name == "files":
            parameters += [_parameter(name, annotation) for name, annotation in _FILE_FLAGS.items()]
        else:
            parameters.append(each)
    wrapped.__signature__ = inspect.Signature(parameters)  # type: ignore[attr-defined]
    wrapped.__annotations__ = {each.name: each.annotation for each in parameters}
    return wrapped


_METAVARS = {float: "X", int: "N", str: "NAME"}
_FILES = {"coordinates": " Or the file of coordinates of a .prmtop, .parm7, .top or .psf."}
_FEW = 3  # most methods that a flag's help names
_PAIRS: Any = Annotated[
    list[str] | None,
    option("KEY=VALUE", "An option of the integrator; see: kickdrift list integrators NAME. Repeatable.", "-o"),
]


def with_options(*flags: str) -> Callable[[Callable[..., None]], Callable[..., None]]:
    """Decorator of a command: ``-o KEY=VALUE`` for every option of integrators, and flags for the named options. Their
    values come as one dict in the command's parameter ``options``."""

    def decorate(command: Callable[..., None]) -> Callable[..., None]:
        known = {DT.name: DT, **known_options()}

        @wraps(command)
        def wrapped(**given: Any) -> None:
            pairs, said = given.pop("o") or (), {name: _value(known[name], given.pop(name)) for name in flags}
            command(**given, options=parsed(pairs, said))

        parameters: list[inspect.Parameter] = []
        for each in inspect.signature(command, eval_str=True).parameters.values():
            if each.name == "options":
                parameters += [_parameter(name, _flag(known[name])) for name in flags]
                parameters.append(_parameter("o", _PAIRS))
            else:
                parameters.append(each)
        wrapped.__signature__ = inspect.Signature(parameters)  # type: ignore[attr-defined]
        wrapped.__annotations__ = {each.name: each.annotation for each in parameters}
        return wrapped

    return decorate


def _parameter(name: str, annotation: Any) -> inspect.Parameter:
    return inspect.Parameter(name, inspect.Parameter.POSITIONAL_OR_KEYWORD, default=None, annotation=annotation)


def _flag(one: Option) -> Any:
    """Flag of an option. The flag of precision has two names, like a switch."""
    if one.name == PRECISION.name:
        help_ = "Pairs in float32 and everything else in float64, or all in float64."
        return Annotated[bool | None, typer.Option(f"--{MIXED}/--{DOUBLE}", help=help_)]
    methods = takers(one.name)
    whose = f" ({', '.join(methods)})" if one is not DT and len(methods) <= _FEW else ""
    help_ = f"{one.help[:-1]}{f': {one.known}' if one.choices else ''}{whose}.{_FILES.get(one.name, '')}"
    if one.type is bool:
        return Annotated[bool | None, typer.Option(f"--{one.name}", help=help_)]
    several = "; X,X,… one for each unknown." if one.several else f"; {one.count} with commas." if one.count > 1 else ""
    return Annotated[str | None, option(_METAVARS[one.type], help_[:-1] + several if several else help_)]


def _value(one: Option, given: Any) -> Any:
    """Value of a flag. Raises an InputError that names the flag."""
    if one.name == PRECISION.name and given is not None:
        return MIXED if given else DOUBLE
    try:
        return one.parsed(given) if isinstance(given, str) else given
    except InputError as error:
        raise InputError(f"--{str(error).replace('_', '-', one.name.count('_'))}") from None

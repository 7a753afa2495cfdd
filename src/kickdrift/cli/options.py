"""Arguments and options of several commands."""

from __future__ import annotations

import inspect
from collections.abc import Callable
from functools import wraps
from pathlib import Path
from typing import Annotated, Any

import typer

from kickdrift.cli.console import hush, results_on_stderr
from kickdrift.disk.outputs import STDOUT
from kickdrift.errors import InputError
from kickdrift.integrators.asked import known_options, parsed, takers
from kickdrift.integrators.options import DOUBLE, DT, MIXED, PRECISION, Option


def system_names(incomplete: str) -> list[str]:
    """Names of shipped systems that begin so, for completion in a shell; without any, the shell completes files."""
    from kickdrift.systemfile.files import shipped

    return [name for name in shipped() if name.startswith(incomplete)]


def method_names(incomplete: str) -> list[str]:
    """Names of integrators that begin so, for completion in a shell."""
    from kickdrift.integrators import INTEGRATORS

    return [name for name in INTEGRATORS if name.startswith(incomplete)]


SystemArgument = Annotated[
    str,
    typer.Argument(
        metavar="SYSTEM.toml", help="A system file, or the name of a shipped system.", autocompletion=system_names
    ),
]
SubjectArgument = Annotated[
    str,
    typer.Argument(
        metavar="SYSTEM",
        help="A system file, the name of a shipped system, or a Python file, which is run: "
        "it defines f and y0, or a System.",
        autocompletion=system_names,
    ),
]


def _alone(path: Path | None) -> Path | None:
    """Keep standard output for the JSON object, if the object goes there."""
    if path == STDOUT:
        results_on_stderr()
    return path


HostsOption = Annotated[
    Path | None,
    typer.Option(
        metavar="FILE", help="Machines for the processes: lines of NAME or NAME:COUNT, as mpiexec takes them."
    ),
]
JsonOption = Annotated[
    Path | None,
    typer.Option(
        "--json", metavar="FILE", callback=_alone,
        help="Write the results as one JSON object; - is standard output, which then holds nothing else.",
    ),
]  # fmt: skip
OverwriteOption = Annotated[bool, typer.Option("--overwrite", help="Replace files that kickdrift wrote.")]
ThreadsOption = Annotated[int, typer.Option(metavar="K", min=1, help="Threads; they do not change the results.")]


def _quietly(quiet: bool) -> bool:
    """Tell the console."""
    if quiet:
        hush()
    return quiet


QuietOption = Annotated[bool, typer.Option("--quiet", callback=_quietly, help="Print only errors on standard error.")]
FlushOption = Annotated[
    float | None,
    typer.Option(
        metavar="SECONDS", help="Seconds between writes to disk; a kill loses at most this much (default 10)."
    ),
]

_METAVARS = {float: "X", int: "N", str: "NAME"}
_FEW = 3  # most methods that a flag's help names
_PAIRS: Any = Annotated[
    list[str] | None,
    typer.Option(
        "-o", metavar="KEY=VALUE", help="An option of the integrator; see: kickdrift list integrators NAME. Repeatable."
    ),
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


def _flag(option: Option) -> Any:
    """Flag of an option. The flag of precision has two names, like a switch."""
    if option.name == PRECISION.name:
        help_ = "Pairs in float32 and everything else in float64, or all in float64."
        return Annotated[bool | None, typer.Option(f"--{MIXED}/--{DOUBLE}", help=help_)]
    methods = takers(option.name)
    whose = f" ({', '.join(methods)})" if option is not DT and len(methods) <= _FEW else ""
    help_ = f"{option.help[:-1]}{f': {option.known}' if option.choices else ''}{whose}."
    if option.type is bool:
        return Annotated[bool | None, typer.Option(f"--{option.name}", help=help_)]
    several = "; X,X,… one for each unknown." if option.several else ""
    return Annotated[
        str | None, typer.Option(metavar=_METAVARS[option.type], help=help_[:-1] + several if several else help_)
    ]


def _value(option: Option, given: Any) -> Any:
    """Value of a flag. Raises an InputError that names the flag."""
    if option.name == PRECISION.name and given is not None:
        return MIXED if given else DOUBLE
    try:
        return option.parsed(given) if isinstance(given, str) else given
    except InputError as error:
        raise InputError(f"--{str(error).replace('_', '-', option.name.count('_'))}") from None

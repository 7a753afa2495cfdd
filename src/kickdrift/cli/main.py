"""The command line: parse, call one function, print. Results go to standard output, the rest to standard error."""

from __future__ import annotations

import errno
import os
import re
import sys
import warnings
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import wraps
from pathlib import Path
from typing import Annotated, Any

import typer

from kickdrift.cli.benchmarks import bench_compile, bench_lammps, bench_lj_energy, bench_speed, validate
from kickdrift.cli.console import open_streams, out, say, stopped_at
from kickdrift.cli.drawing import movie, page, plot, view
from kickdrift.cli.ensemble import ensemble
from kickdrift.cli.files import cite, doctor, export, info, list_, new, schema, show
from kickdrift.cli.help import Command, Group
from kickdrift.cli.measuring import analyze, certify, chaos, cluster, compare, compare_engines, transits
from kickdrift.cli.options import option
from kickdrift.cli.running import relax, resume, run
from kickdrift.cli.watching import INTERRUPTED, Interrupted
from kickdrift.disk.foreign import is_lammps_input
from kickdrift.disk.interrupt import heard_everywhere
from kickdrift.disk.outputs import reason
from kickdrift.errors import KickdriftError
from kickdrift.jit.cache.notices import heard
from kickdrift.model.checks.arguments import other_name

_INVALID = re.compile(r"Invalid value for '(?P<name>[^']*)': (?:Value error, )?(?P<text>.*)")
_WORDS = (
    (r", unable to parse string as an? \w+", ""),
    (r"Input should be a valid integer", "expected a whole number"),
    (r"Input should be a valid number", "expected a number"),
    (r"Input should be greater than or equal to (\S+)", r"expected \1 or more"),
    (r"Input should be less than or equal to (\S+)", r"expected \1 or less"),
    (r"Input should be", "expected"),
    (r"(.*) is not one of (.*)", r"expected one of \2, got \1"),
)


def plain(text: str) -> str:
    """Return a parser's message as "option: what it expects"."""
    text = " ".join(text.split()).rstrip(".")
    found = _INVALID.match(text)
    if not found:
        return text
    words = found["text"]
    for pattern, ours in _WORDS:
        words = re.sub(pattern, ours, words)
    return f"{found['name']}: {words}"


@contextmanager
def compilation_said(quiet: bool) -> Iterator[None]:
    """Say on standard error what is compiled in this context, once for each purpose."""
    said: set[str] = set()

    def hear(purpose: str, kept: bool) -> None:
        line = f"compiling{f' {purpose}' if purpose else ''}{' (once on this machine)' if kept else ''}"
        if line not in said:
            said.add(line)
            say(line, quiet)

    with heard(hear):
        yield


def telling(command: Callable[..., None]) -> Callable[..., None]:
    """Decorator of a command: the command says what it compiles, unless it has ``--quiet``."""

    @wraps(command)
    def told(**given: Any) -> None:
        with compilation_said(bool(given.get("quiet"))):
            command(**given)

    return told


COMMANDS = (  # in the order of --help
    new, run, resume, relax, ensemble, compare, compare_engines, chaos, transits, certify, analyze, cluster, plot, view,
    page, movie, export, info, show, schema, cite, validate, doctor,
)  # fmt: skip

app = typer.Typer(
    name="kickdrift",
    cls=Group,
    help="Molecular dynamics and N-body simulation in which you choose and measure the integrator.",
    add_completion=True,
    pretty_exceptions_enable=False,
    context_settings={"help_option_names": ["-h", "--help"]},
)
bench_app = typer.Typer(cls=Group, help="Measure energy errors and speeds.")
app.add_typer(bench_app, name="bench")

BAD_NAMES = (errno.ENAMETOOLONG, errno.ELOOP, errno.EILSEQ, errno.ENOTDIR, errno.EISDIR, errno.ENOENT)
TRACEBACK = "KICKDRIFT_TRACEBACK"  # the environment variable that shows the source of a bug

for command in COMMANDS:
    app.command(cls=Command)(telling(command))
app.command("list", cls=Command)(list_)
bench_app.command("lj-energy", cls=Command)(telling(bench_lj_energy))
bench_app.command("speed", cls=Command)(telling(bench_speed))
bench_app.command("lammps", cls=Command)(telling(bench_lammps))
bench_app.command("compile", cls=Command)(telling(bench_compile))


def _version(asked: bool) -> None:
    if asked:
        from importlib.metadata import version

        out(f"kickdrift {version('kickdrift')}")
        raise typer.Exit


@app.callback()
def options(
    load: Annotated[
        list[Path] | None,
        option(
            "FILE.py",
            "First load a Python file that registers methods or forces, or a module of calculators "
            "(ase.calculators.emt) that files may name. An input of LAMMPS named here may run commands.",
            "--load",
            envvar="KICKDRIFT_LOAD",
        ),
    ] = None,
    version: Annotated[
        bool, typer.Option("--version", is_eager=True, callback=_version, help="Print the version and exit.")
    ] = False,
) -> None:
    """Options before the command."""
    from kickdrift.integrators.own.registration import load_code

    for path in load or []:
        if is_lammps_input(path):
            from kickdrift.bridges.lammps.script import TRUSTED

            TRUSTED.add(path.resolve())
        else:
            load_code(path)


def main() -> None:
    """The program: exit status 0 done, 1 the run failed, 2 bad input, 130 Ctrl-C."""
    told = False  # what Ctrl-C left behind
    usage_error: Any = typer.BadParameter.__base__  # from click, or from typer's own copy of click
    try:
        open_streams()
        with heard_everywhere() as pressed, warnings.catch_warnings():
            warnings.showwarning = _say_warning  # type: ignore[assignment]
            try:
                status = app(prog_name="kickdrift", standalone_mode=False)
            except Exception as error:
                if pressed() and not isinstance(error, Interrupted):  # an import may say that a package is missing
                    raise KeyboardInterrupt from error
                raise
    except KickdriftError as error:
        say(f"kickdrift: {error}")
        status, told = error.exit_status, isinstance(error, Interrupted)
    except usage_error as error:
        if text := plain(error.format_message()):  # empty without arguments, when help was shown
            command = error.ctx.command_path if error.ctx else "kickdrift"
            hint = other_name("option", str(getattr(error, "option_name", "")).lstrip("-"))
            say(f"kickdrift: {text}{hint} (see {command} --help)")
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
    if status == INTERRUPTED and not told:  # typer turns a KeyboardInterrupt into an exit
        say(f"kickdrift: {stopped_at()}")
    written = everything_written(quiet=bool(status))
    sys.exit(status or written)


def _say_warning(message: Warning | str, *where: Any) -> None:
    """Print a Python warning as one line, without the place in the code."""
    say(f"warning: {message}")


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

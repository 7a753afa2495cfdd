"""``kickdrift ensemble``: parse, run, print."""

from __future__ import annotations

import shlex
import sys
from pathlib import Path
from typing import Annotated, Any

import typer

from kickdrift.cli.amounts import length, whole
from kickdrift.cli.console import members_bar, say
from kickdrift.cli.interruption import Interrupted
from kickdrift.cli.options import QuietOption, SystemArgument, with_options
from kickdrift.disk.files import unfit
from kickdrift.errors import InputError, RunError
from kickdrift.text import counted

MEASURE = "measure"  # module name of a file with a measure


@with_options("dt")
def ensemble(
    system: SystemArgument,
    vary: Annotated[
        list[str] | None,
        typer.Option(
            metavar="KEY=VALUES",
            help="A key of the file, or dt, integrator …, and its values: START:STOP:COUNT, log:START:STOP:COUNT, "
            "A,B,C, uniform:LOW:HIGH, normal:MEAN:DEVIATION or log-uniform:LOW:HIGH; one value holds for all members. "
            "Repeat for a grid of several keys.",
        ),
    ] = None,
    replicas: Annotated[
        int, typer.Option(metavar="N", min=1, help="Members per combination, each with its own seed.")
    ] = 1,
    seed: Annotated[int, typer.Option(metavar="S", min=0, help="Root of all seeds.")] = 0,
    measure: Annotated[
        str, typer.Option(metavar="NAME", help="run (default), megno, or FILE.py:FUNCTION, called with the Simulation.")
    ] = "run",
    integrator: Annotated[str | None, typer.Option(metavar="NAME", help="See: kickdrift list integrators.")] = None,
    options: Any = None,
    steps: Annotated[
        int | None, typer.Option(metavar="N", parser=whole(1), help="Steps of each member, such as 1e6.")
    ] = None,
    time: Annotated[
        Any, typer.Option(metavar="T", parser=length, help="Time of each member, such as '5 ps', instead of --steps.")
    ] = None,
    every: Annotated[int | None, typer.Option(metavar="K", parser=whole(1), help="Steps between samples.")] = None,
    workers: Annotated[
        int | None, typer.Option(metavar="K", min=1, help="Processes on this machine (default: one for each core).")
    ] = None,
    scheduler: Annotated[
        str | None,
        typer.Option(metavar="ADDRESS", help="Dask scheduler, such as tcp://host:8786, instead of workers here."),
    ] = None,
    output: Annotated[
        Path | None,
        typer.Option(metavar="FILE", help="The table, .parquet or .h5; the same command continues an interrupted one."),
    ] = None,
    overwrite: Annotated[bool, typer.Option("--overwrite", help="Replace the table of another ensemble.")] = False,
    trajectories: Annotated[
        Path | None, typer.Option(metavar="FOLDER", help="Write a .h5md file for each member, .h5 for an ODE.")
    ] = None,
    quiet: QuietOption = False,
) -> None:
    """Run a system many times, with varied values and separate seeds, on all cores or on a Dask cluster."""
    from kickdrift.cli.printing_ensemble import print_ensemble
    from kickdrift.ensemble import Ensemble
    from kickdrift.ensemble.running import workers as dask_workers
    from kickdrift.ensemble.table import journal_of

    if scheduler is not None and workers is not None:
        raise InputError("give --workers or --scheduler, not both: a cluster has its own workers")
    planned = Ensemble(
        system, _varied(vary or []), replicas=replicas, seed=seed, measure=_measure(measure), integrator=integrator,
        steps=steps, time=time, every=every, **options,
    )  # fmt: skip
    where: dict[str, Any] = {"output": output, "overwrite": overwrite, "trajectories": trajectories}
    done = -1
    with members_bar(quiet) as bar:

        def progress(now: int, of: int, failed: int) -> None:
            nonlocal done
            if done < 0 and now:
                say(f"{output}: {now} of {counted(of, 'member')} are already done", quiet)
            done = now
            if bar:
                bar(now, of, failed)

        try:
            if scheduler is None:
                table = planned.run(workers=workers, progress=progress, **where)
            else:
                with dask_workers(scheduler=scheduler) as client:
                    if not client.nthreads():
                        say(f"{scheduler}: no workers yet; waiting", quiet)
                    table = planned.run(client, progress=progress, **where)
        except (KeyboardInterrupt, RunError) as error:
            journal = output and journal_of(output)
            if journal and journal.exists():
                again = shlex.join(["kickdrift", *(each for each in sys.argv[1:] if each != "--overwrite")])
                kept = f"{journal} holds {max(done, 0)} of {counted(len(planned), 'member')}; continue with: {again}"
                if isinstance(error, KeyboardInterrupt):
                    raise Interrupted(f"stopped; {kept}") from None
                say(kept)
            elif isinstance(error, KeyboardInterrupt):
                why = "no member is done" if output else "nothing is kept; --output FILE.parquet keeps members"
                raise Interrupted(f"stopped; {why}") from None
            raise
    print_ensemble(table, output)
    if not (table["status"] == "done").any():
        raise typer.Exit(1)


def _varied(given: list[str]) -> dict[str, str]:
    """Parse KEY=VALUES into a dict."""
    found: dict[str, str] = {}
    for text in given:
        key, equals, values = text.partition("=")
        if not (equals and key.strip() and values.strip()):
            raise InputError(f"--vary: expected KEY=VALUES, such as dt=0.001:0.01:10, got {text!r}")
        if key.strip() in found:
            raise InputError(f"--vary: {key.strip()} is given twice")
        found[key.strip()] = values.strip()
    return found


def _measure(text: str) -> Any:
    """Parse --measure: a name, or a function in a file."""
    path, colon, name = text.rpartition(":")
    if not colon:
        if text not in ("run", "megno"):
            raise InputError(f"--measure {text}: expected run, megno or FILE.py:FUNCTION")
        return text
    if not path.endswith(".py") or (why := unfit(path)):
        raise InputError(
            f"--measure {text}: there is no Python file {path}" + (f": {why}" if path.endswith(".py") else "")
        )
    from runpy import run_path

    try:
        found = run_path(path, run_name=MEASURE)
    except (Exception, SystemExit) as error:
        raise InputError(f"--measure {text}: {type(error).__name__}: {' '.join(str(error).split())}") from error
    function = found.get(name)
    if not callable(function):
        raise InputError(f"--measure {text}: {path} has no function {name!r}")
    for each in found.values():
        if getattr(each, "__module__", None) == MEASURE:
            each.__module__ = "__main__"  # so that workers get it by value
    return function

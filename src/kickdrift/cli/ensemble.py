"""The command ``ensemble``."""

from __future__ import annotations

import math
import shlex
import sys
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

import kickdrift as kd
from kickdrift.cli.console import members_bar, print_lines, print_table, say
from kickdrift.cli.options import Quiet, SystemFile, length, option, whole, with_options
from kickdrift.cli.watching import Interrupted
from kickdrift.disk.files import unfit
from kickdrift.errors import InputError, RunError
from kickdrift.text import counted, with_error

if TYPE_CHECKING:
    from pandas import DataFrame

MEASURE = "measure"  # module name of a file with a measure


@with_options("dt")
def ensemble(
    system: SystemFile,
    vary: Annotated[
        list[str] | None,
        option(
            "KEY=VALUES",
            "A key of the file, or dt, integrator …, and its values: START:STOP:COUNT, log:START:STOP:COUNT, "
            "A,B,C, uniform:LOW:HIGH, normal:MEAN:DEVIATION or log-uniform:LOW:HIGH; one value holds for all members. "
            "Repeat for a grid of several keys.",
        ),
    ] = None,
    replicas: Annotated[int, option("N", "Members per combination, each with its own seed.", min=1)] = 1,
    seed: Annotated[int, option("S", "Root of all seeds.", min=0)] = 0,
    measure: Annotated[
        str, option("NAME", "run (default), megno, or FILE.py:FUNCTION, called with the Simulation.")
    ] = "run",
    integrator: Annotated[str | None, option("NAME", "See: kickdrift list integrators.")] = None,
    options: Any = None,
    steps: Annotated[int | None, option("N", "Steps of each member, such as 1e6.", parser=whole(1))] = None,
    time: Annotated[Any, option("T", "Time of each member, such as '5 ps', instead of --steps.", parser=length)] = None,
    every: Annotated[int | None, option("K", "Steps between samples.", parser=whole(1))] = None,
    workers: Annotated[
        int | None, option("K", "Processes on this machine (default: one for each core).", min=1)
    ] = None,
    scheduler: Annotated[
        str | None, option("ADDRESS", "Dask scheduler, such as tcp://host:8786, instead of workers here.")
    ] = None,
    output: Annotated[
        Path | None, option("FILE", "The table, .parquet or .h5; the same command continues an interrupted one.")
    ] = None,
    overwrite: Annotated[bool, typer.Option("--overwrite", help="Replace the table of another ensemble.")] = False,
    trajectories: Annotated[
        Path | None, option("FOLDER", "Write a .h5md file for each member, .h5 for an ODE.")
    ] = None,
    quiet: Quiet = False,
) -> None:
    """Run a system many times, with varied values and separate seeds, on all cores or on a Dask cluster."""
    from kickdrift.ensemble.running import workers as dask_workers
    from kickdrift.ensemble.table import journal_of

    if scheduler is not None and workers is not None:
        raise InputError("give --workers or --scheduler, not both: a cluster has its own workers")
    planned = kd.Ensemble(
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


ROWS = 24  # largest grid whose points are listed one by one
ERRORS = 3  # most failures that are printed one by one


def print_ensemble(table: DataFrame, output: Path | None) -> None:
    """Print a table's summary on standard output, and its failures on standard error."""
    from kickdrift.ensemble import summary
    from kickdrift.ensemble.rows import DONE, STOPPED_BY
    from kickdrift.ensemble.table import PROVENANCE

    came_from = table.attrs[PROVENANCE]
    counts = table["status"].value_counts()
    grids = {key: "" if len(values) > 1 else f" = {values[0]}" for key, values in came_from["grids"].items()}
    varied = [*(f"{key}{one}" for key, one in grids.items()), *(f"{key} (random)" for key in summary.drawn(table))]
    lines = [
        ("ensemble", f"{came_from['system']}: {counted(len(table), 'member')}, root seed {came_from['seed']}"),
        ("varied", ", ".join(varied) or "only seeds"),
        ("members", ", ".join(f"{count:,} {status}" for status, count in counts.items())),
    ]
    done = table[table["status"] == DONE]
    if "verdict" in table:
        lines.append(
            ("verdicts", ", ".join(f"{n:,} {verdict}" for verdict, n in done["verdict"].value_counts().items()))
        )
    if STOPPED_BY in table and (done[STOPPED_BY] != "").any():
        ends = done[STOPPED_BY].replace("", "no event").value_counts()
        lines.append(("ended by", ", ".join(f"{n:,} {kind}" for kind, n in ends.items())))
    if output:
        lines.append(("table", str(output)))
    print_lines(lines)
    if len(done):
        _print_measured(table)
    for row in table[table["status"] != DONE].head(ERRORS).to_dict("records"):
        say(f"member {row['member']}: {row['error']}")
    if warned := [row for row in done.to_dict("records") if row.get("warnings")]:
        say(f"{counted(len(warned), 'member')} warned; member {warned[0]['member']}: {warned[0]['warnings']}")
    if len(table) - len(done) > ERRORS:
        say(f"and {len(table) - len(done) - ERRORS} more")


def _print_measured(table: DataFrame) -> None:
    """Print means with standard errors: of each quantity, or of the most telling ones at each point of a small grid."""
    from kickdrift.ensemble import summary
    from kickdrift.ensemble.rows import DONE

    if not summary.measured(table):
        return
    done = table[table["status"] == DONE]
    keys = summary.grids(table)
    if keys:
        columns = summary.scanned(table)
        points = [summary.by_point(table, column).to_dict("records") for column in columns]
        if len(points[0]) <= ROWS:
            rows = [
                [
                    *(_text(one[0][key]) for key in keys),
                    *(with_error(each["mean"], each["error"]) for each in one),
                    str(one[0]["members"]),
                ]
                for one in zip(*points, strict=True)
            ]
            title = f"{columns[0]}, mean ± standard error" if len(columns) == 1 else "means ± standard errors"
            heads = ["mean"] if len(columns) == 1 else columns
            print_table(title, [*keys, *heads, "members"], rows)
            return
    rows = []
    for name in summary.measured(table):
        found = summary.moments(done[name])
        if found["members"]:
            known = done[name][done[name].abs() < math.inf]
            ends = known.min(), known.max()
            rows.append([name, with_error(found["mean"], found["error"]), *(f"{end:.6g}" for end in ends)])
    print_table(None, ["quantity", "mean ± standard error", "smallest", "largest"], rows)


def _text(value: object) -> str:
    return f"{value:.6g}" if isinstance(value, float) else str(value)

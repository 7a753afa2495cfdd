"""Contents of the file of a Problem's run, as a dictionary and as text."""

from __future__ import annotations

from typing import Any

from kickdrift.text import shown
from kickdrift.trajectory.problems.reader import ProblemRun
from kickdrift.trajectory.problems.table import ProblemTable
from kickdrift.trajectory.read.info import laid_out, method_rows, shared_content, short, with_end

MOST = 8  # numbers of y that are shown


def info(run: ProblemRun) -> dict[str, Any]:
    """The content of the file in numbers."""
    record = run.problem_record
    return shared_content(run) | {
        "problem": run.name,
        "equation": record.get("equation", ""),
        "parameters": record.get("parameters", {}),
        "unknowns": len(run.y0),
        "separable": run.separable,
        "units": {"time": ""},
        "frames": 0,
    }


def describe(run: ProblemRun) -> str:
    """Results of `info`, for a reader."""
    found = info(run)
    given = ", ".join(f"{key} = {short(value)}" for key, value in found["parameters"].items())
    equation = f"{found['equation']}{': ' * bool(given)}{given}" if found["equation"] else "made in Python"
    rows = [
        ("problem", f"{found['problem']}, {found['unknowns']} unknowns"),
        ("equation", shown(equation)[1:-1]),
        *method_rows(found["method"]),
        ("samples", f"{found['samples']:,} of y"),
    ]
    if found["time"]:
        first, last = found["time"]
        rows.append(("time", f"{first:g} to {last:g}, steps {found['steps'][0]} to {found['steps'][1]}"))
    rows += [(name, f"{_short(ends['first'])} → {_short(ends['last'])}") for name, ends in found["observables"].items()]
    return laid_out(found, with_end(found, rows))


def describe_any(run: ProblemRun | ProblemTable) -> str:
    """Contents of a Problem's run or table, for a reader."""
    return describe(run) if isinstance(run, ProblemRun) else describe_table(run)


def describe_table(table: ProblemTable) -> str:
    """Contents of the table of a Problem's run, for a reader."""
    return "\n".join([str(table.path), *(f"  {key:<10}  {value}" for key, value in table_rows(table))])


def table_rows(table: ProblemTable) -> list[tuple[str, str]]:
    """The same in lines of key and text."""
    rows = [("problem", table.name), ("unknowns", str(table.y.shape[1])), ("rows", f"{len(table):,}")]
    rows += [(key, short(table.method[key])) for key in ("integrator", "dt") if table.method.get(key) is not None]
    if len(table):
        rows.append(("time", f"{table.times[0]:g} to {table.times[-1]:g}"))
        rows += [(name, f"{values[0]:.8g} → {values[-1]:.8g}") for name, values in table.series().items()][1:]
    return [(key, value) for key, value in rows if value]


def _short(value: Any) -> str:
    """A value as text; of a long list its first numbers."""
    long = isinstance(value, list) and len(value) > MOST
    return f"{short(value[:MOST])[:-1]}, …)" if long else short(value)

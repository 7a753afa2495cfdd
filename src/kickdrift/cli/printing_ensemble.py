"""Output of the command line for an ensemble."""

from __future__ import annotations

import math
from pathlib import Path
from typing import TYPE_CHECKING

from kickdrift.cli.console import print_lines, print_table, say
from kickdrift.ensemble import summary
from kickdrift.ensemble.rows import DONE, STOPPED_BY
from kickdrift.ensemble.table import PROVENANCE
from kickdrift.text import counted, with_error

if TYPE_CHECKING:
    from pandas import DataFrame

ROWS = 24  # largest grid whose points are listed one by one
ERRORS = 3  # most failures that are printed one by one


def print_ensemble(table: DataFrame, output: Path | None) -> None:
    """Print a table's summary on standard output, and its failures on standard error."""
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
    """Print means with standard errors: of each quantity, or of the most informative one at each point of a small
    grid."""
    if not summary.measured(table):
        return
    done = table[table["status"] == DONE]
    keys = summary.grids(table)
    if keys:
        column = summary.chosen(table)
        points = summary.by_point(table, column)
        if len(points) <= ROWS:
            rows = [
                [
                    *(_text(point[key]) for key in keys),
                    with_error(point["mean"], point["error"]),
                    str(point["members"]),
                ]
                for point in points.to_dict("records")
            ]
            print_table(f"{column}, mean ± standard error", [*keys, "mean", "members"], rows)
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

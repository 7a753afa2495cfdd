"""Output of the command line for runs, systems and lists, on standard output."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Any

from kickdrift.cli.console import members_bar as members_bar
from kickdrift.cli.console import out, print_lines
from kickdrift.cli.console import print_table as print_table
from kickdrift.cli.console import progress_bar as progress_bar
from kickdrift.cli.console import say as say
from kickdrift.disk.outputs import write_json
from kickdrift.display.showing import lines_of, tables_of
from kickdrift.looks.report_lines import drift_text
from kickdrift.text import duration

if TYPE_CHECKING:
    from kickdrift.model.problem import Problem
    from kickdrift.model.system import System


def show_found(found: Any, json_file: Path | None, overwrite: bool) -> None:
    """Print the tables and lines of a result, and write the result as JSON if a file is given."""
    for title, columns, rows in tables_of(found):
        print_table(title, columns, rows)
    print_lines(lines_of(found))
    write_json(json_file, found.as_json(), overwrite=overwrite)


def print_stability(names: Sequence[str]) -> None:
    """Print the longest stable step of each method, from its coefficients."""
    from kickdrift.integrators.asked import integrator
    from kickdrift.plots.stability import number

    columns = ["omega dt", "real lambda dt", "imaginary lambda dt"]
    chosen = dict.fromkeys(integrator(integrator(name).method.name) for name in names)
    limits = [(each.name, each.stability) for each in chosen]
    rows = [[name, *(number(found[key]) if key in found else "" for key in columns)] for name, found in limits]
    print_table(None, ["method", *columns], rows)


def print_benchmark(rows: list[Any], particles: int, seconds: float) -> None:
    """Print the benchmark's two tables on standard output."""
    titles = {
        "same step": "Equal step",
        "same cost": "Equal cost: 1000 force evaluations per unit of time",
    }
    columns = ["method", "dt", "RMS error", "largest", "drift per unit time", "steps/s", "verdict"]
    for table, title in titles.items():
        body = []
        for row in rows:
            if row.table == table and row.report:
                e = row.report.energy
                body.append(
                    [
                        row.method,
                        f"{row.dt:g}",
                        f"{100 * e.rms_relative_error:.2g} %",
                        f"{100 * e.max_relative_error:.2g} %",
                        drift_text(asdict(e)) or "–",
                        f"{row.report.steps_per_second:,.0f}",
                        e.verdict,
                    ]
                )
            elif row.table == table:
                body.append([row.method, f"{row.dt:g}", "–", "–", "–", "–", row.failure])
        print_table(title, columns, body)
    out(
        f"{particles:,} particles, errors relative to |E(0)|; velocity-verlet is leapfrog in its kick-drift-kick form. "
        f"Time: {duration(seconds)}."
    )


def print_claims(rows: list[Any], claimed: dict[str, str]) -> None:
    """Print the literature's claims on the full benchmark beside the measured values, on standard output."""
    body = []
    for row in rows:
        if row.method in claimed:
            e = row.report.energy if row.report else None
            measured = f"{100 * e.rms_relative_error:.2g} %, {e.verdict}" if e else str(row.failure)
            body.append([row.method, f"{row.dt:g}", claimed[row.method], measured])
    print_table("RMS energy error over 10^6 steps", ["method", "dt", "claimed in the literature", "measured"], body)


def print_system(system: System | Problem) -> None:
    """Print the content of a checked system file."""
    (key, name), *rest = lines_of(system)
    print_lines([(key, f"{name}: valid"), *rest])

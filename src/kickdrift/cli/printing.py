"""Output of the command line for runs, systems and lists, on standard output."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from kickdrift.cli.console import members_bar as members_bar
from kickdrift.cli.console import out, print_lines
from kickdrift.cli.console import print_table as print_table
from kickdrift.cli.console import progress_bar as progress_bar
from kickdrift.cli.console import say as say
from kickdrift.model.unit_systems import symbol_of
from kickdrift.text import counted, duration, measured

if TYPE_CHECKING:
    from kickdrift.analysis.chaos_report import ChaosReport
    from kickdrift.model.problem import Problem
    from kickdrift.model.system import System
    from kickdrift.run.report import EnergyReport, Report
    from kickdrift.run.simulation import Simulation


def list_integrators() -> tuple[list[str], list[list[str]]]:
    """Table of every integrator and its properties."""
    from kickdrift.integrators import INTEGRATORS

    yes = {True: "yes", False: "no"}
    columns = ["name", "family", "order", "evaluations", "symplectic", "reversible", "adaptive", "use"]
    rows = [
        [
            name,
            method.family,
            str(method.order),
            str(method.evaluations or "varies"),
            yes[method.symplectic],
            yes[method.reversible],
            yes[method.chooses_steps],
            method.use if name == method.name else f"the same as {method.name}",
        ]
        for name, method in INTEGRATORS.items()
    ]
    return columns, rows


def print_stability(names: Sequence[str]) -> None:
    """Print the longest stable step of each method, from its coefficients."""
    from kickdrift.integrators import integrator
    from kickdrift.integrators.splitting import Splitting
    from kickdrift.integrators.stability import imaginary_interval, real_interval, stability_interval
    from kickdrift.plots.stability import number

    rows = []
    for method in dict.fromkeys(integrator(name) for name in names):
        if isinstance(method, Splitting):
            rows.append([method.name, number(stability_interval(method)), "", ""])
        else:
            rows.append([method.name, "", number(real_interval(method)), number(imaginary_interval(method))])
    print_table(None, ["method", "omega dt", "real lambda dt", "imaginary lambda dt"], rows)


def list_forces() -> tuple[list[str], list[list[str]]]:
    """Table of every force and its parameters."""
    import inspect

    from kickdrift.forces import FORCES

    rows = [
        [name, ", ".join(inspect.signature(force).parameters), (force.__doc__ or "").split("\n")[0]]
        for name, force in FORCES.items()
    ]
    return ["name", "parameters", "description"], rows


def list_systems() -> tuple[list[str], list[list[str]]]:
    """Table of every shipped system file."""
    from kickdrift.systemfile.files import describe, shipped

    found = [describe(path) for path in shipped().values()]
    return ["name", "units", "title"], [[each.name, each.units, each.title] for each in found]


def list_engines() -> tuple[list[str], list[list[str]]]:
    """Table of every engine and its installed version."""
    from kickdrift.engines import ENGINES

    return ["name", "version", "runs"], [
        [name, each.version or f"not installed: {each.install}", each.runs] for name, each in ENGINES.items()
    ]


LISTINGS: dict[str, Callable[[], tuple[list[str], list[list[str]]]]] = {
    "integrators": list_integrators,
    "forces": list_forces,
    "systems": list_systems,
    "engines": list_engines,
}


def print_report(report: Report, sim: Simulation, output: Path | None) -> None:
    """Print a run's summary on standard output."""
    from kickdrift.model.event_log import event_lines
    from kickdrift.model.system import System

    system = sim.system
    units = system.units if isinstance(system, System) else None
    time_unit = measured("", units.symbol("time")) if units else ""
    if units:
        lines = [("system", f"{report.system}: {report.particles:,} particles, units {report.units}")]
    else:
        lines = [("problem", f"{report.system}: {counted(len(system), 'unknown')}")]
    chosen = {"dt": report.dt, "rtol": report.rtol, "atol": report.atol, **report.options}
    said = [
        f"{key} = {value:g}{time_unit * (key == 'dt')}" if isinstance(value, float) else f"{key} = {value}"
        for key, value in chosen.items()
        if value is not None
    ]
    if report.engine != "native":
        where = f" in {report.processes} processes" if report.processes > 1 else ""
        lines.append(("engine", f"{report.engine} {report.engine_version}{where}"))
    lines.append(("integrator", ", ".join([report.integrator, *said])))
    rejected = f" ({report.rejected_steps:,} rejected)" if report.rejected_steps else ""
    lines.append(("length", f"{report.steps:,} steps{rejected}, {report.time:g}{time_unit}"))
    if report.y is not None:
        lines.append(("y at the end", ", ".join(f"{value:.10g}" for value in report.y)))
    energy, unit = report.energy, measured("", units.symbol("energy")) if units else ""
    if energy is not None:
        errors = f"{energy.rms_relative_error:.2e} RMS, {energy.max_relative_error:.2e} largest"
        drift = drift_text(energy, f" per {time_unit.strip() or 'unit of time'}: {energy.verdict}")
        lines += [
            ("energy", f"{energy.initial:.8g} at the start, {energy.final:.8g}{unit} at the end"),
            ("energy error", f"{errors}, of {energy.relative_to}"),
            ("energy drift", drift or energy.verdict),
        ]
    if report.momentum_error is not None:
        lines.append(("momentum error", f"{report.momentum_error:.1e} of the sum of m |v|"))
    if report.angular_momentum_error is not None:
        lines.append(("angular momentum", f"error {report.angular_momentum_error:.1e} of the sum of m |x × v|"))
    if units and report.temperature is not None:
        lines.append(("temperature", f"{measured(f'{report.temperature:.5g}', units.symbol('temperature'))} (mean)"))
    if isinstance(system, System) and report.pressure is not None:
        force_over = symbol_of(f"{system.units.energy}/{system.units.length}^{system.dimensions}")
        lines.append(("pressure", f"{measured(f'{report.pressure:.5g}', force_over)} (mean)"))
    shown = report.force_evaluations is not None and (not units or report.dt is None)
    evaluations = f"{report.force_evaluations:,} evaluations, " if shown else ""
    per_pair = f", {report.ns_per_pair:.1f} ns per pair" if report.ns_per_pair else ""
    where = counted(report.threads, "thread") if report.processes == 1 else f"{report.processes} processes"
    rate = report.steps_per_second
    speed = f"{rate:,.0f}" if rate >= 10 or not rate else f"{rate:.2g}"
    lines.append(("speed", f"{evaluations}{speed} steps/s on {where}{per_pair}"))
    if report.energy_taken is not None:
        lines.append(("energy taken", f"{report.energy_taken:.8g}{unit} by collisions and removed bodies"))
    if report.stopped:
        lines.append(("stopped", report.stopped))
    lines += event_lines(report.events)
    if output:
        lines.append(("written", str(output)))
    print_lines(lines)


def drift_text(energy: EnergyReport, ending: str = "") -> str:
    """Text of the slope, its interval and the ending; empty without a finite interval."""
    if not math.isfinite(energy.drift_error):
        return ""
    return f"{energy.drift_per_unit_time:+.1e} ± {energy.drift_error:.1e}{ending}"


def print_chaos(report: ChaosReport) -> None:
    """Print MEGNO and the Lyapunov exponent on standard output."""
    unit = symbol_of(report.time_unit)
    step = "" if report.dt is None else f", dt = {measured(f'{report.dt:g}', unit)}"
    lines = [
        ("system", report.system),
        ("integrator", report.integrator + step),
        ("length", f"{report.steps:,} steps, {measured(f'{report.time:g}', unit)}"),
        ("MEGNO", f"{report.megno:.4g}: {report.verdict} over this length"),
        ("Lyapunov", f"exponent {report.lyapunov:.2e} ± {report.lyapunov_error:.1e} per {unit or 'unit of time'}"),
        ("energy error", f"{report.energy_error:.2e} at the end"),
    ]
    print_lines(lines)


def print_benchmark(rows: list[Any], particles: int, seconds: float) -> None:
    """Print the benchmark's two tables on standard output."""
    titles = {
        "same step": "Equal step",
        "same cost": "Equal cost: 1000 force evaluations per unit of time",
    }
    columns = ["method", "dt", "RMS error", "largest", "drift per unit time", "verdict", "steps/s"]
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
                        drift_text(e) or "–",
                        e.verdict,
                        f"{row.report.steps_per_second:,.0f}",
                    ]
                )
            elif row.table == table:
                body.append([row.method, f"{row.dt:g}", "–", "–", "–", row.failure, "–"])
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
    from kickdrift.model.system import System

    lines = [("system", f"{system.name}: valid")]
    if isinstance(system, System):
        units = system.units
        lines += [
            ("particles", f"{len(system):,} ({', '.join(system.species)})"),
            ("box", system.box.described(units.symbol("length"))),
            *([("dimensions", "2")] if system.dimensions == 2 else []),
            ("units", f"{units.name}: {units.described(('length', 'time', 'mass', 'energy'))}"),
            *(("force", str(force)) for force in system.forces),
        ]
    else:
        about = [key for key in ("jacobian", "energy", "exact") if getattr(system, key)]
        lines += [
            ("problem", f"{counted(len(system), 'unknown')}, separable: {'yes' if system.separable else 'no'}"),
            ("y0", f"{', '.join(f'{value:.10g}' for value in system.y0)} at t = {system.t0:g}"),
            ("known", ", ".join(about) or "only f"),
        ]
    lines.append(("run", ", ".join(f"{key} = {value}" for key, value in system.run.said().items())))
    if isinstance(system, System) and system.equilibration:
        wanted = vars(system.equilibration).items()
        lines.append(("equilibrate", ", ".join(f"{key} = {value}" for key, value in wanted)))
    print_lines(lines)

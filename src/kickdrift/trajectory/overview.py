"""The report of a run from its file, in nine lines; the same for a run that is not finished, from its samples."""

import os
from collections.abc import Mapping
from typing import Any

import numpy as np

from kickdrift.display.showing import KEY
from kickdrift.errors import InputError
from kickdrift.integrators import INTEGRATORS
from kickdrift.integrators.method import Method
from kickdrift.integrators.options import mean_pressure, worth_saying
from kickdrift.looks.doubts import UNRELIABLE
from kickdrift.looks.report_lines import (
    charge_lines,
    energy_lines,
    energy_trend,
    mean_text,
    method_text,
    molecule_lines,
    pair_lines,
    tensor_lines,
    verdict_text,
)
from kickdrift.model.checks.values import unwarned
from kickdrift.model.state import Floats
from kickdrift.model.units.unit_systems import symbol_of
from kickdrift.statistics.drift import energy_error
from kickdrift.text import counted, measured
from kickdrift.trajectory.layout.problem_header import ENERGY, Y
from kickdrift.trajectory.problems.reader import MOST, ProblemRun, table_rows
from kickdrift.trajectory.problems.reader import info as info_of_problem
from kickdrift.trajectory.problems.table import ProblemTable
from kickdrift.trajectory.read.info import alarms, goal, info_of, room_lines, tie_lines, warnings_of
from kickdrift.trajectory.read.reader import Run, open
from kickdrift.trajectory.read.recorded import Samples

Lines = list[tuple[str, str]]
_CHOICES = ("dt", "rtol", "atol")
FITS = 80 - KEY - 1  # characters of a line


def overview(path: str | os.PathLike[str]) -> Lines:
    """Nine lines about the run in a file, and a line for everything that is wrong with the file.

    The report comes from the file. Without a report, because the run did not finish, the energies, momenta and means
    come from the file's samples. Raises InputError if the file is not a run's file.
    """
    with open(path) as run:
        return overview_of(run)


def overview_of(run: Run) -> Lines:
    """The same of an open file."""
    found, samples = info_of(run), run.whole_samples()
    report = run.report if isinstance(run.report, dict) else _so_far(run, samples)
    dimensions = run.system_record.get("dimensions", 3)
    units = {key: symbol_of(unit) for key, unit in found["units"].items() if isinstance(unit, str)}
    lines = [
        ("system", f"{found['system']}: {found['particles']:,} particles, units {found['units']['name']}"),
        ("integrator", _method(found["method"], report, units["time"])),
    ]
    if found["steps"]:
        (first, last), (begin, end) = found["steps"], found["time"]
        if isinstance(told := report.get("equilibrated"), str) and told:
            lines.append(("equilibrated", told))
        lines.append(("length", f"{counted(last - first, 'step', ',')}, {measured(f'{end - begin:g}', units['time'])}"))
    energy = report.get("energy")
    if isinstance(energy, dict) and found["time"]:
        heat, work = report.get("heat"), report.get("work")
        lines += energy_lines(
            energy, units["energy"], units["time"], found["time"][1] - found["time"][0],
            heat=heat if _is_number(heat) else None, work=work if _is_number(work) else None,
        )  # fmt: skip
    lines += _of_particles(found, report, units)
    lines += _momentum(report)
    lines += _means(report, units, dimensions)
    pairs = report.get("pairs")
    lines += pair_lines(pairs) if isinstance(pairs, Mapping) else []
    lines += [line for line in room_lines(found, units["length"]) if line[0] not in dict(lines)]
    lines.append(("frames", _state(found)))
    return lines + alarms(found)


def overview_of_problem(run: ProblemRun | ProblemTable) -> Lines:
    """The same of the file of a Problem's run, with y at the end, or of its table."""
    if isinstance(run, ProblemTable):
        return table_rows(run)
    found, samples = info_of_problem(run), run.whole_samples()
    report: dict[str, Any] = run.report if isinstance(run.report, dict) else {}
    lines = [
        ("problem", f"{found['problem']}: {counted(found['unknowns'], 'unknown')}"),
        ("integrator", _method(found["method"], report, "")),
    ]
    seen = samples.observables
    if found["steps"]:
        (first, last), (begin, end) = found["steps"], found["time"]
        lines.append(("length", f"{counted(last - first, 'step', ',')}, {end - begin:g}"))
        lines.append(("y at the end", ", ".join(f"{value:.10g}" for value in seen[Y][-1][:MOST]) + _more(seen[Y][-1])))
        energy = report.get("energy") if report else _energy(run, samples, seen[ENERGY]) if ENERGY in seen else None
        lines += energy_lines(energy, "", "", end - begin) if isinstance(energy, dict) else []
    lines.append(("samples", _state(found)))
    return lines + alarms(found)


def _more(y: Floats) -> str:
    return f" and {len(y) - MOST:,} more" if len(y) > MOST else ""


def _method(method: Mapping[str, Any], report: Mapping[str, Any], time_unit: str) -> str:
    """Name and options of the integrator, and the engine if another program made the run."""
    source = report if "options" in report else method
    options = source.get("options")
    chosen = {key: source.get(key) for key in _CHOICES} | (options if isinstance(options, dict) else {})
    engine = method.get("engine")
    where = [] if engine in (None, "native") else [f"engine {engine} {method.get('engine_version') or ''}".rstrip()]
    name = method_text(
        str(method.get("integrator")), {key: value for key, value in chosen.items() if worth_saying(value)}, time_unit
    )
    return ", ".join([name, *where])


def _of_particles(found: dict[str, Any], report: Mapping[str, Any], units: Mapping[str, str]) -> Lines:
    """Charges, constraints and molecules: of the file, and what the report tells of them."""
    charges, molecules = report.get("charges"), report.get("molecules")
    told = charge_lines(charges, units["length"]) if isinstance(charges, Mapping) else []
    told += molecule_lines(molecules, units["length"], units["temperature"]) if isinstance(molecules, Mapping) else []
    return [line for line in tie_lines(found, units["charge"]) if line[0] not in dict(told)] + told


def _momentum(report: Mapping[str, Any]) -> Lines:
    """The errors of momentum and of angular momentum, where these are conserved."""
    lines, linear, angular = [], report.get("momentum_error"), report.get("angular_momentum_error")
    if _is_number(linear):
        lines.append(("momentum error", f"{linear:.1e} of the sum of m |v|"))
    if _is_number(angular):
        lines.append(("angular momentum", f"error {angular:.1e} of the sum of m |x × v|"))
    return lines


def _means(report: Mapping[str, Any], units: Mapping[str, str], dimensions: Any) -> Lines:
    temperature: Any = report.get("temperature")
    pressure: Any = report.get("pressure")
    lines, said = [], ""
    if _is_number(temperature):
        options, verdict = report.get("options"), report.get("temperature_verdict")
        asked = options.get("temperature") if isinstance(options, dict) and isinstance(verdict, str) else None
        said = verdict_text(asked if _is_number(asked) else None, verdict, units["temperature"])
        lines.append(
            ("temperature", mean_text(temperature, _error(report, "temperature"), units["temperature"]) + said)
        )
    if _is_number(pressure):
        unit = f"{units['energy']}/{units['length']}^{dimensions}" if units["energy"] else ""
        text = mean_text(pressure, _error(report, "pressure"), unit)
        options, verdict = report.get("options"), report.get("pressure_verdict")
        asked = mean_pressure(options) if isinstance(options, dict) and isinstance(verdict, str) else None
        text += verdict_text(asked if _is_number(asked) else None, verdict, unit)
        joined = f"{lines[0][1]}, pressure {text}" if lines else ""
        if joined and not said and len(joined) <= FITS:
            return [("temperature", joined)]
        lines.append(("pressure", text))
    tensor = report.get("tensor")
    if isinstance(tensor, Mapping):
        unit = f"{units['energy']}/{units['length']}^{dimensions}" if units["energy"] else ""
        lines += tensor_lines(tensor, unit)
    volume: Any = report.get("volume")
    if _is_number(volume):
        unit = f"{units['length']}^{dimensions}" if units["length"] else ""
        lines.append(("volume", mean_text(volume, _error(report, "volume"), unit)))
    return lines


def _error(report: Mapping[str, Any], key: str) -> float | None:
    """The standard error of a mean in a report; None without a number."""
    error = report.get(f"{key}_error")
    return error if _is_number(error) else None


def _state(found: dict[str, Any]) -> str:
    """Number of frames, and whether the run is finished."""
    ahead = goal(found)
    text = f"{found['samples']:,}"
    if "problem" not in found:
        text = f"{found['frames']:,} and {counted(found['samples'], 'sample', ',')}"
    if found["closed"] and not ahead:
        return f"{text}; " + (
            f"stopped by {found['stopped'].removeprefix('by ')}" if found["stopped"] else "the run is finished"
        )
    text += f"; the run did not finish{f': {ahead}' if ahead else ''}"
    return text + (f"; continue with: kickdrift resume {found['file']}" if ahead and found["checkpoints"] else "")


@unwarned
def _so_far(run: Run, samples: Samples) -> dict[str, Any]:
    """Statements of a report on energy, momentum, temperature and pressure, from the samples."""
    seen = samples.observables
    found: dict[str, Any] = {}
    if len(samples.steps) and {"total_energy", "kinetic_energy"} <= seen.keys():
        method, total = _method_of(run), seen["total_energy"]
        if method and method.bath and "energy_taken" in seen:
            found["heat"] = -float(seen["energy_taken"][-1])
            total = total + seen["energy_taken"]
        found["energy"] = _energy(run, samples, total, float(seen["kinetic_energy"][0]))
        found["energy"] |= {"final": float(seen["total_energy"][-1])} if found["energy"] else {}
        if method and method.bath and "heat" not in found and found["energy"]:
            found["energy"] = {key: found["energy"][key] for key in ("initial", "final")}
    for key in ("temperature", "pressure"):
        if key in seen and len(seen[key]):
            found[key] = float(np.mean(seen[key]))
    if "momentum" in seen and len(seen["momentum"]) and len(run) and not _drags(run):
        try:
            scale = float(run.masses @ np.linalg.norm(run[0].velocities, axis=1))
        except InputError:  # the first frame is damaged
            return found
        change = float(np.linalg.norm(seen["momentum"] - seen["momentum"][0], axis=1).max())
        found["momentum_error"] = change / scale if scale else change
    return found


def _energy(run: Run | ProblemRun, samples: Samples, total: Floats, kinetic: float = 0.0) -> dict[str, Any]:
    try:
        error = energy_error(total, kinetic)
        trend = energy_trend(samples.steps, samples.times, total, kinetic, run.method.get("dt") is not None, error)
    except InputError:  # energies that are not finite
        return {}
    verdict = UNRELIABLE if warnings_of(run) else trend.verdict  # without a report, they are about the energy
    said = {"drift_per_unit_time": trend.slope, "drift_error": trend.error, "verdict": verdict}
    return vars(error) | said


def _method_of(run: Run) -> Method | None:
    """Row of the run's integrator; None if it is unknown here."""
    return INTEGRATORS.get(str(run.method.get("integrator")))


def _drags(run: Run) -> bool:
    """Whether the run's integrator changes the total momentum."""
    method = _method_of(run)
    return method is not None and method.drags


def _is_number(value: object) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool)

"""The report of a run from its file, in nine lines; the same for a run that is not finished, from its samples."""

from __future__ import annotations

import os
from collections.abc import Mapping
from typing import Any

import numpy as np

from kickdrift.errors import InputError
from kickdrift.integrators import INTEGRATORS
from kickdrift.integrators.method import Method
from kickdrift.looks.energy_trend import energy_trend
from kickdrift.looks.report_lines import energy_lines, mean_text, method_text, verdict_text
from kickdrift.model.checks import unwarned
from kickdrift.model.unit_systems import symbol_of
from kickdrift.statistics.drift import energy_error
from kickdrift.text import counted, measured
from kickdrift.trajectory.info import alarms, goal, info_of
from kickdrift.trajectory.reader import Run, open
from kickdrift.trajectory.recorded import Samples

Lines = list[tuple[str, str]]
_CHOICES = ("dt", "rtol", "atol")


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
        lines.append(("length", f"{last - first:,} steps, {measured(f'{end - begin:g}', units['time'])}"))
    energy = report.get("energy")
    if isinstance(energy, dict) and found["time"]:
        heat = report.get("heat")
        lines += energy_lines(
            energy, units["energy"], units["time"], found["time"][1] - found["time"][0],
            heat=heat if _is_number(heat) else None,
        )  # fmt: skip
    lines += _momentum(report)
    lines += _means(report, units, dimensions)
    lines.append(("frames", _state(found)))
    return lines + alarms(found)


def _method(method: Mapping[str, Any], report: Mapping[str, Any], time_unit: str) -> str:
    """Name and options of the integrator, and the engine if another program made the run."""
    source = report if "options" in report else method
    options = source.get("options")
    chosen = {key: source.get(key) for key in _CHOICES} | (options if isinstance(options, dict) else {})
    engine = method.get("engine")
    where = [] if engine in (None, "native") else [f"engine {engine} {method.get('engine_version') or ''}".rstrip()]
    name = method_text(str(method.get("integrator")), {key: value for key, value in chosen.items() if value}, time_unit)
    return ", ".join([name, *where])


def _momentum(report: Mapping[str, Any]) -> Lines:
    """The errors of momentum and of angular momentum, where these are conserved."""
    lines, linear, angular = [], report.get("momentum_error"), report.get("angular_momentum_error")
    if _is_number(linear):
        lines.append(("momentum error", f"{linear:.1e} of the sum of m |v|"))
    if _is_number(angular):
        lines.append(("angular momentum", f"error {angular:.1e} of the sum of m |x × v|"))
    return lines


def _means(report: Mapping[str, Any], units: Mapping[str, str], dimensions: Any) -> Lines:
    temperature, pressure = report.get("temperature"), report.get("pressure")
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
        if lines and not said:
            return [("temperature", f"{lines[0][1]}, pressure {text}")]
        lines.append(("pressure", text))
    return lines


def _error(report: Mapping[str, Any], key: str) -> float | None:
    """The standard error of a mean in a report; None without a number."""
    error = report.get(f"{key}_error")
    return error if _is_number(error) else None


def _state(found: dict[str, Any]) -> str:
    """Number of frames, and whether the run is finished."""
    ahead = goal(found)
    text = f"{found['frames']:,} and {counted(found['samples'], 'sample', ',')}"
    if found["closed"] and not ahead:
        return f"{text}; " + (f"stopped by {found['stopped']}" if found["stopped"] else "the run is finished")
    text += f"; the run did not finish{f': {ahead}' if ahead else ''}"
    return text + (f"; continue with: kickdrift resume {found['file']}" if ahead and found["checkpoints"] else "")


@unwarned
def _so_far(run: Run, samples: Samples) -> dict[str, Any]:
    """What a report says of energy, momentum, temperature and pressure, from the samples."""
    seen = samples.observables
    found: dict[str, Any] = {}
    if len(samples.steps) and {"total_energy", "kinetic_energy"} <= seen.keys():
        found["energy"] = _energy(run, samples)
    method = _method_of(run)
    if method and method.bath and len(taken := seen.get("energy_taken", ())):
        found["heat"] = -float(taken[-1])
    for key in ("temperature", "pressure"):
        if key in seen and len(seen[key]):
            found[key] = float(np.mean(seen[key]))
    if "momentum" in seen and len(seen["momentum"]) and len(run) and not (method and method.drags):
        try:
            scale = float(run.masses @ np.linalg.norm(run[0].velocities, axis=1))
        except InputError:  # the first frame is damaged
            return found
        change = float(np.linalg.norm(seen["momentum"] - seen["momentum"][0], axis=1).max())
        found["momentum_error"] = change / scale if scale else change
    return found


def _energy(run: Run, samples: Samples) -> dict[str, Any]:
    total, kinetic = samples.observables["total_energy"], float(samples.observables["kinetic_energy"][0])
    final = float(total[-1])
    if (method := _method_of(run)) and method.bath:
        total = total + samples.observables.get("energy_taken", 0.0)
    try:
        error = energy_error(total, kinetic)
        trend = energy_trend(samples.steps, samples.times, total, kinetic, run.method.get("dt") is not None)
    except InputError:  # energies that are not finite
        return {}
    said = {"drift_per_unit_time": trend.slope, "drift_error": trend.error, "verdict": trend.verdict}
    return vars(error) | said | {"final": final}


def _method_of(run: Run) -> Method | None:
    """Row of the run's integrator; None if it is unknown here."""
    return INTEGRATORS.get(str(run.method.get("integrator")))


def _is_number(value: object) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool)

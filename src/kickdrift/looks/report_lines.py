"""Lines about a run for people: its method, and its energy with the error and the drift."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

from kickdrift.text import measured, with_error


def method_text(name: str, options: Mapping[str, Any], time_unit: str = "") -> str:
    """Name of a method with the options that are not None."""
    said = [
        f"{key} = {measured(f'{value:g}', time_unit * (key == 'dt'))}"
        if isinstance(value, float)
        else f"{key} = {value}"
        for key, value in options.items()
        if value is not None
    ]
    return ", ".join([name, *said])


def energy_lines(
    energy: Mapping[str, Any],
    energy_unit: str,
    time_unit: str,
    length: float,
    cause: str = "",
    heat: float | None = None,
    work: float | None = None,
) -> list[tuple[str, str]]:
    """Lines of the values of an EnergyReport; values that are None are left out.

    ``length`` is the time of the run. ``cause`` follows a secular drift. ``heat`` is the energy from a heat bath, None
    without a bath; ``work`` is that from the change of the box, None without a barostat. Error and drift are then those
    of the energy less both."""
    less_heat = "" if heat is None else " (energy less heat)" if work is None else " (energy less heat and work)"
    by_force, missed = energy.get("work") or {}, energy.get("work_error") or 0.0
    counted = not str(energy.get("verdict")).startswith("not conserved")
    if by_force and heat is None and counted:
        less_heat = " (energy less work)"
    unit = measured("", energy_unit)
    per = f" per {time_unit or 'unit of time'}"
    lines = []
    if _are_numbers(energy, "initial", "final"):
        lines.append(("energy", f"{energy['initial']:.8g} at the start, {energy['final']:.8g}{unit} at the end"))
    if heat is not None:
        lines.append(("heat", f"{heat:.8g}{unit} from the heat bath"))
    if work is not None:
        lines.append(("work", f"{work:.8g}{unit} from the change of the box"))
    if by_force:
        found = ", ".join(f"{value:.6g}{unit} by {name}" for name, value in by_force.items())
        more = "" if counted else "; look more often to count it"
        lines.append(("work", f"{found} (± {missed:.1e} by the distance between looks{more})"))
    if _are_numbers(energy, "rms_relative_error", "max_relative_error"):
        rms, largest = energy["rms_relative_error"], energy["max_relative_error"]
        lines.append(
            ("energy error", f"{rms:.2e} RMS, {largest:.2e} largest, of {energy.get('relative_to')}{less_heat}")
        )
    drift, verdict = drift_text(energy), energy.get("verdict")
    if isinstance(verdict, str):
        context = _size(energy, length) + cause if drift and verdict == "secular drift" else ""
        lines.append(("energy drift", (f"{drift}{per}: {verdict}{context}" if drift else verdict) + less_heat))
    return lines


def mean_text(mean: float, error: float | None, unit: str) -> str:
    """A mean over the samples with its standard error, if there is one, and its unit."""
    return f"{measured(with_error(mean, error) if error else f'{mean:.5g}', unit)} (mean)"


def verdict_text(asked: float | None, verdict: str | None, unit: str) -> str:
    """The value asked of a bath or a barostat with its verdict, as text; empty without a verdict."""
    return "" if verdict is None or asked is None else f", asked {measured(f'{asked:g}', unit)}: {verdict}"


def drift_text(energy: Mapping[str, Any]) -> str:
    """Slope and its interval; empty without a finite interval."""
    if not _are_numbers(energy, "drift_per_unit_time", "drift_error") or not math.isfinite(energy["drift_error"]):
        return ""
    return f"{energy['drift_per_unit_time']:+.1e} ± {energy['drift_error']:.1e}"


def _size(energy: Mapping[str, Any], length: float) -> str:
    """Size of a drift over the run."""
    of = {"initial energy": " of the energy", "kinetic energy": " of the kinetic energy"}
    size = abs(energy["drift_per_unit_time"] * length)
    return f", {size:.0e}{of.get(energy.get('relative_to', ''), '')} over this run"


def _are_numbers(values: Mapping[str, Any], *keys: str) -> bool:
    return all(isinstance(value := values.get(key), int | float) and not math.isnan(value) for key in keys)

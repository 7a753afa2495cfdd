"""Curves beside a view: the energy error, the temperature, and the user's own numbers over time."""

from __future__ import annotations

from collections.abc import Mapping
from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import NDArray

from kickdrift.model.state import Floats
from kickdrift.model.units.unit_systems import UnitSystem, symbol_of
from kickdrift.statistics.drift import energy_error
from kickdrift.view.packing import packed

MOST_POINTS = 2000  # of a curve; more points keep the smallest and the largest value of each stretch
MOST_CURVES = 6


def curve(name: str, label: str, unit: str, times: Floats, values: Floats) -> dict[str, Any]:
    """A curve as a plain description, with its times and values packed."""
    kept = thinned(values)
    return {
        "name": name,
        "label": label,
        "unit": unit,
        "times": packed(np.asarray(times, "f8")[kept]),
        "values": packed(np.asarray(values, "f8")[kept]),
    }


def curves_of(
    times: Floats, observables: Mapping[str, Floats], units: UnitSystem, own: Mapping[str, str] | None = None
) -> list[dict[str, Any]]:
    """Curves of samples at ``times`` (s,): energy error, temperature, and the plain numbers ``own`` by name and
    unit."""
    found = []
    if len(times) and "total_energy" in observables:
        total = observables["total_energy"] + observables.get("energy_taken", 0.0)
        kinetic = float(observables["kinetic_energy"][0]) if "kinetic_energy" in observables else 0.0
        if np.isfinite(total).all():
            error = energy_error(total, kinetic)
            scale = {"initial energy": abs(error.initial), "kinetic energy": kinetic}.get(error.relative_to, 1.0)
            unit = f"of {error.relative_to}" if scale != 1.0 else symbol_of(units.energy)
            found.append(curve("energy error", "energy error", unit, times, (total - total[0]) / scale))
    if len(times) and "temperature" in observables:
        unit = symbol_of(units.temperature)
        found.append(curve("temperature", "temperature", unit, times, observables["temperature"]))
    for name, unit in (own or {}).items():
        if len(times) and observables[name].ndim == 1:
            found.append(curve(name, name.replace("_", " "), symbol_of(unit), times, observables[name]))
    return found[:MOST_CURVES]


def thinned(values: Floats) -> NDArray[np.int64]:
    """Places, in order, of at most MOST_POINTS values, among them the extremes of every stretch."""
    count = len(values)
    if count <= MOST_POINTS:
        return np.arange(count)
    known = np.nan_to_num(np.asarray(values, "f8"))
    edges = np.linspace(0, count, MOST_POINTS // 2).round().astype(int)
    kept = {0, count - 1}
    for begin, end in pairwise(edges):
        part = known[begin:end]
        kept |= {begin + int(np.argmin(part)), begin + int(np.argmax(part))}
    return np.array(sorted(kept))

"""Arrays and curves as short text: whole numbers of few bits, changes from frame to frame, deflate and base64.

The browser unpacks the text with ``DecompressionStream`` (`src/viewer/packed.js`).
"""

import base64
import zlib
from collections.abc import Mapping
from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from kickdrift.errors import InputError
from kickdrift.model.state import Floats
from kickdrift.model.units.unit_systems import UnitSystem, symbol_of
from kickdrift.statistics.drift import EnergyError, energy_error

KINDS = {"u1": 8, "u2": 16, "u4": 32}  # whole numbers, and their bits
LEVEL = 6  # of zlib: 9 takes five times as long for 1 % less


def packed(values: NDArray, delta: bool = False) -> dict[str, Any]:
    """Array as a plain description: type, shape, and the values as text.

    Parameters
    ----------
    values : array of u1, u2, u4, f4 or f8
    delta : store the change along the first axis, for whole numbers; the sum wraps around, so nothing is lost
    """
    values = np.ascontiguousarray(values)
    kind = f"{values.dtype.kind}{values.dtype.itemsize}"
    if delta:
        bits = KINDS[kind]
        change = np.diff(values, axis=0, prepend=np.zeros_like(values[:1]))
        signed = change.view(f"i{bits // 8}")
        change = ((signed << 1) ^ (signed >> (bits - 1))).view(values.dtype)  # small changes of either sign are small
    else:
        change = values
    data = change.astype(change.dtype.newbyteorder("<"), copy=False).reshape(-1).view("u1")
    planes = data.reshape(-1, values.dtype.itemsize).T  # all first bytes, then all second bytes
    text = base64.b64encode(zlib.compress(planes.tobytes(), LEVEL)).decode("ascii")
    return {"type": kind, "shape": list(values.shape), "delta": delta, "data": text}


def unpacked(text: dict[str, Any]) -> NDArray:
    """The array of ``packed``."""
    kind, shape = np.dtype(text["type"]), text["shape"]
    planes = np.frombuffer(zlib.decompress(base64.b64decode(text["data"])), "u1").reshape(kind.itemsize, -1)
    values = np.ascontiguousarray(planes.T).reshape(-1).view(kind.newbyteorder("<")).astype(kind).reshape(shape)
    if not text["delta"]:
        return values
    change = (values >> 1) ^ (np.zeros_like(values) - (values & 1))
    return np.cumsum(change, axis=0, dtype=kind)


def quantised(part: Floats, bits: int) -> NDArray:
    """Whole numbers of 8, 16 or 32 bits for values from 0 to 1. The largest number stands for nan: nothing is there."""
    most = 2**bits - 1
    kind = f"u{bits // 8}"
    if KINDS.get(kind) != bits:
        raise InputError(f"bits: expected 8, 16 or 32, got {bits}")
    there = np.isfinite(part)
    level = np.floor(np.where(there, np.clip(part, 0.0, 1.0), 0.0) * most)
    return np.where(there, np.minimum(level, most - 1), most).astype(kind)


def restored(level: NDArray) -> Floats:
    """Values from 0 to 1 of ``quantised``, each in the middle of its step."""
    most = int(np.iinfo(level.dtype).max)
    return np.where(level == most, np.nan, (level.astype("f8") + 0.5) / most)


def scaled(values: ArrayLike, low: float, high: float) -> Floats:
    """Values as parts of the range from low to high, within 0 and 1; 0 if the range is empty."""
    wide = high - low
    found = (np.asarray(values, "f8") - low) / wide if wide > 0 else np.asarray(values, "f8") * 0.0
    return np.clip(found, 0.0, 1.0)


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


def energy_curve(times: Floats, away: Floats, error: EnergyError, kinetic: float, units: UnitSystem) -> dict[str, Any]:
    """Curve of the energy error; ``away`` is the distance of the energies from the first one."""
    unit = symbol_of(units.energy) if error.relative_to == "absolute" else f"of {error.relative_to}"
    return curve("energy error", "energy error", unit, times, away / error.scale(kinetic))


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
            found.append(energy_curve(times, total - total[0], energy_error(total, kinetic), kinetic, units))
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

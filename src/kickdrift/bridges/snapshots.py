"""A System of a snapshot: HDF5 files of AMUSE and of GADGET's family, and NEMO's binary files.

AMUSE writes a unit with every array. GADGET's files may say their units; NEMO's are plain numbers, as N-body units are.
"""

from __future__ import annotations

import ast
import math
import os
import re
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any, NamedTuple
from warnings import warn

import numpy as np

from kickdrift.disk.files import opened
from kickdrift.display.showing import above
from kickdrift.errors import InputError
from kickdrift.forces import Gravity, GravityTree
from kickdrift.model.state import Floats
from kickdrift.model.system import System
from kickdrift.model.units.quantities import quantity
from kickdrift.model.units.unit_systems import UnitSystem, unit_system
from kickdrift.text import shown

HDF5 = b"\x89HDF\r\n\x1a\n"
MANY = 20_000  # stars above which the default force is the tree
SINGLE, PLURAL = 0o11 << 8 | 0o222, 0o13 << 8 | 0o222  # marks of NEMO's items
TYPES = {"c": "i1", "b": "i1", "a": "i1", "s": "i2", "i": "i4", "l": "i8", "f": "f4", "d": "f8"}  # of NEMO
SPECIES = ("gas", "halo", "disk", "bulge", "stars", "boundary")  # of GADGET's PartType0 to PartType5
CGS = {  # names of the units in files of GADGET and of SWIFT
    "length": ("UnitLength_in_cm", "Unit length in cgs (U_L)"),
    "mass": ("UnitMass_in_g", "Unit mass in cgs (U_M)"),
    "velocity": ("UnitVelocity_in_cm_per_s",),
    "time": ("Unit time in cgs (U_t)",),
}
POWERS = {"length": {"length": 1}, "velocity": {"length": 1, "time": -1}, "mass": {"mass": 1}, "time": {"time": 1}}
_BASE = re.compile(r"system\.get\('(S\.I\.|generic)'\)\.base\('(\w+)'\)")


class Snapshot(NamedTuple):
    """What a file holds. ``units`` are the sizes of length, mass, velocity and time in SI; None for plain numbers, and
    empty if the file does not say."""

    x: Floats
    v: Floats
    masses: Floats
    time: float
    species: list[str] | None
    units: dict[str, float] | None


def is_snapshot(path: Path) -> bool:
    """Tell whether a file, which `may_be_snapshot`, is a snapshot that `system_of` reads."""
    with opened(path) as file:
        if file.read(8) != HDF5:
            return True
    try:
        with above("HDF5 file")(path) as found:
            return _kind(found) is not None
    except (InputError, OSError, RuntimeError, ValueError):
        return False


def system_of(
    path: str | os.PathLike[str],
    units: str | UnitSystem | None = None,
    scale: Mapping[str, str] | None = None,
    forces: Iterable[Any] | None = None,
    snapshot: int | None = None,
) -> System:
    """Return the System of a snapshot; see `System.from_snapshot`."""
    name = os.fspath(path)
    try:
        found = _read(Path(name), -1 if snapshot is None else snapshot)
    except InputError as error:
        raise InputError(f"{name}: {error}") from None
    except (OSError, RuntimeError, ValueError, KeyError, TypeError, IndexError, OverflowError) as error:
        raise InputError(f"{name}: damaged, or no snapshot: {' '.join(str(error).split())}") from None
    n = len(found.x)
    if not (found.x.shape == found.v.shape == (n, 3) and found.masses.shape == (n,)) or not n:
        raise InputError(f"{name}: expected positions and velocities (n, 3) and masses (n,), got {found.x.shape}")
    asked = unit_system(units) if isinstance(units, str) else units
    own = None if found.units == {} and scale is None and asked is not None and asked.reduced else found.units
    sizes = _sizes(name, own, scale)
    system = asked or unit_system("astro" if sizes else "nbody")
    if sizes and system.reduced:
        raise InputError(f"{name}: has units, and {system.name!r} are plain numbers; expected units = 'astro' or 'si'")
    if not sizes and not system.reduced:
        raise InputError(
            f"{name}: has no units; give scale = {{'length': '1 pc', 'mass': '1 Msun', 'velocity': '1 km/s'}}, or no "
            "units, for plain numbers with G = 1"
        )
    factors = {key: quantity(f"{size!r} {_SI[key]}", key, system) for key, size in sizes.items()} if sizes else {}
    length, mass, velocity, time = (factors.get(key, 1.0) for key in ("length", "mass", "velocity", "time"))
    given = (GravityTree() if n > MANY else Gravity(),) if forces is None else forces
    made = System(
        found.x * length, found.v * velocity, found.masses * mass, forces=given, units=system, species=found.species,
        name=Path(name).stem,
    )  # fmt: skip
    return made.at(made.state.phase, found.time * time)


_SI = {"length": "m", "mass": "kg", "velocity": "m/s", "time": "s"}


def _sizes(name: str, own: dict[str, float] | None, scale: Mapping[str, str] | None) -> dict[str, float] | None:
    """Sizes of the file's units in SI, its own or those of ``scale``; None for plain numbers."""
    if scale is not None:
        if own:
            raise InputError(f"{name}: scale: the file has units of its own")
        wrong = next((key for key in scale if key not in _SI), None)
        missing = next((key for key in ("length", "mass") if key not in scale), None)
        if wrong or missing or not {"velocity", "time"} & set(scale):
            raise InputError(f"{name}: scale: expected length, mass, and velocity or time, got {shown(dict(scale))}")
        si = unit_system("si")
        own = {key: quantity(value, key, si, f"scale: {key}") for key, value in scale.items()}
    if own is not None and not own:
        raise InputError(
            f"{name}: does not say its units; give scale = {{'length': '1 kpc', 'mass': '1e10 Msun', 'velocity': "
            "'1 km/s'}"
        )
    if own is None:
        return None
    own.setdefault("time", own["length"] / own.get("velocity", math.nan))
    own.setdefault("velocity", own["length"] / own["time"])
    return own


def _read(path: Path, index: int) -> Snapshot:
    with opened(path) as file:
        hdf5 = file.read(8) == HDF5
    if not hdf5:
        return _nemo(path, index)
    with above("HDF5 file")(path) as found:
        kind = _kind(found)
        if kind is None:
            raise InputError(
                "is no snapshot: expected AMUSE's groups of particles, or PartType0 to PartType5 of GADGET"
            )
        if kind == "gadget":
            if index not in (0, -1):
                raise InputError(f"snapshot: the file holds one, got {index}")
            return _gadget(found)
        return _amuse(found[kind], index)


def _kind(file: Any) -> str | None:
    """ "gadget", or the name of AMUSE's group, or None."""
    if "Header" in file and any(f"PartType{k}" in file for k in range(6)):
        return "gadget"
    for name, mark in (("data", "AMUSE_INF"), ("particles", "particles/0000000001/attributes")):
        if name in file and mark in file:
            return name
    return None


# --- AMUSE


def _amuse(group: Any, index: int) -> Snapshot:
    """A set of particles, counted as AMUSE stored them."""
    sets = [
        each for _, each in sorted(group.items()) if "attributes" in each and _text(each.attrs.get("type")) != "grid"
    ]
    if not -len(sets) <= index < len(sets):
        raise InputError(f"snapshot: expected one from 0 to {len(sets) - 1}, or from the end, got {index}")
    chosen = sets[index]
    columns: dict[str, tuple[Floats, float, str]] = {}
    for key in ("mass", "x", "y", "z", "vx", "vy", "vz"):
        if key not in chosen["attributes"]:
            what = "masses" if key == "mass" else f"attribute {key!r}"
            raise InputError(f"has no {what}")
        data = chosen["attributes"][key]
        powers = POWERS["mass" if key == "mass" else "velocity" if key[0] == "v" else "length"]
        columns[key] = (np.array(data, dtype=float), *amuse_unit(_text(data.attrs.get("units")), key, powers))
    systems = {system for _, _, system in columns.values()}
    if len(systems) > 1:
        raise InputError("mixes plain numbers with units")
    time, time_size = float(chosen.attrs.get("timestamp", 0.0)), 1.0
    if "timestamp" in chosen.attrs and "timestamp_unit" in chosen.attrs:
        time_size, _ = amuse_unit(_text(chosen.attrs["timestamp_unit"]), "timestamp", POWERS["time"])
    x, v = (
        np.stack([columns[key][0] * columns[key][1] for key in keys], axis=1)
        for keys in (("x", "y", "z"), ("vx", "vy", "vz"))
    )
    si = dict.fromkeys(("length", "mass", "velocity", "time"), 1.0) if systems == {"S.I."} else None
    return Snapshot(x, v, columns["mass"][0] * columns["mass"][1], time * time_size, None, si)


def amuse_unit(text: str, key: str, wanted: Mapping[str, int]) -> tuple[float, str]:
    """Size of a unit in AMUSE's words, such as "(1000.0 * system.get('S.I.').base('length'))", and "S.I." or "generic".

    Raises InputError for another dimension than ``wanted``, powers by dimension, and for text that is no such unit.
    """
    kinds = {each[0] for each in _BASE.findall(text)}
    plain = _BASE.sub(r"\2", text)
    try:
        if len(kinds) != 1:
            raise ValueError
        size, powers = _product(ast.parse(plain, mode="eval").body)
    except (ValueError, SyntaxError, RecursionError, OverflowError, ZeroDivisionError):
        raise InputError(f"{key}: expected a unit of AMUSE, got {shown(text)}") from None
    if {name: power for name, power in powers.items() if power} != dict(wanted):
        raise InputError(f"{key}: expected a unit of {' '.join(wanted)}, got {shown(text)}")
    return size, kinds.pop()


def _product(node: Any) -> tuple[float, dict[str, int]]:
    """Number and powers of a product of numbers, names and powers."""
    if isinstance(node, ast.Constant) and isinstance(node.value, int | float):
        return float(node.value), {}
    if isinstance(node, ast.Name):
        return 1.0, {node.id: 1}
    if isinstance(node, ast.UnaryOp) and isinstance(node.op, ast.USub):
        size, powers = _product(node.operand)
        return -size, powers
    if isinstance(node, ast.BinOp) and isinstance(node.op, ast.Pow):
        (size, powers), (power, none) = _product(node.left), _product(node.right)
        if none or power != int(power) or abs(power) > 9:
            raise ValueError
        return size**power, {name: each * int(power) for name, each in powers.items()}
    if isinstance(node, ast.BinOp) and isinstance(node.op, ast.Mult | ast.Div):
        (size, powers), (other, more) = _product(node.left), _product(node.right)
        sign = 1 if isinstance(node.op, ast.Mult) else -1
        return size * other**sign, {key: powers.get(key, 0) + sign * more.get(key, 0) for key in {*powers, *more}}
    raise ValueError


def _text(value: Any) -> str:
    return value.decode(errors="replace") if isinstance(value, bytes) else str(value)


# --- GADGET and its family


def _gadget(file: Any) -> Snapshot:
    header = dict(file["Header"].attrs)
    said = header | {
        key: each for name in ("Parameters", "Units") if name in file for key, each in file[name].attrs.items()
    }
    comoving = float(_one(said.get("ComovingIntegrationOn", 0))) or float(_one(header.get("Redshift", 0.0)))
    if comoving:
        raise InputError("is in comoving coordinates, which kickdrift does not have")
    if int(_one(header.get("NumFilesPerSnapshot", 1))) > 1:
        raise InputError("is one of several files of a snapshot; join them into one first")
    table = np.zeros(6) if "MassTable" not in header else np.asarray(header["MassTable"], dtype=float)
    parts: list[tuple[Floats, Floats, Floats]] = []
    species: list[str] = []
    for k, word in enumerate(SPECIES):
        group = file.get(f"PartType{k}")
        if group is None or "Coordinates" not in group:
            continue
        x = np.array(group["Coordinates"], dtype=float)
        if k == 0:
            warn(f"left out {len(x):,} particles of gas, since kickdrift has no gas", stacklevel=5)
            continue
        if "Velocities" not in group:
            raise InputError(f"PartType{k} has no velocities")
        if "Masses" in group:
            masses = np.array(group["Masses"], dtype=float)
        elif k < len(table) and table[k] > 0:
            masses = np.full(len(x), table[k])
        else:
            raise InputError(
                f"PartType{k} has no masses: neither a dataset Masses nor a mass in the header's MassTable"
            )
        parts.append((x, np.array(group["Velocities"], dtype=float), masses))
        species += [word] * len(x)
    if not parts:
        raise InputError("has no particles but gas")
    x, v, masses = (np.concatenate(each) for each in zip(*parts, strict=True))
    sizes = {key: float(_one(said[name])) for key, names in CGS.items() for name in names if name in said}
    cgs = {"length": 1e-2, "mass": 1e-3, "velocity": 1e-2, "time": 1.0}
    known = {key: size * cgs[key] for key, size in sizes.items()} if {"length", "mass"} <= set(sizes) else {}
    return Snapshot(x, v, masses, float(_one(header.get("Time", 0.0))), species, known)


def _one(value: Any) -> Any:
    return np.ravel(value)[0]


# --- NEMO


def _nemo(path: Path, index: int) -> Snapshot:
    with opened(path) as file:
        data = file.read()
    items, place = [], 0
    while place < len(data):
        item, place = _item(data, place)
        items.append(item)
    found = [each for tag, each in items if tag == "SnapShot" and isinstance(each, dict) and "Particles" in each]
    if not -len(found) <= index < len(found):
        raise InputError(f"snapshot: expected one from 0 to {len(found) - 1}, or from the end, got {index}")
    bodies, more = found[index]["Particles"], found[index].get("Parameters", {})
    if "Mass" not in bodies:
        raise InputError("has no masses")
    masses = np.ravel(bodies["Mass"]).astype(float)
    if "PhaseSpace" in bodies:
        x, v = np.moveaxis(np.reshape(bodies["PhaseSpace"], (-1, 2, 3)).astype(float), 1, 0)
    else:
        speed = next((each for each in ("Velocity", "Vecolity") if each in bodies), None)  # the latter by AMUSE
        if "Position" not in bodies or speed is None:
            raise InputError("has no positions and velocities")
        x, v = (np.reshape(bodies[key], (-1, 3)).astype(float) for key in ("Position", speed))
    return Snapshot(x, v, masses, float(np.ravel(more.get("Time", 0.0))[0]), None, None)


def _item(data: bytes, place: int) -> tuple[tuple[str, Any], int]:
    """Tag and content of an item of NEMO, and the place after it: an array, or a dict for a set of items."""
    mark = int.from_bytes(data[place : place + 2], "little")
    order = "<"
    if mark not in (SINGLE, PLURAL):
        mark, order = int.from_bytes(data[place : place + 2], "big"), ">"
    if mark not in (SINGLE, PLURAL):
        raise InputError(f"is no file of NEMO: no item begins at byte {place}")
    kind, place = _word(data, place + 2)
    if kind in (")", "]"):
        return (kind, None), place
    tag, place = _word(data, place)
    if kind in ("(", "["):
        inside: dict[str, Any] = {}
        while True:
            (name, value), place = _item(data, place)
            if name in (")", "]") and value is None:
                return (tag, inside), place
            inside[name] = value
    if kind not in TYPES:
        raise InputError(f"is no file of NEMO: {tag} has the type {shown(kind)}")
    shape: list[int] = []
    while mark == PLURAL:
        size = int.from_bytes(data[place : place + 4], "little" if order == "<" else "big")
        place += 4
        if not size:
            break
        shape.append(size)
    dtype, count = np.dtype(order + TYPES[kind]), math.prod(shape)
    if place + count * dtype.itemsize > len(data):
        raise InputError(f"ends within {tag}")
    values = np.frombuffer(data, dtype, count, place)
    return (tag, values.reshape(shape)), place + count * dtype.itemsize


def _word(data: bytes, place: int) -> tuple[str, int]:
    end = data.index(b"\0", place)
    return data[place:end].decode("ascii", "replace"), end + 1

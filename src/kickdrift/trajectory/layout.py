"""Names, units, chunk shapes and the first bytes of a run's file; `kickdrift.trajectory.h5md` describes the whole."""

from __future__ import annotations

import json
import platform
from collections.abc import Sequence
from dataclasses import asdict
from importlib.metadata import PackageNotFoundError, version
from typing import Any, NamedTuple

import h5py
import numpy as np

from kickdrift.box import Box
from kickdrift.system import System
from kickdrift.trajectory import checkpoints
from kickdrift.trajectory.checkpoints import Stored
from kickdrift.trajectory.record import record_of, to_json
from kickdrift.units import DIMENSIONS, UnitSystem

SCHEMA = 2  # 1 had no checkpoints and no plan
SUFFIX = ".h5md"
TRAJECTORY = "particles/trajectory"
SAMPLES = "kickdrift/samples"
EVENTS = "kickdrift/events"
KIND_BYTES, DONE_BYTES = 64, 160  # of an event's texts, which are cut there; fixed, so that rows survive a kill
PLAN_NUMBERS = 7  # what `run_plan.Plan` has
EVENT_WIDTH = 6 + (KIND_BYTES + DONE_BYTES) // 8  # of an event's row, in numbers of 8 bytes
CHUNK_BYTES = 128 * 1024  # of positions or velocities; a chunk holds a few dozen frames of some of the particles
SERIES_CHUNK = 512  # rows of a series with one row for each frame or sample

# Units that are lengths and times to MDAnalysis, in its own angstrom and ps.
_ANGSTROM = {"angstrom": 1.0, "nm": 10.0, "m": 1e10}
_PICOSECOND = {"ps": 1.0, "fs": 1e-3, "s": 1e12}
_DIMENSION = dict.fromkeys(("kinetic_energy", "potential_energy", "total_energy"), "energy")
_DIMENSION |= {"centre_of_mass": "length", "centre_of_mass_velocity": "velocity", "energy_taken": "energy"}
_DIMENSION |= {"momentum_taken": "momentum", "angular_momentum_taken": "angular momentum"}


class FileUnits(NamedTuple):
    """What stored positions and times are multiplied by; both are exactly 1 but for ``si``.

    ``nominal`` is true where a length unit is written as one angstrom and a time unit as one ps for want of anything
    better, as in reduced units.
    """

    length: float
    time: float
    nominal: bool

    @property
    def velocity(self) -> float:
        return self.length / self.time

    @classmethod
    def of(cls, units: UnitSystem) -> FileUnits:
        length, time = _ANGSTROM.get(units.length.lower()), _PICOSECOND.get(units.time.lower())
        if length is None or time is None:
            return cls(1.0, 1.0, True)
        return cls(length, time, False)


def observable_unit(name: str, units: UnitSystem) -> str:
    """The true unit of an observable, in words; empty where it is not known."""
    dimension = _DIMENSION.get(name, name.replace("_", " "))
    return units.unit(dimension) if dimension in DIMENSIONS else ""


def frame_chunk(n: int, flush_frames: int) -> tuple[int, int, int]:
    """Chunk shape of (frames, n, 3) float64 values.

    Enough frames that one particle's path is cheap, but no more than are written at once, and as few particles as
    make up CHUNK_BYTES, so that one frame is cheap too.
    """
    frames = max(32, CHUNK_BYTES // (24 * n))
    frames = max(1, min(frames, flush_frames, CHUNK_BYTES // 24))
    return frames, max(1, min(n, CHUNK_BYTES // (24 * frames))), 3


def versions() -> dict[str, str]:
    """Versions of the packages that decide a run's bits, and the kind of machine; nothing is imported for it."""
    found = {"python": platform.python_version(), "machine": platform.machine()}
    for package in ("kickdrift", "numpy", "numba", "llvmlite", "h5py"):
        try:
            found[package] = version(package)
        except PackageNotFoundError:
            found[package] = "not installed"
    return found


def new_series(
    group: h5py.Group, name: str, shape: tuple[int, ...], dtype: str, rows: int = SERIES_CHUNK
) -> h5py.Dataset:
    """An empty dataset that grows along its first axis; rows that were never written read as NaN."""
    fill = np.nan if dtype == "f8" else None
    return group.create_dataset(
        name, (0, *shape), dtype, maxshape=(None, *shape), chunks=(rows, *shape), fillvalue=fill, track_times=False
    )


def new_events(file: h5py.File) -> None:
    """The table of events, made when there is a first one."""
    group = file.create_group(EVENTS)
    new_series(group, "step", (), "i8")
    new_series(group, "ids", (2,), "i8")
    for name in ("time", "distance", "energy"):
        new_series(group, name, (), "f8")
    new_series(group, "kind", (), f"S{KIND_BYTES}")
    new_series(group, "done", (), f"S{DONE_BYTES}")
    group.create_dataset("committed", data=np.zeros(1, dtype="i8"), track_times=False)


def text(group: h5py.Group, name: str, value: str) -> None:
    """A scalar string; a dataset, since HDF5's first format allows an attribute 64 kB only."""
    if name in group:
        del group[name]
    group.create_dataset(name, data=value, dtype=h5py.string_dtype(), track_times=False)


def header_image(
    system: System,
    *,
    method: dict[str, Any],
    every: int,
    run_id: str,
    author: str,
    flush_frames: int,
    plan: Sequence[float] = (),
    start: Stored | None = None,
) -> bytes:
    """The bytes of a file that holds everything but frames.

    It is made in memory and written by plain file I/O, since a full disk is then an ordinary exception.
    """
    with h5py.File(f"{run_id}.image", "w", driver="core", backing_store=False, libver="earliest") as file:
        h5md = file.create_group("h5md")
        h5md.attrs["version"] = np.array([1, 1], dtype="i4")
        h5md.create_group("author").attrs["name"] = author
        creator = h5md.create_group("creator")
        creator.attrs["name"] = "kickdrift"
        creator.attrs["version"] = versions()["kickdrift"]
        _particles(file.create_group(TRAJECTORY), system, flush_frames)
        file.create_group("observables")
        own = file.create_group("kickdrift")
        own.attrs["schema"] = SCHEMA
        own.attrs["run_id"] = run_id
        own.attrs["every"] = every
        own.create_dataset("committed", data=np.zeros(2, dtype="i8"), track_times=False)  # frames, samples
        own.create_dataset("closed", data=np.zeros(1, dtype="i1"), track_times=False)
        own.create_dataset("plan", data=np.array(plan or [np.nan] * PLAN_NUMBERS), track_times=False)
        _units(own.create_group("units"), system.units)
        text(own, "method", to_json(method))
        text(own, "versions", to_json(versions()))
        _system(own.create_group("system"), system)
        samples = file.create_group(SAMPLES)
        new_series(samples, "step", (), "i8")
        new_series(samples, "time", (), "f8")
        checkpoints.new_table(file)
        if start is not None:
            checkpoints.Table(file, "").add(start)
        file.flush()
        return bytes(file.id.get_file_image())


def _particles(group: h5py.Group, system: System, flush_frames: int) -> None:
    n = len(system)
    chunk = frame_chunk(n, flush_frames)
    position = group.create_group("position")
    step = new_series(position, "step", (), "i8")
    time = new_series(position, "time", (), "f8")
    time.attrs["unit"] = "ps"
    velocity = group.create_group("velocity")
    for element, unit in ((position, "Angstrom"), (velocity, "Angstrom ps-1")):
        value = element.create_dataset(
            "value", (0, n, 3), "f8", maxshape=(None, n, 3), chunks=chunk, fillvalue=np.nan, track_times=False
        )
        value.attrs["unit"] = unit
    velocity["step"], velocity["time"] = step, time  # hard links: one clock for everything that a frame holds
    box = group.create_group("box")
    box.attrs["dimension"] = 3
    box.attrs["boundary"] = np.array([b"periodic" if system.box.periodic else b"none"] * 3)
    if system.box.periodic:
        # One row for each frame although the box is fixed: MDAnalysis reads no other form.
        edges = box.create_group("edges")
        new_series(edges, "value", (3,), "f8").attrs["unit"] = "Angstrom"
        edges["step"], edges["time"] = step, time
    names = {name: index for index, name in enumerate(system.species)}
    kind = h5py.enum_dtype(names, basetype="i4")
    group.create_dataset("species", data=system.species_index.astype("i4"), dtype=kind, track_times=False)
    mass = group.create_dataset("mass", data=system.state.masses, track_times=False)
    mass.attrs["unit"] = system.units.mass
    group.create_dataset("id", data=system.state.ids, track_times=False)


def _units(group: h5py.Group, units: UnitSystem) -> None:
    for key, value in asdict(units).items():
        if value is not None:
            group.attrs[key] = value
    factors = FileUnits.of(units)
    group.attrs["nominal"] = factors.nominal
    group.attrs["length_factor"] = factors.length
    group.attrs["time_factor"] = factors.time


def _system(group: h5py.Group, system: System) -> None:
    text(group, "source", system.source)
    text(group, "record", to_json(record_of(system)))
    group.create_dataset("phase", data=system.state.phase, track_times=False)


def box_of(group: h5py.Group) -> Box:
    """The box in the system's own units, from the ``kickdrift`` group."""
    lengths = json.loads(group["system/record"].asstr()[()])["box"]
    return Box(None if lengths is None else tuple(lengths))

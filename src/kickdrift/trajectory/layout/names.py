"""Names, units, chunk shapes, first bytes and kind of a run's file; ``docs/file-format.md`` has the whole format."""

import hashlib
import platform
from collections.abc import Mapping, Sequence
from dataclasses import asdict
from functools import cache
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Any

import h5py
import numpy as np

from kickdrift.errors import InputError
from kickdrift.integrators.options import FULL, coupling_of
from kickdrift.looks.columns import KNOWN
from kickdrift.model.changing import empty_rows
from kickdrift.model.molecules.topology import SIZES
from kickdrift.model.system import System
from kickdrift.model.units.file_units import FileUnits
from kickdrift.model.units.unit_systems import DIMENSIONS, UnitSystem
from kickdrift.trajectory.file.opening import created
from kickdrift.trajectory.layout import checkpoints, checksums
from kickdrift.trajectory.layout.checkpoints import Stored
from kickdrift.trajectory.layout.edges import shape_of
from kickdrift.trajectory.layout.options import FileOptions
from kickdrift.trajectory.layout.record import record_of, to_json

SCHEMA = 2  # schema 1 had no checkpoints and no plan
SUFFIX = ".h5md"
TRAJECTORY = "particles/trajectory"
SAMPLES = "kickdrift/samples"
EVENTS = "kickdrift/events"
KIND_BYTES, DONE_BYTES = 64, 160  # fixed lengths of an event's texts, so that rows survive a kill; longer texts are cut
NEW_NAMES = "new_names"  # dataset of the names of bodies that collisions have added
PLAN_NUMBERS = 7  # of a `run.plan.Plan`, before its times
EVENT_WIDTH = 6 + (KIND_BYTES + DONE_BYTES) // 8  # length of an event's row, in numbers of 8 bytes
CHUNK_BYTES = 128 * 1024  # size of a chunk of positions or velocities: a few dozen frames of some of the particles
SERIES_CHUNK = 512  # rows in a chunk of a series with one row for each frame or sample

UNIT_KEYS = (
    "name", "length", "time", "mass", "energy", "temperature", "boltzmann", "gravity", "light", "coherent_mass",
    "nominal", "length_factor", "time_factor", "force_factor",
)  # fmt: skip


def observable_unit(name: str, units: UnitSystem) -> str:
    """Physical unit of one of kickdrift's own observables, as text; empty if unknown."""
    dimension = KNOWN[name].unit if name in KNOWN else name.replace("_", " ")
    return units.unit(dimension) if dimension in DIMENSIONS else ""


def frame_chunk(n: int, flush_frames: int, row_bytes: int = 24) -> tuple[int, int, int]:
    """Chunk shape of (frames, n, 3) values, ``row_bytes`` for each particle and frame.

    A chunk spans many frames, so that reading one particle's path is cheap, but no more frames than one write holds.
    Its few particles make up CHUNK_BYTES, so that reading one frame is cheap too.
    """
    frames = max(32, CHUNK_BYTES // (row_bytes * n))
    frames = max(1, min(frames, flush_frames, CHUNK_BYTES // row_bytes))
    chunks = -(-n // max(1, CHUNK_BYTES // (row_bytes * frames)))
    return frames, -(-n // chunks), 3  # so that the last chunk is nearly full


@cache
def versions() -> dict[str, str]:
    """Versions of the packages that determine a run's bits, and the kind of machine. Imports nothing."""
    found = {"python": platform.python_version(), "machine": platform.machine()}
    for package in ("kickdrift", "numpy", "numba", "llvmlite", "h5py"):
        try:
            found[package] = version(package)
        except PackageNotFoundError:
            found[package] = "not installed"
    return found


def new_series(
    group: h5py.Group,
    name: str | None,
    shape: tuple[int, ...],
    dtype: str,
    rows: int | None = None,
    chunk: Sequence[int] | None = None,
) -> h5py.Dataset:
    """Create an empty dataset that grows along its first axis; unwritten floats read as NaN. A dataset without a name
    lies in the file unlinked until it is given one."""
    fill = np.nan if dtype in ("f4", "f8") else None
    chunks = (rows or SERIES_CHUNK, *(shape if chunk is None else chunk))
    return group.create_dataset(
        name, (0, *shape), dtype, maxshape=(None, *shape), chunks=chunks, fillvalue=fill, track_times=False
    )


def _events(file: h5py.File) -> None:
    """Create the empty table of events."""
    group = file.create_group(EVENTS)
    new_series(group, "step", (), "i8")
    new_series(group, "ids", (2,), "i8")
    for name in ("time", "distance", "energy"):
        new_series(group, name, (), "f8")
    new_series(group, "kind", (), f"S{KIND_BYTES}")
    new_series(group, "done", (), f"S{DONE_BYTES}")


def add_text(group: h5py.Group, name: str, value: str) -> None:
    """Write a scalar string as a dataset, since HDF5's first format limits an attribute to 64 kB."""
    group.create_dataset(name, data=value, dtype=h5py.string_dtype(), track_times=False)


def header_image(
    system: System,
    *,
    method: dict[str, Any],
    every: int,
    run_id: str,
    author: str,
    flush_frames: int,
    options: FileOptions,
    plan: Sequence[float] = (),
    start: Stored | None = None,
) -> bytes:
    """Bytes of a file that holds everything but frames.

    The file is made in memory and written by plain file I/O, so that a full disk is an ordinary exception.
    """
    with image(run_id) as file:
        committed = new_counts(file)
        _particles(file, system, flush_frames, options, free=coupling_of(method) == FULL)
        _connectivity(file, system)
        h5md = file.create_group("h5md")
        h5md.attrs["version"] = np.array([1, 1], dtype="i4")
        h5md.create_group("author").attrs["name"] = author
        creator = h5md.create_group("creator")
        creator.attrs["name"] = "kickdrift"
        creator.attrs["version"] = versions()["kickdrift"]
        file.create_group("observables")
        own = new_run(file, committed, run_id=run_id, every=every, compress=options.compress, plan=plan)
        _units(own.create_group("units"), system.units)
        add_method(own, method)
        _system(own.create_group("system"), system)
        own.attrs["sha256"] = run_hash(file)
        new_samples(file)
        vectors = [name for name in checksums.VECTORS if name in file[TRAJECTORY]]
        block = file[TRAJECTORY]["position/value"].chunks[1]
        checksums.new_group(file, len(system), block, vectors)
        checkpoints.new_table(file, start)
        file.flush()
        return bytes(file.id.get_file_image())


def image(run_id: str) -> h5py.File:
    """A file in memory, to be written whole."""
    return created(f"{run_id}.image", driver="core", backing_store=False, libver="earliest")


def new_counts(file: h5py.File) -> h5py.Dataset:
    """Numbers of whole frames, samples and events. Made first, and so inside one page, as they must be to change in one
    write."""
    return file.create_dataset(None, data=np.zeros(3, dtype="i8"), track_times=False)


def new_run(
    file: h5py.File, committed: h5py.Dataset, *, run_id: str, every: int, compress: bool, plan: Sequence[float]
) -> h5py.Group:
    """The group of the run itself, with its counts and its plan."""
    own = file.create_group("kickdrift")
    own.attrs["schema"] = SCHEMA
    own.attrs["run_id"] = run_id
    own.attrs["every"] = every
    own.attrs["compress"] = compress
    own["committed"] = committed
    own.create_dataset("closed", data=np.zeros(1, dtype="i1"), track_times=False)
    add_plan(own, plan or [np.nan] * PLAN_NUMBERS)
    return own


def add_plan(own: h5py.Group, plan: Sequence[float]) -> None:
    """Write the plan of the last call of ``run``, in place of another one."""
    if "plan" in own:
        del own["plan"]
    own.create_dataset("plan", data=np.array(plan), track_times=False)


def add_method(own: h5py.Group, method: dict[str, Any]) -> None:
    """Write facts about the Simulation, the versions of all programs, and room for the report."""
    add_text(own, "method", to_json(method))
    add_text(own, "versions", to_json(versions()))
    new_series(own, "report", (), "u1", rows=CHUNK_BYTES // 8)


def new_samples(file: h5py.File) -> None:
    """The samples' clock and the table of events, empty."""
    samples = file.create_group(SAMPLES)
    new_series(samples, "step", (), "i8")
    new_series(samples, "time", (), "f8")
    _events(file)


def _particles(file: h5py.File, system: System, flush_frames: int, options: FileOptions, free: bool) -> None:
    n = len(system)
    # Both begin in the file's first page, so that they grow in one write: MDAnalysis counts frames by the positions and
    # ends a loop by the steps.
    first = {"step": new_series(file, None, (), "i8"), "position": _vectors(file, n, options.dtype, flush_frames)}
    group = file.create_group(TRAJECTORY)
    position = group.create_group("position")
    position["step"], position["value"] = first["step"], first["position"]
    clock = {"step": first["step"], "time": new_series(position, "time", (), "f8")}
    clock["time"].attrs["unit"] = "ps"
    vectors = {"position": ("Angstrom", options.dtype), "velocity": ("Angstrom ps-1", options.dtype)}
    if "forces" in options.write:
        vectors["force"] = FileUnits.of(system.units).force_unit, options.dtype
    if "images" in options.write:
        if not system.box.periodic:
            raise InputError("write: images need a periodic box; this box is open")
        vectors["image"] = "", "i4"
    for name, (unit, dtype) in vectors.items():
        element = group.require_group(name)
        if "value" not in element:
            element["value"] = _vectors(file, n, dtype, flush_frames)
        if unit:
            element["value"].attrs["unit"] = unit
        _link(element, clock)
    box = group.create_group("box")
    box.attrs["dimension"] = 3
    box.attrs["boundary"] = np.array([b"periodic" if there else b"none" for there in system.box.periodic_axes])
    if system.box.periodic:
        # A row for each frame although the box is fixed: MDAnalysis reads no other form.
        edges = box.create_group("edges")
        new_series(edges, "value", shape_of(system.box, free), "f8").attrs["unit"] = "Angstrom"
        _link(edges, clock)
    names = {name: index for index, name in enumerate(system.species)}
    kind = h5py.enum_dtype(names, basetype="i4")
    group.create_dataset("species", data=system.species_index.astype("i4"), dtype=kind, track_times=False)
    mass = group.create_dataset("mass", data=system.state.masses, track_times=False)
    mass.attrs["unit"] = system.units.mass
    if system.charges is not None:
        charge = group.create_dataset("charge", data=system.charges, track_times=False)
        charge.attrs["unit"] = system.units.charge
    group.create_dataset("id", data=system.state.ids, track_times=False)


def _connectivity(file: h5py.File, system: System) -> None:
    """Write H5MD's lists of bonds, angles and dihedrals, by the particles' ids, for other programs."""
    if system.topology is None:
        return
    group = file.create_group("connectivity")
    for kind in SIZES:
        if len(items := getattr(system.topology, kind)):
            made = group.create_dataset(kind, data=system.state.ids[items], track_times=False)
            made.attrs["particles_group"] = "trajectory"  # H5MD has a reference here, which no file of kickdrift holds


def _vectors(file: h5py.File, n: int, dtype: str, flush_frames: int) -> h5py.Dataset:
    """Create the dataset (f, n, 3) of a vector, without a name."""
    rows, *rest = frame_chunk(n, flush_frames, 3 * np.dtype(dtype).itemsize)
    return new_series(file, None, (n, 3), dtype, rows, rest)


def _link(element: h5py.Group, clock: Mapping[str, h5py.Dataset]) -> None:
    """Make hard links, so that everything in a frame shares one clock."""
    for key, series in clock.items():
        if key not in element:
            element[key] = series


def _units(group: h5py.Group, units: UnitSystem) -> None:
    for key, value in asdict(units).items():
        if value is not None:
            group.attrs[key] = value
    factors = FileUnits.of(units)
    group.attrs["nominal"] = factors.nominal
    group.attrs["length_factor"] = factors.length
    group.attrs["time_factor"] = factors.time
    group.attrs["force_factor"] = factors.force


def _system(group: h5py.Group, system: System) -> None:
    add_text(group, "source", system.source)
    add_text(group, "record", to_json(record_of(system)))
    group.create_dataset("phase", data=system.state.phase, track_times=False)
    if room := empty_rows(system):
        group.create_dataset(NEW_NAMES, data=np.zeros(room, f"S{KIND_BYTES}"), track_times=False)
    group.attrs["sha256"] = system_hash(group.file)


def system_hash(file: h5py.File) -> str:
    """SHA-256, in hexadecimal digits, of the System that the file's run began with.

    The hash covers, in this order: the text of ``kickdrift/system/record``, UTF-8; the little-endian bytes of
    ``kickdrift/system/phase`` (float64), and of ``mass`` (float64), ``id`` (int64) and ``species`` (int32) of the
    particles, and ``charge`` (float64) if there are charges. ``kickdrift/system`` holds the hash as its attribute
    ``sha256`` from the file's beginning on.
    """
    own, particles = file["kickdrift/system"], file[TRAJECTORY]
    found = hashlib.sha256(own["record"].asstr()[()].encode())
    arrays = (
        (own["phase"], "<f8"),
        (particles["mass"], "<f8"),
        (particles["id"], "<i8"),
        (particles["species"], "<i4"),
        *([(particles["charge"], "<f8")] if "charge" in particles else []),
    )
    for data, dtype in arrays:
        found.update(data[()].astype(dtype).tobytes())
    return found.hexdigest()


def run_hash(file: h5py.File) -> str:
    """SHA-256, in hexadecimal digits, of everything that the file states once and that determines the run's numbers.

    The hash covers, in this order: the texts of ``system/record``, ``system/source``, ``method`` and ``versions`` of
    ``kickdrift``; for each key of UNIT_KEYS that is an attribute of ``kickdrift/units``, the key and its value, a text
    or a float64; ``every`` (int64); ``boundary`` of the box; the names of the species in the order of their numbers;
    the attribute ``unit`` of the masses; the checksums (`checksums.sums_of_array`) of ``system/phase``, ``mass``,
    ``id`` and ``species``; the attribute ``unit`` and the checksum of ``charge``, if there are charges. Texts are
    UTF-8, each followed by a zero byte; numbers are little-endian. ``kickdrift`` holds the hash as its attribute
    ``sha256`` from the file's beginning on.
    """
    own, particles = file["kickdrift"], file[TRAJECTORY]
    found = hashlib.sha256()

    def add(value: Any) -> None:
        found.update(hashed(value))

    for name in ("system/record", "system/source", "method", "versions"):
        add(own[name].asstr()[()])
    units = own["units"].attrs
    for key in UNIT_KEYS:
        if key in units:
            add(key)
            add(units[key])
    found.update(np.array(own.attrs["every"], "<i8").tobytes())
    for value in particles["box"].attrs["boundary"]:
        add(value)
    names = h5py.check_enum_dtype(particles["species"].dtype)
    for name in sorted(names, key=names.__getitem__):
        add(name)
    add(particles["mass"].attrs["unit"])
    for data in (own["system/phase"], particles["mass"], particles["id"], particles["species"]):
        found.update(checksums.sums_of_array(data[()]).astype("<u8").tobytes())
    if "charge" in particles:
        add(particles["charge"].attrs["unit"])
        found.update(checksums.sums_of_array(particles["charge"][()]).astype("<u8").tobytes())
    return found.hexdigest()


def hashed(value: Any) -> bytes:
    """A text or a number as a hash takes it."""
    value = value.decode() if isinstance(value, bytes) else value
    return value.encode() + b"\0" if isinstance(value, str) else np.array(value, "<f8").tobytes()


def check_kind(path: Path, file: h5py.File) -> None:
    """Raise InputError if this is not the file of a run, or has another schema; the error names the kind of file."""
    if "kickdrift/problem" in file:
        raise InputError(f"{path}: is the file of a Problem's run, which has no particles")
    if "table" in file and "columns" in file.attrs:
        raise InputError(f"{path}: is the table of an ensemble, which kd.Ensemble.read opens")
    if "h5md" not in file:
        raise InputError(f"{path}: is an HDF5 file but not H5MD: it has no group 'h5md'")
    if "kickdrift" not in file:
        creator = file.get("h5md/creator")
        name = creator.attrs.get("name", "another program") if creator is not None else "another program"
        name = name.decode() if isinstance(name, bytes) else name
        raise InputError(
            f"{path}: is an H5MD file written by {name}; it has no group 'kickdrift' to tell forces, units and method"
        )
    check_schema(path, file)


def check_schema(path: Path, file: h5py.File) -> None:
    """Raise InputError if the file has another schema."""
    schema = int(file["kickdrift"].attrs["schema"])
    if schema > SCHEMA:
        raise InputError(f"{path}: was written by a newer kickdrift (schema {schema}; this one reads {SCHEMA})")
    if schema < SCHEMA:
        raise InputError(f"{path}: was written by an older kickdrift (schema {schema}; this one reads {SCHEMA})")

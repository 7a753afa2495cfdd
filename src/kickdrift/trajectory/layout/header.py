"""Header of a run's file, checked: particles, units, method, and the number of whole rows."""

import re
from dataclasses import dataclass, fields
from typing import Any, NamedTuple

import h5py
import numpy as np
from numpy.typing import NDArray

from kickdrift.looks.columns import KNOWN
from kickdrift.model.box.box import Box
from kickdrift.model.state import Floats
from kickdrift.model.system import System
from kickdrift.model.units.unit_systems import UnitSystem
from kickdrift.text import shown
from kickdrift.trajectory.layout import edges, stored
from kickdrift.trajectory.layout.checksums import CHECKSUMS, VECTORS
from kickdrift.trajectory.layout.contents import Contents
from kickdrift.trajectory.layout.names import (
    DONE_BYTES,
    EVENTS,
    KIND_BYTES,
    NEW_NAMES,
    PLAN_NUMBERS,
    SAMPLES,
    TRAJECTORY,
    observable_unit,
)
from kickdrift.trajectory.layout.options import FileOptions

EVENT_COLUMNS: dict[str, tuple[str, tuple[int, ...]]] = {  # in the order of their checksum
    "time": ("f8", ()),
    "step": ("i8", ()),
    "ids": ("i8", (2,)),
    "distance": ("f8", ()),
    "energy": ("f8", ()),
    "kind": (f"S{KIND_BYTES}", ()),
    "done": (f"S{DONE_BYTES}", ()),
}
SHAPES = {name: column.shape for name, column in KNOWN.items()}  # shapes of known observables
EXTRAS = {"force": "forces", "image": "images"}  # groups of the frames, and their names in options
CLOCK = (("step", "i8"), ("time", "f8"))
_TEXTS = ("name", "length", "time", "mass", "energy", "temperature")  # attributes of the units
# A power of a number or a very long text: a program that parses units would take for ever.
_COSTLY = re.compile(r"[\d)]\s*(?:\^|\*\*)|\d{4}|.{61}", re.DOTALL)


class Committed(NamedTuple):
    """Number of whole rows."""

    frames: int
    samples: int
    events: int


@dataclass(frozen=True, kw_only=True)
class Outline:
    """Information that a writer needs to add rows to a file. A Problem's file has no vectors, and so no frames."""

    units: UnitSystem
    box: Box
    ids: NDArray[np.int64]
    options: FileOptions
    committed: Committed
    vectors: tuple[str, ...]  # groups of the frames, in the order of VECTORS
    observables: tuple[str, ...]

    @property
    def growing(self) -> dict[str, list[str]]:
        """Datasets with a row for each frame, sample and event, by the names of their checksums."""
        clock = [key for key, _ in CLOCK]
        frames = [f"{TRAJECTORY}/position/{key}" for key in clock]
        frames += [f"{TRAJECTORY}/{name}/value" for name in self.vectors]
        frames += [edges.EDGES] if self.box.periodic else []
        frames += [f"observables/{name}/value" for name in self.observables]
        return {
            "frame": frames if self.vectors else [],
            "sample": [f"{SAMPLES}/{name}" for name in (*clock, *self.observables)],
            "event": [f"{EVENTS}/{name}" for name in EVENT_COLUMNS],
        }


@dataclass(frozen=True, kw_only=True)
class Header(Outline):
    """Checked header of a run's file; `Run` describes the public attributes."""

    run_id: str
    every: int
    species: tuple[str, ...]
    species_index: NDArray[np.int32]
    masses: Floats
    charges: Floats | None
    names: tuple[str, ...]
    source: str
    record: dict[str, Any]
    method: dict[str, Any]
    versions: dict[str, Any]
    packed: bool
    report: dict[str, Any] | None
    half_written: dict[str, int]


def outline_of(system: System, options: FileOptions) -> Outline:
    """Outline of a new file, made without reading its header."""
    return Outline(
        units=system.units,
        box=system.box,
        ids=system.state.ids,
        options=options,
        committed=Committed(0, 0, 0),
        vectors=tuple(name for name in VECTORS if name in VECTORS[:2] or EXTRAS.get(name) in options.write),
        observables=(),
    )


def read(contents: Contents) -> Header:
    """Read the header. Raises an InputError that says what is wrong."""
    own, particles = "kickdrift", TRAJECTORY
    record = stored.read(contents, f"{own}/system/record", stored.RecordText)
    species, index = _species(contents)
    n = len(index)
    masses = contents.array(f"{particles}/mass", "f8", (n,))
    charges = contents.array(f"{particles}/charge", "f8", (n,)) if contents.has(f"{particles}/charge") else None
    ids = contents.array(f"{particles}/id", "i8", (n,))
    _check_particles(contents, record, species, index, ids)
    frames, samples, events = counts = contents.array(f"{own}/committed", "i8", (3,)).tolist()
    if min(counts) < 0:
        raise contents.damaged(f"{own}/committed: expected three counts, got {counts}")
    vectors = tuple(name for name in VECTORS if name in VECTORS[:2] or contents.has(f"{particles}/{name}"))
    values = [_vectors(contents, name, frames, n) for name in vectors]
    for key, kind in CLOCK:
        contents.series(f"{particles}/position/{key}", kind, frames)
    box = edges.box_of(contents, record["box"])
    if box.periodic:
        contents.series(edges.EDGES, "f8", frames, edges.shape_in(contents, box))
    series = [sampled(contents, key, samples) for key, _ in CLOCK]
    contents.dataset(f"{own}/system/phase", "f8", (2, 3, n))
    closed = bool(contents.array(f"{own}/closed", "i1", (1,))[0])
    with contents.guarded(f"{particles}/position/value"):
        packed = values[0].compression is not None
    return Header(
        run_id=contents.attribute(own, "run_id", str),
        every=contents.attribute(own, "every", int),
        units=units_of(contents),
        box=box,
        species=species,
        species_index=index,
        masses=masses,
        charges=charges,
        names=_names(contents, record),
        ids=ids,
        source=contents.text(f"{own}/system/source"),
        record=record,
        method=stored.read(contents, f"{own}/method", stored.MethodText),
        versions=stored.read(contents, f"{own}/versions", stored.VersionsText),
        options=FileOptions(
            store="float32" if values[0].dtype.itemsize == 4 else "float64",
            compress=contents.attribute(own, "compress", bool),
            write=tuple(name for group, name in EXTRAS.items() if group in vectors),
        ),
        packed=packed,
        report=report_of(contents) if closed else None,
        committed=Committed(frames, samples, events),
        half_written={
            "frames": values[0].shape[0] - frames,
            "samples": series[0].shape[0] - samples,
            "events": event_column(contents, "step", events).shape[0] - events,
        },
        vectors=vectors,
        observables=_observables(contents),
    )


def units_of(contents: Contents) -> UnitSystem:
    """Unit system that a file states; this version need not know its name."""
    name, values = "kickdrift/units", {}
    attributes = contents.group(name).attrs
    for key in (field.name for field in fields(UnitSystem)):
        with contents.guarded(name):
            there = key in attributes
        if there or key in _TEXTS or key == "boltzmann":
            values[key] = contents.attribute(name, key, str if key in _TEXTS else float)
            if key in _TEXTS and _COSTLY.search(values[key]):
                raise contents.damaged(f"{name}: {key}: {shown(values[key])} is not a unit")
    return UnitSystem(**values)


def _species(contents: Contents) -> tuple[tuple[str, ...], NDArray[np.int32]]:
    """Names of the species, and the index (n,) of each particle's species."""
    name = f"{TRAJECTORY}/species"
    data = contents.dataset(name, "i4", (None,))
    with contents.guarded(name):
        named = h5py.check_enum_dtype(data.dtype) or {}
        index = data[()].astype(np.int32)
    species = tuple(sorted(named, key=named.__getitem__))
    if not len(index):
        raise contents.damaged(f"{name} holds no particle")
    if sorted(named.values()) != list(range(len(named))) or not 0 <= index.min() <= index.max() < len(named):
        raise contents.damaged(f"{name}: its numbers do not match its {len(named)} names")
    return species, index


def _names(contents: Contents, record: dict[str, Any]) -> tuple[str, ...]:
    """Names of the bodies, if any. Bodies that collisions have added have their names in a table of its own."""
    names, room = list(record.get("names", ())), record.get("room", 0)
    if not (names and room):
        return tuple(names)
    new = contents.array(f"kickdrift/system/{NEW_NAMES}", f"S{KIND_BYTES}", (room,)).tolist()
    known = [name.decode(errors="ignore") for name in new]
    first = len(names) - room
    return (*names[:first], *(name or old for name, old in zip(known, names[first:], strict=True)))


def _check_particles(
    contents: Contents, record: dict[str, Any], species: tuple[str, ...], index: NDArray, ids: NDArray
) -> None:
    """Check that all places say the same about the particles."""
    n = len(index)
    for key, found in (("names", record.get("names") or ids), ("radii", record.get("radii") or ids)):
        if len(found) != n:
            raise contents.damaged(f"kickdrift/system/record: {len(found)} {key} for {n} particles")
    if record.get("room", 0) >= n:
        raise contents.damaged(f"kickdrift/system/record: room for {record['room']} of {n} particles")
    if record["particles"] != n:
        raise contents.damaged(f"kickdrift/system/record: {record['particles']} particles, but {n} have a species")
    if sorted(record["species"]) != sorted(species):
        raise contents.damaged(f"kickdrift/system/record: its species differ from {TRAJECTORY}/species")
    if len(np.unique(ids)) != n:
        raise contents.damaged(f"{TRAJECTORY}/id: two particles have the same id")


def _vectors(contents: Contents, name: str, frames: int, n: int) -> h5py.Dataset:
    return contents.series(f"{TRAJECTORY}/{name}/value", "i4" if name == "image" else "f8 f4", frames, (n, 3))


def report_of(contents: Contents) -> dict[str, Any]:
    """The report of a run that has ended."""
    name = "kickdrift/report"
    data = contents.array(name, "u1", (None,))
    with contents.guarded(name):
        text = data.tobytes().decode()
    return stored.checked(contents, contents.parsed(text, name), stored.ReportText, name)


def _observables(contents: Contents) -> tuple[str, ...]:
    """Names of the run's observables; series of other programs are ignored.

    A file with checksums names its observables. In an older file they are the growing series of samples and frames.
    """
    if contents.has(CHECKSUMS):
        return named(contents)
    return tuple(name for name in contents.names(SAMPLES) if name not in dict(CLOCK) and _ours(contents, name))


def shape_of(contents: Contents, name: str) -> tuple[int, ...]:
    """Shape of an observable."""
    data = contents.anything(f"{SAMPLES}/{name}")
    with contents.guarded(f"{SAMPLES}/{name}"):
        shape = tuple(data.shape[1:])
    if shape != SHAPES.get(name, shape):
        raise contents.damaged(f"{SAMPLES}/{name} has rows of {shape}; expected {SHAPES[name]}")
    return shape


def unit_of(contents: Contents, name: str, units: UnitSystem) -> str:
    """Unit of an observable as text: the system's unit, or the file's own for a column of the user."""
    place = f"{SAMPLES}/{name}"
    if name in KNOWN or not contents.has(place):
        return observable_unit(name, units)
    with contents.guarded(place):
        there = "unit" in contents.anything(place).attrs
    return str(contents.attribute(place, "unit", str)) if there else ""


def sampled(contents: Contents, name: str, samples: int) -> h5py.Dataset:
    """Series of an observable, or the clock, at the samples."""
    if name in dict(CLOCK):
        return contents.series(f"{SAMPLES}/{name}", dict(CLOCK)[name], samples)
    return contents.series(f"{SAMPLES}/{name}", "f8", samples, shape_of(contents, name))


def framed(contents: Contents, name: str, frames: int) -> h5py.Dataset:
    """Series of an observable at the frames."""
    return contents.series(f"observables/{name}/value", "f8", frames, shape_of(contents, name))


def event_column(contents: Contents, name: str, events: int) -> h5py.Dataset:
    kind, shape = EVENT_COLUMNS[name]
    return contents.series(f"{EVENTS}/{name}", kind, events, shape)


def named(contents: Contents) -> tuple[str, ...]:
    """Observables that the checksums cover, in order."""
    group = contents.group(CHECKSUMS)
    with contents.guarded(CHECKSUMS):
        if "observables" not in group.attrs:
            return ()
        names = group.attrs["observables"]
        found = tuple(each.decode() if isinstance(each, bytes) else str(each) for each in np.ravel(names))
    if any(not name or "/" in name or name in dict(CLOCK) for name in found) or len(set(found)) < len(found):
        raise contents.damaged(f"{CHECKSUMS}: its observables have invalid names")
    return found


def _ours(contents: Contents, name: str) -> bool:
    """Tell whether a series of samples grows and is also a series of frames, as kickdrift writes observables."""
    with contents.guarded(f"{SAMPLES}/{name}"):
        data, group = contents.file[SAMPLES][name], contents.file["observables"].get(name)
        grows = isinstance(data, h5py.Dataset) and data.maxshape is not None and data.maxshape[:1] == (None,)
        return grows and data.dtype == "f8" and isinstance(group, h5py.Group) and "value" in group


def plan_numbers(contents: Contents) -> list[float]:
    """Numbers of the last plan (see `run.plan.Plan`); empty if unknown."""
    name = "kickdrift/plan"
    if not contents.has(name):
        return []
    stored = contents.array(name, "f8", (None,))
    if len(stored) < PLAN_NUMBERS:
        raise contents.damaged(f"{name} has {len(stored)} numbers; expected {PLAN_NUMBERS} or more")
    numbers: list[float] = stored.tolist()
    if np.isnan(numbers[0]):
        return []
    begin_step, begin_time, end_step, end_time, every, interval, exact, *times = numbers
    whole = all(0 <= number < 2**63 and number == round(number) for number in (begin_step, end_step, every))
    whole = whole and begin_step <= end_step
    timely = np.isfinite(begin_time) and not np.isnan(end_time)
    ends = [abs(time) for time in (begin_time, end_time) if np.isfinite(time)]
    even = interval == 0.0 or (np.isfinite(interval) and interval > 1e-15 * max(ends))
    apart = np.diff(times) if end_time >= begin_time else -np.diff(times)
    rising = bool(np.isfinite(times).all()) and bool((apart > 0).all()) and times[-1:] in ([], [end_time])
    if not (whole and timely and even and rising and exact in (0.0, 1.0)):
        raise contents.damaged(f"{name}: {numbers[:PLAN_NUMBERS]} is not the plan of a run")
    return numbers

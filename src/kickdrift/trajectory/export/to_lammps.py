"""The last chosen frame of a run as a LAMMPS data file, which read_data, MDAnalysis, ASE and system files read."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from kickdrift.disk.kinds import LAMMPS_HEADING
from kickdrift.errors import InputError
from kickdrift.forces.external.lammps_data import DataFile, flags_of
from kickdrift.model.molecules.relatives import molecules_of
from kickdrift.model.molecules.topology import SIZES
from kickdrift.model.state import Floats
from kickdrift.trajectory.export.formats import REMOVED_LEFT_OUT, Chosen, Format, Placed
from kickdrift.trajectory.read.universe import topology_of

UNITS = ("lj", "metal", "real", "si")  # LAMMPS has the same
MARGIN = 0.01  # of the particles' extent, around them along an open axis


def write(chosen: Chosen, path: Path, format: Format, progress: Callable[[int, int], None]) -> list[str]:
    """Write the frame and return notes about what was lost."""
    run, (frame,) = chosen.run, chosen
    there = np.asarray(np.isfinite(frame.positions).all(axis=1))
    notes = [f"the file holds frame {frame.number} alone, step {frame.step}"]
    if not there.all():
        notes.append(f"bodies that were removed are {REMOVED_LEFT_OUT}")
    if run.units.name not in UNITS:
        notes.append(f"LAMMPS has no units of {run.units.length}, {run.units.mass} and {run.units.time}")
    plane = run.system_record.get("dimensions") == 2
    if plane:
        notes.append("LAMMPS needs 'dimension 2'")
    open_axes = [not there for there in frame.box.periodic_axes[: 2 if plane else 3]]
    if any(open_axes):
        words = " ".join("pf"[axis] for axis in [*open_axes, False][:3])
        notes.append(f"LAMMPS needs 'boundary {words}'; along open axes the box has the particles' extent")
    if (found := np.flatnonzero(there & (run.masses <= 0))).size:
        raise InputError(f"{chosen.who(frame, int(found[0]))} has no mass, and LAMMPS needs one")
    data = _content(chosen, frame, there)
    with path.open("w", encoding="utf-8") as file:
        file.writelines(data.lines())
    progress(1, 1)
    return notes


def _content(chosen: Chosen, frame: Placed, there: NDArray[np.bool_]) -> DataFile:
    run, n = chosen.run, len(chosen.run.ids)
    kinds, which = np.unique(np.column_stack([run.species_index, run.masses]), axis=0, return_inverse=True)
    topology = topology_of(run)
    lists, counts, names = {}, {}, {}
    for kind in SIZES:
        if topology is not None and len(items := getattr(topology, kind)):
            types = Numbered.of(topology.types(kind))
            lists[kind] = np.column_stack([types.numbers, items + 1])
            counts[kind], names[kind] = types.most, types.names
    molecules = np.arange(n) if topology is None else molecules_of(topology.bonds, n)
    boxed = topology is not None and run.box.periodic and not chosen.unwrapped
    return DataFile(
        heading=f"{LAMMPS_HEADING}: step {frame.step}, time {frame.time:.10g}, units {run.units.name}",
        bounds=_bounds(frame, frame.positions[there]),
        tilts=frame.box.tilts,
        masses=kinds[:, 1].tolist(),
        labels=[run.species[int(kind)] for kind in kinds[:, 0]],
        ids=np.flatnonzero(there) + 1,
        types=which.reshape(-1)[there] + 1,
        molecules=molecules[there] + 1,
        positions=frame.positions[there],
        velocities=frame.velocities[there],
        lists=lists,
        counts=counts,
        names=names,
        images=_flags(frame, there, molecules) if boxed else None,
        charges=None if run.charges is None else run.charges[there],
    )


def _flags(frame: Placed, there: NDArray[np.bool_], molecules: NDArray[np.int64]) -> NDArray[np.int64]:
    some = frame._replace(positions=frame.positions[there], unwrapped=frame.unwrapped[there])
    return flags_of(some.images, molecules[there])


def _bounds(frame: Placed, x: Floats) -> Floats:
    """The box, and the particles' extent along open axes."""
    margin = np.maximum(MARGIN * np.ptp(x, axis=0), 0.5)
    open_space = np.column_stack([x.min(axis=0) - margin, x.max(axis=0) + margin])
    edges = np.column_stack([np.zeros(3), np.diag(frame.box.matrix)])
    return np.where(np.array(frame.box.periodic_axes)[:, None], edges, open_space)


class Numbered(NamedTuple):
    """Types of items as numbers from 1: their own numbers where all are such, else in the order of their names."""

    numbers: NDArray[np.int64]
    most: int
    names: Sequence[str]

    @classmethod
    def of(cls, types: Sequence[str]) -> Numbered:
        if all(name.isascii() and name.isdigit() and 0 < int(name) <= len(types) for name in set(types)):
            numbers = np.array([int(name) for name in types], np.int64)
            return cls(numbers, int(numbers.max()), ())
        names = list(dict.fromkeys(types))
        place = {name: k for k, name in enumerate(names, 1)}
        return cls(np.array([place[name] for name in types], np.int64), len(names), names)

"""Reading a run's file: `open` gives a Run, the sequence of its frames."""

from __future__ import annotations

import json
import os
from dataclasses import fields
from pathlib import Path
from types import TracebackType
from typing import TYPE_CHECKING, Any, Self

import h5py
import numpy as np
from numpy.typing import NDArray

from kickdrift.errors import InputError
from kickdrift.state import Floats
from kickdrift.trajectory.checkpoints import CHECKPOINTS, Table
from kickdrift.trajectory.frames import EnergySeries, Frames, energies_of
from kickdrift.trajectory.layout import EVENTS, SAMPLES, SCHEMA, TRAJECTORY, FileUnits, box_of, system_hash
from kickdrift.trajectory.options import FileOptions
from kickdrift.units import UnitSystem

if TYPE_CHECKING:
    from kickdrift.system import System


class Run(Frames):
    """A run's file, open for reading: a context manager, and the sequence of all its frames.

    Everything is in the system's own units, whatever unit the file names for the sake of other programs. Observables
    are those of the samples, which are at least as dense as the frames; ``run[:]`` has them at the frames.

    Attributes
    ----------
    path : Path
    run_id : str
    every : int
        Steps between samples.
    units : UnitSystem
    nominal_units : bool
        Whether the file's angstrom and ps stand for a length and time unit that other programs do not know.
    box : Box
    species : tuple of str
    species_index : (n,) int32 into `species`
    names : tuple of str
        Of the bodies, where they have any.
    masses : (n,) float64
    ids : (n,) int64
    system_source : str
        The text of the system file, empty where there was none.
    system_record, method, versions : dict
    options : FileOptions
        How the file is written; of ``flush`` it says nothing.
    packed : bool
        Whether frames are compressed, as they are once a run that was asked for it has ended.
    report : dict or None
        What the run reported at its end; None if it did not reach it.
    """

    def __init__(self, path: str | os.PathLike[str]) -> None:
        self.path = Path(path)
        self._handle = _open_file(self.path)
        try:
            self._read_header()
        except (KeyError, OSError, RuntimeError, ValueError) as error:
            self.close()
            if isinstance(error, InputError):
                raise
            raise InputError(f"{self.path}: damaged: {error}") from None

    def _read_header(self) -> None:
        file = self._file
        _check_kind(self.path, file)
        own, particles = file["kickdrift"], file[TRAJECTORY]
        self.run_id = str(own.attrs["run_id"])
        self.every = int(own.attrs["every"])
        self.units = unit_system_of(own)
        self._factors = FileUnits.of(self.units)
        self.nominal_units = self._factors.nominal
        self.box = box_of(own)
        species = particles["species"]
        names = h5py.check_enum_dtype(species.dtype) or {}
        self.species = tuple(sorted(names, key=names.__getitem__))
        self.species_index: NDArray[np.int32] = species[()].astype(np.int32)
        self.masses: Floats = particles["mass"][()]
        self.ids: NDArray[np.int64] = particles["id"][()]
        self.system_source = str(own["system/source"].asstr()[()])
        self.system_record: dict[str, Any] = json.loads(own["system/record"].asstr()[()])
        self.names: tuple[str, ...] = tuple(self.system_record.get("names", ()))
        self.method: dict[str, Any] = json.loads(own["method"].asstr()[()])
        self.versions: dict[str, str] = json.loads(own["versions"].asstr()[()])
        extras = {"forces": "force", "images": "image"}
        dtype = particles["position/value"].dtype
        self.options = FileOptions(
            precision="float32" if dtype == np.float32 else "float64",
            compress=bool(own.attrs["compress"]),
            write=tuple(name for name, group in extras.items() if group in particles),
        )
        self.packed = particles["position/value"].compression is not None
        self.closed = bool(own["closed"][0])
        self.report: dict[str, Any] | None = json.loads(own["report"][()].tobytes()) if self.closed else None
        # What a kill left behind the last commit may be part of a row; it does not count.
        frames, samples, self._events = (int(rows) for rows in own["committed"][()])
        super().__init__(None, range(frames))
        self._samples = samples
        self.half_written = {
            "frames": max(0, particles["position/value"].shape[0] - frames),
            "samples": max(0, own["samples/step"].shape[0] - samples),
            "events": max(0, own["events/step"].shape[0] - self._events),
        }
        self.all_steps: NDArray[np.int64] = particles["position/step"][:frames]
        self.all_times: Floats = particles["position/time"][:frames] / self._factors.time

    def __repr__(self) -> str:
        return f"<Run {self.path}: {len(self)} frames of {len(self.ids)} particles>"

    @property
    def _file(self) -> h5py.File:
        if not self._handle:
            raise InputError(f"{self.path}: is closed; read it inside of its with block")
        return self._handle

    def vectors(self, what: str, frames: slice, particles: slice = slice(None)) -> Floats:
        """(f, n, 3) unwrapped "positions", "velocities" or "forces" of some frames and particles, read at once; an
        InputError for forces that the run did not write."""
        name, factor = {
            "positions": ("position", self._factors.length),
            "velocities": ("velocity", self._factors.velocity),
            "forces": ("force", self._factors.force),
        }[what]
        group = self._file[TRAJECTORY]
        if name not in group:
            raise InputError(f"{self.path}: holds no {what}; a run writes them where it is asked to")
        start, stop, step = frames.indices(len(self))
        values: Floats = group[name]["value"][start:stop:step, particles].astype(np.float64, copy=False)
        if factor != 1.0:
            values = values / factor
        if what == "positions" and self.box.lengths and "images" in self.options.write:
            values += group["image/value"][start:stop:step, particles] * np.array(self.box.lengths)
        return values

    def framed(self, frames: slice) -> dict[str, Floats]:
        """Every observable as an array (f,) or (f, …) at some frames."""
        group = self._file["observables"]
        return {name: group[name]["value"][frames] for name in group if len(self)}

    @property
    def unchanged(self) -> bool:
        """Whether the system in the file is the one that its run began with, by its hash."""
        return bool(self._file["kickdrift/system"].attrs.get("sha256") == system_hash(self._file))

    @property
    def exact(self) -> bool:
        """Whether positions and velocities are those of the run to the last bit."""
        real = self._factors.length == self._factors.time == 1.0
        return real and self.options.precision == "float64" and "images" not in self.options.write

    @property
    def observables(self) -> dict[str, Floats]:
        """Every observable as an array (s,) or (s, …), at `sample_steps` and `sample_times`."""
        names = [name for name in self._file[SAMPLES] if name not in ("step", "time")]
        return {name: self._sampled(name) for name in names if self._samples}

    @property
    def events(self) -> list[dict[str, Any]]:
        """What `Simulation.events` of the run had: kind, time, step, bodies, ids, distance, energy, done.

        Close approaches that had not ended with the run come last."""
        found: list[dict[str, Any]] = []
        columns = {name: data[: self._events].tolist() for name, data in self._file[EVENTS].items()}
        for k in range(self._events):
            row = {name: values[k] for name, values in columns.items()}
            ids = [each for each in row["ids"] if each >= 0]
            found.append(
                {
                    "kind": row["kind"].decode(errors="ignore"),
                    "time": row["time"],
                    "step": row["step"],
                    "bodies": [self._body(each) for each in ids],
                    "ids": ids,
                    "distance": None if np.isnan(row["distance"]) else row["distance"],
                    "energy": None if np.isnan(row["energy"]) else row["energy"],
                    "done": row["done"].decode(errors="ignore"),
                }
            )
        return found + list((self.report or {}).get("events", ()))

    def _body(self, id_: int) -> str:
        place = np.flatnonzero(self.ids == id_)
        return self.names[int(place[0])] if self.names and place.size else f"particle {id_}"

    @property
    def sample_steps(self) -> NDArray[np.int64]:
        return self._sampled("step")

    @property
    def sample_times(self) -> Floats:
        return self._sampled("time")

    @property
    def energies(self) -> EnergySeries:
        """Kinetic, potential and total energy at `sample_times`; an InputError if they were not written."""
        return energies_of(self, self.sample_times, self.observables)

    def to_pandas(self) -> Any:
        """A pandas DataFrame: a row for each sample, with step, time and every observable (``momentum_x``, …).

        Units are in ``attrs["units"]``, by column. An InputError where pandas is not installed.
        """
        from kickdrift.trajectory.tables import data_frame

        return data_frame(self, self.sample_steps, self.sample_times, self.observables)

    def to_xarray(self) -> Any:
        """An xarray Dataset of all that was written over time, with units as attributes.

        Positions and velocities (frame, particle, axis), masses and species (particle), and every observable
        (sample, …) at the coordinates sample_step and sample_time. An InputError where xarray is not installed.
        """
        from kickdrift.trajectory.tables import dataset

        series = {name: ("sample", values) for name, values in self.observables.items()}
        clock = {"sample_step": self.sample_steps, "sample_time": self.sample_times}
        return dataset(self, self, series, clock)

    def system(self) -> System:
        """The System that the run was given, from the file alone; ``run[k].system()`` is that at a frame."""
        from kickdrift.trajectory.record import system_of

        return system_of(self)

    def _sampled(self, name: str) -> NDArray:
        return self._file[SAMPLES][name][: self._samples]

    @property
    def checkpoints(self) -> Table | None:
        """What the run can be taken up again from; None in a file that has none."""
        return Table(self._file, self.path) if CHECKPOINTS in self._file else None

    @property
    def plan(self) -> list[float]:
        """The numbers of the `run_plan.Plan` of the last run into this file; empty where it is not known."""
        numbers = self._file["kickdrift/plan"][()].tolist() if "kickdrift/plan" in self._file else [np.nan]
        return [] if np.isnan(numbers[0]) else numbers

    @property
    def initial_phase(self) -> Floats:
        """(2, 3, n) positions and velocities of the System that the run was given."""
        return self._file["kickdrift/system/phase"][()]

    def universe(self) -> Any:
        """An MDAnalysis Universe of this file, with names, types and masses; nominal units where the file's are."""
        from kickdrift.trajectory.universe import universe

        return universe(self)

    def close(self) -> None:
        self._handle.close()

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()


def unit_system_of(own: h5py.Group) -> UnitSystem:
    """The unit system that a file states, which need not be one that this version knows by name."""
    stored = own["units"].attrs
    values: dict[str, Any] = {}
    for key in (field.name for field in fields(UnitSystem) if field.name in stored):
        values[key] = stored[key] if isinstance(stored[key], str) else float(stored[key])
    return UnitSystem(**values)


def _open_file(path: Path) -> h5py.File:
    if not path.exists():
        raise InputError(f"{path}: no such file")
    if path.is_dir():
        raise InputError(f"{path}: is a folder, not a file")
    try:
        return h5py.File(path, "r", locking="best-effort")
    except BlockingIOError:
        raise InputError(f"{path}: a run is writing to it at this moment; it can be read when that is over") from None
    except PermissionError:
        raise InputError(f"{path}: no permission to read it") from None
    except OSError as error:
        if "truncated file" in str(error):
            raise InputError(f"{path}: is truncated: its end is missing (copied in part?)") from None
        if not h5py.is_hdf5(path):
            raise InputError(f"{path}: is not an HDF5 file") from None
        raise InputError(f"{path}: cannot be read: {error}") from None


def _check_kind(path: Path, file: h5py.File) -> None:
    if "h5md" not in file:
        raise InputError(f"{path}: is an HDF5 file but not H5MD: it has no group 'h5md'")
    if "kickdrift" not in file:
        creator = file.get("h5md/creator")
        name = creator.attrs.get("name", "another program") if creator is not None else "another program"
        name = name.decode() if isinstance(name, bytes) else name
        raise InputError(
            f"{path}: is an H5MD file written by {name}; it has no group 'kickdrift' to tell forces, units and method"
        )
    schema = int(file["kickdrift"].attrs["schema"])
    if schema > SCHEMA:
        raise InputError(f"{path}: was written by a newer kickdrift (schema {schema}; this one reads {SCHEMA})")
    if schema < SCHEMA:
        raise InputError(f"{path}: was written by an older kickdrift (schema {schema}; this one reads {SCHEMA})")


def open(path: str | os.PathLike[str]) -> Run:
    """A run's file as a Run; the InputError of a file that is none says what it is instead."""
    return Run(path)

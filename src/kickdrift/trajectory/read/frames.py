"""A frame of a run's file, and sequences of frames. Values are read on demand."""

from __future__ import annotations

from collections.abc import Sequence
from copy import copy
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any, NamedTuple, overload
from warnings import warn

import numpy as np
from numpy.typing import NDArray

from kickdrift.errors import InputError
from kickdrift.forces.around.spins import SPINS
from kickdrift.forces.beside.columns import with_values
from kickdrift.forces.beside.unknowns import UNKNOWNS, names_in
from kickdrift.looks.observers import Energies
from kickdrift.model.box.box import Box
from kickdrift.model.state import Floats, State
from kickdrift.model.system import System

if TYPE_CHECKING:
    from kickdrift.trajectory.layout.run_parts import RunFile

_ENERGIES = ("kinetic_energy", "potential_energy", "total_energy")


class EnergySeries(NamedTuple):
    """Energies at some times, each of shape (s,), in the system's units."""

    time: Floats
    kinetic: Floats
    potential: Floats
    total: Floats


class FrameSystem(System):
    """System of a frame, which may be called as in version 0.2, where ``system`` was a method."""

    @classmethod
    def of(cls, system: System) -> FrameSystem:
        """The same System as one that may be called."""
        made = copy(system)
        object.__setattr__(made, "__class__", cls)
        return made  # type: ignore[return-value]

    def __call__(self) -> System:
        """Return the System itself; removed in 0.4."""
        warn("frame.system() is deprecated since 0.3; use frame.system", DeprecationWarning, stacklevel=2)
        return self


@dataclass(frozen=True, repr=False)
class Frame:
    """One frame of a Run, read on demand, in the system's units."""

    _run: RunFile
    index: int

    def __repr__(self) -> str:
        return f"<Frame {self.index}: step {self.step}, time {self.time:g}>"

    @property
    def step(self) -> int:
        self._run.check_clock(range(self.index, self.index + 1))
        return int(self._run.all_steps[self.index])

    @property
    def time(self) -> float:
        self._run.check_clock(range(self.index, self.index + 1))
        return float(self._run.all_times[self.index])

    @property
    def positions(self) -> Floats:
        """Unwrapped positions, shape (n, 3)."""
        return self._alone.positions[0]

    @property
    def velocities(self) -> Floats:
        """Velocities, shape (n, 3)."""
        return self._alone.velocities[0]

    @property
    def forces(self) -> Floats:
        """Forces, shape (n, 3). Raises InputError if the run did not write them."""
        return self._alone.forces[0]

    @property
    def energies(self) -> Energies:
        """Kinetic, potential and total energy."""
        _, kinetic, potential, total = self._alone.energies
        return Energies(float(kinetic[0]), float(potential[0]), float(total[0]))

    @property
    def box(self) -> Box:
        return self._alone.boxes[0]

    def wrapped(self) -> Floats:
        """Positions inside the box, shape (n, 3)."""
        return self.box.wrap(self.positions)

    @property
    def state(self) -> State:
        """State for a Simulation of the same bodies: ``sim.state = run[k].state``."""
        phase = np.array([self.positions.T, self.velocities.T])
        own = self._run.masses.copy(), self._run.ids.copy()
        return replace(State(phase, *own, self.box, self.time, self.step), **self._beside)  # type: ignore[arg-type]

    @property
    def _beside(self) -> dict[str, Floats]:
        """Spins (3, n) and unknowns (k,) beside the bodies, as a State holds them, where the run has them."""
        found = self._run.framed(slice(self.index, self.index + 1))
        values, spins = {}, found.get(SPINS)
        if spins is not None and spins.shape[1:] == (len(self._run.ids), 3):
            values[SPINS] = spins[0].T.copy()
        rows = [found.get(name) for name in names_in(self._run.system_record)]
        if rows and all(row is not None and row.shape == (1,) for row in rows):
            values[UNKNOWNS] = np.concatenate(rows)  # type: ignore[arg-type]
        return values

    @property
    def system(self) -> System:
        """System for a new run from this frame's positions, velocities, box and time, with no steps done.

        Forces, units, masses, names, events and run defaults are the file's. The System has no equilibration and no
        [invariants], which are of the run's start, and a seed of its own. Raises InputError if the file alone is not
        enough: a force's module is not loaded, or bodies have merged or left before this frame.
        """
        from kickdrift.trajectory.layout.record import system_of

        self._run.refuse_changed()
        system, values = system_of(self._run, self.index), self._beside
        return FrameSystem.of(with_values(system, values) if values else system)

    @property
    def _alone(self) -> Frames:
        return Frames(self._run, range(self.index, self.index + 1))


class Frames(Sequence[Frame]):
    """Frames of a run in the order of their numbers ``rows``. A slice of Frames is Frames too.

    Values are read on demand: ``run[::100].positions`` reads every hundredth frame at once.
    """

    def __init__(self, of: RunFile | None, rows: range) -> None:
        self._of, self._rows = of, rows

    @property
    def _run(self) -> RunFile:
        """Return the Run. A Run holds no reference to itself, so its file closes when the last user drops the Run."""
        return self if self._of is None else self._of  # type: ignore[return-value]

    def __repr__(self) -> str:
        return f"<{len(self)} of {self._run!r}>"

    def __len__(self) -> int:
        return len(self._rows)

    @overload
    def __getitem__(self, index: int) -> Frame: ...
    @overload
    def __getitem__(self, index: slice) -> Frames: ...
    def __getitem__(self, index: int | slice) -> Frame | Frames:
        if isinstance(index, slice):
            return Frames(self._run, self._rows[index])
        if not -len(self) <= index < len(self):
            raise IndexError(f"frame {index} of {len(self)}")
        return Frame(self._run, self._rows[index])

    @property
    def run(self) -> RunFile:
        """The Run that holds these frames."""
        return self._run

    @property
    def rows(self) -> range:
        """Numbers of these frames in the run."""
        return self._rows

    @property
    def steps(self) -> NDArray[np.int64]:
        """Step of each frame, shape (f,)."""
        self._run.check_clock(self._rows)
        return self._run.all_steps[as_slice(self._rows)]

    @property
    def times(self) -> Floats:
        """Time of each frame, shape (f,)."""
        self._run.check_clock(self._rows)
        return self._run.all_times[as_slice(self._rows)]

    @property
    def time(self) -> Floats:
        """Same as `times`, under the name that a single frame uses."""
        return self.times

    @property
    def positions(self) -> Floats:
        """Unwrapped positions, shape (f, n, 3)."""
        return self._vectors("positions")

    @property
    def velocities(self) -> Floats:
        """Velocities, shape (f, n, 3)."""
        return self._vectors("velocities")

    @property
    def forces(self) -> Floats:
        """Forces, shape (f, n, 3). Raises InputError if the run did not write them."""
        return self._vectors("forces")

    @property
    def boxes(self) -> list[Box]:
        """Box of each frame."""
        found = self._run.boxes_of(_forward(self._rows))
        return found[::-1] if self._rows.step < 0 else found

    def path_of(self, particle: int) -> Floats:
        """Unwrapped positions (f, 3) of the particle in this row; no other particle is read."""
        n = len(self._run.ids)
        if not 0 <= particle < n:
            raise InputError(f"particle {particle}: expected a number from 0 to {n - 1}")
        return self._vectors("positions", slice(particle, particle + 1))[:, 0]

    @property
    def observables(self) -> dict[str, Floats]:
        """Every observable at these frames, shape (f,) or (f, …)."""
        return {name: self._forth(values) for name, values in self._run.framed(as_slice(_forward(self._rows))).items()}

    @property
    def energies(self) -> EnergySeries:
        """Kinetic, potential and total energy at these frames. Raises InputError if they were not written."""
        return energies_of(self._run, self.times, self.observables)

    def to_pandas(self) -> Any:
        """A pandas DataFrame with a row for each frame: step, time and every observable (``momentum_x``, …).

        The unit of each column is in ``attrs["units"]``. Raises InputError if pandas is not installed.
        """
        from kickdrift.trajectory.read.tables import data_frame

        return data_frame(self._run, self.steps, self.times, self.observables)

    def to_xarray(self) -> Any:
        """An xarray Dataset of the frames, with units as attributes.

        Positions and velocities have dimensions (frame, particle, axis), masses and species (particle), and observables
        (frame, …). Coordinates are step and time. Raises InputError if xarray is not installed.
        """
        from kickdrift.trajectory.read.tables import dataset

        return dataset(self._run, self, {name: ("frame", values) for name, values in self.observables.items()})

    def _vectors(self, what: str, particles: slice = slice(None)) -> Floats:
        return self._forth(self._run.vectors(what, as_slice(_forward(self._rows)), particles))

    def _forth(self, values: Floats) -> Floats:
        """Put values that were read in ascending order into the order of these frames."""
        return values[::-1] if self._rows.step < 0 else values


def energies_of(run: RunFile, times: Floats, observables: dict[str, Floats]) -> EnergySeries:
    """Energies among the observables. Raises InputError if they are missing."""
    if missing := [name for name in _ENERGIES if name not in observables]:
        raise InputError(f"{run.path}: holds no {missing[0]}")
    return EnergySeries(times, *(observables[name] for name in _ENERGIES))


def _forward(rows: range) -> range:
    """The same rows in ascending order: HDF5 reads no other order."""
    return rows if rows.step > 0 else rows[::-1]


def as_slice(rows: range) -> slice:
    """Slice that selects these rows of an array; its end is None where a number would be negative."""
    if not rows:
        return slice(0, 0)
    return slice(rows.start, rows.stop if rows.stop >= 0 else None, rows.step)

"""Table of looks: compiled code fills one row for each look, and Samples are made from the rows."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from kickdrift.errors import InputError, RunError
from kickdrift.looks import columns as column
from kickdrift.looks.observers import NOTHING, Energies, Sample, Taken, observables_of
from kickdrift.model.checks.limits import check_room
from kickdrift.model.state import Floats

FIRST_ROOM = 1024  # rows at first
SAMPLE_BYTES = 1000  # memory of a look at particles, with its Sample
COUNTED = 2**16  # rows between two checks of memory


class Looks:
    """The looks of a run, in order of time.

    Attributes
    ----------
    count : number of filled rows
    steps : (room,) step of each look
    rows : (room, COLUMNS) numbers, in the columns of ``looks.columns``; nan for a value that does not exist
    """

    def __init__(self, room: int = 0) -> None:
        self.count = 0
        self.steps: NDArray[np.int64] = np.zeros(room, np.int64)
        self.rows: Floats = np.zeros((room, column.COLUMNS))
        self._columns: dict[int, Mapping[str, Any]] = {}  # the user's columns, by row
        self._samples: list[Sample] = []  # Samples of the first rows; the others are made on demand
        self._shared = False  # whether a caller holds the filled rows

    def __len__(self) -> int:
        return self.count

    def free(self, count: int = 1) -> int:
        """Return the index of the next row to fill, with room for ``count`` rows."""
        if self.count + count > len(self.steps):
            more = max(FIRST_ROOM, self.count, count)
            self.steps = np.concatenate([self.steps[: self.count], np.zeros(more, np.int64)])
            self.rows = np.concatenate([self.rows[: self.count], np.zeros((more, column.COLUMNS))])
            self._shared = False
        return self.count

    def keep(self, step: int, taken: Taken = NOTHING) -> None:
        """Count the row that was just filled, with events' losses so far.

        A look at the same step and time as the last look replaces that look. Raises RunError if memory is full."""
        k = self.count
        self.steps[k] = step
        if taken is not NOTHING:
            self.take(k, taken)
        if self.at(step, float(self.rows[k, column.TIME])):
            self._own()
            self.rows[k - 1] = self.rows[k]
            del self._samples[k - 1 :]
        else:
            self.keep_next([step])

    def keep_next(self, steps: Sequence[int] | NDArray[np.int64]) -> None:
        """Count looks at new steps, in a run whose events took nothing."""
        before, self.count = self.count, self.count + len(steps)
        self.steps[before : self.count] = steps
        if self.count // COUNTED > before // COUNTED:  # the number of looks in an adaptive run is unknown beforehand
            try:
                check_samples(self.count, "every or interval")
            except InputError as error:
                at = f"{self.steps[self.count - 1]} (t = {self.rows[self.count - 1, column.TIME]:.6g})"
                raise RunError(f"stopped at step {at}: {error}") from None

    def take(self, row: int, taken: Taken) -> None:
        """Write events' losses so far into a row."""
        numbers = self.rows[row]
        numbers[column.ENERGY_TAKEN] = taken.energy
        numbers[column.MOMENTUM_TAKEN : column.ANGULAR_TAKEN] = taken.momentum
        numbers[column.ANGULAR_TAKEN :] = taken.angular_momentum

    def retake(self, taken: Taken) -> None:
        """Update the last look after an event at its step."""
        self._own()
        self.take(self.count - 1, taken)
        del self._samples[self.count - 1 :]

    def note(self, columns: Mapping[str, Any]) -> None:
        """Store the values of the user's columns at the last look."""
        self._columns[self.count - 1] = columns
        del self._samples[self.count - 1 :]

    def at(self, step: int, time: float) -> bool:
        """Tell whether the last look was at this step and time."""
        k = self.count - 1
        return k >= 0 and self.steps[k] == step and self.rows[k, column.TIME] == time

    def fill(self, sample: Sample) -> None:
        """Write a Sample into the next row: a Sample of a Problem, of another program, or from a file."""
        free = self.free()
        row = self.rows[free]
        row[:] = np.nan
        row[column.TIME] = sample.time
        row[_ENERGIES] = sample.energies
        for own in column.NUMBERS:
            row[own.place] = getattr(sample, own.name)
        row[column.PAIRS] = np.nan if sample.pairs is None else sample.pairs
        for own in column.VECTORS:
            value = getattr(sample, own.name)
            row[own.place : own.place + 3] = np.nan if value is None else value
        row[column.ENERGY_TAKEN :] = 0.0

    def add(self, sample: Sample) -> None:
        """Fill and count a row from a Sample."""
        self.fill(sample)
        self.keep(sample.step, sample.taken)
        if sample.columns:
            self.note(sample.columns)

    @property
    def samples(self) -> list[Sample]:
        """All looks as Samples: always the same list, which grows."""
        made = self._samples
        made += [self._sample(k) for k in range(len(made), self.count)]
        return made

    def _sample(self, k: int) -> Sample:
        row = self.rows[k].copy()
        pairs = row[column.PAIRS]
        taken = NOTHING
        if row[column.ENERGY_TAKEN :].any():
            lost = row[column.MOMENTUM_TAKEN : column.ANGULAR_TAKEN], row[column.ANGULAR_TAKEN :]
            taken = Taken(float(row[column.ENERGY_TAKEN]), *lost)
        rest: dict[str, Any] = {own.name: float(row[own.place]) for own in column.NUMBERS}
        for own in column.VECTORS:
            vector = row[own.place : own.place + 3]
            rest[own.name] = None if vector[0] != vector[0] and np.isnan(vector).all() else vector
        return Sample(
            step=int(self.steps[k]),
            time=float(row[column.TIME]),
            energies=Energies(*row[_ENERGIES].tolist()),
            pairs=None if np.isnan(pairs) else int(pairs),
            taken=taken,
            columns=self._columns.get(k, {}),
            **rest,
        )

    @property
    def total(self) -> float:
        """Total energy at the last look."""
        return float(self.rows[self.count - 1, column.TOTAL])

    @property
    def columns(self) -> Mapping[str, Any]:
        """Values of the user's columns at the last look."""
        return self._columns.get(self.count - 1, {})

    def observables(self, index: int, taken: bool = False) -> dict[str, float | Floats]:
        """Return ``Sample.observables`` of a look without making a Sample; vectors are views."""
        return observables_of(self.rows[index], taken)

    def held(self) -> tuple[NDArray[np.int64], Floats]:
        """Return steps and rows of the looks so far; these arrays do not change later."""
        self._shared = True
        return self.steps[: self.count], self.rows[: self.count]

    def _own(self) -> None:
        """Copy the rows if a caller holds them."""
        if self._shared:
            self.rows, self._shared = self.rows.copy(), False


_ENERGIES = [column.KINETIC, column.POTENTIAL, column.TOTAL]


def check_samples(count: float, key: str) -> None:
    """Refuse more looks than fit into memory; ``key`` names the option that sets their number."""
    check_room("run", count, "samples", SAMPLE_BYTES, f"give a larger {key}")

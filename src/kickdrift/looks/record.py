"""What a run keeps of its looks and its cost, and the looks side by side."""

from __future__ import annotations

from dataclasses import dataclass, field, fields
from typing import Any, NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

from kickdrift.errors import InputError
from kickdrift.looks import columns as column
from kickdrift.looks.observers import NOTHING, Sample, Taken
from kickdrift.looks.table import Looks
from kickdrift.model.checks import unwarned
from kickdrift.model.event_log import is_row
from kickdrift.model.memory import Memory, by_value
from kickdrift.model.state import Floats


class Series(NamedTuple):
    """A run's samples side by side.

    Attributes
    ----------
    steps, times : (k,) of the looks
    total : (k,) total energy with what events took out; nan of a Problem that names none
    final : the last total energy, without that
    kinetic : the first kinetic energy; nan of a Problem
    momentum, angular_momentum : (k, 3) with what events took out; None of a Problem
    temperature, pressure, pairs : means; nan, and None, where they mean nothing
    """

    steps: NDArray[np.int64]
    times: Floats
    total: Floats
    final: float
    kinetic: float
    momentum: Floats | None
    angular_momentum: Floats | None
    temperature: float = float("nan")
    pressure: float = float("nan")
    pairs: float | None = None


def even_stretch(steps: NDArray[np.int64]) -> slice:
    """The longest stretch of looks an equal number of steps apart."""
    gaps = np.diff(steps)
    if not len(gaps):
        return slice(None)
    edges = np.flatnonzero(np.diff(gaps)) + 1
    starts, ends = np.concatenate([[0], edges]), np.concatenate([edges, [len(gaps)]])
    longest = int(np.argmax(ends - starts))
    return slice(int(starts[longest]), int(ends[longest]) + 1)


class Counted(Protocol):
    """Evaluations of f and of its Jacobian, and steps that were thrown away."""

    evaluations: int
    rejected: int
    jacobians: int


@dataclass
class Record:
    """The looks at a run since conservation is counted from, and what it cost."""

    looks: Looks = field(default_factory=Looks, compare=False)
    begun: bool = False  # whether the scales are known
    momentum_scale: float = 0.0  # sum of m |v| at the first sample
    angular_momentum_scale: float = 0.0  # sum of m |x × v| there
    steps: int = 0
    rejected_steps: int = 0
    force_evaluations: int = 0
    jacobian_evaluations: int = 0
    wall_seconds: float = 0.0
    compile_seconds: float = 0.0
    warnings: list[str] = field(default_factory=list)
    events: list[dict[str, Any]] = field(default_factory=list)
    taken: Taken = NOTHING

    def count(self, cost: Counted) -> None:
        """Add what some steps cost."""
        self.force_evaluations += cost.evaluations
        self.jacobian_evaluations += cost.jacobians
        self.rejected_steps += cost.rejected

    def take(self, before: Sample, after: Sample) -> None:
        """An event changed what is conserved."""
        self.taken = Taken(
            self.taken.energy + before.energies.total - after.energies.total,
            self.taken.momentum + _lost(before.momentum, after.momentum),
            self.taken.angular_momentum + _lost(before.angular_momentum, after.angular_momentum),
        )

    @unwarned
    def begin(self, masses: Floats, phase: Floats) -> None:
        """What momenta are compared with."""
        x, v = phase
        self.begun = True
        self.momentum_scale = float(masses @ np.linalg.norm(v, axis=0))
        self.angular_momentum_scale = float(masses @ np.linalg.norm(np.cross(x.T, v.T), axis=1))

    @property
    def samples(self) -> list[Sample]:
        """All that was seen at each look."""
        return self.looks.samples

    def memory(self) -> Memory:
        """All but the looks, by value."""
        kept = {key.name: by_value(getattr(self, key.name)) for key in fields(self) if key.name != "looks"}
        return kept | {"taken": None if self.taken is NOTHING else kept["taken"]}

    @classmethod
    def recalled(cls, memory: Memory) -> Record:
        """The record that had this memory; without samples. An InputError where the memory, which may come from a file,
        holds something else."""
        kept, fresh = by_value(memory), cls()
        for key, value in kept.items():
            kind = type(getattr(fresh, key, None))
            if key != "taken" and not isinstance(value, (int, float) if kind in (int, float) else kind):
                raise InputError(f"checkpoint: record.{key} does not fit a run of this system")
        if not all(isinstance(line, str) for line in kept["warnings"]) or not all(map(is_row, kept["events"])):
            raise InputError("checkpoint: its warnings or events are invalid")
        return cls(**(kept | {"taken": NOTHING if kept["taken"] is None else Taken(*kept["taken"])}))

    def series(self) -> Series:
        """The looks side by side; later ones do not change it."""
        steps, rows = self.looks.held()
        first, known = rows[0], ~np.isnan(rows[:, column.PAIRS])
        return Series(
            steps=steps,
            times=rows[:, column.TIME],
            total=rows[:, column.TOTAL] + rows[:, column.ENERGY_TAKEN],
            final=float(rows[-1, column.TOTAL]),
            kinetic=float(first[column.KINETIC]),
            momentum=_vectors(rows, column.MOMENTUM, column.MOMENTUM_TAKEN),
            angular_momentum=_vectors(rows, column.ANGULAR, column.ANGULAR_TAKEN),
            temperature=float(rows[:, column.TEMPERATURE].mean()),
            pressure=float(rows[:, column.PRESSURE].mean()),
            pairs=float(rows[known, column.PAIRS].mean()) if known.any() else None,
        )


def _vectors(rows: Floats, first: int, taken: int) -> Floats | None:
    """(k, 3) with what events took out, of the looks that have that; None where none has."""
    values = rows[:, first : first + 3]
    there = ~np.isnan(values).all(axis=1)
    return (values + rows[:, taken : taken + 3])[there] if there.any() else None


def _lost(before: Floats | None, after: Floats | None) -> Floats | float:
    return 0.0 if before is None or after is None else before - after

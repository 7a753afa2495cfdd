"""Record of a run: its looks, its cost, and series of the looks."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field, fields
from time import perf_counter
from typing import Any, NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

from kickdrift.errors import InputError
from kickdrift.jit.cache.notices import machine_code
from kickdrift.looks import columns as column
from kickdrift.looks.observers import NOTHING, Looks, Sample, Taken
from kickdrift.model.checks.values import unwarned
from kickdrift.model.event_log import is_row
from kickdrift.model.memory import Memory, by_value
from kickdrift.model.state import Floats

# Parts of the work whose wall time a record keeps. Compiled code that steps and looks cannot tell these apart.
STEPPING, LOOKS, BOTH, WRITING, OBSERVING = "stepping", "looks", "stepping and looks", "writing", "observing"


Stretch = slice | NDArray[np.int64]


class Series(NamedTuple):
    """A run's samples as arrays.

    Attributes
    ----------
    steps, times : (k,) steps and times of the looks
    total : (k,) total energy, with the energy that events took out; nan for a Problem without energy
    final : the last total energy, without the energy that events took out
    kinetic : the first kinetic energy; nan for a Problem
    momentum, angular_momentum : (k, 3), with the momentum that events took out; None for a Problem
    temperature, pressure, pairs : means; undefined ones are nan, and None for pairs
    kinetics : (k,) kinetic energy; nan for a Problem
    temperatures, pressures, volumes : (k,) None if a sample has none; volumes of a box that a barostat changes. The
        first pressure of hard spheres is nan
    taken : (k,) energy that events had taken out, or minus the heat and the work that bath and barostat had given
    even : the `even_looks`, if they are known
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
    kinetics: Floats | float = float("nan")
    temperatures: Floats | None = None
    taken: Floats | float = 0.0
    pressures: Floats | None = None
    volumes: Floats | None = None
    even: Stretch | None = None


def even_stretch(steps: NDArray[np.int64]) -> slice:
    """Return the longest stretch of looks that are equally many steps apart."""
    gaps = np.diff(steps)
    if not len(gaps):
        return slice(None)
    edges = np.flatnonzero(np.diff(gaps)) + 1
    starts, ends = np.concatenate([[0], edges]), np.concatenate([edges, [len(gaps)]])
    longest = int(np.argmax(ends - starts))
    return slice(int(starts[longest]), int(ends[longest]) + 1)


def on_grid(steps: NDArray[np.int64], times: Floats) -> NDArray[np.bool_]:
    """Tell of each look whether its time is in proportion to its step, unlike a look after a shortened step."""
    counts, apart = steps - steps[0], np.abs(times - times[0])
    later = counts > 0
    if not later.any():
        return np.ones(len(steps), bool)
    lengths = np.sort(apart[later] / counts[later])
    step = 0.5 * float(lengths[(len(lengths) - 1) // 2] + lengths[len(lengths) // 2])  # np.median's
    rounding = 8.0 * float(np.finfo(float).eps) * float(np.abs(times).max() + apart.max())
    return np.asarray(np.abs(apart - counts * step) <= 1e-6 * step + rounding)


def even_looks(steps: NDArray[np.int64], times: Floats) -> Stretch:
    """Return the index of the looks in the longest stretch of looks that are equally long apart."""
    whole = on_grid(steps, times)
    if whole.all():
        return even_stretch(steps)
    return np.flatnonzero(whole)[even_stretch(steps[whole])]


class Counted(Protocol):
    """Counts of evaluations of f and of its Jacobian, and of rejected steps."""

    evaluations: int
    rejected: int
    jacobians: int


@dataclass
class Record:
    """The looks at a run since its record began, and the cost."""

    looks: Looks = field(default_factory=Looks, compare=False)
    begun: bool = False  # whether the momentum scales are set
    from_start: bool = False  # whether it begins at the System's own positions
    momentum_scale: float = 0.0  # sum of m |v| at the first sample
    angular_momentum_scale: float = 0.0  # sum of m |x × v| there
    steps: int = 0
    rejected_steps: int = 0
    force_evaluations: int = 0
    jacobian_evaluations: int = 0
    wall_seconds: float = 0.0
    compile_seconds: float = 0.0
    backward: bool = False  # whether the run goes back in time
    unfinished: float = 0.0  # time between the current time and the end of a shortened step's whole step
    spent: dict[str, float] = field(default_factory=dict)  # seconds by part of the work; see ``spend``
    warnings: list[str] = field(default_factory=list)
    events: list[dict[str, Any]] = field(default_factory=list)
    equilibrated: str = ""  # how the run was equilibrated before its record began
    taken: Taken = NOTHING
    work: float = 0.0  # energy that the change of the box has given
    hits: list[float] = field(default_factory=list)  # time and virial of the hits at the last look, of hard spheres

    def count(self, cost: Counted) -> None:
        """Add the cost of some steps."""
        self.force_evaluations += cost.evaluations
        self.jacobian_evaluations += cost.jacobians
        self.rejected_steps += cost.rejected

    def spend(self, part: str, seconds: float) -> None:
        """Add wall time to a part of the work: a constant of this module."""
        self.spent[part] = self.spent.get(part, 0.0) + seconds

    @contextmanager
    def spending(self, part: str) -> Iterator[None]:
        """Add the wall time of this context to a part of the work, without that of compiling, which counts apart."""
        began, before = perf_counter(), machine_code.seconds
        yield
        made = machine_code.seconds - before
        self.compile_seconds += made
        self.spend(part, perf_counter() - began - made)

    def take(self, lost: Taken) -> None:
        """Add what an event took."""
        self.taken = Taken(
            self.taken.energy + lost.energy,
            self.taken.momentum + lost.momentum,
            self.taken.angular_momentum + lost.angular_momentum,
        )

    @unwarned
    def begin(self, masses: Floats, phase: Floats) -> None:
        """Set the scales of the momentum errors from the first sample."""
        x, v = phase
        self.begun = True
        self.momentum_scale = float(masses @ np.linalg.norm(v, axis=0))
        self.angular_momentum_scale = float(masses @ np.linalg.norm(np.cross(x.T, v.T), axis=1))

    @property
    def samples(self) -> list[Sample]:
        """All looks as Samples."""
        return self.looks.samples

    def memory(self) -> Memory:
        """Return everything except the looks, by value."""
        kept = {key.name: by_value(getattr(self, key.name)) for key in fields(self) if key.name != "looks"}
        return kept | {"taken": None if self.taken is NOTHING else kept["taken"]}

    @classmethod
    def recalled(cls, memory: Memory) -> Record:
        """Return the record with this memory, without samples.

        The memory may come from a file. Raises InputError if it does not hold a record."""
        kept, fresh = by_value(memory), cls()
        for key, value in kept.items():
            kind = type(getattr(fresh, key, None))
            if key != "taken" and not isinstance(value, (int, float) if kind in (int, float) else kind):
                raise InputError(f"checkpoint: record.{key} does not fit a run of this system")
        if not all(isinstance(seconds, float) for seconds in kept.get("spent", {}).values()):
            raise InputError("checkpoint: its record's times are invalid")
        if not all(isinstance(line, str) for line in kept["warnings"]) or not all(map(is_row, kept["events"])):
            raise InputError("checkpoint: its warnings or events are invalid")
        return cls(**(kept | {"taken": NOTHING if kept["taken"] is None else Taken(*kept["taken"])}))

    def series(self) -> Series:
        """Return the looks so far as a Series; later looks do not change it."""
        steps, rows = self.looks.held()
        first, known = rows[0], ~np.isnan(rows[:, column.PAIRS])
        temperatures, pressures = rows[:, column.TEMPERATURE], rows[:, column.PRESSURE]
        volumes = rows[:, column.VOLUME]
        begun = int(bool(self.hits) and len(rows) > 1)  # the first look at hard spheres has no hits before it
        return Series(
            steps=steps,
            times=rows[:, column.TIME],
            total=rows[:, column.TOTAL] + rows[:, column.ENERGY_TAKEN],
            final=float(rows[-1, column.TOTAL]),
            kinetic=float(first[column.KINETIC]),
            momentum=_vectors(rows, column.MOMENTUM, column.MOMENTUM_TAKEN),
            angular_momentum=_vectors(rows, column.ANGULAR, column.ANGULAR_TAKEN),
            temperature=float(temperatures.mean()),
            pressure=float(pressures[begun:].mean()),
            pairs=float(rows[known, column.PAIRS].mean()) if known.any() else None,
            kinetics=rows[:, column.KINETIC],
            temperatures=temperatures if np.isfinite(temperatures).all() else None,
            taken=rows[:, column.ENERGY_TAKEN],
            pressures=np.append([np.nan] * begun, pressures[begun:]) if np.isfinite(pressures[begun:]).all() else None,
            volumes=volumes if np.isfinite(volumes).all() else None,
        )


def _vectors(rows: Floats, first: int, taken: int) -> Floats | None:
    """Return (k, 3) vectors with events' losses, of the looks that have the vector; None if no look has."""
    values = rows[:, first : first + 3]
    there = ~np.isnan(values).all(axis=1)
    return (values + rows[:, taken : taken + 3])[there] if there.any() else None

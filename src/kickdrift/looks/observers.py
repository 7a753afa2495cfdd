"""Observables of a run (energies, momenta, temperature, pressure), and the table that compiled code fills row by row.

Sampling changes nothing in the run.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

from kickdrift.errors import InputError, RunError
from kickdrift.looks import columns as column
from kickdrift.looks.columns import ENERGY_TAKEN, KINETIC, KNOWN, NUMBERS, OWN, POTENTIAL, TAKEN, TOTAL, VECTORS
from kickdrift.model.checks.limits import check_room
from kickdrift.model.checks.values import unwarned
from kickdrift.model.freedom import apart_of, fixed_heat, freedom_of, whole_motion
from kickdrift.model.state import Floats

if TYPE_CHECKING:
    from kickdrift.forces.bound.forces import Measured
    from kickdrift.model.system import System


class Taken(NamedTuple):
    """Energy and momenta that events have taken out of a run; errors of conservation exclude these."""

    energy: float
    momentum: Floats | float
    angular_momentum: Floats | float


NOTHING = Taken(0.0, 0.0, 0.0)


class Hits(NamedTuple):
    """Hits of hard spheres up to a time. The virial is the sum of distance times push over the hits of spheres.
    ``span`` is the time in which they came."""

    time: float
    span: float
    spheres: int
    walls: int
    virial: float


class Energies(NamedTuple):
    """Totals over all particles, in the system's energy unit."""

    kinetic: float
    potential: float
    total: float


@dataclass(frozen=True)
class Sample:
    """One look at a run.

    Attributes
    ----------
    step, time : step and time of the look
    energies : Energies
    momentum : (3,) sum of m v; None for a Problem
    angular_momentum : (3,) sum of m x × v about the origin, conserved only in open space; None for a Problem
    temperature : 2 Q / (g k_B), Q the heat and g its degrees of freedom, 3 N - 3 in a periodic box; nan without a pair
        force or without degrees of freedom. Heat is kinetic energy without the motion of the whole, see `model.freedom`
    pressure : (2 Q + W) / (3 V), W the virial, sum of r . F over pairs (Allen & Tildesley 2017, eq. 2.60); in two
        dimensions (2 Q + W) / (2 A), A the area; nan in open space
    pairs : number of pairs of particles within the forces' range; None if another engine does not report pairs
    centre_of_mass, centre_of_mass_velocity : (3,) sums of m x and of m v, over the sum of m; None for a Problem and
        without mass
    taken : Taken
    columns : values of the user's columns, by name
    volume : volume of a box that a barostat changes, in two dimensions the area; nan in a box that keeps its size
    """

    step: int
    time: float
    energies: Energies
    momentum: Floats | None = None
    angular_momentum: Floats | None = None
    temperature: float = float("nan")
    pressure: float = float("nan")
    pairs: int | None = 0
    taken: Taken = NOTHING
    centre_of_mass: Floats | None = None
    centre_of_mass_velocity: Floats | None = None
    columns: Mapping[str, Any] = field(default_factory=dict)
    volume: float = float("nan")

    def observables(self, taken: bool = False) -> dict[str, float | Floats]:
        """Return kickdrift's own columns by their names in a run's file; with ``taken``, also events' losses."""
        own = ((column.name, column.value(self)) for column in (OWN + TAKEN if taken else OWN))
        return {name: value for name, value in own if value is not None}

    @classmethod
    def of(cls, step: int, time: float, values: Mapping[str, Any]) -> Sample:
        """Return the Sample with these ``observables``."""
        energies = Energies(*(float(values[f"{kind}_energy"]) for kind in ("kinetic", "potential", "total")))
        taken = NOTHING
        lost = [values.get(f"{kind}_taken", 0.0) for kind in ("energy", "momentum", "angular_momentum")]
        if any(np.any(each) for each in lost):
            taken = Taken(float(lost[0]), lost[1], lost[2])
        rest: dict[str, Any] = {own.name: values.get(own.name) for own in VECTORS}
        rest |= {own.name: float(values.get(own.name, np.nan)) for own in NUMBERS}
        return cls(
            step=step,
            time=time,
            energies=energies,
            pairs=int(values["pairs"]) if "pairs" in values else None,
            taken=taken,
            columns={name: value for name, value in values.items() if name not in KNOWN},
            **rest,
        )


def observables_of(row: Floats, taken: bool = False) -> dict[str, float | Floats]:
    """Return ``Sample.observables`` of the row of a look; vectors are views."""
    found: dict[str, float | Floats] = {}
    if taken and not row[ENERGY_TAKEN:].any():
        row = np.concatenate([row[:ENERGY_TAKEN], np.zeros(len(row) - ENERGY_TAKEN)])  # no zero has a sign
    numbers: list[float] = row.tolist()
    for own in OWN + TAKEN if taken else OWN:
        number = numbers[own.place]
        if own.shape:
            vector = row[own.place : own.place + 3]
            if number == number or not np.isnan(vector).all():
                found[own.name] = vector
        elif number == number or own.place in (KINETIC, POTENTIAL, TOTAL):
            found[own.name] = number
    if "momentum" not in found:
        found.pop("pairs", None)
    return found


def columns_of(rows: Floats) -> dict[str, Floats]:
    """Return ``Sample.observables`` of the rows of several looks, a row for each; empty if some looks lack a value
    that others have."""
    missing = np.isnan(rows)
    if not len(rows) or (missing != missing[0]).any():
        return {}
    return {
        name: rows[:, own.place : own.place + 3] if own.shape else rows[:, own.place]
        for name in observables_of(rows[0])
        for own in (KNOWN[name],)
    }


def kinetic_energy(masses: Floats, velocities: Floats) -> float:
    """Return the sum of m v^2 / 2; velocities (3, n)."""
    return 0.5 * float(np.einsum("i,ki,ki->", masses, velocities, velocities))


def angular_momentum(masses: Floats, x: Floats, v: Floats) -> Floats:
    """Return the (3,) sum of m x × v about the origin; positions and velocities (3, n)."""
    pairs = ((1, 2), (2, 0), (0, 1))
    return np.array([masses @ (x[j] * v[k] - x[k] * v[j]) for j, k in pairs])


def particles_interact(system: System) -> bool:
    """Tell whether particles exchange energy by their forces, so that they have a temperature. Forces on a list of
    neighbours and calculators say so (``thermal``)."""
    return any(getattr(force, "thermal", False) for force in system.forces)


def bodies_collide(system: System) -> bool:
    """Tell whether an event changes bodies that meet. Their pushes are in no virial, so they leave no pressure."""
    return any(getattr(event, "action", "log") not in ("log", "stop") for event in system.events)


class Measuring(Protocol):
    """An object that evaluates forces and sums at (2, 3, n) positions and velocities; None if not finite."""

    def measure(self, time: float, phase: Floats) -> Measured | None: ...


@unwarned
def take_sample(
    system: System, forces: Measuring, step: int, time: float, phase: Floats, drags: bool = False
) -> Sample:
    """Return a sample at ``phase`` (2, 3, n). ``drags`` tells whether the method changes the total momentum.

    Raises RunError if forces or energy are not finite."""
    measured = forces.measure(time, phase)
    if measured is None:
        raise RunError(f"step {step} (t = {time:g}): the forces at these positions are not finite")
    x, v = phase
    m = system.coherent_masses
    total_mass = m.sum()
    kinetic = kinetic_energy(m, v)
    if not np.isfinite(kinetic + measured.potential):
        raise RunError(f"step {step} (t = {time:g}): the energy is not finite")
    collides, degrees = particles_interact(system), freedom_of(system, drags)
    room = system.dimensions * system.volume
    motion = whole_motion(m, x, v, apart_of(system, drags)) if collides or np.isfinite(room) else None
    heat = kinetic - fixed_heat(system) if motion is None else kinetic_energy(m, v - motion)
    temperature = 2 * heat / (degrees * system.units.boltzmann) if collides and degrees else float("nan")
    pressure = (2 * heat + measured.virial) / room if np.isfinite(room) else float("nan")
    return Sample(
        step=step,
        time=time,
        energies=Energies(kinetic, measured.potential, kinetic + measured.potential),
        momentum=v @ m,
        angular_momentum=angular_momentum(m, x, v),
        temperature=temperature,
        pressure=pressure,
        pairs=measured.pairs,
        centre_of_mass=x @ m / total_mass if total_mass else None,
        centre_of_mass_velocity=v @ m / total_mass if total_mass else None,
    )


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

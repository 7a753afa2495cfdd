"""What is looked at while a run goes on: energies, momenta, temperature, pressure. Looking changes nothing."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, fields, replace
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from kickdrift.checks import unwarned
from kickdrift.errors import InputError, RunError
from kickdrift.events import is_row
from kickdrift.forces.pair_law import PairForce
from kickdrift.memory import Memory, by_value
from kickdrift.state import Floats

if TYPE_CHECKING:
    from kickdrift.forces.bound import BoundForces
    from kickdrift.system import System


class Taken(NamedTuple):
    """What events took out of a run so far, so that conservation is not blamed for it."""

    energy: float
    momentum: Floats | float
    angular_momentum: Floats | float


NOTHING = Taken(0.0, 0.0, 0.0)


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
    step, time : of the look
    energies : Energies
    momentum : (3,) sum of m v; None for a Problem
    angular_momentum : (3,) sum of m x × v, about the origin; it is conserved in open space alone; None for a Problem
    temperature : 2 K / (g k_B), g = 3 N - 3; nan without particles that collide (no pair force) or degrees of freedom
    pressure : (2 K + W) / (3 V), W the virial, sum of r . F over pairs (Allen & Tildesley 2017, eq. 2.60); nan in open
    space
    pairs : pairs of particles within the forces' range; None where another engine does not say
    centre_of_mass, centre_of_mass_velocity : (3,) sum of m x and of m v over that of m; None for a Problem and without
    a mass
    taken : Taken
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

    def observables(self, taken: bool = False) -> dict[str, float | Floats]:
        """By the names that a run's file uses; with what events took out, if ``taken``."""
        kinetic, potential, total = self.energies
        values: dict[str, float | Floats] = {
            "kinetic_energy": kinetic,
            "potential_energy": potential,
            "total_energy": total,
        }
        if self.momentum is not None and self.angular_momentum is not None:
            values |= {"momentum": self.momentum, "angular_momentum": self.angular_momentum}
        if self.centre_of_mass is not None:
            values["centre_of_mass"] = self.centre_of_mass
        if self.centre_of_mass_velocity is not None:
            values["centre_of_mass_velocity"] = self.centre_of_mass_velocity
        if not np.isnan(self.temperature):
            values["temperature"] = self.temperature
        if not np.isnan(self.pressure):
            values["pressure"] = self.pressure
        if self.momentum is not None and self.pairs is not None:
            values["pairs"] = float(self.pairs)
        if taken:
            values |= {
                "energy_taken": self.taken.energy,
                "momentum_taken": self.taken.momentum * np.ones(3),
                "angular_momentum_taken": self.taken.angular_momentum * np.ones(3),
            }
        return values

    @classmethod
    def of(cls, step: int, time: float, values: Mapping[str, Any]) -> Sample:
        """The Sample that had these ``observables``."""
        energies = Energies(*(float(values[f"{kind}_energy"]) for kind in ("kinetic", "potential", "total")))
        taken = NOTHING
        lost = [values.get(f"{kind}_taken", 0.0) for kind in ("energy", "momentum", "angular_momentum")]
        if any(np.any(each) for each in lost):
            taken = Taken(float(lost[0]), lost[1], lost[2])
        return cls(
            step=step,
            time=time,
            energies=energies,
            momentum=values.get("momentum"),
            angular_momentum=values.get("angular_momentum"),
            temperature=float(values.get("temperature", np.nan)),
            pressure=float(values.get("pressure", np.nan)),
            pairs=int(values["pairs"]) if "pairs" in values else None,
            taken=taken,
            centre_of_mass=values.get("centre_of_mass"),
            centre_of_mass_velocity=values.get("centre_of_mass_velocity"),
        )


def _lost(before: Floats | None, after: Floats | None) -> Floats | float:
    return 0.0 if before is None or after is None else before - after


def kinetic_energy(masses: Floats, velocities: Floats) -> float:
    """Sum of m v^2 / 2; velocities (3, n)."""
    return 0.5 * float(np.einsum("i,ki,ki->", masses, velocities, velocities))


def angular_momentum(masses: Floats, x: Floats, v: Floats) -> Floats:
    """(3,) sum of m x × v, about the origin; positions and velocities (3, n)."""
    pairs = ((1, 2), (2, 0), (0, 1))
    return np.array([masses @ (x[j] * v[k] - x[k] * v[j]) for j, k in pairs])


@unwarned
def take_sample(system: System, forces: BoundForces, step: int, time: float, phase: Floats) -> Sample:
    """Look at positions and velocities ``phase`` (2, 3, n); a RunError where forces or energy there are no numbers."""
    measured = forces.measure(time, phase)
    if measured is None:
        raise RunError(f"step {step} (t = {time:g}): the forces at these positions are not finite")
    x, v = phase
    m = system.coherent_masses
    total_mass = m.sum()
    kinetic = kinetic_energy(m, v)
    if not np.isfinite(kinetic + measured.potential):
        raise RunError(f"step {step} (t = {time:g}): the energy is not finite")
    collides = any(isinstance(force, PairForce) for force in system.forces)
    degrees = system.degrees_of_freedom
    temperature = 2 * kinetic / (degrees * system.units.boltzmann) if collides and degrees else float("nan")
    pressure = (2 * kinetic + measured.virial) / (3 * system.box.volume) if system.box.periodic else float("nan")
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


@dataclass
class Record:
    """The samples of a run since conservation is counted from, and what it cost."""

    samples: list[Sample] = field(default_factory=list)
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

    def memory(self) -> Memory:
        """All but the samples, by value."""
        kept = {key.name: by_value(getattr(self, key.name)) for key in fields(self) if key.name != "samples"}
        return kept | {"taken": None if self.taken is NOTHING else kept["taken"]}

    @classmethod
    def recalled(cls, memory: Memory) -> Record:
        """The record that had this memory; without samples. An InputError where the memory, which may come from a file,
        holds something else."""
        kept, fresh = by_value(memory), cls()
        for key, value in kept.items():
            kind = type(getattr(fresh, key, None))
            if key != "taken" and not isinstance(value, (int, float) if kind in (int, float) else kind):
                raise InputError(f"checkpoint: record.{key} does not hold what it held in such a run")
        if not all(isinstance(line, str) for line in kept["warnings"]) or not all(map(is_row, kept["events"])):
            raise InputError("checkpoint: its warnings or events are none")
        return cls(**(kept | {"taken": NOTHING if kept["taken"] is None else Taken(*kept["taken"])}))

    def add(self, sample: Sample) -> Sample:
        """Keep a sample, with what was taken so far; one of the same step and time takes the last one's place."""
        if self.samples and (self.samples[-1].step, self.samples[-1].time) == (sample.step, sample.time):
            self.samples.pop()
        self.samples.append(sample if self.taken is NOTHING else replace(sample, taken=self.taken))
        return self.samples[-1]

    def series(self) -> Series:
        """The samples side by side."""
        samples = self.samples
        pairs = [s.pairs for s in samples if s.pairs is not None]
        momentum = [s.momentum + s.taken.momentum for s in samples if s.momentum is not None]
        turning = [s.angular_momentum + s.taken.angular_momentum for s in samples if s.angular_momentum is not None]
        return Series(
            steps=np.array([s.step for s in samples]),
            times=np.array([s.time for s in samples]),
            total=np.array([s.energies.total + s.taken.energy for s in samples]),
            final=samples[-1].energies.total,
            kinetic=samples[0].energies.kinetic,
            momentum=np.array(momentum) if momentum else None,
            angular_momentum=np.array(turning) if turning else None,
            temperature=float(np.mean([s.temperature for s in samples])),
            pressure=float(np.mean([s.pressure for s in samples])),
            pairs=sum(pairs) / len(pairs) if pairs else None,
        )

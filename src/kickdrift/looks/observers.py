"""Observables of a run: energies, momenta, temperature, pressure. Sampling changes nothing in the run."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, NamedTuple, Protocol

import numpy as np

from kickdrift.errors import RunError
from kickdrift.looks.columns import ENERGY_TAKEN, KINETIC, KNOWN, NUMBERS, OWN, POTENTIAL, TAKEN, TOTAL, VECTORS
from kickdrift.model.checks.values import unwarned
from kickdrift.model.freedom import apart_of, freedom_of, whole_motion
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
    heat = kinetic if motion is None else kinetic_energy(m, v - motion)
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

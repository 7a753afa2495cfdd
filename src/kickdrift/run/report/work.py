"""Work of the body laws that take or give energy: their power at each look, and its integral over the run.

Such a law has a column with its power, the sum of m v . a, and one with its potential energy. The energy that the law
took or gave is the integral of the power plus the change of its potential energy.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np

from kickdrift.forces.around.spins import UnderSpins, spinning
from kickdrift.forces.bound.forces import BoundForces
from kickdrift.forces.laws.body_law import BodyForce
from kickdrift.looks.columns import Column
from kickdrift.looks.observers import Sample
from kickdrift.model.state import Floats
from kickdrift.model.system import System

POINTS, FEWER = 12, 10  # looks through which a polynomial goes in each interval; with fewer, for the error
RESOLVED = 0.01  # the looks resolve a work whose relative error is at most this
ROWS = 2**15  # intervals at a time


class Work(NamedTuple):
    """Energy that forces have given by a look; negative for energy that they took.

    Attributes
    ----------
    by_force : energy by the last look, for each force's name
    given : (k,) sum over the forces at each look
    error : largest error of the sum, from the distance between looks
    """

    by_force: dict[str, float]
    given: Floats
    error: float

    @property
    def resolved(self) -> bool:
        """Whether the looks are dense enough to tell the work."""
        return self.error <= RESOLVED * max(float(np.abs(self.given).max()), *map(abs, self.by_force.values()))


def working(system: Any) -> dict[str, list[Any]]:
    """Body laws that do work, by name; none for a Problem."""
    found: dict[str, list[Any]] = {}
    for force in system.forces if isinstance(system, System) else ():
        if isinstance(force, BodyForce) and force.works:
            found.setdefault(force.name, []).append(force)
    return found


def column_names(name: str) -> tuple[str, str]:
    """Names of the columns of a force's power and potential energy."""
    plain = re.sub(r"\W", "_", name)
    return f"power_{plain}", f"potential_{plain}"


def work_columns(system: Any) -> list[Column]:
    """Columns of power and potential energy of each force that does work."""
    found = []
    for name in working(system):
        meter = Meter(name)
        power, potential = column_names(name)
        found += [Column(power, "power", (), meter.power), Column(potential, "energy", (), meter.potential)]
    return found


class Meter:
    """Evaluates power and potential energy of the forces of one name at the present state of a Simulation."""

    def __init__(self, name: str) -> None:
        self._name = name
        self._system: Any = None
        self._forces: Any = None
        self._last: tuple[Any, tuple[float, float]] = (None, (np.nan, np.nan))

    def power(self, sim: Any) -> float:
        """Sum of m v . a now."""
        return self._at(sim)[0]

    def potential(self, sim: Any) -> float:
        """Potential energy now."""
        return self._at(sim)[1]

    def _at(self, sim: Any) -> tuple[float, float]:
        """Power and potential energy now; nan if the forces are not finite."""
        if sim.system is not self._system:  # a new system after a body has left
            self._system = sim.system
            under = sim.system.under(working(sim.system)[self._name])
            self._forces = BoundForces(UnderSpins(under) if spinning(sim.system) else under)
            self._last = (None, (np.nan, np.nan))
        where = sim.steps_done, sim.time
        if self._last[0] != where:
            phase, n = sim.state.phase, len(sim.system)
            seen = sim.integration.y.copy() if spinning(sim.system) else phase
            measured = self._forces.measure(sim.time, seen)
            power = np.nan
            if measured is not None:
                power = float(
                    np.einsum("i,ki,ki->", sim.system.coherent_masses, phase[1], measured.accelerations[:, :n])
                )
            self._last = where, (power, np.nan if measured is None else float(measured.potential))
        return self._last[1]


def work_of(system: Any, samples: Sequence[Sample]) -> Work | None:
    """Work of the forces over these samples; None without such forces or without their columns."""
    names = list(working(system))
    if not names or len(samples) < 2 or not all(column_names(name)[0] in each.columns for each in samples
                                                for name in names):  # fmt: skip
        return None
    times = np.array([each.time for each in samples])
    by_force, given, missed = {}, np.zeros(len(times)), np.zeros(len(times))
    for name in names:
        power, potential = (np.array([each.columns[key] for each in samples]) for key in column_names(name))
        fine, coarse = (cumulative(times, power, points) for points in (POINTS, FEWER))
        one = fine + potential - potential[0]
        by_force[name] = float(one[-1])
        given += one
        missed += np.abs(fine - coarse)
    return Work(by_force, given, float(missed.max()))


def cumulative(times: Floats, values: Floats, points: int) -> Floats:
    """Integral of ``values`` from the first time to each time, (k,).

    In each interval, a polynomial goes through the ``points`` nearest values."""
    count = len(times)
    points = min(points, count)
    found = np.zeros(count)
    powers = np.arange(points)
    for begin in range(0, count - 1, ROWS):
        left = np.arange(begin, min(begin + ROWS, count - 1))
        first = np.clip(left - (points - 1) // 2, 0, count - points)
        near = first[:, None] + powers
        length = times[left + 1] - times[left]
        scale = np.abs(times[near] - times[left][:, None]).max(axis=1)
        u = (times[near] - times[left][:, None]) / scale[:, None]
        end = length / scale
        moments = end[:, None] ** (powers + 1) / (powers + 1)
        weights = np.linalg.solve(u[:, None, :] ** powers[:, None], moments[:, :, None])[:, :, 0]
        found[left + 1] = scale * (weights * values[near]).sum(axis=1)
    return np.cumsum(found)

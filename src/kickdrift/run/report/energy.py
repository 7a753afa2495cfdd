"""Conservation of the energy of a run: errors, drift and a verdict, and the work of body laws.

Body laws that take or give energy have a column with their power at each look, the sum of m v . a, and one with their
potential energy. The energy that such a law took or gave is the integral of the power plus the change of its potential
energy.
"""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass, field, replace
from typing import Any, NamedTuple

import numpy as np

from kickdrift.forces.beside.columns import bound_under, further
from kickdrift.forces.beside.unknowns import Beside
from kickdrift.forces.bound.forces import BoundForces
from kickdrift.forces.laws.body_law import BodyForce
from kickdrift.looks.columns import Column
from kickdrift.looks.doubts import UNRELIABLE, energy_doubt
from kickdrift.looks.observers import Sample
from kickdrift.looks.record import Series
from kickdrift.looks.report_lines import energy_trend
from kickdrift.model.problem import Problem
from kickdrift.model.state import Floats
from kickdrift.model.system import System
from kickdrift.statistics.drift import EnergyError, energy_error

POINTS, FEWER = 12, 10  # looks through which a polynomial goes in each interval; with fewer, for the error
RESOLVED = 0.01  # the looks resolve a work whose relative error is at most this
ROWS = 2**15  # intervals at a time
_JUDGED = ("drift_per_unit_time", "drift_error", "verdict")


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
    """Body laws and unknowns that do work, by name; none for a Problem."""
    found: dict[str, list[Any]] = {}
    for force in system.forces if isinstance(system, System) else ():
        if isinstance(force, BodyForce | Beside) and force.works:
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
            self._forces, self._beside = BoundForces(bound_under(under)), bool(further(under))
            self._last = (None, (np.nan, np.nan))
        where = sim.steps_done, sim.time
        if self._last[0] != where:
            phase, n = sim.state.phase, len(sim.system)
            seen = sim.integration.y.copy() if self._beside else phase
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


@dataclass(frozen=True)
class EnergyReport:
    """Errors and drift of the total energy; ``statistics.drift`` has definitions and sources.

    With a heat bath, errors and drift are those of the total energy less the heat, which is conserved; with a barostat,
    also less the work. They are nan, and the verdict says so, if an engine does not tell the heat. With body laws that
    do work, such as tides with a time lag, errors and drift are those of the energy less this work. Where the looks are
    too far apart to tell the work, the verdict is "not conserved".

    Attributes
    ----------
    initial, final : total energy, in the system's unit
    rms_relative_error, max_relative_error : root mean square and maximum of E(t) - E(0) over the samples, divided by
        the scale that ``relative_to`` names
    relative_to : "initial energy" |E(0)|, "kinetic energy" if |E(0)| is below a tenth of it, or "absolute"
    drift_per_unit_time : slope of the relative error per unit of time, from a regression with autocorrelation
    drift_error : half-width of the slope's 95 % interval
    verdict : "bounded", "secular drift", "random walk", "round-off" or "not resolvable"; "unreliable" if the largest
        error is above a tenth of the energy (`looks.doubts.energy_doubt`); "not conserved", with the force's name, if
        a force does work that is not counted
    work : energy that each body law gave over the run, by the force's name; negative for energy that the force took.
        Empty without such laws
    work_error : largest error of the sum of this work, from the distance between looks

    Slope, interval and verdict take about half a millisecond. They are computed when one of them is first read.
    """

    initial: float
    final: float
    rms_relative_error: float
    max_relative_error: float
    relative_to: str
    drift_per_unit_time: float
    drift_error: float
    verdict: str
    work: dict[str, float] = field(default_factory=dict)
    work_error: float = 0.0

    @classmethod
    def later(
        cls, error: EnergyError, final: float, judged: Callable[[], tuple[float, float, str]], work: Work | None = None
    ) -> EnergyReport:
        """Return a report that calls ``judged`` for slope, interval and verdict when one of them is first read."""
        found = cls.__new__(cls)
        by_force, missed = (work.by_force, work.error) if work else ({}, 0.0)
        vars(found).update(vars(error), final=final, _judged=judged, work=by_force, work_error=missed)
        return found

    def __getattr__(self, name: str) -> Any:
        """Compute slope, interval and verdict on first use."""
        judged = vars(self).get("_judged")
        if judged is None or name not in _JUDGED:
            raise AttributeError(f"{type(self).__name__!r} object has no attribute {name!r}")
        vars(self).update(zip(_JUDGED, judged(), strict=True))
        del vars(self)["_judged"]
        return vars(self)[name]

    def __getstate__(self) -> dict[str, Any]:
        """Return all values, for another process."""
        return asdict(self)


def energy_report(
    series: Series, even: bool, system: System | Problem, bath: bool, unknown: str = "", work: Work | None = None
) -> tuple[EnergyReport | None, str]:
    """Conservation of the energy, and a warning if its error is too large for the trajectory to be any good.

    The errors are nan if they are ``unknown``, for the reason given. ``work`` is that of the forces over the series."""
    total, kinetic = series.total, series.kinetic
    closed = work is not None and work.resolved
    if work is not None and closed:
        total = total - work.given
    if np.isnan(total[0]):
        return None, ""  # a Problem without an energy function
    error = whole = energy_error(total, 0.0 if np.isnan(kinetic) else kinetic)
    if unknown:
        error = replace(error, rms_relative_error=math.nan, max_relative_error=math.nan)
        return EnergyReport.later(error, series.final, lambda: (math.nan, math.nan, unknown)), ""
    working = system.acting("works") if isinstance(system, System) else []
    if work is not None and closed:
        working = [name for name in working if name not in work.by_force]

    doubt = "" if working or bath else energy_doubt(total, series.kinetics, whole)

    def judged() -> tuple[float, float, str]:
        trend = energy_trend(series.steps, series.times, total, kinetic, even, whole, series.even)
        verdict = UNRELIABLE if doubt else trend.verdict
        return trend.slope, trend.error, f"not conserved: {', '.join(working)}" if working else verdict

    return EnergyReport.later(error, series.final, judged, work), doubt

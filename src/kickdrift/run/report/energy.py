"""Conservation of the energy of a run: errors, drift and a verdict."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import asdict, dataclass, field, replace
from typing import Any

import numpy as np

from kickdrift.looks.doubts import UNRELIABLE, energy_doubt
from kickdrift.looks.record import Series
from kickdrift.looks.report_lines import energy_trend
from kickdrift.model.problem import Problem
from kickdrift.model.system import System
from kickdrift.run.report.work import Work
from kickdrift.statistics.drift import EnergyError, energy_error

_JUDGED = ("drift_per_unit_time", "drift_error", "verdict")


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

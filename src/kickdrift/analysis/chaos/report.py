"""MEGNO, the Lyapunov exponent and a verdict, from the growth of a deviation vector.

With d(t) the length of a solution of the variational equations, the Mean Exponential Growth of Nearby Orbits is

    Y(t) = 2 / t  integral of s (d'/d) ds from 0 to t.

Its running mean <Y> tends to 2 for a quasi-periodic motion and to lambda t / 2 for a chaotic one, with the largest
Lyapunov exponent lambda (Cincotta & Simo 2000, doi:10.1051/aas:2000108; Cincotta, Giordano & Simo 2003,
doi:10.1016/S0167-2789(03)00103-9).
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import Any, Literal

import numpy as np

from kickdrift.analysis.doubts import plain, run_lines, trajectory_doubts, warning_lines
from kickdrift.display.showing import Lines, Shown
from kickdrift.errors import InputError
from kickdrift.looks.doubts import UNRELIABLE
from kickdrift.looks.observers import Energies
from kickdrift.model.body_checks import doubtful_forces
from kickdrift.model.problem import Problem
from kickdrift.model.state import Floats
from kickdrift.model.system import System
from kickdrift.model.units.unit_systems import symbol_of

Verdict = Literal["regular", "chaotic", "undecided", "unreliable"]

REGULAR = 0.1  # largest |<Y> - 2| of a regular motion
CHAOTIC = 4.0  # least <Y> of a chaotic motion
MARGIN = 1.5  # of the time that an undecided run should have had
SETTLED = 0.2  # first part of the run, left out of the fit of the Lyapunov exponent (Cincotta & Simo 2000, section 3)


@dataclass(frozen=True, repr=False)
class ChaosReport(Shown):
    """Results from the growth of a deviation.

    Attributes
    ----------
    system, integrator, dt, time, time_unit, steps, seed : the run, and the seed of the first deviation; ``time_unit``
        is "" for a Problem
    megno : running mean <Y> at the end
    verdict : "regular" for |megno - 2| < 0.1, "chaotic" for megno above 4, else "undecided"; "unreliable" if the
        trajectory is no good, for the reason in ``warnings``
    lyapunov : largest Lyapunov exponent, per the system's unit of time: twice the slope of <Y> over the last four
        fifths of the run (Cincotta & Simo 2000). A regular motion gives a small number of either sign.
    lyapunov_error : half the difference between the results of the two halves of this part
    energy_error : relative, at the end; nan for a Problem without energy
    times, means, growth : (k,) times since the start, <Y> at these times, and ln d(t) / d(0)
    warnings : what is wrong with the trajectory, or doubtful in the forces
    """

    system: str
    integrator: str
    dt: float | None
    time: float
    time_unit: str
    steps: int
    seed: int
    megno: float
    verdict: Verdict
    lyapunov: float
    lyapunov_error: float
    energy_error: float
    times: Floats = field(repr=False)
    means: Floats = field(repr=False)
    growth: Floats = field(repr=False)
    warnings: list[str] = field(default_factory=list)

    @property
    def time_to_decide(self) -> float | None:
        """Length of a run that should decide, an estimate from this run; None if this run decides.

        A regular motion has <Y> - 2 fall about as 1 / t, and a chaotic one has <Y> grow as t (Cincotta & Simo 2000). A
        <Y> above 3 is nearer to chaos. Half as much again covers the logarithm of t in the first law, and the
        oscillations about both."""
        if self.verdict != "undecided":
            return None
        nearer_chaos = self.megno > 0.5 * (2.0 + CHAOTIC)
        return MARGIN * self.time * (CHAOTIC / self.megno if nearer_chaos else abs(self.megno - 2.0) / REGULAR)

    @property
    def bound(self) -> float:
        """Largest Lyapunov exponent that this run allows: the modulus of its estimate, and the error."""
        return abs(self.lyapunov) + self.lyapunov_error

    def _lines(self) -> Lines:
        unit, longer = symbol_of(self.time_unit), self.time_to_decide
        exponent = f"{self.lyapunov:.2e} ± {self.lyapunov_error:.1e}" if longer is None else f"below {self.bound:.1e}"
        lines = [
            *run_lines(self),
            ("MEGNO", f"{self.megno:.4g}: {self.verdict} over this length"),
            ("Lyapunov", f"exponent {exponent} per {unit or 'unit of time'}"),
        ]
        if not math.isnan(self.energy_error):
            lines.append(("energy error", f"{self.energy_error:.2e} at the end"))
        if longer is not None:
            times = longer / self.time
            lines.append(("to decide", f"run about {times:.2g} times as long: --time {float(f'{longer:.2g}'):g}"))
        return lines + warning_lines(self.warnings)

    def as_json(self) -> dict[str, Any]:
        """The report as one JSON object, with series of at most some 500 points."""
        return plain(self, "times", "means", "growth") | {"time_to_decide": self.time_to_decide}


def report_of(
    system: System | Problem,
    integrator: str,
    dt: float | None,
    steps: int,
    seed: int,
    energies: tuple[Energies, Energies],
    times: Floats,
    growth: Floats,
    phase: Floats | None = None,
) -> ChaosReport:
    """Report from the growth of a deviation; ``phase`` (2, 3, n) is that of the particles at the end, if known."""
    means = mean_megno(times, growth)
    slope, error = _slope(times, means)
    found, (begin, end) = float(means[-1]), energies
    doubts = trajectory_doubts(system, energies, phase)
    kinetic = 0.0 if np.isnan(begin.kinetic) else begin.kinetic  # a Problem has none
    return ChaosReport(
        system=system.name,
        integrator=integrator,
        dt=dt,
        time=float(times[-1]),
        time_unit=system.units.time if isinstance(system, System) else "",
        steps=steps,
        seed=seed,
        megno=found,
        verdict=UNRELIABLE if doubts else verdict(found),
        lyapunov=2.0 * slope,
        lyapunov_error=2.0 * error,
        energy_error=abs(end.total - begin.total) / (abs(begin.total) or abs(kinetic) or 1.0),
        times=times,
        means=means,
        growth=growth,
        warnings=doubts + (doubtful_forces(system) if isinstance(system, System) else []),
    )


def verdict(megno: float) -> Verdict:
    """Verdict from a mean MEGNO."""
    if abs(megno - 2.0) < REGULAR:
        return "regular"
    return "chaotic" if megno > CHAOTIC else "undecided"


def mean_megno(times: Floats, growth: Floats) -> Floats:
    """Mean MEGNO <Y> (k,) at times (k,), the first of them 0, from ``growth`` = ln d (k,).

    The trapezoidal rule gives both integrals. The first runs over ln d, so for times far apart it is MEGNO's sum for
    maps (Cincotta, Giordano & Simo 2003, section 4.1).
    """
    middles, lengths = 0.5 * (times[1:] + times[:-1]), np.diff(times)
    y = np.concatenate([[0.0], 2.0 * np.cumsum(middles * np.diff(growth)) / times[1:]])
    total = np.cumsum(0.5 * (y[1:] + y[:-1]) * lengths)
    return np.concatenate([[0.0], total / times[1:]])


def _slope(times: Floats, means: Floats) -> tuple[float, float]:
    """Slope of <Y> over the settled part of the run, and half the difference between the slopes of its halves."""
    settled = times >= SETTLED * times[-1]
    t, y = times[settled], means[settled]
    if len(t) < 6:
        raise InputError(f"time: {len(times) - 1} steps are too few to measure growth; give a longer time")
    half = len(t) // 2
    whole, early, late = (_line(t[part], y[part]) for part in (slice(None), slice(half), slice(half, None)))
    return whole, abs(late - early) / 2


def _line(t: Floats, y: Floats) -> float:
    """Slope of a straight line by least squares."""
    t = t - t.mean()
    return float(t @ (y - y.mean()) / (t @ t))

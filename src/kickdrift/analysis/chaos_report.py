"""What the growth of a deviation says: MEGNO, the Lyapunov exponent and a verdict."""

from __future__ import annotations

from dataclasses import dataclass, field, fields
from typing import Any, Literal

import numpy as np

from kickdrift.errors import InputError
from kickdrift.looks.observers import Energies
from kickdrift.model.state import Floats
from kickdrift.model.system import System

Verdict = Literal["regular", "chaotic", "undecided"]


REGULAR = 0.1  # |<Y> - 2| below which a motion is called regular
CHAOTIC = 4.0  # <Y> above which it is called chaotic
KEPT = 500  # of them, in a report's JSON
SETTLED = 0.2  # of the run that the fit of the Lyapunov exponent leaves out (Cincotta & Simo 2000, section 3)


@dataclass(frozen=True)
class ChaosReport:
    """What the deviation's growth says.

    Attributes
    ----------
    system, integrator, dt, time, time_unit, steps, seed : what was run, and the seed of the first deviation
    megno : the running mean <Y> at the end
    verdict : "regular" where |megno - 2| < 0.1, "chaotic" where it is above 4, "undecided" between
    lyapunov : the largest Lyapunov exponent, per the system's unit of time: twice the slope of <Y> over the last four
        fifths of the run (Cincotta & Simo 2000). Of a regular motion it is a small number of either sign.
    lyapunov_error : half the difference between the slopes of the two halves of that
    energy_error : relative, at the end
    times, means, growth : (k,) times since the start, <Y> at them, and ln d(t) / d(0)
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

    def as_json(self) -> dict[str, Any]:
        """As one JSON object; the series thinned to some 500 points."""
        every = -(-len(self.times) // KEPT)
        series = ("times", "means", "growth")
        return {
            name: value[::-every][::-1].tolist() if name in series else value
            for name, value in ((f.name, getattr(self, f.name)) for f in fields(self))
        }


def report_of(
    system: System,
    integrator: str,
    dt: float | None,
    steps: int,
    seed: int,
    energies: tuple[Energies, float],
    times: Floats,
    growth: Floats,
) -> ChaosReport:
    """What the growth of a deviation says."""
    means = mean_megno(times, growth)
    slope, error = _slope(times, means)
    found, (begin, end) = float(means[-1]), energies
    return ChaosReport(
        system=system.name,
        integrator=integrator,
        dt=dt,
        time=float(times[-1]),
        time_unit=system.units.time,
        steps=steps,
        seed=seed,
        megno=found,
        verdict=verdict(found),
        lyapunov=2.0 * slope,
        lyapunov_error=2.0 * error,
        energy_error=abs(end - begin.total) / (abs(begin.total) or abs(begin.kinetic) or 1.0),
        times=times,
        means=means,
        growth=growth,
    )


def verdict(megno: float) -> Verdict:
    """What a mean MEGNO says."""
    if abs(megno - 2.0) < REGULAR:
        return "regular"
    return "chaotic" if megno > CHAOTIC else "undecided"


def mean_megno(times: Floats, growth: Floats) -> Floats:
    """<Y> at each of the times, the first of them 0, from ln d: both integrals by the trapezoidal rule, the first over
    ln d, which makes it MEGNO's sum for maps (Cincotta, Giordano & Simo 2003, section 4.1) where times are far
    apart."""
    middles, lengths = 0.5 * (times[1:] + times[:-1]), np.diff(times)
    y = np.concatenate([[0.0], 2.0 * np.cumsum(middles * np.diff(growth)) / times[1:]])
    total = np.cumsum(0.5 * (y[1:] + y[:-1]) * lengths)
    return np.concatenate([[0.0], total / times[1:]])


def _slope(times: Floats, means: Floats) -> tuple[float, float]:
    """Of <Y> over the settled part of the run, and half the difference between its halves'."""
    settled = times >= SETTLED * times[-1]
    t, y = times[settled], means[settled]
    if len(t) < 6:
        raise InputError(f"time: {len(times) - 1} steps are too few to measure growth; give a longer time")
    half = len(t) // 2
    whole, early, late = (_line(t[part], y[part]) for part in (slice(None), slice(half), slice(half, None)))
    return whole, abs(late - early) / 2


def _line(t: Floats, y: Floats) -> float:
    """The slope of the straight line of least squares."""
    t = t - t.mean()
    return float(t @ (y - y.mean()) / (t @ t))

"""Deviation vectors: their start, their scale, and MEGNO and the Lyapunov exponent from their growth.

With d(t) the length of a solution of the variational equations, the Mean Exponential Growth of Nearby Orbits is

    Y(t) = 2 / t  integral of s (d'/d) ds from 0 to t.

Its running mean <Y> tends to 2 for a quasi-periodic motion and to lambda t / 2 for a chaotic one, with the largest
Lyapunov exponent lambda (Cincotta & Simo 2000, doi:10.1051/aas:2000108; Cincotta, Giordano & Simo 2003,
doi:10.1016/S0167-2789(03)00103-9).
"""

from __future__ import annotations

from typing import Literal

import numpy as np

from kickdrift.errors import InputError
from kickdrift.model.limits import steps_in
from kickdrift.model.state import Floats

Verdict = Literal["regular", "chaotic", "undecided"]

REGULAR = 0.1  # largest |<Y> - 2| of a regular motion
CHAOTIC = 4.0  # least <Y> of a chaotic motion
SETTLED = 0.2  # first part of the run, left out of the fit of the Lyapunov exponent (Cincotta & Simo 2000, section 3)
LARGEST = 2.0**200  # growth or decay of a deviation before it is scaled back


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


def scale_of(phase: Floats, accelerations: Floats) -> Floats:
    """Distance and speed (…, 2, 1, 1) that scale deviations of particles at phase (…, 2, 3, n).

    The distance is the scatter of positions about their mean. The speed combines the scatter of velocities with the
    speed that the forces give over this distance. A scaled deviation has the same length in any units.
    """
    scatter = _rms(phase - phase.mean(axis=-1, keepdims=True))
    distance = _or_else(_or_else(scatter[..., 0], _rms(phase[..., 0, :, :])), 1.0)
    speed = _or_else(np.sqrt(scatter[..., 1] ** 2 + distance * _rms(accelerations)), 1.0)
    return np.stack([distance, speed], axis=-1)[..., None, None]


def _or_else(value: Floats, other: Floats | float) -> Floats:
    return np.where(value == 0.0, other, value)


def _rms(vectors: Floats) -> Floats:
    """Root mean square of the lengths of vectors (…, 3, n)."""
    return np.sqrt((vectors**2).sum(axis=-2).mean(axis=-1))


def first_deviation(n: int, seed: int) -> Floats:
    """Deviation (2, 3, n) of length 1 in a random direction."""
    drawn = np.random.Generator(np.random.PCG64(seed)).standard_normal((2, 3, n))
    return drawn / np.linalg.norm(drawn)


def settled_slope(times: Floats, means: Floats) -> tuple[float, float]:
    """Slope of <Y> over the settled part of the run, and half the difference between the slopes of its halves."""
    settled = times >= SETTLED * times[-1]
    t, y = times[settled], means[settled]
    if len(t) < 6:
        raise InputError(f"time: {len(times) - 1} steps are too few to measure growth; give a longer time")
    half = len(t) // 2
    whole, early, late = (_least_squares(t[part], y[part]) for part in (slice(None), slice(half), slice(half, None)))
    return whole, abs(late - early) / 2


def _least_squares(t: Floats, y: Floats) -> float:
    """Slope of a straight line by least squares."""
    t = t - t.mean()
    return float(t @ (y - y.mean()) / (t @ t))


SAMPLES = 10_000  # most samples of the deviation in a run of fixed steps


def cadence(length: float, dt: float) -> tuple[int, int]:
    """Number of steps, and number of steps between samples."""
    steps = max(1, round(steps_in("time", length, dt)))
    return steps, max(1, steps // SAMPLES)

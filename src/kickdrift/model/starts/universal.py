"""Kepler's equation on every conic, in the universal variable s.

On an ellipse s is E / sqrt(1 - e), on a hyperbola H / sqrt(e - 1), and on a parabola their common limit, 2 tan(f / 2) /
sqrt(1 + e). Lengths are in pericentre distances q, times in sqrt(q^3 / mu).

Source: Danby 1988, Fundamentals of Celestial Mechanics, 6.9.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import ArrayLike

from kickdrift.model.state import Floats

TAU = 2 * math.pi
MOST_ITERATIONS = 100  # Newton's method, from the right of a convex function, needs 5 to 15
CLOSED_FORM = 1.0  # least |z| for the closed forms of Stumpff's functions; below it their series are exact


def stumpff(z: Floats) -> tuple[Floats, Floats, Floats, Floats]:
    """Stumpff's functions c0, c1, c2, c3 of z (Danby 1988, 6.9).

    For x^2 = z > 0 they are cos x, sin x / x, (1 - cos x) / x^2 and (x - sin x) / x^3; for z < 0 sinh and cosh replace
    sin and cos.
    """
    z = np.asarray(z, dtype=float)
    near = np.abs(z) < CLOSED_FORM
    small = np.where(near, z, 0.0)
    c2s, c3s = np.zeros_like(z), np.zeros_like(z)
    for k in range(9, -1, -1):  # 1/20! is 4e-19
        c2s = 1.0 / math.factorial(2 * k + 2) - small * c2s
        c3s = 1.0 / math.factorial(2 * k + 3) - small * c3s
    x = np.sqrt(np.where(near, 1.0, np.abs(z)))
    up = z > 0
    swing = np.where(up, np.sin(x), np.sinh(np.where(up, 0.0, x)))
    # 1 - cos x and cosh x - 1 as squares of the half angle: no cancellation
    half = np.where(up, np.sin(x / 2), np.sinh(np.where(up, 0.0, x / 2)))
    c2 = np.where(near, c2s, 2.0 * half**2 / x**2)
    c3 = np.where(near, c3s, np.where(up, x - swing, swing - x) / x**3)
    return 1.0 - z * c2, 1.0 - z * c3, c2, c3


def kepler_time(e: Floats, s: Floats) -> Floats:
    """Time since the pericentre, in sqrt(q^3 / mu), at the universal variable s: Kepler's equation of all conics."""
    return s + e * s**3 * stumpff((1.0 - e) * s * s)[3]


def universal_anomaly(e: Floats, f: ArrayLike) -> Floats:
    """Universal variable s at the true anomaly f in (-pi, pi]."""
    f = np.asarray(f, dtype=float)
    alpha = 1.0 - e
    root = np.sqrt(np.abs(alpha))
    up, down = alpha > 0, alpha < 0
    ellipse = 2.0 * np.arctan2(root * np.sin(f / 2), np.sqrt(1.0 + e) * np.cos(f / 2))
    with np.errstate(divide="ignore", invalid="ignore"):
        k = np.tan(f / 2) / np.sqrt(1.0 + e)
        hyperbola = 2.0 * np.arctanh(np.where(down, root * k, 0.0))
        return np.where(up, ellipse / root, np.where(down, hyperbola / root, 2.0 * k))


def anomaly_at(time: Floats, e: Floats) -> Floats:
    """Solve kepler_time(e, s) = time for s; |time| is at most half a period.

    kepler_time is odd. For s > 0, up to half a period, it rises (its slope is r / q >= 1) and is convex (its curvature
    is e times s c1 >= 0), so Newton's iteration from above converges to the root. Two upper bounds of s start it. A
    cubic equation comes from c3 >= 1 / pi^2 on this half of an ellipse and c3 >= 1 / 6 on a hyperbola. The other bound
    is e sinh H - H >= (e - 1) sinh H.
    """
    alpha = 1.0 - e
    tau = np.abs(time)
    third = 3.0 * e * np.where(alpha > 0, 1.0 / math.pi**2, 1.0 / 6.0)  # s + third / 3 s^3 <= tau
    root = np.sqrt(np.where(alpha == 0, 1.0, np.abs(alpha)))
    with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
        deep = np.sqrt(third)
        cubic = 2.0 / deep * np.sinh(np.arcsinh(1.5 * deep * tau) / 3.0)
        bound = np.where(deep * tau > 1e-8, cubic, tau)
    bound = np.minimum(bound, tau)
    bound = np.where(alpha > 0, np.minimum(bound, math.pi / root), bound)
    bound = np.where(alpha < 0, np.minimum(bound, np.arcsinh(tau * root) / root), bound)
    s = bound * (1.0 + 4e-16)
    for _ in range(MOST_ITERATIONS):
        _, _, c2, c3 = stumpff(alpha * s * s)
        step = (s + e * s**3 * c3 - tau) / (1.0 + e * s * s * c2)
        s = s - step
        if np.all(np.abs(step) <= 4e-16 * s):
            break
    return np.copysign(s, time)

"""Problems that integrators are measured on, each with a solution that does not come from kickdrift."""

import math
from collections.abc import Callable
from functools import cache
from typing import NamedTuple

import numpy as np
from scipy.integrate import solve_ivp
from scipy.special import ellipj, ellipk

import kickdrift as kd

ECCENTRICITY = 0.3
AMPLITUDE = 1.2  # of the pendulum, in radians
DRIVE = 2.2  # angular frequency of the driven oscillator's force
ENERGETIC = (0.0, 0.1, 0.49, 0.0)  # a start for Henon and Heiles, E = 0.12: chaos begins near 1/8


class Measured(NamedTuple):
    """A problem, how long to run it, and where it then is."""

    problem: Callable[[], kd.Problem]
    length: float
    end: np.ndarray


class Solved(NamedTuple):
    """A problem, its solution at any time, and how long to run it."""

    problem: Callable[[], kd.Problem]
    exact: Callable[[float], np.ndarray]
    length: float


@cache
def pendulum() -> kd.Problem:
    """x'' = -sin x, released at rest."""

    def f(t, y):
        return [y[1], -math.sin(y[0])]

    def energy(t, y):
        return 0.5 * y[1] ** 2 - math.cos(y[0])

    return kd.Problem(f, [AMPLITUDE, 0.0], separable=True, energy=energy, name="pendulum")


def pendulum_exact(t: float) -> np.ndarray:
    """By Jacobi's elliptic functions (Abramowitz & Stegun 1964, ch. 16)."""
    k = math.sin(AMPLITUDE / 2)
    sn, cn = ellipj(t + ellipk(k * k), k * k)[:2]
    return np.array([2 * math.asin(k * sn), 2 * k * cn])


@cache
def kepler_orbit() -> kd.Problem:
    """The ellipse of eccentricity 0.3, from pericentre; G M = 1, semi-major axis 1."""

    def f(t, y):
        r3 = (y[0] * y[0] + y[1] * y[1]) ** 1.5
        return [y[2], y[3], -y[0] / r3, -y[1] / r3]

    return kd.Problem(f, kepler_exact(0.0), separable=True, name="kepler")


def kepler(t: float, e: float) -> tuple[np.ndarray, np.ndarray]:
    """Separation and relative velocity (3,) at time t after pericentre: G (m1 + m2) = 1, semi-major axis 1."""
    eccentric = t
    for _ in range(100):  # Newton's method on E - e sin E = t
        change = (eccentric - e * np.sin(eccentric) - t) / (1.0 - e * np.cos(eccentric))
        eccentric -= change
        if abs(change) < 1e-16 * max(1.0, abs(t)):
            break
    c, s, b = np.cos(eccentric), np.sin(eccentric), np.sqrt(1.0 - e * e)
    return np.array([c - e, b * s, 0.0]), np.array([-s, b * c, 0.0]) / (1.0 - e * c)


def kepler_exact(t: float) -> np.ndarray:
    r, v = kepler(t, ECCENTRICITY)
    return np.array([r[0], r[1], v[0], v[1]])


@cache
def henon_heiles() -> kd.Problem:
    """Henon & Heiles 1964, doi:10.1086/109234."""

    def f(t, y):
        return [y[2], y[3], -y[0] - 2 * y[0] * y[1], -y[1] - y[0] * y[0] + y[1] * y[1]]

    return kd.Problem(f, ENERGETIC, separable=True, name="henon-heiles")


@cache
def driven() -> kd.Problem:
    """x'' = -x + cos(w t): the clock must be right at every stage."""

    def f(t, y):
        return [y[1], -y[0] + math.cos(DRIVE * t)]

    return kd.Problem(f, [0.3, 0.1], separable=True, name="driven oscillator")


def driven_exact(t: float) -> np.ndarray:
    gain = 1.0 / (1.0 - DRIVE**2)
    x = 0.1 * math.sin(t) + (0.3 - gain) * math.cos(t) + gain * math.cos(DRIVE * t)
    return np.array([x, 0.1 * math.cos(t) - (0.3 - gain) * math.sin(t) - gain * DRIVE * math.sin(DRIVE * t)])


@cache
def measured() -> dict[str, Measured]:
    """The four problems of the order test."""
    length = 5.0
    by_scipy = solve_ivp(henon_heiles().f, (0.0, length), ENERGETIC, "DOP853", rtol=1e-13, atol=1e-15).y[:, -1]
    return {
        "pendulum": Measured(pendulum, length, pendulum_exact(length)),
        "kepler": Measured(kepler_orbit, math.pi, kepler_exact(math.pi)),
        "henon-heiles": Measured(henon_heiles, length, by_scipy),
        "driven": Measured(driven, length, driven_exact(length)),
    }


SOLVED = {
    "pendulum": Solved(pendulum, pendulum_exact, 20.0),
    "kepler": Solved(kepler_orbit, kepler_exact, 20.0),
    "driven": Solved(driven, driven_exact, 20.0),
}

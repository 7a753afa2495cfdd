"""Order of a user's splitting or tableau, measured on a Kepler orbit by plain NumPy."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np

from kickdrift.errors import InputError
from kickdrift.integrators.method import Method
from kickdrift.integrators.runge_kutta.method import Tableau
from kickdrift.integrators.splitting.method import Splitting
from kickdrift.integrators.splitting.subflows import DRIFT, KICK
from kickdrift.model.state import Floats

Step = Callable[[float, Floats, float], Floats]

ECCENTRICITY = 0.2
TIME = 1.0  # of the orbit, whose period is 2 pi
GROWTH = 1.25  # ratio of the numbers of steps of two runs that are compared
MOST_STEPS = 3000
LARGEST, SMALLEST = 1e-3, 1e-12  # errors between which the slope is taken; rounding is about 1e-15 a step
SHORTFALL = 0.3  # of the stated order, that a slope between finite steps may miss


def refuse_lower_order(method: Method) -> None:
    """Refuse a method whose measured order is below the stated one."""
    found = measured_order(method)
    if found < method.order - SHORTFALL:
        raise InputError(f"{method.name}: the order is stated as {method.order}, but measured as {found:.1f}")


def measured_order(method: Method) -> float:
    """Return the slope of log error against log dt at the shortest steps whose error is above rounding.

    The problem is a Kepler orbit in the plane with e = 0.2, beside z' = z cos t for a tableau, so that f depends on
    time. Both have exact solutions. An InputError for a method of another family, or for further flows."""
    step, start, end = _stepping(method)
    slopes, before = [], None
    steps = 4
    while steps <= MOST_STEPS:
        error = _error(step, start, end, steps)
        if error < SMALLEST:
            break
        if before and LARGEST > before[1] > error:
            slopes.append(math.log(before[1] / error) / math.log(steps / before[0]))
        before = (steps, error)
        steps = max(steps + 1, round(steps * GROWTH))
    if not slopes:
        raise InputError(
            f"{method.name}: the order cannot be measured; no error lies between {SMALLEST:g} and {LARGEST:g}"
        )
    return float(np.median(slopes[-5:]))


def _stepping(method: Method) -> tuple[Step, Floats, Floats]:
    """Return the step, the start and the exact end."""
    if isinstance(method, Splitting) and not method.further:
        return _splitting_step(method), kepler(0.0), kepler(TIME)
    if isinstance(method, Tableau):
        return _tableau_step(method), np.append(kepler(0.0), 1.0), np.append(kepler(TIME), math.exp(math.sin(TIME)))
    raise InputError(f"{method.name}: the order is measured for splittings of kicks and drifts, and for tableaus")


def kepler(t: float) -> Floats:
    """Position and velocity (4,) at a time after the pericentre, for a = GM = 1."""
    e, anomaly = ECCENTRICITY, t
    for _ in range(50):  # Newton's iteration of Kepler's equation
        anomaly -= (anomaly - e * math.sin(anomaly) - t) / (1 - e * math.cos(anomaly))
    c, s, b = math.cos(anomaly), math.sin(anomaly), math.sqrt(1 - e * e)
    return np.array([c - e, b * s, -s / (1 - e * c), b * c / (1 - e * c)])


def _pull(x: Floats) -> Floats:
    pull: Floats = -x / math.hypot(x[0], x[1]) ** 3
    return pull


def _splitting_step(method: Splitting) -> Step:
    def step(t: float, y: Floats, dt: float) -> Floats:
        y = y.copy()
        for letter, weight in zip(method.letters, method.weights, strict=True):
            if letter == DRIFT:
                y[:2] += weight * dt * y[2:]
            elif letter[0] == KICK:
                y[2:] += weight * dt * _pull(y[:2]) / max(1, method.groups)
        return y

    return step


def _tableau_step(method: Tableau) -> Step:
    def slope(t: float, y: Floats) -> Floats:
        return np.array([*y[2:4], *_pull(y[:2]), y[4] * math.cos(t)])

    def step(t: float, y: Floats, dt: float) -> Floats:
        stages: list[Floats] = []
        for c, row in zip(method.c, ((), *method.a), strict=False):
            stages.append(slope(t + c * dt, y + dt * sum(w * k for w, k in zip(row, stages, strict=True))))
        return y + dt * sum(w * k for w, k in zip(method.b, stages, strict=True))

    return step


def _error(step: Step, start: Floats, end: Floats, steps: int) -> float:
    y, dt = start, TIME / steps
    for k in range(steps):
        y = step(k * dt, y, dt)
    return float(np.abs(y - end).max())

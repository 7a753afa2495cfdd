"""The oracle of the integrators: splitting and Runge-Kutta steps from their definitions, in plain NumPy.

Slow and obvious. ``acceleration`` is a function of time and positions (n, 3). A method is read as its rows of numbers
in the registry.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from kickdrift.integrators import Method
from kickdrift.integrators.splitting.method import Splitting
from kickdrift.integrators.splitting.stormer import Stormer

Acceleration = Callable[[float, np.ndarray], np.ndarray]


def run(method: Method, acceleration: Acceleration, x: np.ndarray, v: np.ndarray, dt: float, steps: int):
    """Positions and velocities (n, 3) after this number of steps from time 0."""
    if isinstance(method, Stormer):
        return two_positions(acceleration, x, v, dt, steps)
    step = splitting_step if isinstance(method, Splitting) else runge_kutta_step
    for number in range(steps):
        x, v = step(method, acceleration, number * dt, x, v, dt)
    return x, v


def two_positions(acceleration: Acceleration, x, v, dt: float, steps: int):
    """x(t + dt) = 2 x(t) - x(t - dt) + dt^2 a(t), with v(t) from the positions on both sides."""
    positions = [x, x + dt * v + 0.5 * dt * dt * acceleration(0.0, x)]
    for number in range(1, steps + 1):
        positions.append(2 * positions[-1] - positions[-2] + dt * dt * acceleration(number * dt, positions[-1]))
    return positions[steps], (positions[steps + 1] - positions[steps - 1]) / (2 * dt)


def splitting_step(method: Splitting, acceleration: Acceleration, t: float, x, v, dt: float):
    """Kicks v += b dt a(t, x) and drifts x += c dt v in turn; the clock moves with the drift."""
    for letter, weight in zip(method.word, method.weights, strict=True):
        if letter == "B":
            v = v + weight * dt * acceleration(t, x)
        else:
            x, t = x + weight * dt * v, t + weight * dt
    return x, v


def runge_kutta_step(method, acceleration: Acceleration, t: float, x, v, dt: float):
    """k_i = f(t + c_i dt, y + dt sum_j a_ij k_j), y <- y + dt sum_i b_i k_i, with f(t, (x, v)) = (v, a(t, x))."""
    k: list[tuple[np.ndarray, np.ndarray]] = []
    for row in ((), *method.a):
        stage_x = x + dt * sum((a * dx for a, (dx, _) in zip(row, k, strict=True)), np.zeros_like(x))
        stage_v = v + dt * sum((a * dv for a, (_, dv) in zip(row, k, strict=True)), np.zeros_like(v))
        k.append((stage_v, acceleration(t + sum(row) * dt, stage_x)))
    x = x + dt * sum(b * dx for b, (dx, _) in zip(method.b, k, strict=True))
    v = v + dt * sum(b * dv for b, (_, dv) in zip(method.b, k, strict=True))
    return x, v

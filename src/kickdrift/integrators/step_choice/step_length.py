"""Test whether fixed steps are short enough for the fastest orbit or spring.

Beyond the limit of stability a run continues without an error, and its result means nothing.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from functools import cache

import numpy as np

from kickdrift.forces.laws.central import gravitational_constant
from kickdrift.integrators.exact.method import Exact
from kickdrift.integrators.flows.flow import Flow
from kickdrift.integrators.flows.particle_flow import ParticleFlow
from kickdrift.integrators.method import Method
from kickdrift.integrators.runge_kutta.method import Tableau
from kickdrift.integrators.splitting.method import Splitting
from kickdrift.integrators.step_choice.stability import imaginary_interval, real_interval, stability_interval
from kickdrift.looks.observers import particles_interact
from kickdrift.model.checks.values import unwarned
from kickdrift.model.state import Floats
from kickdrift.model.system import System
from kickdrift.text import measured

Slope = Callable[[Floats], Floats]

MOST = 2000  # most particles for the search of the fastest oscillation
DENSE = 12  # most particles for the whole matrix
ITERATIONS = 12  # iterations of the power method, which finds the frequency of more particles to some 10 %
DIFFERENCE = 1e-6  # difference, relative to the largest coordinate, for derivatives of accelerations
TOO_LONG = "is too long for a stable run"
LEAPFROG = 2.0  # omega dt of leapfrog, also on whole numbers


@cache
def longest_step(method: Method) -> float | None:
    """Largest omega dt of a stable oscillation, for fixed-step methods with known coefficients; else None.

    For a Runge-Kutta method the larger of both intervals counts: a method unstable at every imaginary number, such as
    Euler's, shows this in the energy.
    """
    if method.chooses_steps or method.overdamped:
        return None
    if isinstance(method, Splitting):
        return stability_interval(method)
    if isinstance(method, Tableau):
        return max(real_interval(method), imaginary_interval(method))
    return LEAPFROG if isinstance(method, Exact) else None


def can_be_checked(flow: Flow, method: Method) -> bool:
    """Tell whether a run is subject to ``step_warning``: fixed steps, not too many particles, and no pair force.

    Under a pair force, or another among all particles, a step that is too long blows up at once.
    """
    if not isinstance(flow, ParticleFlow) or longest_step(method) is None:
        return False
    forces = flow.subject.forces
    return 1 <= len(flow.subject) <= MOST and bool(forces) and not particles_interact(flow.subject)


def step_warning(flow: ParticleFlow, method: Method, dt: float, time: float, y: Floats) -> str | None:
    """One line if dt exceeds the limit of stability for the fastest oscillation about y, else None."""
    limit, omega = longest_step(method), fastest(flow, time, y)
    if limit is None or not omega * dt > limit:
        return None
    unit = measured("", flow.subject.units.symbol("time"))
    period = 2 * math.pi / omega
    return (
        f"dt = {dt:g}{unit} {TOO_LONG}: at t = {time:.6g} the fastest orbit or spring has a period of "
        f"{period:.4g}{unit}, and {method.name} is stable to dt = {limit / omega:.4g}{unit}; the result means nothing"
    )


def start_warning(system: System, method: Method, dt: float) -> str | None:
    """Return ``step_warning`` at the start of a system under gravity alone. A cheap bound clears most steps."""
    limit, phase = longest_step(method), system.state.phase
    if limit is None or not limit < bound_by_gravity(system) * dt < math.inf:
        return None
    return step_warning(ParticleFlow(system, 1, jumps=True), method, dt, system.state.time, phase)


@unwarned
def bound_by_gravity(system: System) -> float:
    """Bound on the angular frequencies about the start: omega^2 <= max_i sum_j 4 G m_j / r_ij^3."""
    force, x = system.forces[0], system.state.positions
    r2 = ((x[:, None] - x[None]) ** 2).sum(axis=-1) + force.softening**2
    np.fill_diagonal(r2, np.inf)
    gm = gravitational_constant(force.name, force.G, system) * system.state.masses
    return math.sqrt(float((4.0 * gm / r2**1.5).sum(axis=1).max()))


def fastest(flow: ParticleFlow, time: float, y: Floats) -> float:
    """Largest angular frequency of the motion linearised about y, in radians per time; 0 without oscillation."""
    n = len(flow.subject)
    x = y[0, :, :n]
    scale = DIFFERENCE * float(np.abs(x).max())

    def slope(direction: Floats) -> Floats:
        """Change of the accelerations along a direction (3, n) of length one."""
        ends = []
        for sign in (1.0, -1.0):
            moved = y.copy()
            moved[0, :, :n] += sign * scale * direction
            found = flow.accelerations(moved, time)
            ends.append(np.full(x.shape, np.nan) if found is None else found)
        return (ends[0] - ends[1]) / (2 * scale)

    if not (math.isfinite(scale) and scale > 0):
        return 0.0
    with np.errstate(all="ignore"):
        least = _dense(slope, x.shape) if x.shape[1] <= DENSE else _by_power(slope, x.shape)
    return math.sqrt(-least) if least < 0 else 0.0


def _dense(slope: Slope, shape: tuple[int, ...]) -> float:
    """Least eigenvalue, from all columns."""
    columns = [slope(one.reshape(shape)).reshape(-1) for one in np.eye(math.prod(shape))]
    matrix = np.array(columns).T
    return float(np.linalg.eigvals(matrix).real.min()) if np.isfinite(matrix).all() else 0.0


def _by_power(slope: Slope, shape: tuple[int, ...]) -> float:
    """Least eigenvalue by the power method, after a shift by the largest one if that is positive."""
    largest = _dominant(slope, shape, 0.0)
    if not largest > 0.0:
        return largest if math.isfinite(largest) else 0.0
    least = _dominant(slope, shape, largest)
    return least if math.isfinite(least) else 0.0


def _dominant(slope: Slope, shape: tuple[int, ...], shift: float) -> float:
    """Eigenvalue furthest from ``shift``."""
    direction = np.random.default_rng(0).standard_normal(shape)
    found = 0.0
    for _ in range(ITERATIONS):
        direction /= np.linalg.norm(direction)
        image = slope(direction) - shift * direction
        found = float((direction * image).sum())
        direction = image
    return found + shift

"""Whether steps are short enough: for the fastest orbit or spring, and for the eigenvalues of a Jacobian.

Beyond the limit of stability a run continues without an error, and its result means nothing.
"""

import math
from collections.abc import Callable, Sequence
from functools import cache
from typing import Any

import numpy as np

from kickdrift.forces.laws.central import gravitational_constant
from kickdrift.integrators.exact.method import Exact
from kickdrift.integrators.flows.flow import Flow
from kickdrift.integrators.flows.particle_flow import ParticleFlow
from kickdrift.integrators.method import Method
from kickdrift.integrators.runge_kutta.method import Tableau
from kickdrift.integrators.splitting.method import Splitting
from kickdrift.integrators.step_choice.stability import (
    imaginary_interval,
    real_interval,
    stability_function,
    stability_interval,
)
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


WATCHED_UNKNOWNS = 64  # most unknowns of a tested run
NEAR = 0.8  # fraction of the distance to the boundary of stability
LIMITED = "limited by stability, not accuracy"
WATCHED_POINTS = 10  # tested points at the end of a run
WATCHED_STEPS = 1000  # least steps of a tested run: a shorter one is over too soon to matter

Point = tuple[float, Floats, float]


def stability_boundary(method: Method, direction: complex) -> float:
    """Largest r with |R(s direction)| <= 1 for all s up to r. ``direction`` has absolute value one."""
    r = np.arange(0.0, 60.0, 0.01)
    beyond = np.abs(stability_function(method)(r * direction)) > 1.0 + 1e-9
    return float(r[np.argmax(beyond) - 1]) if beyond[1:].any() else float(r[-1])


def can_be_limited(flow: Flow, method: Method) -> bool:
    """Tell whether a run is subject to ``stability_warning``: an explicit Runge-Kutta method on few unknowns.

    Particles under velocity-independent forces are excluded. Each of their eigenvalues has its negative: with a mode
    that decays at once comes one that grows as fast, and no step can follow that.
    """
    return (
        isinstance(method, Tableau)
        and _unknowns(flow) <= WATCHED_UNKNOWNS
        and not (isinstance(flow, ParticleFlow) and flow.not_separable is None)
    )


def _unknowns(flow: Flow) -> int:
    return 6 * len(flow.subject) if isinstance(flow, ParticleFlow) else len(flow.subject)


def stability_warning(flow: Flow, method: Method, points: Sequence[Point]) -> str | None:
    """One line if stability and not accuracy limits the steps of an explicit run, else None.

    Take a mode of the linearised equation with Re lambda < 0 that decays by more than e within one step, Re(h lambda) <
    -1. The mode is gone from the solution, and accuracy needs no step that short. If h lambda nevertheless lies near
    the boundary of the method's stability (four fifths of the way or more), stability keeps it there: the error
    estimate grows with the mode as soon as h passes the boundary. This is the test of DOPRI5, h |lambda| > 3.25 of 3.3
    (Hairer & Wanner 1996, IV.2, eq. 2.22 ff., doi:10.1007/978-3-642-05221-7), with the eigenvalue itself instead of an
    estimate. The warning needs this at half of the points or more, since adaptive steps oscillate about the boundary.

    Parameters
    ----------
    flow, method : flow and method of the run
    points : (time, y, last step) at the end of the run; the last ten count
    """
    if not isinstance(method, Tableau) or not can_be_limited(flow, method):
        return None
    stepped = [point for point in points if point[2] > 0.0][-WATCHED_POINTS:]
    limits: list[Any] = []
    for asked, point in enumerate(reversed(stepped), start=1):
        if (found := _limited(flow, method, *point)) is not None:
            limits.append(found)
        elif 2 * (asked - len(limits)) > len(stepped):
            return None
    if not limits:
        return None
    time, step, eigenvalue, boundary = limits[0]
    return (
        f"{LIMITED}: at t = {time:.6g} the step {step:.3g} times the eigenvalue "
        f"{_shown(eigenvalue)} is {step * abs(eigenvalue):.2g}, and {method.name} is stable to {boundary:.2g}; "
        "an implicit method (radau, bdf, rosenbrock) can take longer steps"
    )


def _limited(flow: Flow, method: Tableau, time: float, y: Floats, step: float) -> Any:
    """Time, step, eigenvalue and boundary, if stability limits the step."""
    jacobian = flow.jacobian(time, y)
    if not np.isfinite(jacobian).all():
        return None
    if step * float(np.linalg.norm(jacobian)) < 1.0:  # no eigenvalue is larger than this norm
        return None
    eigenvalues = np.linalg.eigvals(jacobian)
    worst = None
    for value in eigenvalues[step * eigenvalues.real < -1.0]:
        boundary = stability_boundary(method, value / abs(value))
        part = step * abs(value) / boundary
        if part >= NEAR and (worst is None or part > worst[0]):
            worst = part, (time, step, complex(value), boundary)
    return None if worst is None else worst[1]


def _shown(value: complex) -> str:
    if value.imag == 0.0:
        return f"{value.real:.3g}"
    return f"{value.real:.3g} {'-' if value.imag < 0 else '+'} {abs(value.imag):.3g}i"

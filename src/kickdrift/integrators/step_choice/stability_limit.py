"""Test whether eigenvalues of the Jacobian, and not accuracy, limit an explicit run's steps."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from kickdrift.integrators.flows.flow import Flow
from kickdrift.integrators.flows.particle_flow import ParticleFlow
from kickdrift.integrators.method import Method
from kickdrift.integrators.runge_kutta.method import Tableau
from kickdrift.integrators.step_choice.stability import stability_function
from kickdrift.model.state import Floats

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

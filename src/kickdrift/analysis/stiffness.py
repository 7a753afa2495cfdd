"""Stiffness: what the eigenvalues of the Jacobian along a solution say."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from kickdrift.engines.session import EngineFlow, RunFlow
from kickdrift.errors import InputError
from kickdrift.integrators.flow import Flow, flow_of
from kickdrift.model.problem import Problem
from kickdrift.model.state import Floats
from kickdrift.model.system import System
from kickdrift.run.simulation import Simulation

DIFFERENCES = 1e-9  # relative error of a Jacobian by differences, with some room


@dataclass(frozen=True)
class Stiffness:
    """The Jacobian's eigenvalues at one point of a solution.

    Attributes
    ----------
    time : of the point
    eigenvalues : (N,) complex, the real parts rising
    rounding : eigenvalues no larger than this cannot be told from 0
    step : h, the step there, None where none was taken
    """

    time: float
    eigenvalues: NDArray[np.complexfloating]
    rounding: float
    step: float | None = None

    @property
    def ratio(self) -> float:
        """max |Re lambda| / min |Re lambda|, over the eigenvalues with Re lambda < 0 (Lambert 1991, Numerical Methods
        for Ordinary Differential Systems, section 6.1); nan where there is none.

        Those that rounding cannot tell from 0, such as that of a conserved sum, do not count."""
        decay = -self.eigenvalues.real
        decay = decay[decay > self.rounding]
        return float(decay.max() / decay.min()) if decay.size else float("nan")

    @property
    def fastest(self) -> complex:
        """The eigenvalue of the largest absolute value."""
        return complex(self.eigenvalues[np.argmax(np.abs(self.eigenvalues))])

    @property
    def step_times_rate(self) -> float | None:
        """h |lambda|, of the largest; an explicit method needs it to be of order one."""
        return None if self.step is None else self.step * abs(self.fastest)


def stiffness(subject: Simulation | System | Problem, states: Iterable[Any] | None = None) -> list[Stiffness]:
    """The eigenvalues of the Jacobian df/dy of y' = f(t, y) at points of a solution, y the positions and velocities of
    particles or the unknowns of a Problem.

    Parameters
    ----------
    subject : a Simulation, a System or a Problem
    states : the points, States or ProblemStates as ``Simulation.state`` gives them; default the present (of a
        Simulation, which also knows its step) or the start

    Raises
    ------
    InputError
        Where a state is not one of the subject's, or the Jacobian is too large to hold (3000 unknowns).
    """
    flow: RunFlow
    if isinstance(subject, (System, Problem)):
        flow, step = flow_of(subject, 1, jumps=True), None
    else:
        flow, step = subject.integration.flow, subject.integration.stepper.last_step or None
        if isinstance(flow, EngineFlow):
            raise InputError(
                f"stiffness: engine {subject.engine!r} gives forces only at its present state; give the System instead"
            )
    points: list[Any] = [subject.state] if states is None else list(states)
    return [_stiffness(flow, state.time, flow.array(state), step if states is None else None) for state in points]


def _stiffness(flow: Flow, time: float, y: Floats, step: float | None) -> Stiffness:
    jacobian = flow.jacobian(time, y)
    if not np.isfinite(jacobian).all():
        raise InputError(f"stiffness: the Jacobian at t = {time:.6g} is not finite")
    eigenvalues = np.sort_complex(np.linalg.eigvals(jacobian))
    error = 10 * float(np.finfo(float).eps) if flow.analytic else DIFFERENCES
    return Stiffness(time, eigenvalues, error * float(np.linalg.norm(jacobian, 2)), step)

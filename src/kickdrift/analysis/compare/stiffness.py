"""Stiffness, from the eigenvalues of the Jacobian along a solution."""

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from kickdrift.engines.session import EngineFlow, RunFlow
from kickdrift.errors import InputError
from kickdrift.integrators.flows.flow import Flow, flow_of
from kickdrift.model.problem import Problem
from kickdrift.model.state import Floats
from kickdrift.model.system import System
from kickdrift.run.simulation import Simulation

DIFFERENCES = 1e-9  # relative error of a Jacobian by differences, with a margin


@dataclass(frozen=True)
class Stiffness:
    """The Jacobian's eigenvalues at one point of a solution.

    Attributes
    ----------
    time : time of the point
    eigenvalues : (N,) complex, sorted by rising real parts
    rounding : smaller eigenvalues cannot be told from 0
    step : step h at this point; None if no step was taken
    """

    time: float
    eigenvalues: NDArray[np.complexfloating]
    rounding: float
    step: float | None = None

    @property
    def ratio(self) -> float:
        """max |Re lambda| / min |Re lambda|, over the eigenvalues with Re lambda < 0; nan if there is none.

        Source: Lambert 1991, Numerical Methods for Ordinary Differential Systems, section 6.1. Eigenvalues that
        rounding cannot tell from 0, such as that of a conserved sum, do not count."""
        decay = -self.eigenvalues.real
        decay = decay[decay > self.rounding]
        return float(decay.max() / decay.min()) if decay.size else float("nan")

    @property
    def fastest(self) -> complex:
        """Eigenvalue with the largest absolute value."""
        return complex(self.eigenvalues[np.argmax(np.abs(self.eigenvalues))])

    @property
    def step_times_rate(self) -> float | None:
        """h |lambda| for the largest eigenvalue. An explicit method needs a value of order one."""
        return None if self.step is None else self.step * abs(self.fastest)


def stiffness(subject: Simulation | System | Problem, states: Iterable[Any] | None = None) -> list[Stiffness]:
    """Eigenvalues of the Jacobian df/dy of y' = f(t, y) at points of a solution.

    y holds the positions and velocities of particles, or the unknowns of a Problem.

    Parameters
    ----------
    subject : a Simulation, a System or a Problem
    states : the points, as States or ProblemStates from ``Simulation.state``. Default: the current point of a
        Simulation, with its step, or the start

    Raises
    ------
    InputError
        If a state does not belong to the subject, or the Jacobian is too large for memory (3000 unknowns).
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

"""A solver of SciPy's under way."""

from __future__ import annotations

import warnings
from typing import TYPE_CHECKING, Any

import numpy as np
from scipy import integrate
from scipy.linalg import LinAlgError

from kickdrift.flow import ParticleFlow
from kickdrift.forces.kernel import BLOWN_UP, OK
from kickdrift.integrators.step_control import check_tolerances
from kickdrift.integrators.stepping import STOPPED, Counts, Options
from kickdrift.integrators.stepwise import PythonStepper, check_unknowns
from kickdrift.state import Floats

if TYPE_CHECKING:
    from kickdrift.flow import Flow
    from kickdrift.integrators.scipy_methods import SciPyMethod


class SciPyStepper(PythonStepper):
    """One of ``scipy.integrate.OdeSolver``, with no end to reach, so that its steps depend on none.

    All that it keeps from step to step is inside the solver; one that begins anew at a step point takes other steps.
    """

    def __init__(self, flow: Flow, method: SciPyMethod, options: Options) -> None:
        super().__init__(flow)
        self.rtol, self.atol = options.tolerances
        check_tolerances(self.rtol, self.atol)
        check_unknowns(method.name, flow)
        self._method, self._first = method, options.dt
        self._analytic = not isinstance(flow, ParticleFlow) and flow.subject.jacobian is not None
        self._jacobians_before = 0

    def _forget(self) -> None:
        self._jacobians_before = self.counts.jacobians
        self._solver: Any = None
        self._bad: Floats | None = None  # where f was no number

    @property
    def counts(self) -> Counts:
        counts = super().counts
        if not self._analytic:  # the solver takes differences of f, which counts itself
            solver = getattr(self, "_solver", None)
            counts.jacobians = self._jacobians_before + (int(solver.njev) if solver else 0)
        return counts

    def _right_hand_side(self, time: float, y: Floats) -> Floats:
        f = self._f(time, y.reshape(self.y.shape))
        self._bad = None if np.isfinite(f).all() else y.reshape(self.y.shape) + f
        return f.reshape(-1)

    def _begin(self, time: float, y: Floats, end: float = np.inf, first: float | None = None) -> Any:
        jac = (lambda time, y: self._jacobian(time, y.reshape(self.y.shape))) if self._analytic else None
        return getattr(integrate, self._method.solver)(
            self._right_hand_side, time, y.reshape(-1), end, first_step=first, rtol=self.rtol, atol=self.atol, jac=jac,
        )  # fmt: skip

    def _step(self) -> int:
        with warnings.catch_warnings(record=True) as said:
            warnings.simplefilter("always")
            try:
                self._solver = self._solver or self._begin(self.time, self.y, first=self._first)
                message = self._solver.step()
                failed = self._solver.status == "failed" or not np.isfinite(self._solver.y).all()
            except (ValueError, RuntimeError, LinAlgError) as error:  # of matrices and states that are no numbers
                message, failed = str(error), True
        if failed:
            if self._bad is not None:
                self._reached = self._bad
                return BLOWN_UP
            reasons = [str(warning.message) for warning in said] or [message or "the solution is no number"]
            self.trouble = f"SciPy's {self._method.solver} gave up: {' '.join(reasons[-1].split())}"
            return STOPPED
        self._before, self.y = self.y, self._solver.y.reshape(self.y.shape).copy()
        self.last_step, self.time = float(self._solver.t - self.time), float(self._solver.t)
        return OK

    def at(self, time: float) -> Floats:
        """By steps from the last step point that end there, thrown away: inside a long step of a stiff problem SciPy's
        interpolants are off by a thousand tolerances."""
        if time == self.time or self._solver is None:
            return self.y.copy()
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            solver = self._begin(self.time - self.last_step, self._before, time)
            while solver.status == "running":
                solver.step()
        found = solver.y if solver.status == "finished" else self._solver.dense_output()(time)
        return found.reshape(self.y.shape).copy()

"""kickdrift's adaptive methods as solvers of ``scipy.integrate.solve_ivp``, for SciPy's own tests.

Time runs backward by -t, and complex y is its real and imaginary parts. Unlike a Simulation, and like SciPy's solvers,
they never step past the end of the interval or further than ``max_step``. An error is measured over the parts of y, so
for a complex y it is up to sqrt(2) smaller than SciPy's.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from scipy.integrate import DenseOutput, OdeSolver
from scipy.integrate._ivp.common import validate_first_step, validate_max_step, validate_tol, warn_extraneous

import kickdrift as kd
from kickdrift.forces.kernel import OK
from kickdrift.integrators import integrator
from kickdrift.integrators.adaptive import LAST, NEXT
from kickdrift.integrators.options import Options
from kickdrift.integrators.problem_flow import ProblemFlow
from kickdrift.integrators.step_control import LEAST_RTOL


class Adapter(OdeSolver):
    """One of our methods in the form of SciPy's solvers."""

    method: str
    error_estimator_order: int
    steps_taken = 0

    def __init__(
        self,
        fun: Any,
        t0: float,
        y0: Any,
        t_bound: float,
        max_step: float = np.inf,
        rtol: Any = 1e-3,
        atol: Any = 1e-6,
        vectorized: bool = False,
        first_step: float | None = None,
        **extraneous: Any,
    ) -> None:
        warn_extraneous(extraneous)
        super().__init__(fun, t0, y0, t_bound, vectorized, support_complex=True)
        self.max_step = validate_max_step(max_step)
        rtol, atol = validate_tol(rtol, atol, self.n)
        if first_step is not None:
            validate_first_step(first_step, t0, t_bound)
        if self.n == 0:
            return  # SciPy's base class does the rest; a Problem has at least one unknown
        self.complex = np.iscomplexobj(self.y)
        way = float(self.direction)

        def f(s: float, y: Any) -> Any:
            s = min(s, way * t_bound)  # c adds up to 1 + 4e-16 in some rows
            return way * self._flat(np.asarray(self.fun(way * s, self._shaped(y))))

        problem = kd.Problem(f, self._flat(self.y), t0=way * t0, compiled=False)
        smallest = LEAST_RTOL, np.finfo(float).tiny
        tolerances = [max(float(np.min(value)), least) for value, least in zip((rtol, atol), smallest, strict=True)]
        self.options = Options(dt=first_step, rtol=tolerances[0], atol=tolerances[1])
        self.flow = ProblemFlow(problem, 1, True)
        self.stepper: Any = integrator(self.method).stepper(self.flow, self.options)
        self.stepper.reset(self.flow.array(problem.state), problem.t0, 0)

    def _flat(self, y: Any) -> Any:
        return np.concatenate([y.real, y.imag]) if self.complex else np.array(y, dtype=float)

    def _shaped(self, y: Any) -> Any:
        y = y.reshape(-1)
        return y[: self.n] + 1j * y[self.n :] if self.complex else y.copy()

    def _step_impl(self) -> tuple[bool, str | None]:
        stepper = self.stepper
        clock = stepper._clock
        if clock[NEXT] == 0.0:
            clock[NEXT] = self.options.dt or stepper._first_step()
        left = self.direction * self.t_bound - stepper.time
        clock[NEXT] = min(clock[NEXT], left, self.max_step)
        if stepper.steps_done == 0:  # SciPy's first step ignores max_step
            clock[NEXT] = max(clock[NEXT], min(left, 20 * np.spacing(abs(self.t))))
        if stepper.advance(1) != OK:
            if self.flow.raised is not None:
                raise self.flow.raised
            return False, self.TOO_SMALL_STEP
        self.t = self.t_bound if clock[LAST] == left else self.direction * stepper.time
        self.y = self._shaped(stepper.y)
        type(self).steps_taken += 1
        return True, None

    def _dense_output_impl(self) -> DenseOutput:
        return Dense(self)


class Dense(DenseOutput):
    """Interpolant of the last step."""

    def __init__(self, solver: Adapter) -> None:
        super().__init__(solver.t_old, solver.t)
        stepper = solver.stepper
        self.shaped, self.begin, self.h = solver._shaped, stepper._before.copy(), stepper._clock[LAST]
        self.end = stepper.y.copy()
        self.stages, self.weights = stepper._dense_stages().copy(), np.array(stepper._tableau.dense)

    def _call_impl(self, t: Any) -> Any:
        theta = (np.atleast_1d(t) - self.t_old) / (self.t - self.t_old)
        powers = theta ** np.arange(1, self.weights.shape[1] + 1)[:, None]
        values = [
            self.shaped(self.end if part == 1.0 else self.begin + self.h * np.tensordot(row, self.stages, 1))
            for part, row in zip(theta, (self.weights @ powers).T, strict=True)
        ]
        found = np.array(values).T
        return found[:, 0] if np.ndim(t) == 0 else found


class RK23(Adapter):
    """bogacki-shampine23."""

    method, error_estimator_order = "bogacki-shampine23", 2


class RK45(Adapter):
    """dormand-prince45."""

    method, error_estimator_order = "dormand-prince45", 4


class DOP853(Adapter):
    """dop853."""

    method, error_estimator_order = "dop853", 7


SOLVERS = (RK23, RK45, DOP853)


def pytest_configure() -> None:
    """Put our methods into the places of SciPy's, before SciPy's tests import them. For use as a pytest plugin."""
    import scipy.integrate
    from scipy.integrate._ivp import ivp

    for solver in SOLVERS:
        ivp.METHODS[solver.__name__] = solver
        setattr(scipy.integrate, solver.__name__, solver)


def pytest_terminal_summary(terminalreporter: Any) -> None:
    """Print which methods took the steps."""
    for solver in SOLVERS:
        terminalreporter.write_line(f"{solver.method} took {solver.steps_taken} steps")

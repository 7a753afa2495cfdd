"""Integration with a Rosenbrock method. Its error sets the step, as in an embedded Runge-Kutta method."""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple, Protocol

import numpy as np

from kickdrift.forces.seam.kernel import BLOWN_UP, OK
from kickdrift.integrators.options.options import Options
from kickdrift.integrators.runge_kutta.adaptive import scaled_error
from kickdrift.integrators.runge_kutta.tableaus import Rows, lower
from kickdrift.integrators.stepping.step_control import (
    EPSILON,
    FLOOR,
    controller,
    first_step,
    rejected_factor,
    step_factor,
    tolerances_of,
)
from kickdrift.integrators.stepping.stepper import STOPPED
from kickdrift.integrators.stepping.stepwise import PythonStepper, check_unknowns, factored
from kickdrift.model.state import Floats

if TYPE_CHECKING:
    from kickdrift.integrators.flows.flow import Flow
    from kickdrift.integrators.flows.jacobian import Derivative


class Tangent(NamedTuple):
    """f and its derivatives at a step point."""

    f: Floats
    by_y: Floats  # (N, N)
    by_t: Floats


class LinearStages(Protocol):
    """Numbers of a Rosenbrock method, as its steps use them; see ``Rosenbrock``."""

    @property
    def name(self) -> str: ...

    @property
    def gamma(self) -> float: ...

    @property
    def a(self) -> Rows: ...

    @property
    def c(self) -> Rows: ...

    @property
    def m(self) -> tuple[float, ...]: ...

    @property
    def errors(self) -> tuple[float, ...]: ...

    @property
    def error_order(self) -> int: ...

    @property
    def sums(self) -> tuple[Floats, Floats]: ...


class RosenbrockStepper(PythonStepper):
    """Integration with an embedded Rosenbrock method. A checkpoint holds the next step, the errors of the last two
    steps and the start of the last step."""

    saved = (*PythonStepper.saved, "_next", "_errors", "_begun")

    def __init__(self, flow: Flow, tableau: LinearStages, options: Options) -> None:
        super().__init__(flow)
        self.rtol, self.atol = tolerances_of(flow, options)
        check_unknowns(tableau.name, flow)
        self._tableau, self._first, self._longest = tableau, options.dt, options.longest
        self._numbers = controller(options.controller).numbers
        self._exponent = 1.0 / (tableau.error_order + 1)
        self._a, self._c = lower(tableau.a), lower(tableau.c)

    def _forget(self) -> None:
        self._next = 0.0
        self._errors = [FLOOR, FLOOR]  # of the last two steps
        self._begun = self.time
        self._bad: Floats | None = None  # value of f that was not finite in the last attempt
        self._tangent: Tangent | None = None  # at the start of the last step, for samples

    def _step(self) -> int:
        t, y, rejected = self.time, self.y, False
        f = self._f(t, y)
        if not np.isfinite(f).all():
            return self._blow_up(f)
        h = min(self._next or self._first_step(self._f, f) or 0.0, self._longest)
        last = t + h > self.end
        h = self.end - t if last else h
        tangent = Tangent(f, self._jacobian(t, y), _by_time(self._f, t, y, f, h))
        if not np.isfinite(tangent.by_t).all():
            return self._blow_up(tangent.by_t)
        while last or h > 10.0 * np.spacing(abs(t)):
            trial, error = self._try(self._f, t, y, h, tangent)
            if error <= 1.0:
                factor = step_factor.py_func(self._numbers, self._exponent, error, *self._errors)
                following = h * (min(1.0, factor) if rejected else factor)
                self._next = max(following, self._next) if last else following
                self._errors = [error, self._errors[0]]
                self._before, self.y, self._tangent = y, trial, None
                self._begun, self.time, self.last_step = t, self.end if last else t + h, h
                return OK
            last = False
            h *= rejected_factor.py_func(self._numbers, self._exponent, error)
            rejected = True
            self._counts.rejected += 1
        if self._bad is not None:
            self._reached = self._bad
            return BLOWN_UP
        self.trouble = f"the step fell to {h:.3g}, too short to change t = {t:.9g}"
        return STOPPED

    def _first_step(self, derivative: Derivative, f: Floats) -> float | None:
        order, limits = self._tableau.error_order, (self.end, self.clip)
        return self._first or first_step(derivative, self.time, self.y, f, order, self.rtol, self.atol, *limits)

    def _fits(self) -> bool:
        h: float | None = self._next
        if not h:
            f = self._flow.derivative(self.time, self.y)
            h = self._first_step(self._flow.derivative, f) if np.isfinite(f).all() else 0.0
        return h is not None and self.time + min(h, self._longest) <= self.end

    def _try(self, derivative: Derivative, t: float, y: Floats, h: float, tangent: Tangent) -> tuple[Floats, float]:
        """Try a step of h from (t, y). Return its end and its error over the tolerance, infinite if there is none."""
        method = self._tableau
        matrix = -tangent.by_y
        np.einsum("ii->i", matrix)[...] += 1.0 / (h * method.gamma)
        solve = factored(matrix)
        self._bad = None
        u = np.zeros((len(method.m), *y.shape))
        for i, (alpha, gamma) in enumerate(zip(*method.sums, strict=True)):
            stage = y + np.tensordot(self._a[i, :i], u[:i], 1)
            f = derivative(min(t + alpha * h, t + h, self.end), stage) if i else tangent.f
            right = f + np.tensordot(self._c[i, :i], u[:i], 1) / h + gamma * h * tangent.by_t
            if not np.isfinite(f).all():
                self._bad = stage + f
            u[i] = solve(right.reshape(-1)).reshape(y.shape)
            if not np.isfinite(u[i]).all():
                return y, np.inf
        trial = y + np.tensordot(method.m, u, 1)
        estimate = np.tensordot(method.errors, u, 1).reshape(1, -1)
        ends = y.reshape(-1), trial.reshape(-1)
        error = scaled_error.py_func(*ends, np.ones((1, 1)), 1.0, estimate, self.rtol, self.atol)
        return trial, float(error) if np.isfinite(error) else np.inf

    def at(self, time: float) -> Floats:
        """State at a time, by a discarded step from the last step point. It depends only on that point."""
        if time == self.time or self.last_step == 0.0:
            return self.y.copy()
        begin, y, derivative, bad = self._begun, self._before, self._flow.derivative, self._bad
        with np.errstate(all="ignore"):
            if self._tangent is None:
                f = derivative(begin, y)
                by_time = _by_time(derivative, begin, y, f, self.last_step)
                self._tangent = Tangent(f, self._flow.jacobian(begin, y), by_time)
            found = self._try(derivative, begin, y, time - begin, self._tangent)[0].copy()
        self._bad = bad
        return found


def _by_time(derivative: Derivative, t: float, y: Floats, f: Floats, h: float) -> Floats:
    """Return df/dt by central differences over a short part of the step, since f may change with t as fast as that.

    At a start before which f is not finite, use forward differences. Neither goes beyond the step.
    """
    apart = min(max(EPSILON ** (1 / 3) * h, 1000.0 * float(np.spacing(abs(t)))), h)
    after, before = t + apart, t - apart
    ahead, behind = derivative(after, y), derivative(before, y)
    if not np.isfinite(behind).all():
        return (ahead - f) / (after - t)
    return (ahead - behind) / (after - before)

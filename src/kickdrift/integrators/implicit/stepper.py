"""Integration with implicit methods: the iteration for Runge-Kutta stages, and Rosenbrock's linear stages.

A Rosenbrock method's error sets the step, as in an embedded Runge-Kutta method.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import TYPE_CHECKING, Any, NamedTuple, Protocol

import numpy as np

from kickdrift.forces.seam.kernel import BLOWN_UP, OK
from kickdrift.integrators.flows.particle_flow import ParticleFlow
from kickdrift.integrators.options import Options
from kickdrift.integrators.runge_kutta.adaptive import scaled_error
from kickdrift.integrators.runge_kutta.tableaus import Rows, lower
from kickdrift.integrators.stepping import step_control
from kickdrift.integrators.stepping.stepper import STOPPED
from kickdrift.integrators.stepping.stepping import Retimed
from kickdrift.integrators.stepping.stepwise import PythonStepper, check_unknowns, factored
from kickdrift.model.memory import Memory
from kickdrift.model.state import Floats

if TYPE_CHECKING:
    from kickdrift.integrators.flows.flow import Flow
    from kickdrift.integrators.flows.jacobian import Derivative


ROUNDED = 1e-10  # a stalled increment below this fraction of y is rounding; above, the iteration diverges
LEFT = (
    1e-3 * step_control.EPSILON
)  # allowed error over y: its sign is the same in each step, and 0.1 of rounding showed as a drift
MOST = {"newton": 50, "fixed-point": 100}  # iterations
SLOW = 10  # from this many iterations on, a new Jacobian pays

Correction = Callable[[Floats, Floats], Floats]  # from the stages and their residual


class StageEquations(Protocol):
    """Numbers of an implicit Runge-Kutta method, as its steps use them; see ``ImplicitTableau``."""

    @property
    def name(self) -> str: ...

    @property
    def b(self) -> tuple[float, ...]: ...

    @property
    def c(self) -> tuple[float, ...]: ...

    @property
    def matrix(self) -> Floats: ...

    @property
    def increment(self) -> Floats: ...

    @property
    def extrapolation(self) -> Floats: ...


class ImplicitStepper(Retimed, PythonStepper):
    """Steps of one length. With Z_i = Y_i - y the stages solve Z = dt (a x I) F(Z).

    Newton's matrix I - dt a x J is kept from step to step while it converges quickly. The stages are kept for the next
    guess. So a run cut in pieces gives the same bits, and a run that starts anew at a step point agrees to rounding. A
    checkpoint holds the stages, the carries of compensated sums, and the place of J instead of the matrix.
    """

    saved = (*PythonStepper.saved, "_start", "_carry", "_stages", "_matrix_at")

    def __init__(self, flow: Flow, tableau: StageEquations, options: Options) -> None:
        super().__init__(flow)
        assert options.dt is not None
        self._tableau, self.dt, self._compensated = tableau, options.dt, options.compensated
        self.iteration = options.iteration or ("fixed-point" if isinstance(flow, ParticleFlow) else "newton")
        if self.iteration == "newton":
            check_unknowns(tableau.name, flow, '; iteration="fixed-point" needs none')

    def _forget(self) -> None:
        self._start = self.time - self.steps_done * self.dt
        self._carry = np.zeros_like(self.y)
        self._stages: Floats | None = None
        self._solve: Callable[[Floats], Floats] | None = None
        self._matrix_at: Any = None  # the time and the y of its Jacobian

    def recall(self, memory: Memory) -> None:
        """See Stepper."""
        super().recall(memory)
        if self._matrix_at:
            cost = replace(self._counts)
            self._solve = self._newton_matrix(*self._matrix_at)
            self._counts = cost

    def _step(self) -> int:
        z = self._find_stages()
        if z is None:
            return self._give_up()
        self._before[...] = self.y
        increment = np.tensordot(self._tableau.increment, z, 1)
        if self._compensated:  # like loops.add_compensated
            increment += self._carry
            self.y += increment
            self._carry = increment + (self._before - self.y)
        else:
            self.y += increment
        self._stages, self.last_step = z, self.dt
        self.time = self._start + (self.steps_done + 1) * self.dt
        return OK

    def _give_up(self) -> int:
        for c in self._tableau.c:
            f = self._f(self.time + c * self.dt, self.y)
            if not np.isfinite(f).all():  # not the iteration's fault
                return self._blow_up(f)
        other = ', or iteration="newton"' if self.iteration == "fixed-point" else ""
        self.trouble = (
            f"the {self.iteration} iteration for the stages does not converge with dt = {self.dt:g}; take a smaller "
            f"dt{other}"
        )
        return STOPPED

    # --- the stages ---

    def _find_stages(self) -> Floats | None:
        """Stages Z (s, *y.shape); None if no iteration converges."""
        nothing = np.zeros((len(self._tableau.b), *self.y.shape))
        guess = nothing if self._stages is None else np.tensordot(self._tableau.extrapolation, self._stages, 1)
        if self.iteration == "fixed-point":
            return self._iterate(guess, lambda z, residual: residual, memory=2)[0]
        if self._solve is not None:
            z, count = self._iterate(guess, self._simplified)
            if z is not None:
                if count > SLOW:
                    self._solve = self._matrix_at = None
                return z
        self._solve = self._newton_matrix(self.time, self.y)
        z, count = self._iterate(guess, self._simplified)
        if z is None:
            z, count = self._iterate(nothing, self._newton, patient=True)
        if count > SLOW:
            self._solve = self._matrix_at = None
        return z

    def _iterate(
        self, z: Floats, correct: Correction, memory: int = 1, patient: bool = False
    ) -> tuple[Floats | None, int]:
        """Correct z until only rounding is left. Return z, or None if that fails, and the number of iterations.

        The increments shrink at a rate. z is final once the remaining increments are below rounding, or stop shrinking
        while tiny (Hairer & Wanner 1996, IV.8; Hairer, Lubich & Wanner 2006, VIII.6). ``memory`` is the number of
        iterations for the rate: 2 if positions feel a force one iteration after the velocities. With ``patient``,
        increments may grow meanwhile.
        """
        h, c = self.dt, self._tableau.c
        sizes: list[float] = []
        for count in range(1, MOST[self.iteration] + 1):
            f = np.array([self._f(self.time + ci * h, self.y + zi) for ci, zi in zip(c, z, strict=True)])
            change = correct(z, h * np.tensordot(self._tableau.matrix, f, 1) - z)
            z = z + change
            size = self._relative(change, z)
            if size == 0.0:
                return z, count
            if not np.isfinite(size):
                return None, count
            if count > memory:
                rate = (size / sizes[-memory]) ** (1.0 / memory)
                if rate >= 1.0 and size <= ROUNDED:
                    return z, count
                if rate >= 1.0 and not patient:
                    return None, count
                if rate < 1.0 and size * rate <= LEFT * (1.0 - rate):
                    return z, count
            sizes.append(size)
        return None, MOST[self.iteration]

    def _relative(self, change: Floats, z: Floats) -> float:
        """Largest change over the largest position or velocity, each in its own unit."""
        axes = tuple(range(1, self.y.ndim))
        scale = np.abs(self.y).max(axis=axes) + np.abs(z).max(axis=(0, *(k + 1 for k in axes)))
        largest = np.abs(change).max(axis=(0, *(k + 1 for k in axes)))
        return float(np.where(scale > 0.0, largest / np.where(scale > 0.0, scale, 1.0), largest).max())

    def _simplified(self, z: Floats, residual: Floats) -> Floats:
        assert self._solve is not None
        return self._solve(residual.reshape(-1)).reshape(z.shape)

    def _newton(self, z: Floats, residual: Floats) -> Floats:
        """Compute the matrix anew, from the mean of the stages."""
        c = float(np.mean(self._tableau.c))
        self._solve = self._newton_matrix(self.time + c * self.dt, self.y + z.mean(axis=0))
        return self._simplified(z, residual)

    def _newton_matrix(self, time: float, y: Floats) -> Callable[[Floats], Floats]:
        self._matrix_at = [time, y.copy()]
        matrix = np.asarray(-np.kron(self.dt * self._tableau.matrix, self._jacobian(time, y)), dtype=float)
        np.einsum("ii->i", matrix)[...] += 1.0
        return factored(matrix)


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
        self.rtol, self.atol = step_control.tolerances_of(flow, options)
        check_unknowns(tableau.name, flow)
        self._tableau, self._first, self._longest = tableau, options.dt, options.longest
        self._numbers = step_control.controller(options.controller).numbers
        self._exponent = 1.0 / (tableau.error_order + 1)
        self._a, self._c = lower(tableau.a), lower(tableau.c)

    def _forget(self) -> None:
        self._next = 0.0
        self._errors = [step_control.FLOOR, step_control.FLOOR]  # of the last two steps
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
                factor = step_control.step_factor.py_func(self._numbers, self._exponent, error, *self._errors)
                following = h * (min(1.0, factor) if rejected else factor)
                self._next = max(following, self._next) if last else following
                self._errors = [error, self._errors[0]]
                self._before, self.y, self._tangent = y, trial, None
                self._begun, self.time, self.last_step = t, self.end if last else t + h, h
                return OK
            last = False
            h *= step_control.rejected_factor.py_func(self._numbers, self._exponent, error)
            rejected = True
            self._counts.rejected += 1
        if self._bad is not None:
            self._reached = self._bad
            return BLOWN_UP
        self.trouble = f"the step fell to {h:.3g}, too short to change t = {t:.9g}"
        return STOPPED

    def _first_step(self, derivative: Derivative, f: Floats) -> float | None:
        order, limits = self._tableau.error_order, (self.end, self.clip)
        return self._first or step_control.first_step(
            derivative, self.time, self.y, f, order, self.rtol, self.atol, *limits
        )

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
    apart = min(max(step_control.EPSILON ** (1 / 3) * h, 1000.0 * float(np.spacing(abs(t)))), h)
    after, before = t + apart, t - apart
    ahead, behind = derivative(after, y), derivative(before, y)
    if not np.isfinite(behind).all():
        return (ahead - f) / (after - t)
    return (ahead - behind) / (after - before)

"""Embedded Runge-Kutta methods: the error sets the step. The last step is kept, so that y is known inside it."""

from __future__ import annotations

from functools import cached_property
from typing import TYPE_CHECKING, Protocol

import numpy as np

from kickdrift.forces.bound.table import fill_derivative
from kickdrift.forces.seam.kernel import GROW, OK, RAISED
from kickdrift.integrators.options import Options
from kickdrift.integrators.stepping import step_control
from kickdrift.integrators.stepping.chosen_steps import BEFORE, LAST, NEXT, TIME, ChosenSteps
from kickdrift.integrators.stepping.loops import FRESH, REJECTED, STAGE, STEP, stage_state
from kickdrift.integrators.stepping.stepper import INNER, STOPPED
from kickdrift.integrators.stepping.stepping import CompiledSteps
from kickdrift.jit.compile import driver, jit
from kickdrift.jit.handle import handle
from kickdrift.model.state import Floats

if TYPE_CHECKING:
    from kickdrift.integrators.flows.flow import Flow
    from kickdrift.integrators.flows.jacobian import Derivative
    from kickdrift.integrators.runge_kutta.tableaus import Rows

# Further slots of the clock: the errors of the last two steps, whether the last attempt failed.
ERROR, ERROR_BEFORE, REJECTED_LAST = range(4, 7)
SKETCHED = 5  # degree of y' in a rough interpolant


@jit
def scaled_error(y, trial, errors, h, k, rtol, atol):
    """Root mean square of the error estimate over its tolerance atol + rtol |y|, with |y| the larger of both ends
    (Hairer, Norsett & Wanner 1993, eq. II.4.11).

    Two rows of ``errors``, E5 and E3, give E5^2 / sqrt(E5^2 + 0.01 E3^2) (II.10). y, trial, rtol and atol are (N,), k
    (stages, N).
    """
    first, second, stages = 0.0, 0.0, errors.shape[1]
    two = errors.shape[0] == 2
    for i in range(y.size):
        e, e3 = 0.0, 0.0
        for j in range(stages):
            e += errors[0, j] * k[j, i]
            if two:
                e3 += errors[1, j] * k[j, i]
        scale = atol[i] + rtol[i] * max(abs(y[i]), abs(trial[i]))
        first += (e / scale) ** 2
        second += (e3 / scale) ** 2
    if two:
        if first == 0.0 and second == 0.0:
            return 0.0
        return abs(h) * first / np.sqrt((first + 0.01 * second) * y.size)
    return abs(h) * np.sqrt(first / y.size)


@driver
def adaptive_loop(forces, y, before, work, stages, errors, rtol, atol, settings, numbers, clock, until, steps, cursor):
    """Take steps until the clock has reached ``until``, or ``steps`` of them. Return a status, STOPPED if a step fails.

    The loop ends before a step beyond the end, or cuts that step off there. ``before`` is y at the last step's start.
    ``work`` holds the trial state and the stages of the last step, with the derivative at its end last. ``settings``
    are minus the exponent -1 / (q + 1), the longest step, the end, and whether to cut off (1 or 0).
    """
    bound = handle(forces)
    count = stages.shape[1]
    trial, k = work[0], work[1:]
    flat_y, flat_before, flat_trial, flat_k = (
        y.reshape(-1),
        before.reshape(-1),
        trial.reshape(-1),
        k.reshape((count + 1, -1)),
    )
    exponent, longest, end, clip = settings[0], settings[1], settings[2], settings[3] != 0.0
    c = np.zeros(count + 1)
    for stage in range(count + 1):
        for j in range(count):
            c[stage] += stages[stage, j]
    while cursor[STEP] < steps and clock[TIME] < until:
        t, h = clock[TIME], min(clock[NEXT], longest)
        last = t + h > end
        if last:
            if not clip:
                return OK
            h = end - t
        if cursor[STAGE] == 0:
            if cursor[FRESH]:
                for i in range(flat_k.shape[1]):
                    flat_k[0, i] = flat_k[count, i]
            else:
                status = fill_derivative(bound, t, y, k[0], cursor)
                if status != OK:
                    return status
            cursor[FRESH] = 0
            cursor[STAGE] = 1
        if not (last or h > 10.0 * (np.nextafter(abs(t), np.inf) - abs(t))):
            return STOPPED
        status = OK
        for stage in range(cursor[STAGE], count + 1):
            stage_state(flat_trial, flat_y, stages, stage, min(stage, count), h, flat_k)
            status = fill_derivative(bound, min(t + c[stage] * h, end), trial, k[stage], cursor)
            if status != OK:
                cursor[STAGE] = stage
                break
        if status in (GROW, RAISED):
            return status
        error = np.inf
        if status == OK:
            error = scaled_error(flat_y, flat_trial, errors, h, flat_k, rtol, atol)
        if error <= 1.0:
            factor = step_control.step_factor(numbers, exponent, error, clock[ERROR], clock[ERROR_BEFORE])
            if clock[REJECTED_LAST] != 0.0:
                factor = min(1.0, factor)
            for i in range(flat_y.size):
                flat_before[i], flat_y[i] = flat_y[i], flat_trial[i]
            following = max(h * factor, clock[NEXT]) if last else h * factor
            clock[BEFORE], clock[TIME], clock[LAST], clock[NEXT] = t, end if last else t + h, h, following
            clock[ERROR_BEFORE], clock[ERROR], clock[REJECTED_LAST] = clock[ERROR], error, 0.0
            cursor[STAGE] = 0
            cursor[FRESH] = 1
            cursor[STEP] += 1
        else:
            clock[NEXT] = h * step_control.rejected_factor(numbers, exponent, error)
            clock[REJECTED_LAST] = 1.0
            cursor[STAGE] = 1
            cursor[REJECTED] += 1
    return OK


class EmbeddedPair(Protocol):
    """Numbers of an embedded Runge-Kutta method, as its steps use them; see ``Tableau``."""

    @property
    def b(self) -> tuple[float, ...]: ...

    @property
    def stages(self) -> Floats: ...

    @property
    def error_rows(self) -> Floats: ...

    @property
    def error_order(self) -> int: ...

    @property
    def extra(self) -> Rows: ...

    @property
    def dense(self) -> Rows: ...

    def step(self, derivative: Derivative, t: float, y: Floats, dt: float) -> Floats:
        """Take one step from y at t."""


def sketched(stages: Floats) -> Floats:
    """Weights P (stages, powers) of a rough interpolant: y' is the polynomial of degree SKETCHED nearest to all stages,
    or of a lower degree for few stages."""
    parts = stages.sum(axis=1)
    degree = min(SKETCHED, len(np.unique(parts)) - 2)
    powers = np.arange(degree + 1)
    found: Floats = np.linalg.pinv(parts[:, None] ** powers).T / (powers + 1)
    return found


class AdaptiveStepper(ChosenSteps):
    """Integration with an embedded pair. A checkpoint holds its clock with the last errors, and the start and the
    stages of the last step."""

    saved = (*ChosenSteps.saved, "_before", "_stages")

    def __init__(self, flow: Flow, tableau: EmbeddedPair, options: Options) -> None:
        super().__init__(flow, options)
        self.rtol, self.atol = step_control.tolerances_of(flow, options)
        self._tableau, self._controller = tableau, step_control.controller(options.controller)

    def reset(self, y: Floats, time: float, steps: int) -> None:
        self._begin(y, time, steps)
        self._before = y.copy()
        self._k_done: list[Floats] = []
        self._work = np.zeros((len(self._tableau.b) + 2, *y.shape))
        self._clock[[ERROR, ERROR_BEFORE]] = step_control.FLOOR

    @property
    def _stages(self) -> Floats:
        return self._work[1:]

    @property
    def recordable_steps(self) -> CompiledSteps:
        settings = np.array([1.0 / (self._tableau.error_order + 1), self._longest, self.end, float(self.clip)])
        self._k_done = []
        given = (
            self.y, self._before, self._work, self._tableau.stages, self._tableau.error_rows, self.rtol, self.atol,
            settings, self._controller.numbers,
        )  # fmt: skip
        return adaptive_loop, self._flow.forces, given

    def _go(self, until: float, steps: int) -> int:
        loop, forces, given = self.recordable_steps
        return forces.call(loop, *given, self._clock, until, steps, self._cursor)

    def _first_step(self) -> float | None:
        f, order, limits = self._flow.derivative(self.time, self.y), self._tableau.error_order, (self.end, self.clip)
        h = step_control.first_step(self._flow.derivative, self.time, self.y, f, order, self.rtol, self.atol, *limits)
        self._extra_evaluations += 2 if h is not None else 0  # else every later step would repeat this
        return h

    def at(self, time: float) -> Floats:
        begin, h = self._clock[BEFORE], self._clock[LAST]
        if time == self.time or h == 0.0:
            return self.y.copy()
        if self.dense_weights is None:
            return self._tableau.step(self._flow.derivative, begin, self._before, time - begin)
        theta = (time - begin) / h
        weights = self.dense_weights @ theta ** np.arange(1, self.dense_weights.shape[1] + 1)
        return self._before + h * np.tensordot(weights, self.dense_stages()[0], 1)

    @property
    def dense_weights(self) -> Floats | None:
        """Weights P (stages, powers) of the interpolant, see ``Tableau``; None without one."""
        return np.array(self._tableau.dense) if self._tableau.dense else None

    def sketch(self) -> Floats:
        """See Stepper: by the interpolant of the stages, or by a rough one."""
        found: Floats = (self._clock[LAST] * self._sketch_rows) @ self._stages.reshape(len(self._stages), -1)
        found += self._before.reshape(-1)
        return found.reshape((len(INNER), *self.y.shape))

    @cached_property
    def _sketch_rows(self) -> Floats:
        own = None if self._tableau.extra else self.dense_weights
        weights = sketched(self._tableau.stages) if own is None else own
        return INNER[:, None] ** np.arange(1, weights.shape[1] + 1) @ weights.T

    @property
    def start_of_step(self) -> tuple[Floats, float]:
        """y, a copy, and time at the start of the last step."""
        return self._before.copy(), float(self._clock[BEFORE])

    def dense_stages(self) -> tuple[Floats, int]:
        """Derivatives of the last step's stages, including the stages of its interpolant; and the evaluations of f that
        these took now."""
        taken = 0
        if self._tableau.extra and not self._k_done:
            k = list(self._stages)
            begin, h = self._clock[BEFORE], self._clock[LAST]
            for row in self._tableau.extra:
                y = self._before + h * np.tensordot(row, np.array(k), 1)
                k.append(self._flow.derivative(min(begin + sum(row) * h, self.time), y))
            self._k_done, taken = k, len(self._tableau.extra)
        return np.array(self._k_done or self._stages), taken

    def reached(self, inside_step: bool) -> tuple[Floats, Floats]:
        return (self._work[0], self.y[0]) if inside_step else (self.y, self._before[0])

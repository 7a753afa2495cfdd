"""Steps of one of our methods, as ``kickdrift.solve`` takes them: in either direction of time, y real or complex.

The interface is that of ``scipy.integrate.OdeSolver``: ``step``, ``status``, ``t_old``, ``t``, ``y`` and
``dense_output``. So SciPy's own solvers fit in the same place.
"""

from __future__ import annotations

import math
from collections import deque
from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.integrate import DenseOutput

from kickdrift.errors import RunError
from kickdrift.forces.seam.kernel import OK
from kickdrift.integrators.flows.problem_flow import ProblemFlow
from kickdrift.integrators.runge_kutta.adaptive import AdaptiveStepper
from kickdrift.integrators.step_choice.step_length import WATCHED_POINTS, WATCHED_STEPS, Point, stability_warning
from kickdrift.integrators.stepping.chosen_steps import ChosenSteps
from kickdrift.integrators.stepping.stepper import STOPPED, Counts
from kickdrift.integrators.stepping.stepping import AT_ONCE
from kickdrift.model.state import Floats
from kickdrift.run.advance import Integration
from kickdrift.run.watch.sketch import sketch
from kickdrift.run.watch.zeros import Rough

Solutions = NDArray[Any]  # y of the user, real or complex
GRID = 1e-9  # of a step; a time this near to a step point is the step point
NEAR = 1e-15  # relative to a step's times; a time this near to an end of the step is that end


class Shape:
    """The user's problem as the steps see it: y as one row of floats, and time as growing from its start.

    Backward in time, s = -t grows. Then velocities, the second half of a separable y, change their sign too.
    """

    def __init__(self, y0: Solutions, backward: bool, separable: bool) -> None:
        self.paired, self.way = np.iscomplexobj(y0), -1.0 if backward else 1.0
        self.signs = np.ones(len(y0))
        if backward and separable:
            self.signs[len(y0) // 2 :] = -1.0

    def row(self, y: Solutions) -> Floats:
        """The user's y as a row of floats; of a complex number the real and the imaginary part."""
        row = np.ascontiguousarray(self.signs * y)
        return row.view(float) if self.paired else row

    def back(self, y: Floats) -> Solutions:
        """The user's y, a copy, of one row or of several."""
        return self.signs * (np.ascontiguousarray(y).view(complex) if self.paired else y)


class Constant(DenseOutput):
    """The start, where nothing changes: no time passes, or y has no components."""

    def __init__(self, t: float, y: Solutions) -> None:
        super().__init__(t, t)
        self._y = y

    def _call_impl(self, t: Any) -> Solutions:
        return self._y.copy() if t.ndim == 0 else np.repeat(self._y[:, None], len(t), axis=1)


class Polynomial(DenseOutput):
    """The interpolant of a Runge-Kutta method's step: y + h sum_i k_i sum_j P_ij theta^(j + 1), y' = k_i."""

    def __init__(self, t_old: float, t: float, ends: tuple[Floats, Floats], slopes: Floats, shape: Shape) -> None:
        super().__init__(t_old, t)
        self._ends, self._slopes, self._shape = ends, slopes, shape

    def _call_impl(self, t: Any) -> Solutions:
        theta = (np.atleast_1d(t) - self.t_old) / (self.t - self.t_old)
        begin, end = self._ends
        powers = theta ** np.arange(1, self._slopes.shape[1] + 1)[:, None]
        values = np.where(theta == 1.0, end[:, None], begin[:, None] + self._slopes @ powers)
        found = self._shape.back(values.T).T
        return found[:, 0] if t.ndim == 0 else found


class Retaken(DenseOutput):
    """y inside a step of any method, by another step from the same start that ends there."""

    def __init__(self, steps: OwnSteps, ends: tuple[Floats, Floats]) -> None:
        super().__init__(steps.t_old, steps.t)
        self._steps, self._ends = steps, ends

    def _call_impl(self, t: Any) -> Solutions:
        if t.ndim == 0:
            return self._at(float(t))
        return np.array([self._at(float(time)) for time in t]).reshape((len(t), -1)).T

    def _at(self, t: float) -> Solutions:
        steps, (begin, end), near = self._steps, self._ends, NEAR * max(abs(self.t_old), abs(self.t))
        if abs(t - self.t) <= near:
            return steps.shape.back(end.reshape(-1))
        if abs(t - self.t_old) <= near:
            return steps.shape.back(begin.reshape(-1))
        way = steps.shape.way
        return steps.shape.back(steps.retaken(way * self.t_old, begin, way * t).reshape(-1))


class OwnSteps:
    """Steps of an integration from t0 to ``t_bound``, which may be infinite. No step leads beyond.

    Attributes
    ----------
    t_old, t : start and end of the last step; None and t0 before the first
    status : "running", "finished" or "failed"
    nlu : 0; our methods do not count their decompositions
    """

    nlu = 0

    def __init__(self, run: Integration, shape: Shape, t0: float, t_bound: float) -> None:
        self._run, self.shape, self.t_bound = run, shape, t_bound
        self.t, self.status = t0, "running"
        self.t_old: float | None = None
        run.begin_at(run.system.state)
        run.prepare()
        stepper: Any = run.stepper
        self._stepper, self._spent, self._extra, self._shorter = stepper, stepper.counts, 0, 0
        self._end = shape.way * t_bound
        self._now = self._before = stepper.y.copy()
        self._points: deque[Point] = deque(maxlen=WATCHED_POINTS)
        if run.method.chooses_steps:
            stepper.end, stepper.clip = self._end, True
        else:
            self._whole = _whole_steps(self._end - stepper.time, stepper.dt)

    @property
    def y(self) -> Solutions:
        """y at ``t``, a copy."""
        return self.shape.back(self._now.reshape(-1))

    @property
    def steps_done(self) -> int:
        """Number of steps so far."""
        return int(self._stepper.steps_done) + self._shorter

    @property
    def counts(self) -> Counts:
        """Cost so far."""
        spent = self._stepper.counts - self._spent
        spent.evaluations += self._extra
        return spent

    @property
    def nfev(self) -> int:
        """Number of evaluations of f so far."""
        return self.counts.evaluations

    @property
    def njev(self) -> int:
        """Number of evaluations of the Jacobian so far."""
        return self.counts.jacobians

    @property
    def warning(self) -> str | None:
        """One line if stability, not accuracy, sets the steps."""
        if self.steps_done < WATCHED_STEPS:
            return None
        return stability_warning(self._flow, self._run.method, list(self._points))

    @property
    def _flow(self) -> ProblemFlow:
        flow: Any = self._run.flow
        return flow

    def step(self, until: float | None = None) -> str | None:
        """Take a step, or all steps up to a time. Return why it failed, or None. Raises what f raises."""
        if self.t == self.t_bound:
            self.t_old, self.status = self.t, "finished"
            return None
        self._flow.forget_errors()
        try:
            status = self._chosen(until) if self._run.method.chooses_steps else self._fixed(until)
        except RunError as error:  # of a Jacobian
            raise error.__cause__ or error from None
        if (raised := self._flow.raised) is not None:
            raise raised
        if status != OK or not np.isfinite(self._now).all():
            self.status = "failed"
            return self._trouble(status)
        self._points.append((self._stepper.time, self._now, self._stepper.last_step))
        if self.t == self.t_bound:
            self.status = "finished"
        return None

    def record(self) -> tuple[Floats, Solutions, str | None]:
        """Take many steps, in compiled code where that can be. Return times (k,) and y (n, k) after them, and why the
        next step failed, or None. Raises what f raises."""
        stepper, shape = self._stepper, self._now.shape
        ready = isinstance(stepper, ChosenSteps) and stepper.steady and stepper.recordable_steps is not None
        if not ready or self.t == self.t_bound:
            message, count = self.step(), int(self.status != "failed")
            return np.array([self.t] * count), np.array([self.y] * count).reshape((count, len(self.y))).T, message
        self._flow.forget_errors()
        rows, before = np.empty((AT_ONCE + 1, 1 + self._now.size)), stepper.steps_done
        rows[0, 0], rows[0, 1:] = stepper.time, stepper.y.reshape(-1)
        status = stepper.recorded(rows[1:])
        if (raised := self._flow.raised) is not None:
            raise raised
        rows = rows[: 1 + stepper.steps_done - before]
        last = [(float(row[0]), row[1:].reshape(shape)) for row in rows[-1 - WATCHED_POINTS :]]
        self._points.extend((*here, here[0] - there[0]) for there, here in pairwise(last))
        if len(last) > 1:
            self._took(*last[-2], *last[-1])
        if status != OK:
            self.status = "failed"
        elif self.t == self.t_bound:
            self.status = "finished"
        message = self._trouble(status) if status != OK else None
        return self.shape.way * rows[1:, 0], self.shape.back(rows[1:, 1:]).T, message

    def _chosen(self, until: float | None) -> int:
        stepper = self._stepper
        several = until is not None and isinstance(stepper, AdaptiveStepper)
        before, begin = stepper.y.copy(), stepper.time
        status: int = stepper.advance(AT_ONCE, self.shape.way * until) if several else stepper.advance(1)  # type: ignore[operator]
        if several:
            before, begin = stepper.start_of_step
        self._took(begin, before, stepper.time, stepper.y)
        return status

    def _fixed(self, until: float | None) -> int:
        stepper, way, status = self._stepper, self.shape.way, OK
        left = self._whole - stepper.steps_done
        if left <= 0:  # a shorter step to the end
            begin, before = stepper.time, stepper.y.copy()
            self._shorter = 1
            self._took(begin, before, self._end, self.retaken(begin, before, self._end))
            return OK
        count = 1 if until is None else math.ceil((way * until - stepper.time) / stepper.dt - GRID)
        count = int(min(max(count, 1), left, AT_ONCE))
        if count > 1:
            status = stepper.advance(count - 1)
        begin, before = stepper.time, stepper.y.copy()
        if status == OK:
            status = stepper.advance(1)
        near = stepper.steps_done == self._whole and self._end - stepper.time < GRID * stepper.dt
        self._took(begin, before, self._end if near else stepper.time, stepper.y)
        return status

    def _took(self, begin: float, before: Floats, end: float, y: Floats) -> None:
        way = self.shape.way
        self.t_old, self.t = way * begin, self.t_bound if end >= self._end else way * end
        self._before, self._now = before, y.copy()

    def retaken(self, begin: float, y: Floats, time: float) -> Floats:
        """y at a time, by one step from y at ``begin``, or by several if the method finds that too far."""
        run = self._run
        stepper: Any = run.method.stepper(self._flow, run.options.changed(dt=time - begin))
        stepper.reset(y.copy(), begin, 0)
        if not run.method.chooses_steps:
            stepper.advance(1)
        else:
            stepper.end, stepper.clip = time, True
            while stepper.time < time and stepper.advance(AT_ONCE, time) == OK:
                pass
        if (raised := self._flow.raised) is not None:
            raise raised
        self._extra += stepper.counts.evaluations
        found: Floats = stepper.y
        return found

    def _trouble(self, status: int) -> str:
        stepper = self._stepper
        if status == STOPPED:
            return str(stepper.trouble)
        (reached, before), step = stepper.reached(status != OK), stepper.steps_done
        return self._flow.explain(reached, before, self._before, step + (status != OK), stepper.time, step)

    def sketch(self) -> Rough | None:
        """y at four times inside the last step, roughly and without f; None where only f can tell."""
        way = self.shape.way
        if self.t_old is None or self.t_old == self.t or self._shorter:
            return None
        ends = (way * self.t_old, self._before), (way * self.t, self._now)
        found = sketch(self._stepper, *ends, self._points)
        return found and found._replace(states=self.shape.back(found.states.reshape((len(found.states), -1))))

    def dense_output(self) -> DenseOutput:
        """Return the interpolant of the last step."""
        assert self.t_old is not None
        if self.t_old == self.t:
            return Constant(self.t, self.y)
        if not (isinstance(self._stepper, AdaptiveStepper) and self._stepper.dense_weights is not None):
            return Retaken(self, (self._before, self._now))
        stages, evaluations = self._stepper.dense_stages()
        self._extra += evaluations
        slopes = self._stepper.last_step * stages.reshape((len(stages), -1)).T @ self._stepper.dense_weights
        ends = self._before.reshape(-1), self._now.reshape(-1)
        return Polynomial(self.t_old, self.t, ends, slopes, self.shape)


def _whole_steps(length: float, dt: float) -> float:
    """Number of whole steps in a length of time, as a float that may be infinite."""
    count = length / dt
    if not math.isfinite(count):
        return math.inf
    return float(round(count) if abs(count - round(count)) < GRID else math.floor(count))


class NoSteps:
    """Steps of a problem without components: the end is there at once. The interface is that of `OwnSteps`."""

    nfev = njev = nlu = steps_done = 0
    status, warning = "running", None

    def __init__(self, t0: float, y0: Solutions, t_bound: float) -> None:
        self.t, self.t_bound, self.y = t0, t_bound, y0
        self.t_old: float | None = None

    def step(self, until: float | None = None) -> None:
        """Go to the end."""
        self.t_old, self.t, self.status = self.t, self.t_bound, "finished"

    def dense_output(self) -> DenseOutput:
        """Return the constant y."""
        return Constant(self.t, self.y)

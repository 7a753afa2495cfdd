"""The way through an interval: steps, the times asked for, interpolants, and events.

The rules are those of ``scipy.integrate.solve_ivp``, so that results mean the same.
"""

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from scipy.integrate import OdeSolution

from kickdrift.errors import InputError
from kickdrift.integrators.stepping.step_control import EPSILON
from kickdrift.integrators.stepping.stepper import INNER
from kickdrift.model.state import Floats
from kickdrift.run.solve.steps import OwnSteps
from kickdrift.run.watch.zeros import Point, Quiet, Rough, changes, monotone_points, zero
from kickdrift.text import shown

MESSAGES = {
    0: "The solver successfully reached the end of the integration interval.",
    1: "A termination event occurred.",
}


@dataclass
class Walk:
    """Results of a walk; see ``kickdrift.Solution``."""

    t: Any
    y: Any
    sol: OdeSolution | None
    t_events: list[Any] | None
    y_events: list[Any] | None
    status: int
    message: str
    end: tuple[float, Any]  # the last time, and y there
    steps: int  # calls of ``step``


class Inside:
    """What lies inside a step: the interpolant, made where it is needed, and rough solutions for a quick test."""

    def __init__(self, steps: Any) -> None:
        self._steps = steps

    @cached_property
    def dense(self) -> Any:
        """The interpolant."""
        return self._steps.dense_output()

    @property
    def times(self) -> Floats:
        """Times of the rough solutions."""
        begin: float = self._steps.t_old
        return begin + INNER * (self._steps.t - begin)

    @cached_property
    def rough(self) -> Rough:
        """Rough solutions, or those of the interpolant."""
        found = self._steps.sketch() if isinstance(self._steps, OwnSteps) else None
        return found or Rough(self.dense(self.times).T)


class Zeros:
    """Functions g(t, y, *args) whose zeros are looked for, with the times and solutions found so far.

    A function may have the attributes ``terminal`` (True, or the number of its zeros that ends the walk) and
    ``direction`` (positive: g rises through zero; negative: g falls)."""

    def __init__(self, events: Any, args: Sequence[Any]) -> None:
        if not callable(events) and not isinstance(events, Iterable):
            raise InputError(f"events: expected functions g(t, y), got {shown(events)}")
        events = (events,) if callable(events) else tuple(events)
        for k, event in enumerate(events):
            if not callable(event):
                raise InputError(f"events[{k}]: expected a function g(t, y), got {shown(event)}")
        self._functions: list[Callable[..., Any]] = list(events)
        self._args = tuple(args)
        self._most = [_most(getattr(event, "terminal", None)) for event in events]
        self._directions = [float(np.asarray(getattr(event, "direction", 0)).item()) for event in events]
        self._quiet = [Quiet() for _ in events]
        self.times: list[list[float]] = [[] for _ in events]
        self.solutions: list[list[Any]] = [[] for _ in events]

    def begin(self, t: float, y: Any) -> None:
        """Evaluate the functions at the start."""
        self._values = self._all(t, y)

    def _value(self, k: int, t: float, y: Any) -> float:
        value = self._functions[k](t, y, *self._args)
        if isinstance(value, float):
            return float(value)
        value = np.asarray(value)
        if value.size != 1 or value.dtype.kind not in "biuf":
            raise InputError(f"events[{k}]: expected one real number at t = {t:.9g}, got {shown(value.tolist())}")
        return float(value.item())

    def _all(self, t: float, y: Any) -> list[float]:
        values = [self._value(k, t, y) for k in range(len(self._functions))]
        for quiet, value in zip(self._quiet, values, strict=True):
            quiet.keep(value)
        return values

    def look(self, t_old: float, t: float, y: Any, inside: Inside) -> float | None:
        """Add the zeros between t_old and t. Return the time of the zero that ends the walk, if there is one."""
        begins, self._values = self._values, self._all(t, y)
        found: list[tuple[float, int]] = []
        for k, (first, last) in enumerate(zip(begins, self._values, strict=True)):
            if self._quiet[k].rests(last, abs(t - t_old)):
                continue
            ends, rough = ((t_old, first), (t, last)), inside.rough
            inner = self._several(k, inside.times, rough.states)
            if self._quiet[k].passes([first, *inner, last], abs(t - t_old), rough.foretelling):
                points = list(ends)
            else:
                points = monotone_points(self._inside(k, inside), *ends)
            found += [(time, k) for time in self._zeros_of(k, points, inside)]
        return self._taken(found, 1.0 if t > t_old else -1.0, inside) if found else None

    def _inside(self, k: int, inside: Inside) -> Callable[[Floats], list[float]]:
        """A function of times inside the step."""
        return lambda times: self._several(k, times, inside.dense(times).T if len(times) else ())

    def _several(self, k: int, times: Floats, states: Sequence[Any]) -> list[float]:
        """A function's values at several times; NaN where it raises, because it may have no value inside the step."""
        values = []
        with np.errstate(all="ignore"):
            for time, y in zip(times.tolist(), states, strict=True):
                try:
                    values.append(self._value(k, time, np.ascontiguousarray(y)))
                except Exception:  # a user's function may raise anything
                    values.append(np.nan)
        return values

    def _zeros_of(self, k: int, points: Sequence[Point], inside: Inside) -> list[float]:
        """Zeros of a function in its direction, in the order of the points."""
        (t_old, first), (t, last) = ends = points[0], points[-1]

        def g(time: float) -> float:
            if time in (t_old, t):
                return first if time == t_old else last
            return self._value(k, time, inside.dense(time))

        found, way = changes(points), self._directions[k]
        if len(found) == 1 and first * last < 0.0:
            found = [ends]
        if way:
            found = [(a, b) for a, b in found if way * a[1] <= 0.0 <= way * b[1]]
        times = [zero(g, a, b, 4 * EPSILON * abs(t - t_old)) for (a, _), (b, _) in found]
        known = self.times[k][-1:]  # at the end of the last step, perhaps
        return [time for time in times if time not in known]

    def _taken(self, found: list[tuple[float, int]], way: float, inside: Inside) -> float | None:
        """Add the zeros up to the first that ends the walk. Return its time."""
        ends = []
        for k, most in enumerate(self._most):
            times = [time for time, which in found if which == k]
            if len(self.times[k]) + len(times) >= most:
                ends.append(times[int(most) - len(self.times[k]) - 1])
        end = way * min(way * time for time in ends) if ends else None
        for time, k in sorted(found, key=lambda each: way * each[0]):
            if end is None or way * time <= way * end:
                self.times[k].append(time)
                self.solutions[k].append(inside.dense(time))
        return end


def _most(terminal: Any) -> float:
    """Number of zeros that ends the walk, from the attribute ``terminal``."""
    if terminal is None or terminal == 0:
        return np.inf
    if int(terminal) == terminal and terminal > 0:
        return float(terminal)
    raise InputError(
        "events: The `terminal` attribute of each event must be a boolean or positive integer, got " + shown(terminal)
    )


class _Points:
    """Times and solutions of a walk: the ends of the steps, or the times of ``t_eval``; and the interpolants."""

    def __init__(self, steps: Any, t_eval: Floats | None, dense_output: bool) -> None:
        self._way, self._bound = (1.0 if steps.t_bound >= steps.t else -1.0), steps.t_bound
        self._t_eval, self._dense_output, self._done = t_eval, dense_output, 0
        self._times: list[Any] = [] if t_eval is not None else [np.array([steps.t])]
        self._solutions: list[Any] = [] if t_eval is not None else [steps.y[:, None]]
        self._none = np.zeros((len(steps.y), 0), steps.y.dtype)
        self._ends, self._interpolants = [steps.t], []  # type: ignore[var-annotated]

    @property
    def ahead(self) -> float:
        """The next time asked for; if there is none, the end."""
        return (
            self._bound if self._t_eval is None or self._done == len(self._t_eval) else float(self._t_eval[self._done])
        )

    def add(self, times: Floats, solutions: Any) -> None:
        """Add the ends of some steps."""
        self._times.append(times)
        self._solutions.append(solutions)

    def reach(self, t: float, y: Any, inside: Inside) -> None:
        """Add the end of a step, or the times asked for up to there."""
        if t != self._ends[-1] or len(self._ends) == 1:  # else an event at the last step's end ends the walk
            self._ends.append(t)
            if self._dense_output:
                self._interpolants.append(inside.dense)
            if self._t_eval is None:
                self.add(np.array([t]), y[:, None])
        if self._t_eval is not None:
            reached = int(np.searchsorted(self._way * self._t_eval, self._way * t, side="right"))
            if reached > self._done:
                times = self._t_eval[self._done : reached]
                self.add(times, inside.dense(times))
                self._done = reached

    def found(self) -> tuple[Any, Any]:
        """All times (k,), and all solutions (n, k)."""
        return np.concatenate([np.zeros(0), *self._times]), np.concatenate([self._none, *self._solutions], axis=1)

    def continuous(self, alternative: bool) -> OdeSolution | None:
        """The solution at all times, where it was asked for."""
        if not self._interpolants:
            return None
        return OdeSolution(self._ends, self._interpolants, alt_segment=alternative)


def walk(steps: Any, t_eval: Floats | None, dense_output: bool, zeros: Zeros | None, alternative: bool) -> Walk:
    """Take all steps, and collect what was asked for.

    ``steps`` has the interface of ``scipy.integrate.OdeSolver``. ``alternative`` is the same setting of OdeSolution."""
    points, status, count, message = _Points(steps, t_eval, dense_output), None, 0, None
    t, y = steps.t, steps.y
    fast = isinstance(steps, OwnSteps) and not (dense_output or zeros)  # nothing to do in Python between steps
    if zeros:
        zeros.begin(t, y)
    while status is None:
        if fast and t_eval is None:
            times, solutions, message = steps.record()
            points.add(times, solutions)
        else:
            message = steps.step(points.ahead) if fast else steps.step()
        count += 1
        if steps.status != "running":
            status = 0 if steps.status == "finished" else -1
        if status == -1:
            break
        t, y = steps.t, steps.y
        if fast and t_eval is None:
            continue
        inside = Inside(steps)
        if zeros and (end := zeros.look(steps.t_old, t, y, inside)) is not None:
            status, t, y = 1, end, inside.dense(end)
        points.reach(t, y, inside)
    return Walk(
        *points.found(),
        points.continuous(alternative),
        [np.asarray(each) for each in zeros.times] if zeros else None,
        [np.asarray(each) for each in zeros.solutions] if zeros else None,
        status,
        MESSAGES.get(status) or message or "The solution could not be continued.",
        (t, y),
        count,
    )

"""The way through an interval: steps, the times asked for, interpolants, and events found by Brent's method.

The rules are those of ``scipy.integrate.solve_ivp``, so that results mean the same.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from functools import cache
from typing import Any

import numpy as np
from scipy.integrate import OdeSolution
from scipy.optimize import brentq

from kickdrift.errors import InputError
from kickdrift.integrators.step_control import EPSILON
from kickdrift.model.state import Floats
from kickdrift.run.solve_steps import OwnSteps
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
        self._most = np.array([_most(getattr(event, "terminal", None)) for event in events])
        self._directions = np.array([getattr(event, "direction", 0) for event in events], dtype=float)
        self.times: list[list[float]] = [[] for _ in events]
        self.solutions: list[list[Any]] = [[] for _ in events]

    def begin(self, t: float, y: Any) -> None:
        """Evaluate the functions at the start."""
        self._values = self._all(t, y)

    def _value(self, k: int, t: float, y: Any) -> float:
        value = np.asarray(self._functions[k](t, y, *self._args))
        if value.size != 1 or value.dtype.kind not in "biuf":
            raise InputError(f"events[{k}]: expected one real number at t = {t:.9g}, got {shown(value.tolist())}")
        return float(value.item())

    def _all(self, t: float, y: Any) -> Floats:
        return np.array([self._value(k, t, y) for k in range(len(self._functions))])

    def look(self, t_old: float, t: float, y: Any, dense: Callable[[], Any]) -> float | None:
        """Add the zeros between t_old and t. Return the time of the zero that ends the walk, if there is one.

        ``dense`` returns the interpolant between these times, and is called only where there is a zero."""
        first, self._values = self._values, self._all(t, y)
        last = self._values
        up, down = (first <= 0) & (last >= 0), (first >= 0) & (last <= 0)
        changed = np.where(self._directions > 0, up, np.where(self._directions < 0, down, up | down))
        if not changed.any():
            return None
        sol = dense()
        zeros = [(self._zero(int(k), sol, t_old, t, first[k], last[k]), int(k)) for k in np.flatnonzero(changed)]
        ends = [time for time, k in zeros if len(self.times[k]) + 1 >= self._most[k]]
        way = 1.0 if t > t_old else -1.0
        end = way * min(way * time for time in ends) if ends else None
        for time, k in sorted(zeros, key=lambda zero: way * zero[0]):
            if end is None or way * time < way * end or (time == end and time in ends):
                self.times[k].append(time)
                self.solutions[k].append(sol(time))
        return end

    def _zero(self, k: int, sol: Any, t_old: float, t: float, first: float, last: float) -> float:
        def g(time: float) -> float:
            if time in (t_old, t):
                return first if time == t_old else last
            return self._value(k, time, sol(time))

        return float(brentq(g, t_old, t, xtol=4 * EPSILON, rtol=4 * EPSILON))


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

    def reach(self, t: float, y: Any, dense: Callable[[], Any]) -> None:
        """Add the end of a step, or the times asked for up to there."""
        if t != self._ends[-1] or len(self._ends) == 1:  # else an event at the last step's end ends the walk
            self._ends.append(t)
            if self._dense_output:
                self._interpolants.append(dense())
            if self._t_eval is None:
                self.add(np.array([t]), y[:, None])
        if self._t_eval is not None:
            reached = int(np.searchsorted(self._way * self._t_eval, self._way * t, side="right"))
            if reached > self._done:
                times = self._t_eval[self._done : reached]
                self.add(times, dense()(times))
                self._done = reached

    def found(self) -> tuple[Any, Any]:
        """All times, and all solutions; empty lists, as from SciPy, where no time asked for was reached."""
        if not self._times:
            return [], []
        return np.concatenate(self._times), np.concatenate(self._solutions, axis=1)

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
        dense = cache(steps.dense_output)
        if zeros and (end := zeros.look(steps.t_old, t, y, dense)) is not None:
            status, t, y = 1, end, dense()(end)
        points.reach(t, y, dense)
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

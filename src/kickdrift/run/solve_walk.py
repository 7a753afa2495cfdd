"""The way through an interval: steps, the times asked for, interpolants, and events found by Brent's method.

The rules are those of ``scipy.integrate.solve_ivp``, so that results mean the same.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
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
    """What a walk found; see ``kickdrift.Solution``."""

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

    def _all(self, t: float, y: Any) -> list[Any]:
        return [function(t, y, *self._args) for function in self._functions]

    def look(self, t_old: float, t: float, y: Any, dense: Callable[[], Any]) -> float | None:
        """Add the zeros between t_old and t. Return the time of the zero that ends the walk, if there is one.

        ``dense`` returns the interpolant between these times, and is called only where there is a zero."""
        before, self._values = self._values, self._all(t, y)
        first, last = np.asarray(before, dtype=float), np.asarray(self._values, dtype=float)
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
            if time == t_old or time == t:
                return first if time == t_old else last
            return float(self._functions[k](time, sol(time), *self._args))

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


def walk(steps: Any, t_eval: Floats | None, dense_output: bool, zeros: Zeros | None, alternative: bool) -> Walk:
    """Take all steps, and collect what was asked for.

    ``steps`` has the interface of ``scipy.integrate.OdeSolver``. ``alternative`` is the same setting of OdeSolution."""
    way = 1.0 if steps.t_bound >= steps.t else -1.0
    ts: list[Any] = [steps.t] if t_eval is None else []
    ys: list[Any] = [steps.y] if t_eval is None else []
    points, interpolants = [steps.t], []
    asked = 0 if t_eval is None else len(t_eval)
    ahead = None if t_eval is None else way * t_eval
    t, y = steps.t, steps.y
    done, count, status, message = 0, 0, None, None
    several = ahead is not None and isinstance(steps, OwnSteps) and not (dense_output or zeros)
    if zeros:
        zeros.begin(steps.t, steps.y)
    while status is None:
        if several:
            message = steps.step(t_eval[done] if t_eval is not None and done < asked else steps.t_bound)
        else:
            message = steps.step()
        count += 1
        if steps.status == "failed":
            status = -1
            break
        if steps.status == "finished":
            status = 0
        t_old, t, y, made = steps.t_old, steps.t, steps.y, []

        def dense(made: list[Any] = made) -> Any:
            if not made:
                made.append(steps.dense_output())
            return made[0]

        if zeros and (end := zeros.look(t_old, t, y, dense)) is not None:
            status, t, y = 1, end, dense()(end)
        if t != points[-1] or len(points) == 1:
            points.append(t)
            if dense_output:
                interpolants.append(dense())
            if t_eval is None:
                ts.append(t)
                ys.append(y)
        if ahead is not None:
            reached = int(np.searchsorted(ahead, way * t, side="right"))
            if reached > done:
                assert t_eval is not None
                ts.append(t_eval[done:reached])
                ys.append(dense()(t_eval[done:reached]))
                done = reached
    if t_eval is None:
        ts, ys = np.array(ts), np.vstack(ys).T
    elif ts:
        ts, ys = np.hstack(ts), np.hstack(ys)
    return Walk(
        ts, ys, OdeSolution(points, interpolants, alt_segment=alternative) if interpolants else None,
        [np.asarray(each) for each in zeros.times] if zeros else None,
        [np.asarray(each) for each in zeros.solutions] if zeros else None,
        status, MESSAGES.get(status) or message or "The solution could not be continued.", (t, y), count,
    )  # fmt: skip

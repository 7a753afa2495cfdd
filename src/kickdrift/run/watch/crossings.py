"""Search of a step for the zeros of scalars: the events of a `Crossing`."""

import math
from collections import deque
from collections.abc import Sequence
from itertools import pairwise
from typing import Any

import numpy as np

from kickdrift.errors import RunError
from kickdrift.integrators.stepping.stepper import INNER
from kickdrift.model.event_log import Row, entry
from kickdrift.model.events.events import Between, Crossing
from kickdrift.model.memory import Checkpointed
from kickdrift.model.problem import Problem
from kickdrift.model.state import Floats
from kickdrift.model.subject import index_of
from kickdrift.model.system import System
from kickdrift.run.watch.encounters import crossings
from kickdrift.run.watch.sketch import sketch
from kickdrift.run.watch.span import Part, Span, approach, separation
from kickdrift.run.watch.zeros import PAST, Point, Quiet, Rough, Values, clear, monotone_points

_INNER: list[float] = INNER.tolist()


class Crossings(Checkpointed):
    """Zeros of scalars."""

    saved = ("_signs", "_last", "_fresh")

    def __init__(self, events: Sequence[Crossing], subject: System | Problem) -> None:
        self.stepper: Any = None  # which took the step
        self._events = events
        self._pairs = [self._bodies(event, subject) for event in events]
        self.begin(subject)

    def _bodies(self, event: Crossing, subject: System | Problem) -> tuple[int, int] | None:
        if not (isinstance(event.function, Between) and isinstance(subject, System)):
            return None
        pair = (event.function.body, event.function.about)
        first, second = (int(subject.state.ids[index_of(subject, body, event.name)]) for body in pair)
        return first, second

    def begin(self, subject: System | Problem) -> None:
        """Watch these bodies, with the signs at the start of the next step."""
        self._subject = subject
        self._rows: list[tuple[int, int] | None] = []
        self._live: list[int] = []
        self._bodies_move = isinstance(subject, System)
        if isinstance(subject, System):
            row_of = {int(each): row for row, each in enumerate(subject.state.ids)}
        for k, pair in enumerate(self._pairs):
            rows = None
            if pair is not None:
                if not (pair[0] in row_of and pair[1] in row_of):
                    continue  # a body is gone
                rows = row_of[pair[0]], row_of[pair[1]]
            self._live.append(k)
            self._rows.append(rows)
        self._built = [m for m, rows in enumerate(self._rows) if rows is not None]
        self._own = [m for m, rows in enumerate(self._rows) if rows is None]
        self._indices = np.array([self._rows[m] for m in self._built], dtype=np.int64).reshape(-1, 2).T.copy()
        functions = [self._events[self._live[m]].function for m in self._built]
        self._approach = np.array([f.quantity == "approach" for f in functions if isinstance(f, Between)], dtype=bool)
        # Scalars of two bodies come first, then functions. Each has its value and its last nonzero sign.
        self._order = [*self._built, *self._own]
        self._values, self._signs = np.zeros(len(self._order)), np.zeros(len(self._order))
        self._quiet, self._past = [Quiet() for _ in self._own], deque[tuple[float, Floats]](maxlen=PAST)
        self._hidden, self._most, self._several_turns = list[int](), np.zeros(len(self._built)), 0
        self._follows_past: bool | None = None  # whether rough states inside a step need the ends of earlier steps
        self._last: Floats | None = None
        self._fresh = False  # whether signs are out of date

    follow = begin

    def __len__(self) -> int:
        return len(self._order)

    def _fill(self, step_parts: Sequence[Part], own: Sequence[float]) -> int:
        """Store the values at the end of a step, those of functions given. Return the number of changed signs."""
        built, changed = len(self._built), 0
        if built:
            self._most[:] = 0.0
            given = self._approach, self._indices, self._signs[:built], self._values[:built], self._most
            for part in step_parts:
                changed, self._several_turns = crossings(part.y0, part.y1, part.t1 - part.t0, *given)
        for k, value in enumerate(own, built):
            self._values[k] = value
            changed += bool(self._signs[k] * value < 0)
        return changed

    def scan(self, step_parts: list[Part], step: int) -> int:
        """Evaluate at the end of a step. Return the number of scalars whose zeros ``look`` will search."""
        (y0, t0), (y1, t1) = step_parts[0][:2], step_parts[-1][2:]
        if self._own and not (math.isfinite(np.vdot(y1, y1)) or np.isfinite(y1).all()):
            return 0  # the run has blown up
        if self._last is None:
            self._fill([Part(y0, t0, y0, t0)], self._values_at(t0, y0, step))
            self._signs = np.sign(self._values)
            self._last, self._fresh = self._values.copy(), True
        own = self._values_at(t1, y1, step)
        tested = self._tested(own, y1, t1, t1 - t0) if own else []
        if t1 > t0 and not (tested or self._built or self._fresh):  # all are far from zero, with the signs they had
            self._last[:] = own
            return 0
        changed = self._fill(step_parts, own)
        self._hidden = np.flatnonzero(self._most > 1.0).tolist() if self._several_turns and t1 > t0 else []
        if tested:
            self._hidden += self._unclear(tested, step_parts, step)
        if not (changed or self._hidden):
            self._keep()
        return changed + len(self._hidden)

    def _tested(self, own: Sequence[float], y: Floats, time: float, length: float) -> list[int]:
        """Functions, by their places among all scalars, that need the quick test in a step with these values at its
        end."""
        if self._follows_past is None:
            self._follows_past = len(y) != 2 and not hasattr(type(self.stepper), "sketch")
        if self._follows_past:
            self._past.append((time, y.copy()))
            for quiet, value in zip(self._quiet, own, strict=True):
                quiet.keep(value)
        if length <= 0.0:
            return []
        built = len(self._built)
        return [built + k for k, value in enumerate(own) if not self._quiet[k].rests(value, length)]

    def _unclear(self, tested: Sequence[int], step_parts: list[Part], step: int) -> list[int]:
        """Those of the tested functions whose signs at the ends of a step may not tell all their zeros."""
        assert self._last is not None
        rough = [self._rough(part) for part in step_parts]
        if None in rough:
            return list(tested)
        found = []
        for k in tested:
            ends = float(self._last[k]), float(self._values[k])
            if not self._told(k, self._quiet[k - len(self._built)], ends, step_parts, rough, step):
                found.append(k)
        return found

    def _rough(self, part: Part) -> Rough | None:
        whole = self.stepper if part.t1 == self.stepper.time else None  # else an event cuts the step
        return sketch(whole, (part.t0, part.y0), (part.t1, part.y1), self._past)

    def _told(
        self, k: int, quiet: Quiet, ends: tuple[float, float], step_parts: list[Part], rough: list[Any], step: int
    ) -> bool:
        """Tell whether a function's signs at the ends of a step tell all its zeros, as far as the quick test sees."""
        m, (first, last), values = self._order[k], ends, list[list[float]]()
        for part, each in zip(step_parts, rough, strict=True):
            times = [part.t0 + share * (part.t1 - part.t0) for share in _INNER]
            inside = self._several(m, times, each.states, step)
            if len(step_parts) == 1:
                return quiet.passes([first, *inside, last], part.t1 - part.t0, each.foretelling)
            after = last if part is step_parts[-1] else self._several(m, times[:1], [part.y1], step)[0]
            values.append([values[-1][-1] if values else first, *inside, after])
        changed = sum(each[0] * each[-1] <= 0.0 for each in values)
        return changed < 2 and all(clear(each) for each in values)

    def _keep(self) -> None:
        """Keep values and signs. A zero at the very end of a step counts when the sign has changed."""
        values = self._values
        if self._fresh or np.count_nonzero(values) < len(values):
            moved = values != 0.0
            self._signs[moved] = np.sign(values[moved])
            self._fresh = not moved.all()
        self._last, self._values = values, self._last

    def _several(self, m: int, times: Sequence[float], states: Any, step: int) -> list[float]:
        """A function at several times; NaN where it has no value, because inside a step it may have none."""
        found = []
        with np.errstate(all="ignore"):
            for time, y in zip(times, self._turned(np.asarray(states)), strict=True):
                try:
                    found.append(self._called(m, time, y, step))
                except RunError:
                    found.append(np.nan)
        return found

    def _turned(self, y: Floats) -> Floats:
        """A copy of y, or of several, that functions of the user may have: rows of bodies, or the unknowns."""
        if self._bodies_move:
            return y.swapaxes(-1, -2).copy()
        return y.flatten() if y.ndim == 3 else y.reshape(len(y), -1).copy()

    def _values_at(self, time: float, y: Floats, step: int) -> list[float]:
        """The functions at a time."""
        return [self._called(m, time, self._turned(y), step) for m in self._own]

    def _value(self, m: int, time: float, y: Floats, step: int) -> float:
        """A scalar at a time."""
        if (rows := self._rows[m]) is None:
            return self._called(m, time, self._turned(y), step)
        quantity = self._events[self._live[m]].function.quantity  # type: ignore[union-attr]
        return approach(y, *rows) if quantity == "approach" else float(y[0, 2, rows[0]] - y[0, 2, rows[1]])

    def _of_bodies(self, y: Floats) -> tuple[Floats, ...]:
        """Positions and velocities of the bodies, and the unknowns beside them, if any, which are the last columns."""
        n = len(self._subject)
        forces: Any = getattr(self._subject, "forces", ())
        count = sum(getattr(force, "unknowns", 0) for force in forces)
        return (y[0, :n], y[1, :n], *([y[1, len(y[1]) - count :, 0]] if count else []))

    def _called(self, m: int, time: float, y: Floats, step: int) -> float:
        """A function's value at y as `_turned` gives it; a finite number."""
        event = self._events[self._live[m]]
        arguments = self._of_bodies(y) if self._bodies_move else (y, *self._subject.args)  # type: ignore[union-attr]
        try:
            given = event.function(time, *arguments)  # type: ignore[operator]
        except Exception as error:  # a user's function may raise anything
            said = f"{_where(event, step, time)}: raised {type(error).__name__}: {error}"
            raise RunError(" ".join(said.split())) from error
        try:
            value = float(given)
        except (TypeError, ValueError):
            said = f"{_where(event, step, time)}: returned {given!r:.60}, which is no number"
            raise RunError(" ".join(said.split())) from None
        if not math.isfinite(value):
            raise RunError(f"{_where(event, step, time)}: returned {value}")
        return value

    def look(self, span: Span) -> list[tuple[float, Row]]:
        """Entries for zeros inside the searched span."""
        assert self._last is not None
        found = []
        changed = np.flatnonzero(self._signs * self._values < 0).tolist()
        for k in sorted({*self._hidden, *changed}):
            m = self._order[k]
            event, rows = self._events[self._live[m]], self._rows[m]
            for time in self._zeros(k, event, span):
                distance = separation(span.inside(time), *rows) if rows else math.nan
                if event.seen is not None:
                    y = self._turned(span.inside(time))
                    event.seen(time, *(self._of_bodies(y)[:2] if self._bodies_move else (y,)))
                found.append((time, entry(self._subject, event.kind, time, span.step, rows or (), distance, "logged")))
        self._fresh = True
        self._keep()
        return found

    def _zeros(self, k: int, event: Crossing, span: Span) -> list[float]:
        """Zeros of a scalar in its direction, in order. A zero at the start of the span counts when the sign changes
        there; a zero at the end waits for the next step."""
        assert self._last is not None
        m, first, last = self._order[k], float(self._last[k]), float(self._values[k])

        def g(time: float) -> float:
            if time <= span.t0 or time >= span.t1:
                return first if time <= span.t0 else last
            return self._value(m, time, span.at(time), span.step)

        def inside(time: float) -> float:
            try:
                return g(time)
            except RunError:  # of the function, or of a shorter step
                return math.nan

        def several(times: Floats) -> list[float]:
            with np.errstate(all="ignore"):
                return [inside(time) for time in times.tolist()]

        points = self._points(k, several, (span.t0, first), (span.t1, last))
        found, sign = [], float(self._signs[k])
        once = first and sign * last < 0.0 and sum((a[1] > 0.0) != (b[1] > 0.0) for a, b in pairwise(points)) == 1
        for a, b in [(points[0], points[-1])] if once else pairwise(points):
            if sign * b[1] < 0.0 and event.direction * b[1] >= 0.0:
                found.append(a[0] if a[1] == 0.0 else span.zero(g, a[0], b[0], event.tolerance))
            sign = math.copysign(1.0, b[1]) if b[1] else sign
        return found

    def _points(self, k: int, several: Values, first: Point, last: Point) -> list[Point]:
        """Points between which a scalar has at most one zero."""
        length, quiet = last[0] - first[0], self._quiet[k - len(self._built)] if k >= len(self._built) else None
        if k not in self._hidden:
            return [first, last]
        if quiet and quiet.passes([first[1], *several(first[0] + INNER * length), last[1]], length):
            return [first, last]
        points = monotone_points(several, first, last)
        return [first, *(point for point in points[1:-1] if abs(point[1]) > 0.0), last]


def _where(event: Crossing, step: int, time: float) -> str:
    return f"event {event.name!r}: step {step} (t = {time:.9g})"

"""Search of a step for the zeros of scalars: the events of a `Crossing`."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from kickdrift.errors import RunError
from kickdrift.model.event_log import Row, entry
from kickdrift.model.events import Between, Crossing
from kickdrift.model.memory import Checkpointed
from kickdrift.model.state import Floats
from kickdrift.model.subject import index_of
from kickdrift.model.system import System
from kickdrift.run.watch.encounters import crossings
from kickdrift.run.watch.span import Part, Span, approach, separation

if TYPE_CHECKING:
    from kickdrift.model.problem import Problem


class Crossings(Checkpointed):
    """Zeros of scalars."""

    saved = ("_signs", "_last", "_fresh")

    def __init__(self, events: Sequence[Crossing], subject: System | Problem) -> None:
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
        self._last: Floats | None = None
        self._fresh = False  # whether signs are out of date

    follow = begin

    def __len__(self) -> int:
        return len(self._order)

    def _fill(self, time: float, y: Floats, step: int) -> int:
        built, changed = len(self._built), 0
        if built:
            changed = crossings(y, self._approach, self._indices, self._signs[:built], self._values[:built])
        for k in range(built, len(self._order)):
            self._values[k] = value = self._value(self._order[k], time, y, step)
            changed += self._signs[k] * value < 0
        return changed

    def scan(self, step_parts: list[Part], step: int) -> int:
        """Evaluate at the end of a step. Return the number of changed signs."""
        (y0, t0), (y1, t1) = step_parts[0][:2], step_parts[-1][2:]
        if self._own and not np.isfinite(y1).all():
            return 0  # the run has blown up
        if self._last is None:
            self._fill(t0, y0, step)
            self._signs = np.sign(self._values)
            self._last, self._fresh = self._values.copy(), True
        changed = self._fill(t1, y1, step)
        if not changed:
            self._keep()
        return changed

    def _keep(self) -> None:
        """Keep values and signs. A zero at the very end of a step counts when the sign has changed."""
        values = self._values
        if self._fresh or not values.all():
            moved = values != 0.0
            self._signs[moved] = np.sign(values[moved])
            self._fresh = not moved.all()
        self._last, self._values = values, self._last

    def _value(self, m: int, time: float, y: Floats, step: int) -> float:
        event, rows = self._events[self._live[m]], self._rows[m]
        if rows is not None:
            quantity = event.function.quantity  # type: ignore[union-attr]
            return approach(y, *rows) if quantity == "approach" else float(y[0, 2, rows[0]] - y[0, 2, rows[1]])
        if isinstance(self._subject, System):
            arguments = (y[0].T.copy(), y[1].T.copy())
        else:
            arguments = (y.reshape(-1).copy(), *self._subject.args)
        where = f"event {event.name!r}: step {step} (t = {time:.9g})"
        try:
            given = event.function(time, *arguments)  # type: ignore[operator]
        except Exception as error:  # a user's function may raise anything
            raise RunError(" ".join(f"{where}: raised {type(error).__name__}: {error}".split())) from error
        try:
            value = float(given)
        except (TypeError, ValueError):
            raise RunError(" ".join(f"{where}: returned {given!r:.60}, which is no number".split())) from None
        if not math.isfinite(value):
            raise RunError(f"{where}: returned {value}")
        return value

    def look(self, span: Span) -> list[tuple[float, Row]]:
        """Entries for zeros inside the searched span."""
        assert self._last is not None
        found = []
        for k in np.flatnonzero(self._signs * self._values < 0):
            m, last = self._order[k], float(self._values[k])
            event, rows = self._events[self._live[m]], self._rows[m]
            if event.direction * last < 0:
                continue
            time = self._zero(m, span, event, float(self._last[k]), last)
            distance = separation(span.inside(time), *rows) if rows else math.nan
            found.append((time, entry(self._subject, event.kind, time, span.step, rows or (), distance, "logged")))
        self._fresh = True
        self._keep()
        return found

    def _zero(self, m: int, span: Span, event: Crossing, first: float, last: float) -> float:
        if first == 0.0:
            return span.t0

        def g(time: float) -> float:
            if time <= span.t0 or time >= span.t1:
                return first if time <= span.t0 else last
            return self._value(m, time, span.at(time), span.step)

        return span.zero(g, span.t0, span.t1, event.tolerance)

"""What each kind of event looks for in a step, and what it remembers from step to step."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from kickdrift.errors import RunError
from kickdrift.forces.central import gravitational_constant
from kickdrift.model.event_checks import binding
from kickdrift.model.events import Between, CloseApproach, Collision, Crossing, Escape
from kickdrift.model.memory import Memory, Remembering
from kickdrift.model.state import Floats
from kickdrift.model.subject import index_of
from kickdrift.model.system import System
from kickdrift.run.watch.encounters import CLOSEST, contacts, crossings, passages, unbound

if TYPE_CHECKING:
    from kickdrift.model.problem import Problem

Row = dict[str, Any]  # an entry of the log


@dataclass
class Span:
    """A step, or the part of one up to an event: y at both ends, and ``at(time)`` in between."""

    y0: Floats
    t0: float
    y1: Floats
    t1: float
    step: int
    at: Callable[[float], Floats]

    @property
    def length(self) -> float:
        return self.t1 - self.t0

    def inside(self, time: float) -> Floats:
        """y at a time of the span, the very ends included."""
        return self.y0 if time <= self.t0 else self.y1 if time >= self.t1 else self.at(time)

    def zero(self, g: Callable[[float], float], a: float, b: float, tolerance: float) -> float:
        """Where g, of different signs at a and b, is zero; ``tolerance`` is a part of the span."""
        from scipy.optimize import brentq

        least = max(tolerance * self.length, 4 * float(np.spacing(max(abs(a), abs(b)))))
        return float(brentq(g, a, b, xtol=least, rtol=4 * np.finfo(float).eps))


class Act(NamedTuple):
    """What an event is to do to the bodies."""

    event: Collision | Escape
    time: float
    bodies: tuple[int, ...]  # their rows
    distance: float


def entry(
    system: System | Problem, kind: str, time: float, step: int, bodies: Sequence[int], distance: float, done: str
) -> Row:
    """An entry of the log; ``bodies`` are rows of the system."""
    ids = [int(system.state.ids[i]) for i in bodies] if isinstance(system, System) else []
    names = [system.body(i) for i in bodies] if isinstance(system, System) else []
    return {
        "kind": kind,
        "time": float(time),
        "step": int(step),
        "bodies": names,
        "ids": ids,
        "distance": float(distance) if math.isfinite(distance) else None,
        "energy": None,
        "done": done,
    }


def separation(y: Floats, i: int, j: int) -> float:
    """The distance between two bodies."""
    return float(np.linalg.norm(y[0, :, i] - y[0, :, j]))


def approach(y: Floats, i: int, j: int) -> float:
    """r . v of one body relative to another."""
    return float((y[0, :, i] - y[0, :, j]) @ (y[1, :, i] - y[1, :, j]))


class Approaches(Remembering):
    """Passages of a `CloseApproach`."""

    keeps = ("_closest_of",)

    def __init__(self, event: CloseApproach, system: System) -> None:
        self.event = event
        bodies = [index_of(system, body, event.kind) for body in event.bodies or ()]
        self._ids = {int(system.state.ids[i]) for i in bodies}
        self.begin(system)

    def begin(self, system: System) -> None:
        """Watch these bodies, with no passage under way."""
        self._system, ids, masses = system, system.state.ids, system.state.masses
        pairs = np.array(np.triu_indices(len(system), 1), dtype=np.int64)
        if self._ids:
            named = np.isin(ids[pairs], list(self._ids))
            pairs = pairs[:, named.any(axis=0) if len(self._ids) == 1 else named.all(axis=0)]
        self._heaviest, limits = -1, np.full(pairs.shape[1], float(self.event.distance))
        if self.event.hill:
            self._heaviest = int(np.argmax(masses))
            pairs = pairs[:, (pairs != self._heaviest).all(axis=0)]
            limits = self.event.distance * np.cbrt(masses[pairs].sum(axis=0) / (3 * masses[self._heaviest]))
        self._pairs, self._limits = np.ascontiguousarray(pairs), limits
        self._closest_of = np.full((pairs.shape[1], 3), np.inf)
        self._rows = np.zeros((2 * pairs.shape[1], 3))

    def follow(self, system: System) -> None:
        """Watch the bodies that are left; passages go on."""
        old = {tuple(pair): closest for pair, closest in zip(self._by_id(), self._closest_of, strict=True)}
        self.begin(system)
        for p, pair in enumerate(self._by_id()):
            self._closest_of[p] = old.get(tuple(pair), np.inf)

    def _by_id(self) -> list[list[int]]:
        return self._system.state.ids[self._pairs.T].tolist()

    def scan(self, y0: Floats, t0: float, y1: Floats, t1: float, step: int) -> int:
        """Search a span; how much there is to look at."""
        self._count = passages(
            y0, y1, t0, t1 - t0, step, self._pairs, self._limits, self._heaviest, self._closest_of, self._rows
        )
        return self._count

    def look(self, span: Span) -> list[tuple[float, Row]]:
        """Passages that ended in the span that was searched."""
        found = []
        for p, _, what in self._rows[: self._count].tolist():
            pair = int(p)
            if what == CLOSEST:
                self._refine(pair, span)
            else:
                found.append((span.t1, self._entry(pair, "passed")))
                self._closest_of[pair] = np.inf
        return found

    def _refine(self, pair: int, span: Span) -> None:
        """The closest point on the method's own solution in place of the cubic's."""
        i, j = self._pairs[:, pair]
        if approach(span.y0, i, j) < 0 < approach(span.y1, i, j):
            time = span.zero(lambda t: approach(span.inside(t), i, j), span.t0, span.t1, 1e-13)
            self._closest_of[pair] = separation(span.inside(time), i, j), time, span.step

    def _entry(self, pair: int, done: str) -> Row:
        distance, time, step = self._closest_of[pair]
        i, j = self._pairs[:, pair]
        return entry(self._system, self.event.kind, time, step, (i, j), distance, done)

    def going_on(self) -> list[Row]:
        """Passages that have not ended, as they are so far."""
        return [self._entry(int(p), "going on") for p in np.flatnonzero(np.isfinite(self._closest_of[:, 0]))]


class Contacts(Remembering):
    """Contacts of a `Collision`."""

    keeps = ("radii", "_touching")

    def __init__(self, event: Collision, system: System) -> None:
        self.event = event
        self.radii = event.radii_in(system)
        self._approaching = event.action == "bounce"  # what has bounced is in contact, and goes apart
        self.begin(system)

    def begin(self, system: System) -> None:
        """Watch these bodies, none of which is known to touch another."""
        self._system, masses = system, system.state.masses
        pairs = np.array(np.triu_indices(len(system), 1), dtype=np.int64)
        self._pairs = np.ascontiguousarray(pairs[:, masses[pairs].any(axis=0)])
        self._touching = np.zeros(self._pairs.shape[1], dtype=np.bool_)
        self._rows = np.zeros((self._pairs.shape[1], 4))

    def scan(self, y0: Floats, t0: float, y1: Floats, t1: float, step: int) -> int:
        """Search a span; how many pairs are in contact."""
        self._count = contacts(
            y0, y1, t1 - t0, self._pairs, self.radii, self._approaching, self._touching, self._rows
        )  # fmt: skip
        return self._count

    def first(self, span: Span) -> Act | None:
        """The first contact in the span that was searched."""
        rows = self._rows[: self._count].tolist()
        found = [act for row in rows if (act := self._confirmed(span, *row)) is not None]
        return min(found, key=lambda act: act.time, default=None)

    def _confirmed(self, span: Span, pair: float, s: float, a: float, b: float) -> Act | None:
        """The contact on the method's own solution, where that has one too."""
        i, j = (int(k) for k in self._pairs[:, int(pair)])
        reach = self.radii[i] + self.radii[j]

        def gap(time: float) -> float:
            return separation(span.inside(time), i, j) - reach

        begin, end = span.t0 + a * span.length, span.t0 + b * span.length if b < 1 else span.t1
        time = begin
        if s > a:
            if gap(end) > 0:
                return None
            if gap(begin) > 0:
                time = span.zero(gap, begin, end, 1e-13)
        return Act(self.event, time, (i, j), gap(time) + reach)

    follow = begin

    def recall(self, memory: Memory) -> None:
        """Be what had this memory, of the bodies that are left."""
        self.radii = np.zeros(len(self._system))
        super().recall(memory)

    def touch(self, bodies: tuple[int, ...]) -> None:
        """Known from now on, until they are apart."""
        self._touching |= (self._pairs == np.array(bodies)[:, None]).all(axis=0)


class Escapes(Remembering):
    """Bodies that meet an `Escape`."""

    keeps = ("_known_ids", "_known")

    def __init__(self, event: Escape, system: System) -> None:
        self.event = event
        self._distance, self._about = float(event.distance), None
        if event.about is not None:
            self._about = int(system.state.ids[index_of(system, event.about, event.kind)])
        self.begin(system)

    def begin(self, system: System) -> None:
        """Watch these bodies, none of which has escaped."""
        self._known_ids: list[int] = []
        self.follow(system)

    def follow(self, system: System) -> None:
        """Watch the bodies that are left; those that escaped are known."""
        self._system, ids = system, system.state.ids
        law = binding(system)
        gravity = gravitational_constant(law.name, law.G, system)
        self._gm, self._softening2 = gravity * system.state.masses, float(law.softening) ** 2
        place = np.flatnonzero(ids == self._about) if self._about is not None else np.array([-1])
        self._place = int(place[0]) if place.size else -2  # whoever it was measured from is gone
        self._known = np.isin(ids, self._known_ids)
        self._rows = np.zeros((len(system), 2))

    def scan(self, y0: Floats, t0: float, y1: Floats, t1: float, step: int) -> int:
        """How many have escaped at the end of a span."""
        self._count = 0
        if self._place >= -1:
            self._count = unbound(
                y1, self._gm, self._softening2, self._place, self._distance, self._known, self._rows
            )  # fmt: skip
        return self._count

    def gone(self, span: Span) -> list[Act]:
        """Those that have escaped at the end of the span that was searched."""
        return [Act(self.event, span.t1, (int(i),), d) for i, d in self._rows[: self._count].tolist()]

    def know(self, body: int) -> None:
        """It has been told of."""
        self._known_ids.append(int(self._system.state.ids[body]))
        self._known[body] = True


class Crossings(Remembering):
    """Zeros of scalars."""

    keeps = ("_signs", "_last", "_fresh")

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
        """Watch these bodies; the signs are those at the start of the next step."""
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
        # Those of two bodies come first, then functions; of each its value and the last sign that was none of zero.
        self._order = [*self._built, *self._own]
        self._values, self._signs = np.zeros(len(self._order)), np.zeros(len(self._order))
        self._last: Floats | None = None
        self._fresh = False  # whether signs have to be taken anew

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

    def scan(self, y0: Floats, t0: float, y1: Floats, t1: float, step: int) -> int:
        """Evaluate at the end of a span; how many signs have changed."""
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
        """A zero at the very end of a step is told of when the sign has changed."""
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
        copies = (y[0].T.copy(), y[1].T.copy()) if isinstance(self._subject, System) else (y.reshape(-1).copy(),)
        where = f"event {event.name!r}: step {step} (t = {time:.9g})"
        try:
            given = event.function(time, *copies)  # type: ignore[operator]
        except Exception as error:  # whatever a user's function raises
            raise RunError(" ".join(f"{where}: raised {type(error).__name__}: {error}".split())) from error
        try:
            value = float(given)
        except (TypeError, ValueError):
            raise RunError(" ".join(f"{where}: returned {given!r:.60}, which is no number".split())) from None
        if not math.isfinite(value):
            raise RunError(f"{where}: returned {value}")
        return value

    def look(self, span: Span) -> list[tuple[float, Row]]:
        """Zeros inside the span that was searched."""
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

"""Search of a step for close approaches and escapes: events of distances between bodies.

The end of a step tells little of the least distance of a pair that attracts each other strongly in the step.
`Passing` follows such a passage by gauss-radau15, beside the run and from the step in which it begins, until the pair
is far again. The run itself goes on by its own steps.
"""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from kickdrift.errors import RunError
from kickdrift.model.event_log import Row, entry
from kickdrift.model.events.events import CloseApproach, Escape
from kickdrift.model.memory import Checkpointed, Memory
from kickdrift.model.state import Floats
from kickdrift.model.subject import index_of
from kickdrift.model.system import System
from kickdrift.run.watch.courses import any_bends
from kickdrift.run.watch.encounters import CLOSEST, passages, unbound
from kickdrift.run.watch.span import Act, Part, Span, Trials, Watched, approach, attraction, separation


class Approaches(Checkpointed):
    """Passages of a `CloseApproach`."""

    saved = ("_closest_of",)

    def __init__(self, event: CloseApproach, system: System) -> None:
        self.event = event
        bodies = [index_of(system, body, event.kind) for body in event.bodies or ()]
        self._ids = {int(system.state.ids[i]) for i in bodies}
        self.begin(system)

    def begin(self, system: System) -> None:
        """Watch these bodies, without any passage under way."""
        self._system, ids, masses = system, system.state.ids, system.state.masses
        self._gm, self._softening2 = attraction(system)
        self._attracts = bool(self._gm.any())
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
        """Watch the remaining bodies; passages go on."""
        old = {tuple(pair): closest for pair, closest in zip(self._by_id(), self._closest_of, strict=True)}
        self.begin(system)
        for p, pair in enumerate(self._by_id()):
            self._closest_of[p] = old.get(tuple(pair), np.inf)

    def _by_id(self) -> list[list[int]]:
        return self._system.state.ids[self._pairs.T].tolist()

    def scan(self, step_parts: list[Part], step: int) -> int:
        """Search a step. Return the number of closest points and ends of passages."""
        self._ended: list[tuple[float, Row]] = []
        self._outside, self._passed = np.isinf(self._closest_of[:, 0]), dict[int, float]()
        for part in step_parts:
            self._count = passages(
                part.y0, part.y1, part.t0, part.t1 - part.t0, step, self._pairs, self._limits, self._heaviest,
                self._closest_of, self._rows,
            )  # fmt: skip
            if len(step_parts) > 1:  # so short that the cubic's closest points need no refinement
                self._end_passages(part.t1)
                self._count = 0
        return self._count + len(self._ended)

    def begun(self, time: float) -> Act | None:
        """The event that ends a run with the searched step, if a passage began there."""
        if self.event.action != "stop":
            return None
        inside = np.isfinite(self._closest_of[:, 0])
        inside[list(self._passed)] = True
        for p in np.flatnonzero(self._outside & inside):
            i, j = (int(k) for k in self._pairs[:, p])
            return Act(self.event, time, (i, j), self._passed.get(int(p), float(self._closest_of[p, 0])))
        return None

    def _end_passages(self, time: float) -> None:
        for p, _, what in self._rows[: self._count].tolist():
            if what != CLOSEST:
                self._ended.append((time, self._entry(int(p), "passed")))
                self._passed[int(p)] = float(self._closest_of[int(p), 0])
                self._closest_of[int(p)] = np.inf

    def bends(self, y: Floats, h: float, inside: bool = False) -> bool:
        """Tell whether a pair passes so near in a step from y, or soon after, that the step does not resolve it. With
        ``inside``, also if an unbound pair is within its limit."""
        if not self._attracts:
            return False
        return bool(any_bends(y, h, self._pairs, self._limits, self._heaviest, self._gm, self._softening2, inside))

    @property
    def under_way(self) -> bool:
        """Whether a passage goes on."""
        return bool(np.isfinite(self._closest_of[:, 0]).any())

    @property
    def limits(self) -> tuple[NDArray[np.int64], Floats, NDArray[np.int64]]:
        """Pairs, their limits, and the body whose distances these are fractions of; see `quiet.Limits`."""
        return self._pairs, self._limits, np.full(len(self._limits), self._heaviest)

    def look(self, span: Span) -> list[tuple[float, Row]]:
        """Entries for passages that ended in the searched span."""
        for p, _, what in self._rows[: self._count].tolist():
            if what == CLOSEST:
                self._refine(int(p), span)
        self._end_passages(span.t1)
        return self._ended

    def _refine(self, pair: int, span: Span) -> None:
        """Replace the cubic's closest point by that of the method's own solution."""
        i, j = self._pairs[:, pair]
        if approach(span.y0, i, j) < 0 < approach(span.y1, i, j):
            time = span.zero(lambda t: approach(span.inside(t), i, j), span.t0, span.t1, 1e-13)
            self._closest_of[pair] = separation(span.inside(time), i, j), time, span.step

    def _entry(self, pair: int, done: str) -> Row:
        distance, time, step = self._closest_of[pair]
        i, j = self._pairs[:, pair]
        return entry(self._system, self.event.kind, time, step, (i, j), distance, done)

    def going_on(self) -> list[Row]:
        """Entries for passages that have not ended."""
        return [self._entry(int(p), "going on") for p in np.flatnonzero(np.isfinite(self._closest_of[:, 0]))]


class Escapes(Checkpointed):
    """Bodies that meet an `Escape`."""

    saved = ("_known_ids", "_known")

    def __init__(self, event: Escape, system: System) -> None:
        self.event = event
        self._distance, self._about = float(event.distance), None
        if event.about is not None:
            self._about = int(system.state.ids[index_of(system, event.about, event.kind)])
        self.begin(system)

    def begin(self, system: System) -> None:
        """Watch these bodies, without any escape."""
        self._known_ids: list[int] = []
        self.follow(system)

    def follow(self, system: System) -> None:
        """Watch the remaining bodies; known escapes stay known."""
        self._system, ids = system, system.state.ids
        self._gm, self._softening2 = attraction(system)
        place = np.flatnonzero(ids == self._about) if self._about is not None else np.array([-1])
        self._place = int(place[0]) if place.size else -2  # the origin of the distance is gone
        self._known = np.isin(ids, self._known_ids)
        self._rows = np.zeros((len(system), 2))

    def scan(self, step_parts: list[Part], step: int) -> int:
        """Number of escapes at the end of a step."""
        self._count = 0
        if self._place >= -1:
            self._count = unbound(
                step_parts[-1].y1, self._gm, self._softening2, self._place, self._distance, self._known, self._rows
            )  # fmt: skip
        return self._count

    @property
    def limit(self) -> tuple[float, int, Floats]:
        """Distance, origin and shares of the masses; see `quiet.Limits`."""
        far = self._distance if self._place >= -1 else np.inf
        return far, max(self._place, -1), self._gm / self._gm.sum()

    def gone(self, span: Span) -> list[Act]:
        """Escapes at the end of the searched span."""
        return [Act(self.event, span.t1, (int(i),), d) for i, d in self._rows[: self._count].tolist()]

    def know(self, body: int) -> None:
        """Mark an escape as reported."""
        self._known_ids.append(int(self._system.state.ids[body]))
        self._known[body] = True


class Passing:
    """Passages beside a run."""

    def __init__(self, run: Watched, approaches: Sequence[Approaches]) -> None:
        self._approaches = approaches
        logs = any(each.event.action == "log" for each in approaches)  # a stop needs no least distance
        self._on = logs and not run.method.adaptive
        self.forget()

    def forget(self) -> None:
        """Forget the passage under way."""
        self._y: Floats | None = None
        self._time = -np.inf

    def parts(self, trials: Trials, found_in: list[Part]) -> list[Part]:
        """The parts of a step that are searched for passages: the step's own, or those of a motion computed apart."""
        if not self._on:
            return found_in
        y, begin, end = found_in[0].y0, found_in[0].t0, found_in[-1].t1
        beside = self._y is not None and self._time == begin  # until the pair has left in the run too
        here, y = y, self._y if beside and self._y is not None else y
        for each in self._approaches:
            if each.bends(y, end - begin) or (beside and each.bends(here, end - begin, inside=True)):
                break
        else:
            self._y = None
            return found_in
        try:
            parts = trials.parts(y, begin, end)
        except RunError:
            self.forget()
            return found_in
        self._y, self._time = parts[-1].y1, end
        return parts

    @property
    def states(self) -> list[Floats]:
        """State of the bodies beside the run, if there is a passage."""
        return [] if self._y is None else [self._y]

    def memory(self) -> Memory:
        """State of the bodies beside the run, and its time."""
        return {"y": self._y, "time": self._time}

    def recall(self, memory: Memory) -> None:
        """Restore this state."""
        self._y, self._time = memory["y"], memory["time"]

"""Events of systems in lanes.

A step that is not quiet for a system is done once more by a Simulation of it alone, which tells whether an event ends
the run. So events, and the state with which a run ends, are those of a system alone.
"""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from kickdrift.forces.gravity.batch import LOOK
from kickdrift.integrators.method import Method
from kickdrift.integrators.trace.batch import Reaches
from kickdrift.integrators.trace.state import COUNTS, PATH_COLUMNS, POINTS
from kickdrift.jit.compile import driver
from kickdrift.jit.handle import address_of
from kickdrift.jit.lanes.vectors import WIDTH
from kickdrift.model.events.events import CloseApproach, Crossing, Escape, Event
from kickdrift.model.state import Floats
from kickdrift.model.subject import index_of
from kickdrift.model.system import System
from kickdrift.run.simulation import Simulation
from kickdrift.run.watch.contacts import Contacts
from kickdrift.run.watch.courses import may_touch
from kickdrift.run.watch.distances import Approaches, Escapes
from kickdrift.run.watch.encounters import POINTS as TURNS
from kickdrift.run.watch.encounters import unbound_bodies
from kickdrift.run.watch.quiet import MARGIN, ROOM, all_inside, nearest, nearest_on_path

PIECE = 32_768  # steps between looks for lanes that have become free
SAMPLES = 4096  # most samples between them


@driver
def lane_is_quiet(before, y, h, counts, path, places, lengths, fractions, touch, far, about, gm, lane):
    """Return 1 if nothing can have happened in a step from ``before`` to y (2, 3, n), else 0; see `quiet.is_quiet`. The
    limits and G m are those of a lane. Pairs may touch at the distances ``touch``."""
    n, count, pair = y.shape[2], counts[POINTS], 0
    if count + MARGIN > path.shape[0]:
        return 0
    ya, yb, c, points = np.zeros((2, 3, 2)), np.zeros((2, 3, 2)), np.empty((4, 3)), np.empty(TURNS)
    own, found = np.empty(n), np.empty(3)
    for i in range(n):
        own[i] = gm[i, lane]
    for i in range(n):
        for j in range(i + 1, n):
            reach, fraction, sizes = lengths[pair, lane], fractions[pair, lane], 0.0
            pair += 1
            if fraction > 0.0:
                for body in (i, j):
                    d2 = 0.0
                    for k in range(3):
                        d2 += (y[0, k, body] - y[0, k, 0]) ** 2
                    sizes += np.sqrt(d2)
                reach = max(reach, fraction * 0.5 * sizes * ROOM)
            if reach == 0.0:
                continue
            least = np.inf
            if count > 0:
                least = nearest_on_path(path, count, places[i], places[j], reach, ya, yb, c, points)
            if least == np.inf:
                least = nearest(before, y, h, i, j, reach, c, points)
            if not least > reach:
                return 0
            if touch[pair - 1, lane] > 0.0 and may_touch(before, h, i, j, touch[pair - 1, lane], own, own, 0.0, found):
                return 0
    if far < np.inf:
        shares = np.empty(n)
        shares[:] = own / own.sum()
        origin = -1 if about > 0.5 else 0
        if not all_inside(y, far, origin, shares):
            known, rows = np.zeros(n, np.bool_), np.zeros((n, 2))
            if unbound_bodies(y, own, 0.0, origin, far, known, rows) > 0:
                return 0
    return 1


def refusal_of(system: System, method: Method) -> str | None:
    """Reason why a batch cannot watch the events of a System, or None."""
    events: Sequence[Event] = system.events
    if not events:
        return None
    if not method.stops_in_lanes:
        return f"a batch watches events with trace, not with {method.name}"
    if any(getattr(event, "action", "log") != "stop" for event in events):
        return 'a batch watches events with action = "stop" alone'
    escapes = [event for event in events if isinstance(event, Escape)]
    if len(escapes) > 1:
        return "a batch watches one escape"
    for event in escapes:
        heaviest = int(np.argmax(system.state.masses))
        if event.about is not None and index_of(system, event.about, event.kind) != heaviest:
            return f"a batch measures escapes from {system.body(heaviest)} or from the centre of mass"
    return None


class LaneEvents:
    """Events of the members of a batch.

    Attributes
    ----------
    stopped : text of the event that ended each member's run, by number
    steps : step with which the run ended, by number
    rows : entries of each member's log of events, by number
    """

    def __init__(
        self,
        systems: Sequence[System],
        order: NDArray[np.int64],
        integrator: str,
        dt: Floats,
        options: Mapping[str, Any],
    ) -> None:
        self._systems, self._integrator, self._dt, self._options = systems, integrator, dt, options
        self.stopped: dict[int, str] = {}
        self.steps: dict[int, int] = {}
        self.rows: dict[int, list[dict[str, Any]]] = {}
        found = [_reaches(system, row) for system, row in zip(systems, order, strict=True)]
        self.reaches = Reaches(*(np.array(part) for part in zip(*found, strict=True)))

    @cached_property
    def quiet_at(self) -> int:
        """Address of ``lane_is_quiet``."""
        n, pairs = len(self._systems[0]), self.reaches.lengths.shape[1]
        y, counts, path = np.zeros((2, 3, n)), np.zeros(COUNTS, np.int64), np.zeros((0, PATH_COLUMNS))
        rows, gm = np.zeros((pairs, WIDTH)), np.zeros((n, WIDTH))
        return address_of(lane_is_quiet, y, y, 0.0, counts, path, counts, rows, rows, rows, 0.0, 0.0, gm, 0)

    def end(self, member: int, before: Floats, step: int) -> Floats | None:
        """State (2, 3, n) with which this step, from the state ``before``, ends a member's run; None if it does not."""
        system, dt = self._systems[member], float(self._dt[member])
        start = system.state.time + (step - 1 - system.state.steps_done) * dt
        sim = Simulation(system, self._integrator, dt, **self._options)
        sim.state = replace(system.state.copy(), phase=before, time=start, steps_done=step - 1)
        sim.advance(1)
        if not sim.stopped:
            return None
        self.stopped[member], self.steps[member] = sim.stopped, step
        self.rows[member] = [*sim.events, *sim.going_on()]
        return sim.state.phase


def _reaches(system: System, order: NDArray[np.int64]) -> tuple[Floats, Floats, Floats, float, float]:
    """Distances within which something may happen to a system whose bodies stand in this order."""
    n = len(order)
    place = np.argsort(order)
    number = np.zeros((n, n), np.int64)
    number[np.triu_indices(n, 1)] = np.arange(n * (n - 1) // 2)
    lengths, fractions, touching = (np.zeros(n * (n - 1) // 2) for _ in range(3))
    far, origin = np.inf, -1
    for event in system.events:
        if isinstance(event, Escape):
            far, origin, _ = Escapes(event, system).limit
            continue
        if isinstance(event, Crossing):  # refused
            continue
        watch = Approaches(event, system) if isinstance(event, CloseApproach) else Contacts(event, system)
        pairs, reaches, about = watch.limits
        rows = number[tuple(np.sort(place[pairs], axis=0))]
        for part, some in ((lengths, about < 0), (fractions, about >= 0)):
            np.maximum.at(part, rows[some], reaches[some])
        if isinstance(watch, Contacts):
            np.maximum.at(touching, rows, reaches)
    return lengths, fractions, touching, float(far), float(origin < 0)


def run_with_events(stepper: Any, counts: NDArray[np.int64], done: int, members: int) -> Floats:
    """Take ``counts`` (k,) steps and sample after each. Members that have stopped leave their lanes, and keep their
    last sample. Returns samples (k, LOOK, members)."""
    found, last = np.zeros((len(counts), LOOK, members)), np.full((LOOK, members), np.nan)
    for parts, samples in _pieces(counts):
        lanes, size = stepper.in_lanes, int(parts.sum())
        looks = np.concatenate([stepper.run(block, parts, done)[0] for block in range(stepper.blocks)], axis=-1)
        for k, sample in enumerate(samples):
            last[:, lanes] = looks[k, :, : len(lanes)]
            if sample is not None:
                found[sample] = last
        done += size
        stepper.pack()
    return found


def _pieces(counts: NDArray[np.int64]) -> Iterator[tuple[NDArray[np.int64], list[int | None]]]:
    """Steps before each of some samples, and the samples' numbers, for about PIECE steps at a time; None for a sample
    that is not kept."""
    parts: list[int] = []
    samples: list[int | None] = []
    for sample, count in enumerate(counts.tolist()):
        cuts = [*range(PIECE, count, PIECE), count]
        for end, before in zip(cuts, [0, *cuts], strict=False):
            parts.append(end - before)
            samples.append(sample if end == count else None)
            if sum(parts) >= PIECE or len(parts) >= SAMPLES:
                yield np.array(parts, np.int64), samples
                parts, samples = [], []
    if parts:
        yield np.array(parts, np.int64), samples

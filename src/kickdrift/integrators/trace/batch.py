"""Integrations of many small systems with the hybrid map, one system in each lane."""

from typing import Any, NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

from kickdrift.forces.bound.forces import BoundForces
from kickdrift.forces.bound.table import SLOTS
from kickdrift.forces.gravity.batch import LOOK, LaneBodies
from kickdrift.integrators.options import Options
from kickdrift.integrators.stepping.batch_loops import Deviations, Members, from_lanes, to_lanes
from kickdrift.integrators.trace import batch_loop
from kickdrift.integrators.trace.batch_events import Limits
from kickdrift.integrators.trace.loop import trace_loop
from kickdrift.integrators.trace.state import COUNTS
from kickdrift.integrators.trace.stepper import hybrid_of, wide_lines
from kickdrift.integrators.wisdom_holman import bodies as rows
from kickdrift.integrators.wisdom_holman.batch import WisdomHolmanLanes
from kickdrift.integrators.wisdom_holman.batch_loop import WAY, WORK, LaneOrbits
from kickdrift.integrators.wisdom_holman.method import LEAPFROG
from kickdrift.jit.handle import address_of
from kickdrift.jit.lanes.memory import aligned
from kickdrift.jit.lanes.vectors import WIDTH
from kickdrift.model.state import Floats


class Reaches(NamedTuple):
    """Distances within which events may happen to each member; see `batch_events.Limits`."""

    lengths: Floats  # (members, pairs)
    fractions: Floats  # (members, pairs)
    touching: Floats  # (members, pairs)
    far: Floats  # (members,)
    about: Floats  # (members,)


class Watching(Protocol):
    """Watcher of the members' events."""

    @property
    def reaches(self) -> Reaches:
        """Distances within which events may happen."""

    @property
    def quiet_at(self) -> int:
        """Address of the compiled test of a step."""

    def end(self, member: int, before: Floats, step: int) -> Floats | None:
        """State (2, 3, n) with which this step, from the state ``before``, ends a member's run; None if it does not."""


class TraceLanes(WisdomHolmanLanes):
    """Members with their states at the step point. A member that an event has stopped leaves its lane at ``pack``."""

    # what each lane has
    _carried = ("_orbit", "_work", "_centre", "_table", "_reach", "_slots", "_central", "_shares", "_gm", "_masses",
                "_marks", "_softening2", "_dt", "_lengths", "_fractions", "_touching", "_far", "_about",
                "_y", "_ended")  # fmt: skip

    def __init__(self, members: Members, way: int, inner: int, options: Options) -> None:
        super().__init__(members, LEAPFROG, options)
        self._hill_radii, count = options.hill_radii, len(members.systems)
        blocks, _, _, bodies, _ = self._orbit.shape
        self._table[:, rows.HILL] = 0.0  # near bodies need no warning
        heavy = (self._table[:, rows.SOURCE] / (3.0 * self._central[:, None])) ** (1 / 3)
        self._reach = (self._hill_radii * heavy) ** 2
        masses = from_lanes(self._masses, blocks * WIDTH)[:, 1:]
        full = WIDTH * -(-bodies // WIDTH)  # slots for as many massive bodies, and for as many massless ones
        light = masses == 0.0
        places = np.where(light, full + np.cumsum(light, axis=1), np.cumsum(~light, axis=1)) - 1
        self._slots = to_lanes(places).astype(np.int64)
        self._alone = self._room(bodies + 1, full, full if light.any() else 0, way, inner)
        self._marks = np.zeros((blocks, batch_loop.MARKS, WIDTH), np.int64)
        self._work = aligned((blocks, WORK, *self._orbit.shape[2:]))
        self._softening2, self._dt = members.softening2, members.dt
        pairs = bodies * (bodies + 1) // 2
        self._lengths, self._fractions, self._touching = (aligned((blocks, pairs, WIDTH)) for _ in range(3))
        self._far, self._about = aligned((blocks, WIDTH), np.inf), aligned((blocks, WIDTH))
        self._ended = aligned(self._y.shape)
        self._kept = np.zeros((WIDTH, 2, 3, bodies + 1))
        self._forces = BoundForces(members.systems[0].under(()))
        cursor, room = np.zeros(SLOTS, np.int64), self._alone
        self._alone_at = address_of(
            trace_loop, self._forces.table, room.hybrid, room.slots, room.listed, room.masses, 0.0, 0.0, room.y, 0, 1,
            cursor,
        )  # fmt: skip
        self._watch: Watching | None = None
        self._lane_of = np.arange(count)  # members in the lanes, in order
        self._gone: dict[int, tuple[Floats, int]] = {}  # last state and evaluations of members that left
        self._seen_order = self._order[:count]
        self._start, self._begun = aligned(self._orbit.shape[1:]), aligned(self._orbit.shape[2:])
        for block in range(blocks):
            batch_loop.begin_lanes(self._lanes(block), self._dt[block])

    @staticmethod
    def _room(n: int, massive: int, massless: int, way: int, inner: int) -> batch_loop.Alone:
        """Room for a system of n bodies that takes a step alone."""
        slots = massive + massless
        bodies = rows.Bodies(
            orbit=aligned((6, slots)), carry=aligned((6, 0)), centre=aligned((5, WIDTH)),
            table=aligned((rows.ROWS, slots)), inside=np.zeros(slots, np.int64), first=np.full((3, slots), np.nan),
            work=aligned((rows.WORK, slots)), massive=massive, jacobi=False, order=np.full(slots, -1), central=0,
            gm=0.0, shares=np.zeros(1), x=np.zeros((2, 3, 1)), a=np.zeros((3, 1)),
        )  # fmt: skip
        hybrid = hybrid_of(bodies, aligned((slots,)), way, inner)
        return batch_loop.Alone(hybrid, np.zeros(n, np.int64), np.arange(n), np.ones((3, n)), np.zeros((2, 3, n)))

    def _lanes(self, block: int) -> batch_loop.LaneTrace:
        n = self._y.shape[3]
        orbits = LaneOrbits(
            orbit=self._orbit[block], seen=self._seen, centre=self._centre[block], table=self._table[block],
            first=self._first[0], work=self._work[block], way=aligned((WAY, WIDTH)), central=self._central[block],
            shares=self._shares[block],
            bodies=LaneBodies(self._gm[block], self._masses[block], self._softening2[block]), jacobi=False,
        )  # fmt: skip
        limits = Limits(
            watched=self._watch is not None, lengths=self._lengths[block], fractions=self._fractions[block],
            touching=self._touching[block], far=self._far[block], about=self._about[block],
            before=np.zeros((2, 3, n)), after=np.zeros((2, 3, n)), kept=self._kept, none=np.zeros(COUNTS, np.int64),
            places=np.full(n, -1),
        )  # fmt: skip
        return batch_loop.LaneTrace(
            orbits=orbits, start=self._start, begun=self._begun, reach=self._reach[block], slots=self._slots[block],
            marks=self._marks[block], idle=aligned((WIDTH,)), ended=self._ended[block], limits=limits,
            way=self._alone.hybrid.way,
        )  # fmt: skip

    # --- runs ---

    def run(self, block: int, counts: NDArray[np.int64], done: int, watch: Deviations | None = None) -> Any:
        """See LaneStepper."""
        looks, cursor, first = aligned((len(counts), LOOK, WIDTH)), np.zeros(SLOTS, np.int64), 0
        quiet_at, alone, forces = self._watch.quiet_at if self._watch else 0, self._alone, self._forces.table
        lanes, y, dt = self._lanes(block), self._y[block], self._dt[block]
        while True:
            found = batch_loop.batch_trace_loop(
                forces, lanes, alone, self._alone_at, quiet_at, y, dt, done, counts, first, looks, cursor
            )
            if found == len(counts):
                return looks, np.zeros((len(counts), WIDTH))
            done += int(counts[first:found].sum())
            first = found
            self._judge(block, done)

    def _judge(self, block: int, done: int) -> None:
        """Stop the members to which an event has happened."""
        marks, watch = self._marks[block], self._watch
        assert watch is not None
        for lane in np.flatnonzero(marks[batch_loop.LOUD]):
            marks[batch_loop.LOUD, lane] = 0
            member = int(self._lane_of[block * WIDTH + lane])
            step = done + int(marks[batch_loop.TAKEN, lane])
            before, order = self._kept[lane], self._order[block * WIDTH + lane]
            time = (step - 1) * self._dt[block, lane]
            x = np.empty(before.shape)
            shares = self._shares[block, :, lane]
            centre = self._centre[block, :, :, lane]
            x[0] = before[0] + (centre[0] + time * centre[1] - before[0, :, 1:] @ shares)[:, None]
            x[1] = before[1] + centre[1][:, None]
            listed = np.empty_like(x)
            listed[:, :, order] = x
            after = watch.end(member, listed, step)
            if after is not None:
                marks[batch_loop.STILL, lane] = 1
                self._ended[block, ..., lane] = after[:, :, order]

    def watch(self, watch: Watching) -> None:
        """Stop members at their events."""
        self._watch, blocks = watch, len(self._y)
        for name, values in zip(("_lengths", "_fractions", "_touching", "_far", "_about"), watch.reaches, strict=True):
            setattr(self, name, to_lanes(values))
        for lane in range(len(self._lane_of), blocks * WIDTH):
            self._marks[lane // WIDTH, batch_loop.STILL, lane % WIDTH] = 1

    @property
    def running(self) -> NDArray[np.int64]:
        """Members in the lanes that no event has stopped."""
        still = self._marks[:, batch_loop.STILL].reshape(-1)[: len(self._lane_of)]
        return self._lane_of[still == 0]

    @property
    def blocks(self) -> int:
        """Number of blocks of lanes."""
        return len(self._y)

    @property
    def order(self) -> NDArray[np.int64]:
        """Bodies (members, n) of each member in the order of the lanes, the central one first."""
        return self._seen_order

    @property
    def in_lanes(self) -> NDArray[np.int64]:
        """Members in the lanes, in order."""
        return self._lane_of

    def pack(self) -> None:
        """Take the members that have stopped out of the lanes, if the others then need fewer blocks."""
        still = self._marks[:, batch_loop.STILL].reshape(-1)[: len(self._lane_of)] == 1
        stay = np.flatnonzero(~still)
        if not len(stay) or -(-len(stay) // WIDTH) == len(self._y):
            return
        y, cost = self.y_of_lanes, self._marks[:, batch_loop.COST].reshape(-1)
        for lane in np.flatnonzero(still):
            self._gone[int(self._lane_of[lane])] = y[lane].copy(), int(cost[lane])
        full = len(self._y) * WIDTH
        for name in self._carried:
            old = getattr(self, name)
            new = to_lanes(from_lanes(old, full)[stay])
            setattr(self, name, new.astype(np.int64) if old.dtype == np.int64 else new)
        blocks = len(self._y)
        more = np.minimum(np.arange(blocks * WIDTH), len(stay) - 1)
        self._order, self._lane_of = self._order[stay[more]], self._lane_of[stay]
        self._marks[-1, batch_loop.STILL, len(stay) - (blocks - 1) * WIDTH :] = 1

    @property
    def y_of_lanes(self) -> Floats:
        """States (lanes, 2, 3, n) in the order of the list."""
        full = len(self._y) * WIDTH
        back = np.argsort(self._order, axis=1)[:, None, None]
        return np.take_along_axis(from_lanes(self._y, full), back, 3)

    @property
    def y(self) -> Floats:
        """See LaneStepper."""
        own = self.y_of_lanes[: len(self._lane_of)]
        found = np.empty((len(self._members.systems), *own.shape[1:]))
        found[self._lane_of] = own
        for member, (state, _) in self._gone.items():
            found[member] = state
        return to_lanes(found)

    def evaluations_of(self, member: int) -> int:
        """See LaneStepper."""
        if member in self._gone:
            return self._gone[member][1]
        lane = int(np.flatnonzero(self._lane_of == member)[0])
        return int(self._marks[lane // WIDTH, batch_loop.COST, lane % WIDTH])

    def warnings(self, member: int) -> list[str]:
        """See LaneStepper."""
        system, order = self._members.systems[member], self._seen_order[member]
        masses = system.state.masses
        far = self._hill_radii * np.cbrt(masses[order[1:]] / (3.0 * masses[order[0]]))
        return wide_lines(system, [int(order[i + 1]) for i in np.flatnonzero(far >= 1.0)], self._hill_radii)

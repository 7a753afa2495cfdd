"""Wisdom-Holman integrations of many small systems, one system in each lane."""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from kickdrift.forces.bound.table import EVALUATIONS, SLOTS
from kickdrift.forces.gravity.batch import LOOK, LaneBodies
from kickdrift.integrators.options import JACOBI, Options
from kickdrift.integrators.splitting.method import Splitting
from kickdrift.integrators.stepping.batch_loops import Deviations, Members, from_lanes, to_lanes
from kickdrift.integrators.wisdom_holman import bodies as rows
from kickdrift.integrators.wisdom_holman.batch_loop import WAY, WORK, LaneOrbits, batch_wisdom_holman_loop
from kickdrift.integrators.wisdom_holman.stepper import passages_and_hill, warning_lines
from kickdrift.jit.lanes.memory import aligned
from kickdrift.jit.lanes.vectors import WIDTH
from kickdrift.model.starts.coordinates import to_democratic, to_jacobi
from kickdrift.model.state import Floats


class WisdomHolmanLanes:
    """The runs stay before the last drift of a step, as in ``WisdomHolmanStepper``."""

    def __init__(self, members: Members, table: Splitting, options: Options) -> None:
        drift, kick = np.array(table.drift), np.array([*table.kick, 0.0])
        self._weights = np.array([drift, kick, np.cumsum(drift)])
        self._members, self._jacobi, self._kicks = members, options.coordinates == JACOBI, len(table.kick)
        blocks, full = len(members.y), len(members.y) * WIDTH
        y, masses, gm = (from_lanes(part, full) for part in (members.y, members.masses, members.gm))
        central = np.argmax(masses, axis=1)[:, None]
        ranks = np.arange(masses.shape[1])
        self._order = np.argsort(np.where(ranks == central, -1, ranks), axis=1)  # (members, n) central body first
        masses, gm = np.take_along_axis(masses, self._order, 1), np.take_along_axis(gm, self._order, 1)
        y = np.take_along_axis(y, self._order[:, None, None], 3)
        x, v = y.transpose(1, 0, 3, 2)
        q = np.array((to_jacobi(x, masses), to_jacobi(v, masses)) if self._jacobi else to_democratic(x, v, masses))
        q = np.ascontiguousarray(q.transpose(1, 0, 3, 2))  # (members, 2, 3, n)
        self._y, self._orbit = to_lanes(y), to_lanes(q[..., 1:])
        elapsed = (from_lanes(members.dt, full) * members.done)[:, None]
        q[:, 0, :, 0] -= elapsed * q[:, 1, :, 0]
        self._centre = to_lanes(q[..., 0])
        constants = self._tables(gm)
        x, v = np.moveaxis(q[..., 1:], (1, 2), (0, 1))
        self._passages, hill = passages_and_hill(x, v, constants[:, rows.GM], constants[:, rows.SOURCE], gm[:, :1])
        constants[:, rows.HILL] = hill
        self._table, self._central = to_lanes(constants), to_lanes(gm[:, 0])
        self._shares = to_lanes(masses[:, 1:] / masses.sum(axis=1, keepdims=True))
        self._gm, self._masses = to_lanes(gm), to_lanes(masses)
        self._first = aligned((blocks, 3, *self._table.shape[2:]), np.inf)
        self._cursor = np.zeros((blocks, SLOTS), np.int64)
        self._seen, self._work = aligned(self._orbit.shape[1:]), aligned((WORK, *self._orbit.shape[2:]))

    def _tables(self, gm: Floats) -> Floats:
        """Constants (members, ROWS, n - 1) of the bodies around the central one, except their Hill radii."""
        central, source = gm[:, :1], gm[:, 1:]
        before = np.cumsum(source, axis=1) - source
        table = np.zeros((len(gm), rows.ROWS, source.shape[1]))
        table[:, rows.LIVE] = 1.0
        rows.fill_table(table.swapaxes(0, 1), central, source, before, self._jacobi)
        return table

    @property
    def y(self) -> Floats:
        """See LaneStepper."""
        full = len(self._y) * WIDTH
        back = np.argsort(self._order, axis=1)[:, None, None]
        return to_lanes(np.take_along_axis(from_lanes(self._y, full), back, 3))

    def evaluations_of(self, member: int) -> int:
        """See LaneStepper."""
        return int(self._cursor[0, EVALUATIONS])

    def run(self, block: int, counts: NDArray[np.int64], done: int, watch: Deviations | None = None) -> Any:
        """See LaneStepper."""
        looks = aligned((len(counts), LOOK, WIDTH))
        members = self._members
        orbits = LaneOrbits(
            orbit=self._orbit[block], seen=self._seen, centre=self._centre[block], table=self._table[block],
            first=self._first[block], work=self._work, way=aligned((WAY, WIDTH)), central=self._central[block],
            shares=self._shares[block],
            bodies=LaneBodies(self._gm[block], self._masses[block], members.softening2[block]), jacobi=self._jacobi,
        )  # fmt: skip
        batch_wisdom_holman_loop(
            orbits, self._y[block], self._weights, members.dt[block], members.start[block], done, counts, looks,
            self._cursor[block],
        )  # fmt: skip
        return looks, np.zeros((len(counts), WIDTH))

    def warnings(self, member: int) -> list[str]:
        """See LaneStepper."""
        members, (block, lane) = self._members, divmod(member, WIDTH)
        order, first, dt = self._order[member, 1:], self._first[block, :, :, lane], float(members.dt[block, lane])
        passages = self._passages[member]
        k = int(np.argmin(passages)) if passages.size else 0
        shortest = (float(passages[k]), int(order[k])) if passages.size and passages[k] < np.inf else None
        unbound, near = (np.flatnonzero(first[row] < np.inf) for row in (rows.UNBOUND, rows.NEAR))
        return warning_lines(
            members.systems[member], dt, dt / self._kicks, shortest,
            [(int(order[i]), float(first[rows.UNBOUND, i])) for i in unbound],
            [(int(order[i]), int(order[int(first[rows.WHICH, i])]), float(first[rows.NEAR, i])) for i in near],
        )  # fmt: skip

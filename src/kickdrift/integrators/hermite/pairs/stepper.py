"""Integration with hermite4 in block steps, with close pairs on orbits of their own."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from kickdrift.errors import InputError
from kickdrift.forces.seam.kernel import OK
from kickdrift.integrators.hermite.pairs.loop import pairs_loop, put_members
from kickdrift.integrators.hermite.pairs.table import (
    AXIS,
    BROKEN,
    COUNT,
    DISTANCE,
    ECCENTRICITY,
    FORM,
    FORMED,
    KIND,
    LOGGED,
    ONE,
    OTHER,
    SINGLE,
    STEP,
    TIME,
    pairs_among,
)
from kickdrift.integrators.hermite.stepper import START, TAKEN, HermiteStepper
from kickdrift.integrators.options import Options
from kickdrift.integrators.stepping.loops import STEP as COUNTED
from kickdrift.model.memory import Memory
from kickdrift.model.state import Floats


class PairChange(NamedTuple):
    """Formation or break-up of a pair: time and step, whether it formed, its two bodies and their distance, and the
    semi-major axis (infinite without one) and eccentricity of its orbit."""

    time: float
    step: int
    formed: bool
    bodies: tuple[int, int]
    distance: float
    axis: float
    eccentricity: float


class PairStepper(HermiteStepper):
    """Hermite integration whose close pairs are single bodies in the block steps.

    ``y`` and ``at`` put the bodies of each pair on its orbit. A checkpoint also holds the pairs, with their orbits and
    neighbours. `changes` returns the formations and break-ups since its last call.
    """

    saved = (
        *HermiteStepper.saved, "_pairs.partner", "_pairs.bodies", "_pairs.orbit", "_pairs.near", "_pairs.nears",
        "_pairs.strength", "_pairs.tally",
    )  # fmt: skip

    def __init__(self, flow: Any, options: Options) -> None:
        super().__init__(flow, options)
        self._pairs = pairs_among(self._bodies.sources.gm[: len(self._bodies.times)])
        self._changes: list[PairChange] = []

    def reset(self, y: Floats, time: float, steps: int) -> None:
        super().reset(y, time, steps)
        self._pairs.partner[:] = SINGLE
        self._pairs.tally[:] = 0
        self._pairs.nears[:] = 0
        self._changes.clear()
        self._weigh()

    def recall(self, memory: Memory) -> None:
        super().recall(memory)
        pairs, n = self._pairs, len(self._pairs.gm)
        count, bodies = int(pairs.tally[COUNT]), pairs.bodies
        good = 0 <= count <= bodies.shape[1] and not (pairs.tally < 0).any() and pairs.tally[LOGGED] == 0
        good = good and ((bodies >= 0) & (bodies < n)).all() and ((pairs.near >= 0) & (pairs.near < n)).all()
        good = good and ((pairs.nears >= 0) & (pairs.nears <= pairs.near.shape[1])).all()
        partner = np.full(n, SINGLE)
        if good:
            first, second = bodies[:, :count]
            partner[first], partner[second] = second, first
        if not (good and np.array_equal(partner, pairs.partner) and len(set(bodies[:, :count].flat)) == 2 * count):
            raise InputError("checkpoint: pairs do not fit the bodies of this system")
        self._changes.clear()
        self._weigh()

    def _weigh(self) -> None:
        """Give the slots of pairs their masses."""
        gm, pairs = self._bodies.sources.gm, self._pairs
        gm[: len(pairs.gm)] = pairs.gm
        first, second = pairs.bodies[:, : pairs.tally[COUNT]]
        gm[first], gm[second] = pairs.gm[first] + pairs.gm[second], 0.0

    @property
    def pairs(self) -> list[tuple[int, int]]:
        """The pairs of now, by the numbers of their bodies."""
        return [(int(i), int(j)) for i, j in self._pairs.bodies[:, : self._pairs.tally[COUNT]].T]

    @property
    def formed(self) -> int:
        """Pairs formed since the state was set."""
        return int(self._pairs.tally[FORMED])

    @property
    def broken(self) -> int:
        """Pairs broken up since the state was set."""
        return int(self._pairs.tally[BROKEN])

    def changes(self) -> list[PairChange]:
        """Return the changes since the last call."""
        found, self._changes = self._changes, []
        return found

    def _drain(self) -> None:
        """Move the compiled log to ``_changes``."""
        pairs, clock = self._pairs, self._clock
        begun = self.steps_done + int(self._cursor[COUNTED] - clock[TAKEN])
        for row in pairs.log[: pairs.tally[LOGGED]]:
            time, bodies = float(clock[START] + row[TIME]), (int(row[ONE]), int(row[OTHER]))
            orbit = map(float, row[[DISTANCE, AXIS, ECCENTRICITY]])
            self._changes.append(PairChange(time, begun + int(row[STEP]), bool(row[KIND] == FORM), bodies, *orbit))
        pairs.tally[LOGGED] = 0

    def _loop(self, steps: int, until: float) -> int:
        args = self._bodies, self._pairs, self._eta, self._clock, until, steps, self._cursor
        while True:
            status = self._call(pairs_loop, *args)
            full = self._pairs.tally[LOGGED] > 0
            self._drain()
            if status != OK or not full or self._cursor[COUNTED] >= steps or self.time >= until:
                return status

    def _series_at(self, since: float) -> Floats:
        y = super()._series_at(since)
        if self._pairs.tally[COUNT]:
            put_members(self._bodies, self._pairs, since, y)
        return y

    def reached(self, inside_step: bool) -> tuple[Floats, Floats]:
        return self.y, self.y[0]

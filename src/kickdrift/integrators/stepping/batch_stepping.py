"""Integrations of many small systems, eight to a block, one system in each lane."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any, NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

from kickdrift.forces.bound.evaluate import EVALUATIONS, SLOTS
from kickdrift.forces.gravity.batch import LOOK, LaneBodies
from kickdrift.jit.lanes.memory import aligned
from kickdrift.jit.lanes.vectors import WIDTH
from kickdrift.model.state import Floats

if TYPE_CHECKING:
    from kickdrift.model.system import System


class Members(NamedTuple):
    """Systems with equal numbers of bodies, in blocks of eight. Copies of the last system fill the last block."""

    systems: Sequence[System]
    done: int  # steps done before
    y: Floats  # (blocks, 2, 3, rows, 8); rows beyond the n bodies are deviations
    gm: Floats  # (blocks, n, 8) G m
    masses: Floats  # (blocks, n, 8) coherent
    softening2: Floats  # (blocks, 8)
    dt: Floats  # (blocks, 8)
    start: Floats  # (blocks, 8) the time of step 0

    def bodies(self, block: int) -> LaneBodies:
        """Data of a block for the forces."""
        return LaneBodies(self.gm[block], self.masses[block], self.softening2[block])


def to_lanes(values: Floats) -> Floats:
    """Convert (members, …) to (blocks, …, 8)."""
    blocks = -(-len(values) // WIDTH)
    chosen = values[np.minimum(np.arange(blocks * WIDTH), len(values) - 1)]
    lanes = np.moveaxis(chosen.reshape(blocks, WIDTH, *values.shape[1:]), 1, -1)
    found = aligned(lanes.shape, None)
    found[...] = lanes
    return found


def from_lanes(lanes: Floats, count: int) -> Floats:
    """Convert (blocks, …, 8) to a copy (members, …)."""
    return np.moveaxis(lanes, -1, 1).reshape(-1, *lanes.shape[1:-1])[:count].copy()


class Deviations(NamedTuple):
    """Sampling of deviations; see ``batch_loops.Watch``."""

    inverse: Floats  # (blocks, 2, 8)
    largest: float


class LaneStepper(Protocol):
    """Integrations in progress."""

    @property
    def y(self) -> Floats:
        """State (blocks, 2, 3, rows, 8) at the last sample."""

    def evaluations_of(self, member: int) -> int:
        """Force evaluations of a system so far."""

    def run(self, block: int, counts: NDArray[np.int64], done: int, watch: Deviations | None = None) -> Any:
        """Take ``counts`` (k,) steps after the ``done`` steps, and sample after each. Return samples (k, LOOK, 8), or
        lengths of deviations (k, 1, 8), and the powers of two (k, 8) that rescaled them."""

    def warnings(self, member: int) -> list[str]:
        """Warnings about effects that the method does not follow in this system."""


class FixedLanes:
    """Fixed steps by a compiled loop (see ``batch_loops``), with a workspace of this shape for each block."""

    def __init__(self, members: Members, loop: Any, weights: Floats, room: tuple[int, ...]) -> None:
        self._members, self._loop, self._weights = members, loop, weights
        self.y = members.y
        self._work = aligned((len(self.y), *room))
        self._cursor = np.zeros((len(self.y), SLOTS), np.int64)

    def evaluations_of(self, member: int) -> int:
        """See LaneStepper."""
        return int(self._cursor[0, EVALUATIONS])

    def run(self, block: int, counts: NDArray[np.int64], done: int, watch: Deviations | None = None) -> Any:
        """See LaneStepper."""
        from kickdrift.integrators.stepping.batch_loops import Watch

        looks = aligned((len(counts), LOOK if watch is None else 1, WIDTH))
        exponents = np.zeros((len(counts), WIDTH))
        inverse, largest = (np.zeros((2, WIDTH)), 1.0) if watch is None else (watch.inverse[block], watch.largest)
        self._loop(
            self._members.bodies(block), self.y[block], self._work[block], self._weights, self._members.dt[block],
            counts, looks, Watch(inverse, largest, exponents), self._cursor[block],
        )  # fmt: skip
        return looks, exponents

    def warnings(self, member: int) -> list[str]:
        """Return no warnings."""
        return []

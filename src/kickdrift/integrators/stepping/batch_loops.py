"""Many small systems, eight to a block, one system in each lane: compiled fixed-step loops, and their steppers.

All take (bodies, y, work, weights, dt, counts, looks, watch, cursor): ``y`` (2, 3, rows, 8) positions and velocities,
``work`` the method's workspace, ``weights`` as in ``loops``, ``dt`` (8,), ``counts`` (k,) the steps before each of k
samples, and ``looks`` (k, LOOK, 8) the samples. With deviations, a sample is their length instead: see ``Watch``. The
whole run of a block stays in the nearest cache. A lane that blows up keeps non-finite numbers, and the others continue.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any, NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

from kickdrift.forces.bound.table import EVALUATIONS, SLOTS
from kickdrift.forces.gravity.batch import LOOK, LaneBodies, accelerations_in_lanes, look_in_lanes
from kickdrift.integrators.stepping.loops import FRESH
from kickdrift.jit.compile import driver, in_order, jit
from kickdrift.jit.handle import handle, unowned
from kickdrift.jit.lanes.functions import splat
from kickdrift.jit.lanes.masks import any_lane
from kickdrift.jit.lanes.memory import aligned, load, store
from kickdrift.jit.lanes.vectors import WIDTH
from kickdrift.model.state import Floats

if TYPE_CHECKING:
    from kickdrift.model.system import System


class Watch(NamedTuple):
    """Sampling of deviations.

    ``inverse`` (2, 8) is one over the scales of positions and velocities. A length above ``largest``, or below its
    inverse, is rescaled by a power of two, whose exponents are in ``exponents`` (k, 8).
    """

    inverse: NDArray[np.float64]
    largest: float
    exponents: NDArray[np.float64]


@in_order
def look(bodies, y, k, looks, watch, cursor):
    """looks[k] <- the sample. For deviations, their length in row 0, after which they may be rescaled."""
    n, rows = bodies.gm.shape[0], y.shape[2]
    if rows == n:
        look_in_lanes(bodies, y[0], y[1], looks[k])
        return
    squares = splat(0.0)
    for half in range(2):
        inverse = load(watch.inverse, half * WIDTH)
        for axis in range(3):
            first = (half * 3 + axis) * rows
            for i in range(first + n, first + rows):
                u = load(y, i * WIDTH) * inverse
                squares = squares + u * u
    size = looks[k, 0]
    store(size, 0, math.sqrt(squares))
    if any_lane(load(size, 0) >= watch.largest) or any_lane(load(size, 0) <= 1.0 / watch.largest):
        scale_back(y, n, size, watch, k)
        cursor[FRESH] = 0


@jit
def scale_back(y, n, size, watch, k):
    for lane in range(WIDTH):
        if 0.0 < size[lane] < np.inf and not 1.0 / watch.largest < size[lane] < watch.largest:
            exponent = np.rint(np.log2(size[lane]))
            watch.exponents[k, lane] = exponent
            for half in range(2):
                for axis in range(3):
                    for i in range(n, y.shape[2]):
                        y[half, axis, i, lane] *= 2.0**-exponent  # exact: no digit changes


@in_order
def advance_in_lanes(y, factor, dy, size):
    """y <- y + factor dy, for ``size`` numbers; ``factor`` in lanes."""
    for p in range(0, size, WIDTH):
        store(y, p, load(y, p) + factor * load(dy, p))


@in_order
def copy_in_lanes(target, source):
    """target <- source, with equal sizes."""
    for p in range(0, source.size, WIDTH):
        store(target, p, load(source, p))


@driver
def batch_splitting_loop(bodies, y, work, weights, dt, counts, looks, watch, cursor):
    bound, watched = handle(bodies), handle(watch)
    y, work, weights, counts = unowned(y), unowned(work), unowned(weights), unowned(counts)
    looks, cursor, step = unowned(looks), unowned(cursor), load(unowned(dt), 0)
    x, v = y[0], y[1]
    kick, drift = weights[0], weights[1]
    for k in range(counts.size):
        for _ in range(counts[k]):
            for stage in range(kick.size):
                if kick[stage] != 0.0:
                    if not cursor[FRESH]:
                        accelerations_in_lanes(bound, x, work)
                        cursor[FRESH] = 1
                        cursor[EVALUATIONS] += 1
                    advance_in_lanes(v, kick[stage] * step, work, v.size)
                if drift[stage] != 0.0:
                    advance_in_lanes(x, drift[stage] * step, v, v.size)
                    cursor[FRESH] = 0
        look(bound, y, k, looks, watched, cursor)


@driver
def batch_runge_kutta_loop(bodies, y, work, weights, dt, counts, looks, watch, cursor):
    bound, watched = handle(bodies), handle(watch)
    y, work, weights, counts = unowned(y), unowned(work), unowned(weights), unowned(counts)
    looks, cursor, step = unowned(looks), unowned(cursor), load(unowned(dt), 0)
    stages, trial = weights.shape[1], work[0]
    for k in range(counts.size):
        for _ in range(counts[k]):
            for stage in range(stages + 1):  # the last row has the weights of the whole step
                target = trial if stage < stages else y
                if stage < stages:
                    copy_in_lanes(trial, y)
                for j in range(stage):
                    if weights[stage, j] != 0.0:
                        advance_in_lanes(target, weights[stage, j] * step, work[j + 1], y.size)
                if stage < stages:
                    copy_in_lanes(work[stage + 1, 0], trial[1])
                    accelerations_in_lanes(bound, trial[0], work[stage + 1, 1])
            cursor[EVALUATIONS] += stages
        look(bound, y, k, looks, watched, cursor)


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

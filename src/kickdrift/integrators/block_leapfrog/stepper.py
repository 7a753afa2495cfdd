"""Steps of ``leapfrog-block``: the levels of the bodies, and the compiled loop of drifts and kicks.

A body of level l has the step dt / 2^l. Time within a step is counted in ticks of dt / 2^DEEPEST.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

import numpy as np

from kickdrift.forces.bound.forces import BoundForces
from kickdrift.forces.bound.table import SLOTS, fill_accelerations
from kickdrift.forces.seam.kernel import BLOWN_UP, OK
from kickdrift.forces.tree.force import GravityTree
from kickdrift.forces.tree.kernel import TreeKernel, sum_all
from kickdrift.integrators.stepping.loops import STEP
from kickdrift.integrators.stepping.stepper import Counts
from kickdrift.integrators.stepping.stepping import Regular, Retimed
from kickdrift.jit.compile import driver, is_finite, jit
from kickdrift.jit.handle import handle
from kickdrift.jit.threads.chunks import team_of
from kickdrift.model.state import Floats

if TYPE_CHECKING:
    from kickdrift.integrators.flows.flow import Flow
    from kickdrift.integrators.options import Options

DEEPEST = 20  # level
TICKS = 1 << DEEPEST


@jit
def ticks_of(level):
    """Return the ticks of a step."""
    return 1 << (DEEPEST - level)


@jit
def wanted_level(a, i, dt, length):
    """Return the level of the longest step that is at most sqrt(length / |a|) for body i."""
    size2 = a[0, i] * a[0, i] + a[1, i] * a[1, i] + a[2, i] * a[2, i]
    level, step2 = 0, dt * dt * math.sqrt(size2)
    while level < DEEPEST and step2 > length:
        step2 *= 0.25
        level += 1
    return level


@jit
def accelerations_of_some(tree, others, time, y, a, beside, cursor):
    """a <- the accelerations of the bodies that are ``wanted`` of the tree; return a status."""
    if not sum_all(tree, False, y[0]):
        return BLOWN_UP
    status = fill_accelerations(others, time, y[0], y[1], beside, None, cursor)
    if status != OK:
        return status
    for i in range(tree.wanted.size):
        if tree.wanted[i]:
            for k in range(3):
                a[k, i] = tree.spare[i, k] + beside[k, i]
                if not is_finite(a[k, i]):
                    return BLOWN_UP
    return OK


@driver
def block_loop(others, tree, y, a, beside, levels, begun, summed, dt, length, start, first, steps, cursor):
    """Take ``steps`` of dt; see ``loops``. ``a`` and ``levels`` are those at y. Return a status.

    ``summed`` counts the bodies whose acceleration was computed. ``length`` is 2 eta softening."""
    tree, others = handle(tree), handle(others)
    n = y.shape[2]
    if steps > 0 and begun[0] == 0:
        tree.wanted[:] = True
        status = accelerations_of_some(tree, others, start + first * dt, y, a, beside, cursor)
        if status != OK:
            return status
        summed[0] += n
        for i in range(n):
            levels[i] = wanted_level(a, i, dt, length)
        begun[0] = 1
    while cursor[STEP] < steps:
        tick, deepest = 0, 0
        for i in range(n):
            deepest = max(deepest, levels[i])
            half = 0.5 * dt * ticks_of(levels[i]) / TICKS
            for k in range(3):
                y[1, k, i] += half * a[k, i]
        while tick < TICKS:
            stride = ticks_of(deepest)
            drift = dt * stride / TICKS
            tick += stride
            for i in range(n):
                for k in range(3):
                    y[0, k, i] += drift * y[1, k, i]
                tree.wanted[i] = tick % ticks_of(levels[i]) == 0
                summed[0] += tree.wanted[i]
            time = start + (first + cursor[STEP] + tick / TICKS) * dt
            status = accelerations_of_some(tree, others, time, y, a, beside, cursor)
            if status != OK:
                return status
            deepest = 0
            for i in range(n):
                if tree.wanted[i]:
                    kick = 0.5 * dt * ticks_of(levels[i]) / TICKS
                    level = wanted_level(a, i, dt, length)
                    if level < levels[i] and tick < TICKS:
                        longer = tick % ticks_of(levels[i] - 1) == 0
                        level = levels[i] - 1 if longer else levels[i]
                    levels[i] = level
                    if tick < TICKS:
                        kick += 0.5 * dt * ticks_of(level) / TICKS
                    for k in range(3):
                        y[1, k, i] += kick * a[k, i]
                deepest = max(deepest, levels[i])
        cursor[STEP] += 1
    return OK


class BlockStepper(Retimed, Regular):
    """Integration whose checkpoint holds the accelerations and the levels of all bodies."""

    saved = ("_start", "_cursor", "_a", "_levels", "_begun", "_summed")
    trouble = ""
    _lists = None

    def __init__(self, flow: Flow, options: Options) -> None:
        system: Any = flow.subject
        assert options.dt is not None
        self._flow, self.dt = flow, options.dt
        (force,) = (each for each in system.forces if isinstance(each, GravityTree))
        rest = system.under(each for each in system.forces if each is not force)
        self._others = BoundForces(rest, flow.forces.threads, jumps=False)  # type: ignore[union-attr]
        n = len(system)
        parts: TreeKernel = force.bind(system, flow.forces.threads)  # type: ignore[union-attr]
        self._tree = parts._replace(wanted=np.ones(n, np.bool_))
        self._length = 2.0 * (options.eta or 0.0) * force.softening
        self._cursor = np.zeros(SLOTS, np.int64)
        self._a, self._beside = np.zeros((2, 3, n))
        self._levels = np.zeros(n, np.int64)
        self._begun, self._summed = np.zeros((2, 1), np.int64)

    def reset(self, y: Floats, time: float, steps: int) -> None:
        """See Stepper."""
        self.y, self.steps_done = y, steps
        self._start = time - steps * self.dt
        self._cursor[STEP:] = 0
        self._begun[0] = 0

    def advance(self, steps: int, until: float = np.inf) -> int:
        """See Stepper."""
        if self._others.threads > 1:
            team_of(self._others.threads).start()
        status = block_loop(
            self._others.table, self._tree, self.y, self._a, self._beside, self._levels, self._begun, self._summed,
            self.dt, self._length, self._start, self.steps_done, steps, self._cursor,
        )  # fmt: skip
        self.steps_done += int(self._cursor[STEP])
        self._cursor[STEP] = 0
        return int(status)

    @property
    def counts(self) -> Counts:
        """Cost since the start; the sum for some bodies counts as their fraction of an evaluation."""
        return Counts(-(-int(self._summed[0]) // len(self._levels)))

    def reached(self, inside_step: bool) -> tuple[Floats, Floats]:
        """See Stepper."""
        return self.y, self.y[0] - self.dt * self.y[1]

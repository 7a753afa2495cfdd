"""Steps of ``leapfrog-block``: the levels of the bodies, and the compiled loop of drifts and kicks.

A body of level l has the step dt / 2^l. Time within a step is counted in ticks of dt / 2^DEEPEST.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

import numpy as np

from kickdrift.forces.bound.forces import BoundForces
from kickdrift.forces.bound.table import SLOTS, fill_accelerations
from kickdrift.forces.seam.kernel import OK
from kickdrift.forces.tree.force import GravityTree
from kickdrift.forces.tree.kernel import TreeKernel
from kickdrift.integrators.stepping.loops import STEP
from kickdrift.integrators.stepping.stepper import Counts
from kickdrift.integrators.stepping.stepping import Regular, Retimed
from kickdrift.jit.compile import driver, jit
from kickdrift.jit.handle import handle
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


@driver
def block_loop(forces, wanted, y, a, work, levels, begun, summed, dt, length, start, first, steps, cursor):
    """Take ``steps`` of dt; see ``loops``. ``a`` and ``levels`` are those at y. Return a status.

    The tree sums the accelerations of the bodies that are ``wanted``, into ``work``, and ``summed`` counts them.
    ``length`` is 2 eta softening.
    """
    bound = handle(forces)
    n = y.shape[2]
    if steps > 0 and begun[0] == 0:
        wanted[:] = True
        status = fill_accelerations(bound, start + first * dt, y[0], y[1], a, None, cursor)
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
                wanted[i] = tick % ticks_of(levels[i]) == 0
                summed[0] += wanted[i]
            time = start + (first + cursor[STEP] + tick / TICKS) * dt
            status = fill_accelerations(bound, time, y[0], y[1], work, None, cursor)
            if status != OK:
                return status
            deepest = 0
            for i in range(n):
                if wanted[i]:
                    for k in range(3):
                        a[k, i] = work[k, i]
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
        assert options.eta is not None
        self._flow, self.dt = flow, options.dt
        (tree,) = (each for each in system.forces if isinstance(each, GravityTree))
        n = len(system)
        self._wanted = np.ones(n, np.bool_)
        self._forces = BoundForces(system, flow.forces.threads, jumps=False)
        self._forces.forces = tuple(
            type(each)(each.parts._replace(wanted=self._wanted)) if isinstance(each.parts, TreeKernel) else each
            for each in self._forces.forces
        )
        self._length = 2.0 * options.eta * tree.softening
        self._cursor = np.zeros(SLOTS, np.int64)
        self._a, self._work = np.zeros((2, 3, n))
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
        status = self._forces.call(
            block_loop, self._wanted, self.y, self._a, self._work, self._levels, self._begun, self._summed, self.dt,
            self._length, self._start, self.steps_done, steps, self._cursor,
        )  # fmt: skip
        self.steps_done += int(self._cursor[STEP])
        self._cursor[STEP] = 0
        return status

    @property
    def counts(self) -> Counts:
        """Cost since the start; the sum for some bodies counts as their fraction of an evaluation."""
        return Counts(-(-int(self._summed[0]) // len(self._levels)))

    def reached(self, inside_step: bool) -> tuple[Floats, Floats]:
        """See Stepper."""
        return self.y, self.y[0] - self.dt * self.y[1]

"""Integration with the hybrid map of Wisdom-Holman steps and encounters: its memory and its warnings."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, ClassVar, Self

import numpy as np
from numpy.typing import NDArray

from kickdrift.forces.bound.table import SLOTS
from kickdrift.forces.gravity.direct import Gravity
from kickdrift.integrators.options import Options
from kickdrift.integrators.stepping.loops import STEP
from kickdrift.integrators.stepping.stepping import CompiledSteps
from kickdrift.integrators.trace.loop import trace_loop
from kickdrift.integrators.trace.path import points_inside
from kickdrift.integrators.trace.room import hybrid_of
from kickdrift.integrators.trace.state import PAIRS, PASSAGES, PATH_COLUMNS, POINTS, TWICE
from kickdrift.integrators.wisdom_holman.bodies import LIVE, SOURCE
from kickdrift.integrators.wisdom_holman.method import LEAPFROG
from kickdrift.integrators.wisdom_holman.stepper import WisdomHolmanStepper
from kickdrift.jit.handle import address_of
from kickdrift.jit.lanes.memory import aligned
from kickdrift.model.state import Floats

if TYPE_CHECKING:
    from kickdrift.integrators.flows.flow import Flow
    from kickdrift.model.system import System

NAMED = 3  # most bodies that a warning names


class TraceStepper(WisdomHolmanStepper):
    """Integration in democratic heliocentric coordinates that follows encounters and pericentre passages.

    A checkpoint holds the orbits at the step point and the centre of mass. Near pairs and passages are found again from
    these.
    """

    saved: ClassVar[tuple[str, ...]] = ("_cursor", "_start", "_twice", "_wide", "_bodies.orbit", "_bodies.centre")

    def __init__(self, flow: Flow, way: int, inner: int, options: Options) -> None:
        self._way, self._inner, self._hill_radii = way, inner, options.hill_radii
        self._moving = flow.not_separable is not None
        super().__init__(flow, LEAPFROG, options)

    def _place(self, system: System) -> None:
        super()._place(system)
        bodies = self._bodies
        slots = bodies.table.shape[1]
        heavy = (bodies.table[SOURCE] / (3.0 * bodies.gm)) ** (1 / 3)
        self._reach = aligned((slots,))
        self._reach[:] = (self._hill_radii * heavy) ** 2 * bodies.table[LIVE]
        others = [force for force in system.forces if not isinstance(force, Gravity)]
        self._hybrid = hybrid_of(bodies, self._reach, self._way, self._inner, others, self._moving)

    def reset(self, y: Floats, time: float, steps: int) -> None:
        self.y, self.steps_done = y.copy(), steps
        self._start = time - steps * self.dt
        self._cursor = np.zeros(SLOTS, np.int64)
        self._others.forget()
        for flags in (self._hybrid.counts, self._hybrid.near, self._hybrid.meets, self._hybrid.passes):
            flags[...] = 0
        self._enter(y)
        self._look_at_start()

    def _look_at_start(self) -> None:
        """Find the bodies whose hand-over radius covers their whole orbit."""
        far = np.sqrt(self._reach)
        self._wide = [int(self._bodies.order[slot]) for slot in np.flatnonzero(far >= 1.0)]

    def begin_from(self, run: Self) -> None:
        """Start anew at the step point of another stepper of the same method."""
        self.reset(run.y, run.time, run.steps_done)

    @property
    def flags(self) -> tuple[int, int]:
        """Numbers of near pairs and of pericentre passages at the step point, once steps are done."""
        return int(self._hybrid.counts[PAIRS]), int(self._hybrid.counts[PASSAGES])

    @property
    def _twice(self) -> int:
        """Number of steps done once more with further pairs or passages."""
        return int(self._hybrid.counts[TWICE])

    @_twice.setter
    def _twice(self, value: int) -> None:
        self._hybrid.counts[TWICE] = value

    @property
    def _given(self) -> tuple[object, ...]:
        return self._hybrid, self._slots, self._listed, self._masses, self.dt, self._start, self.y

    def advance(self, steps: int, until: float = np.inf) -> int:
        status = self._others.call(trace_loop, *self._given, self.steps_done, steps, self._cursor)
        self.steps_done += int(self._cursor[STEP])
        self._cursor[STEP] = 0
        return status

    def noting(self, rows: int) -> tuple[NDArray[np.int64], int, NDArray[np.int64]]:
        """Make room for ``rows`` points inside a step, and note the pairs and passages of each step, for a tangent map.

        Return the slot of each body (n,), the central one first, then massive bodies; the number of slots; and each
        body's row in the system."""
        bodies = self._bodies
        massive, slots = self._hybrid.near.shape
        self._hybrid = self._hybrid._replace(
            path=np.zeros((rows, PATH_COLUMNS)), used=np.zeros((massive + 1, slots), np.uint8)
        )
        slot = np.flatnonzero(self._real)
        return np.array([0, *slot]), slots, np.array([bodies.central, *bodies.order[slot]])

    def advance_with(self, tangents: object, steps: int) -> int:
        """Take steps, and move these ``tangent.TraceTangents`` along. Return a status."""
        from kickdrift.integrators.trace.tangent import trace_tangent_steps

        table, given = self._others.table, self._given
        if self._loop_at is None:
            self._loop_at = address_of(trace_loop, table, *given, self.steps_done, 1, self._cursor)
        status = trace_tangent_steps(self._loop_at, table, *given, self.steps_done, steps, self._cursor, tangents)
        self.steps_done += int(self._cursor[STEP])
        self._cursor[STEP] = 0
        return int(status)

    @property
    def steady(self) -> bool:  # type: ignore[override]
        return True

    @property
    def compiled_steps(self) -> CompiledSteps:
        return trace_loop, self._others, self._given

    @property
    def noted(self) -> tuple[NDArray[np.int64], Floats, NDArray[np.int64]]:
        """Memory with the number of points of bodies that met inside the last step, the points (see ``state``),
        and the slot of each body, -1 for the central one."""
        slots = self._slots.copy()
        slots[self._bodies.central] = -1
        return self._hybrid.counts[POINTS : POINTS + 1], self._hybrid.path, slots

    def inside(self, before: Floats) -> list[tuple[float, Floats]]:
        """Times and states inside the last step, which began at ``before``, at the points of the bodies that meet."""
        rows = self._hybrid.path[: self._hybrid.counts[POINTS]]
        order, central = self._bodies.order, self._bodies.central
        return points_inside(rows, order, central, before, self.y, self.time - self.dt, self.dt)

    @property
    def warnings(self) -> list[str]:
        return wide_lines(self._system, self._wide, self._hill_radii)


def wide_lines(system: System, wide: Sequence[int], hill_radii: float) -> list[str]:
    """Warning about bodies whose hand-over radius covers their whole orbit, if there are any."""
    if not wide:
        return []
    more = len(wide) - NAMED
    names = ", ".join(system.body(i) for i in wide[:NAMED]) + (f" and {more} more" if more > 0 else "")
    return [
        f"{names}: the hand-over radius, hill_radii = {hill_radii:g}, covers the whole orbit, "
        "so every step is an encounter; take a smaller hill_radii"
    ]

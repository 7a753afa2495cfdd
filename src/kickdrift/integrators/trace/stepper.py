"""Integration with the hybrid map of Wisdom-Holman steps and encounters: its memory and its warnings."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, ClassVar, Self

import numpy as np
from numpy.typing import NDArray

from kickdrift.forces.gravity.direct import Gravity
from kickdrift.forces.seam.group import ListedForce
from kickdrift.integrators.gauss_radau import series
from kickdrift.integrators.gauss_radau.tables import tables
from kickdrift.integrators.options import Options
from kickdrift.integrators.stepping.loops import STEP
from kickdrift.integrators.stepping.stepping import CompiledSteps
from kickdrift.integrators.trace import state
from kickdrift.integrators.trace.loop import trace_loop
from kickdrift.integrators.wisdom_holman.bodies import LIVE, SOURCE, Bodies
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
        self.begin_at(y.copy(), time, steps)
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
        return int(self._hybrid.counts[state.PAIRS]), int(self._hybrid.counts[state.PASSAGES])

    @property
    def _twice(self) -> int:
        """Number of steps done once more with further pairs or passages."""
        return int(self._hybrid.counts[state.TWICE])

    @_twice.setter
    def _twice(self, value: int) -> None:
        self._hybrid.counts[state.TWICE] = value

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
            path=np.zeros((rows, state.PATH_COLUMNS)), used=np.zeros((massive + 1, slots), np.uint8)
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
        return self._hybrid.counts[state.POINTS : state.POINTS + 1], self._hybrid.path, slots

    def inside(self, before: Floats) -> list[tuple[float, Floats]]:
        """Times and states inside the last step, which began at ``before``, at the points of the bodies that meet."""
        rows = self._hybrid.path[: self._hybrid.counts[state.POINTS]]
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


# --- memory ---


def hybrid_of(
    bodies: Bodies, reach: Floats, way: int, inner: int, others: Sequence[object] = (), moving: bool = False
) -> state.Hybrid:
    """The state of the hybrid map of these bodies, with ``reach`` (slots,) as in ``state``.

    ``others`` are the forces other than gravity; ``moving`` tells whether they depend on velocity.
    """
    groups = np.array([state.KICKS if isinstance(force, ListedForce) else state.INSIDE for force in others], np.int64)
    slots, massive = bodies.table.shape[1], bodies.massive
    room = massive + 1
    width = series.BLOCK * -(-3 * room // series.BLOCK) + series.BLOCK
    return state.Hybrid(
        bodies=bodies, near=np.zeros((massive, slots), np.uint8), meets=np.zeros(slots, np.int64),
        passes=np.zeros(slots, np.uint8), reach=reach, zone=aligned((massive,)),
        counts=np.zeros(state.COUNTS, np.int64), start=aligned((6, slots)), centre=aligned(bodies.centre.shape),
        middle=aligned((6, slots)),
        group=np.zeros(massive, np.int64), path=np.zeros((state.PATH_ROWS, state.PATH_COLUMNS)),
        kept=aligned((6, slots)),
        meeting=state.Meeting(
            slots=np.zeros(room, np.int64), gm=np.zeros(room), jumps=np.zeros(room, np.uint8),
            acts=np.zeros(room, np.uint8),
            size=np.zeros(5, np.int64), x=aligned((width,)), v=aligned((width,)), a=aligned((width,)),
            work=aligned((series.ROWS * width,)),
        ),
        tables=tables(), groups=groups, present=np.array([state.KICKS in groups, state.INSIDE in groups], np.uint8),
        span=np.zeros(2), speeds=np.zeros((3, slots + 2)), latest=np.zeros((3, slots + 1)),
        used=np.zeros((0, slots), np.uint8), moving=moving, way=way, inner=inner,
    )  # fmt: skip


# --- inside a step ---


def points_inside(
    rows: Floats, order: NDArray[np.int64], central: int, before: Floats, after: Floats, begin: float, h: float
) -> list[tuple[float, Floats]]:
    """Times and states (2, 3, n) between the ends of a step, at each time of ``rows`` (see ``state``).

    The central body moves on a straight line. A body without rows follows Hermite's cubic between the ends of the step.
    A body with rows follows cubics between its points. These paths are shifted so that they begin and end at the ends
    of the step. The map shifts all bodies that meet by the same way, so the distances between them stay.
    """
    rows = rows[rows[:, 1] >= 0.0]  # no copies
    times = np.unique(rows[:, 0])
    times = times[(times > 0.0) & (times < h)]
    if not len(times):
        return []
    s = (times / h)[:, None, None]
    found = np.empty((len(times), 2, *before.shape[1:]))
    found[:, 0], found[:, 1] = _cubics(s, before, after, h)
    line = before[0, :, central] + s[:, 0] * (after[0, :, central] - before[0, :, central])
    found[:, 0, :, central] = line
    found[:, 1, :, central] = (after[0, :, central] - before[0, :, central]) / h
    for slot in np.unique(rows[:, 1].astype(np.int64)):
        own, body = rows[rows[:, 1] == slot], order[slot]
        own = own[np.argsort(own[:, 0], kind="stable")]
        first, last = before[0, :, body] - own[0, 2:5], after[0, :, body] - own[-1, 2:5]
        place = np.clip(np.searchsorted(own[:, 0], times, side="right") - 1, 0, len(own) - 2)
        left, right = own[place], own[place + 1]
        length = (right[:, 0] - left[:, 0])[:, None]
        part = (times[:, None] - left[:, :1]) / length
        start, end = (np.array([each[:, 2:5], each[:, 5:8]]) for each in (left, right))
        x, v = _cubics(part, start, end, length)
        found[:, 0, :, body] = x + first + s[:, 0] * (last - first)
        found[:, 1, :, body] = v + (last - first) / h
    return [(begin + float(time), np.ascontiguousarray(y)) for time, y in zip(times, found, strict=True)]


def _cubics(s: Floats, start: Floats, end: Floats, h: Floats | float) -> tuple[Floats, Floats]:
    """Positions and velocities at fractions s of Hermite's cubic between two states (2, ...), a time h apart."""
    x, v = state.hermite(s, start[0], h * start[1], end[0], h * end[1])
    return x, v / h

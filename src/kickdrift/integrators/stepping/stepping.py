"""Common parts of steppers: checkpoints, and compiled loops of fixed steps and samples without Python in between."""

from __future__ import annotations

from collections.abc import Callable
from time import perf_counter
from typing import TYPE_CHECKING, Any, ClassVar, Self

import numpy as np
from numpy.typing import NDArray

from kickdrift.errors import InputError
from kickdrift.forces.bound.table import EVALUATIONS, SLOTS
from kickdrift.forces.seam.kernel import OK
from kickdrift.integrators.stepping.loops import STEP
from kickdrift.integrators.stepping.stepper import Counts
from kickdrift.jit.compile import driver, strict
from kickdrift.jit.handle import address_of, status_at
from kickdrift.looks.looking import Looking
from kickdrift.model.checks.limits import NEVER
from kickdrift.model.memory import Checkpointed, Memory, by_value
from kickdrift.model.state import Floats

if TYPE_CHECKING:
    from kickdrift.forces.bound.forces import BoundForces
    from kickdrift.integrators.flows.flow import Flow
    from kickdrift.integrators.options import Options


TAKEN, WANTED, REFUSED = range(3)  # slots of ``seen``: samples so far, samples in all, whether the last failed


@strict
def clock(start, steps, dt):
    """Return the time after a number of steps, rounded as in Python."""
    return start + steps * dt


@strict
def next_look(begin, interval, end, time):
    """Return the next time of a sample, as ``Plan.next_stop`` finds it, or the end if there is none before."""
    passed = np.floor((time - begin) / interval * (1 + 1e-15))
    ahead = begin + (passed + 1) * interval
    while ahead <= time:
        passed += 1
        ahead = begin + (passed + 1) * interval
    return ahead if ahead < end - 1e-15 * abs(end) else end


@driver
def looked_loop(
    forces, aside, step_loop, look, given, first, every, cursor, start, dt, y, desk, last, rows, row, own, seen
):
    """Take ``every`` steps by ``step_loop`` and a sample by ``look`` at y with the forces ``aside``, repeatedly. Return
    a status.

    Both are addresses (``jit.handle``), so neither is compiled into this loop. ``given`` are the arguments of the
    steps besides the forces and (first, steps, cursor). ``first`` is the number of steps done before, ``row`` the first
    sample's row, ``own`` the samples' cursor.
    """
    while seen[TAKEN] < seen[WANTED]:
        done = first + seen[TAKEN] * every
        status = status_at(step_loop, (forces, *given, done, every, cursor))
        if status != OK:
            return status
        cursor[STEP] = 0
        at = clock(start, done + every, dt)
        status = status_at(look, (aside, at, y, desk, last, rows, row + seen[TAKEN], own))
        if status != OK:
            seen[REFUSED] = 1
            return status
        seen[TAKEN] += 1
    return OK


@driver
def looked_intervals(
    forces, aside, step_loop, look, given, clock, begin, interval, end, steps, cursor, y, desk, last, rows, row, own,
    taken_at, seen,
):  # fmt: skip
    """The same for steps of different lengths.

    Samples are taken at the first step point from each multiple of ``interval`` after ``begin`` on, until the next one
    is the ``end``, or ``steps`` are taken. ``taken_at`` gets the number of steps before each sample. The loop ends
    without a sample after a step beyond the end. ``given`` precedes (clock, time to reach, steps, cursor), and the
    first number of ``clock`` is the time.
    """
    while seen[TAKEN] < seen[WANTED]:
        ahead = next_look(begin, interval, end, clock[0])
        if ahead >= end:
            return OK
        status = status_at(step_loop, (forces, *given, clock, ahead, steps, cursor))
        if status != OK:
            return status
        if clock[0] < ahead or clock[0] > end:
            return OK
        status = status_at(look, (aside, clock[0], y, desk, last, rows, row + seen[TAKEN], own))
        if status != OK:
            seen[REFUSED] = 1
            return status
        taken_at[seen[TAKEN]] = cursor[STEP]
        seen[TAKEN] += 1
    return OK


@driver
def recorded_loop(forces, step_loop, given, clock, until, cursor, y, points):
    """Take steps of different lengths one by one until the time ``until``, or until all rows of ``points`` (steps, 1 +
    N) are filled. Each row gets the time and y after a step. Return a status.

    The other arguments are those of ``looked_intervals``. ``cursor`` counts the steps.
    """
    flat = y.reshape(-1)
    while cursor[STEP] < points.shape[0] and clock[0] < until:
        done = cursor[STEP]
        status = status_at(step_loop, (forces, *given, clock, until, done + 1, cursor))
        if status != OK or cursor[STEP] == done:
            return status
        points[done, 0] = clock[0]
        points[done, 1:] = flat
    return OK


CompiledSteps = tuple[Any, "BoundForces", tuple[Any, ...]]
SHORT = 0.05  # seconds of one call of compiled code, of which the next may take twice as many steps
AT_ONCE = 10_000  # steps of compiled code between checks for Ctrl-C


class Resumable(Checkpointed):
    """Stepper that stores y, its step point, its forces' pair lists, and the attributes in ``saved``."""

    y: Floats
    steps_done: int
    end: float = np.inf  # see Stepper
    clip: bool = False
    _addresses: tuple[int, int] | None = None  # addresses of the machine code of steps and samples, once known
    fresh: bool = False  # whether the flow's forces were last evaluated at ``y``, so that their pair lists are valid
    _flow: Flow

    @property
    def _lists(self) -> BoundForces | None:
        """Forces of the steps, if their pair lists matter."""
        return self._flow.forces

    def memory(self: Any) -> Memory:
        """See Stepper."""
        point = {"y": by_value(self.y), "time": by_value(self.time), "steps_done": self.steps_done}
        return {**point, **Checkpointed.memory(self), "forces": self._lists.memory() if self._lists else []}

    def recall(self: Any, memory: Memory) -> None:
        """Restore as Stepper does. The memory may come from a file, and compiled code checks no bounds, so anything
        invalid raises InputError. The caller has checked that y has the shape of these bodies."""
        y, steps = np.array(memory["y"], dtype=float), memory["steps_done"]
        if not (isinstance(steps, int) and 0 <= steps < NEVER and np.isfinite(memory["time"])):
            raise InputError("checkpoint: its step or time is invalid")
        if "cursor" in memory and not np.all(memory["cursor"] >= 0):
            raise InputError("checkpoint: cursor holds a negative number")
        self.reset(y, memory["time"], steps)
        Checkpointed.recall(self, memory)
        if self._lists:
            self._lists.recall(memory["forces"])

    def ahead(self: Any, time: float, over: Callable[[], bool] = bool) -> tuple[int, Floats, Counts]:
        """Return a status, y at a time beyond the last step point without evaluations of f beyond it, and the cost.

        The steps to that time are discarded, unless they fail. So the run itself is unchanged. ``over`` tells whether
        to give up: y is then of an earlier time.
        """
        known, before, limits = self.memory(), self.counts, (self.end, self.clip)
        self.end, self.clip = time, True
        try:
            status, count = OK, 1
            while status == OK and self.time < time and not over():
                began = perf_counter()
                status = self.advance(count, time)
                count = min(AT_ONCE, 2 * count) if perf_counter() - began < SHORT else count
        finally:
            self.end, self.clip = limits
        y, cost = self.y.copy(), self.counts - before
        if status == OK:
            self.recall(known)
        return status, y, cost


class Regular(Resumable):
    """Clock of fixed steps. It counts steps, so that times do not depend on how a run is cut."""

    dt: float
    y: Floats
    steps_done: int
    ends_fresh: bool = False  # whether it is ``fresh`` after any whole step
    steady: bool = True  # whether the next step is like all later ones
    _start: float  # the time of step 0
    _cursor: NDArray[np.int64]

    def advance(self, steps: int, until: float = np.inf) -> int:
        """See Stepper."""
        raise NotImplementedError

    @property
    def time(self) -> float:
        return self._start + self.steps_done * self.dt

    @property
    def last_step(self) -> float:
        return self.dt

    @property
    def counts(self) -> Counts:
        return Counts(int(self._cursor[EVALUATIONS]))

    def at(self, time: float) -> Floats:
        """State at the step point: no time lies between two."""
        return self.y.copy()

    def series(self, count: int, every: int, look: Callable[[], int]) -> int:
        """Take ``every`` steps and ``look``, ``count`` times, while both return OK. Return the first other status."""
        for _ in range(count):
            if (status := self.advance(every) or look()) != OK:
                return status
        return OK

    @property
    def compiled_steps(self) -> CompiledSteps | None:
        """Driver of steps that leaves ``y`` at a step point, its forces, and its arguments between these and (first,
        steps, cursor). While ``steady``; None if that needs Python."""
        return None

    def looked(
        self, count: int, every: int, looking: Looking, last: Floats, rows: Floats, row: int
    ) -> tuple[int, int, bool]:
        """Like ``series``, with samples by compiled code, from that row of ``rows`` on. Return a status, the
        number of good samples, and whether a sample failed."""
        assert self.compiled_steps is not None
        (loop, forces, given), cursor = self.compiled_steps, self._cursor
        seen, places = np.array([0, count, 0]), (looking.desk, last, rows, row, looking.cursor)
        if self._addresses is None:
            steps_at = address_of(loop, forces.table, *given, self.steps_done, every, cursor)
            self._addresses = steps_at, looking.address(self.time, self.y, *places)
        status = forces.call(
            with_lists(looked_loop, looking, forces), *self._addresses, given, self.steps_done, every, cursor,
            self._start, self.dt, self.y, *places, seen,
        )  # fmt: skip
        taken, refused = int(seen[TAKEN]), bool(seen[REFUSED])
        self.steps_done += (taken + refused) * every + int(cursor[STEP])
        cursor[STEP] = 0
        return status, taken, refused


def with_lists(loop: Any, looking: Looking, forces: BoundForces) -> Callable[..., int]:
    """Compiled loop of samples in the form for ``BoundForces.call``. If samples use the run's own forces, their lists
    may have grown meanwhile."""
    if looking.forces is forces:
        return lambda bound, *args: int(loop(bound, bound, *args))
    return lambda bound, *args: int(loop(bound, looking.forces.table, *args))


class Retimed:
    """Stepper of fixed steps whose length can change, because nothing else is made for that length."""

    dt: float

    def retimed(self, dt: float) -> Self:
        """This stepper with steps of another length. Call ``reset`` before the next step."""
        self.dt = dt
        return self


class FixedStepper(Retimed, Regular):
    """Fixed steps by a compiled loop (see ``loops``) with a workspace of ``room`` arrays of y's ``shape``.

    With ``kept``, the workspace is carried from step to step, and a checkpoint holds it. A checkpoint always holds the
    carries of compensated sums.
    """

    trouble = ""
    saved: ClassVar[tuple[str, ...]] = ("_start", "_cursor", "_carry", "_carried")

    def __init__(
        self, flow: Flow, loop: Any, stages: Any, room: Callable[..., Floats], options: Options, kept: bool
    ) -> None:
        assert options.dt is not None
        self._flow, self._loop, self._stages, self.dt, self._kept = flow, loop, stages, options.dt, kept
        self._room, self._compensated = room, options.compensated
        self._cursor = np.zeros(SLOTS, np.int64)

    def reset(self, y: Floats, time: float, steps: int) -> None:
        self.y = y
        self.steps_done = steps
        self._start = time - steps * self.dt
        self._work = self._room(y.shape)
        self._carry = np.zeros(y.shape if self._compensated else (*y.shape[:2], 0))
        self._cursor[STEP:] = 0
        self._flow.forces.forget()

    def advance(self, steps: int, until: float = np.inf) -> int:
        status = self._flow.forces.call(
            self._loop, self.y, self._carry, self._work, self._stages, self.dt, self._start, self.steps_done, steps,
            self._cursor,
        )  # fmt: skip
        self.steps_done += int(self._cursor[STEP])
        self._cursor[STEP] = 0
        return status

    @property
    def compiled_steps(self) -> CompiledSteps:
        given = (self.y, self._carry, self._work, self._stages, self.dt, self._start)
        return self._loop, self._flow.forces, given

    @property
    def _carried(self) -> Floats:
        return self._work if self._kept else self._work[:0]

    def reached(self, inside_step: bool) -> tuple[Floats, Floats]:
        if inside_step and self._work.ndim > self.y.ndim:
            return self._work[0], self.y[0]  # y waits for the last stage
        return self.y, self.y[0] - self.dt * self.y[-1]

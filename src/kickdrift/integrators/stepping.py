"""Steppers: integrations in progress, with the same methods for every integrator.

A stepper has ``y`` and ``time``, its last step point; ``last_step``, the length of the step to this point (0 before an
adaptive method's first); ``steps_done``, the step points passed since the start; and ``counts``. ``advance`` takes
steps. ``at`` returns y between the last two step points without changing anything. ``memory`` holds the state that
determines the next step's bits. ``recall`` puts a new stepper, for example in another process, into that state.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, ClassVar, Protocol

import numpy as np
from numpy.typing import NDArray

from kickdrift.errors import InputError
from kickdrift.forces.evaluate import EVALUATIONS, SLOTS
from kickdrift.forces.kernel import OK
from kickdrift.integrators.looked_loop import REFUSED as LOOK_REFUSED
from kickdrift.integrators.looked_loop import TAKEN, looked_intervals, looked_loop
from kickdrift.integrators.loops import REJECTED, STEP
from kickdrift.jit.by_address import address_of
from kickdrift.looks.looking import Looking
from kickdrift.model.limits import NEVER
from kickdrift.model.memory import Memory, Remembering, by_value
from kickdrift.model.state import Floats

if TYPE_CHECKING:
    from kickdrift.forces.bound import BoundForces
    from kickdrift.integrators.flow import Flow
    from kickdrift.integrators.options import Options

# First slots of the clock of a loop that chooses its steps: the last step point, the step to try, the last step, its
# starting time.
TIME, NEXT, LAST, BEFORE = range(4)
STOPPED = 3  # besides the forces' OK, GROW and BLOWN_UP: the method itself cannot continue, for the reason ``trouble``


@dataclass
class Counts:
    """Cost of an integration so far."""

    evaluations: int = 0
    rejected: int = 0
    jacobians: int = 0

    def __sub__(self, before: Counts) -> Counts:
        rejected, jacobians = self.rejected - before.rejected, self.jacobians - before.jacobians
        return Counts(self.evaluations - before.evaluations, rejected, jacobians)


class LookTimes(Protocol):
    """Times of samples: every ``interval`` from ``begin_time`` to ``end_time``."""

    @property
    def begin_time(self) -> float: ...

    @property
    def interval(self) -> float: ...

    @property
    def end_time(self) -> float: ...


class Stepper(Protocol):
    """Integration in progress.

    Steppers with steps of different lengths also have ``end``: they evaluate f at no later time. ``advance`` then stops
    before the first step beyond the end. With ``clip`` that step is cut off at ``end`` instead.
    """

    y: Floats
    steps_done: int
    trouble: str

    @property
    def time(self) -> float:
        """Time of the last step point."""

    @property
    def last_step(self) -> float:
        """Length of the step to the last step point; 0 if there was none."""

    @property
    def counts(self) -> Counts:
        """Cost since the stepper was made."""

    def reset(self, y: Floats, time: float, steps: int) -> None:
        """Start anew at y."""

    def advance(self, steps: int, until: float) -> int:
        """Take this many steps, or fewer if a step point reaches ``until``. Return a status."""

    def at(self, time: float) -> Floats:
        """Copy of y at a time between the last two step points."""

    def reached(self, inside_step: bool) -> tuple[Floats, Floats]:
        """After a blow-up inside a step or in the last one: the y reached, and the positions before."""

    def memory(self) -> Memory:
        """Copies of the state, at the last step point, that determines the next step's bits."""

    def recall(self, memory: Memory) -> None:
        """Restore the state of a stepper of the same method, options and bodies from its memory."""


CompiledSteps = tuple[Any, "BoundForces", tuple[Any, ...]]
AT_ONCE = 10_000  # steps of compiled code between checks for Ctrl-C


class Resumable(Remembering):
    """Stepper that stores y, its step point, its forces' pair lists, and the attributes in ``keeps``."""

    y: Floats
    steps_done: int
    end: float = np.inf  # see Stepper
    clip: bool = False
    _addresses: tuple[int, int] | None = None  # of the machine code of steps and samples, once known
    fresh: bool = False  # whether the flow's forces were last evaluated at ``y``, so that their pair lists are valid
    _flow: Flow

    @property
    def _lists(self) -> BoundForces | None:
        """Forces of the steps, if their pair lists matter."""
        return self._flow.forces

    def memory(self: Any) -> Memory:
        """See Stepper."""
        point = {"y": by_value(self.y), "time": by_value(self.time), "steps_done": self.steps_done}
        return {**point, **Remembering.memory(self), "forces": self._lists.memory() if self._lists else []}

    def recall(self: Any, memory: Memory) -> None:
        """Restore as Stepper does. The memory may come from a file, and compiled code checks no bounds, so anything
        invalid raises InputError. The caller has checked that y has the shape of these bodies."""
        y, steps = np.array(memory["y"], dtype=float), memory["steps_done"]
        if not (isinstance(steps, int) and 0 <= steps < NEVER and np.isfinite(memory["time"])):
            raise InputError("checkpoint: its step or time is invalid")
        if "cursor" in memory and not np.all(memory["cursor"] >= 0):
            raise InputError("checkpoint: cursor holds a negative number")
        self.reset(y, memory["time"], steps)
        Remembering.recall(self, memory)
        if self._lists:
            self._lists.recall(memory["forces"])

    def ahead(self: Any, time: float) -> tuple[int, Floats, Counts]:
        """Return a status, y at a time beyond the last step point without evaluations of f beyond it, and the cost.

        The steps to that time are discarded, unless they fail. So the run itself is unchanged.
        """
        known, before, limits = self.memory(), self.counts, (self.end, self.clip)
        self.end, self.clip = time, True
        try:
            status = OK
            while status == OK and self.time < time:
                status = self.advance(AT_ONCE, time)
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
            _with_lists(looked_loop, looking, forces), *self._addresses, given, self.steps_done, every, cursor,
            self._start, self.dt, self.y, *places, seen,
        )  # fmt: skip
        taken, refused = int(seen[TAKEN]), bool(seen[LOOK_REFUSED])
        self.steps_done += (taken + refused) * every + int(cursor[STEP])
        cursor[STEP] = 0
        return status, taken, refused


def _with_lists(loop: Any, looking: Looking, forces: BoundForces) -> Callable[..., int]:
    """Compiled loop of samples in the form for ``BoundForces.call``. If samples use the run's own forces, their lists
    may have grown meanwhile."""
    if looking.forces is forces:
        return lambda bound, *args: int(loop(bound, bound, *args))
    return lambda bound, *args: int(loop(bound, looking.forces.table, *args))


class FixedStepper(Regular):
    """Fixed steps by a compiled loop (see ``loops``) with a workspace of ``room`` arrays of y's ``shape``.

    With ``kept``, the workspace is carried from step to step, and a checkpoint holds it. A checkpoint always holds the
    carries of compensated sums.
    """

    trouble = ""
    keeps = ("_start", "_cursor", "_carry", "_carried")

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


class ChosenSteps(Resumable):
    """Steps that a compiled loop chooses by their error. Keeps the clock."""

    keeps: ClassVar[tuple[str, ...]] = ("_cursor", "_clock", "_extra_evaluations")

    def __init__(self, flow: Flow, options: Options) -> None:
        self._flow, self._first, self._longest = flow, options.dt, options.longest
        self._cursor = np.zeros(SLOTS, np.int64)
        self._clock = np.zeros(7)
        self._extra_evaluations = 0
        self.trouble = ""

    def _begin(self, y: Floats, time: float, steps: int) -> None:
        self.y, self.steps_done = y, steps
        self._clock[:] = 0.0
        self._clock[[TIME, BEFORE]] = time
        self._cursor[STEP:REJECTED] = 0
        self._flow.forces.forget()

    @property
    def time(self) -> float:
        return float(self._clock[TIME])

    @property
    def last_step(self) -> float:
        """Length of the last step; 0 before the first."""
        return float(self._clock[LAST])

    @property
    def counts(self) -> Counts:
        return Counts(int(self._cursor[EVALUATIONS]) + self._extra_evaluations, int(self._cursor[REJECTED]))

    @property
    def steady(self) -> bool:
        """Tell whether the next step is like all later ones: its length is known."""
        return self._clock[NEXT] != 0.0

    @property
    def compiled_steps(self) -> CompiledSteps | None:
        """Driver as for ``Regular``, but its last arguments are (clock, time to reach, steps, cursor)."""
        return None

    def looked(
        self, plan: LookTimes, steps: int, looking: Looking, last: Floats, rows: Floats, row: int
    ) -> tuple[int, NDArray[np.int64], bool]:
        """Take steps and the plan's samples, until that many steps are taken or Python is needed. Return a status, the
        step of each good sample, and whether a sample failed."""
        assert self.compiled_steps is not None
        (loop, forces, given), cursor, clock = self.compiled_steps, self._cursor, self._clock
        seen, taken_at = np.array([0, len(rows) - row, 0]), np.zeros(len(rows) - row, np.int64)
        places = (looking.desk, last, rows, row, looking.cursor)
        if self._addresses is None:
            steps_at = address_of(loop, forces.table, *given, clock, self.time, steps, cursor)
            self._addresses = steps_at, looking.address(self.time, self.y, *places)
        status = forces.call(
            _with_lists(looked_intervals, looking, forces), *self._addresses, given, clock,
            plan.begin_time, plan.interval, plan.end_time, steps, cursor, self.y, *places, taken_at, seen,
        )  # fmt: skip
        found = self.steps_done + taken_at[: seen[TAKEN]]
        self.steps_done += int(cursor[STEP])
        cursor[STEP] = 0
        return self._judged(status), found, bool(seen[LOOK_REFUSED])

    def _first_step(self) -> float | None:
        """Length of the first step; None if finding it would take f beyond the end."""
        raise NotImplementedError

    def _go(self, until: float, steps: int) -> int:
        """Run the loop. Return a status."""
        raise NotImplementedError

    def advance(self, steps: int, until: float = np.inf) -> int:
        if self._clock[NEXT] == 0.0 and steps:
            first = self._first or self._first_step()
            if first is None:
                return OK
            self._clock[NEXT] = first
        status = self._go(until, steps)
        self.steps_done += int(self._cursor[STEP])
        self._cursor[STEP] = 0
        return self._judged(status)

    def _judged(self, status: int) -> int:
        """Return the status. If it is STOPPED, set ``trouble``."""
        if status == STOPPED:
            self.trouble = f"the step fell to {self._clock[NEXT]:.3g}, too short to change t = {self.time:.9g}"
        return status

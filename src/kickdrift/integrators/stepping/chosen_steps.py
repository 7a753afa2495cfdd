"""Steps that a compiled loop chooses by their error."""

from __future__ import annotations

from typing import TYPE_CHECKING, ClassVar, Protocol

import numpy as np
from numpy.typing import NDArray

from kickdrift.forces.bound.table import EVALUATIONS, SLOTS
from kickdrift.forces.seam.kernel import OK
from kickdrift.integrators.stepping.loops import REJECTED, STEP
from kickdrift.integrators.stepping.stepper import STOPPED, Counts
from kickdrift.integrators.stepping.stepping import REFUSED as LOOK_REFUSED
from kickdrift.integrators.stepping.stepping import (
    TAKEN,
    CompiledSteps,
    Resumable,
    looked_intervals,
    recorded_loop,
    with_lists,
)
from kickdrift.jit.handle import address_of
from kickdrift.looks.looking import Looking
from kickdrift.model.state import Floats

if TYPE_CHECKING:
    from kickdrift.integrators.flows.flow import Flow
    from kickdrift.integrators.options import Options

# First slots of the clock of a loop that chooses its steps: the last step point, the step to try, the last step, its
# starting time.
TIME, NEXT, LAST, BEFORE = range(4)


class LookTimes(Protocol):
    """Times of samples: every ``interval`` from ``begin_time`` to ``end_time``."""

    @property
    def begin_time(self) -> float: ...

    @property
    def interval(self) -> float: ...

    @property
    def end_time(self) -> float: ...


class ChosenSteps(Resumable):
    """Integration whose compiled loop chooses steps by their error. Stores the clock."""

    saved: ClassVar[tuple[str, ...]] = ("_cursor", "_clock", "_extra_evaluations")
    _record_address: int | None = None  # of the machine code of steps, once known

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

    @property
    def recordable_steps(self) -> CompiledSteps | None:
        """The same for ``recorded``."""
        return self.compiled_steps

    def recorded(self, points: Floats) -> int:
        """Take a step for each row of ``points`` (steps, 1 + N), or fewer to the ``end``. A row gets time and y after a
        step. Return a status; ``steps_done`` counts the rows. The stepper is ``steady``."""
        assert self.recordable_steps is not None
        (loop, forces, given), clock, cursor = self.recordable_steps, self._clock, self._cursor
        if self._record_address is None:
            self._record_address = address_of(loop, forces.table, *given, clock, self.end, 1, cursor)
        places = (given, clock, self.end, cursor, self.y, points)
        status = forces.call(recorded_loop, self._record_address, *places)
        self.steps_done += int(cursor[STEP])
        cursor[STEP] = 0
        return self._judged(status)

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
            with_lists(looked_intervals, looking, forces), *self._addresses, given, clock,
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

"""Looks at a Simulation while it runs: rows of its record, the state to go back to, warnings about its steps."""

from __future__ import annotations

from collections import deque
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from kickdrift.errors import RunError
from kickdrift.forces.kernel import OK
from kickdrift.integrators.flow import ParticleFlow
from kickdrift.integrators.stability_limit import (
    WATCHED_POINTS,
    WATCHED_STEPS,
    Point,
    can_be_limited,
    stability_warning,
)
from kickdrift.integrators.step_length import TOO_LONG, can_be_checked, step_warning
from kickdrift.integrators.stepping import ChosenSteps, Regular
from kickdrift.looks.columns import COLUMNS, TIME
from kickdrift.looks.looking import Looking
from kickdrift.looks.observers import NOTHING
from kickdrift.model.state import Floats
from kickdrift.run.plan import Plan

if TYPE_CHECKING:
    from kickdrift.run.simulation import Simulation


MOST = 4096  # looks in a row, at most


class Lookout:
    """Looks at a Simulation.

    Attributes
    ----------
    y, time, step : the last state that was looked at, which a run that blows up goes back to; y is a buffer of its own
    """

    y: Floats
    time: float
    step: int

    def __init__(self, sim: Simulation, foreign: bool) -> None:
        self._sim = sim
        self._limited = can_be_limited(sim._flow, sim.method)
        self._checked = can_be_checked(sim._flow, sim.method) and not foreign
        self._points: deque[Point] = deque(maxlen=WATCHED_POINTS)
        self._check_at = 0

    def begin(self, check_at: int) -> None:
        """The present is another one, and good. ``check_at`` is how many steps the record is to have when the step is
        checked next."""
        self._check_at = check_at
        self._points.clear()
        self.keep()

    def keep(self) -> None:
        """The present is good."""
        sim = self._sim
        self.y, self.time, self.step = sim._now().copy(), sim.time, sim.steps_done

    def begin_anew(self) -> None:
        """The bodies may be others, and what was seen of them is behind."""
        self._points.clear()
        self.keep()

    # --- looks ---

    def look(self, again: bool = True) -> bool:
        """Keep all that is seen now; not ``again`` where the last look was at the present. False where forces or energy
        are no numbers."""
        sim = self._sim
        record, flow, y = sim.record, sim._flow, sim._now()
        looks, step, time = record.looks, sim.steps_done, sim.time
        if not again and looks.at(step, time):
            if record.taken is not NOTHING:
                looks.retake(record.taken)
            self.y[...] = y
            new = False
        else:
            fresh = sim._at is None and getattr(sim._stepper, "fresh", False)
            try:
                if flow.look(looks, y, time, step, self.y, fresh) != OK:
                    return False
            except RunError:  # another program has ended
                return False
            new = True
        if not record.begun:
            flow.begin(record, y)
        self.time, self.step = time, step
        if self._limited:
            self._points.append((time, self.y.copy(), sim._stepper.last_step))
        if new:
            looks.keep(step, record.taken)
        return True

    def alone(self, plan: Plan, chunk: int) -> int:
        """How many looks may follow each other with none but this one looking, in about ``chunk`` steps; 0 where that
        does not pay, or cannot be."""
        sim = self._sim
        stepper: Any = sim._stepper
        if sim._at is not None or sim.record.taken is not NOTHING or not getattr(stepper, "steady", False):
            return 0
        if isinstance(stepper, Regular) and plan.every:
            done = stepper.steps_done
            found = 0 if done % plan.every else min(chunk // plan.every, (plan.end_step - done) // plan.every, MOST)
            return found if found > 1 else 0
        if not plan.interval or plan.exact or self._limited or self._looking() is None:
            return 0
        return 0 if sim.time + plan.interval >= plan.end_time else MOST

    def _looking(self) -> Looking | None:
        """What looks that compiled code takes between steps are taken with, where it can."""
        flow, stepper = self._sim._flow, self._sim._stepper
        if isinstance(stepper, Regular):
            return flow.looking(stepper.ends_fresh) if stepper.compiled_steps else None
        if isinstance(stepper, ChosenSteps) and not flow.clocked:
            return flow.looking(False) if stepper.compiled_steps else None
        return None

    def prepare(self, plan: Plan) -> None:
        """Compile what a series of looks needs."""
        looking, stepper, rows = self._looking(), self._sim._stepper, np.zeros((1, COLUMNS))
        if looking and isinstance(stepper, Regular) and plan.every:
            stepper.looked(0, 1, looking, self.y, rows, 0)
        elif looking and isinstance(stepper, ChosenSteps) and plan.interval:
            stepper.looked(plan, 0, looking, self.y, rows, 1)

    def series(self, plan: Plan, count: int, chunk: int) -> tuple[int, bool]:
        """Go on through ``count`` looks, or with steps that differ in length through about ``chunk`` steps, until
        something goes wrong: a status, and whether a look found it."""
        looking, stepper = self._looking(), self._sim._stepper
        if isinstance(stepper, ChosenSteps):
            assert looking
            looks = self._sim.record.looks
            row = looks.free(count)
            status, steps, refused = stepper.looked(plan, chunk, looking, self.y, looks.rows[: row + count], row)
            self._seen(row, steps)
            return status, refused
        assert isinstance(stepper, Regular)
        shown = (WATCHED_POINTS if self._limited else 0) if looking else count  # one by one, at the end
        if looking and count > shown:
            status, refused = self._compiled(looking, stepper, count - shown, plan.every)
            if status != OK:
                return status, refused
        return self._one_by_one(stepper, min(count, shown), plan.every)

    def _compiled(self, looking: Looking, stepper: Regular, count: int, every: int) -> tuple[int, bool]:
        looks, first = self._sim.record.looks, stepper.steps_done
        row = looks.free(count)
        status, taken, refused = stepper.looked(count, every, looking, self.y, looks.rows, row)
        self._seen(row, first + every * np.arange(1, taken + 1))
        return status, refused

    def _seen(self, row: int, steps: NDArray[np.int64]) -> None:
        """Count the rows that compiled code has filled, from that one on."""
        if len(steps):
            looks = self._sim.record.looks
            self.step, self.time = int(steps[-1]), float(looks.rows[row + len(steps) - 1, TIME])
            looks.keep_next(steps)

    def _one_by_one(self, stepper: Regular, count: int, every: int) -> tuple[int, bool]:
        flow, looks, refused = self._sim._flow, self._sim.record.looks, False

        def look() -> int:
            nonlocal refused
            step, time = stepper.steps_done, stepper.time
            if (status := flow.look(looks, stepper.y, time, step, self.y, stepper.fresh)) != OK:
                refused = True
                return status
            self.time, self.step = time, step
            if self._limited:
                self._points.append((time, self.y.copy(), stepper.last_step))
            looks.keep_next([step])
            return OK

        status = stepper.series(count, every, look)
        return status, refused

    # --- warnings ---

    def check_step(self) -> None:
        """Say where dt is beyond the limit of stability: at the start, then after twice the steps, and again."""
        sim = self._sim
        record = sim.record
        if not self._checked or record.steps < self._check_at:
            return
        self._check_at = max(1, 2 * record.steps)
        assert isinstance(sim._flow, ParticleFlow)
        assert sim.dt is not None
        warning = step_warning(sim._flow, sim.method, sim.dt, sim.time, sim._now())
        if warning and not any(TOO_LONG in line for line in record.warnings):
            record.warnings.append(warning)

    def warn(self) -> None:
        """Say what the method has to say, and where stability and not accuracy sets the steps."""
        sim = self._sim
        record = sim.record
        self.check_step()
        record.warnings += [line for line in getattr(sim._stepper, "warnings", ()) if line not in record.warnings]
        if not self._limited or record.steps < WATCHED_STEPS:
            return
        warning = stability_warning(sim._flow, sim.method, list(self._points))
        if warning and warning not in record.warnings:
            record.warnings = [*(w for w in record.warnings if TOO_LONG in w), warning]

"""Looks at a Simulation while it runs: rows of its record, the state to go back to, warnings about its steps."""

from __future__ import annotations

from collections import deque
from typing import TYPE_CHECKING, Any

import numpy as np

from kickdrift.analysis.step_length import TOO_LONG, can_be_checked, step_warning
from kickdrift.analysis.stiffness import WATCHED_POINTS, WATCHED_STEPS, Point, can_be_limited, stability_warning
from kickdrift.errors import RunError
from kickdrift.flow import ParticleFlow
from kickdrift.forces.kernel import OK
from kickdrift.forces.look_columns import COLUMNS, TIME
from kickdrift.forces.looking import Looking
from kickdrift.observers import NOTHING
from kickdrift.run_plan import Plan
from kickdrift.state import Floats

if TYPE_CHECKING:
    from kickdrift.simulation import Simulation


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

    def ahead(self, plan: Plan, chunk: int) -> int:
        """How many looks may follow each other with none but this one looking, in about ``chunk`` steps; 0 where that
        does not pay, or cannot be."""
        sim = self._sim
        every, done = plan.every, sim._stepper.steps_done
        if not every or sim._at is not None or done % every or sim.record.taken is not NOTHING:
            return 0
        if not hasattr(sim._stepper, "series"):
            return 0
        found = min(chunk // every, (plan.end_step - done) // every, MOST)
        return found if found > 1 else 0

    def _looking(self) -> Looking | None:
        """What looks that compiled code takes between steps are taken with, where it can."""
        stepper: Any = self._sim._stepper
        if not hasattr(stepper, "series") or stepper.compiled_steps is None:
            return None
        return self._sim._flow.looking(stepper.ends_fresh)

    def prepare(self) -> None:
        """Compile what a series of looks needs."""
        looking, stepper = self._looking(), self._sim._stepper
        if looking:
            stepper.looked(0, 1, looking, self.y, np.zeros((1, COLUMNS)), 0)  # type: ignore[union-attr]

    def series(self, count: int, every: int) -> tuple[int, bool]:
        """``count`` times take ``every`` steps and look, until something goes wrong: a status, and whether a look found
        it."""
        stepper: Any = self._sim._stepper
        looking = self._looking() if stepper.steady else None
        shown = (WATCHED_POINTS if self._limited else 0) if looking else count  # one by one, at the end
        if looking and count > shown:
            status, refused = self._compiled(looking, count - shown, every)
            if status != OK:
                return status, refused
        return self._one_by_one(min(count, shown), every)

    def _compiled(self, looking: Looking, count: int, every: int) -> tuple[int, bool]:
        stepper: Any = self._sim._stepper
        looks, first = self._sim.record.looks, stepper.steps_done
        row = looks.free(count)
        status, taken, refused = stepper.looked(count, every, looking, self.y, looks.rows, row)
        if taken:
            self.step = first + taken * every
            self.time = float(looks.rows[row + taken - 1, TIME])
            looks.keep_next(range(first + every, self.step + 1, every))
        return status, refused

    def _one_by_one(self, count: int, every: int) -> tuple[int, bool]:
        stepper: Any = self._sim._stepper
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

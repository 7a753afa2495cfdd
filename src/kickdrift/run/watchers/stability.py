"""Check whether steps are too long for stability or shorter than accuracy needs, and whether speeds are too high."""

from __future__ import annotations

import math
from collections import deque
from typing import TYPE_CHECKING, Any

from kickdrift.engines.session import EngineFlow
from kickdrift.integrators.flows.particle_flow import ParticleFlow
from kickdrift.integrators.step_choice import step_length
from kickdrift.looks.doubts import LIGHT, light_doubt, slowest_light
from kickdrift.model.checks.limits import MOST_STEPS
from kickdrift.model.state import Floats
from kickdrift.run.watcher import Watcher

if TYPE_CHECKING:
    pass


class Stability(Watcher):
    """Warns if dt exceeds the limit of stability, if stability rather than accuracy sets the steps, or if a body is as
    fast as light under a force that holds for slow ones.

    Attributes
    ----------
    limited : bool
        Whether stability can set the steps of this method and flow. If so, every look is stored.
    shown : int
        How many looks at the end of a series this must see.
    """

    def __init__(self, run: Any) -> None:
        self._run = run
        flow = None if isinstance(run.flow, EngineFlow) else run.flow  # another program has limits of its own
        self.limited = flow is not None and step_length.can_be_limited(flow, run.method)
        self._checked = flow is not None and step_length.can_be_checked(flow, run.method)
        self._points: deque[step_length.Point] = deque(maxlen=step_length.WATCHED_POINTS)
        self._changes = run.changes
        self._check_at, self._first = 0, False
        self._lights = slowest_light(run.system) < math.inf
        self.shown = MOST_STEPS if self._lights else step_length.WATCHED_POINTS if self.limited else 0

    @property
    def watches(self) -> bool:
        """Whether this must see looks."""
        return self.limited or self._lights

    def begin_anew(self, check_at: int) -> None:
        """Start again from another state; check dt next when the record has ``check_at`` steps."""
        self._check_at = check_at
        self._points.clear()

    def begin(self) -> None:
        """Note that the next look is the run's first."""
        self._first = True

    def look(self) -> None:
        """Store the current point, and check dt at a run's first look."""
        if self._lights or (self.limited and not self._run.record.backward):
            self.keep(self._run.time, self._run.y)
        if self._first:
            self._first = False
            self._check_step()

    def keep(self, time: float, y: Floats) -> None:
        """Check the speeds of a point, and store it; drop the points from before an event changed the bodies."""
        if self._lights:
            self._check_speeds(y)
        if not self.limited or self._run.record.backward:
            return
        if self._changes != self._run.changes:
            self._changes = self._run.changes
            self._points.clear()
        self._points.append((time, y.copy(), self._run.stepper.last_step))

    def end(self) -> None:
        """Add the method's warnings, and a warning if stability rather than accuracy sets the steps."""
        run = self._run
        record = run.record
        self._check_step()
        record.warnings += [line for line in getattr(run.stepper, "warnings", ()) if line not in record.warnings]
        if not self.limited or record.backward or record.steps < step_length.WATCHED_STEPS:
            return
        assert not isinstance(run.flow, EngineFlow)
        warning = step_length.stability_warning(run.flow, run.method, list(self._points))
        if warning and warning not in record.warnings:
            record.warnings = [*(w for w in record.warnings if not w.startswith(step_length.LIMITED)), warning]

    def _check_speeds(self, y: Floats) -> None:
        """Warn once if a body is as fast as light."""
        line, warnings = light_doubt(self._run.system, y[1]), self._run.record.warnings
        if line and not any(LIGHT in each for each in warnings):
            warnings.append(line)

    def _check_step(self) -> None:
        """Warn if dt exceeds the limit of stability; check at the start and whenever the steps have doubled."""
        run = self._run
        record = run.record
        if not self._checked or record.steps < self._check_at:
            return
        self._check_at = max(1, 2 * record.steps)
        assert isinstance(run.flow, ParticleFlow)
        assert run.dt is not None
        warning = step_length.step_warning(run.flow, run.method, run.dt, run.time, run.y)
        if warning and not any(step_length.TOO_LONG in line for line in record.warnings):
            record.warnings.append(warning)

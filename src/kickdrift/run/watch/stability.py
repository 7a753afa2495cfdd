"""Whether a run's steps are too long for its motion, or shorter than its accuracy needs."""

from __future__ import annotations

from collections import deque
from typing import TYPE_CHECKING, Protocol

from kickdrift.integrators.flow import Flow, ParticleFlow
from kickdrift.integrators.method import Method
from kickdrift.integrators.stability_limit import (
    WATCHED_POINTS,
    WATCHED_STEPS,
    Point,
    can_be_limited,
    stability_warning,
)
from kickdrift.integrators.step_length import TOO_LONG, can_be_checked, step_warning
from kickdrift.integrators.stepping import Stepper
from kickdrift.looks.record import Record
from kickdrift.model.state import Floats
from kickdrift.run.watch.watcher import Watcher

if TYPE_CHECKING:
    from kickdrift.run.watch.watched_stepper import WatchedStepper


class Stepping(Protocol):
    """What is known of the integration; see `run.advance.Integration`."""

    method: Method
    flow: Flow
    dt: float | None
    record: Record
    changes: int

    @property
    def stepper(self) -> Stepper | WatchedStepper: ...

    @property
    def y(self) -> Floats: ...

    @property
    def time(self) -> float: ...


class Stability(Watcher):
    """Warns where dt is beyond the limit of stability, and where stability and not accuracy sets the steps.

    Attributes
    ----------
    limited : bool
        Whether stability can set the steps of this method and flow; then every look is kept.
    """

    def __init__(self, run: Stepping, foreign: bool) -> None:
        self._run = run
        self.limited = can_be_limited(run.flow, run.method)
        self._checked = can_be_checked(run.flow, run.method) and not foreign
        self._points: deque[Point] = deque(maxlen=WATCHED_POINTS)
        self._changes = run.changes
        self._check_at, self._first = 0, False

    def begin_anew(self, check_at: int) -> None:
        """The present is another one. ``check_at`` is how many steps the record is to have when the step is checked
        next."""
        self._check_at = check_at
        self._points.clear()

    def begin(self) -> None:
        """See Watcher."""
        self._first = True

    def look(self) -> None:
        """Keep the present, and check the step at a run's first look."""
        if self.limited:
            self.keep(self._run.time, self._run.y)
        if self._first:
            self._first = False
            self._check_step()

    def keep(self, time: float, y: Floats) -> None:
        """Keep a point that was looked at; those from before an event changed the bodies are dropped."""
        if self._changes != self._run.changes:
            self._changes = self._run.changes
            self._points.clear()
        self._points.append((time, y.copy(), self._run.stepper.last_step))

    def end(self) -> None:
        """Say what the method has to say, and where stability and not accuracy sets the steps."""
        run = self._run
        record = run.record
        self._check_step()
        record.warnings += [line for line in getattr(run.stepper, "warnings", ()) if line not in record.warnings]
        if not self.limited or record.steps < WATCHED_STEPS:
            return
        warning = stability_warning(run.flow, run.method, list(self._points))
        if warning and warning not in record.warnings:
            record.warnings = [*(w for w in record.warnings if TOO_LONG in w), warning]

    def _check_step(self) -> None:
        """Say where dt is beyond the limit of stability: at the start, then after twice the steps, and again."""
        run = self._run
        record = run.record
        if not self._checked or record.steps < self._check_at:
            return
        self._check_at = max(1, 2 * record.steps)
        assert isinstance(run.flow, ParticleFlow)
        assert run.dt is not None
        warning = step_warning(run.flow, run.method, run.dt, run.time, run.y)
        if warning and not any(TOO_LONG in line for line in record.warnings):
            record.warnings.append(warning)

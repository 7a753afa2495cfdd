"""Error of a run that blew up, or whose method stopped, and the way back to the last good state."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Protocol

from kickdrift.engines.session import RunFlow
from kickdrift.errors import RunError
from kickdrift.integrators.method import Method
from kickdrift.integrators.stepping.stepper import Stepper
from kickdrift.looks.record import Record
from kickdrift.model.box.box import Box
from kickdrift.model.checks.values import unwarned
from kickdrift.model.state import Floats, State

if TYPE_CHECKING:
    from kickdrift.run.watch.watched_stepper import WatchedStepper


@dataclass
class Safe:
    """The last state known to be good. A run that blows up goes back to this state."""

    y: Floats  # its own buffer
    time: float
    step: int
    box: Box | None = None  # of a run with a barostat


class Failing(Protocol):
    """Attributes of a failed integration; see `run.advance.Integration`."""

    method: Method
    flow: RunFlow
    stepper: Stepper | WatchedStepper
    dt: float | None
    record: Record
    at: float | None
    replaced: bool

    @property
    def backward(self) -> bool: ...

    @property
    def moving(self) -> RunFlow: ...

    @property
    def integrator(self) -> str: ...

    @property
    def safe(self) -> Safe: ...


def go_back(run: Failing) -> None:
    """Put a run back to its last good state, and forget the events after this state."""
    safe = run.safe
    run.record.events = [event for event in run.record.events if event["time"] <= safe.time]
    if safe.box is not None:
        run.flow.box = safe.box  # type: ignore[union-attr]
    run.stepper.reset(safe.y.copy(), safe.time, safe.step)
    run.at, run.replaced = None, True


@unwarned
def failure(run: Failing, inside_step: bool, stopped: bool) -> tuple[BaseException, BaseException | None]:
    """Return the error to raise and its cause.

    With ``inside_step``, the current step failed; otherwise the last completed step did. ``stopped`` means that the
    method itself cannot continue. The error's ``state`` is the last good state. An exception that Ctrl-C or `sys.exit`
    raised inside a Python function is returned unchanged."""
    stepper, flow, safe = run.stepper, run.moving, run.safe
    step = stepper.steps_done + inside_step
    dt = 0.0 if run.method.chooses_steps else (run.dt or 0.0)
    time = stepper.time + (-dt if run.backward else dt) * inside_step
    with_step = "" if run.method.chooses_steps else f", dt = {run.dt:g}"
    last = run.flow.state(safe.y, safe.time, safe.step)
    if safe.box is not None and isinstance(last, State):
        last = replace(last, box=safe.box)
    if stopped:
        message = f"stopped at step {step} (t = {stepper.time:.6g}): {stepper.trouble}{flow.meeting(stepper.y)}"
    else:
        reached, before = stepper.reached(inside_step)
        message = flow.explain(reached, before, safe.y, step, time, last.steps_done)
    raised = flow.raised
    if raised is not None and not isinstance(raised, Exception):
        return raised, raised.__cause__  # KeyboardInterrupt, SystemExit
    error = RunError(f"{run.integrator}{with_step}: {message}")
    error.state, error.failed_at = last, (step, time)
    return error, raised

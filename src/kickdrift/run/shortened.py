"""A step of another length than the run's, in a copy of its stepper."""

from __future__ import annotations

from typing import Any, Protocol

from kickdrift.integrators.options import Options
from kickdrift.integrators.stepper import Counts
from kickdrift.looks.record import Record
from kickdrift.model.state import Floats


class Stepping(Protocol):
    """A run as a shortened step sees it; see `run.advance.Integration`."""

    stepper: Any
    options: Options
    record: Record
    dt: float | None

    @property
    def backward(self) -> bool: ...

    def stepper_in(self, backward: bool, options: Options) -> tuple[Any, Any]: ...


def shortened_step(run: Stepping, time: float) -> tuple[int, Floats, Counts]:
    """Take one step to ``time`` in a copy, which leaves the run on its grid. Return a status, y and the cost."""
    assert run.dt is not None
    rest = abs(time - run.stepper.time)
    _, stepper = run.stepper_in(run.backward, run.options.changed(dt=rest))
    stepper.reset(run.stepper.y.copy(), run.stepper.time, run.stepper.steps_done)
    before = stepper.counts
    status = stepper.advance(1)
    run.record.unfinished = run.dt - rest
    return status, stepper.y.copy(), stepper.counts - before

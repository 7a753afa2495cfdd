"""A step of another length than the run's, in a copy of its stepper.

The copy has a flow of its own, so that the run's pair lists and its noise stay as they are. A heat bath acts in the
copy from the memory of the run's bath, and with the random numbers of the step that the copy shortens.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, Protocol

from kickdrift.integrators.options import Options
from kickdrift.integrators.stepping.stepper import Counts
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


class Shortened:
    """Shortened steps of a run, in a copy that is kept while the run goes on in one direction with the same bodies.

    It does not hold the run, so that a run that nobody holds is freed at once.

    Attributes
    ----------
    heat : energy that the bath has given by the end of the last shortened step; None without a bath
    """

    def __init__(self) -> None:
        self._last: Any = None
        self.heat: float | None = None

    def step(self, run: Stepping, time: float) -> tuple[int, Floats, Counts]:
        """Take one step from the run's step point to ``time``. Return a status, y and the cost."""
        assert run.dt is not None
        rest = abs(time - run.stepper.time)

        def made(dt: float) -> Any:
            return run.stepper_in(run.backward, run.options.changed(dt=dt))[1]

        self._last = stepper = of_length(rest, self._last, made)
        inner = own_stepper(stepper)
        if hasattr(inner, "begin_from"):
            inner.begin_from(own_stepper(run.stepper))
        else:
            stepper.reset(run.stepper.y.copy(), run.stepper.time, run.stepper.steps_done)
        before = stepper.counts
        status = stepper.advance(1)
        run.record.unfinished = run.dt - rest
        self.heat = getattr(inner, "heat", None)
        return status, stepper.y.copy(), stepper.counts - before


def of_length(dt: float, last: Any, made: Callable[[float], Any]) -> Any:
    """A stepper with steps of this length: the last one, where it can change their length, else one that is made."""
    inner = own_stepper(last)
    if not hasattr(inner, "retimed"):
        return made(dt)
    inner.retimed(dt)
    return last


def own_stepper(stepper: Any) -> Any:
    """The method's own stepper, without what goes back in time or watches events around it."""
    return getattr(stepper, "inner", stepper)

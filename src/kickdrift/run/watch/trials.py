"""Trial steps beside a run, for the positions of bodies inside a step."""

from __future__ import annotations

from typing import Any, Protocol

from kickdrift.engines.session import RunFlow
from kickdrift.errors import RunError
from kickdrift.forces.kernel import OK
from kickdrift.integrators.flow import flow_of
from kickdrift.integrators.method import Method
from kickdrift.integrators.options import Options
from kickdrift.integrators.stepper import Counts, Stepper
from kickdrift.looks.observers import Sample
from kickdrift.looks.record import Record
from kickdrift.model.state import Floats


class Watched(Protocol):
    """Integration that is searched for events; see `run.advance.Integration`."""

    method: Method
    options: Options
    flow: RunFlow
    record: Record
    watched: tuple[Any, ...]

    @property
    def system(self) -> Any: ...

    @property
    def threads(self) -> int: ...

    @property
    def time(self) -> float: ...

    def stepper_for(self, system: Any) -> Stepper: ...

    def sample_at(self, y: Floats, time: float) -> Sample: ...

    def bodies_changed(self) -> None: ...


class Trials:
    """Shorter steps of a run's method from one of its states. Their own flow leaves the run's pair lists unchanged."""

    def __init__(self, run: Watched) -> None:
        self._run = run
        self._flow = flow_of(run.system, run.threads, jumps=True)
        self._last: Any = None

    def step(self, y: Floats, begin: float, end: float) -> tuple[int, Floats, Counts]:
        """Take one step from y at ``begin`` to ``end``. Return the status, y at the end, and the counts."""
        stepper = self._stepper(end - begin)
        stepper.reset(y.copy(), begin, 0)
        before = stepper.counts
        status = stepper.advance(1, float("inf"))
        return status, stepper.y, stepper.counts - before

    def _stepper(self, dt: float) -> Stepper:
        """A stepper for steps of this length: the last one, where it can change their length."""
        if hasattr(self._last, "retimed"):
            return self._last.retimed(dt)
        self._last = self._run.method.stepper(self._flow, self._run.method.parted(self._run.options, dt))
        return self._last

    def at(self, y: Floats, begin: float, time: float, step: int) -> Floats:
        """y at a time inside the run's ``step``, which began at y."""
        status, reached, _ = self.step(y, begin, time)
        if status != OK:
            raise RunError(f"step {step}: a shorter step to t = {time:.9g}, where an event is, failed")
        return reached

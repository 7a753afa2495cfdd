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
from kickdrift.run.shortened import of_length


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
        self._last = stepper = of_length(end - begin, self._last, self._made)
        stepper.reset(y.copy(), begin, 0)
        before = stepper.counts
        status = stepper.advance(1, float("inf"))
        return status, stepper.y, stepper.counts - before

    def _made(self, dt: float) -> Stepper:
        return self._run.method.stepper(self._flow, self._run.options.changed(dt=dt))

    def at(self, y: Floats, begin: float, time: float, step: int) -> Floats:
        """y at a time inside the run's ``step``, which began at y."""
        status, reached, _ = self.step(y, begin, time)
        if status != OK:
            raise RunError(f"step {step}: a shorter step to t = {time:.9g}, where an event is, failed")
        return reached

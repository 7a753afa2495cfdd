"""A step to search for events, the event that acts in it, and trial steps beside the run for positions inside it."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from itertools import pairwise
from typing import Any, NamedTuple, Protocol

import numpy as np

from kickdrift.engines.session import RunFlow
from kickdrift.errors import RunError
from kickdrift.forces.laws.central import gravitational_constant
from kickdrift.forces.seam.kernel import OK
from kickdrift.integrators import INTEGRATORS
from kickdrift.integrators.flows.flow import flow_of
from kickdrift.integrators.method import Method
from kickdrift.integrators.options import Options
from kickdrift.integrators.stepping.stepper import Counts, Stepper
from kickdrift.looks.observers import Sample
from kickdrift.looks.record import Record
from kickdrift.model.events.events import CloseApproach, Collision, Escape, binding
from kickdrift.model.patch import HERE, Image
from kickdrift.model.state import Floats
from kickdrift.model.system import System
from kickdrift.run.stepping import of_length
from kickdrift.run.watch.zeros import zero


@dataclass
class Span:
    """A step, or its part up to an event: y at both ends, and ``at(time)`` in between."""

    y0: Floats
    t0: float
    y1: Floats
    t1: float
    step: int
    at: Callable[[float], Floats]
    costly: bool = False  # whether ``at`` costs many evaluations of the forces
    failed: bool = False  # whether the step has no end

    @property
    def length(self) -> float:
        return self.t1 - self.t0

    def inside(self, time: float) -> Floats:
        """y at a time of the span, both ends included."""
        return self.y0 if time <= self.t0 else self.y1 if time >= self.t1 else self.at(time)

    def zero(self, g: Callable[[float], float], a: float, b: float, tolerance: float) -> float:
        """Zero of g, which has different signs at a and b. ``tolerance`` is a part of the span."""
        return zero(g, a, b, max(tolerance * self.length, 4 * float(np.spacing(max(abs(a), abs(b))))))


class Part(NamedTuple):
    """A part of a step: y at both ends, and their times."""

    y0: Floats
    t0: float
    y1: Floats
    t1: float


def parts(y0: Floats, t0: float, y1: Floats, t1: float, inner: object) -> list[Part]:
    """Parts of a stepper's last step, from (t0, y0) to (t1, y1): between the states that it knows inside the step, if
    there are any (see ``TraceStepper.inside``), else the step as one part."""
    if not hasattr(type(inner), "inside"):
        return [Part(y0, t0, y1, t1)]
    ends = [(t0, y0), *inner.inside(y0), (t1, y1)]  # type: ignore[attr-defined]
    return [Part(a, begin, b, end) for (begin, a), (end, b) in pairwise(ends)]


class Act(NamedTuple):
    """An event that is about to change bodies, or to end the run."""

    event: Collision | Escape | CloseApproach
    time: float
    bodies: tuple[int, ...]  # rows
    distance: float
    image: Image = HERE  # of the second body, in a box or patch


def attraction(system: System) -> tuple[Floats, float]:
    """G times the masses (n,), and the squared softening; zeros without gravity."""
    law = binding(system)
    gravity = 0.0 if law is None else gravitational_constant(law.name, law.G, system)
    return gravity * system.state.masses, 0.0 if law is None else float(law.softening) ** 2


def separation(y: Floats, i: int, j: int) -> float:
    """Distance between two bodies."""
    return float(np.linalg.norm(y[0, :, i] - y[0, :, j]))


def approach(y: Floats, i: int, j: int) -> float:
    """r . v of one body relative to another."""
    return float((y[0, :, i] - y[0, :, j]) @ (y[1, :, i] - y[1, :, j]))


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
        self._run, self.method = run, run.method
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
        return self._run.method.stepper(self._flow, self._run.method.parted(self._run.options, dt))

    def exact(self, y: Floats, begin: float) -> Exact:
        """The motion from y by a method without error."""
        return Exact(self._flow, y, begin)

    def between(self, y: Floats, begin: float, time: float) -> Floats:
        """y at a time by a method without error, from y at ``begin``."""
        return self.parts(y, begin, time)[-1].y1

    def parts(self, y: Floats, begin: float, end: float) -> list[Part]:
        """Steps of a method without error from y."""
        motion, found = self.exact(y, begin), [Part(y, begin, y, begin)]
        while (last := found[-1]).t1 < end:
            status, y, now = motion.step(end)
            if status != OK or not (now > last.t1 and np.isfinite(y).all()):
                raise RunError(f"the motion from t = {begin:.9g} to {end:.9g} failed")
            found.append(Part(last.y1, last.t1, y, now))
        return found[1:] or found

    def own(self, y: Floats, begin: float) -> Own:
        """The motion from y by steps of the run's method."""
        return Own(self, y, begin)

    def at(self, y: Floats, begin: float, time: float, step: int) -> Floats:
        """y at a time inside the run's ``step``, which began at y."""
        status, reached, _ = self.step(y, begin, time)
        if status != OK:
            raise RunError(f"step {step}: a shorter step to t = {time:.9g}, where an event is, failed")
        return reached


class Exact:
    """Motion from a state by gauss-radau15, in parts of given lengths at most."""

    ahead, behind, fine = 1.0, 0.0, False  # see ``courses.room``

    def __init__(self, flow: Any, y: Floats, begin: float) -> None:
        self._stepper: Any = INTEGRATORS["gauss-radau15"].stepper(flow, Options())
        self._stepper.reset(y.copy(), begin, 0)

    def step(self, until: float) -> tuple[int, Floats, float]:
        """Take one step, to ``until`` at most. Return the status, and y and the time at its end."""
        stepper = self._stepper
        stepper.end, stepper.clip = until, True
        status = stepper.advance(1, np.inf)
        return status, stepper.y.copy(), stepper.time

    def at(self, time: float) -> Floats:
        """y at a time inside the last step."""
        return np.array(self._stepper.at(time))


class Own:
    """Motion from a state by a run's own method, in parts of given lengths."""

    fine = True

    def __init__(self, trials: Trials, y: Floats, begin: float) -> None:
        self._trials, self._from, self._to = trials, (y, begin), (y, begin)
        self.ahead, self.behind = evaluated(trials.method)

    def step(self, until: float) -> tuple[int, Floats, float]:
        """Take one step. Return the status, and y and the time at its end."""
        self._from = self._to
        status, reached, _ = self._trials.step(*self._from, until)
        self._to = reached.copy(), until
        return status, *self._to

    def at(self, time: float) -> Floats:
        """y at a time inside the last step."""
        status, reached, _ = self._trials.step(*self._from, time)
        return reached if status == OK else np.full_like(reached, np.nan)


def evaluated(method: Any) -> tuple[float, float]:
    """Latest and earliest time at which a step evaluates forces, as parts of the step: at least (1, 0)."""
    if hasattr(method, "kick_groups"):
        times: Floats = method.stages[2]
    else:
        times = np.array(getattr(method, "c", (0.0, 1.0)))
    return max(1.0, float(times.max())), max(0.0, -float(times.min()))

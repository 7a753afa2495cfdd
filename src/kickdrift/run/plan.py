"""Plan of one call of ``Simulation.run``: where the run ends, and when it looks."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import astuple, dataclass
from typing import TYPE_CHECKING, Any, Protocol

import numpy as np

from kickdrift.errors import InputError
from kickdrift.integrators import INTEGRATORS
from kickdrift.looks.table import check_samples as check_samples
from kickdrift.model.checks import number
from kickdrift.model.limits import NEVER, steps_in
from kickdrift.model.limits import whole_number as whole_number
from kickdrift.text import shown

if TYPE_CHECKING:
    from kickdrift.integrators.method import Method
    from kickdrift.model.problem import Problem
    from kickdrift.model.run_defaults import RunDefaults
    from kickdrift.model.system import System

# Default numbers of looks; ``looks_at`` chooses among them. They depend on the run alone, so every machine takes the
# same looks at the same run.
SAMPLES = 1000
GLIMPSES = 10  # for a run without an energy, in which only the check for stiffness looks
LEAST = 50  # the verdict on the drift needs 40 looks
EVALUATIONS = 100  # force evaluations for each look; a look costs as much as one to seven
BODIES = 16_000  # looks times bodies in a run of any length: a few milliseconds in all


class Clock(Protocol):
    """Step and time of a run."""

    @property
    def steps_done(self) -> int: ...

    @property
    def time(self) -> float: ...


class Planned(Clock, Protocol):
    """Attributes of a Simulation that a plan needs."""

    method: Method
    integrator: str
    dt: float | None

    @property
    def system(self) -> System | Problem: ...

    @property
    def running(self) -> bool: ...


@dataclass(frozen=True)
class Plan:
    """Plan to run to step ``end_step`` or time ``end_time``, whichever comes first.

    The run looks after every ``every`` steps or every ``interval`` of time. With ``exact``, looks are at exactly these
    times; otherwise each look is at the next step point.
    """

    begin_step: int
    begin_time: float
    end_step: int = NEVER
    end_time: float = np.inf
    every: int = 0
    interval: float = 0.0
    exact: bool = False

    @property
    def numbers(self) -> list[float]:
        """The Plan as numbers, as a run's file stores it."""
        return [float(value) for value in astuple(self)]

    @classmethod
    def of(cls, numbers: Sequence[float]) -> Plan:
        """Return the Plan with these ``numbers``."""
        begin_step, begin_time, end_step, end_time, every, interval, exact = numbers
        return cls(int(begin_step), begin_time, int(end_step), end_time, int(every), interval, bool(exact))

    def over(self, run: Clock) -> bool:
        """Tell whether the run has reached its end."""
        return run.steps_done >= self.end_step or run.time >= self.end_time

    def next_stop(self, run: Clock) -> tuple[int, float]:
        """The next step number and time to stop at, whichever comes first."""
        step, time = self.end_step, self.end_time
        if self.every:
            step = min(step, (run.steps_done // self.every + 1) * self.every)
        if self.interval:
            passed = np.floor((run.time - self.begin_time) / self.interval * (1 + 1e-15))
            ahead = self.begin_time + (passed + 1) * self.interval
            while ahead <= run.time:
                passed += 1
                ahead = self.begin_time + (passed + 1) * self.interval
            if ahead < self.end_time - 1e-15 * abs(self.end_time):
                time = ahead
        return step, time

    def present(self, step_point: float, stop_time: float) -> float | None:
        """Return the time of the look if it lies before ``step_point``, else None (the look is at the step point)."""
        present = self.horizon(stop_time)
        return present if step_point > present else None

    def horizon(self, stop_time: float) -> float:
        """Return the latest time that the run may reach before its next look."""
        return stop_time if self.exact else self.end_time

    def progress(self, run: Clock) -> tuple[int, int]:
        """Return the amount done and the total."""
        if self.end_step < NEVER:
            return run.steps_done - self.begin_step, self.end_step - self.begin_step
        done = (run.time - self.begin_time) / (self.end_time - self.begin_time)
        return min(1000, int(1000 * done)), 1000


def looks_at(steps: int, evaluations: int, bodies: int) -> int:
    """Return the default number of looks of a run; ``evaluations`` counts the force evaluations of one step.

    The number is 1000, or one for each 100 force evaluations if that is fewer. It is at least 16000 / bodies, and at
    least 50.
    """
    return min(SAMPLES, max(LEAST, steps * max(evaluations, 1) // EVALUATIONS, BODIES // bodies))


def plan_of(
    sim: Planned,
    steps: int | None,
    until: float | None,
    every: int | None,
    interval: float | None,
    known: int | None,
    seen: bool = True,
) -> Plan:
    """Check the arguments of ``Simulation.run`` and return the Plan.

    ``known`` is the cadence of the file that the run continues, if any. ``seen`` says whether there is anything to
    sample."""
    begin = sim.steps_done, sim.time
    if interval is not None and not sim.method.chooses_steps:
        raise InputError(f"run: interval is for methods that choose their steps; with {sim.integrator}, use every")
    if interval is not None and not (np.isfinite(number(interval)) and interval > 0):
        raise InputError(f"run: interval must be a positive time, got {shown(interval)}")
    if interval is not None and every is not None:
        raise InputError("run: give every or interval, not both")
    given = sim.system.run.interval if (every, interval, known) == (None, None, None) else None
    if given is not None and sim.method.chooses_steps:
        interval = given
    elif given is not None and sim.dt:
        every = max(1, round(given / sim.dt))
    cadence = whole_number("every", every, 1) if every is not None else known or sim.system.run.every
    if not sim.method.chooses_steps or until is None:
        count = steps_to(sim, steps, until)
        samples = looks_at(count, sim.method.evaluations, len(sim.system)) if seen else GLIMPSES
        cadence = cadence or max(1, count // samples)
        every = 0 if interval else cadence
        check_samples(count / cadence, "every")
        return Plan(*begin, begin[0] + count, every=every, interval=interval or 0.0, exact=True)
    if steps is not None or sim.running:
        steps_to(sim, steps, until)  # raises the error
    end = number(until)
    if not (np.isfinite(end) and end >= sim.time):
        raise InputError(
            f"run: until must be a finite time not before the current time, {sim.time:.12g}, got {shown(until)}"
        )
    if cadence and interval is None:
        return Plan(*begin, end_time=end, every=cadence)
    length = interval or (end - sim.time) / (SAMPLES if seen else GLIMPSES)
    if interval:
        check_samples((end - sim.time) / interval, "interval")
    return Plan(*begin, end_time=end, interval=length, exact=interval is not None)


def check_run(run: RunDefaults) -> None:
    """Refuse a ``[run]`` table that asks for too many steps or samples, before the run begins."""
    steps: float | None = run.steps
    method = INTEGRATORS.get(run.integrator or "")
    if run.time is not None and run.dt is not None and not (method and method.chooses_steps):
        steps = steps_in("run: time", run.time, run.dt)
    if steps is not None and run.every is not None:
        check_samples(steps / run.every, "every")


def length_of(sim: Planned, name: str, steps: int | None = None, time: float | None = None) -> dict[str, Any]:
    """Return the arguments ``steps`` or ``until`` of ``Simulation.run``.

    Without ``steps`` and ``time``, the system's own ``[run]`` decides. Errors name the system by ``name``."""
    given = sim.system.run
    if steps is None and time is None:
        steps, time = given.steps, given.time
        if sim.method.chooses_steps and given.steps is not None and given.dt is not None:
            steps, time = None, given.steps * given.dt  # covers the same time as the file's fixed steps
    if steps is None and time is None:
        raise InputError(f"{name}: [run] names neither steps nor time; give --steps or --time")
    if sim.method.chooses_steps and time is not None:
        return {"until": sim.time + time}
    return {"steps": steps_to(sim, steps, None if time is None else sim.time + time)}


def steps_to(sim: Planned, steps: int | None, until: float | None) -> int:
    """Return the number of steps; see ``Simulation.steps_to``."""
    if sim.running:
        raise InputError("run: the Simulation is already running")
    if (steps is None) == (until is None):
        raise InputError("run: give either steps or until")
    if until is None:
        return whole_number("steps", steps, 0)
    if not np.isfinite(number(until)):
        raise InputError(f"run: until must be a finite time, got {shown(until)}")
    if sim.dt is None or sim.method.chooses_steps:
        raise InputError(f"run: {sim.integrator} chooses its steps, so their number is not known before the run")
    exact = steps_in("run: time", until - sim.time, sim.dt)
    count = round(exact)
    if exact < -1e-6:
        raise InputError(f"run: time {until:.12g} lies before the current time, {sim.time:.12g}")
    if abs(exact - count) > 1e-6:
        low = sim.time + int(np.floor(exact)) * sim.dt
        nearest = f"{low:.12g} and {low + sim.dt:.12g}"
        raise InputError(f"run: time {until:.12g} is not on the grid of steps of {sim.dt:g}; nearest are {nearest}")
    return count

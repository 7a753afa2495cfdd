"""How far one call of ``Simulation.run`` goes, and where it stops to look."""

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

# Looks at a run that does not say how often; ``looks_at`` says how many when. They depend on the run alone, so that the
# same run is looked at alike on every machine.
SAMPLES = 1000
GLIMPSES = 10  # where there is no energy to sample: for stiffness alone
LEAST = 50  # the verdict on the drift needs 40
EVALUATIONS = 100  # of the forces for each look: a look costs one to seven of them
BODIES = 16_000  # that may be looked at whatever the run's length: that is a few milliseconds in all


class Clock(Protocol):
    """How far a run has come."""

    @property
    def steps_done(self) -> int: ...

    @property
    def time(self) -> float: ...


class Planned(Clock, Protocol):
    """What is known of a run that is to be planned: a Simulation."""

    method: Method
    integrator: str
    dt: float | None

    @property
    def system(self) -> System | Problem: ...

    @property
    def running(self) -> bool: ...


@dataclass(frozen=True)
class Plan:
    """Go on to step ``end_step`` or time ``end_time``, whichever comes first, and look every so many steps or so much
    time.

    Looks ``interval`` apart are at these very times where ``exact``, else at the first step point from there on.
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
        """The Plan as a run's file keeps it."""
        return [float(value) for value in astuple(self)]

    @classmethod
    def of(cls, numbers: Sequence[float]) -> Plan:
        """The Plan that has these ``numbers``."""
        begin_step, begin_time, end_step, end_time, every, interval, exact = numbers
        return cls(int(begin_step), begin_time, int(end_step), end_time, int(every), interval, bool(exact))

    def over(self, run: Clock) -> bool:
        """Whether the run has come to its end."""
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
        """The time to look at, where that lies before the step point reached; None for the step point itself."""
        present = self.horizon(stop_time)
        return present if step_point > present else None

    def horizon(self, stop_time: float) -> float:
        """The present comes no further than that before the next look."""
        return stop_time if self.exact else self.end_time

    def progress(self, run: Clock) -> tuple[int, int]:
        """Done, and of how much."""
        if self.end_step < NEVER:
            return run.steps_done - self.begin_step, self.end_step - self.begin_step
        done = (run.time - self.begin_time) / (self.end_time - self.begin_time)
        return min(1000, int(1000 * done)), 1000


def looks_at(steps: int, evaluations: int, bodies: int) -> int:
    """How many looks a run of so many steps takes by default, with so many evaluations of the forces a step.

    1000, but one for each 100 evaluations of the forces where these are fewer, and 16000 / bodies or 50 at least.
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
    """What ``Simulation.run`` was asked for, checked; ``known`` is the cadence of the file that the run goes on into,
    if any, and ``seen`` whether there is anything to look at."""
    begin = sim.steps_done, sim.time
    if interval is not None and not sim.method.chooses_steps:
        raise InputError(f"run: interval is for methods that choose their steps; {sim.integrator} takes every")
    if interval is not None and not (np.isfinite(number(interval)) and interval > 0):
        raise InputError(f"run: interval must be a positive time, got {shown(interval)}")
    if interval is not None and every is not None:
        raise InputError("run: give every or interval, not both")
    cadence = whole_number("every", every, 1) if every is not None else known or sim.system.run.every
    if not sim.method.chooses_steps or until is None:
        count = steps_to(sim, steps, until)
        samples = looks_at(count, sim.method.evaluations, len(sim.system)) if seen else GLIMPSES
        cadence = cadence or max(1, count // samples)
        every = 0 if interval else cadence
        check_samples(count / cadence, "every")
        return Plan(*begin, begin[0] + count, every=every, interval=interval or 0.0, exact=True)
    if steps is not None or sim.running:
        steps_to(sim, steps, until)  # which says why not
    end = number(until)
    if not (np.isfinite(end) and end >= sim.time):
        raise InputError(f"run: time {shown(until)} is not a finite time from the present, {sim.time:.12g}, on")
    if cadence and interval is None:
        return Plan(*begin, end_time=end, every=cadence)
    length = interval or (end - sim.time) / (SAMPLES if seen else GLIMPSES)
    if interval:
        check_samples((end - sim.time) / interval, "interval")
    return Plan(*begin, end_time=end, interval=length, exact=interval is not None)


def check_run(run: RunDefaults) -> None:
    """Refuse what ``[run]`` asks for where it is too long, or too many samples, before anything is run."""
    steps: float | None = run.steps
    method = INTEGRATORS.get(run.integrator or "")
    if run.time is not None and run.dt is not None and not (method and method.chooses_steps):
        steps = steps_in("run: time", run.time, run.dt)
    if steps is not None and run.every is not None:
        check_samples(steps / run.every, "every")


def length_of(sim: Planned, name: str, steps: int | None = None, time: float | None = None) -> dict[str, Any]:
    """What ``Simulation.run`` is asked for: steps, or the time until; where neither is given, what the system, which
    goes by that name, says itself."""
    given = sim.system.run
    if steps is None and time is None:
        steps, time = given.steps, given.time
        if sim.method.chooses_steps and given.steps is not None and given.dt is not None:
            steps, time = None, given.steps * given.dt  # the same length as the file's fixed steps have
    if steps is None and time is None:
        raise InputError(f"{name}: [run] names neither steps nor time; give --steps or --time")
    if sim.method.chooses_steps and time is not None:
        return {"until": sim.time + time}
    return {"steps": steps_to(sim, steps, None if time is None else sim.time + time)}


def steps_to(sim: Planned, steps: int | None, until: float | None) -> int:
    """See ``Simulation.steps_to``."""
    if sim.running:
        raise InputError("run: the Simulation runs already")
    if (steps is None) == (until is None):
        raise InputError("run: give either steps or until")
    if until is None:
        return whole_number("steps", steps, 0)
    if not np.isfinite(number(until)):
        raise InputError(f"run: the time to reach must be a finite number, got {shown(until)}")
    if sim.dt is None or sim.method.chooses_steps:
        raise InputError(f"run: {sim.integrator} chooses its steps; how many it takes is known afterwards")
    exact = steps_in("run: time", until - sim.time, sim.dt)
    count = round(exact)
    if exact < -1e-6:
        raise InputError(f"run: time {until:.12g} lies before the present, {sim.time:.12g}")
    if abs(exact - count) > 1e-6:
        low = sim.time + int(np.floor(exact)) * sim.dt
        nearest = f"{low:.12g} and {low + sim.dt:.12g}"
        raise InputError(f"run: time {until:.12g} is not on the grid of steps of {sim.dt:g}; nearest are {nearest}")
    return count

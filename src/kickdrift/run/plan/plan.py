"""Plan of one call of ``Simulation.run``: where the run ends, and when it looks."""

from __future__ import annotations

from bisect import bisect_right
from collections.abc import Sequence
from dataclasses import astuple, dataclass, replace
from operator import neg
from typing import Protocol

import numpy as np

from kickdrift.errors import InputError
from kickdrift.integrators import INTEGRATORS
from kickdrift.looks.observers import check_samples as check_samples
from kickdrift.model.checks.limits import NEVER, steps_in
from kickdrift.model.checks.limits import whole_number as whole_number
from kickdrift.model.checks.values import number
from kickdrift.model.run_defaults import RunDefaults
from kickdrift.run.plan import lengths
from kickdrift.text import shown

# Default numbers of looks; ``looks_at`` chooses among them. They depend on the run alone, so every machine takes the
# same looks at the same run.
SAMPLES = 1000
GLIMPSES = 10  # for a run without an energy, in which only the check for stiffness looks
LEAST = 50  # the verdict on the drift needs 40 looks
SHARE = 0.1  # most time of these, as a part of the time of the steps
EVALUATIONS = 100  # force evaluations for each look
BODIES = 16_000  # looks times bodies in a run of any length: a few milliseconds in all


class Cadence(Protocol):
    """Steps or time between the looks of the file that a run continues."""

    @property
    def every(self) -> int: ...

    @property
    def interval(self) -> float | None: ...


class Clock(Protocol):
    """Step and time of a run, and the length of fixed steps."""

    dt: float | None

    @property
    def steps_done(self) -> int: ...

    @property
    def time(self) -> float: ...


@dataclass(frozen=True)
class Plan:
    """Plan to run to step ``end_step`` or time ``end_time``, whichever comes first.

    The run looks after every ``every`` steps or every ``interval`` of time. With ``exact``, looks are at exactly these
    times; otherwise each look is at the next step point. An end before the beginning is a run backwards; with fixed
    steps it is at minus infinity. Fixed steps to ``end_step`` and a finite ``end_time`` end with a shortened step. With
    ``times``, the looks are at these times alone, and the last one is the end.
    """

    begin_step: int
    begin_time: float
    end_step: int = NEVER
    end_time: float = np.inf
    every: int = 0
    interval: float = 0.0
    exact: bool = False
    times: tuple[float, ...] = ()

    @property
    def numbers(self) -> list[float]:
        """The Plan as numbers, as a run's file stores it."""
        return [float(value) for value in (*astuple(self)[:-1], *self.times)]

    @classmethod
    def of(cls, numbers: Sequence[float]) -> Plan:
        begin_step, begin_time, end_step, end_time, every, interval, exact, *times = numbers
        steps = int(begin_step), int(end_step), int(every)
        return cls(steps[0], begin_time, steps[1], end_time, steps[2], interval, bool(exact), tuple(times))

    @property
    def backward(self) -> bool:
        """Whether the run goes back in time."""
        return self.end_time < self.begin_time

    def reached(self, time: float, goal: float) -> bool:
        """Whether a time is the goal or lies behind it, in the direction of the run."""
        return time <= goal if self.backward else time >= goal

    def over(self, run: Clock) -> bool:
        """Tell whether the run has reached its end."""
        if self.times:
            return self.next_time(run) is None
        return run.steps_done >= self.end_step or self.reached(run.time, self.end_time)

    @property
    def whole_steps_end(self) -> int:
        """The last whole step: a finite end step and end time mean that the last step is shortened."""
        return self.end_step - (self.end_step < NEVER and bool(np.isfinite(self.end_time)))

    def only_shortened(self, run: Clock) -> bool:
        """Whether nothing but a shortened step is left."""
        return self.whole_steps_end <= run.steps_done < self.end_step

    def next_time(self, run: Clock) -> float | None:
        """The first of the ``times`` that lies ahead of the present; None if there is none. A time within the rounding
        of fixed steps counts as the present."""
        margin = 0.0 if self.end_step == NEVER or run.dt is None else lengths.CLOSE * run.dt
        if self.backward:
            passed = bisect_right(self.times, margin - run.time, key=neg)
        else:
            passed = bisect_right(self.times, run.time + margin)
        return self.times[passed] if passed < len(self.times) else None

    def next_stop(self, run: Clock) -> tuple[int, float]:
        """The next step number and time to stop at, whichever comes first."""
        step, time = self.whole_steps_end, self.end_time
        if self.every:
            step = min(step, (run.steps_done // self.every + 1) * self.every)
        if self.interval:
            apart = -self.interval if self.backward else self.interval
            passed = np.floor((run.time - self.begin_time) / apart * (1 + 1e-15))
            ahead = self.begin_time + (passed + 1) * apart
            while self.reached(run.time, ahead):
                passed += 1
                ahead = self.begin_time + (passed + 1) * apart
            margin = 1e-15 * abs(self.end_time)
            if not self.reached(ahead, self.end_time + (margin if self.backward else -margin)):
                time = ahead
        return step, time

    def present(self, step_point: float, stop_time: float) -> float | None:
        """Return the time of the look if it lies before ``step_point``, else None (the look is at the step point)."""
        present = self.horizon(stop_time)
        return present if step_point != present and self.reached(step_point, present) else None

    def horizon(self, stop_time: float) -> float:
        """Return the latest time that the run may reach before its next look."""
        return stop_time if self.exact else self.end_time

    def progress(self, run: Clock) -> tuple[int, int]:
        """Return the amount done and the total."""
        if self.end_step < NEVER:
            return run.steps_done - self.begin_step, self.end_step - self.begin_step
        done = (run.time - self.begin_time) / (self.end_time - self.begin_time)
        return min(1000, int(1000 * done)), 1000


def looks_at(steps: int, evaluations: int, bodies: int, cost: float = 0.0) -> int:
    """Return the default number of looks of a run; ``evaluations`` counts the force evaluations of one step, and
    ``cost`` is the time of a look in evaluations.

    The number is 1000, or one for each 100 force evaluations if that is fewer. It is at least 16000 / bodies, and at
    least 50 if these take a tenth of the time of the steps or less.
    """
    all_evaluations = steps * max(evaluations, 1)
    least = min(LEAST, int(SHARE * all_evaluations / cost)) if cost else LEAST
    return min(SAMPLES, max(1, least, all_evaluations // EVALUATIONS, BODIES // bodies))


def _look_cost(sim: lengths.Planned) -> float:
    run = sim.integration
    return float(run.flow.look_cost(getattr(run.stepper, "ends_fresh", False)))


def plan_of(
    sim: lengths.Planned,
    steps: int | None,
    until: float | None,
    every: int | None,
    interval: float | None,
    own: Cadence | None = None,
    seen: bool = True,
    exact: lengths.Exact = False,
) -> Plan:
    """Check the arguments of ``Simulation.run`` and return the Plan.

    ``own`` is the cadence of the file that the run continues, if any. ``seen`` says whether there is anything to
    sample."""
    lengths.check_exact(exact)
    begin = sim.steps_done, sim.time
    known = own.every if own else None
    if own and sim.method.chooses_steps and (steps, every, interval) == (None,) * 3:
        interval = own.interval
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
        count = lengths.steps_to(sim, steps, until, exact)
        samples = looks_at(count, sim.method.evaluations, len(sim.system), _look_cost(sim)) if seen else GLIMPSES
        cadence = cadence or max(1, count // samples)
        every = 0 if interval else cadence
        check_samples(count / cadence, "every")
        plan = Plan(*begin, begin[0] + count, every=every, interval=interval or 0.0, exact=True)
        return plan if until is None else _to_time(sim, plan, until, exact)
    if steps is not None or sim.running:
        lengths.steps_to(sim, steps, until)  # raises the error
    end = number(until)
    if not np.isfinite(end):
        raise InputError(f"run: until must be a finite time, got {shown(until)}")
    if end < sim.time:
        lengths.check_backward(sim)
    if cadence and interval is None:
        return Plan(*begin, end_time=end, every=cadence)
    length = interval or abs(end - sim.time) / (SAMPLES if seen else GLIMPSES)
    if interval:
        check_samples(abs(end - sim.time) / interval, "interval")
    return Plan(*begin, end_time=end, interval=length, exact=interval is not None)


def _to_time(sim: lengths.Planned, plan: Plan, until: float, exact: lengths.Exact) -> Plan:
    """Return a plan of fixed steps to a time: backwards if the time lies behind, with a shortened step at the end."""
    whole = lengths.whole_steps(sim, until, exact)
    if whole.backward and whole.steps:
        lengths.check_backward(sim)
        plan = replace(plan, end_time=-np.inf)
    if whole.shortened:
        if sim.integration.events:
            raise InputError(
                f'run: exact="{lengths.SHORTEN}": events are not watched in a shortened step; end on a whole step'
            )
        plan = replace(plan, end_time=until)
    return plan


def check_run(run: RunDefaults) -> None:
    """Refuse a ``[run]`` table that asks for too many steps or samples, before the run begins."""
    steps: float | None = run.steps
    method = INTEGRATORS.get(run.integrator or "")
    if run.time is not None and run.dt is not None and not (method and method.chooses_steps):
        steps = steps_in("run: time", run.time, run.dt)
    if steps is not None and run.every is not None:
        check_samples(steps / run.every, "every")

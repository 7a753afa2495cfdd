"""Looks at given times: the plan of ``Simulation.run(times=…)``, and the way to its next time."""

from collections.abc import Iterable, Sequence
from typing import Any

import numpy as np

from kickdrift.errors import InputError
from kickdrift.model.checks.values import number
from kickdrift.model.state import Floats
from kickdrift.run.advance import Integration
from kickdrift.run.plan import lengths
from kickdrift.run.plan.plan import Plan, check_samples
from kickdrift.text import shown


def times_of(sim: lengths.Planned, times: Any) -> Floats:
    """Times in the system's unit, from numbers and texts such as "5 ps". Raises InputError for an empty row, and for
    what is no finite time."""
    if isinstance(times, str) or not isinstance(times, Iterable):
        raise InputError(f"times: expected a row of times, such as [0.5, 1.0], got {shown(times)}")
    found = np.array([_time(sim, f"times[{k}]", value) for k, value in enumerate(times)])
    if not found.size:
        raise InputError("times: expected one time or more, got none")
    check_samples(len(found), "times")
    return found


def _time(sim: lengths.Planned, key: str, value: Any) -> float:
    found = number(lengths.time_of(sim, value, key))
    if not np.isfinite(found):
        raise InputError(f"{key}: expected a finite time, got {shown(value)}")
    return found


def refuse_beside(times: Any, **others: Any) -> None:
    """Refuse other lengths and other looks beside ``times``."""
    for key, value in others.items():
        if times is not None and value is not None:
            raise InputError(
                f"run: give times alone: they say how long the run is and where it looks, and so does {key}"
            )


def plan_at(sim: lengths.Planned, times: Floats) -> Plan:
    """Plan of a run with looks at these times alone, beside the look at the start."""
    begin, last = sim.time, float(times[-1])
    if sim.running:
        raise InputError("run: the Simulation is already running")
    backward = last < begin
    fixed = not sim.method.chooses_steps
    margin = lengths.CLOSE * sim.dt if fixed and sim.dt is not None else 0.0
    passed = times > begin + margin if backward else times < begin - margin
    if passed.any():
        which = int(np.argmax(passed))
        side = "after" if backward else "before"
        raise InputError(f"times[{which}]: {times[which]:.12g} lies {side} the present, {begin:.12g}")
    apart = -np.diff(times) if backward else np.diff(times)
    if (apart <= 0).any():
        first = 1 + int(np.argmax(apart <= 0))
        raise InputError(
            f"times[{first}]: {times[first]:.12g} does not follow {times[first - 1]:.12g}; times rise, or fall for a "
            "run back in time"
        )
    if backward:
        lengths.check_backward(sim)
    plan = Plan(sim.steps_done, begin, end_time=last, exact=True, times=tuple(times.tolist()))
    if not fixed:
        return plan
    assert sim.dt is not None
    origin, _ = lengths.grid_from(sim, backward)
    steps = np.abs(times - origin) / sim.dt
    off = np.abs(steps - np.round(steps)) > lengths.CLOSE
    if off.any():
        _check_inside(sim, float(times[off][0]))
    whole = lengths.whole_steps(sim, last, lengths.SHORTEN)
    return Plan(sim.steps_done, begin, sim.steps_done + whole.steps, last, exact=True, times=plan.times)


def _check_inside(sim: lengths.Planned, time: float) -> None:
    """Refuse a time inside a fixed step where a shortened copy of the step has no meaning."""
    run, why = sim.integration, ""
    if run.box_varies:
        why = "a barostat acts between whole steps"
    elif run.foreign:
        why = f"engine {run.engine.name!r} takes whole steps"
    elif run.events and run.events.acting:
        why = "events change bodies inside steps, and a shortened copy of a step knows no events"
    if why:
        raise InputError(f"times: {time:.12g} lies inside a step of {sim.dt:g}, and {why}; give times of whole steps")


def length_of(
    sim: lengths.Planned,
    name: str,
    steps: int | None = None,
    time: float | None = None,
    exact: lengths.Exact = False,
    times: Sequence[float | str] | None = None,
) -> dict[str, Any]:
    """Return the arguments ``times``, ``steps``, or ``until`` and ``exact``, of ``Simulation.run``.

    Without ``steps`` and ``time``, the system's own ``[run]`` decides. Errors name the system by ``name``."""
    given = sim.system.run
    if times is None and steps is None and time is None:
        times = given.times
    if times is not None:
        refuse_beside(times, steps=steps, time=time, exact=exact or None)
        plan_at(sim, times_of(sim, times))  # or its error
        return {"times": times}
    if steps is None and time is None:
        steps, time = given.steps, given.time
        if sim.method.chooses_steps and given.steps is not None and given.dt is not None:
            steps, time = None, given.steps * given.dt  # as long as the fixed steps of the file
    if steps is None and time is None:
        raise InputError(f"{name}: [run] names neither steps nor time nor times; give --steps, --time or --times")
    if time is None:
        return {"steps": lengths.steps_to(sim, steps, None)}
    if not np.isfinite(number(time)):
        raise InputError(f"time must be a finite time, got {shown(time)}")
    until = sim.time + time
    if not sim.method.chooses_steps:
        lengths.steps_to(sim, steps, until, exact)  # or its error
    return {"until": until, "exact": exact}


def go_to_next(run: Integration, plan: Plan) -> bool:
    """Go towards the next time of the plan, through as many steps as compiled code takes at once. Return whether the
    present is at that time."""
    time = plan.next_time(run)
    assert time is not None
    if run.method.chooses_steps:
        return _by_own_steps(run, plan, time)
    assert run.dt is not None
    steps = abs(time - run.stepper.time) / run.dt
    if steps > 1 - lengths.CLOSE:
        run.advance(min(run.chunk, int(steps + lengths.CLOSE)))
        if run.events and run.events.stopped:
            return False
        steps = abs(time - run.stepper.time) / run.dt
    if lengths.CLOSE < steps < 1 - lengths.CLOSE:
        run.look_ahead(time, counted=True)
    return steps < 1 - lengths.CLOSE


def _by_own_steps(run: Integration, plan: Plan, time: float) -> bool:
    """The same for a method that chooses its steps: the present lies inside the last step."""
    if run.events or not plan.reached(run.stepper.time, time):
        if run.advance(run.chunk, time, time, plan.end_time):
            run.look_ahead(time, counted=time == plan.end_time)
            return run.at is not None
        if not plan.reached(run.stepper.time, time):
            return False
    run.at = None if run.stepper.time == time else time
    return True

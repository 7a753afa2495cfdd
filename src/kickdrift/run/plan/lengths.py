"""Length of a run in steps: whole steps to a time, forwards or backwards, and what happens to a time between two."""

from typing import Any, Literal, NamedTuple, Protocol

import numpy as np

from kickdrift.errors import InputError
from kickdrift.integrators.method import Method
from kickdrift.integrators.stepping.backward import mirrored
from kickdrift.looks.record import Record
from kickdrift.model.checks.limits import steps_in
from kickdrift.model.checks.limits import whole_number as whole_number
from kickdrift.model.checks.values import number
from kickdrift.model.units.quantities import time_in
from kickdrift.text import shown

Exact = bool | Literal["shorten"]

SHORTEN: Literal["shorten"] = "shorten"
CLOSE = 1e-6  # steps between a time and the grid that count as rounding


class Planned(Protocol):
    """Attributes of a Simulation that the length of a run needs."""

    method: Method
    integrator: str
    dt: float | None

    @property
    def integration(self) -> Any: ...

    @property
    def steps_done(self) -> int: ...

    @property
    def time(self) -> float: ...

    @property
    def system(self) -> Any: ...

    @property
    def running(self) -> bool: ...

    @property
    def record(self) -> Record: ...


class Whole(NamedTuple):
    """Fixed steps of a run to a time.

    Attributes
    ----------
    steps : number of steps, counted from the current step; with a shortened step at the end, that one included
    backward : whether the run goes back in time
    end : time that these steps reach
    off : whether the time lies between two steps
    shortened : whether the last step is shortened
    """

    steps: int
    backward: bool
    end: float
    off: bool
    shortened: bool


def check_exact(exact: Any) -> None:
    """Refuse another ``exact`` than True, False and "shorten"."""
    if not (isinstance(exact, bool | np.bool_) or (isinstance(exact, str) and exact == SHORTEN)):
        raise InputError(f'run: exact must be True, False or "shorten", got {shown(exact)}')


def whole_steps(sim: Planned, until: float, exact: Exact = False) -> Whole:
    """Return the steps to a time; an InputError where a time between two steps is refused, or where there is no way.

    A run that goes on in its direction keeps to its grid, also from a time inside a step."""
    check_exact(exact)
    if not np.isfinite(number(until)):
        raise InputError(f"run: until must be a finite time, got {shown(until)}")
    if sim.dt is None or sim.method.chooses_steps:
        raise InputError(f"run: {sim.integrator} chooses its steps, so their number is not known before the run")
    dt, run = sim.dt, sim.integration
    backward = until < sim.time - CLOSE * dt
    sign = -1 if backward else 1
    begin, begun = grid_from(sim, backward)
    steps = steps_in("run: time", abs(until - begin), dt)
    nearest = round(steps)
    off = abs(steps - nearest) > CLOSE
    shortened = off and exact == SHORTEN
    if shortened and run.box_varies:
        raise InputError('run: exact = "shorten": a barostat acts between whole steps; give a whole number of steps')
    if off and exact is True:
        low, high = sorted(begin + sign * (int(np.floor(steps)) + k) * dt for k in (0, 1))
        near = f"{low:.12g} and {high:.12g}"
        raise InputError(f"run: time {until:.12g} is not on the grid of steps of {dt:g}; nearest are {near}")
    passed = int(np.floor(steps)) + 1 if shortened else nearest
    end = until if shortened else begin + sign * passed * dt
    return Whole(max(0, begun + passed - sim.steps_done), backward, end, off, shortened)


def grid_from(sim: Planned, backward: bool) -> tuple[float, int]:
    """Time and number of the whole step from which a run in this direction counts its steps."""
    run = sim.integration
    return (run.stepper.time, run.stepper.steps_done) if backward == run.backward else (sim.time, sim.steps_done)


def time_of(sim: Planned, value: float | str | None, key: str) -> float | None:
    """A time in the system's unit, from a number or a text such as "5 ps"; errors begin with ``key``."""
    found: float | None = time_in(value, getattr(sim.system, "units", None), key)
    return found


def goal_of(sim: Planned, steps: int | None, until: float | str | None, time: float | str | None) -> float | None:
    """The time that a run goes to: ``until``, or now and ``time`` more; None where ``steps`` say how long it is."""
    if time is None:
        return time_of(sim, until, "until")
    if until is not None or steps is not None:
        other = "until" if steps is None else "steps"
        raise InputError(f"run: give steps, until or time, not {other} and time")
    more = time_of(sim, time, "time")
    if more is None or not np.isfinite(number(more)):
        raise InputError(f"run: time must be a finite time, got {shown(time)}")
    return sim.time + more


def begin(sim: Planned, backward: bool, until: float | None, exact: Exact) -> None:
    """Turn the run to its direction of time, and note a time between two steps in its record."""
    notes = _rounding_note(sim, until, exact)
    sim.integration.turn(backward)
    sim.record.warnings += [line for line in notes if line not in sim.record.warnings]


def _rounding_note(sim: Planned, until: float | None, exact: Exact) -> list[str]:
    """Return a line that says where a run ends whose time lies between two steps."""
    if until is None or sim.method.chooses_steps:
        return []
    whole = whole_steps(sim, until, exact)
    if not whole.off or whole.shortened:
        return []
    steps = f"{whole.steps:,} step{'' if whole.steps == 1 else 's'}"
    return [f"time {until:.12g} is not a multiple of dt = {sim.dt:.12g}: runs {steps}, to {whole.end:.12g}"]


def steps_to(sim: Planned, steps: int | None, until: float | None, exact: Exact = False) -> int:
    """Return the number of steps; see ``Simulation.steps_to``."""
    if sim.running:
        raise InputError("run: the Simulation is already running")
    if (steps is None) == (until is None):
        raise InputError("run: give either steps or until")
    if until is None:
        return whole_number("steps", steps, 0)
    return whole_steps(sim, until, exact).steps


def check_backward(sim: Planned) -> None:
    """Refuse a run backwards in time where method, engine, events or a force cannot go back; names which."""
    run, method = sim.integration, sim.method
    if not (method.reversible or method.chooses_steps):
        raise InputError(
            f"run: {sim.integrator} is neither reversible nor adaptive, so the run cannot go back in time; "
            "velocity-verlet and dop853 can"
        )
    if run.foreign:
        raise InputError(f"run: engine {run.engine.name!r} runs forwards in time only; the native engine goes back")
    if run.events:
        raise InputError("run: events are watched forwards in time only; a run back in time takes no events")
    mirrored(run.system)

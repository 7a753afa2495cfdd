"""Loop of leapfrog-adaptive, and an integration with it."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from kickdrift.forces.bound.table import EVALUATIONS, SLOTS, fill_accelerations
from kickdrift.forces.seam.kernel import OK
from kickdrift.integrators.options import Options
from kickdrift.integrators.stepping.loops import STAGE, STEP, add_scaled
from kickdrift.integrators.stepping.stepper import STOPPED, Counts
from kickdrift.integrators.stepping.stepping import Resumable
from kickdrift.jit.compile import driver, jit
from kickdrift.jit.handle import handle
from kickdrift.model.state import Floats

if TYPE_CHECKING:
    from kickdrift.integrators.flows.flow import Flow

# Slots of the clock: the last step point and the density of steps there, the same for the previous step point; dt and
# the crowding at the system's start, which scale the density.
TIME, DENSITY, BEFORE, DENSITY_BEFORE, DT, SCALE = range(6)

MOST = 10.0  # largest ratio of consecutive steps
LOWEST = 1e-4  # fraction of the density at the start: steps grow to 10,000 dt if forces vanish


@jit
def crowding(a):
    """Return sum |a|^3 over particles: its fourth root is a smooth maximum of |a|^(3/4)."""
    total = 0.0
    for i in range(a.shape[1]):
        a2 = 0.0
        for k in range(a.shape[0]):
            a2 += a[k, i] ** 2
        total += a2 * np.sqrt(a2)
    return total


@jit
def density(a, clock):
    """Return the steps per time for these accelerations; 1 / dt throughout if there was no acceleration at the
    start."""
    ratio = crowding(a) / clock[SCALE] if clock[SCALE] > 0.0 else 1.0
    return (ratio + LOWEST**4) ** 0.25 / clock[DT]


@driver
def density_at(a, clock):
    """The same, for calls from Python."""
    return density(a, clock)


@driver
def step_density_loop(forces, y, before, a, clock, until, end, steps, cursor):
    """Take steps until the clock has reached ``until``, or ``steps`` of them. Return a status, STOPPED if a step would
    differ tenfold from the one before. No force is evaluated beyond ``end``. ``before`` is y at the last step's start,
    ``a`` the accelerations in its middle."""
    bound = handle(forces)
    while cursor[STEP] < steps and clock[TIME] < until:
        tau = 1.0 / clock[DENSITY]
        if clock[TIME] + 0.5 * tau > end:
            return OK
        if cursor[STAGE] == 0:
            before[:] = y
            add_scaled(y[0], 0.5 * tau, y[1])
            cursor[STAGE] = 1
        status = fill_accelerations(bound, clock[TIME] + 0.5 * tau, y[0], y[1], a, None, cursor)
        if status != OK:
            return status
        ahead = 2.0 * density(a, clock) - clock[DENSITY]
        if not clock[DENSITY] < MOST * ahead < MOST**2 * clock[DENSITY]:
            y[:] = before
            cursor[STAGE] = 0
            return STOPPED
        clock[BEFORE], clock[DENSITY_BEFORE] = clock[TIME], clock[DENSITY]
        add_scaled(y[1], 0.5 * (tau + 1.0 / ahead), a)
        add_scaled(y[0], 0.5 / ahead, y[1])
        clock[TIME] += 0.5 * (tau + 1.0 / ahead)
        clock[DENSITY] = ahead
        cursor[STAGE] = 0
        cursor[STEP] += 1
    return OK


class StepDensityStepper(Resumable):
    """Integration whose density of steps is part of the state, and follows from positions only at a start.

    A ``reset`` to the present state, with the same or with negated velocities, keeps the density, so the run continues
    or retraces its path. A checkpoint holds its clock with the density and its scale, and the start of the last step. A
    step cut off at the end (``clip``) is a leapfrog step of that length, and leaves the density unchanged.
    """

    saved = ("_cursor", "_clock", "_extra_evaluations", "_scaled", "_start_of_step", "_last", "_cut")

    def __init__(self, flow: Flow, options: Options) -> None:
        assert options.dt is not None
        self._flow, self.dt = flow, options.dt
        self._cursor = np.zeros(SLOTS, np.int64)
        self._extra_evaluations = 0
        self._clock = np.zeros(6)
        self._clock[DT] = options.dt
        self._scaled = False
        self._last: Floats | None = None  # the step point's y, a private copy
        self.trouble = ""

    def reset(self, y: Floats, time: float, steps: int) -> None:
        last = self._last
        stays = last is not None and np.array_equal(y[0], last[0])
        stays = stays and last is not None and any(np.array_equal(y[1], sign * last[1]) for sign in (1.0, -1.0))
        self.y, self.steps_done = y, steps
        self._start_of_step, self._a = y.copy(), np.zeros(y.shape[1:])
        self._last = y.copy()
        clock = self._clock
        clock[TIME] = clock[BEFORE] = time
        if not stays:
            clock[DENSITY] = 0.0
        self._cut = 0.0  # length of the last step if it was cut off
        self._cursor[STEP:] = 0
        self._flow.forces.forget()

    @property
    def time(self) -> float:
        return float(self._clock[TIME])

    @property
    def last_step(self) -> float:
        return float(self._clock[TIME] - self._clock[BEFORE])

    @property
    def counts(self) -> Counts:
        return Counts(int(self._cursor[EVALUATIONS]) + self._extra_evaluations)

    def _start(self) -> None:
        """Scale the density by the system's start, and compute the present density."""
        clock, flow = self._clock, self._flow
        if not self._scaled:
            begin: Any = flow.subject.state
            clock[SCALE] = crowding(np.ascontiguousarray(flow.derivative(begin.time, flow.array(begin))[-1]))
            self._scaled = True
        here = np.ascontiguousarray(flow.derivative(self.time, self.y)[-1])
        self._extra_evaluations += 2
        value = density_at(here, clock)
        clock[DENSITY] = value if np.isfinite(value) else 1.0 / self.dt  # the first step will report the problem

    def advance(self, steps: int, until: float = np.inf) -> int:
        if self._clock[DENSITY] == 0.0 and steps:
            self._start()
        status = self._flow.forces.call(
            step_density_loop, self.y, self._start_of_step, self._a, self._clock, until, self.end, steps, self._cursor
        )
        taken = int(self._cursor[STEP])
        self.steps_done += taken
        self._cursor[STEP] = 0
        self._cut = 0.0 if taken else self._cut
        if status == OK and self.clip and taken < steps and self.time < until:
            self._cut_off()
        self._last = self.y.copy()
        if status == STOPPED:
            self.trouble = (
                f"the forces changed so much in a step of {1.0 / self._clock[DENSITY]:.3g} that the next would differ "
                f"tenfold; use a fixed-step method if forces vanish on the way or at the start, else a smaller dt than "
                f"{self.dt:g}"
            )
        return status

    def _cut_off(self) -> None:
        """Take a step that ends at ``end``."""
        clock = self._clock
        clock[BEFORE], self._start_of_step, self._cut = clock[TIME], self.y.copy(), self.end - self.time
        clock[TIME] = self.end
        self.y[:] = self._leapt(0.5 * self._cut, 0.5 * self._cut)
        self._extra_evaluations += 1
        self.steps_done += 1

    def at(self, time: float) -> Floats:
        """State at a time, by a part of the last step: one more evaluation, discarded."""
        clock = self._clock
        begin = clock[BEFORE]
        if time == self.time or self.time == begin:
            return self.y.copy()
        part = (time - begin) / (self.time - begin)
        if self._cut:
            return self._leapt(0.5 * part * self._cut, 0.5 * part * self._cut)
        return self._leapt(0.5 * part / clock[DENSITY_BEFORE], 0.5 * part / clock[DENSITY])

    def _leapt(self, first: float, second: float) -> Floats:
        """State after two drifts from the last step's start, with a kick between them."""
        y = self._start_of_step.copy()
        y[0] += first * y[1]
        y[1] += (first + second) * self._flow.derivative(self._clock[BEFORE] + first, y)[-1]
        y[0] += second * y[1]
        return y

    def reached(self, inside_step: bool) -> tuple[Floats, Floats]:
        return self.y, self._start_of_step[0]

"""Many small gravitational systems at once: eight systems side by side in a processor's registers, a lane each.

For one system, a step of three bodies takes longer to organise than to compute. Side by side, the organisation
disappears: every number of the formulas becomes eight, one for each system.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from time import perf_counter
from typing import Any

import numpy as np
from numpy.typing import NDArray

from kickdrift.batch.lane_events import LaneEvents, run_with_events
from kickdrift.batch.members import by_member, common, members_of, momentum_scales, run_lanes, sampled_steps
from kickdrift.engines import NATIVE, engine
from kickdrift.errors import InputError
from kickdrift.integrators.asked import Integrator
from kickdrift.integrators.step_choice.step_length import start_warning
from kickdrift.integrators.stepping.batch_loops import LaneStepper, from_lanes
from kickdrift.jit.cache.notices import compiling_for
from kickdrift.looks.record import BOTH, Record, Series, even_stretch
from kickdrift.model.checks.limits import check_room, whole_number
from kickdrift.model.state import Floats, State
from kickdrift.model.system import System
from kickdrift.run.plan.plan import looks_at
from kickdrift.run.report.report import Report, report
from kickdrift.run.stepping import purpose_of

LOOK_BYTES = 2 * 64  # memory of a member's sample while the pieces become one array


class Batch:
    """Copies of many Systems with equal numbers of bodies, all run with one integrator.

    Each member's results equal a Simulation's up to round-off, since sums have another order. Without chaos the
    difference is less than 4 eps (steps x stages)^1.5 of the largest position and velocity. A member's bits depend only
    on the member: not on the others, their number or its place in the list. A member that blows up leaves the others
    alone, and ``finite`` shows it. ``finite`` also shows a member with bodies at the same place, which a Simulation
    refuses.

    Parameters
    ----------
    systems : Systems with equal numbers of bodies and of steps done, under ``Gravity`` alone, softened or not;
        starts, masses, G, units and softening may differ. With trace, their events with action "stop" end the runs of
        single members, which ``stopped`` shows
    integrator : a splitting, a fixed-step Runge-Kutta method, wisdom-holman, saba or trace; default as in a Simulation
    dt : one step for all, or one for each; default from the system files
    options : as in a Simulation: coordinates, order

    Raises
    ------
    InputError
        Gives the reason of `refusal` and the member, or names the property that differs.
    """

    @np.errstate(all="ignore")  # overflows of members that blow up
    def __init__(
        self,
        systems: Sequence[System],
        integrator: str | Integrator | None = None,
        dt: float | Sequence[float] | Floats | None = None,
        **options: Any,
    ) -> None:
        self.systems = tuple(systems)
        self.integrator, self.method, self.options, self.dt = common(self.systems, integrator, dt, options)
        members = members_of(self.systems, self.dt, np.array([system.state.phase for system in self.systems]))
        self.steps_done = self.systems[0].state.steps_done
        self._start = from_lanes(members.start, len(self.systems))
        self._members = members
        self._stepper: LaneStepper = self.method.in_lanes(members, self.options)
        self._events: LaneEvents | None = None
        if any(system.events for system in self.systems):
            stepper: Any = self._stepper
            own = self.options.extras(self.method.tunable)
            self._events = LaneEvents(self.systems, stepper.order, self.integrator, self.dt, own)
            stepper.watch(self._events)
        self._begun = momentum_scales(self.systems)
        self._steps: list[int] = []
        self._looks: list[Floats] = []  # (k, LOOK, members) from each run
        self._joined: tuple[NDArray[np.int64], slice, Floats] | None = None
        self._taken, self._seconds, self._compiling = 0, 0.0, 0.0

    def __len__(self) -> int:
        return len(self.systems)

    @property
    def time(self) -> Floats:
        """Time of each member (members,) in the systems' unit."""
        return self._start + self._steps_of * self.dt

    @property
    def _steps_of(self) -> NDArray[np.int64]:
        """Step of each member (members,)."""
        found = np.full(len(self), self.steps_done)
        for i, step in self._events.steps.items() if self._events else ():
            found[i] = step
        return found

    @property
    def stopped(self) -> list[str]:
        """Event that ended each member's run, as a text; "" for a member that goes on."""
        return [self._stopped_by(i) for i in range(len(self))]

    def _stopped_by(self, i: int) -> str:
        return self._events.stopped.get(i, "") if self._events else ""

    @property
    def phase(self) -> Floats:
        """Copy of positions and velocities (members, 2, 3, n)."""
        return from_lanes(self._stepper.y, len(self))

    def events(self, i: int) -> list[dict[str, Any]]:
        """Entries in the log of events of member ``i``, as in a Report."""
        return list(self._events.rows.get(i, ())) if self._events else []

    def states(self) -> list[State]:
        """Copies of the State of each member."""
        return [
            replace(system.state.copy(), phase=phase, time=float(time), steps_done=int(done))
            for system, phase, time, done in zip(self.systems, self.phase, self.time, self._steps_of, strict=True)
        ]

    @property
    def finite(self) -> NDArray[np.bool_]:
        """Flag for each member (members,): whether all its present and sampled numbers are finite. Run a member that
        blew up as a Simulation to learn why."""
        found = [np.isfinite(self.phase).all(axis=(1, 2, 3))]
        found += [np.isfinite(looks).all(axis=(0, 1)) for looks in self._looks]
        return np.logical_and.reduce(found)

    def run(self, steps: int, every: int | None = None) -> None:
        """Take ``steps`` steps. Sample energies and momenta at the start, every ``every`` steps (counted from step 0)
        and at the end; default as in ``Simulation.run``. A sample takes 64 bytes a member."""
        steps = whole_number("steps", steps, 0)
        every = whole_number("every", every, 1) if every is not None else None
        known = {system.run.every for system in self.systems}
        if every is None and len(known) > 1:
            raise InputError("every: the systems have different values; give one for all")
        most = looks_at(steps, self.method.evaluations, len(self.systems[0]))
        cadence = every or known.pop() or max(1, steps // most)
        check_room("run", steps / cadence * len(self), "samples", LOOK_BYTES, "give a larger every")
        stops = sampled_steps(self.steps_done, steps, cadence)
        counts = np.diff(stops, prepend=self.steps_done)
        began = perf_counter()
        with compiling_for(purpose_of(self.integrator, self.systems[0])):
            self._stepper.run(0, np.zeros(0, np.int64), self.steps_done)  # compiles the code, unless done before
        compiled = perf_counter()
        self._compiling += compiled - began
        again = bool(self._steps) and self._steps[-1] == self.steps_done
        if self._events:
            self._looks.append(run_with_events(self._stepper, counts[again:], self.steps_done, len(self)))
        else:
            self._looks.append(run_lanes(self._stepper, counts[again:], self.steps_done)[0][:, :, : len(self)])
        self._joined = None
        self._steps += stops[again:].tolist()
        self.steps_done += steps
        self._taken += steps
        self._seconds += perf_counter() - compiled

    def report(self, i: int) -> Report:
        """Report of member ``i``, as from ``Simulation.run``. Its wall time is an equal share of all members' time."""
        if not self._steps:
            raise InputError("report: call run first")
        return report(Member(self, i))

    def reports(self) -> list[Report | None]:
        """Reports of all members; None for a member that blew up."""
        return [self.report(i) if finite else None for i, finite in enumerate(self.finite)]

    @property
    def _samples(self) -> tuple[NDArray[np.int64], slice, Floats]:
        """Steps (k,), their longest even stretch, and samples (members, LOOK, k) of the members."""
        if self._joined is None:
            steps = np.array(self._steps)
            self._joined = steps, even_stretch(steps), by_member(self._looks)
        return self._joined

    def record(self, i: int) -> LaneRecord:
        """Samples of member ``i`` and its cost."""
        steps, even, samples = self._samples
        system, looks, taken = self.systems[i], samples[i], self._taken
        last = self._events.steps.get(i, self.steps_done) if self._events else self.steps_done
        if last < self.steps_done:  # an event has ended the run between two samples
            row = int(np.searchsorted(steps, last))
            steps, looks, taken = np.append(steps[:row], last), looks[:, : row + 1], last - int(steps[0])
            even = even_stretch(steps)
        massive = int(np.count_nonzero(system.state.masses))
        warning = start_warning(system, self.method, float(self.dt[i]))
        series = Series(
            steps=steps,
            times=self._start[i] + steps * self.dt[i],
            total=looks[0] + looks[1],
            final=float(looks[0, -1] + looks[1, -1]),
            kinetic=float(looks[0, 0]),
            momentum=looks[2:5].T,
            angular_momentum=looks[5:8].T,
            kinetics=looks[0],
            pairs=0.5 * massive * (massive - 1) + massive * (len(system) - massive),
            even=even,
        )
        return LaneRecord(
            begun=True,
            momentum_scale=float(self._begun[0][i]),
            angular_momentum_scale=float(self._begun[1][i]),
            steps=taken,
            force_evaluations=self._stepper.evaluations_of(i),
            wall_seconds=self._seconds / len(self),
            compile_seconds=self._compiling / len(self),
            spent={BOTH: self._seconds / len(self)},
            warnings=[*self._stepper.warnings(i), *([warning] if warning else [])],
            found=series,
        )


@dataclass
class LaneRecord(Record):
    """Record whose samples are already arrays."""

    found: Series | None = field(default=None)

    def series(self) -> Series:
        """Series of the samples; see Record."""
        assert self.found is not None
        return self.found


class Member:
    """Member of a Batch in the form of a Simulation, for ``report``."""

    engine, threads, processes = NATIVE, 1, 1
    state: Any = None  # needed for reports of Problems

    def __init__(self, batch: Batch, i: int) -> None:
        self.system, self.record, self.stopped = batch.systems[i], batch.record(i), batch._stopped_by(i)
        self.integrator, self.method, self.dt = batch.integrator, batch.method, float(batch.dt[i])
        self.options = batch.options.changed(dt=self.dt)
        self.engine_version = engine(NATIVE).version
        self.events: list[dict[str, Any]] = batch.events(i)

    def going_on(self) -> list[dict[str, Any]]:
        """Return no events."""
        return []

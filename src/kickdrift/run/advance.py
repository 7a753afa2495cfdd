"""An integration in progress: flow, stepper, current state, and steps without a look."""

from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import replace
from threading import RLock
from time import perf_counter
from typing import Any, NoReturn

import numpy as np

from kickdrift.disk.interrupt import interruptible
from kickdrift.engines import Engine
from kickdrift.engines.job import Job
from kickdrift.engines.session import RunFlow
from kickdrift.errors import InputError, RunError
from kickdrift.forces.seam.kernel import OK
from kickdrift.integrators.flows.particle_flow import ParticleFlow
from kickdrift.integrators.options import PAIRS, PRESSURE, RAMP_STEPS, REGULARISED, Options
from kickdrift.integrators.stepping.backward import BackwardStepper, mirrored
from kickdrift.integrators.stepping.stepper import STOPPED, Stepper
from kickdrift.jit.cache.notices import compiling_for
from kickdrift.looks.observers import Sample
from kickdrift.looks.record import Record
from kickdrift.model.box.box import Box
from kickdrift.model.checks.values import no_overflow
from kickdrift.model.events.events import Escape, Event
from kickdrift.model.memory import Memory
from kickdrift.model.problem import Problem
from kickdrift.model.starts.builders import check_overlaps
from kickdrift.model.state import Floats
from kickdrift.model.system import System
from kickdrift.run.ramp import Ramp
from kickdrift.run.report.pairs import pair_rows
from kickdrift.run.returning import Safe, failure, go_back
from kickdrift.run.stepping import Shortened, purpose_of, stepping
from kickdrift.run.watch.watched_stepper import WatchedStepper

CHUNK_SECONDS = 0.1  # time in compiled code between two checks for Ctrl-C


class Integration:
    """A System or a Problem with its method: the part of a Simulation that takes steps.

    Attributes
    ----------
    method, options, dt, engine
        The Simulation's.
    system : System or Problem
        The current bodies; events may remove some.
    flow : RunFlow
        y' = f(t, y).
    stepper : Stepper
        The method's stepper; with events, the `WatchedStepper` around it.
    events : WatchedStepper or None
        The stepper, if there are events.
    watched : tuple of Event
        What the stepper searches for.
    record : Record
        The run's cost and samples.
    at : float or None
        The current time if it lies inside a step; None at the stepper's own step point.
    safe : Safe
        The last good state.
    chunk : int
        Number of steps that compiled code takes in about a tenth of a second.
    running : bool
        Whether steps are being taken. Meanwhile the state cannot be replaced.
    lock : RLock
        Held by the thread that uses the Simulation; see `run.present.alone`.
    pressed, ended : callable, str
        Whether Ctrl-C was pressed in this run; who else ended the run, "" if nobody did.
    replaced : bool
        Whether the state was replaced since a file was begun. A file that continues needs a new checkpoint then.
    changes : int
        Number of changes of the bodies by events.
    """

    def __init__(self, job: Job, engine: Engine, events: Sequence[Event]) -> None:
        self.method, self.options, self.dt = job.method, job.options, job.options.dt
        self.ramp = Ramp.of(job.options)
        if self.ramp and engine.foreign:
            raise InputError(f"engine {engine.name!r}: ramps of temperature and pressure are kickdrift's own")
        self._job, self.engine = job, engine
        self.record = Record()
        with compiling_for(self.purpose):
            self.stepper: Stepper | WatchedStepper = self.stepper_for(job.system)
        self.events: WatchedStepper | None = None
        if events and self.method.bath:
            raise InputError(
                f"events: {self.integrator} has a heat bath, which changes velocities inside steps; "
                "take a method without one"
            )
        if job.options.get(PAIRS.name) == REGULARISED and any(event.kind != Escape.kind for event in events):
            raise InputError(
                "pairs: one step of a regularised pair may be many orbits, in which no event can be searched; take "
                "pairs = plain, or an escape alone"
            )
        self.watched = tuple(events)
        if events and not self.method.bounces:
            self.stepper = self.events = WatchedStepper(self, self.stepper, events)
        self.chunk, self.changes, self.lock = 1, 0, RLock()
        self.running, self.replaced, self.ended = False, True, ""
        self.pressed: Callable[[], bool] = bool
        self._from_start = False  # whether the first step begins at the System's own positions
        self.at: float | None = None
        self._present: tuple[float, Floats, float | None] | None = None  # time inside a step, y and heat at that time
        self._compiled = False

    def stepper_for(self, system: Any) -> Stepper:
        """Make ``system`` the integration's bodies, and return the method's stepper for them."""
        self.system: System | Problem = system
        self.flow: RunFlow
        self._shortened = Shortened()
        self.flow, stepper = self._made(system, self.options)
        return stepper

    def _made(self, system: Any, options: Options) -> tuple[RunFlow, Any]:
        """A flow of ``system`` and the method's stepper for it."""
        return stepping(self.engine, replace(self._job, system=system, options=options))

    @property
    def integrator(self) -> str:
        """The method's name, as the user gave it."""
        return self._job.named

    @property
    def purpose(self) -> str:
        """The purpose of compiled code: the method, and the forces or the Problem."""
        return purpose_of(self.integrator, self._job.system)

    @property
    def threads(self) -> int:
        return self._job.threads

    @property
    def processes(self) -> int:
        return self._job.processes

    @property
    def heat(self) -> float | None:
        """Energy that a heat bath has given; None without a bath and where the engine does not tell it."""
        if not self.method.bath:
            return None
        if self.at is None:
            return self.stepper.heat  # type: ignore[union-attr]
        return self._inside[2]

    @property
    def box_varies(self) -> bool:
        """Whether a barostat changes the box."""
        return self._job.options.get(PRESSURE.name) is not None

    def ramp_over(self, steps: int) -> None:
        """Let a ramp without a length of its own end at this step of the run."""
        if self.ramp and self.ramp.steps is None and steps > 0:
            self.options = self.options.changed(**{RAMP_STEPS.name: steps})
            self._job, self.ramp = replace(self._job, options=self.options), Ramp.of(self.options)

    @property
    def foreign(self) -> bool:
        """Whether another program takes the steps."""
        return self.engine.foreign

    # --- direction ---

    @property
    def backward(self) -> bool:
        """Whether the stepper goes back in time."""
        return isinstance(self.stepper, BackwardStepper)

    def turn(self, backward: bool) -> None:
        """Go on from the current state in this direction of time. A change of direction begins a new record."""
        if backward == self.backward:
            return
        if backward and self.ramp:
            raise InputError("run: a ramp of temperature or pressure goes forwards in time only")
        y, time, steps = self.y.copy(), self.time, self.steps_done
        old: Any = self.stepper
        with compiling_for(self.purpose):
            flow, self.stepper = self.stepper_in(backward, self.options)
            self._shortened = Shortened()
        self.flow = self.flow if backward else flow
        self._reset(y, time, steps)
        if hasattr(old, "method_state"):
            self.stepper_with_state.method_state = old.method_state
        self._compiled = False
        self.begin_record()

    def stepper_in(self, backward: bool, options: Options) -> tuple[RunFlow, Any]:
        """A flow of the current bodies in this direction of time, and a new stepper."""
        flow, stepper = self._made(mirrored(self.system) if backward else self.system, options)
        return flow, BackwardStepper(stepper, flow) if backward else stepper

    @property
    def moving(self) -> RunFlow:
        """The flow of the steps: the run's own, or in a run back in time the flow of the mirrored motion."""
        stepper = self.stepper
        return stepper.flow if isinstance(stepper, BackwardStepper) else self.flow

    def _reset(self, y: Floats, time: float, steps: int) -> None:
        """Start the stepper anew at y."""
        flow = self.moving
        if self.dt is not None and isinstance(flow, ParticleFlow):
            flow.tune(y, self.dt / max(1, self.method.evaluations))
        with no_overflow():
            self.stepper.reset(y, time, steps)
        self.at = self._present = None

    # --- current state ---

    @property
    def time(self) -> float:
        return self.stepper.time if self.at is None else self.at

    @property
    def steps_done(self) -> int:
        """Number of steps since the start, including a step that the current time lies inside."""
        return self.stepper.steps_done + int(self.at is not None and self._beyond(self.at))

    def _beyond(self, time: float) -> bool:
        """Whether a time lies beyond the stepper's step point, in the direction of the run."""
        return time < self.stepper.time if self.backward else time > self.stepper.time

    @property
    def y(self) -> Floats:
        """y at the current time. Only the stepper may write into it."""
        return self.stepper.y if self.at is None else self._inside[1]

    @property
    def _inside(self) -> tuple[float, Floats, float | None]:
        """The current time inside a step, and y and the heat there."""
        assert self.at is not None
        if self._present is None or self._present[0] != self.at:
            if self._beyond(self.at):
                self.look_ahead(self.at, over=bool)
            else:
                self._present = self.at, self.stepper.at(self.at), None
        assert self._present is not None
        return self._present

    @property
    def state(self) -> Any:
        return self.flow.state(self.y, self.time, self.steps_done)

    @property
    def fresh(self) -> bool:
        """Whether the run last evaluated its forces at the current time."""
        return self.at is None and getattr(self.stepper, "fresh", False)

    def begin_at(self, state: Any) -> None:
        """Start again from a state, with a new record."""
        y = self.flow.array(state)
        if self.box_varies:
            self.flow.box = state.box  # type: ignore[union-attr]
        self._from_start = isinstance(self.system, System) and np.array_equal(y[0], self.system.state.phase[0])
        self._reset(y, state.time, state.steps_done)
        self.begin_record()

    def begin_record(self) -> None:
        """Start the record of conservation and cost again, from a state that the user has set."""
        self.record, self.replaced = Record(backward=self.backward), True
        self.keep()

    @property
    def stepper_with_state(self) -> Any:
        """The method's stepper, if it has a state beyond positions and velocities; else raises InputError."""
        stepper = self.events.inner if self.events else self.stepper
        if not hasattr(stepper, "method_state"):
            raise InputError(f"method_state: {self.integrator} has no method state; leapfrog-exact has one")
        return stepper

    def begin_with(self, method_state: Any) -> None:
        """Start again from a method state, with a new record."""
        self.stepper_with_state.method_state = method_state
        if self.events:
            self.events.forget()
        self.begin_record()

    def recall(self, checkpoint: Memory) -> None:
        self._from_start = False
        self.turn(bool(checkpoint["record"].get("backward", False)))
        self.stepper.recall(checkpoint["stepper"])
        self.at, self._present = checkpoint["present"], None
        self.record, self.replaced = Record.recalled(checkpoint["record"]), True
        self.keep()

    def keep(self) -> None:
        """Store the current state as the last good state."""
        self.safe = Safe(self.y.copy(), self.time, self.steps_done, self.box)

    def sample(self) -> Sample:
        found = self.flow.sample(self.y, self.time, self.steps_done, self.fresh)
        return replace(found, pressure=self._pressure_of_spheres()) if self.method.bounces else found

    def _pressure_of_spheres(self) -> float:
        """Pressure of hard spheres: of the motion, and of the hits since the look before, or without one since the
        state was set. At a look this is its pressure. Before all steps and looks, and where a checkpoint was restored,
        this is nan."""
        hits, system = self.stepper.hits, self.system  # type: ignore[union-attr]
        begun, virial = self.record.hits or (hits.time - hits.span, 0.0)
        if hits.time == begun:
            return float(self.record.samples[-1].pressure) if self.record.hits and self.record.samples else np.nan
        moving = self.flow.pressure_of_motion(self.y, self.time)  # type: ignore[union-attr]
        return moving + (hits.virial - virial) / ((hits.time - begun) * system.dimensions * system.volume)  # type: ignore[union-attr]

    def rescale_velocities(self, factor: float, motion: Floats | None = None) -> None:
        """Multiply the velocities of all particles by ``factor``, relative to ``motion`` (3, n) if there is one. Forces
        at these positions stay valid."""
        self.turn(backward=False)
        stepper = self.stepper
        stepper.y[1] *= factor
        if motion is not None:
            stepper.y[1] += (1.0 - factor) * motion
        if (fixed := getattr(self.system, "fixed", None)) is not None:
            stepper.y[1][:, fixed.particles] = fixed.velocities
        if self.foreign:
            stepper.reset(stepper.y, stepper.time, stepper.steps_done)  # passes the velocities to the program

    @property
    def box(self) -> Box | None:
        """The box now, if a barostat changes the box; else None."""
        return self.flow.box if self.box_varies else None  # type: ignore[union-attr]

    # --- steps ---

    @contextmanager
    def busy(self) -> Iterator[Callable[[], bool]]:
        """Forbid replacing the state, and defer Ctrl-C: the yielded function tells whether Ctrl-C was pressed."""
        self.running = True
        try:
            with interruptible() as interrupted:
                self.pressed = interrupted
                yield interrupted
        finally:
            self.running = False

    def prepare(self) -> None:
        """Compile the code for steps and looks; this time does not count as the run's.

        Raises InputError if the run begins at the System's own positions and particles overlap there."""
        if self._compiled:
            return
        if self._from_start:
            with no_overflow():
                check_overlaps(self.system)  # type: ignore[arg-type]
            self._from_start = False
        began = perf_counter()
        with compiling_for(self.purpose):
            self.stepper.advance(0, self.time)
            self.flow.prepare(self.stepper.y, self.time)
        self._compiled = True
        self.record.compile_seconds += perf_counter() - began

    def advance(self, steps: int, until: float = np.inf, horizon: float = np.inf, end: float = np.inf) -> bool:
        """Take steps, or fewer where a ramp changes the temperature before. Return whether the next step waits because
        it would evaluate f beyond ``end``."""
        began = perf_counter()
        if self.ramp:
            steps = self.ramp.begin(self.stepper, steps)
        if self.events:
            self.events.horizon = horizon
        stepper: Any = self.stepper
        limited = self.method.chooses_steps and not self.foreign and self.moving.clocked
        if limited:
            stepper.end = end
        self.record.steps += stepper.steps_done - self.steps_done  # a step that was begun counts again
        before, counts = stepper.steps_done, stepper.counts
        self.moving.forget_errors()
        try:
            status = stepper.advance(steps, until)
        except RunError as error:
            self._fall_back(error)
            raise
        self.at, self._present, self.record.unfinished = None, None, 0.0
        self.record.steps += stepper.steps_done - before
        self.record.count(stepper.counts - counts)
        if hasattr(stepper, "changes") and isinstance(self.system, System):
            self.record.events += pair_rows(self.system, stepper)
        if status != OK or not (self.foreign or np.isfinite(stepper.y).all()):  # other programs check their own numbers
            self.fail(inside_step=status != OK, stopped=status == STOPPED)
        if stepper.steps_done == before:
            return limited and not self.events and steps > 0 and (self._beyond(until) or np.isinf(until))
        self.pace(stepper.steps_done - before, perf_counter() - began)
        return False

    def pace(self, steps: int, elapsed: float) -> None:
        """Set ``chunk`` so that one call of compiled code takes about CHUNK_SECONDS, as ``steps`` took ``elapsed``."""
        self.chunk = max(1, min(int(steps * CHUNK_SECONDS / max(elapsed, 1e-9)), 8 * self.chunk, 10**6))

    def look_ahead(self, time: float, counted: bool = False, over: Callable[[], bool] | None = None) -> None:
        """Set the current time inside the next step, but do not take that step: it leads beyond the end.

        With fixed steps, a shortened step of another stepper gives y at that time. ``over`` tells whether to give up
        and to stay at the step point, as after Ctrl-C in a run."""
        stepper: Any = self.stepper
        self.moving.forget_errors()
        over = over or (self.pressed if self.running else bool)
        status, y, cost = stepper.ahead(time, over) if self.method.chooses_steps else self._shortened.step(self, time)
        if status == OK and self.method.chooses_steps and over():
            self.at = self._present = None
            return
        if status != OK or not np.isfinite(y).all():
            self.at = self._present = None
            self.fail(inside_step=status != OK, stopped=status == STOPPED)
        if self.at is None or not self._beyond(self.at):
            self.record.steps += 1
        if counted:
            self.record.count(cost)
        self.at, self._present = time, (time, y, self._shortened.heat)

    def fail(self, inside_step: bool, stopped: bool = False) -> NoReturn:
        """Go back to the last good state, and raise an error that says what blew up.

        With ``inside_step``, the current step failed; otherwise the last completed step did."""
        error, cause = failure(self, inside_step, stopped)
        self.record.steps -= self.stepper.steps_done - self.safe.step
        go_back(self)
        raise error from cause

    def _fall_back(self, error: RunError) -> None:
        """Go back to the last good state after an event that could not act, and note that state in the error."""
        safe = self.safe
        if self.events and error.state is None and safe.y.shape == self.stepper.y.shape:
            error.state = self.flow.state(safe.y, safe.time, safe.step)
            go_back(self)

    # --- for events ---

    def sample_at(self, y: Floats, time: float) -> Sample:
        return self.flow.sample(y, time, self.steps_done)

    def bodies_changed(self) -> None:
        """Record that an event changed the bodies; a failed run never goes back before this point."""
        self.at = self._present = None
        self.changes += 1
        self.keep()

"""A Simulation: how a System or a Problem is run."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager, nullcontext
from time import perf_counter
from typing import TYPE_CHECKING, Any, NamedTuple, NoReturn

import numpy as np

from kickdrift.disk.files import place
from kickdrift.disk.interrupt import interruptible
from kickdrift.engines import engine as engine_named
from kickdrift.engines.session import Job, begin
from kickdrift.errors import InputError, RunError
from kickdrift.forces.bound import check_threads
from kickdrift.forces.kernel import OK
from kickdrift.integrators import integrator as method_named
from kickdrift.integrators.asked import Integrator, settled, unpacked
from kickdrift.integrators.flow import Flow, ParticleFlow, flow_of
from kickdrift.integrators.option import MIXED
from kickdrift.integrators.stepping import STOPPED, Counts, Stepper
from kickdrift.jit.compile import features, processor
from kickdrift.looks.observers import Energies, Sample
from kickdrift.looks.record import Record
from kickdrift.model.capacity import PROCESS_BYTES, check_room
from kickdrift.model.checks import no_overflow, path_text, unwarned, whole_number
from kickdrift.model.events import checked_events
from kickdrift.model.memory import Memory
from kickdrift.model.problem import Problem
from kickdrift.model.state import Floats, read_only
from kickdrift.model.system import System
from kickdrift.model.units import shown
from kickdrift.run.lookout import Lookout
from kickdrift.run.plan import Plan, plan_of, steps_to
from kickdrift.run.report import Report, report
from kickdrift.run.watch.watching import WatchedStepper

if TYPE_CHECKING:
    from kickdrift.integrators.exact import Lattice
    from kickdrift.model.events import Event
    from kickdrift.trajectory.h5md import Writer
    from kickdrift.trajectory.options import FileOptions

CHUNK_SECONDS = 0.1  # how long compiled code runs before Python looks for Ctrl-C

Observer = Callable[["Simulation"], Any]


class Simulation:
    """Runs a copy of a System, or a Problem, with an integrator.

    Parameters
    ----------
    system : System or Problem
    integrator : name, see ``kickdrift.integrators()``, or a value that ``kickdrift.integrator`` makes; default the
        system file's, else "velocity-verlet" for particles and "dormand-prince45" for a Problem
    dt : step in the system's unit of time; default the system file's. For an adaptive method the first step, optional
    threads : of the forces; the results do not depend on it, bit by bit
    engine : the program that runs it, see ``kickdrift.engines()``: "native", or another that is installed
    processes : of an engine that runs on several ("lammps")
    events : what to watch for (`CloseApproach`, `Collision`, `Escape`, `Crossing`); default the system file's
    options : what the integrator takes, such as ``rtol=1e-10`` or ``corrector=17``; `kickdrift list integrators NAME`
        explains them. Options given here come first, then those of an integrator's value, then the system file's.
        Every integrator takes ``precision``, which is of pair forces: "double" (float64, default) or "mixed" (pairs in
        float32, all else in float64). With "mixed", forces in a liquid are off by about 2e-7 of a typical one for each
        sigma of the box's edge (or of the extent, in open space). Reported energies are float64's

    Raises
    ------
    InputError
        Where an argument makes no sense, and where the engine cannot run that, or is not installed.
    """

    def __init__(
        self,
        system: System | Problem,
        integrator: str | Integrator | None = None,
        dt: float | None = None,
        threads: int = 1,
        *,
        engine: str = "native",
        processes: int = 1,
        events: Iterable[Event] | None = None,
        **options: Any,
    ) -> None:
        if not isinstance(system, System | Problem):
            raise InputError(f"a Simulation takes a System or a Problem, got {_kind_of(system)}")
        self._engine = engine_named(engine)
        default = "velocity-verlet" if isinstance(system, System) else "dormand-prince45"
        name, asked = unpacked(integrator, {"dt": dt, **options})
        named = name if name is not None else system.run.integrator
        self.integrator = default if named is None else self._engine.method_name(named)
        self.method = method_named(self.integrator)
        self.options = settled(self.method, asked, system.run)
        self.dt = self.options.dt
        if self.dt is None and self.method.needs_dt:
            raise InputError(f"dt is needed: system {system.name!r} names none in [run]")
        self.threads = check_threads(threads)
        self.processes = whole_number("processes", processes, 1)
        if self.processes > 1:
            check_room("run", self.processes, "processes", PROCESS_BYTES, "give fewer")
        if isinstance(system, System):
            system = system if events is None else system.watched(events)
            watched: tuple[Event, ...] = system.events
        else:
            watched = checked_events(system, events or ())
        if self._engine.foreign or self.processes > 1:
            self._engine.check(self._job(system))
        self._stepper: Stepper | WatchedStepper = self.stepper_for(system)
        self._watching: WatchedStepper | None = None
        if watched:
            self._stepper = self._watching = WatchedStepper(self, self._stepper, watched)
        self._lookout = Lookout(self, self._engine.foreign)
        self._chunk = 1
        self._compiled = 0  # 1: all that steps and a look need; 2: and what many looks in a row do
        self.running = False
        self.output: str | None = None  # the file that `run` writes to unless told, of a run that was taken up again
        self.plan: Plan | None = None  # what `run` goes on with where it is told nothing
        self._files: dict[str, Own] = {}  # files that this Simulation began, or goes on into
        self.state = system.state

    # --- state ---

    @property
    def state(self) -> Any:
        """The State (positions, velocities, time) or ProblemState (y, time); a copy. Setting it starts a new record of
        what is conserved; a run in progress refuses that, and so does a state of other particles than the system's.

        An adaptive run's own step point may lie before or past ``time``. The run goes on from that step point, whatever
        was looked at."""
        return self._flow.state(self._now(), self.time, self.steps_done)

    @state.setter
    def state(self, state: Any) -> None:
        if self.running:
            raise InputError("state: is read-only while the Simulation runs")
        y = self._flow.array(state)
        if self.dt is not None and isinstance(self._flow, ParticleFlow) and not self._engine.foreign:
            self._flow.tune(y, self.dt / max(1, self.method.evaluations))
        with no_overflow():
            self._stepper.reset(y, state.time, state.steps_done)
        self._at: float | None = None  # the present, where it lies before the stepper's last step point
        self._present: tuple[float, Floats] | None = None  # and y there, once it was looked at
        self.record = Record()
        self._replaced = True  # a file that goes on with this cannot be replayed from what it has
        self._lookout.begin(check_at=self.record.steps)

    def checkpoint(self) -> Memory:
        """All that the rest of the run depends on, by value: arrays, numbers, texts, None, and lists and dicts of these
        by text. ``restore`` takes it, in another process too, and what follows then has the bits of this run.

        That is: the method and its options; the stepper's own memory (see the integrators' pages), pair lists
        included; the present, where it lies inside a step; what events are under way, and the bodies that are left;
        and the record but for its samples. It may be taken at any look, and changes nothing."""
        return {
            "step": self.steps_done,
            "time": self.time,
            "integrator": self.method.name,
            "options": dict(self.options),
            "stepper": self._stepper.memory(),
            "present": self._at,
            "record": self.record.memory(),
        }

    def restore(self, checkpoint: Memory) -> None:
        """Go on where ``checkpoint`` was taken, of a Simulation of the same system, method, options and events; the
        number of threads may be another. The record's samples are left out: what is looked at from here on follows.

        Raises InputError where method, options or bodies are others, where the checkpoint is damaged, and while a run
        goes on."""
        if self.running:
            raise InputError("restore: the Simulation runs")
        try:
            self._restore(checkpoint)
        except InputError:
            raise
        except (ArithmeticError, AttributeError, LookupError, TypeError, ValueError, MemoryError) as error:
            why = " ".join(f"{type(error).__name__}: {error}".split())
            raise InputError(f"checkpoint: does not fit a run of this system: {why[:200]}") from None

    def _restore(self, checkpoint: Memory) -> None:
        own = {"integrator": self.method.name, **self.options}
        for key, value in {"integrator": checkpoint["integrator"], **checkpoint["options"]}.items():
            if own.get(key) != (tuple(value) if isinstance(value, list) else value):
                raise InputError(f"checkpoint: {key} is {value!r} there, and {own.get(key)!r} here")
        there, here = checkpoint["stepper"]["y"].shape, self._stepper.y.shape
        if there != here and not self._watching:
            raise InputError(f"checkpoint: holds {there[-1]} particles or unknowns, and the system {here[-1]}")
        self._stepper.recall(checkpoint["stepper"])
        self._at, self._present = checkpoint["present"], None
        self.record = Record.recalled(checkpoint["record"])
        self._replaced = True
        self._lookout.begin(check_at=2 * self.record.steps)

    @property
    def lattice(self) -> Lattice:
        """The whole numbers that leapfrog-exact moves, a copy; ``state`` shows them rounded to floats. Setting it takes
        a run up again to the last bit, and ``sim.lattice = sim.lattice.reversed()`` turns it around."""
        return self._exact().lattice

    @lattice.setter
    def lattice(self, lattice: Lattice) -> None:
        if self.running:
            raise InputError("lattice: is read-only while the Simulation runs")
        self._exact().lattice = lattice
        if self._watching:
            self._watching.begin()
        self._replaced = True
        self.record = Record()
        self._lookout.keep()

    def _exact(self) -> Any:
        stepper = self._watching.inner if self._watching else self._stepper
        if not hasattr(stepper, "lattice"):
            raise InputError(f"lattice: {self.integrator} has none; leapfrog-exact has")
        return stepper

    @property
    def time(self) -> float:
        """In the system's unit."""
        return self._stepper.time if self._at is None else self._at

    @property
    def steps_done(self) -> int:
        """Steps since the start; where the present lies inside one, that one counts."""
        return self._stepper.steps_done + (self._at is not None and self._at > self._stepper.time)

    def _now(self) -> Floats:
        if self._at is None:
            return self._stepper.y
        if self._present is None or self._present[0] != self._at:
            if self._at > self._stepper.time:
                self._look_ahead(self._at)
            else:
                self._present = self._at, self._stepper.at(self._at)
        assert self._present is not None
        return self._present[1]

    def energy(self) -> Energies:
        """Kinetic, potential and total energy now, in the system's units."""
        return self.sample().energies

    def forces(self) -> Floats:
        """(n, 3) forces on the particles now, in the system's energy unit per length; a read-only copy."""
        if not isinstance(self._flow, ParticleFlow):
            raise InputError("forces: a Problem has none")
        accelerations = self._flow.accelerations(self._now(), self.time)
        if accelerations is None:
            raise RunError(f"step {self.steps_done}: the forces at these positions are not finite")
        return read_only((accelerations * self._flow.subject.coherent_masses).T.copy())

    def sample(self) -> Sample:
        """All that is watched, now."""
        fresh = self._at is None and getattr(self._stepper, "fresh", False)
        return self._flow.sample(self._now(), self.time, self.steps_done, fresh)

    @property
    def events(self) -> list[dict[str, Any]]:
        """What was seen so far of the events watched for, in the order in which it came to be known: a copy. Of each
        kind, time, step (in which it was), bodies, ids, distance, energy that it took out, and what was done."""
        return [dict(row) for row in self.record.events]

    def report(self) -> Report:
        """How well the run conserved energy and momentum so far, and what it cost."""
        if not self.record.looks:
            self._look()
        return report(self)

    # --- running ---

    def run(
        self,
        steps: int | None = None,
        *,
        until: float | None = None,
        every: int | None = None,
        interval: float | None = None,
        output: str | os.PathLike[str] | None = None,
        overwrite: bool = False,
        file: FileOptions | None = None,
        observe: Observer | None = None,
        progress: Callable[[int, int], Any] | None = None,
    ) -> Report:
        """Take ``steps`` steps, or go on ``until`` a time: on the grid of whole steps, or any for an adaptive method.

        Every ``every`` steps (counted from step 0), at the start and at the end the energies are sampled, a frame goes
        to ``output`` (a new .h5md file, or one that this Simulation began) and ``observe(sim)`` is called. An adaptive
        run may ask for that at every ``interval`` of time instead; the steps do not change by it. ``file`` says how the
        output is written: how often it is flushed, its precision, compression, forces and images.
        Without ``every`` the system file's counts, or that of the file that the run goes on into. Where nothing says
        how often, there are about 1000 looks; in a run of fewer than 100,000 evaluations of the forces, one for each
        100 of them, but at least 16000 / bodies or 50 (as far as there are steps). That depends on the run alone.
        ``progress(done, of)`` is called now and then. Ctrl-C ends the run cleanly with a KeyboardInterrupt: what was
        done stays done, and the file is whole.

        Returns the Report. Raises InputError for arguments that make no sense, and RunError where the run blows up; the
        state is then that of the last sample.
        """
        for key, function in (("observe", observe), ("progress", progress)):
            if not (function is None or callable(function)):
                raise InputError(f"run: {key} must be a function, got {shown(function)}")
        if not isinstance(overwrite, bool | np.bool_):
            raise InputError(f"run: overwrite must be True or False, got {shown(overwrite)}")
        output = None if output is None else path_text("run: output", output)
        if output is None:
            output = self.output
            if output and (overwrite or not os.path.exists(output)):
                why = "is what this run goes on into" if overwrite else "is gone, and this run goes on into it"
                raise InputError(f"{output}: {why}; give another output")
        own = self._files.get(os.path.realpath(output or "")) or self._files.get(self.output or "")
        if self.plan is not None and (steps, until, every, interval) == (None,) * 4:
            plan = self.plan
        else:
            seen = isinstance(self.system, System) or self.system.energy is not None or observe is not None
            if own and self.method.chooses_steps and (steps, every, interval) == (None,) * 3:
                interval = own.interval
            plan = plan_of(self, steps, until, every, interval, own.every if own else None, seen)
        self.plan = None
        alone = output is None and not (observe or self._watching)  # nobody but the record looks
        self._prepare(plan if alone else None)
        if self._watching:
            self._watching.stopped = ""
        with self._busy() as interrupted, self._writer(output, plan, overwrite, file) as writer:
            if self._watching:
                self._watching.writer = writer
                if writer:
                    writer.absorbed = self._watching.absorbed
            self._look(writer, observe, again=False)
            self._lookout.check_step()
            if writer and self._replaced:
                writer.flush(final=True, anew=True)
            self._replaced = False if writer else self._replaced
            began = perf_counter()
            spent_before = self.record.wall_seconds
            looked = True
            while not (plan.over(self) or interrupted() or self.stopped):
                if alone and (count := self._lookout.alone(plan, self._chunk)):
                    self._series(plan, count)
                    self.record.wall_seconds = spent_before + perf_counter() - began
                    looked = self._at is None and self.record.looks.at(self.steps_done, self.time)
                    if progress:
                        progress(*plan.progress(self))
                    continue
                stop, stop_time = plan.next_stop(self)
                steps = min(self._chunk, stop - self._stepper.steps_done)
                held = self._advance(steps, stop_time, plan.horizon(stop_time), plan.end_time)
                if held:
                    self._look_ahead(plan.horizon(stop_time), counted=plan.horizon(stop_time) == plan.end_time)
                else:
                    self._at = plan.present(self._stepper.time, stop_time)
                self.record.wall_seconds = spent_before + perf_counter() - began
                looked = held or self.steps_done == stop or self._stepper.time >= stop_time
                if looked:
                    self._look(writer, observe)
                elif writer:
                    writer.flush_if_due()
                if progress:
                    progress(*plan.progress(self))
            if not looked:
                self._look(writer, observe)
            self._lookout.warn()
            found = self.report()
            if writer:
                writer.report = found.as_json()
                writer.report["events"] = self.going_on()  # the others stand in the file already
        if interrupted():
            raise KeyboardInterrupt
        return found

    def go_to(self, step: int, time: float | None = None, end: float = np.inf) -> None:
        """Run to a step without a look; an adaptive method to a ``time`` inside the step that leads there. ``end`` is
        where the run was to end."""
        self._prepare()
        horizon, held = (np.inf if time is None else time), False
        with self._busy() as interrupted:
            while self.steps_done < step and not (held or interrupted()):
                if self._watching:
                    self._watching.stopped = ""  # a run that an event ended, and that was continued
                held = self._advance(min(self._chunk, step - self._stepper.steps_done), horizon=horizon, end=end)
                if self._stepper.time - self._stepper.last_step > horizon + 1e-9 * abs(horizon):
                    raise InputError(f"step {step}: is not at time {horizon:g}, which lies at step {self.steps_done}")
        if interrupted():
            raise KeyboardInterrupt
        if time is not None and (held or self._stepper.time > time):
            self._at = time
        self._lookout.keep()

    def continue_in(self, path: str, run_id: str, every: int, plan: Plan | None) -> None:
        """Go on into a file that another Simulation of the same run began, by its plan unless told otherwise."""
        self.output, self.plan = path, plan
        self._replaced = False
        self._files[path] = Own.of(run_id, every, plan)

    def equilibrate(
        self,
        temperature: float,
        time: float,
        interval: int = 10,
        progress: Callable[[int, int], Any] | None = None,
    ) -> None:
        """Bring the system to ``temperature`` in ``time``, and start counting steps, time and conservation anew.

        Velocities are rescaled to the temperature every ``interval`` steps (Woodcock 1971,
        doi:10.1016/0009-2614(71)80281-6). At the end they are rescaled once more, so that the total energy is the mean
        over the second half, K(T) + <U>: the run that follows, at constant energy, then has the temperature as its mean
        and not just as its start. An adaptive method leaves this to velocity Verlet with the system file's dt.
        """
        from kickdrift.run.equilibration import equilibrate

        equilibrate(self, temperature, time, interval, progress)

    @contextmanager
    def _busy(self) -> Iterator[Callable[[], bool]]:
        """Inside, the state cannot be replaced, and Ctrl-C only sets what the function yielded returns."""
        self.running = True
        try:
            with interruptible() as interrupted:
                yield interrupted
        finally:
            self.running = False

    def steps_to(self, steps: int | None = None, until: float | None = None) -> int:
        """How many steps ``run(steps)`` or ``run(until=…)`` would take now; an InputError where that makes no sense, or
        where only the run can tell (an adaptive one until a time)."""
        return steps_to(self, steps, until)

    def _prepare(self, alone: Plan | None = None) -> None:
        """Compile what the run needs, so that its time does not count as the run's; what many looks in a row need, too,
        where nobody else looks at it."""
        level = 1 if alone is None else 2
        if self._compiled >= level:
            return
        began = perf_counter()
        if not self._compiled:
            self._stepper.advance(0, self.time)
            self._flow.prepare(self._stepper.y, self.time)
        if alone:
            self._lookout.prepare(alone)
        self._compiled = level
        self.record.compile_seconds += perf_counter() - began

    def _advance(self, steps: int, until: float = np.inf, horizon: float = np.inf, end: float = np.inf) -> bool:
        """Take steps; whether the next one is held back, because it would take f beyond the ``end``."""
        began = perf_counter()
        if self._watching:
            self._watching.horizon = horizon
        stepper: Any = self._stepper
        limited = self.method.chooses_steps and not self._engine.foreign and self._flow.clocked
        if limited:
            stepper.end = end
        self.record.steps += stepper.steps_done - self.steps_done  # a step that was begun is counted anew
        before, counts = stepper.steps_done, stepper.counts
        self._flow.forget_errors()
        status = stepper.advance(steps, until)
        self._at = self._present = None
        self.record.steps += stepper.steps_done - before
        self._count(stepper.counts - counts)
        if status != OK or not (self._engine.foreign or np.isfinite(stepper.y).all()):  # the others look themselves
            self._fail(inside_step=status != OK, stopped=status == STOPPED)
        if stepper.steps_done == before:
            return limited and not self._watching and steps > 0 and stepper.time < until
        self._pace(perf_counter() - began)
        return False

    def _pace(self, elapsed: float) -> None:
        """Have about as many steps in each call of compiled code as take CHUNK_SECONDS, if the last took so long."""
        self._chunk = max(1, min(int(self._chunk * min(CHUNK_SECONDS / max(elapsed, 1e-9), 8.0)), 10**6))

    def _count(self, cost: Counts) -> None:
        self.record.force_evaluations += cost.evaluations
        self.record.jacobian_evaluations += cost.jacobians
        self.record.rejected_steps += cost.rejected

    def _look_ahead(self, time: float, counted: bool = False) -> None:
        """Have the present inside the step that follows, which is not taken: it would lead beyond the run's end."""
        stepper: Any = self._stepper
        self._flow.forget_errors()
        status, y, cost = stepper.ahead(time)
        if status != OK or not np.isfinite(y).all():
            self._at = self._present = None
            self._fail(inside_step=status != OK, stopped=status == STOPPED)
        if self._at is None or self._at <= stepper.time:
            self.record.steps += 1
        if counted:
            self._count(cost)
        self._at, self._present = time, (time, y)

    @unwarned
    def _fail(self, inside_step: bool, stopped: bool = False) -> NoReturn:
        """Say what blew up, in the step going on or in the last one, and go back to the last sample."""
        seen, stepper = self._lookout, self._stepper
        step = stepper.steps_done + inside_step
        time = stepper.time + (0.0 if self.method.chooses_steps else (self.dt or 0.0) * inside_step)
        with_step = "" if self.method.chooses_steps else f", dt = {self.dt:g}"
        last, good = self._flow.state(seen.y, seen.time, seen.step), seen.y.copy()
        if stopped:
            message = (
                f"stopped at step {step} (t = {stepper.time:.6g}): {stepper.trouble}{self._flow.meeting(stepper.y)}"
            )
        else:
            reached, before = stepper.reached(inside_step)
            message = self._flow.explain(reached, before, good, step, time, last.steps_done)
        self.record.steps -= stepper.steps_done - last.steps_done
        self.record.events = [event for event in self.record.events if event["time"] <= last.time]
        self._replaced = True
        stepper.reset(good, last.time, last.steps_done)
        self._at = None
        raised = self._flow.raised
        if raised is not None and not isinstance(raised, Exception):
            raise raised  # KeyboardInterrupt, SystemExit
        error = RunError(f"{self.integrator}{with_step}: {message}")
        error.state = last
        raise error from raised

    # --- what events ask for ---

    @property
    def stopped(self) -> str:
        """The event that ended the last run, in words; "" where none did."""
        return self._watching.stopped if self._watching else ""

    def going_on(self) -> list[dict[str, Any]]:
        """Close approaches that have not ended yet, as entries of ``events`` so far."""
        return self._watching.going_on() if self._watching else []

    def stepper_for(self, system: Any) -> Stepper:
        """The method's stepper for these bodies, which are the Simulation's from now on."""
        self.system = system
        self._flow: Flow
        if self._engine.foreign:
            self._flow, stepper = begin(self._engine, self._job(system))
            return stepper
        mixed = self.options.precision == MIXED
        self._flow = flow_of(system, self.threads, jumps=self.method.trial_steps, mixed=mixed)
        if self.method.separable and self._flow.not_separable:
            raise InputError(
                f"{self.integrator}: needs accelerations that depend on positions and time alone, and "
                f"{self._flow.not_separable}; Runge-Kutta methods do not"
            )
        return self.method.stepper(self._flow, self.options)

    def _job(self, system: Any) -> Job:
        return Job(system, self.method, self.integrator, self.options, self.threads, self.processes)

    @property
    def engine(self) -> str:
        """The name of the program that runs it."""
        return self._engine.name

    @property
    def engine_version(self) -> str | None:
        """Its version."""
        return self._engine.version

    def bodies_changed(self) -> None:
        """An event acted: there is no going back behind it."""
        self._at = self._present = None
        self._lookout.begin_anew()

    def sample_at(self, y: Floats, time: float) -> Sample:
        """All that is watched, at y."""
        return self._flow.sample(y, time, self.steps_done)

    def _look(self, writer: Writer | None = None, observe: Observer | None = None, again: bool = True) -> None:
        """Sample, write and show the present state."""
        if not self._lookout.look(again):
            self._fail(inside_step=False, stopped=self._engine.foreign and bool(self._stepper.trouble))
        if writer:
            acting = self._watching is not None and self._watching.acting
            forces = self.forces() if "forces" in writer.writes else None
            writer.append(self.state, self.record.samples[-1].observables(taken=acting), forces=forces)
        if observe:
            observe(self)

    def _series(self, plan: Plan, count: int) -> None:
        """Go on through many looks that nobody else takes part in."""
        began = perf_counter()
        stepper = self._stepper
        before, counts = stepper.steps_done, stepper.counts
        self._flow.forget_errors()
        status, refused = self._lookout.series(plan, count, self._chunk)
        self.record.steps += stepper.steps_done - before
        self._count(stepper.counts - counts)
        if status != OK:
            self._fail(inside_step=not refused, stopped=status == STOPPED and not refused)
        self._at = plan.present(stepper.time, np.inf) if self.method.chooses_steps else None
        self._pace(perf_counter() - began)

    def _writer(self, output: Any, plan: Plan, overwrite: bool, options: FileOptions | None) -> Any:
        if output is None:
            if options is not None:
                raise InputError("file: says how output is written, and there is none")
            return nullcontext()
        if not isinstance(self.system, System):
            raise InputError("output: a run's file holds particles, and a Problem has none; use observe")
        from kickdrift.trajectory.h5md import Writer
        from kickdrift.trajectory.options import FileOptions

        if not isinstance(options, FileOptions | None):
            raise InputError(f"file: expected kd.FileOptions, got {shown(options)}")
        path = os.path.realpath(output)
        if path in self._files and not overwrite and os.path.exists(path):
            return Writer.append_to(
                path, self._files[path].run_id, options=options, checkpoint=self.checkpoint, plan=plan.numbers,
                at=(self.steps_done, self.time), events=len(self.record.events),
            )  # fmt: skip
        method = {
            "integrator": self.integrator,
            "order": self.method.order,
            "dt": self.dt,
            "threads": self.threads,
            "seed": self.system.seed,
            "engine": self.engine,
            "engine_version": self.engine_version,
            "processes": self.processes,
            **self.options.extras(self.method.tunable),
            "options": dict(self.options),
            "processor": processor(),
            "features": features(),
        }
        path = str(place(output))
        self._replaced = False  # a new file begins with a checkpoint
        system = self._watching.first if self._watching else self.system  # with the bodies that have left
        writer = Writer(
            path, system, method=method, every=plan.every, overwrite=overwrite, options=options,
            checkpoint=self.checkpoint, plan=plan.numbers,
        )  # fmt: skip
        self._files[path] = Own.of(writer.run_id, plan.every, plan)
        return writer


class Own(NamedTuple):
    """A file that a Simulation writes to, and the cadence of looks that it keeps."""

    run_id: str
    every: int
    interval: float | None

    @classmethod
    def of(cls, run_id: str, every: int, plan: Plan | None) -> Own:
        """Of a run that began the file by a plan."""
        return cls(run_id, every, plan.interval if plan and plan.exact and plan.interval else None)


def _kind_of(value: Any) -> str:
    """What was given in place of a System, and what to give instead."""
    if isinstance(value, Simulation):
        return "a Simulation: give its ``system``, or go on with the Simulation itself"
    if isinstance(value, str | os.PathLike):
        return f"{shown(value)}: give kd.load({shown(str(value))}), or kd.resume of a run's file"
    if isinstance(value, type):
        return f"the class {value.__name__}"
    return type(value).__name__

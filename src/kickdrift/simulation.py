"""A Simulation: how a System or a Problem is run."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator
from contextlib import contextmanager, nullcontext
from numbers import Real
from time import perf_counter
from typing import TYPE_CHECKING, Any, NoReturn

import numpy as np

from kickdrift.errors import InputError, RunError
from kickdrift.flow import ParticleFlow, flow_of
from kickdrift.forces.kernel import OK
from kickdrift.integrators import integrator as method_named
from kickdrift.integrators.stepping import STOPPED, Options
from kickdrift.interrupt import interruptible
from kickdrift.observers import Energies, Record, Sample
from kickdrift.report import Report, report
from kickdrift.run_plan import Plan
from kickdrift.state import Floats, read_only
from kickdrift.system import System

if TYPE_CHECKING:
    from kickdrift.integrators.exact import Lattice
    from kickdrift.problem import Problem
    from kickdrift.trajectory.h5md import Writer

CHUNK_SECONDS = 0.1  # how long compiled code runs before Python looks for Ctrl-C
SAMPLES = 1000  # of the energy in a run that does not say how often

Observer = Callable[["Simulation"], Any]


class Simulation:
    """Runs a copy of a System, or a Problem, with an integrator.

    Parameters
    ----------
    system : System or Problem
    integrator : name, see ``kickdrift.integrators()``; default the system file's, else "velocity-verlet" for particles
        and "dormand-prince45" for a Problem
    dt : step in the system's unit of time; default the system file's. For an adaptive method the first step, optional
    threads : of the forces; the results do not depend on it, bit by bit
    rtol, atol : relative and absolute error allowed per step by an adaptive method; default the system file's, else
        1e-8 and 1e-10
    controller : how an adaptive method sets its step: "i", "pi" (default) or "pid"
    compensated : carry on what rounding loses of positions and velocities; for methods of fixed steps
    iteration : how an implicit method solves for its stages: "newton" or "fixed-point"

    Raises
    ------
    InputError
        Where an argument makes no sense.
    """

    def __init__(
        self,
        system: System | Problem,
        integrator: str | None = None,
        dt: float | None = None,
        threads: int = 1,
        *,
        rtol: float | None = None,
        atol: float | None = None,
        controller: str | None = None,
        compensated: bool = False,
        iteration: str | None = None,
    ) -> None:
        default = "velocity-verlet" if isinstance(system, System) else "dormand-prince45"
        self.integrator = integrator or system.run.integrator or default
        self.method = method_named(self.integrator)
        given = Options(
            dt if dt is not None else system.run.dt,
            rtol if rtol is not None else system.run.rtol,
            atol if atol is not None else system.run.atol,
            controller,
            compensated,
            iteration,
        )
        self.options = self.method.checked(given, asked=Options(dt, rtol, atol, controller, compensated, iteration))
        self.dt = self._step_asked(system)
        self.system = system
        self.threads = threads
        self._flow = flow_of(system, threads, jumps=self.method.trial_steps)
        if self.method.separable and self._flow.not_separable:
            raise InputError(
                f"{self.integrator}: needs accelerations that depend on positions and time alone, and "
                f"{self._flow.not_separable}; rk4, dormand-prince45 and dop853 do not"
            )
        self._stepper = self.method.stepper(self._flow, self.options)
        self._chunk = 1
        self._compiled = False
        self._running = False
        self._files: dict[str, tuple[str, int]] = {}  # files that this Simulation began: path -> run id, cadence
        self._every: int | None = None
        self.state = system.state

    def _step_asked(self, system: System | Problem) -> float | None:
        given = self.options.dt
        if given is None and self.method.adaptive:
            return None
        if given is None:
            raise InputError(f"dt is needed: system {system.name!r} names none in [run]")
        dt = _number(given)
        if not (np.isfinite(dt) and dt > 0):
            raise InputError(f"dt must be a positive finite time, got {given!r}")
        return dt

    # --- state ---

    @property
    def state(self) -> Any:
        """The State (positions, velocities, time) or ProblemState (y, time); a copy. Setting it starts a new record of
        what is conserved; a run in progress refuses that, and so does a state of other particles than the system's.

        An adaptive run's own step point may lie past ``time``; it goes on from there, whatever was looked at."""
        return self._flow.state(self._now(), self.time, self.steps_done)

    @state.setter
    def state(self, state: Any) -> None:
        if self._running:
            raise InputError("state: is read-only while the Simulation runs")
        y = self._flow.array(state)
        self._stepper.reset(y, state.time, state.steps_done)
        self._at: float | None = None  # the present, where it lies before the stepper's last step point
        self.record = Record()
        self._last_good = self.state

    @property
    def lattice(self) -> Lattice:
        """The whole numbers that leapfrog-exact moves, a copy; ``state`` shows them rounded to floats. Setting it takes
        a run up again to the last bit, and ``sim.lattice = sim.lattice.reversed()`` turns it around."""
        return self._exact().lattice

    @lattice.setter
    def lattice(self, lattice: Lattice) -> None:
        if self._running:
            raise InputError("lattice: is read-only while the Simulation runs")
        self._exact().lattice = lattice
        self.record = Record()
        self._last_good = self.state

    def _exact(self) -> Any:
        if not hasattr(self._stepper, "lattice"):
            raise InputError(f"lattice: {self.integrator} has none; leapfrog-exact has")
        return self._stepper

    @property
    def time(self) -> float:
        """In the system's unit."""
        return self._stepper.time if self._at is None else self._at

    @property
    def steps_done(self) -> int:
        """Whole steps since the start."""
        return self._stepper.steps_done

    def _now(self) -> Floats:
        return self._stepper.y if self._at is None else self._stepper.at(self._at)

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
        return self._flow.sample(self._now(), self.time, self.steps_done)

    def report(self) -> Report:
        """How well the run conserved energy and momentum so far, and what it cost."""
        if not self.record.samples:
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
        observe: Observer | None = None,
        progress: Callable[[int, int], Any] | None = None,
    ) -> Report:
        """Take ``steps`` steps, or go on ``until`` a time: on the grid of whole steps, or any for an adaptive method.

        Every ``every`` steps (counted from step 0), at the start and at the end the energies are sampled, a frame goes
        to ``output`` (a new .h5md file, or one that this Simulation began) and ``observe(sim)`` is called. An adaptive
        run may ask for that at every ``interval`` of time instead; the steps do not change by it.
        ``progress(done, of)`` is called now and then. Ctrl-C ends the run cleanly with a KeyboardInterrupt: what was
        done stays done, and the file is whole.

        Returns the Report. Raises InputError for arguments that make no sense, and RunError where the run blows up; the
        state is then that of the last sample.
        """
        plan = self._plan(steps, until, every, interval, output)
        self._prepare()
        with self._busy() as interrupted, self._writer(output, plan.every, overwrite) as writer:
            self._look(writer, observe, again=False)
            began = perf_counter()
            spent_before = self.record.wall_seconds
            looked = True
            while not plan.over(self) and not interrupted():
                stop, stop_time = plan.next_stop(self)
                self._advance(min(self._chunk, stop - self.steps_done), stop_time)
                self._at = plan.present(self._stepper.time, stop_time)
                self.record.wall_seconds = spent_before + perf_counter() - began
                looked = self.steps_done == stop or self._stepper.time >= stop_time
                if looked:
                    self._look(writer, observe)
                if progress:
                    progress(*plan.progress(self))
            if not looked:
                self._look(writer, observe)
            if writer:
                writer.report = self.report().as_json()
        if interrupted():
            raise KeyboardInterrupt
        return self.report()

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
        from kickdrift.equilibration import equilibrate

        equilibrate(self, temperature, time, interval, progress)

    @contextmanager
    def _busy(self) -> Iterator[Callable[[], bool]]:
        """Inside, the state cannot be replaced, and Ctrl-C only sets what the function yielded returns."""
        self._running = True
        try:
            with interruptible() as interrupted:
                yield interrupted
        finally:
            self._running = False

    def steps_to(self, steps: int | None = None, until: float | None = None) -> int:
        """How many steps ``run(steps)`` or ``run(until=…)`` would take now; an InputError where that makes no sense, or
        where only the run can tell (an adaptive one until a time)."""
        if self._running:
            raise InputError("run: the Simulation runs already")
        if (steps is None) == (until is None):
            raise InputError("run: give either steps or until")
        if until is None:
            return _whole_number("steps", steps, 0)
        if not np.isfinite(_number(until)):
            raise InputError(f"run: the time to reach must be a finite number, got {until!r}")
        if self.dt is None or self.method.chooses_steps:
            raise InputError(f"run: {self.integrator} chooses its steps; how many it takes is known afterwards")
        exact = (until - self.time) / self.dt
        count = round(exact)
        if exact < -1e-6:
            raise InputError(f"run: time {until:.12g} lies before the present, {self.time:.12g}")
        if abs(exact - count) > 1e-6:
            low = self.time + int(np.floor(exact)) * self.dt
            nearest = f"{low:.12g} and {low + self.dt:.12g}"
            raise InputError(
                f"run: time {until:.12g} is not on the grid of steps of {self.dt:g}; nearest are {nearest}"
            )
        return count

    def _plan(
        self, steps: int | None, until: float | None, every: int | None, interval: float | None, output: Any
    ) -> Plan:
        begin = self.steps_done, self.time
        if interval is not None and not (self.method.chooses_steps and np.isfinite(_number(interval)) and interval > 0):
            fixed = "" if self.method.chooses_steps else f" for an adaptive method; {self.integrator} has every"
            raise InputError(f"run: interval must be a positive time{fixed}, got {interval!r}")
        if interval is not None and every is not None:
            raise InputError("run: give every or interval, not both")
        if not self.method.chooses_steps or until is None:
            count = self.steps_to(steps, until)
            cadence = 0 if interval else self._cadence(every, output, count)
            return Plan(*begin, begin[0] + count, every=cadence, interval=interval or 0.0, exact=True)
        if steps is not None or self._running:
            self.steps_to(steps, until)
        end = _number(until)
        if not (np.isfinite(end) and end >= self.time):
            raise InputError(f"run: time {until!r} is not a finite time from the present, {self.time:.12g}, on")
        if every is not None or (interval is None and self.system.run.every):
            return Plan(*begin, end_time=end, every=self._cadence(every, output, 0))
        length = interval or (end - self.time) / SAMPLES
        return Plan(*begin, end_time=end, interval=length, exact=interval is not None)

    def _cadence(self, every: int | None, output: Any, count: int) -> int:
        if every is not None:
            every = _whole_number("every", every, 1)
        began = self._files.get(os.path.abspath(output)) if output is not None else None
        known = every or (began[1] if began else None) or self._every or self.system.run.every
        self._every = every or self._every
        return int(known or max(1, count // SAMPLES))

    def _prepare(self) -> None:
        """Compile what the run needs, so that its time does not count as the run's."""
        if self._compiled:
            return
        began = perf_counter()
        self._stepper.advance(0, self.time)
        self._flow.prepare(self._stepper.y, self.time)
        self._compiled = True
        self.record.compile_seconds += perf_counter() - began

    def _advance(self, steps: int, until: float = np.inf) -> None:
        began = perf_counter()
        stepper = self._stepper
        before, counts = stepper.steps_done, stepper.counts
        status = stepper.advance(steps, until)
        self._at = None
        after = stepper.counts
        self.record.steps += stepper.steps_done - before
        self.record.force_evaluations += after.evaluations - counts.evaluations
        self.record.rejected_steps += after.rejected - counts.rejected
        if status != OK or not np.isfinite(stepper.y).all():
            self._fail(inside_step=status != OK, stopped=status == STOPPED)
        elapsed = perf_counter() - began
        self._chunk = max(1, min(int(self._chunk * min(CHUNK_SECONDS / max(elapsed, 1e-9), 8.0)), 10**6))

    @np.errstate(over="ignore", invalid="ignore")
    def _fail(self, inside_step: bool, stopped: bool = False) -> NoReturn:
        """Say what blew up, in the step going on or in the last one, and go back to the last sample."""
        last, stepper = self._last_good, self._stepper
        step = stepper.steps_done + inside_step
        time = stepper.time + (self.dt or 0.0) * inside_step
        with_step = "" if self.method.chooses_steps else f", dt = {self.dt:g}"
        good = self._flow.array(last)
        if stopped:
            message = f"stopped at step {step} (t = {stepper.time:.6g}): {stepper.trouble}"
        else:
            reached, before = stepper.reached(inside_step)
            message = self._flow.explain(reached, before, good, step, time, last.steps_done)
        self.record.steps -= stepper.steps_done - last.steps_done
        stepper.reset(good, last.time, last.steps_done)
        self._at = None
        raise RunError(f"{self.integrator}{with_step}: {message}")

    def _look(self, writer: Writer | None = None, observe: Observer | None = None, again: bool = True) -> None:
        """Sample, write and show the present state."""
        samples = self.record.samples
        known = not again and samples and (samples[-1].step, samples[-1].time) == (self.steps_done, self.time)
        try:
            sample = samples[-1] if known else self.sample()
        except RunError:
            self._fail(inside_step=False)
        if not samples:
            self._flow.begin(self.record, self._now())
        self.record.add(sample)
        self._last_good = self.state
        if writer:
            writer.append(self._last_good, sample.observables())
        if observe:
            observe(self)

    def _writer(self, output: Any, cadence: int, overwrite: bool) -> Any:
        if output is None:
            return nullcontext()
        if not isinstance(self.system, System):
            raise InputError("output: a run's file holds particles, and a Problem has none; use observe")
        from kickdrift.trajectory.h5md import Writer

        path = os.path.abspath(output)
        if path in self._files and not overwrite and os.path.exists(path):
            return Writer.append_to(path, self._files[path][0])
        method = {
            "integrator": self.integrator,
            "order": self.method.order,
            "dt": self.dt,
            "threads": self.threads,
            "seed": self.system.seed,
            "engine": "native",
            **self.options.extras(),
        }
        writer = Writer(path, self.system, method=method, every=cadence, overwrite=overwrite)
        self._files[path] = (writer.run_id, cadence)
        return writer


def _whole_number(key: str, value: Any, least: int) -> int:
    number = _number(value)
    if not (number.is_integer() and number >= least):
        words = {0: "zero or more", 1: "one or more"}[least]
        raise InputError(f"run: {key} must be a whole number, {words}, got {value!r}")
    return int(number)


def _number(value: Any) -> float:
    """A number as a float, anything else as nan."""
    return float(value) if isinstance(value, Real) else np.nan

"""A Simulation: how a System is run."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator
from contextlib import contextmanager, nullcontext
from numbers import Real
from time import perf_counter
from typing import TYPE_CHECKING, Any, NoReturn

import numpy as np

from kickdrift.blow_up import explain
from kickdrift.builders import check_overlaps
from kickdrift.errors import InputError, RunError
from kickdrift.forces.bound import BoundForces
from kickdrift.forces.evaluate import EVALUATIONS
from kickdrift.forces.kernel import OK
from kickdrift.integrators import integrator as method_named
from kickdrift.integrators.loops import STEP
from kickdrift.integrators.runge_kutta import Tableau
from kickdrift.interrupt import interruptible
from kickdrift.observers import Energies, Record, Sample, kinetic_energy, take_sample
from kickdrift.report import Report, report
from kickdrift.state import Floats, State, read_only
from kickdrift.system import System

if TYPE_CHECKING:
    from kickdrift.trajectory.h5md import Writer

CHUNK_SECONDS = 0.1  # how long compiled code runs before Python looks for Ctrl-C
SAMPLES = 1000  # of the energy in a run that does not say how often

Observer = Callable[["Simulation"], Any]


class Simulation:
    """Runs a copy of a System with an integrator.

    Parameters
    ----------
    system : System
    integrator : name, see ``kickdrift.integrators()``; default the system file's, else "velocity-verlet"
    dt : step in the system's unit of time; default the system file's
    threads : of the forces; the results do not depend on it, bit by bit

    Raises
    ------
    InputError
        Where an argument makes no sense.
    """

    def __init__(
        self, system: System, integrator: str | None = None, dt: float | None = None, threads: int = 1
    ) -> None:
        self.integrator = integrator if integrator is not None else system.run.integrator
        self._method = method_named(self.integrator)
        step = dt if dt is not None else system.run.dt
        if step is None:
            raise InputError(f"dt is needed: system {system.name!r} names none in [run]")
        self.dt = _number(step)
        if not (np.isfinite(self.dt) and self.dt > 0):
            raise InputError(f"dt must be a positive finite time, got {step!r}")
        check_overlaps(system)
        self.system = system
        self.threads = threads
        self._forces = BoundForces(system, threads, jumps=False)
        self._looks = BoundForces(system, threads)  # with lists of its own: looking must not change the run's
        self._work = self._method.workspace(len(system))
        self._cursor = np.zeros(4, np.int64)
        self._chunk = 1
        self._compiled = False
        self._running = False
        self._files: dict[str, tuple[str, int]] = {}  # files that this Simulation began: path -> run id, cadence
        self._every: int | None = None
        self.state = system.state

    # --- state ---

    @property
    def state(self) -> State:
        """Positions, velocities, time; a copy. Setting it starts a new record of what is conserved; a run in progress
        refuses that, and so does a state of other particles or another box than the system's."""
        return State(
            self._phase.copy(), self._masses.copy(), self._ids.copy(), self.system.box, self.time, self.steps_done
        )

    @state.setter
    def state(self, state: State) -> None:
        if len(state) != len(self.system):
            raise InputError(f"state: expected {len(self.system)} particles, got {len(state)}")
        if self._running:
            raise InputError("state: is read-only while the Simulation runs")
        own = self.system.state
        if not (np.array_equal(state.ids, own.ids) and np.array_equal(state.masses, own.masses)):
            raise InputError("state: ids and masses must be those of the system's particles, in the same order")
        if state.box != self.system.box:
            raise InputError(f"state: its box is {state.box.lengths}, and the system's {self.system.box.lengths}")
        if not np.all(np.isfinite(state.phase)):
            raise InputError("state: positions and velocities must be finite")
        self._phase = np.array(state.phase, dtype=float, order="C")
        self._masses, self._ids = state.masses.copy(), state.ids.copy()
        self.steps_done = state.steps_done
        self._start = state.time - state.steps_done * self.dt
        self._cursor[:] = 0
        self._forces.forget()
        self.record = Record()
        self._last_good = self.state

    @property
    def time(self) -> float:
        """In the system's unit."""
        return self._start + self.steps_done * self.dt

    def energy(self) -> Energies:
        """Kinetic, potential and total energy now, in the system's units."""
        return self.sample().energies

    def forces(self) -> Floats:
        """(n, 3) forces on the particles now, in the system's energy unit per length; a read-only copy."""
        measured = self._looks.measure(self.time, self._phase)
        if measured is None:
            raise RunError(f"step {self.steps_done}: the forces at these positions are not finite")
        return read_only((measured.accelerations * self.system.coherent_masses).T.copy())

    def sample(self) -> Sample:
        """All that is watched, now."""
        return take_sample(self.system, self._looks, self.steps_done, self.time, self._phase)

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
        output: str | os.PathLike[str] | None = None,
        overwrite: bool = False,
        observe: Observer | None = None,
        progress: Callable[[int, int], Any] | None = None,
    ) -> Report:
        """Take ``steps`` steps, or go on ``until`` a time on the grid of whole steps.

        Every ``every`` steps (counted from step 0), at the start and at the end the energies are sampled, a frame goes
        to ``output`` (a new .h5md file, or one that this Simulation began) and ``observe(sim)`` is called.
        ``progress(done, of)`` is called now and then. Ctrl-C ends the run cleanly with a KeyboardInterrupt: what was
        done stays done, and the file is whole.

        Returns the Report. Raises InputError for arguments that make no sense, and RunError where the run blows up; the
        state is then that of the last sample.
        """
        count = self.steps_to(steps, until)
        cadence = self._cadence(every, output, count)
        self._prepare()
        end = self.steps_done + count
        with self._busy() as interrupted, self._writer(output, cadence, overwrite) as writer:
            self._look(writer, observe, again=False)
            began = perf_counter()
            spent_before = self.record.wall_seconds
            while self.steps_done < end and not interrupted():
                stop = min(end, (self.steps_done // cadence + 1) * cadence)
                self._advance(min(self._chunk, stop - self.steps_done))
                self.record.wall_seconds = spent_before + perf_counter() - began
                if self.steps_done == stop:
                    self._look(writer, observe)
                if progress:
                    progress(count - (end - self.steps_done), count)
            if self.steps_done < end:
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
        and not just as its start.
        """
        if not (np.isfinite(temperature) and temperature > 0):
            raise InputError(f"equilibrate: temperature must be positive, got {temperature}")
        if not (np.isfinite(time) and time > 0):
            raise InputError(f"equilibrate: time must be positive, got {time}")
        if interval < 1:
            raise InputError(f"equilibrate: interval must be a whole number of steps, one or more, got {interval}")
        if self.system.degrees_of_freedom == 0:
            raise InputError("equilibrate: a system of one particle has no temperature")
        if self._running:
            raise InputError("equilibrate: the Simulation runs already")
        wanted = 0.5 * self.system.degrees_of_freedom * self.system.units.boltzmann * temperature
        count = max(1, round(time / self.dt))
        self._prepare()
        compile_seconds = self.record.compile_seconds
        self._restart()
        potentials: list[float] = []
        with self._busy() as interrupted:
            while self.steps_done < count and not interrupted():
                self._rescale(wanted)
                self._advance(min(interval, count - self.steps_done))
                if 2 * self.steps_done >= count:
                    potentials.append(self.energy().potential)
                if progress:
                    progress(self.steps_done, count)
        if interrupted():
            raise KeyboardInterrupt
        self._rescale(max(wanted + float(np.mean(potentials)) - potentials[-1], 0.5 * wanted))
        self._restart()
        self.record.compile_seconds = compile_seconds

    def _restart(self) -> None:
        """Call the present step 0."""
        now = self.state
        self.state = State(now.phase, now.masses, now.ids, now.box)

    @contextmanager
    def _busy(self) -> Iterator[Callable[[], bool]]:
        """Inside, the state cannot be replaced, and Ctrl-C only sets what the function yielded returns."""
        self._running = True
        try:
            with interruptible() as interrupted:
                yield interrupted
        finally:
            self._running = False

    def _rescale(self, kinetic: float) -> None:
        now = kinetic_energy(self.system.coherent_masses, self._phase[1])
        if now == 0:
            raise InputError(
                "equilibrate: all velocities are zero, so none can be rescaled; give [velocities] a temperature"
            )
        self._phase[1] *= np.sqrt(kinetic / now)

    def steps_to(self, steps: int | None = None, until: float | None = None) -> int:
        """How many steps ``run(steps)`` or ``run(until=…)`` would take now; an InputError where that makes no sense."""
        if self._running:
            raise InputError("run: the Simulation runs already")
        if (steps is None) == (until is None):
            raise InputError("run: give either steps or until")
        if until is None:
            return _whole_number("steps", steps, 0)
        if not np.isfinite(_number(until)):
            raise InputError(f"run: the time to reach must be a finite number, got {until!r}")
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
        self._step(0)
        self._looks.measure(self.time, self._phase)
        self._compiled = True
        self.record.compile_seconds += perf_counter() - began

    def _advance(self, steps: int) -> None:
        began = perf_counter()
        before = self._cursor[EVALUATIONS]
        self._cursor[STEP] = 0
        status = self._step(steps)
        done = int(self._cursor[STEP])
        self.steps_done += done
        self.record.steps += done
        self.record.force_evaluations += int(self._cursor[EVALUATIONS] - before)
        if status != OK or not np.isfinite(self._phase).all():
            self._fail(inside_step=status != OK)
        elapsed = perf_counter() - began
        self._chunk = max(1, min(int(self._chunk * min(CHUNK_SECONDS / max(elapsed, 1e-9), 8.0)), 10**6))

    def _step(self, steps: int) -> int:
        stages, step, first = self._method.stages, self._method.loop(), self.steps_done
        return self._forces.call(
            step, self._phase, self._work, stages, self.dt, self._start, first, steps, self._cursor
        )

    @np.errstate(over="ignore", invalid="ignore")
    def _fail(self, inside_step: bool) -> NoReturn:
        """Say what blew up, in the step going on or in the last one, and go back to the last sample."""
        last, step = self._last_good, self.steps_done + inside_step
        reached, before = self._phase, self._phase[0] - self.dt * self._phase[1]
        if inside_step and isinstance(self._method, Tableau):  # the phase waits for the last stage
            reached, before = self._work[0], self._phase[0]
        message = explain(self.system, reached, before, last.phase, step, self._start + step * self.dt, last.steps_done)
        self.record.steps -= self.steps_done - last.steps_done
        self._phase[...], self.steps_done = last.phase, last.steps_done
        self._cursor[:] = 0
        self._forces.forget()
        raise RunError(f"{self.integrator}, dt = {self.dt:g}: {message}")

    def _look(self, writer: Writer | None = None, observe: Observer | None = None, again: bool = True) -> None:
        """Sample, write and show the present state."""
        known = not again and self.record.samples and self.record.samples[-1].step == self.steps_done
        try:
            sample = self.record.samples[-1] if known else self.sample()
        except RunError:
            self._fail(inside_step=False)
        self.record.add(sample, self.system.coherent_masses, self._phase)
        self._last_good = self.state
        if writer:
            writer.append(self._last_good, sample.observables())
        if observe:
            observe(self)

    def _writer(self, output: Any, cadence: int, overwrite: bool) -> Any:
        if output is None:
            return nullcontext()
        from kickdrift.trajectory.h5md import Writer

        path = os.path.abspath(output)
        if path in self._files and not overwrite and os.path.exists(path):
            return Writer.append_to(path, self._files[path][0])
        method = {
            "integrator": self.integrator,
            "order": self._method.order,
            "dt": self.dt,
            "threads": self.threads,
            "seed": self.system.seed,
            "engine": "native",
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

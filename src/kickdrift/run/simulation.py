"""A Simulation: how a System or a Problem is run."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterable
from typing import TYPE_CHECKING, Any
from warnings import warn

from kickdrift.engines import engine as engine_named
from kickdrift.engines.session import Job
from kickdrift.errors import InputError
from kickdrift.forces.bound import check_threads
from kickdrift.integrators import integrator as method_named
from kickdrift.integrators.asked import Integrator, settled, unpacked
from kickdrift.looks.observers import Energies, Sample
from kickdrift.looks.record import Record
from kickdrift.model.capacity import PROCESS_BYTES, check_room
from kickdrift.model.checks import path_text, whole_number
from kickdrift.model.event_checks import checked_events
from kickdrift.model.memory import Memory
from kickdrift.model.problem import Problem
from kickdrift.model.state import Floats
from kickdrift.model.system import System
from kickdrift.run.advance import Integration
from kickdrift.run.asked import check_asked, kind_of
from kickdrift.run.checkpoint import checkpoint_of, restore
from kickdrift.run.columns import ColumnWatcher, check_columns_fit, checked_columns
from kickdrift.run.equilibration import equilibrate
from kickdrift.run.forces import accelerations_at, forces_at
from kickdrift.run.looks import Sampler
from kickdrift.run.loop import go_on, run_through
from kickdrift.run.outputs import Outputs
from kickdrift.run.plan import Plan, plan_of, steps_to
from kickdrift.run.report import Report, report
from kickdrift.run.watch.stability import Stability
from kickdrift.run.watch.watched_stepper import Events
from kickdrift.run.watch.watcher import Observe, Watcher

if TYPE_CHECKING:
    from kickdrift.looks.columns import Column
    from kickdrift.model.events import Event
    from kickdrift.trajectory.options import FileOptions

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
            raise InputError(f"a Simulation takes a System or a Problem, got {kind_of(system, Simulation)}")
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
        job = Job(system, self.method, self.integrator, self.options, self.threads, self.processes)  # type: ignore[arg-type]
        if self._engine.foreign or self.processes > 1:
            self._engine.check(job)
        self.integration = Integration(job, self._engine, watched)
        self._stability = Stability(self.integration, self._engine.foreign)
        self._sampler = Sampler(self.integration, self._stability)
        self._outputs = Outputs(self.integration, self.checkpoint)
        self.plan: Plan | None = None  # what `run` goes on with where it is told nothing
        self.state = system.state

    # --- state ---

    @property
    def system(self) -> Any:
        """The System or Problem that runs; bodies that an event took away are missing."""
        return self.integration.system

    @property
    def engine(self) -> str:
        """The name of the program that runs it."""
        return self._engine.name

    @property
    def engine_version(self) -> str | None:
        """Its version."""
        return self._engine.version

    @property
    def running(self) -> bool:
        """Whether a run goes on; the state is read-only meanwhile."""
        return self.integration.running

    @property
    def record(self) -> Record:
        """The run's samples, and what it cost."""
        return self.integration.record

    @property
    def state(self) -> Any:
        """The State (positions, velocities, time) or ProblemState (y, time); a copy. Setting it starts a new record of
        what is conserved; a run in progress refuses that, and so does a state of other particles than the system's.

        An adaptive run's own step point may lie before or past ``time``. The run goes on from that step point, whatever
        was looked at."""
        return self.integration.state

    @state.setter
    def state(self, state: Any) -> None:
        if self.running:
            raise InputError("state: is read-only while the Simulation runs")
        self.integration.begin_at(state)
        self._stability.begin_anew(check_at=0)

    @property
    def method_state(self) -> Any:
        """What the method moves where that is more than positions and velocities; an InputError where it is not.

        Under leapfrog-exact that is a `Lattice` of whole numbers, a copy, which ``state`` shows rounded to floats.
        Setting it takes a run up again to the last bit, and ``sim.method_state = sim.method_state.reversed()`` turns
        the run around."""
        return self.integration.stepper_with_state.method_state

    @method_state.setter
    def method_state(self, value: Any) -> None:
        if self.running:
            raise InputError("method_state: is read-only while the Simulation runs")
        self.integration.begin_with(value)

    @property
    def lattice(self) -> Any:
        """The old name of ``method_state``; goes after version 0.2."""
        _warn_of_lattice()
        return self.method_state

    @lattice.setter
    def lattice(self, value: Any) -> None:
        _warn_of_lattice()
        self.method_state = value

    def checkpoint(self) -> Memory:
        """All that the rest of the run depends on, by value: arrays, numbers, texts, None, and lists and dicts of these
        by text. ``restore`` takes it, in another process too, and what follows then has the bits of this run.

        That is: the method and its options; the stepper's own memory (see the integrators' pages), pair lists
        included; the present, where it lies inside a step; what events are under way, and the bodies that are left;
        and the record but for its samples. It may be taken at any look, and changes nothing."""
        return checkpoint_of(self.integration)

    def restore(self, checkpoint: Memory) -> None:
        """Go on where ``checkpoint`` was taken, of a Simulation of the same system, method, options and events; the
        number of threads may be another. The record's samples are left out: what is looked at from here on follows.

        Raises InputError where method, options or bodies are others, where the checkpoint is damaged, and while a run
        goes on."""
        if self.running:
            raise InputError("restore: the Simulation runs")
        restore(self.integration, checkpoint)
        self._stability.begin_anew(check_at=2 * self.record.steps)

    @property
    def time(self) -> float:
        """In the system's unit."""
        return self.integration.time

    @property
    def steps_done(self) -> int:
        """Steps since the start; where the present lies inside one, that one counts."""
        return self.integration.steps_done

    def energy(self) -> Energies:
        """Kinetic, potential and total energy now, in the system's units."""
        return self.sample().energies

    def accelerations(self) -> Floats:
        """(n, 3) accelerations of the particles now, in the system's units; a read-only copy."""
        return accelerations_at(self.integration)

    def forces(self) -> Floats:
        """(n, 3) forces on the particles now, in the system's energy unit per length; a read-only copy."""
        return forces_at(self.integration)

    def sample(self) -> Sample:
        """All that is watched, now."""
        return self.integration.sample()

    @property
    def events(self) -> list[dict[str, Any]]:
        """What was seen so far of the events watched for, in the order in which it came to be known: a copy. Of each
        kind, time, step (in which it was), bodies, ids, distance, energy that it took out, and what was done."""
        return [dict(row) for row in self.record.events]

    @property
    def stopped(self) -> str:
        """The event that ended the last run, in words; "" where none did."""
        return self.integration.events.stopped if self.integration.events else ""

    def going_on(self) -> list[dict[str, Any]]:
        """Close approaches that have not ended yet, as entries of ``events`` so far."""
        return self.integration.events.going_on() if self.integration.events else []

    def report(self) -> Report:
        """How well the run conserved energy and momentum so far, and what it cost."""
        if not self.record.looks:
            self._sampler.look()
            self._stability.look()
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
        columns: Iterable[Column] = (),
        progress: Callable[[int, int], Any] | None = None,
    ) -> Report:
        """Take ``steps`` steps, or go on ``until`` a time: on the grid of whole steps, or any for an adaptive method.

        Every ``every`` steps (counted from step 0), at the start and at the end the energies are sampled, a frame goes
        to ``output`` (a new .h5md file, or one that this Simulation began) and ``observe(sim)`` is called. An adaptive
        run may ask for that at every ``interval`` of time instead; the steps do not change by it. ``file`` says how the
        output is written: how often it is flushed, its precision, compression, forces and images. The values of
        ``columns`` are written beside the energies; ``record.samples`` has them too. A run that goes on into a file
        gives the columns that the file was begun with.

        Without ``every`` the system file's counts, or that of the file that the run goes on into. Where nothing says
        how often, there are about 1000 looks; in a run of fewer than 100,000 evaluations of the forces, one for each
        100 of them, but at least 16000 / bodies or 50 (as far as there are steps). That depends on the run alone.
        ``progress(done, of)`` is called now and then. Ctrl-C ends the run cleanly with a KeyboardInterrupt: what was
        done stays done, and the file is whole.

        Returns the Report. Raises InputError for arguments that make no sense, and RunError where the run blows up; the
        state is then that of the last sample.
        """
        check_asked(observe, progress, overwrite)
        units = self.system.units if isinstance(self.system, System) else None
        written = ColumnWatcher(checked_columns(columns, units), self.integration, self)
        output = self._outputs.chosen(None if output is None else path_text("run: output", output), overwrite)
        if self.plan is not None and (steps, until, every, interval) == (None,) * 4:
            plan = self.plan
        else:
            own = self._outputs.own(output)
            seen = isinstance(self.system, System) or self.system.energy is not None or bool(observe or written.columns)
            if own and self.method.chooses_steps and (steps, every, interval) == (None,) * 3:
                interval = own.interval
            plan = plan_of(self, steps, until, every, interval, own.every if own else None, seen)
        check_columns_fit(written.columns, plan)
        self.plan = None
        run = self.integration
        watching: list[Watcher | None] = [
            Events(run.events) if run.events else None,
            self._stability,
            written if written.columns else None,
            self._outputs.watcher(output, plan, overwrite, file, written.described, self.going_on),
            Observe(observe, self) if observe else None,
        ]
        watchers = [each for each in watching if each]
        alone = watchers == [self._stability]
        run.prepare()
        if alone:
            self._sampler.prepare(plan)
        return run_through(run, self._sampler, plan, watchers, alone, self.report, progress)

    def advance(self, steps: int, *, every: int | None = None, visit: Observer | None = None) -> None:
        """Take ``steps`` steps without a look: nothing is sampled, written or observed.

        The bits are those of ``run``. ``visit(sim)`` is called after each ``every`` steps and at the end; where it
        returns something true, the steps end there. The steps count in the report. A run that blows up goes back to
        the last look, or to the last state that was set. An event that ends a run ends this too, and ``stopped`` names
        it. Raises InputError for numbers that make no sense, and while a run goes on; RunError where the run blows
        up."""
        steps, every = self.steps_to(steps), every if every is None else whole_number("every", every, 1)
        go_on(self.integration, steps, every, visit, self)

    @property
    def output(self) -> str | None:
        """The file that ``run`` writes to unless told, of a run that was resumed."""
        return self._outputs.default

    def continue_in(self, path: str, run_id: str, every: int, plan: Plan | None) -> None:
        """Go on into a file that another Simulation of the same run began, by its plan unless told otherwise."""
        self.plan = plan
        self.integration.replaced = False
        self._outputs.continue_in(path, run_id, every, plan)

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
        more = {"engine": self.engine, "processes": self.processes}
        equilibrate(
            self, temperature, time, interval, progress,
            lambda: Simulation(self.system, "velocity-verlet", self.system.run.dt, self.threads, **more),  # type: ignore[arg-type]
        )  # fmt: skip

    def steps_to(self, steps: int | None = None, until: float | None = None) -> int:
        """How many steps ``run(steps)`` or ``run(until=…)`` would take now; an InputError where that makes no sense, or
        where only the run can tell (an adaptive one until a time)."""
        return steps_to(self, steps, until)


def _warn_of_lattice() -> None:
    warn("Simulation.lattice is Simulation.method_state since 0.2", DeprecationWarning, stacklevel=3)

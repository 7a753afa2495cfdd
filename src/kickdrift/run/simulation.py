"""Simulation: runs a System or a Problem."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterable
from functools import partial
from typing import TYPE_CHECKING, Any
from warnings import warn

from kickdrift.display.showing import following
from kickdrift.engines import engine as engine_named
from kickdrift.engines.hosts import on_this_machine, slots
from kickdrift.engines.job import Job
from kickdrift.errors import InputError
from kickdrift.forces.bound.forces import check_threads
from kickdrift.integrators import integrator as method_named
from kickdrift.integrators.asked import Integrator, settled, unpacked
from kickdrift.model.checks.limits import PROCESS_BYTES, check_room
from kickdrift.model.checks.values import path_text, whole_number
from kickdrift.model.events.events import checked_crossings
from kickdrift.model.memory import Memory
from kickdrift.model.problem import Problem
from kickdrift.model.run_defaults import Equilibration
from kickdrift.model.system import System
from kickdrift.run.advance import Integration
from kickdrift.run.asked import check_asked, kind_of
from kickdrift.run.columns import ColumnWatcher, check_columns_fit, checked_columns, with_body_columns
from kickdrift.run.equilibration import equilibrate
from kickdrift.run.files import Outputs, keeping_failed_atoms
from kickdrift.run.followers import Follower, followed
from kickdrift.run.looks import Sampler
from kickdrift.run.loop import go_on, run_through
from kickdrift.run.minimization import FORCE, METHOD, STEPS, Minimum, minimize
from kickdrift.run.plan.lengths import Exact, begin, goal_of, time_of
from kickdrift.run.plan.plan import Plan, plan_of
from kickdrift.run.present import Present, alone, no_step
from kickdrift.run.report.energy import work_columns
from kickdrift.run.report.report import Report, report
from kickdrift.run.returning import checkpoint_of, restore
from kickdrift.run.times import plan_at, refuse_beside, times_of
from kickdrift.run.watch.watched_stepper import Events
from kickdrift.run.watcher import Observe, Watcher
from kickdrift.run.watchers.imd import Imd
from kickdrift.run.watchers.stability import Stability

if TYPE_CHECKING:
    from kickdrift.looks.columns import Column
    from kickdrift.model.events.events import Event
    from kickdrift.trajectory.layout.options import FileOptions

Observer = Callable[["Simulation"], Any]


def default_method(system: System | Problem) -> str:
    """Name of the integrator of a run that names none."""
    return "velocity-verlet" if isinstance(system, System) else "dormand-prince45"


class Simulation(Present):
    """Runs a copy of a System, or a Problem, with an integrator.

    Parameters
    ----------
    system : System or Problem
    integrator : a name from ``kickdrift.integrators()``, or a value from ``kickdrift.integrator``; default the
        system file's, else "velocity-verlet" for particles and "dormand-prince45" for a Problem
    dt : step in the system's unit of time, or "2 fs"; default the system file's. Adaptive methods: first step, optional
        (with neither integrator nor dt, particles take no steps; energy, forces, pressure and ``minimize`` are there)
    threads : number of threads of the forces; the bits of the results do not depend on this number
    engine : name of the program that takes the steps: "native", or an installed one of ``kickdrift.engines()``
    processes : number of processes, for an engine that runs on several ("lammps"); default 1, or all that ``hosts`` has
    hosts : file that lists machines for the processes, as mpiexec takes it: lines of NAME or NAME:COUNT
    events : what to watch for (`CloseApproach`, `Collision`, `Escape`, `Crossing`); default the system file's
    options : options of the integrator, such as ``rtol=1e-10`` or ``corrector=17``; `kickdrift list integrators NAME`
        explains them. A value with a unit may be text: ``temperature="300 K"``. Options given here override those of an
        integrator's value, which override the system file's. Every integrator takes ``precision`` of pair and many-body
        forces: "double" (float64, default) or "mixed" (pairs in float32, everything else in float64). With "mixed", the
        error of forces in a liquid is about 2e-7 of a typical force for each sigma of the box's edge (in open space, of
        the extent). Reported energies are in float64

    ``now()`` is the System at present, and ``sim["Callisto"]`` a body at present.
    ``system`` is the System at the start.

    Raises
    ------
    InputError
        If an argument makes no sense, or the engine is not installed or cannot run the system.
    """

    def __init__(
        self,
        system: System | Problem,
        integrator: str | Integrator | None = None,
        dt: float | str | None = None,
        threads: int = 1,
        *,
        engine: str = "native",
        processes: int | None = None,
        hosts: str | os.PathLike[str] | None = None,
        events: Iterable[Event] | None = None,
        **options: Any,
    ) -> None:
        if not isinstance(system, System | Problem):
            raise InputError(f"a Simulation takes a System or a Problem, got {kind_of(system, Simulation)}")
        self._engine = engine_named(engine)
        name, asked = unpacked(integrator, {"dt": dt, **options})
        named = name if name is not None else system.run.integrator
        self.integrator = default_method(system) if named is None else self._engine.method_name(named)
        self.method = method_named(self.integrator)
        self.options = settled(self.method, asked, system.run, getattr(system, "units", None))
        self.dt = self.options.dt
        still = self.dt is None and self.method.needs_dt
        if still and (named is not None or self._engine.foreign or isinstance(system, Problem)):
            raise no_step(system)
        self.threads = check_threads(threads)
        self.hosts = None if hosts is None else str(hosts)
        machines = None if hosts is None else slots(hosts)
        listed = 1 if machines is None else sum(machines.values())
        self.processes = whole_number("processes", listed if processes is None else processes, 1)
        if self.processes > 1:
            here = self.processes if machines is None else on_this_machine(machines, self.processes)
            check_room("run", here, "processes", PROCESS_BYTES, "give fewer")
        if isinstance(system, System):
            system = system if events is None else system.watched(events)
            system = system.with_stages() if system.stages else system  # a run is not a stage; see `staged`
            watched: tuple[Event, ...] = system.events
        else:
            watched = checked_crossings(events or (), len(system.args))
        stepping = self.options.changed(dt=0.0) if still else self.options
        job = Job(system, self.method, self.integrator, stepping, self.threads, self.processes, machines)  # type: ignore[arg-type]
        if self._engine.foreign or self.processes > 1 or hosts:
            self._engine.check(job)
        self.integration = Integration(job, self._engine, watched)
        self._stability = Stability(self.integration)
        self._sampler = Sampler(self.integration, self._stability)
        self._outputs: Outputs = Outputs(self.integration, partial(checkpoint_of, self.integration))
        self.followers: list[Follower] = []  # views that show this Simulation while it runs
        self.plan: Plan | None = None  # the plan of `run` without arguments
        self.state = system.state

    # --- state ---

    @property
    @alone
    def state(self) -> Any:
        """The current State (positions, velocities, time) or ProblemState (y, time); a copy.

        Assigning a state starts a new record of conserved quantities. Raises InputError if a run is in progress, or if
        the state has other particles than the system.

        The step point of an adaptive run may lie before or after ``time``. The run continues from that step point;
        reading the state does not change the run."""
        return self.integration.state

    @state.setter
    @alone
    def state(self, state: Any) -> None:
        if self.running:
            raise InputError("state: is read-only while the Simulation runs")
        self.integration.begin_at(state)
        self._stability.begin_anew(check_at=0)

    @property
    @alone
    def method_state(self) -> Any:
        """State of a method that moves more than positions and velocities. Other methods raise InputError.

        For leapfrog-exact this is a `Lattice` of whole numbers, a copy; ``state`` shows these numbers rounded to
        floats. Assigning a method state resumes a run to the last bit. The assignment
        ``sim.method_state = sim.method_state.reversed()`` reverses the run."""
        return self.integration.stepper_with_state.method_state

    @method_state.setter
    @alone
    def method_state(self, value: Any) -> None:
        if self.running:
            raise InputError("method_state: is read-only while the Simulation runs")
        self.integration.begin_with(value)

    @property
    def lattice(self) -> Any:
        """Old name of ``method_state``, to be removed after version 0.2."""
        _warn_of_lattice()
        return self.method_state

    @lattice.setter
    def lattice(self, value: Any) -> None:
        _warn_of_lattice()
        self.method_state = value

    @alone
    def checkpoint(self) -> Memory:
        """Return everything that determines the rest of the run, by value.

        The checkpoint consists of arrays, numbers, texts, None, and lists and dicts (keyed by text) of these. After
        ``restore``, also in another process, the run continues with the same bits.

        The checkpoint holds the method and its options, and the stepper's own memory with the pair lists (see the
        integrators' pages). It holds the current time if that lies inside a step, the events in progress and the
        remaining bodies. It holds the record without its samples. Taking a checkpoint changes nothing, and is possible
        at any look."""
        return checkpoint_of(self.integration)

    @alone
    def restore(self, checkpoint: Memory) -> None:
        """Continue from a ``checkpoint`` of a Simulation of the same system, method, options and events.

        The number of threads may differ. The record then begins without samples.

        Raises InputError if method, options or bodies differ, if the checkpoint is damaged, or if a run is in
        progress."""
        if self.running:
            raise InputError("restore: the Simulation is already running")
        restore(self.integration, checkpoint)
        if self.integration.ramp:
            self.options = self.integration.options
        self._stability.begin_anew(check_at=2 * self.record.steps)

    @alone
    def report(self) -> Report:
        """Return the report so far: conservation of energy and momentum, and cost."""
        if not self.record.looks:
            self._sampler.look()
            self._stability.look()
        return report(self)

    def plot(self) -> Any:
        """Draw energies, energy error and temperature so far; a matplotlib Figure. See `Report.plot`."""
        return self.report().plot()

    # --- running ---

    @alone
    def run(
        self,
        steps: int | None = None,
        *,
        until: float | str | None = None,
        time: float | str | None = None,
        times: Iterable[float | str] | None = None,
        exact: Exact = False,
        every: int | None = None,
        interval: float | str | None = None,
        output: str | os.PathLike[str] | None = None,
        overwrite: bool = False,
        file: FileOptions | None = None,
        observe: Observer | None = None,
        columns: Iterable[Column] = (),
        progress: bool | Callable[[int, int], Any] | None = None,
        imd: int | None = None,
        imd_wait: bool = False,
        live: bool | int = False,
    ) -> Report:
        """Take ``steps`` steps, run ``until`` a time, for a ``time``, or to each of some ``times``.

        Times are numbers, or texts such as "5 ps".

        An adaptive method reaches any time. Fixed steps run to the nearest whole step, and the report says so. With
        ``exact=True`` a time between two steps is an InputError. With ``exact="shorten"`` a copy takes a shortened last
        step: the last look, ``time`` and ``state`` are there, and a longer run goes on from the last whole step. A time
        before now is a run back in time, for reversible and adaptive methods. A turn begins a new record.

        The run looks at the start, after every ``every`` steps (counted from step 0) and at the end. Each look samples
        the energies, writes a frame to ``output`` (a new .h5md file, or one that this Simulation began) and calls
        ``observe(sim)``. A Problem writes y and its energy to a .h5 file, or at the end to a table (.csv, .parquet). An
        adaptive run may look at every ``interval`` of time instead, which does not change its steps.

        With ``times``, any run looks at its start and at exactly these times, and ends at the last time. Times rise, or
        fall for a run back in time. The steps and their bits stay as they are without ``times``: a state inside a step
        is the interpolant of an adaptive method, or the end of a shortened copy of a fixed step. A time within a
        millionth of a step of a whole step is that step.

        ``file`` sets how the output is written: seconds between flushes, precision, compression, forces and images. The
        values of ``columns`` go to the file beside the energies, and to ``record.samples``. A run that continues a file
        takes the same columns as the file.

        ``every`` defaults to the system file's, or to that of the file that the run continues. Without any of these
        there are about 1000 looks. A run of fewer than 100,000 force evaluations has one look for each 100 evaluations,
        but at least 16000 / bodies. It has at least 50 if these take a tenth of the time of the steps or less.

        ``progress=True`` shows a bar, on a terminal or in a notebook; a function is called as ``progress(done, of)``
        now and then. Ctrl-C ends the run with a KeyboardInterrupt; the steps taken remain, and the file is complete.

        ``imd`` is a port of this machine from which MDAnalysis reads the looks during the run: see docs/mdanalysis.md.
        With ``imd_wait`` the run waits whenever no client is there. ``live=True``, or a port, serves a page on this
        machine that shows the run as it goes on; standard error says the address.

        Returns the Report. Raises InputError for arguments that make no sense, and RunError if the run blows up; the
        state is then that of the last sample.
        """
        check_asked(observe, progress, overwrite)
        self.refuse_still()
        refuse_beside(times, steps=steps, until=until, time=time, every=every, interval=interval, exact=exact or None)
        goal, apart = goal_of(self, steps, until, time), time_of(self, interval, "interval")
        columns = with_body_columns(columns, self.integration)
        own = work_columns(self.system)
        asked = checked_columns(columns, getattr(self.system, "units", None), own)
        written = ColumnWatcher(asked, self.integration, self)
        output = self._outputs.chosen(None if output is None else path_text("run: output", output), overwrite)
        plan = self.plan if times is None else plan_at(self, times_of(self, times))
        if plan is None or (steps, goal, every, apart) != (None,) * 4:
            seen = isinstance(self.system, System) or bool(self.system.energy or observe or written.columns or output)
            plan = plan_of(self, steps, goal, every, apart, self._outputs.own(output), seen, exact)
        check_columns_fit(written.columns, plan)
        run, self.plan = self.integration, None
        begin(self, plan.backward, goal, exact)
        if run.ramp:
            run.ramp_over(plan.whole_steps_end)
            self.options = run.options
        watching: list[Watcher | None] = [
            Events(run.events) if run.events else None,
            self._stability,
            None if imd is None else Imd(run, imd, imd_wait),
            written if written.columns else None,
            self._outputs.watcher(output, plan, overwrite, file, written.described, self.going_on),
            Observe(observe, self) if observe else None,
        ]
        watchers = [each for each in watching if each]
        alone = watchers == [self._stability]
        run.prepare()
        if alone:
            self._sampler.prepare(plan)
        failing = keeping_failed_atoms(run, output)
        with following(progress, "running") as bar, followed(self, bar, live) as told, failing:
            found = run_through(run, self._sampler, plan, watchers, alone, self.report, told)
        return found.written_to(output)

    @alone
    def advance(self, steps: int, *, every: int | None = None, visit: Observer | None = None) -> None:
        """Take ``steps`` steps without a look: nothing is sampled, written or observed.

        The bits equal those of ``run``. ``visit(sim)`` is called after each ``every`` steps and at the end; if it
        returns a true value, the steps end. The steps count in the report. A run that blows up goes back to the last
        look, or to the last assigned state. An event that ends a run also ends the steps here, and ``stopped`` names
        this event. Raises InputError for numbers that make no sense or if a run is in progress, and RunError if the
        run blows up."""
        self.refuse_still()
        steps, every = self.steps_to(steps), every if every is None else whole_number("every", every, 1)
        go_on(self.integration, steps, every, visit, self)

    def continue_in(self, path: str, run_id: str, every: int, plan: Plan | None) -> None:
        """Continue a file that another Simulation of the same run began; ``plan`` is the default of ``run``."""
        self.plan = plan
        self.integration.replaced = False
        self._outputs.continue_in(path, run_id, every, plan)

    @alone
    def equilibrate(
        self,
        temperature: float | str,
        time: float | str | None = None,
        interval: int = 10,
        progress: bool | Callable[[int, int], Any] | None = None,
        *,
        to: float | str | None = None,
        steps: int | None = None,
        integrator: str | None = None,
        **options: Any,
    ) -> None:
        """Bring the system to ``temperature`` in ``time`` or ``steps``, then count steps, time and conservation from
        zero. With ``to``, the temperature goes from ``temperature`` to ``to``, linearly in time. Each may be text with
        a unit, such as "94.4 K" or "5 ps".

        Velocities are rescaled to the temperature every ``interval`` steps (Woodcock 1971,
        doi:10.1016/0009-2614(71)80281-6). A last rescaling sets the total energy to the mean over the second half,
        K(T) + <U>. A following run at constant energy then has ``temperature`` as its mean, not only at its start.
        After a ramp, the last rescaling sets the kinetic energy alone.

        A method with a heat bath rescales nothing. The bath acts with other random numbers than in the run, and its
        memory and heat begin anew at zero. A ramp has 200 stairs of constant temperature. ``integrator`` and its
        ``options`` equilibrate with a heat bath of their own, and ``options`` alone change those of the run's method,
        such as its friction. Raises InputError if the run has a heat bath whose temperature differs from the
        temperature at the end. For an adaptive method, velocity Verlet with the system file's dt does the
        equilibration. ``progress`` is as in ``run``.
        """
        check_asked(None, progress, False, "equilibrate")
        self.refuse_still()
        asked = Equilibration(temperature, time, interval, to, steps, integrator, options)  # type: ignore[arg-type]
        with following(progress, "equilibrating") as told:
            equilibrate(self, asked, told, self._for_equilibration)

    def _for_equilibration(self, name: str, given: dict[str, Any]) -> Simulation:
        """A Simulation of the system by another method: by the program of this run, or natively if that lacks it."""
        lacks = self._engine.foreign and name not in self._engine.methods
        where: dict[str, Any] = {} if lacks else {"engine": self.engine, "processes": self.processes}
        return Simulation(self.system, name, threads=self.threads, events=(), **where, **given)

    @alone
    def minimize(
        self,
        force: float | str = FORCE,
        steps: int = STEPS,
        method: str = METHOD,
        max_displacement: float | str | None = None,
        progress: bool | Callable[[int, int], Any] | None = None,
        *,
        soft: bool = False,
    ) -> Minimum:
        """Move the particles to a minimum of their potential energy; the start may be random.

        The minimization ends when the largest force on a particle is at most ``force``, or after ``steps`` steps of
        ``method``, "fire" or "l-bfgs" (see docs/relax.md). No particle moves further than ``max_displacement`` in one
        step; default a tenth of the shortest sigma. Both may be texts with units. With ``soft``, soft potentials of
        growing strength first draw apart chains that cross (see docs/relax.md). The forces are kickdrift's own, in
        float64, whatever the engine and the precision. ``progress`` is as in ``run``.

        The velocities become zero, time and number of steps stay, and a new record starts. Returns the `Minimum`, which
        says whether the minimization converged. Raises InputError for a Problem and for arguments that make no sense,
        and RunError if the forces at the start are not finite.
        """
        check_asked(None, progress, False, "minimize")
        with following(progress, "minimizing") as told:
            return minimize(self, force, steps, method, max_displacement, soft, told)


def _warn_of_lattice() -> None:
    warn("Simulation.lattice is deprecated since 0.2; use Simulation.method_state", DeprecationWarning, stacklevel=3)

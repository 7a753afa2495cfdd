"""The present of a Simulation: system, time, energies, forces, orbits and events so far."""

from collections.abc import Callable, Iterator
from functools import wraps
from typing import Any, Concatenate, ParamSpec, TypeVar

from kickdrift.engines import Engine
from kickdrift.errors import InputError, RunError
from kickdrift.forces.beside.columns import values_in, with_values
from kickdrift.integrators.method import Method
from kickdrift.looks.observers import Energies, Sample
from kickdrift.looks.record import Record
from kickdrift.model.bodies import Body
from kickdrift.model.orbits import OrbitTable, orbit_table
from kickdrift.model.state import Floats, read_only
from kickdrift.model.system import System
from kickdrift.run.advance import Integration
from kickdrift.run.plan.lengths import Exact, steps_to, time_of
from kickdrift.run.report.shown import ShownSimulation

Given = ParamSpec("Given")
Answer = TypeVar("Answer")


def accelerations_at(run: Integration) -> Floats:
    """Accelerations of the particles now, (n, 3), in the system's units; a read-only copy."""
    return read_only(_accelerations(run, "accelerations").T.copy())


def forces_at(run: Integration) -> Floats:
    """Forces on the particles now, (n, 3), in the system's energy unit per length; a read-only copy."""
    flow: Any = run.flow
    return read_only((_accelerations(run, "forces", felt=True) * flow.subject.coherent_masses).T.copy())


def _accelerations(run: Integration, key: str, felt: bool = False) -> Any:
    """Accelerations now, (3, n), or with ``felt`` the forces over the masses; ``key`` names the quantity in errors."""
    flow: Any = run.flow
    if not flow.of_particles:
        raise InputError(f"{key}: a Problem has no {key}")
    found = (flow.felt if felt and hasattr(flow, "felt") else flow.accelerations)(run.y, run.time)
    if found is None:
        raise RunError(f"step {run.steps_done}: the forces at these positions are not finite")
    return found


def alone(method: Callable[Concatenate[Any, Given], Answer]) -> Callable[Concatenate[Any, Given], Answer]:
    """Make a method of a Simulation raise InputError while another thread is inside such a method.

    Compiled code runs beside other threads and trusts that nobody else writes into its memory."""

    @wraps(method)
    def by_one_thread(self: Any, /, *args: Given.args, **kwargs: Given.kwargs) -> Answer:
        lock = self.integration.lock
        if not lock.acquire(blocking=False):
            raise InputError(f"{method.__name__}: the Simulation is busy in another thread; give each thread its own")
        try:
            return method(self, *args, **kwargs)
        finally:
            lock.release()

    return by_one_thread


class Present(ShownSimulation):
    """The part of a Simulation that only reads its integration."""

    integration: Integration
    method: Method
    integrator: str
    dt: float | None
    _engine: Engine
    _outputs: Any

    @property
    def system(self) -> Any:
        """The System or Problem that runs, as it was at the start, or after the last event that changed its bodies.

        `now` is the System at present."""
        return self.integration.system

    def now(self) -> System:
        """The System at present: the bodies with their positions and velocities of now, in the box of now.

        A new run may begin there: ``kd.Simulation(nvt.now(), "velocity-verlet")``. The System has the present time, no
        steps done, and no ``[equilibrate]`` and ``[invariants]``, which are of the start. Raises InputError for a
        Problem.
        """
        system, state = self.system, self.integration.state
        if not isinstance(system, System):
            raise InputError("now: a Problem has no bodies; the Simulation's state has y")
        return with_values(system.anew(state), values_in(state))

    def __getitem__(self, body: str | int) -> Body:
        """The `Body` of that name or id at present: ``sim["Callisto"].position``. ``sim.system["Callisto"]`` is the
        body at the start. Raises InputError for an unknown name, with the nearest one, and for a Problem."""
        return self.now()[body]

    def __iter__(self) -> Iterator[Body]:
        """The bodies at present."""
        return iter(self.now())

    @property
    def engine(self) -> str:
        """The name of the program that takes the steps."""
        return self._engine.name

    @property
    def engine_version(self) -> str | None:
        """The version of the engine."""
        return self._engine.version

    @property
    def running(self) -> bool:
        """Whether a run is in progress; the state is read-only then."""
        return self.integration.running

    @property
    def record(self) -> Record:
        """The run's samples and cost."""
        return self.integration.record

    @property
    def time(self) -> float:
        """The current time, in the system's unit."""
        return self.integration.time

    @property
    def steps_done(self) -> int:
        """Number of steps since the start. If the current time lies inside a step, that step counts."""
        return self.integration.steps_done

    @alone
    def energy(self) -> Energies:
        """Kinetic, potential and total energy now, in the system's units."""
        return self.sample().energies

    @alone
    def accelerations(self) -> Floats:
        """Accelerations of the particles now, (n, 3), in the system's units; a read-only copy."""
        return accelerations_at(self.integration)

    @alone
    def forces(self) -> Floats:
        """Forces on the particles now, (n, 3), in the system's energy unit per length; a read-only copy."""
        return forces_at(self.integration)

    @alone
    def pressure(self) -> float:
        """Pressure now, in the system's energy unit per volume (per area in two dimensions); nan in open space. Hits of
        hard spheres count since the last look, or since the start; before all steps it is nan."""
        return self.sample().pressure

    @alone
    def elements(self, frame: str = "heliocentric", plane: str = "file") -> OrbitTable:
        """Osculating elements of the bodies now, a table by name: ``sim.elements()["Jupiter"].a``.

        Angles are in degrees, as in system files. ``frame`` is "heliocentric" (about the central body), "jacobi" (in
        the bodies' order) or "barycentric". ``plane`` is "file" (x-y) or "invariable". Raises InputError if no body
        has half of all mass, and for a Problem.
        """
        if not isinstance(self.system, System):
            raise InputError("elements: a Problem has no bodies")
        return orbit_table(self.now(), frame, plane)

    @alone
    def sample(self) -> Sample:
        """Return a sample of the current state."""
        return self.integration.sample()

    @property
    def events(self) -> list[dict[str, Any]]:
        """Events found so far, in the order in which they were found; a copy.

        Each entry has the kind, time, step that contains the event, bodies, ids, distance, energy taken out, and the
        action."""
        return [dict(row) for row in self.record.events]

    @property
    def stopped(self) -> str:
        """Description of what ended the last run before its end, such as an event; "" if nothing did."""
        run = self.integration
        return (run.events.stopped if run.events else "") or run.ended

    def going_on(self) -> list[dict[str, Any]]:
        """Return the close approaches that have not ended, as entries like those in ``events``."""
        return self.integration.events.going_on() if self.integration.events else []

    @property
    def box_varies(self) -> bool:
        """Whether a barostat changes the box; ``state.box`` is the box of now."""
        return self.integration.box_varies

    @property
    def output(self) -> str | None:
        """Default output of ``run``: the file of a resumed run, else None."""
        found: str | None = self._outputs.default
        return found

    def steps_to(self, steps: int | None = None, until: float | str | None = None, exact: Exact = False) -> int:
        """Return the number of steps that ``run(steps)`` or ``run(until=…, exact=…)`` would take now.

        Raises InputError if the arguments make no sense, or if the number is unknown before the run (an adaptive method
        with ``until``)."""
        self.refuse_still()
        return steps_to(self, steps, time_of(self, until, "until"), exact)

    def refuse_still(self) -> None:
        """Refuse steps of a Simulation that was made without dt."""
        if self.dt is None and self.method.needs_dt:
            raise no_step(self.system)


def no_step(system: Any) -> InputError:
    """The error of a method with fixed steps that got no dt."""
    return InputError(f"dt is needed: system {system.name!r} has no dt in [run]")

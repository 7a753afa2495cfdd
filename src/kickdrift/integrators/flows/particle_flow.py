"""Flow of a System: the view that integrators have of its particles under their forces, its states and its samples."""

from typing import Any

import numpy as np

from kickdrift.errors import InputError, RunError
from kickdrift.forces.bound.forces import BoundForces
from kickdrift.forces.bound.table import SLOTS
from kickdrift.forces.external.kernel import Host
from kickdrift.forces.pairs.law import PairForce
from kickdrift.forces.seam.group import ListedForce
from kickdrift.forces.seam.kernel import OK
from kickdrift.forces.slopes.variations import particles_in
from kickdrift.integrators.flows.jacobian import difference_jacobian
from kickdrift.integrators.options import APART, FULL
from kickdrift.looks.columns import PRESSURE, VIRIAL
from kickdrift.looks.doubts import explain, nearest_pair
from kickdrift.looks.looking import CHANGING, HEAD, NO_ENERGY, VOLUMES, Looking, desk_of, look
from kickdrift.looks.observers import Looks, Sample
from kickdrift.looks.record import Record
from kickdrift.looks.tensor import components
from kickdrift.model.body_checks import check_plane
from kickdrift.model.box.box import Box
from kickdrift.model.checks.values import check_state, no_overflow, unwarned
from kickdrift.model.live_box import LiveBox, in_box
from kickdrift.model.molecules.constraints import on_manifold
from kickdrift.model.starts.builders import check_overlaps
from kickdrift.model.state import Floats, State
from kickdrift.model.system import System


class ParticleStates:
    """States, samples and blow-ups of a System's particles, for any flow. Each flow defines ``look``."""

    raised: BaseException | None = None
    of_particles = True
    halves = 2
    hits = False  # whether hard spheres hit between two looks, so that the pressure needs both
    carries = False  # whether unknowns beside the bodies can advance apart from them: see ``Method.carries_unknowns``

    def __init__(self, system: System) -> None:
        with no_overflow():
            check_overlaps(system, near=False)
        self.subject = system
        self.live: LiveBox | None = None  # the box of a run with a barostat
        self.name = system.name
        self._ends = np.empty((2, 3, len(system)))  # (2, 3, n) a copy of the sampled state

    def look(self, looks: Looks, y: Floats, time: float, step: int, last: Floats, fresh: bool = False) -> int:
        """Fill the table's next row with a sample of y, and ``last`` with y. Return a status. ``fresh`` says whether
        the run's forces were last evaluated at y."""
        raise NotImplementedError

    @property
    def clocked(self) -> bool:
        """Tell whether f may depend on time: true for a user's own force class, unless the class denies it."""
        return any(clocked(force) for force in self.subject.forces)

    def state(self, y: Floats, time: float, steps: int) -> State:
        """Copy of y as a State."""
        return self.shared_state(y, time, steps).copy()

    def shared_state(self, y: Floats, time: float, steps: int) -> State:
        """y as a State that shares memory with y and with the System."""
        own = self.subject.state
        if (sites := self.subject.virtual_sites) is not None:
            sites.place(y[0])
        return State(y, own.masses, own.ids, self.box, time, steps)

    @property
    def box_varies(self) -> bool:
        """Whether a barostat changes the box."""
        return self.live is not None

    @property
    def box(self) -> Box:
        """The box now."""
        return self.subject.box if self.live is None else self.live.box

    @box.setter
    def box(self, box: Box) -> None:
        if self.live is not None:
            self.live.box = box

    @property
    def present(self) -> System:
        """The System in the box of now."""
        return self.subject if self.live is None else in_box(self.subject, self.live.box)

    def array(self, state: State) -> Floats:
        """Checked copy of a State as y."""
        check_state(state, State)
        own = self.subject.state
        if len(state) != len(own):
            raise InputError(f"state: expected {len(own)} particles, got {len(state)}")
        if not (np.array_equal(state.ids, own.ids) and np.array_equal(state.masses, own.masses)):
            raise InputError("state: ids and masses must equal the system's, in the same order")
        if self.live is None and state.box != own.box:
            raise InputError(f"state: the box is {state.box.shape}, but the system's is {own.box.shape}")
        if not np.all(np.isfinite(state.phase)):
            raise InputError("state: positions and velocities must be finite")
        if self.subject.dimensions == 2:
            check_plane(state.phase)
        held = self.subject.constraints
        phase = (
            state.phase
            if held is None
            else on_manifold(self.subject, held, self.subject.coherent_masses, state.phase)[0]
        )
        for force in self.subject.forces:
            if getattr(force, "reflects", False):
                force.check(self.subject.at(phase, state.time))  # no particle may be behind it
        if (sites := self.subject.virtual_sites) is not None:
            phase = sites.settled(self.subject.box, held, phase)
        if (fixed := self.subject.fixed) is not None:
            phase = fixed.settled(phase)
        return np.array(phase, dtype=float, order="C")

    def look_cost(self, fresh: bool) -> float:
        """Time of a look in evaluations of the forces. ``fresh`` is as in `looking`."""
        return TAKEN_COST

    def begin(self, record: Record, y: Floats) -> None:
        """Begin a record of conservation here."""
        record.begin(self.subject.coherent_masses, y)
        record.from_start = np.array_equal(y[0], self.subject.state.phase[0])

    def refused(self, status: int, step: int, time: float) -> RunError:
        """Error of a failed sample."""
        if status == NO_ENERGY:
            return RunError(f"step {step} (t = {time:g}): the energy is not finite")
        return RunError(f"step {step} (t = {time:g}): the forces at these positions are not finite")

    def sample(self, y: Floats, time: float, steps: int, fresh: bool = False) -> Sample:
        """Sample of all observables at y."""
        one = Looks(room=1)
        status = self.look(one, y, time, steps, self._ends, fresh)
        if status != OK:
            raise self.refused(status, steps, time)
        if self.hits:
            one.rows[0, PRESSURE] = np.nan
        one.keep(steps)
        return one.samples[0]

    def forget_errors(self) -> None:
        """Do nothing: compiled forces raise no errors."""

    def explain(self, y: Floats, before: Floats, good: Floats, step: int, time: float, good_step: int) -> str:
        """One line about a blow-up. ``before`` (3, n) holds the particles' positions a step before y."""
        return explain(self.present, y, before, good, step, time, good_step)


def clocked(force: Any) -> bool:
    """Tell whether a force may depend on time."""
    own = isinstance(force, PairForce) or type(force).__module__.startswith("kickdrift.")
    return bool(getattr(force, "time_dependent", not own))


# time of a look in evaluations of the forces: with the sums of the last evaluation, with one of its own, and with one
# that makes its lists first
TAKEN_COST, APART_COST, LISTED_COST = 0.45, 1.2, 4.0
MANY = 50_000  # particles whose lists are not kept for samples alone


class ParticleFlow(ParticleStates):
    """A System's particles under its forces."""

    def __init__(self, system: System, threads: int, jumps: bool, mixed: bool = False, coupling: str = "") -> None:
        super().__init__(system)
        self.live = LiveBox(system.box, coupling == FULL) if coupling else None
        under = self._under(system)
        apart = coupling in APART
        self.forces = BoundForces(under, threads, jumps=jumps, mixed=mixed, live=self.live, apart=apart, hold=True)
        self._listed = any(isinstance(force, ListedForce) for force in system.forces)
        self._shared = (self._listed or self.forces.sums_before_samples) and not mixed
        # a sample must not change the run's lists; lists of many particles take much memory, and are made when needed
        self._kept = None if self._listed and len(system) >= MANY else self._forces_aside(system)
        self._seen: tuple[Floats, Floats, float, Floats, Floats] | None = None  # y, edges, virial, its parts, forces
        self.others: BoundForces | None = None  # forces that a method has bound by itself
        self._look_at(system)
        if system.dimensions == 2:
            self._check_in_plane()
        culprits = system.acting("velocity_dependent")
        self.not_separable = f"force {culprits[0]!r} depends on velocity" if culprits else None

    def _forces_aside(self, system: System) -> BoundForces:
        """Forces with lists of their own, for one set of positions."""
        free = self.live is not None and self.live.free
        aside = BoundForces(self._under(system), self.forces.threads, thin=True, live=self.live, apart=free, hold=True)
        aside.follow(self.forces)
        return aside

    @property
    def _aside(self) -> BoundForces:
        """Forces that share no lists with the run."""
        return self._kept or self._forces_aside(self.subject)

    def kick_apart(self, forces: list[Any]) -> None:
        """Let steps kick by these forces in place of the System's. Samples have the System's."""
        self.forces = BoundForces(self.subject.under(forces), self.forces.threads)
        self._shared = False

    def _under(self, system: System) -> Any:
        """The forces of the flow, see ``BoundForces``."""
        return system

    def _check_in_plane(self) -> None:
        """Refuse forces that push particles of a two-dimensional system out of the plane."""
        measured = self._aside.measure(self.subject.state.time, self.array(self.subject.state))
        off = np.flatnonzero(measured.accelerations[2] if measured is not None else 0)
        if len(off):
            raise InputError(
                f"dimensions: the forces push {self.subject.body(int(off[0]))} out of the system's two dimensions"
            )

    def count_bath(self, drags: bool) -> None:
        """Take temperatures of samples as a heat bath does, which may change the total momentum."""
        self._desk[:HEAD] = desk_of(self.subject, True, drags)[:HEAD]

    def count_hits(self) -> None:
        """Give samples the pressure of the motion, to which the method adds that of the hits since the look before."""
        self.hits = True
        self._desk[:HEAD] = desk_of(self.subject, hits=True)[:HEAD]

    @unwarned
    def tune(self, y: Floats, between: float) -> None:
        """Adapt pair lists to the particles' speed at y, with this time between two evaluations of the forces."""
        speeds = np.sqrt((y[1, :, : particles_in(self.subject)] ** 2).sum(axis=0))
        self.forces.tune(float(speeds.max()) * between)

    # --- samples ---

    def pressure_of_motion(self, y: Floats, time: float) -> float:
        """Pressure at y without that of the hits of hard spheres."""
        one = Looks(room=1)
        self.look(one, y, time, 0, self._ends)
        return float(one.rows[0, PRESSURE])

    def _look_at(self, system: System) -> None:
        self._desk = desk_of(system)
        self._cursor = np.zeros(SLOTS, np.int64)
        self._one = Looks(room=1)

    def _looks(self, fresh: bool = False) -> BoundForces:
        """Forces for a sample. If the run's own forces were last evaluated at these positions, their pair lists are
        valid, and another evaluation changes nothing in them. Else the lists are made anew, so that a sample depends
        only on the run, and on no earlier sample."""
        if fresh and self._shared:
            return self.forces
        aside = self._aside
        if self._listed:
            aside.forget()
        return aside

    def look(self, looks: Looks, y: Floats, time: float, step: int, last: Floats, fresh: bool = False) -> int:
        """See ParticleStates."""
        row = looks.free()
        if self.live:
            self._desk[CHANGING] = self.live.volume
            self._desk[VOLUMES] = self.subject.dimensions * self.live.volume
        forces = self._looks(fresh)
        status = forces.call(look, time, _plain(y), self._desk, last, looks.rows, row, self._cursor)
        if self.live and self.live.free and forces.along is not None:
            virial, n = float(looks.rows[row, VIRIAL]), y.shape[2]
            felt = self._desk[HEAD + n : HEAD + 4 * n].reshape(3, n).copy()
            self._seen = y.copy(), self.live.lengths.copy(), virial, forces.along.copy(), felt
        return status

    def pressure_tensor(self, y: Floats, time: float, drags: bool) -> Floats:
        """Components (6,) of the pressure at y in a box that changes its shape, see `looks.tensor`."""
        assert self.live is not None
        if self._seen is None or not (
            np.array_equal(self._seen[0], y) and np.array_equal(self._seen[1], self.live.lengths)
        ):  # no sample was taken here
            self.sample(y, time, 0)
        assert self._seen is not None
        _, _, virial, along, a = self._seen
        return components(self.subject, y, virial, along, a, self.live.volume, drags)

    def looking(self, fresh: bool) -> Looking | None:
        """Data for many samples in a row by compiled code; None if pair lists are made anew each time."""
        if self.live or (self._listed and not (fresh and self._shared)):
            return None
        return Looking(self._looks(fresh), self._desk, self._cursor)

    def look_cost(self, fresh: bool) -> float:
        """See ParticleStates."""
        if fresh and self._shared:
            return TAKEN_COST
        return LISTED_COST if self._listed else APART_COST

    def accelerations(self, y: Floats, time: float) -> Floats | None:
        """Accelerations (3, n) at y; None if they are not finite."""
        if self.look(self._one, y, time, 0, self._ends) not in (OK, NO_ENERGY):
            return None
        n = len(self.subject)
        return self._desk[HEAD + n : HEAD + 4 * n].reshape(3, n).copy()

    def felt(self, y: Floats, time: float) -> Floats | None:
        """Forces over masses (3, n) at y, also of fixed particles, which they do not accelerate; None if not finite."""
        if self.subject.fixed is None:
            return self.accelerations(y, time)
        found = BoundForces(self._under(self.subject), self.forces.threads).measure(time, _plain(y))
        return None if found is None else found.accelerations[:, : len(self.subject)]

    def prepare(self, y: Floats, time: float) -> None:
        """Compile the code for samples."""
        self.look(self._one, y, time, 0, self._ends)

    def derivative(self, time: float, y: Floats) -> Floats:
        """Return f(t, y), without using the run's own pair lists."""
        return self.apart().derivative(time, y)

    def apart(self) -> BoundForces:
        """Forces that share no pair lists with the run. Their lists are made anew at the next evaluation."""
        return self._looks()

    analytic = False  # the Jacobian is by differences

    def jacobian(self, time: float, y: Floats) -> Floats:
        """Jacobian (N, N) df_i / dy_j of the flattened y by central differences."""
        return difference_jacobian(self.apart().derivative, time, y)

    @property
    def raised(self) -> BaseException | None:  # type: ignore[override]
        """Exception that a force's Python code raised."""
        return next((host.error for host in self._hosts if host.error), None)

    @property
    def _hosts(self) -> list[Host]:
        """Hosts of all Python code that steps call."""
        both = (self.forces, self.others) if self.others else (self.forces,)
        return [host for forces in both for host in forces.hosts if host is not None]

    def forget_errors(self) -> None:
        """Forget earlier exceptions, which do not concern the coming steps."""
        for host in self._hosts:
            host.error = None

    @property
    def failure(self) -> str:
        """One line about a force whose Python code raised or returned no finite numbers at the last call; else ""."""
        return next((host.failure for host in self._hosts if host.failure), "")

    def refused(self, status: int, step: int, time: float) -> RunError:
        """See ParticleStates."""
        if not (line := self.failure):
            return super().refused(status, step, time)
        error = RunError(f"step {step} (t = {time:g}): {line}")
        error.__cause__ = self.raised
        return error

    def explain(self, y: Floats, before: Floats, good: Floats, step: int, time: float, good_step: int) -> str:
        """One line about a blow-up, or about a force's Python code that raised or returned no finite numbers."""
        if line := self.failure:
            return f"step {step} (t = {time:.6g}): {line}"
        return super().explain(y, before, good, step, time, good_step)

    def meeting(self, y: Floats, time: float) -> str:
        """Name the nearest particles, for the end of a line about failed steps."""
        return nearest_pair(self.present, y[0])


def _plain(y: Floats) -> Floats:
    """The same numbers in the form for compiled code: contiguous and writable."""
    return y if y.flags.c_contiguous and y.flags.writeable else np.array(y, dtype=float, order="C")

"""Flow of a System: the view that integrators have of its particles under their forces."""

from __future__ import annotations

from typing import Any

import numpy as np

from kickdrift.errors import InputError, RunError
from kickdrift.forces.bound import BoundForces
from kickdrift.forces.evaluate import SLOTS
from kickdrift.forces.kernel import OK
from kickdrift.forces.pair_law import PairForce
from kickdrift.integrators.jacobian import difference_jacobian
from kickdrift.looks.blow_up import explain, nearest_pair
from kickdrift.looks.looking import HEAD, NO_ENERGY, Looking, desk_of, look
from kickdrift.looks.observers import Sample
from kickdrift.looks.record import Record
from kickdrift.looks.table import Looks
from kickdrift.model.checks import check_state, no_overflow, unwarned
from kickdrift.model.space import check_plane
from kickdrift.model.starts.builders import check_overlaps
from kickdrift.model.state import Floats, State
from kickdrift.model.system import System


class ParticleFlow:
    """A System's particles under its forces."""

    raised: BaseException | None = None
    of_particles = True

    def __init__(self, system: System, threads: int, jumps: bool, mixed: bool = False) -> None:
        with no_overflow():
            check_overlaps(system)
        self.subject = system
        self.name = system.name
        self.halves = 2
        self.forces = BoundForces(system, threads, jumps=jumps, mixed=mixed)
        self._aside = BoundForces(
            system, threads, thin=True
        )  # with own lists: a sample must not change the run's lists
        self._listed = any(isinstance(force, PairForce) for force in system.forces)
        self._shared = self._listed and not mixed
        self._look_at(system)
        if system.dimensions == 2:
            self._check_in_plane()
        culprits = system.acting("velocity_dependent")
        self.not_separable = f"force {culprits[0]!r} depends on velocity" if culprits else None

    def _check_in_plane(self) -> None:
        """Refuse forces that push particles of a two-dimensional system out of the plane."""
        measured = self._aside.measure(self.subject.state.time, self.subject.state.phase)
        off = np.flatnonzero(measured.accelerations[2] if measured is not None else 0)
        if len(off):
            raise InputError(
                f"dimensions: the forces push {self.subject.body(int(off[0]))} out of the system's two dimensions"
            )

    @property
    def clocked(self) -> bool:
        """Tell whether f may depend on time: true for a user's own force class, unless the class denies it."""
        return any(_clocked(force) for force in self.subject.forces)

    def state(self, y: Floats, time: float, steps: int) -> State:
        """Copy of y as a State."""
        own = self.subject.state
        return State(y.copy(), own.masses.copy(), own.ids.copy(), own.box, time, steps)

    def array(self, state: State) -> Floats:
        """Checked copy of a State as y."""
        check_state(state, State)
        own = self.subject.state
        if len(state) != len(own):
            raise InputError(f"state: expected {len(own)} particles, got {len(state)}")
        if not (np.array_equal(state.ids, own.ids) and np.array_equal(state.masses, own.masses)):
            raise InputError("state: ids and masses must equal the system's, in the same order")
        if state.box != own.box:
            raise InputError(f"state: the box is {state.box.shape}, but the system's is {own.box.shape}")
        if not np.all(np.isfinite(state.phase)):
            raise InputError("state: positions and velocities must be finite")
        if self.subject.dimensions == 2:
            check_plane(state.phase)
        return np.array(state.phase, dtype=float, order="C")

    @unwarned
    def tune(self, y: Floats, between: float) -> None:
        """Adapt pair lists to the particles' speed at y, with this time between two evaluations of the forces."""
        self.forces.tune(float(np.sqrt((y[1] ** 2).sum(axis=0).max())) * between)

    def begin(self, record: Record, y: Floats) -> None:
        """Begin a record of conservation here."""
        record.begin(self.subject.coherent_masses, y)

    # --- samples ---

    def _look_at(self, system: System) -> None:
        self._desk = desk_of(system)
        self._cursor = np.zeros(SLOTS, np.int64)
        self._ends = np.empty((2, 3, len(system)))  # (2, 3, n) a copy of the sampled state
        self._one = Looks(room=1)

    def _looks(self, fresh: bool = False) -> BoundForces:
        """Forces for a sample. If the run's own forces were last evaluated at these positions, their pair lists are
        valid, and another evaluation changes nothing in them. Else the lists are made anew, so that a sample depends
        only on the run, and on no earlier sample."""
        if fresh and self._shared:
            return self.forces
        if self._listed:
            self._aside.forget()
        return self._aside

    def look(self, looks: Looks, y: Floats, time: float, step: int, last: Floats, fresh: bool = False) -> int:
        """Fill the table's next row with a sample of y, and ``last`` with y. Return a status. ``fresh`` says whether
        the run's forces were last evaluated at y."""
        row = looks.free()
        return self._looks(fresh).call(look, time, _plain(y), self._desk, last, looks.rows, row, self._cursor)

    def looking(self, fresh: bool) -> Looking | None:
        """Data for many samples in a row by compiled code; None if pair lists are made anew each time."""
        if self._listed and not (fresh and self._shared):
            return None
        return Looking(self._looks(fresh), self._desk, self._cursor)

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
        one.keep(steps)
        return one.samples[0]

    def accelerations(self, y: Floats, time: float) -> Floats | None:
        """Accelerations (3, n) at y; None if they are not finite."""
        if self.look(self._one, y, time, 0, self._ends) not in (OK, NO_ENERGY):
            return None
        n = len(self.subject)
        return self._desk[HEAD + n :].reshape(3, n).copy()

    def forget_errors(self) -> None:
        """Do nothing: compiled forces raise no errors."""

    def prepare(self, y: Floats, time: float) -> None:
        """Compile the code for samples."""
        self.look(self._one, y, time, 0, self._ends)

    def derivative(self, time: float, y: Floats) -> Floats:
        """Return f(t, y), without using the run's own pair lists."""
        return self._looks().derivative(time, y)

    analytic = False  # of the Jacobian

    def jacobian(self, time: float, y: Floats) -> Floats:
        """Jacobian (N, N) df_i / dy_j of the flattened y by central differences."""
        return difference_jacobian(self._looks().derivative, time, y)

    def explain(self, y: Floats, before: Floats, good: Floats, step: int, time: float, good_step: int) -> str:
        """One line about a blow-up. ``before`` (3, n) holds the particles' positions a step before y."""
        return explain(self.subject, y, before, good, step, time, good_step)

    def meeting(self, y: Floats) -> str:
        """Name the nearest particles, for the end of a line about failed steps."""
        return nearest_pair(self.subject, y[0])


def _plain(y: Floats) -> Floats:
    """The same numbers in the form for compiled code: contiguous and writable."""
    return y if y.flags.c_contiguous and y.flags.writeable else np.array(y, dtype=float, order="C")


def _clocked(force: Any) -> bool:
    own = isinstance(force, PairForce) or type(force).__module__.startswith("kickdrift.")
    return bool(getattr(force, "time_dependent", not own))

"""States and samples of a System's particles, for every flow of them."""

from __future__ import annotations

from typing import Any

import numpy as np

from kickdrift.errors import InputError, RunError
from kickdrift.forces.pairs.law import PairForce
from kickdrift.forces.seam.kernel import OK
from kickdrift.looks.blow_up import explain
from kickdrift.looks.looking import NO_ENERGY
from kickdrift.looks.observers import Sample
from kickdrift.looks.record import Record
from kickdrift.looks.table import Looks
from kickdrift.model.box.box import Box
from kickdrift.model.checks.values import check_state, no_overflow
from kickdrift.model.live_box import LiveBox, in_box
from kickdrift.model.space import check_plane
from kickdrift.model.starts.builders import check_overlaps
from kickdrift.model.state import Floats, State
from kickdrift.model.system import System


class ParticleStates:
    """States, samples and blow-ups of a System's particles, for any flow. Each flow defines ``look``."""

    raised: BaseException | None = None
    of_particles = True
    halves = 2

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
        return np.array(state.phase, dtype=float, order="C")

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

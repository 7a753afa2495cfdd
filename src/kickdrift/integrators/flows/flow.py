"""Flows, the views that integrators have of a System or a Problem: y' = f(t, y), with y one array.

y is (2, 3, n) for particles, positions and velocities; (2, 1, n / 2) for a separable Problem; (1, 1, n) for any other.
"""

from dataclasses import replace
from typing import Any

import numpy as np

from kickdrift.errors import InputError
from kickdrift.forces.around.spins import UnderSpins, first_spins, spinning
from kickdrift.forces.seam.kernel import OK
from kickdrift.integrators.flows.particle_flow import ParticleFlow
from kickdrift.integrators.flows.problem_flow import ProblemFlow
from kickdrift.looks.columns import ANGULAR
from kickdrift.looks.looking import HEAD
from kickdrift.looks.observers import Looks
from kickdrift.looks.record import Record
from kickdrift.model.problem import Problem
from kickdrift.model.state import Floats, State
from kickdrift.model.system import System

MOST = 256  # bodies whose pairs are all searched for events; the tree of more bodies knows no spins


class SpinningFlow(ParticleFlow):
    """A System's bodies and their spins. y is (2, 3, 2 n): see ``forces.around.spins``."""

    def __init__(self, system: System, threads: int, jumps: bool, mixed: bool = False, coupling: str = "") -> None:
        if mixed or coupling:
            raise InputError("tides-spin: takes neither mixed precision nor a barostat")
        if any(getattr(event, "action", "log") not in ("log", "stop") for event in system.events):
            raise InputError("tides-spin: its bodies may neither merge nor leave; give events the action log or stop")
        if len(system) > MOST and system.events:
            raise InputError(f"tides-spin: takes events of up to {MOST} bodies; this system has {len(system)}")
        self._spins, self._inertia = first_spins(system)
        super().__init__(system, threads, jumps)

    def _under(self, system: System) -> Any:
        return UnderSpins(system)

    def _look_at(self, system: System) -> None:
        super()._look_at(system)
        n = len(system)
        desk = np.zeros(HEAD + 8 * n)  # spins have no mass, and add nothing to sums over particles
        desk[: HEAD + n] = self._desk[: HEAD + n]
        self._desk, self._ends = desk, np.empty((2, 3, 2 * n))

    def array(self, state: State) -> Floats:
        """Checked copy of a State as y; spins that the State does not have are those of the start."""
        phase = super().array(state)
        spins = self._spins if state.spins is None else np.asarray(state.spins, dtype=float)
        if spins.shape != self._spins.shape or not np.isfinite(spins).all():
            raise InputError(f"state: expected finite spins of shape {self._spins.shape}")
        return np.concatenate([phase, np.array([np.zeros_like(spins), spins])], axis=2)

    def shared_state(self, y: Floats, time: float, steps: int) -> State:
        """y as a State; see ParticleStates."""
        n = len(self.subject)
        return replace(super().shared_state(y[:, :, :n], time, steps), spins=y[1, :, n:])

    def look(self, looks: Looks, y: Floats, time: float, step: int, last: Floats, fresh: bool = False) -> int:
        """See ParticleStates; the angular momentum includes the spins."""
        row = looks.free()
        status = super().look(looks, y, time, step, last, fresh)
        if status == OK:
            looks.rows[row, ANGULAR : ANGULAR + 3] += y[1, :, len(self.subject) :] @ self._inertia
        return status

    def looking(self, fresh: bool) -> None:
        """None: compiled looks know no spins."""
        return

    def accelerations(self, y: Floats, time: float) -> Floats | None:
        """Accelerations (3, n) of the bodies at y; None if they are not finite."""
        if self.look(self._one, y, time, 0, self._ends) != OK:
            return None
        n = len(self.subject)
        return self._desk[HEAD + 2 * n :].reshape(3, 2 * n)[:, :n].copy()

    def begin(self, record: Record, y: Floats) -> None:
        """Begin a record of conservation here."""
        super().begin(record, y[:, :, : len(self.subject)])

    def explain(self, y: Floats, before: Floats, good: Floats, step: int, time: float, good_step: int) -> str:
        """See ParticleFlow."""
        n = len(self.subject)
        return super().explain(y[:, :, :n], before[:, :n], good[:, :, :n], step, time, good_step)

    def meeting(self, y: Floats) -> str:
        """See ParticleFlow."""
        return super().meeting(y[:, :, : len(self.subject)])


Flow = ParticleFlow | ProblemFlow


def flow_of(subject: System | Problem, threads: int, jumps: bool, mixed: bool = False, coupling: str = "") -> Flow:
    """Flow of a System or a Problem. With ``jumps``, trial steps may go far astray. With ``mixed``, pair forces are in
    mixed precision. A barostat's ``coupling`` says which edges change."""
    if isinstance(subject, System):
        kind = SpinningFlow if spinning(subject) else ParticleFlow
        return kind(subject, threads, jumps, mixed, coupling)
    if mixed and isinstance(subject, Problem):
        raise InputError(f"precision: mixed needs pair forces; {subject.name!r} is an ODE")
    if isinstance(subject, Problem):
        return ProblemFlow(subject, threads, jumps)
    raise InputError(f"a Simulation takes a System or a Problem, got {type(subject).__name__}")

"""Flows, the views that integrators have of a System or a Problem: y' = f(t, y), with y one array.

y is (2, 3, n) for particles, positions and velocities; (2, 1, n / 2) for a separable Problem; (1, 1, n) for any other.
"""

from dataclasses import replace
from itertools import pairwise
from typing import Any

import numpy as np

from kickdrift.errors import InputError, RunError
from kickdrift.forces.beside.columns import UnderColumns, further
from kickdrift.forces.beside.unknowns import UNKNOWNS, Beside
from kickdrift.forces.bound.forces import check_threads
from kickdrift.forces.seam.kernel import OK
from kickdrift.integrators.flows.particle_flow import ParticleFlow
from kickdrift.integrators.flows.problem_flow import ProblemFlow
from kickdrift.jit.cache.notices import compiling_for
from kickdrift.looks.columns import ANGULAR
from kickdrift.looks.looking import HEAD
from kickdrift.looks.observers import Looks, Sample
from kickdrift.looks.record import Record
from kickdrift.model.problem import Problem
from kickdrift.model.state import Floats, State, read_only
from kickdrift.model.system import System

HUGE = 1e100  # no unknown is as large before it blows up
MOST = 256  # bodies whose pairs are all searched for events; the tree of more bodies knows no spins


class FlowBeside(ParticleFlow):
    """A System's bodies, and unknowns beside them. y has further columns: see ``forces.beside.columns``."""

    def __init__(self, system: System, threads: int, jumps: bool, mixed: bool = False, coupling: str = "") -> None:
        names = " and ".join(own.force.name for own in further(system))
        if mixed or coupling:
            raise InputError(f"{names}: takes neither mixed precision nor a barostat")
        if any(getattr(event, "action", "log") not in ("log", "stop") for event in system.events):
            raise InputError(f"{names}: its bodies may neither merge nor leave; give events the action log or stop")
        if len(system) > MOST and system.events:
            raise InputError(f"{names}: takes events of up to {MOST} bodies; this system has {len(system)}")
        if system.tied_by:
            raise InputError(f"{names}: moves free bodies, and {system.name!r} has {system.tied_by}")
        self._own = further(system)
        self._first = {own.columns.key: own.columns.first(own.force, system) for own in self._own}
        ends = np.cumsum([len(system), *(value.shape[-1] for value in self._first.values())])
        self._at = {key: slice(*pair) for key, pair in zip(self._first, pairwise(ends.tolist()), strict=True)}
        self._moments = [
            (self._at[own.columns.key], own.columns.moments(own.force, system))
            for own in self._own
            if own.columns.moments
        ]
        super().__init__(system, threads, jumps)
        if self.not_separable is None:
            self.not_separable = f"force {names!r} has unknowns beside the bodies"
            self.carries = True

    def _under(self, system: System) -> Any:
        return UnderColumns(system)

    def _look_at(self, system: System) -> None:
        super()._look_at(system)
        n, width = len(system), self._width
        desk = np.zeros(HEAD + 4 * width)  # further columns have no mass, and add nothing to sums over particles
        desk[: HEAD + n] = self._desk[: HEAD + n]
        self._desk, self._ends = desk, np.empty((2, 3, width))

    @property
    def _width(self) -> int:
        """Number of columns."""
        return max(each.stop for each in self._at.values())

    def array(self, state: State) -> Floats:
        """Checked copy of a State as y; values that the State does not have are those of the start."""
        phase = super().array(state)
        y = np.zeros((2, 3, self._width))
        y[:, :, : len(self.subject)] = phase
        for key, first in self._first.items():
            given = getattr(state, key)
            values = first if given is None else np.asarray(given, dtype=float)
            if values.shape != first.shape or not np.isfinite(values).all():
                raise InputError(f"state: expected finite {key} of shape {first.shape}")
            y[1, : len(np.atleast_2d(values)), self._at[key]] = values
        return y

    def shared_state(self, y: Floats, time: float, steps: int) -> State:
        """y as a State; see ParticleStates."""
        state = super().shared_state(y[:, :, : len(self.subject)], time, steps)
        return replace(state, **self.values(y))  # type: ignore[arg-type]

    def values(self, y: Floats) -> dict[str, Floats]:
        """The values of further columns as a State holds them."""
        return {key: y[1, : (3 if first.ndim == 2 else 1), self._at[key]].reshape(first.shape)
                for key, first in self._first.items()}  # fmt: skip

    def own_tolerances(self, atol: Floats) -> None:
        """Put the absolute tolerances of unknowns into ``atol``, one for each number of y. The time integrals of
        unknowns, which stand in place of positions, count in no error."""
        rows = atol.reshape(2, 3, self._width)
        for own in self._own:
            if (given := getattr(own.force, "atol", None)) is not None:
                rows[1, 0, self._at[own.columns.key]] = given
            if own.columns.moments is None:
                rows[0, :, self._at[own.columns.key]] = np.inf

    def carried(self) -> Any:
        """Hand the unknowns to a method that advances them by itself, and return their compiled form."""
        self.forces.compile()
        laws = (getattr(force.parts, "law", None) for force in self.forces.forces)
        own: Any = next(law for law in laws if hasattr(law, "split"))
        own.split[0] = 1
        return own

    def look(self, looks: Looks, y: Floats, time: float, step: int, last: Floats, fresh: bool = False) -> int:
        """See ParticleStates; the angular momentum includes the spins."""
        row = looks.free()
        status = super().look(looks, y, time, step, last, fresh)
        if status == OK:
            for at, weights in self._moments:
                looks.rows[row, ANGULAR : ANGULAR + 3] += y[1, :, at] @ weights
        return status

    def looking(self, fresh: bool) -> None:
        """None: compiled looks know bodies alone."""
        return

    def accelerations(self, y: Floats, time: float) -> Floats | None:
        """Accelerations (3, n) of the bodies at y; None if they are not finite."""
        if self.look(self._one, y, time, 0, self._ends) != OK:
            return None
        width = self._width
        return self._desk[HEAD + width :].reshape(3, width)[:, : len(self.subject)].copy()

    def begin(self, record: Record, y: Floats) -> None:
        """Begin a record of conservation here."""
        super().begin(record, y[:, :, : len(self.subject)])

    def explain(self, y: Floats, before: Floats, good: Floats, step: int, time: float, good_step: int) -> str:
        """See ParticleFlow; also names an unknown that has blown up."""
        n = len(self.subject)
        for force in (own.force for own in self._own if own.force.name == Beside.name):
            values = self.values(y)[UNKNOWNS]
            largest = int(np.argmax(np.where(np.isnan(values), np.inf, np.abs(values))))
            if np.isfinite(y[:, :, :n]).all() and not abs(values[largest]) <= HUGE:
                value = f"{force.names[largest]} is {values[largest]:.3g}"
                return f"step {step} (t = {time:.6g}): {force.name}: {value}; the last good point is step {good_step}"
        return super().explain(y[:, :, :n], before[:, :n], good[:, :, :n], step, time, good_step)

    def meeting(self, y: Floats, time: float) -> str:
        """See ParticleFlow; names the unknown that changes faster, relative to its value, than all velocities."""
        n, rates = len(self.subject), self.derivative(time, y)
        with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
            bodies = np.linalg.norm(rates[1, :, :n], axis=0) / np.linalg.norm(y[1, :, :n], axis=0)
            for force in (own.force for own in self._own if own.force.name == Beside.name):
                at = self._at[UNKNOWNS]
                fast = np.nan_to_num(np.abs(rates[1, 0, at]) / np.maximum(np.abs(y[1, 0, at]), 1.0), nan=np.inf)
                first = int(np.argmax(fast))
                if fast[first] > np.nanmax(bodies, initial=0.0):
                    value = f"{force.names[first]} is {y[1, 0, at][first]:.3g}"
                    return f"; {force.name}: {value}, and changes by {rates[1, 0, at][first]:.3g} a unit of time"
        return super().meeting(y[:, :, :n], time)


Flow = ParticleFlow | ProblemFlow


def flow_of(subject: System | Problem, threads: int, jumps: bool, mixed: bool = False, coupling: str = "") -> Flow:
    """Flow of a System or a Problem. With ``jumps``, trial steps may go far astray. With ``mixed``, pair forces are in
    mixed precision. A barostat's ``coupling`` says which edges change."""
    if isinstance(subject, System):
        kind = FlowBeside if further(subject) else ParticleFlow
        return kind(subject, threads, jumps, mixed, coupling)
    if mixed and isinstance(subject, Problem):
        raise InputError(f"precision: mixed needs pair forces; {subject.name!r} is an ODE")
    if isinstance(subject, Problem):
        return ProblemFlow(subject, threads, jumps)
    raise InputError(f"a Simulation takes a System or a Problem, got {type(subject).__name__}")


def still_sample(system: System, threads: int = 1) -> Sample:
    """The sample with which a run from here begins. Raises RunError if forces or energy are not finite."""
    with compiling_for(f"the forces of {system.name}"):
        flow = flow_of(system, check_threads(threads), jumps=True)
        return flow.sample(flow.array(system.state), system.state.time, 0)  # type: ignore[arg-type]


def still_forces(system: System, threads: int = 1) -> Floats:
    """Forces (n, 3) on the particles, also on fixed ones; a read-only array. Raises RunError if they are not finite."""
    with compiling_for(f"the forces of {system.name}"):
        flow = flow_of(system, check_threads(threads), jumps=True)
        found = flow.felt(flow.array(system.state), system.state.time)  # type: ignore[union-attr, arg-type]
    if found is None:
        raise RunError("the forces at these positions are not finite")
    return read_only(np.ascontiguousarray((found * system.coherent_masses).T))

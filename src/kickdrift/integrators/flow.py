"""Flows, the view that integrators have of a System or a Problem: y' = f(t, y), with y one array.

y is (2, 3, n) for particles, positions and velocities; (2, 1, n / 2) for a separable Problem; (1, 1, n) for any other.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

from kickdrift.errors import InputError, RunError
from kickdrift.forces.bound import BoundForces
from kickdrift.forces.equation import check_right_hand_side, right_hand_side
from kickdrift.forces.evaluate import SLOTS
from kickdrift.forces.kernel import OK
from kickdrift.forces.pair_law import PairForce
from kickdrift.looks.blow_up import explain, nearest_pair
from kickdrift.looks.looking import HEAD, NO_ENERGY, Looking, desk_of, look
from kickdrift.looks.observers import Energies, Sample
from kickdrift.looks.record import Record
from kickdrift.looks.table import Looks
from kickdrift.model.checks import no_overflow, unwarned
from kickdrift.model.problem import Problem, ProblemState
from kickdrift.model.space import check_plane
from kickdrift.model.starts.builders import check_overlaps
from kickdrift.model.state import Floats, State
from kickdrift.model.system import System

Derivative = Callable[[float, Floats], Floats]
NEWTON_UNKNOWNS = 3000  # most unknowns of a dense Jacobian


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


class ProblemFlow:
    """Solution of a Problem."""

    clocked = True  # see ParticleFlow
    of_particles = False

    def __init__(self, problem: Problem, threads: int, jumps: bool) -> None:
        self.subject = problem
        self.name = problem.name
        self.halves = 2 if problem.separable else 1
        known = "right_hand_side" in vars(problem)
        self._callback = right_hand_side(problem).callback
        if known:  # names outside f may have changed since
            check_right_hand_side(problem, right_hand_side(problem))
        self.forces = BoundForces(_Bindable(problem), threads)
        self.not_separable = None if problem.separable else "the problem is not declared separable=True"

    def state(self, y: Floats, time: float, steps: int) -> ProblemState:
        """Copy of y as a ProblemState."""
        return ProblemState(y.reshape(-1).copy(), time, steps)

    def array(self, state: ProblemState) -> Floats:
        """Checked copy of a ProblemState as y."""
        check_state(state, ProblemState)
        y = np.array(state.y, dtype=float)
        if y.shape != self.subject.y0.shape:
            raise InputError(f"state: expected y of shape {self.subject.y0.shape}, got {y.shape}")
        if not np.isfinite(y).all():
            raise InputError("state: y must be finite")
        return y.reshape((self.halves, 1, -1))

    @property
    def raised(self) -> BaseException | None:
        """Error raised by Python code in f."""
        return self._callback.error

    def begin(self, record: Record, y: Floats) -> None:
        """Do nothing: only the samples are compared."""
        record.begun = True

    def look(self, looks: Looks, y: Floats, time: float, step: int, last: Floats, fresh: bool = False) -> int:
        """Fill the table's next row with a sample of y, and ``last`` with y. Return a status."""
        looks.fill(self.sample(y, time, step))
        last[...] = y
        return OK

    def looking(self, fresh: bool) -> None:
        """Return None: each sample calls Python."""

    def sample(self, y: Floats, time: float, steps: int, fresh: bool = False) -> Sample:
        """Sample of the problem's conserved quantity at y."""
        energy = self.subject.energy
        try:
            value = float(energy(time, y.reshape(-1).copy())) if energy else float("nan")
        except Exception as error:  # whatever a user's function raises
            line = " ".join(f"{type(error).__name__}: {error}".split())
            raise InputError(f"step {steps} (t = {time:.6g}): energy raised {line}") from error
        return Sample(steps, time, Energies(float("nan"), float("nan"), value))

    def forget_errors(self) -> None:
        """Forget earlier errors of f, which do not concern the coming steps."""
        self._callback.error = None

    def prepare(self, y: Floats, time: float) -> None:
        """Do nothing: the right-hand side is compiled already."""

    def derivative(self, time: float, y: Floats) -> Floats:
        """f(t, y)."""
        return self.forces.derivative(time, y)

    @property
    def analytic(self) -> bool:
        """Tell whether the problem gives its Jacobian."""
        return self.subject.jacobian is not None

    def jacobian(self, time: float, y: Floats) -> Floats:
        """Jacobian (n, n) df_i / dy_j, analytic if the problem gives it."""
        if self.subject.jacobian is None:
            return difference_jacobian(self.derivative, time, y)
        value = np.asarray(self.subject.jacobian(time, y.reshape(-1).copy()), dtype=float)
        return value.reshape(len(self.subject), -1)

    def explain(self, y: Floats, before: Floats, good: Floats, step: int, time: float, good_step: int) -> str:
        """One line about a blow-up, or about an error of f."""
        if (error := self.raised) is not None:
            return " ".join(f"step {step} (t = {time:.6g}): f raised {type(error).__name__}: {error}".split())
        flat = y.reshape(-1)
        bad = np.flatnonzero(~np.isfinite(flat))
        worst = int(bad[0]) if bad.size else int(np.argmax(np.abs(flat)))
        what = f"y[{worst}] is {flat[worst]:.3g}"
        return f"blew up at step {step} (t = {time:.6g}): {what}; the last good point is step {good_step}"

    def meeting(self, y: Floats) -> str:
        """Return no text."""
        return ""


def check_state(state: Any, kind: Any) -> None:
    """Raise InputError unless this is a state of that kind with a finite time."""
    if not isinstance(state, kind):
        raise InputError(f"state: expected a {kind.__name__}, got {type(state).__name__}")
    if not np.isfinite(state.time) or state.steps_done < 0:
        raise InputError(
            f"state: time must be finite and steps_done zero or more, got {state.time}, {state.steps_done}"
        )


Flow = ParticleFlow | ProblemFlow


def flow_of(subject: System | Problem, threads: int, jumps: bool, mixed: bool = False) -> Flow:
    """Flow of a System or a Problem. With ``jumps``, trial steps may go far astray. With ``mixed``, pair forces are in
    mixed precision."""
    if isinstance(subject, System):
        return ParticleFlow(subject, threads, jumps, mixed)
    if mixed and isinstance(subject, Problem):
        raise InputError(f"precision: mixed needs pair forces; {subject.name!r} is an ODE")
    if isinstance(subject, Problem):
        return ProblemFlow(subject, threads, jumps)
    raise InputError(f"a Simulation takes a System or a Problem, got {type(subject).__name__}")


class _Bindable:
    """Problem with its right-hand side in the form of a System."""

    def __init__(self, problem: Problem) -> None:
        self.forces = (right_hand_side(problem),)
        self._problem = problem

    def __len__(self) -> int:
        return len(self._problem)

    @property
    def separable(self) -> bool:
        return self._problem.separable


def difference_jacobian(derivative: Derivative, time: float, y: Floats) -> Any:
    """Central differences (N, N) of f with respect to the flattened y. The relative error is about 1e-10, with steps of
    the cube root of the rounding unit (Press et al. 2007, Numerical Recipes, 5.7)."""
    flat = y.reshape(-1)
    if flat.size > NEWTON_UNKNOWNS:
        raise InputError(f"the Jacobian of {flat.size} unknowns is too large; the limit is {NEWTON_UNKNOWNS}")
    scale = np.maximum(np.abs(flat), 1e-3 * max(float(np.abs(flat).max()), 1e-3))
    steps = np.cbrt(np.finfo(float).eps) * scale
    columns = []
    for k, h in enumerate(steps):
        ahead, behind = flat.copy(), flat.copy()
        ahead[k] += h
        behind[k] -= h
        difference = derivative(time, ahead.reshape(y.shape)) - derivative(time, behind.reshape(y.shape))
        columns.append(difference.reshape(-1) / (ahead[k] - behind[k]))
    return np.array(columns).T

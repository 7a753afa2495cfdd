"""What a Simulation integrates, as the integrators see it: y' = f(t, y), with y one array.

y is (2, 3, n) for particles, positions and velocities; (2, 1, n / 2) for a separable Problem; (1, 1, n) for any other.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

from kickdrift.blow_up import explain, nearest_pair
from kickdrift.builders import check_overlaps
from kickdrift.checks import no_overflow, unwarned
from kickdrift.errors import InputError
from kickdrift.forces.bound import BoundForces
from kickdrift.forces.pair_law import PairForce
from kickdrift.observers import Energies, Record, Sample, take_sample
from kickdrift.problem import Problem, ProblemState
from kickdrift.state import Floats, State
from kickdrift.system import System

Derivative = Callable[[float, Floats], Floats]
NEWTON_UNKNOWNS = 3000  # at most, for a dense Jacobian


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
        )  # with lists of its own: looking must not change the run's
        culprits = system.acting("velocity_dependent")
        self.not_separable = f"force {culprits[0]!r} depends on velocity" if culprits else None

    @property
    def clocked(self) -> bool:
        """Whether f may depend on time: that of a user's own force class, unless the class denies it."""
        return any(_clocked(force) for force in self.subject.forces)

    def state(self, y: Floats, time: float, steps: int) -> State:
        """The State that y stands for; a copy."""
        own = self.subject.state
        return State(y.copy(), own.masses.copy(), own.ids.copy(), own.box, time, steps)

    def array(self, state: State) -> Floats:
        """The y of a State, checked; a copy."""
        check_state(state, State)
        own = self.subject.state
        if len(state) != len(own):
            raise InputError(f"state: expected {len(own)} particles, got {len(state)}")
        if not (np.array_equal(state.ids, own.ids) and np.array_equal(state.masses, own.masses)):
            raise InputError("state: ids and masses must be those of the system's particles, in the same order")
        if state.box != own.box:
            raise InputError(f"state: its box is {state.box.lengths}, and the system's {own.box.lengths}")
        if not np.all(np.isfinite(state.phase)):
            raise InputError("state: positions and velocities must be finite")
        return np.array(state.phase, dtype=float, order="C")

    @unwarned
    def tune(self, y: Floats, between: float) -> None:
        """Have pair lists for particles as fast as at y, with that much time between two evaluations of the forces."""
        self.forces.tune(float(np.sqrt((y[1] ** 2).sum(axis=0).max())) * between)

    def begin(self, record: Record, y: Floats) -> None:
        """A record of conservation begins here."""
        record.begin(self.subject.coherent_masses, y)

    @property
    def _looks(self) -> BoundForces:
        """Forces to look at, with lists that are made anew: what they give depends on nothing looked at before."""
        self._aside.forget()
        return self._aside

    def sample(self, y: Floats, time: float, steps: int) -> Sample:
        """All that is watched, at y."""
        return take_sample(self.subject, self._looks, steps, time, y)

    def accelerations(self, y: Floats, time: float) -> Floats | None:
        """(3, n) at y, None where they are not finite."""
        measured = self._looks.measure(time, y)
        return None if measured is None else measured.accelerations

    def forget_errors(self) -> None:
        """Compiled forces raise none."""

    def prepare(self, y: Floats, time: float) -> None:
        """Compile what looking needs."""
        self._looks.measure(time, y)

    def derivative(self, time: float, y: Floats) -> Floats:
        """f(t, y), without touching the run's own pair lists."""
        return self._looks.derivative(time, y)

    analytic = False  # the Jacobian

    def jacobian(self, time: float, y: Floats) -> Floats:
        """df_i / dy_j of the flattened y by central differences; (N, N)."""
        return difference_jacobian(self._looks.derivative, time, y)

    def explain(self, y: Floats, before: Floats, good: Floats, step: int, time: float, good_step: int) -> str:
        """One line on what blew up; ``before`` (3, n) is where the particles stood a step before y."""
        return explain(self.subject, y, before, good, step, time, good_step)

    def meeting(self, y: Floats) -> str:
        """Which particles are nearest to each other, as the end of a line on steps that came to nothing."""
        return nearest_pair(self.subject, y[0])


def _clocked(force: Any) -> bool:
    own = isinstance(force, PairForce) or type(force).__module__.startswith("kickdrift.")
    return bool(getattr(force, "time_dependent", not own))


class ProblemFlow:
    """A Problem's solution."""

    clocked = True  # see ParticleFlow
    of_particles = False

    def __init__(self, problem: Problem, threads: int, jumps: bool) -> None:
        self.subject = problem
        self.name = problem.name
        self.halves = 2 if problem.separable else 1
        known = "right_hand_side" in vars(problem)
        self._callback = problem.right_hand_side.callback
        if known:  # names outside f may have other values since
            problem.check_compiled(problem.right_hand_side)
        self.forces = BoundForces(_Bindable(problem), threads)
        self.not_separable = None if problem.separable else "the problem is not declared separable=True"

    def state(self, y: Floats, time: float, steps: int) -> ProblemState:
        """The ProblemState that y stands for; a copy."""
        return ProblemState(y.reshape(-1).copy(), time, steps)

    def array(self, state: ProblemState) -> Floats:
        """The y of a ProblemState, checked; a copy."""
        check_state(state, ProblemState)
        y = np.array(state.y, dtype=float)
        if y.shape != self.subject.y0.shape:
            raise InputError(f"state: expected y of shape {self.subject.y0.shape}, got {y.shape}")
        if not np.isfinite(y).all():
            raise InputError("state: y must be finite")
        return y.reshape((self.halves, 1, -1))

    @property
    def raised(self) -> BaseException | None:
        """What Python code in f raised."""
        return self._callback.error

    def begin(self, record: Record, y: Floats) -> None:
        """Nothing but the samples is compared."""
        record.begun = True

    def sample(self, y: Floats, time: float, steps: int) -> Sample:
        """The quantity that the problem says is conserved, at y."""
        energy = self.subject.energy
        try:
            value = float(energy(time, y.reshape(-1).copy())) if energy else float("nan")
        except Exception as error:  # whatever a user's function raises
            line = " ".join(f"{type(error).__name__}: {error}".split())
            raise InputError(f"step {steps} (t = {time:.6g}): energy raised {line}") from error
        return Sample(steps, time, Energies(float("nan"), float("nan"), value))

    def forget_errors(self) -> None:
        """What f raised before is no matter of the steps to come."""
        self._callback.error = None

    def prepare(self, y: Floats, time: float) -> None:
        """The right-hand side is compiled already."""

    def derivative(self, time: float, y: Floats) -> Floats:
        """f(t, y)."""
        return self.forces.derivative(time, y)

    @property
    def analytic(self) -> bool:
        """Whether the problem gives its Jacobian."""
        return self.subject.jacobian is not None

    def jacobian(self, time: float, y: Floats) -> Floats:
        """df_i / dy_j, analytic where the problem gives it; (n, n)."""
        if self.subject.jacobian is None:
            return difference_jacobian(self.derivative, time, y)
        value = np.asarray(self.subject.jacobian(time, y.reshape(-1).copy()), dtype=float)
        return value.reshape(len(self.subject), -1)

    def explain(self, y: Floats, before: Floats, good: Floats, step: int, time: float, good_step: int) -> str:
        """One line on what blew up, or on what f raised."""
        if (error := self.raised) is not None:
            return " ".join(f"step {step} (t = {time:.6g}): f raised {type(error).__name__}: {error}".split())
        flat = y.reshape(-1)
        bad = np.flatnonzero(~np.isfinite(flat))
        worst = int(bad[0]) if bad.size else int(np.argmax(np.abs(flat)))
        what = f"y[{worst}] is {flat[worst]:.3g}"
        return f"blew up at step {step} (t = {time:.6g}): {what}; the last good point is step {good_step}"

    def meeting(self, y: Floats) -> str:
        """Nothing."""
        return ""


def check_state(state: Any, kind: Any) -> None:
    """Refuse what is no state of that kind, or stands at no time."""
    if not isinstance(state, kind):
        raise InputError(f"state: expected a {kind.__name__}, got {type(state).__name__}")
    if not np.isfinite(state.time) or state.steps_done < 0:
        raise InputError(
            f"state: time must be finite and steps_done zero or more, got {state.time}, {state.steps_done}"
        )


Flow = ParticleFlow | ProblemFlow


def flow_of(subject: System | Problem, threads: int, jumps: bool, mixed: bool = False) -> Flow:
    """The flow of a System or a Problem; with ``jumps``, trial steps may go far astray; with ``mixed``, pair forces are
    in mixed precision."""
    if isinstance(subject, System):
        return ParticleFlow(subject, threads, jumps, mixed)
    if mixed and isinstance(subject, Problem):
        raise InputError(f"precision: mixed is for pair forces, and {subject.name!r} is an ODE")
    if isinstance(subject, Problem):
        return ProblemFlow(subject, threads, jumps)
    raise InputError(f"a Simulation takes a System or a Problem, got {type(subject).__name__}")


class _Bindable:
    """A Problem with its right-hand side in a System's place."""

    def __init__(self, problem: Problem) -> None:
        self.forces = (problem.right_hand_side,)
        self._problem = problem

    def __len__(self) -> int:
        return len(self._problem)

    @property
    def separable(self) -> bool:
        return self._problem.separable


def difference_jacobian(derivative: Derivative, time: float, y: Floats) -> Any:
    """(N, N) central differences of f with respect to the flattened y, error about 1e-10 relative (steps of the cube
    root of the rounding unit; Press et al. 2007, Numerical Recipes, 5.7)."""
    flat = y.reshape(-1)
    if flat.size > NEWTON_UNKNOWNS:
        raise InputError(f"the Jacobian of {flat.size} unknowns is too large to hold; {NEWTON_UNKNOWNS} is the most")
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

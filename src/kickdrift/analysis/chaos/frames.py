"""Deviations from a motion, under way together: those of MEGNO, and orthonormal ones of Lyapunov spectra."""

import math
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np

from kickdrift.analysis.tangents.deviations import scale_of
from kickdrift.analysis.tangents.mapped import has_map, map_run
from kickdrift.analysis.tangents.varied_run import accelerations_at_start
from kickdrift.errors import InputError
from kickdrift.forces.slopes.problem_variations import varied_problem
from kickdrift.forces.slopes.variations import varied
from kickdrift.integrators import INTEGRATORS
from kickdrift.integrators import integrator as method_named
from kickdrift.looks.observers import Energies
from kickdrift.model.problem import Problem
from kickdrift.model.state import Floats
from kickdrift.model.system import System
from kickdrift.model.units.quantities import time_in
from kickdrift.run.simulation import Simulation

DEFAULT = "dop853"  # for a system file without an integrator, or with one that carries no variations


def checked_seed(seed: Any) -> int:
    """The seed as an int. Raises InputError unless it is a whole number, zero or more."""
    if isinstance(seed, bool) or not isinstance(seed, int | np.integer) or seed < 0:
        raise InputError(f"seed: expected a whole number, zero or more, got {seed!r}")
    return int(seed)


def length_of(system: System | Problem, time: float | str | None) -> float:
    length = system.run.time if time is None else time_in(time, getattr(system, "units", None), "time")
    if time is None and length is None and system.run.steps and system.run.dt:
        length = system.run.steps * system.run.dt
    if length is None:
        raise InputError(f"time: system {system.name!r} has no time in [run]; give a time")
    if not (isinstance(length, (int, float, np.number)) and math.isfinite(length) and length > 0):
        raise InputError(f"time must be a positive finite time, got {length!r}")
    return float(length)


def carrier(system: System, integrator: str | None, default: str = DEFAULT) -> str:
    """Name of the integrator for the run."""
    if integrator is not None:
        if not method_named(integrator).carries:
            raise InputError(f"integrator: {integrator} carries no variations; {default} does, and yoshida6")
        return integrator
    named = INTEGRATORS.get(system.run.integrator or "")
    return named.name if named is not None and named.carries else default


class MovingFrame:
    """A motion with k deviations. ``sim`` is a Simulation by the same method, and holds the deviations in its state."""

    sim: Any

    @property
    def time(self) -> float:
        return float(self.sim.time)

    @property
    def steps_done(self) -> int:
        return int(self.sim.steps_done)

    def energy(self) -> Energies:
        """Energies of the motion now."""
        found: Energies = self.sim.energy()
        return found

    def advance(self, steps: int, *, every: int, visit: Callable[[Any], Any]) -> None:
        """Take steps, and call ``visit`` after each ``every`` of them; a true value ends them."""
        self.sim.advance(steps, every=every, visit=visit)

    @property
    def end(self) -> Any:
        """The state of the motion now, without deviations."""
        raise NotImplementedError

    def matrix(self) -> Floats:
        """The deviations now, scaled, as columns (N, k)."""
        raise NotImplementedError

    def size(self) -> float:
        """Length of the scaled deviations."""
        return float(np.linalg.norm(self.matrix()))

    def put(self, matrix: Floats) -> None:
        """Start anew from these deviations (N, k)."""
        raise NotImplementedError

    def scale(self, factor: float) -> None:
        """Multiply all deviations."""
        raise NotImplementedError

    def straighten(self) -> None:
        """Replace the deviations by the orthonormal ones of their QR factorisation."""
        q, r = np.linalg.qr(self.matrix())
        self.put(q * np.sign(np.diag(r)))


def frame_of(
    system: System | Problem, asked: str | None, options: dict[str, Any], threads: int, first: Floats
) -> MovingFrame:
    """A System or a Problem with deviations that start as the columns of ``first`` (N, k)."""
    if isinstance(system, Problem):
        return _OfProblem(system, asked or system.run.integrator or DEFAULT, options, threads, first)
    if asked is not None and has_map(method_named(asked)):
        return _OfMap(system, method_named(asked), options, threads, first)
    return _OfSystem(system, carrier(system, asked), options, threads, first)


class _OfSystem(MovingFrame):
    def __init__(self, system: System, name: str, options: dict[str, Any], threads: int, first: Floats) -> None:
        self._system, self._n, n = system, len(system), len(system)
        made = varied(system, np.zeros((2, 3, n * first.shape[1])))
        self.sim = Simulation(made, name, threads=threads, **options)
        self._scale = scale_of(system.state.phase, accelerations_at_start(self.sim, n))[..., None]
        self.put(first)

    @property
    def end(self) -> Any:
        return self._system.at(self.sim.integration.y[:, :, : self._n], self.time).state

    def matrix(self) -> Floats:
        y = self.sim.integration.y[:, :, self._n :]
        return np.asarray((y.reshape(2, 3, self._n, -1) / self._scale).reshape(6 * self._n, -1))

    def put(self, matrix: Floats) -> None:
        state = self.sim.state
        state.phase[:, :, self._n :] = (matrix.reshape(2, 3, self._n, -1) * self._scale).reshape(2, 3, -1)
        self.sim.state = state

    def scale(self, factor: float) -> None:
        state = self.sim.state
        state.phase[:, :, self._n :] *= factor
        self.sim.state = state


class _OfProblem(MovingFrame):
    def __init__(self, problem: Problem, name: str, options: dict[str, Any], threads: int, first: Floats) -> None:
        made, self._place = varied_problem(problem, first.T)
        self._problem = problem
        self.sim = Simulation(made, name, threads=threads, **options)

    @property
    def end(self) -> Any:
        own = np.delete(self.sim.state.y, np.ravel(self._place))
        return replace(self._problem.state, y=own, time=self.time)

    def matrix(self) -> Floats:
        return np.asarray(self.sim.integration.y.reshape(-1)[self._place].T)

    def put(self, matrix: Floats) -> None:
        state = self.sim.state
        state.y[self._place] = matrix.T
        self.sim.state = state

    def scale(self, factor: float) -> None:
        state = self.sim.state
        state.y[self._place] *= factor
        self.sim.state = state


class _OfMap(MovingFrame):
    """Deviations under a method's tangent map."""

    def __init__(self, system: System, method: Any, options: dict[str, Any], threads: int, first: Floats) -> None:
        self._run = map_run(system, None, method, threads, options)
        self.sim = self._run.sim
        self._scale = scale_of(system.state.phase, self.sim.accelerations().T)[..., None]
        self._run.start(first.reshape(2, 3, len(system), -1) * self._scale)

    @property
    def time(self) -> float:
        return self._run.time

    @property
    def steps_done(self) -> int:
        return self._run.steps

    def advance(self, steps: int, *, every: int, visit: Callable[[Any], Any]) -> None:
        self._run.advance_and_look(steps, every, lambda: visit(self))

    def energy(self) -> Energies:
        state = self.sim.state
        state.phase[...], _ = self._run.now()
        self.sim.state = state
        return super().energy()

    @property
    def end(self) -> Any:
        return self._run.system.at(self._run.now()[0], self.time).state

    def matrix(self) -> Floats:
        slopes = self._run.now()[1]
        return np.asarray((slopes / self._scale).reshape(-1, slopes.shape[-1]))

    def size(self) -> float:
        return float(np.linalg.norm(self._run.now()[1] / self._scale))

    def scale(self, factor: float) -> None:
        self._run.scale(factor)

    def straighten(self) -> None:
        r = np.linalg.qr(self.matrix(), mode="r")
        self._run.mix(np.linalg.inv(np.sign(np.diag(r))[:, None] * r))

"""Several deviations from a motion, under way together, that can be made orthonormal: for Lyapunov spectra."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any, Protocol

import numpy as np

from kickdrift.analysis.chaos.megno import DEFAULT, carrier
from kickdrift.analysis.tangents.deviations import scale_of
from kickdrift.analysis.tangents.mapped import has_map, map_run
from kickdrift.errors import RunError
from kickdrift.forces.slopes.problem_variations import varied_problem
from kickdrift.forces.slopes.variations import varied
from kickdrift.integrators import integrator as method_named
from kickdrift.jit.cache.notices import compiling_for
from kickdrift.model.problem import Problem
from kickdrift.model.state import Floats
from kickdrift.model.system import System
from kickdrift.run.simulation import Simulation


class MovingFrame(Protocol):
    """A motion with k deviations. ``sim`` is a Simulation by the same method."""

    sim: Any

    @property
    def time(self) -> float: ...

    @property
    def steps_done(self) -> int: ...

    def advance(self, steps: int, *, every: int, visit: Callable[[Any], Any]) -> None:
        """Take steps, and call ``visit`` after each ``every`` of them; a true value ends them."""

    @property
    def end(self) -> Any:
        """The state of the motion now, without deviations."""

    def matrix(self) -> Floats:
        """The deviations now, scaled, as columns (N, k)."""

    def straighten(self) -> None:
        """Replace the deviations by the orthonormal ones of their QR factorisation."""


def frame_of(
    system: System | Problem, asked: str | None, options: dict[str, Any], threads: int, count: int, seed: int
) -> MovingFrame:
    """A System or a Problem with orthonormal deviations in random directions."""
    size = len(system) * (6 if isinstance(system, System) else 1)
    first = np.linalg.qr(np.random.Generator(np.random.PCG64(seed)).standard_normal((count, size)).T)[0]
    if isinstance(system, Problem):
        return _OfProblem(system, asked or system.run.integrator or DEFAULT, options, threads, first)
    if asked is not None and has_map(method_named(asked)):
        return _OfMap(system, method_named(asked), options, threads, first)
    return _OfSystem(system, carrier(system, asked), options, threads, first)


class _OfRun:
    """Deviations in the state of a Simulation."""

    sim: Simulation

    @property
    def time(self) -> float:
        return self.sim.time

    @property
    def steps_done(self) -> int:
        return self.sim.steps_done

    def advance(self, steps: int, *, every: int, visit: Callable[[Any], Any]) -> None:
        self.sim.advance(steps, every=every, visit=visit)

    def matrix(self) -> Floats:
        raise NotImplementedError

    def put(self, matrix: Floats) -> None:
        """Start anew from these deviations (N, k)."""
        raise NotImplementedError

    def straighten(self) -> None:
        q, r = np.linalg.qr(self.matrix())
        self.put(q * np.sign(np.diag(r)))


class _OfSystem(_OfRun):
    def __init__(self, system: System, name: str, options: dict[str, Any], threads: int, first: Floats) -> None:
        self._system, self._n, n = system, len(system), len(system)
        made = varied(system, np.zeros((2, 3, n * first.shape[1])))
        self.sim = Simulation(made, name, threads=threads, **options)
        try:
            with compiling_for(self.sim.integration.purpose):
                accelerations = self.sim.accelerations()[:n].T
        except RunError:  # not finite; the run gives the reason
            accelerations = np.zeros((3, 1))
        self._scale = scale_of(system.state.phase, accelerations)[..., None]
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


class _OfProblem(_OfRun):
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


class _OfMap:
    """Deviations under a method's tangent map."""

    def __init__(self, system: System, method: Any, options: dict[str, Any], threads: int, first: Floats) -> None:
        self._run = map_run(system, None, method, threads, options)
        self.sim: Any = self._run.sim
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

    @property
    def end(self) -> Any:
        return self._run.system.at(self._run.now()[0], self.time).state

    def matrix(self) -> Floats:
        slopes = self._run.now()[1]
        return np.asarray((slopes / self._scale).reshape(-1, slopes.shape[-1]))

    def straighten(self) -> None:
        r = np.linalg.qr(self.matrix(), mode="r")
        self._run.mix(np.linalg.inv(np.sign(np.diag(r))[:, None] * r))

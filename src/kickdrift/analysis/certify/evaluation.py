"""One evaluation of forces at given positions, by kickdrift or by an engine, for tests of forces."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from kickdrift.errors import InputError, RunError
from kickdrift.forces.bound.forces import BoundForces
from kickdrift.model.checks.values import no_overflow
from kickdrift.model.state import Floats
from kickdrift.model.system import System
from kickdrift.run.simulation import Simulation


class Values(NamedTuple):
    """Forces and energies at one set of positions, in the units that make force = mass x acceleration."""

    forces: Floats  # (n, 3)
    energy: float
    virial: float  # nan if unknown


class Evaluator:
    """Forces of a System at any positions (n, 3).

    The evaluator keeps its pair lists between calls, as a run does. Another evaluator has lists of its own.
    """

    def __init__(self, system: System, engine: str | None = None, threads: int = 1) -> None:
        self.system, self.engine, self.threads = system, engine, threads
        self._masses = system.coherent_masses
        self._velocities = system.state.phase[1]
        self._measure = self._own() if engine is None else self._of_engine(engine)
        self.calls = 0

    def another(self, system: System | None = None) -> Evaluator:
        """An evaluator with lists of its own, of another System if given."""
        return Evaluator(self.system if system is None else system, self.engine, self.threads)

    def __call__(self, positions: Floats) -> Values:
        """Forces at ``positions`` (n, 3). Raises RunError if forces or energy are not finite."""
        self.calls += 1
        phase = np.ascontiguousarray([positions.T, self._velocities])
        with no_overflow():
            found = self._measure(phase)
        if found is None or not np.isfinite(found.potential):
            raise RunError(f"{self.system.name}: the forces are not finite at positions that a test tried")
        return Values((found.accelerations * self._masses).T.copy(), float(found.potential), float(found.virial))

    def _own(self) -> Any:
        bound, time = BoundForces(self.system, self.threads), self.system.state.time
        return lambda phase: bound.measure(time, phase)

    def _of_engine(self, engine: str) -> Any:
        sim, time = Simulation(self.system, engine=engine, dt=self.system.run.dt or 1e-3), self.system.state.time
        stepper: Any = sim.integration.stepper

        def measure(phase: Floats) -> Any:
            stepper.reset(phase, time, 0)
            return stepper.measure(time, phase)

        return measure


def tested_states(evaluate: Evaluator, count: int, part: float, rng: np.random.Generator) -> list[Floats]:
    """Positions (n, 3) near the System's own, each moved by some ``part`` of its distance to the nearest neighbour.

    Positions where the forces are not finite are tried again with half the displacement."""
    x = evaluate.system.state.positions
    near = nearest_distances(evaluate.system)[:, None]
    flat = np.array([1.0, 1.0, 1.0 if evaluate.system.dimensions == 3 else 0.0])
    found: list[Floats] = []
    for _ in range(count):
        direction, size = rng.standard_normal(x.shape) * flat, part
        while True:
            moved = x + size * near * direction
            try:
                evaluate(moved)
            except RunError:
                if size < 1e-6 * part:
                    raise InputError(
                        f"{evaluate.system.name}: no positions near the start have finite forces"
                    ) from None
                size /= 2
                continue
            found.append(moved)
            break
    return found


def nearest_distances(system: System) -> Floats:
    """Distance from each particle to its nearest neighbour, (n,); 1 for a single particle."""
    x, least = system.state.positions, np.ones(len(system))
    for i in range(len(x) if len(x) > 1 else 0):
        d = system.box.minimum_image(np.delete(x, i, axis=0) - x[i])
        nearest = float(np.sqrt((d**2).sum(axis=1).min()))
        least[i] = nearest or 1.0
    return least

"""A deviation under a method with a tangent map, as a run that MEGNO follows."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

from kickdrift.analysis.tangents.deviations import first_deviation, scale_of
from kickdrift.analysis.tangents.mapped import map_run
from kickdrift.looks.observers import Energies
from kickdrift.model.system import System


class DeviationOfMap:
    """A System and a deviation under way by a method's tangent map, with the face of a Simulation."""

    def __init__(self, system: System, method: Any, threads: int, options: dict[str, Any], seed: int) -> None:
        self._run = map_run(system, None, method, threads, options)
        sim = self._sim = self._run.sim
        self.method, self.integrator, self.integration, self.dt = sim.method, sim.integrator, sim.integration, sim.dt
        self._scale = scale_of(system.state.phase, sim.accelerations().T)
        self._run.start((first_deviation(len(system), seed) * self._scale)[..., None])

    @property
    def time(self) -> float:
        return self._run.time

    @property
    def steps_done(self) -> int:
        return self._run.steps

    def energy(self) -> Energies:
        """Energies of the particles now."""
        state = self._sim.state
        state.phase[...], _ = self._run.now()
        self._sim.state = state
        return self._sim.energy()

    def advance(self, steps: int, *, every: int, visit: Callable[[Any], Any]) -> None:
        """Take steps, and call ``visit`` after each ``every`` of them; a true value ends them."""
        self._run.advance_and_look(steps, every, lambda: visit(self))

    def size(self) -> float:
        """Length of the deviation, in units of the start's distances and speeds."""
        return float(np.linalg.norm(self._run.now()[1][..., 0] / self._scale))

    def shrink(self, factor: float) -> None:
        """Multiply the deviation."""
        self._run.scale(factor)

"""A run of a System with derivatives of its end by a method's tangent map: what the maps have in common."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

from kickdrift.analysis.deviations import cadence
from kickdrift.model.state import Floats
from kickdrift.model.system import System
from kickdrift.run.simulation import Simulation

PIECE = 1000  # steps between two reports of progress


class MapRun:
    """A System with derivatives under a method that has a tangent map. ``sim`` is a Simulation of the System, at the
    start."""

    by_differences: tuple[str, ...] = ()
    system: System
    sim: Simulation
    dt: float
    steps: int
    _rows: Floats  # (blocks, rows, numbers) duals; positions and velocities in the first two rows

    def start(self, slopes: Floats, of_masses: Floats | None = None) -> None:
        """Start from slopes (2, 3, n, columns) of the system's state, and slopes of the masses (n, columns)."""
        raise NotImplementedError

    def advance(self, steps: int) -> None:
        """Take steps."""
        raise NotImplementedError

    def now(self) -> tuple[Floats, Floats]:
        """Phase (2, 3, n) and derivatives (2, 3, n, columns) at the step point."""
        raise NotImplementedError

    @property
    def time(self) -> float:
        """Time at the step point."""
        return self.system.state.time + self.steps * self.dt

    def advance_and_look(self, steps: int, every: int, visit: Callable[[], Any]) -> None:
        """Take steps, and call ``visit`` after each ``every`` of them; a true value ends them."""
        goal = self.steps + steps
        while self.steps < goal:
            self.advance(min(every, goal - self.steps))
            if visit():
                return

    def scale(self, factor: float) -> None:
        """Multiply all deviations."""
        from kickdrift.integrators.wisdom_holman_tangent import slopes_in

        slopes_in(self._rows)[...] *= factor

    def mix(self, matrix: Floats) -> None:
        """Replace the deviations by their sums with these weights (columns, columns)."""
        from kickdrift.integrators.wisdom_holman_tangent import slopes_in

        slopes = slopes_in(self._rows)
        blocks, width = len(slopes), slopes.shape[-1]
        padded = np.zeros((blocks * width, blocks * width))
        padded[: len(matrix), : len(matrix)] = matrix
        flat = np.moveaxis(slopes, 0, 2).reshape(*slopes.shape[1:3], -1) @ padded
        slopes[...] = np.moveaxis(flat.reshape(*slopes.shape[1:3], blocks, width), 2, 0)

    def to(self, length: float, progress: Callable[[int, int], Any] | None = None) -> tuple[Floats, Floats, float]:
        """Run for a length of time, in whole steps. Return phase, derivatives and the time."""
        steps, _ = cadence(length, self.dt)
        while self.steps < steps:
            self.advance(min(PIECE, steps - self.steps))
            if progress:
                progress(self.steps, steps)
        return *self.now(), self.time

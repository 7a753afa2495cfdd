"""A run of a System by a Wisdom-Holman method, with derivatives of its end by the method's tangent map."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

from kickdrift.analysis.deviations import cadence
from kickdrift.analysis.varied_run import DEFAULT, Columns
from kickdrift.errors import InputError, RunError
from kickdrift.forces.central import gravitational_constant
from kickdrift.forces.gravity import Gravity
from kickdrift.integrators.option import JACOBI
from kickdrift.integrators.wisdom_holman import WisdomHolman
from kickdrift.jit.notices import compiling_for
from kickdrift.model.state import Floats
from kickdrift.model.system import System
from kickdrift.run.simulation import Simulation

PIECE = 1000  # steps between two reports of progress
KNOWN = (
    "coordinates",
    "corrector",
    "compensated",
    "order",
)  # options that the tangent map follows, or that round alone


class TangentRun:
    """A System with derivatives under a Wisdom-Holman method, like a `VariedRun`."""

    by_differences: tuple[str, ...] = ()

    def __init__(self, system: System, columns: Columns, name: str, threads: int, options: dict[str, Any]) -> None:
        others = [force.name for force in system.forces if not isinstance(force, Gravity)]
        if others:
            raise InputError(
                f"{name}: its tangent map takes gravity alone, not {', '.join(others)}; {DEFAULT} takes all"
            )
        sim = Simulation(system, name, threads=threads, **options)
        method, chosen = sim.method, sim.options
        assert isinstance(method, WisdomHolman)
        assert sim.dt is not None
        if chosen.coordinates != JACOBI:
            raise InputError(f"coordinates: the tangent map of {name} takes {JACOBI} alone, got {chosen.coordinates}")
        for option in method.declared:
            if option.name not in KNOWN and chosen.get(option.name) not in (None, False, option.default):
                raise InputError(f"{option.name}: the tangent map of {name} takes {option.default!r} alone")
        method.check(system)
        self.system, self.columns, self.dt, self.steps = system, columns, sim.dt, 0
        table, row = method.table(chosen), _corrector(chosen.get("corrector"))
        drift, kick = np.array(table.drift), np.array([*table.kick, 0.0])
        self._correct, self._begin = row, np.array([drift[:-1], kick[:-1]])
        self._step = self._begin.copy()
        self._step[0, 0] += drift[-1]
        self._end = np.array([drift[-1:], [0.0]])
        self._purpose = sim.integration.purpose

    def to(self, length: float, progress: Callable[[int, int], Any] | None = None) -> tuple[Floats, Floats, float]:
        """Run for a length of time, in whole steps. Return phase (2, 3, n), derivatives (2, 3, n, columns) and the
        time."""
        from kickdrift.integrators.wisdom_holman_tangent import leave, tangent_steps, tangents

        system, columns, n = self.system, self.columns, len(self.system)
        masses, total = system.state.masses, columns.total
        order = np.concatenate([[np.argmax(masses)], np.delete(np.arange(n), np.argmax(masses))])
        gravity = next(force for force in system.forces if isinstance(force, Gravity))
        G = gravitational_constant(gravity.name, gravity.G, system)
        by_mass = columns.of_masses(n)
        gm_slopes = G * (np.zeros((n, total)) if by_mass is None else by_mass)
        self.steps, _ = cadence(length, self.dt)
        with compiling_for(self._purpose):
            made = tangents(system.state.phase[:, :, order], columns.start(n)[:, :, order], G * masses[order],
                            gm_slopes[order])  # fmt: skip

            def take(row: Floats, steps: int) -> None:
                if row.size:
                    tangent_steps(made.rows, n, *row, self.dt, steps)

            take(self._correct, 1)
            take(self._begin, 1)
            for done in range(1, self.steps, PIECE):
                take(self._step, min(PIECE, self.steps - done))
                if progress:
                    progress(done, self.steps)
            take(self._end, 1)
            take(_undone(self._correct), 1)
            phase, slopes = np.empty((2, 3, n)), np.empty((2, 3, n, total))
            leave(made.rows, total, phase, slopes)
        if not (np.isfinite(phase).all() and np.isfinite(slopes).all()):
            raise RunError(f"transition_matrix: the run blew up within {self.steps} steps of {self.dt:g}")
        back = np.argsort(order)
        end = system.state.time + self.steps * self.dt
        return phase[:, :, back], slopes[:, :, back], end


def _corrector(order: Any) -> Floats:
    from kickdrift.integrators.wisdom_holman_corrector import corrector

    return corrector(order) if order else np.zeros((2, 0))


def _undone(row: Floats) -> Floats:
    from kickdrift.integrators.wisdom_holman_corrector import undone

    return undone(row) if row.size else row

"""A run of a System together with deviations from it, one for each number that the end is differentiated by."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np

from kickdrift.analysis.deviations import cadence, scale_of
from kickdrift.errors import InputError, RunError
from kickdrift.forces.pushes import Push, parameter_of, push_of_parameter, pushes_of_mass
from kickdrift.forces.variations import varied
from kickdrift.jit.notices import compiling_for
from kickdrift.model.state import Floats
from kickdrift.model.system import System
from kickdrift.run.simulation import Simulation

DEFAULT = "gauss-radau15"  # where the system file has no integrator, or one that moves no deviations
LARGEST = 2.0**10  # growth of a deviation before it is scaled back: errors count relative to the largest number
EVERY = 16  # steps between two checks of that growth


class Columns(NamedTuple):
    """The variables of the derivatives: coordinates and velocities of bodies, masses, parameters."""

    bodies: tuple[int, ...]  # rows of the System whose start varies
    masses: tuple[int, ...] = ()  # rows of the System whose mass varies
    parameters: tuple[str, ...] = ()  # of forces, "j2.radius"

    @property
    def total(self) -> int:
        return 6 * len(self.bodies) + len(self.masses) + len(self.parameters)

    def start(self, n: int) -> Floats:
        """Unit deviations (2, 3, n, columns): positions body by body, velocities body by body, then masses, which
        deviate from nothing."""
        made = np.zeros((2, 3, n, self.total))
        for half in range(2):
            for place, body in enumerate(self.bodies):
                for axis in range(3):
                    made[half, axis, body, 3 * (half * len(self.bodies) + place) + axis] = 1.0
        return made

    def of_masses(self, n: int) -> Floats | None:
        """Slopes of the masses (n, columns) along the columns; None if no mass varies."""
        if not self.masses:
            return None
        made = np.zeros((n, self.total))
        made[list(self.masses), 6 * len(self.bodies) + np.arange(len(self.masses))] = 1.0
        return made


def rows_of(system: System, bodies: Any, what: str) -> tuple[int, ...]:
    """Rows of the bodies with these names or numbers; None is all bodies."""
    if bodies is None:
        return tuple(range(len(system)))
    given = [bodies] if isinstance(bodies, str | int | np.integer) else list(bodies)
    rows = []
    for each in given:
        whole = isinstance(each, int | np.integer) and not isinstance(each, bool)
        if isinstance(each, str) and each in system.names:
            rows.append(system.names.index(each))
        elif whole and each in system.state.ids:
            rows.append(int(np.flatnonzero(system.state.ids == each)[0]))
        else:
            known = f"names are {', '.join(system.names)}" if system.names else f"numbers are 0 to {len(system) - 1}"
            raise InputError(f"{what}: there is no body {each!r}; {known}")
    if len(set(rows)) != len(rows) or not rows:
        raise InputError(f"{what}: expected one body or more, each once, got {bodies!r}")
    return tuple(rows)


def _pushes(system: System, columns: Columns, heavy: float) -> tuple[list[Push], list[float]]:
    """What the masses and parameters do in each force, and the size of each parameter as a power of two."""
    first = 6 * len(columns.bodies)
    made = [push for k, body in enumerate(columns.masses) for push in pushes_of_mass(system, body, first + k, heavy)]
    sizes = []
    for k, text in enumerate(columns.parameters, first + len(columns.masses)):
        value = parameter_of(system, text)[2]
        sizes.append(float(2.0 ** np.round(np.log2(abs(value) or 1.0))))
        made.append(push_of_parameter(system, text, k, sizes[-1]))
    return made, sizes


class VariedRun:
    """A System with deviations, under way.

    Deviations are in units of the system's own distance, speed and mass, as powers of two, so that a tolerance serves
    them as well as the particles. Scaling them changes no digit.
    """

    def __init__(self, system: System, columns: Columns, name: str, threads: int, options: dict[str, Any]) -> None:
        n, count = len(system), columns.total
        self.system, self.columns = system, columns
        masses, start = columns.of_masses(n), columns.start(n)
        heavy = 2.0 ** np.round(np.log2(system.state.masses.sum() or 1.0))
        pushes, sizes = _pushes(system, columns, heavy)
        made = varied(system, start.reshape(2, 3, -1), None if masses is None else heavy * masses, pushes)
        self.sim = Simulation(made, name, threads=threads, **options)
        try:
            with compiling_for(self.sim.integration.purpose):
                accelerations = self.sim.accelerations()[:n].T
        except RunError:  # not finite; the run gives the reason
            accelerations = np.zeros((3, 1))
        self._scale = 2.0 ** np.round(np.log2(scale_of(system.state.phase, accelerations)))[..., None]
        self._unit = np.ones(count)  # true deviation over the scaled one
        half = 3 * len(columns.bodies)
        self._unit[:half], self._unit[half : 2 * half] = 1.0 / self._scale[:, 0, 0, 0]
        self._unit[2 * half :] = 1.0 / np.array([*(heavy for _ in columns.masses), *sizes])
        self._put(start / self._unit)

    def _put(self, deviations: Floats) -> None:
        """Start anew from these deviations (2, 3, n, columns)."""
        n, state = len(self.system), self.sim.state
        state.phase[:, :, n:] = deviations.reshape(2, 3, -1)
        self.sim.state = state

    @property
    def time(self) -> float:
        return self.sim.time

    @property
    def steps(self) -> int:
        """Steps taken so far."""
        return self.sim.steps_done

    def split(self, y: Floats) -> tuple[Floats, Floats]:
        """The particles' phase (2, 3, n), and the derivatives (2, 3, n, columns), of the run's y (2, 3, n (1 +
        columns))."""
        n = len(self.system)
        deviations = y[:, :, n:].reshape(2, 3, n, self.columns.total)
        return y[:, :, :n].copy(), deviations * self._unit

    def advance(self, number: int, visit: Callable[[], bool | None], every: int = EVERY) -> None:
        """Take steps, and call ``visit`` after each ``every`` of them; a true value ends them."""
        large = False

        def seen(sim: Simulation) -> bool:
            nonlocal large
            y = sim.integration.stepper.y
            large = bool((np.abs(y[:, :, len(self.system) :]).max(axis=2) > LARGEST * self._scale[:, :, 0, 0]).any())
            return bool(visit()) or large

        goal = self.sim.steps_done + number
        while (left := goal - self.sim.steps_done) > 0:
            self.sim.advance(left, every=every, visit=seen)
            if not large:
                return
            self._shrink()
            large = False

    def _shrink(self) -> None:
        """Scale each column back to the size of one, by a power of two."""
        n = len(self.system)
        y = self.sim.state.phase[:, :, n:].reshape(2, 3, n, -1)
        size = np.abs(y / self._scale).max(axis=(0, 1, 2))
        factor = 2.0 ** np.round(np.log2(np.where(size > 0.0, size, 1.0)))
        self._unit *= factor
        self._put(y / factor)

    def to(self, length: float, progress: Callable[[int, int], Any] | None = None) -> tuple[Floats, Floats, float]:
        """Go on for a length of time. Return phase, derivatives and the time, as ``split`` does."""
        begin, end = self.time, self.time + length

        def visit() -> bool:
            done = (self.sim.integration.stepper.time - begin) / length
            if progress:
                progress(int(1000 * min(1.0, done)), 1000)
            return self.sim.method.chooses_steps and done >= 1.0

        if not self.sim.method.chooses_steps:
            assert self.sim.dt is not None
            self.advance(cadence(length, self.sim.dt)[0], visit)
            return *self.split(self.sim.integration.stepper.y), self.time
        stepper: Any = self.sim.integration.stepper
        while stepper.time < end:
            self.advance(1, visit, 1)
            stepper = self.sim.integration.stepper
        return *self.split(stepper.at(end)), end

    @property
    def by_differences(self) -> tuple[str, ...]:
        """Names of the forces whose slopes came from central differences."""
        return tuple(force.name for force in self.sim.integration.system.forces if force.differs)  # type: ignore[union-attr]

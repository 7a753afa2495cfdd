"""A run of a System together with deviations from it, one for each number that the end is differentiated by."""

from collections.abc import Callable
from typing import Any

import numpy as np

from kickdrift.analysis.tangents.columns import Columns
from kickdrift.analysis.tangents.deviations import cadence, scale_of
from kickdrift.errors import RunError
from kickdrift.forces.slopes.pushes import PairPush, Push, parameter_of, push_of_parameter, pushes_of_mass
from kickdrift.forces.slopes.variations import varied
from kickdrift.integrators.splitting.method import Splitting
from kickdrift.jit.cache.notices import compiling_for
from kickdrift.model.state import Floats
from kickdrift.model.system import System
from kickdrift.run.simulation import Simulation

DEFAULT = "gauss-radau15"  # where the system file has no integrator, or one that moves no deviations
LARGEST = 2.0**10  # growth of a deviation before it is scaled back: errors count relative to the largest number
EVERY = 16  # steps between two checks of that growth
SELDOM = 256  # the same for splitting methods, whose steps are linear in the deviations at any size


def _pushes(system: System, columns: Columns, unit: Floats) -> list[Push | PairPush]:
    """What the masses and parameters do in each force, for columns in these units."""
    made: list[Push | PairPush] = []
    of_masses = columns.of_masses(len(system))
    if of_masses is not None:
        for body, column in np.argwhere(of_masses):
            made += pushes_of_mass(system, int(body), int(column), 1.0 / unit[column])
    for k, text in enumerate(columns.parameters, sum(columns.widths[:2])):
        made.append(push_of_parameter(system, text, k, 1.0 / unit[k]))
    return made


def _size(value: float) -> float:
    """The power of two next to a number's size."""
    return float(2.0 ** np.round(np.log2(abs(value) or 1.0)))


def accelerations_at_start(sim: Simulation, n: int) -> Floats:
    """Accelerations (3, n) of the first n particles; zeros where they are not finite, as the run will say."""
    try:
        with compiling_for(sim.integration.purpose):
            return sim.accelerations()[:n].T
    except RunError:
        return np.zeros((3, 1))


class VariedRun:
    """A System with deviations, under way.

    Deviations are in units of the system's own distance, speed and mass, as powers of two, so that a tolerance serves
    them as well as the particles. Scaling them changes no digit. With ``second`` there are deviations of order 2 behind
    those of order 1; the unit of each is the product of two units. The deviations start from ``begun`` (2, 3, n,
    columns) if it is given, else as the columns say.
    """

    def __init__(
        self,
        system: System,
        columns: Columns,
        name: str,
        threads: int,
        options: dict[str, Any],
        second: bool = False,
        begun: Floats | None = None,
    ) -> None:
        n, count = len(system), columns.total
        self.system, self.columns, self._pairs = system, columns, np.triu_indices(count if second else 0)
        self._given, self._before, self._differ = (name, threads, options), 0, set[str]()
        start, masses = columns.start(n) if begun is None else begun, columns.of_masses(n)
        start = np.concatenate([start, columns.second_start(n, *self._pairs)], axis=-1)
        half, first = 6 * len(columns.bodies), sum(columns.widths[:2])
        unit: Floats = np.ones(count)  # true deviation over the scaled one
        self._pushed: Any = np.zeros(count, bool)  # columns with terms of their own in the forces
        if masses is not None:
            self._pushed = masses.any(axis=0)
            unit[self._pushed] = 1.0 / _size(system.state.masses.sum())
        for k, text in enumerate(columns.parameters, first):
            self._pushed[k], unit[k] = True, 1.0 / _size(parameter_of(system, text)[2])
        self._unit = self._with_pairs(unit)
        self.sim = self._simulation(system, start)
        scale = scale_of(system.state.phase, accelerations_at_start(self.sim, n))
        self._scale = 2.0 ** np.round(np.log2(scale))[..., None]
        found = np.abs(start / self._scale).max(axis=(0, 1, 2))[:count]
        found = 2.0 ** np.round(np.log2(np.where(found > 0.0, found, 1.0)))
        if begun is None:
            found[:half] = 1.0 / np.repeat(self._scale[:, 0, 0, 0], half // 2)
        self._unit = self._with_pairs(np.where(self._pushed, unit, found))
        self._put(start / self._unit)

    def _simulation(self, system: System, deviations: Floats) -> Simulation:
        """A run of the system with these scaled deviations (2, 3, n, columns)."""
        count, masses = self.columns.total, self.columns.of_masses(len(system))
        if masses is not None:
            masses = np.concatenate([masses / self._unit[:count], np.zeros((len(system), len(self._pairs[0])))], axis=1)
        pushes = _pushes(self.system, self.columns, self._unit)
        made = varied(system, deviations.reshape(2, 3, -1), masses, pushes, count)
        name, threads, options = self._given
        return Simulation(made, name, threads=threads, **options)

    def _with_pairs(self, values: Any) -> Floats:
        """Values for the deviations of order 1, and their products for those of order 2."""
        return np.concatenate([values, values[self._pairs[0]] * values[self._pairs[1]]])

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
        return self._before + self.sim.steps_done

    def split(self, y: Floats) -> tuple[Floats, Floats]:
        """The particles' phase (2, 3, n), and the derivatives (2, 3, n, columns), of the run's y."""
        return y[:, :, : len(self.system)].copy(), (self._deviations(y) * self._unit)[..., : self.columns.total]

    def second(self) -> Floats:
        """Second derivatives (2, 3, n, columns, columns) where ``to`` ended."""
        n, count = len(self.system), self.columns.total
        found, (one, two) = (self._deviations(self._end) * self._unit)[..., count:], self._pairs
        made = np.empty((2, 3, n, count, count))
        made[..., one, two] = made[..., two, one] = found
        return made

    def _deviations(self, y: Floats) -> Floats:
        """The scaled deviations (2, 3, n, deviations) in the run's y (2, 3, n (1 + deviations))."""
        return y[:, :, len(self.system) :].reshape(2, 3, len(self.system), -1)

    def advance(self, number: int, visit: Callable[[], bool | None], every: int = EVERY) -> None:
        """Take steps, and call ``visit`` after each ``every`` of them; a true value ends them."""
        large = False

        def seen(sim: Simulation) -> bool:
            nonlocal large
            y = sim.integration.stepper.y
            sizes = np.abs(self._deviations(y)[..., : self.columns.total]).max(axis=(2, 3), initial=0.0)
            ended = bool(visit())
            large = not ended and bool((sizes > LARGEST * self._scale[:, :, 0, 0]).any())
            return ended or large

        goal = self.steps + number
        while (left := goal - self.steps) > 0:
            self.sim.advance(left, every=every, visit=seen)
            if not large:
                return
            self._shrink()
            large = False

    def _shrink(self) -> None:
        """Scale each column back to the size of one, by a power of two. What a mass or a parameter does scales with its
        column."""
        y = self._deviations(self.sim.state.phase)
        size = np.abs(y / self._scale).max(axis=(0, 1, 2))[: self.columns.total]
        factor = self._with_pairs(2.0 ** np.round(np.log2(np.where(size > 0.0, size, 1.0))))
        self._unit *= factor
        if (factor[: self.columns.total][self._pushed] == 1.0).all():
            self._put(y / factor)
            return
        self._before, self._differ = self.steps, {*self._differ, *self.by_differences}
        phase = self.sim.state.phase[:, :, : len(self.system)]
        self.sim = self._simulation(self.system.at(phase, self.sim.time), y / factor)

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
            every = SELDOM if isinstance(self.sim.method, Splitting) else EVERY
            self.advance(cadence(length, self.sim.dt)[0], visit, every)
            self._end = self.sim.integration.stepper.y
            return *self.split(self._end), self.time
        stepper: Any = self.sim.integration.stepper
        while stepper.time < end:
            self.advance(1, visit, 1)
            stepper = self.sim.integration.stepper
        self._end = stepper.at(end)
        return *self.split(self._end), end

    @property
    def by_differences(self) -> tuple[str, ...]:
        """Names of the forces whose slopes came from central differences."""
        forces: Any = self.sim.integration.system.forces  # type: ignore[union-attr]
        return tuple(dict.fromkeys(force.name for force in forces if force.differs or force.name in self._differ))

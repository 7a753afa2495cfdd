"""A run of a System with derivatives of its end by a method's tangent map: what the maps have in common."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from kickdrift.analysis.tangents.columns import Columns
from kickdrift.analysis.tangents.deviations import cadence
from kickdrift.analysis.tangents.varied_run import DEFAULT
from kickdrift.errors import InputError, RunError
from kickdrift.forces.gravity.direct import Gravity
from kickdrift.forces.laws.central import gravitational_constant
from kickdrift.forces.slopes.pushes import PairPush, Push, parameter_of, push_of_parameter, pushes_of_mass
from kickdrift.forces.slopes.variations import check_mapped
from kickdrift.jit.cache.notices import compiling_for
from kickdrift.model.state import Floats
from kickdrift.model.system import System
from kickdrift.run.simulation import Simulation

if TYPE_CHECKING:
    from kickdrift.integrators.wisdom_holman.tangent_columns import Derived


Pushes = list[tuple[int, Push | PairPush]]
PIECE = 1000  # steps between two reports of progress


class BoundOthers(NamedTuple):
    """Machine code of the other forces. It must live as long as its addresses are in use."""

    slopes: list[Any]
    pushes: list[Any]
    forces: NDArray[np.int64]  # (other forces, 2) addresses of the slopes of each, and of its parts
    table: NDArray[np.int64]  # (pushes, 3) the column of each, and addresses


def pushes_of(system: System, columns: Columns | None) -> Pushes:
    """What masses and parameters do in the forces other than gravity, each with its column."""
    made: Pushes = []
    if columns is None:
        return made
    of_masses = columns.of_masses(len(system))
    if of_masses is not None:
        for body, column in np.argwhere(of_masses):
            made += [(int(column), push) for push in pushes_of_mass(system, int(body), 0, 1.0)]
    for column, text in enumerate(columns.parameters, sum(columns.widths[:2])):
        if not isinstance(system.forces[parameter_of(system, text)[0]], Gravity):
            made.append((column, push_of_parameter(system, text, 0, 1.0)))
    return made


def bound_others(forces: list[Any], pushes: Pushes, system: System, threads: int) -> BoundOthers:
    """Bind the slopes of these forces, and these pushes."""
    from kickdrift.forces.seam.kernel import BoundForce
    from kickdrift.forces.slopes.dual_slopes import BoundSlopes

    slopes = [BoundSlopes(force.bind(system, threads)).ready() for force in forces]
    bound = [BoundForce(push.bind(system, threads)).ready() for _, push in pushes]
    rows = [(column, each.address, each.work) for (column, _), each in zip(pushes, bound, strict=True)]
    return BoundOthers(
        slopes, bound,
        np.array([(each.address, each.work) for each in slopes], np.int64).reshape(-1, 2),
        np.array(rows, np.int64).reshape(-1, 3),
    )  # fmt: skip


class MapRun:
    """A System with derivatives under a method that has a tangent map. ``sim`` is a Simulation of the System, at the
    start. Without columns the caller gives the deviations to ``start``."""

    by_differences: tuple[str, ...] = ()
    _rows: Floats  # (blocks, rows, numbers) duals; positions and velocities in the first two rows
    _order: NDArray[np.int64]  # (n,) rows of the map's bodies in the system
    _count: int  # columns
    _twice: bool  # there are second derivatives

    def __init__(
        self,
        system: System,
        columns: Columns | None,
        name: str,
        threads: int,
        options: dict[str, Any],
        twice: bool = False,
    ) -> None:
        self._others = [force for force in system.forces if not isinstance(force, Gravity)]
        of_masses = None if columns is None else self._slopes_of_masses(system, columns, name)
        self._pushes = pushes_of(system, columns)
        sim = Simulation(system, name, threads=threads, **options)
        assert sim.dt is not None
        for force in self._others:
            check_mapped(force, system, name, twice)
        self.system, self.sim, self.dt, self.steps = system, sim, sim.dt, 0
        if columns is not None:
            self._start_from(columns, of_masses, twice)

    def _slopes_of_masses(self, system: System, columns: Columns, name: str) -> Floats | None:
        """Slopes of the masses (n, columns) along the columns; None if no mass varies. Raises InputError for a column
        that the map does not take."""
        raise NotImplementedError

    def start(self, slopes: Floats, of_masses: Floats | None = None, second: Floats | None = None) -> None:
        """Start from slopes (2, 3, n, columns) of the system's state, and slopes of the masses (n, columns).
        ``second`` (2, 3, n, columns, columns) are second derivatives of the state, those of the masses are zero."""
        raise NotImplementedError

    def advance(self, steps: int) -> None:
        raise NotImplementedError

    def _leave(self, found: Derived) -> None:
        """found <- the phase (2, 3, n) at the step point with its derivatives, bodies in the map's order."""
        raise NotImplementedError

    def _deviations(self) -> list[Floats]:
        """Slopes that scale with the deviations, (blocks, 2, numbers, lanes) each, to read and to write."""
        from kickdrift.integrators.wisdom_holman.tangent import slopes_in

        return [slopes_in(self._rows)]

    def _start_from(self, columns: Columns, of_masses: Floats | None, twice: bool) -> None:
        """Start from what the columns say."""
        n, count = len(self.system), columns.total
        second = None
        if twice:
            pairs = np.triu_indices(count)
            second = np.zeros((2, 3, n, count, count))
            second[..., pairs[0], pairs[1]] = columns.second_start(n, *pairs)
        self.start(columns.start(n), of_masses, second)

    def _given(self, slopes: Floats, of_masses: Floats | None, second: Floats | None) -> tuple[Derived, Derived]:
        """The phase and G m with these derivatives, bodies in the map's order."""
        from kickdrift.integrators.wisdom_holman.tangent_columns import derived

        state, order, self._count, self._twice = self.system.state, self._order, slopes.shape[-1], second is not None
        gravity = next(force for force in self.system.forces if isinstance(force, Gravity))
        G = gravitational_constant(gravity.name, gravity.G, self.system)
        by_mass = np.zeros((len(order), self._count)) if of_masses is None else G * of_masses[order]
        none = np.zeros((len(order), self._count, self._count)) if self._twice else None
        phase = derived(state.phase[:, :, order], slopes[:, :, order], None if second is None else second[:, :, order])
        return phase, derived(G * state.masses[order], by_mass, none)

    def _without_slopes(self) -> InputError:
        """The error of a map whose other forces have no exact slopes."""
        names = ", ".join(force.name for force in self._others)
        return InputError(f"{self.sim.integrator}: its tangent map needs exact slopes of {names}; {DEFAULT} does not")

    def _found(self) -> Derived:
        """The phase at the step point with its derivatives, bodies in the map's order."""
        from kickdrift.integrators.wisdom_holman.tangent_columns import derived_room

        with compiling_for(self.sim.integration.purpose):
            found = derived_room((2, 3, len(self.system)), self._count, self._twice)
            self._leave(found)
        if not all(np.isfinite(each).all() for each in found):
            raise RunError(f"{self.sim.integrator}, dt = {self.dt:g}: blew up before step {self.steps}")
        return found

    def now(self) -> tuple[Floats, Floats]:
        """Phase (2, 3, n) and derivatives (2, 3, n, columns) at the step point."""
        found, shape, back = self._found(), (2, 3, len(self.system)), np.argsort(self._order)
        return found.values.reshape(shape)[:, :, back], found.slopes.reshape(*shape, -1)[:, :, back]

    def second(self) -> Floats:
        """Second derivatives (2, 3, n, columns, columns) at the step point."""
        from kickdrift.integrators.wisdom_holman.tangent_columns import second_of

        return second_of(self._found(), (2, 3, len(self.system)))[:, :, np.argsort(self._order)]

    @property
    def time(self) -> float:
        return self.system.state.time + self.steps * self.dt

    def advance_and_look(self, steps: int, every: int, visit: Callable[[], Any]) -> None:
        """Take steps, and call ``visit`` after each ``every`` of them; a true value ends them."""
        goal = self.steps + steps
        while self.steps < goal:
            self.advance(min(every, goal - self.steps))
            if visit():
                return

    def scale(self, factor: float) -> None:
        for slopes in self._deviations():
            slopes *= factor

    def mix(self, matrix: Floats) -> None:
        """Replace the deviations by their sums with these weights (columns, columns)."""
        for slopes in self._deviations():
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

"""The numbers that a motion is differentiated by: coordinates and velocities, masses, parameters, orbital elements."""

from collections.abc import Iterable
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from kickdrift.analysis.tangents.element_slopes import Slopes, named, slopes_of
from kickdrift.errors import InputError
from kickdrift.forces.slopes.pushes import parameter_of
from kickdrift.model.state import Floats
from kickdrift.model.system import System

Indices = NDArray[np.int64]


class Columns(NamedTuple):
    """The variables of the derivatives, in the order of the columns."""

    bodies: tuple[int, ...]  # rows of the System whose start varies
    masses: tuple[int, ...] = ()  # rows of the System whose mass varies
    parameters: tuple[str, ...] = ()  # of forces, "j2.radius"
    elements: tuple[str, ...] = ()  # of bodies, "b.e"
    of_elements: Slopes | None = None  # what the elements do to the start

    @property
    def widths(self) -> tuple[int, ...]:
        """Numbers of columns of coordinates and velocities, masses, parameters and elements."""
        return 6 * len(self.bodies), len(self.masses), len(self.parameters), len(self.elements)

    @property
    def total(self) -> int:
        return sum(self.widths)

    def names(self, system: System) -> tuple[str, ...]:
        """Names of the columns, such as "b.x", "b.vx", "b.mass", "j2.radius" and "b.e"."""
        known = system.names or tuple(str(row) for row in range(len(system)))
        axes = [f"{known[body]}.{part}{axis}" for part in ("", "v") for body in self.bodies for axis in "xyz"]
        return (*axes, *(f"{known[row]}.mass" for row in self.masses), *self.parameters, *self.elements)

    def start(self, n: int) -> Floats:
        """Deviations (2, 3, n, columns): units for positions body by body and velocities body by body, nothing for
        masses and parameters, and what the elements do."""
        made = np.zeros((2, 3, n, self.total))
        for half in range(2):
            for place, body in enumerate(self.bodies):
                for axis in range(3):
                    made[half, axis, body, 3 * (half * len(self.bodies) + place) + axis] = 1.0
        if self.of_elements is not None:
            made[..., self.total - len(self.elements) :] = self.of_elements.first
        return made

    def second_start(self, n: int, one: Indices, two: Indices) -> Floats:
        """Second derivatives of the start (2, 3, n, p) by p pairs of columns: those by elements, others are zero."""
        made = np.zeros((2, 3, n, len(one)))
        if self.of_elements is not None:
            first = self.total - len(self.elements)
            both = np.flatnonzero((one >= first) & (two >= first))
            made[..., both] = self.of_elements.second[..., one[both] - first, two[both] - first]
        return made

    def of_masses(self, n: int) -> Floats | None:
        """Slopes of the masses (n, columns) along the columns; None if no mass varies."""
        made = np.zeros((n, self.total))
        made[list(self.masses), 6 * len(self.bodies) + np.arange(len(self.masses))] = 1.0
        if self.of_elements is not None:
            made[:, self.total - len(self.elements) :] = self.of_elements.masses
        return made if made.any() else None

    def split(self, flat: Floats) -> tuple[Floats, Floats | None, Floats | None, Floats | None]:
        """Derivatives (rows, columns) by coordinates and velocities, masses, parameters and elements; None for those
        without columns."""
        parts = np.split(flat, np.cumsum(self.widths)[:-1], axis=1)
        matrix, *others = (np.ascontiguousarray(part) for part in parts)
        by_masses, by_parameters, by_elements = (part if part.shape[1] else None for part in others)
        return matrix, by_masses, by_parameters, by_elements


def columns_of(
    system: System,
    bodies: Any,
    masses: bool,
    parameters: Iterable[str],
    elements: Iterable[str] = (),
    primary: str | int | None = None,
) -> Columns:
    """The numbers to differentiate by. Without ``bodies``, elements take the place of all coordinates."""
    by, of = ((texts,) if isinstance(texts, str) else tuple(texts) for texts in (parameters, elements))
    for text in by:
        parameter_of(system, text)
    if bodies is None and of:
        rows: tuple[int, ...] = ()
    else:
        rows = rows_of(system, bodies, "bodies")
    found = slopes_of(system, named(system, of), primary) if of else None
    return Columns(rows, tuple(range(len(system))) if masses else (), by, of, found)


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

"""Orbits of a System's bodies at one time, as a table by name."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from kickdrift.errors import InputError
from kickdrift.model.orbits.orbits import G_given, Paths, central_row, orbits_of
from kickdrift.model.starts.elements import ANGLES, Elements
from kickdrift.model.state import Floats
from kickdrift.model.subject import Subject
from kickdrift.model.units.unit_systems import UnitSystem
from kickdrift.text import choices, shown, suggestion

SHOWN = ("a", "e", "inc", "Omega", "omega", "f", "M", "P")  # columns of a printed table


class Orbit(NamedTuple):
    """An orbit by its elements, under the names and in the units of ``elements`` in a system file.

    Angles are in degrees: ``inc`` in [0, 180], ``Omega`` and ``omega`` in [0, 360), ``f``, ``M`` and ``E`` the true,
    mean and eccentric anomaly. Lengths and the period ``P`` are in the system's units. On a hyperbola ``a`` is negative
    and ``P`` infinite.
    """

    a: float
    q: float
    e: float
    inc: float
    Omega: float
    omega: float
    f: float
    M: float
    E: float
    P: float


@dataclass(frozen=True, eq=False, repr=False)
class OrbitTable:
    """Orbits of bodies at one time: a row for each body but the central one, in the bodies' order.

    ``table["Jupiter"]`` is the `Orbit` of a body. ``table.a`` is a column, an array (m,). The columns have the names
    and units of `Orbit`. ``names`` are the bodies, ``central`` is the central body, ``time`` is the time of the
    elements, and ``frame`` and ``plane`` are their reference frame and plane. ``print(table)`` shows the table.
    """

    names: tuple[str, ...]
    central: str
    frame: str
    plane: str
    time: float
    units: UnitSystem
    a: Floats
    q: Floats
    e: Floats
    inc: Floats
    Omega: Floats
    omega: Floats
    f: Floats
    M: Floats
    E: Floats
    P: Floats

    def __len__(self) -> int:
        return len(self.names)

    def __iter__(self) -> Iterator[str]:
        return iter(self.names)

    def __getitem__(self, name: str) -> Orbit:
        if name not in self.names:
            raise InputError(f"elements: no body {shown(name)} in the table{_near(name, self.names)}")
        row = self.names.index(name)
        return Orbit(*(float(getattr(self, column)[row]) for column in Orbit._fields))

    def __repr__(self) -> str:
        units = {"a": self.units.symbol("length"), "P": self.units.symbol("time")} | dict.fromkeys(ANGLES, "deg")
        headings = [f"{column} ({units[column]})" if units.get(column) else column for column in SHOWN]
        rows = [["", *headings]]
        rows += [[name, *(f"{getattr(self, column)[k]:.8g}" for column in SHOWN)] for k, name in enumerate(self.names)]
        widths = [max(map(len, column)) for column in zip(*rows, strict=True)]
        lines = [[cell.rjust(width) for cell, width in zip(row, widths, strict=True)] for row in rows]
        return "\n".join("  ".join([row[0].ljust(widths[0]), *line[1:]]) for row, line in zip(rows, lines, strict=True))


def orbit_table(system: Subject, frame: str, plane: str) -> OrbitTable:
    """Osculating elements of a system's bodies; see ``Simulation.elements``."""
    state = system.state
    if len(system) < 2:
        raise InputError(f"elements: {system.name!r} has one body, and an orbit needs two")
    if not state.masses.any():
        raise InputError(f"elements: no body of {system.name!r} has a mass")
    gravity, share = gravity_of(system, "elements"), state.masses / state.masses.sum()
    names = tuple(system.body(i) for i in range(len(system)))
    x, v = (np.ascontiguousarray(rows.T)[None] for rows in state.phase)
    x, v = (rows - np.einsum("n,knj->kj", share, rows)[:, None] for rows in (x, v))
    times, held, central = np.array([state.time]), state.masses[None], central_row(state.masses)
    found = orbits_of(Paths(times, x, v, state.masses, held, names, gravity, central), frame, plane)
    assert central is not None  # orbits_of refuses a system without a central body
    return OrbitTable(
        found.names, names[central], frame, plane, state.time, system.units,
        *(np.atleast_1d(column) for column in in_degrees(found.elements, found.mu, 0)),
    )  # fmt: skip


def in_degrees(found: Elements, mu: ArrayLike, row: int | tuple[()] = ()) -> tuple[Floats, ...]:
    """Elements (…) as the columns of `Orbit`; for elements (k, m), those of one row."""
    columns = {key: getattr(found, key) for key in Orbit._fields if key != "P"} | {"P": found.period(mu)}
    degrees = {key: np.degrees(value) if key in ANGLES else value for key, value in columns.items()}
    return tuple(np.asarray(degrees[key], dtype=float)[row] for key in Orbit._fields)


def gravity_of(system: Subject, key: str) -> float:
    """G of a system: that of its gravity, else that of its units. Raises an InputError that begins with ``key``."""
    given = G_given(system.forces, system.units)
    if given is None:
        raise InputError(
            f"{key}: units {system.units.name!r} define no G; give a force with G, such as kd.Gravity(G=1)"
        )
    return float(given)


def _near(name: str, names: tuple[str, ...]) -> str:
    hint = suggestion(name, names) if isinstance(name, str) else ""
    return f"{hint} (known: {choices(names, name)})"

"""Orbits of bodies about a central one: elements in any frame and plane, a table by name, ellipses for pictures."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from kickdrift.errors import InputError
from kickdrift.model.starts.coordinates import about_centre, attracting_masses
from kickdrift.model.starts.elements import ANGLES, Elements, elements
from kickdrift.model.state import Floats
from kickdrift.model.subject import Subject
from kickdrift.model.turned import invariable_axes
from kickdrift.model.units.unit_systems import UnitSystem
from kickdrift.text import choices, shown, suggestion

DOMINANT = 0.5  # least part of all mass for a body that the others orbit
PLANES = ("file", "invariable")


class Paths(NamedTuple):
    """Paths of bodies: times (k,), positions and velocities (k, n, 3) relative to their barycentre, and masses (n,).

    A body that was absorbed or removed has nan from then on. ``held`` (k, n) are the masses at each frame, including
    absorbed masses, and 0 for a body that is gone. ``central`` is the row of the body that the others orbit, None if no
    body dominates.
    """

    times: Floats
    positions: Floats
    velocities: Floats
    masses: Floats
    held: Floats
    names: tuple[str, ...]
    gravity: float
    central: int | None

    def invariable_axes(self) -> Floats:
        """Axes of the invariable plane at the first frame, as rows (3, 3)."""
        return invariable_axes(self.masses, self.positions[0], self.velocities[0])


class Orbits(NamedTuple):
    """Elements over time: times (k,), names (m,) of all bodies but the central one, and Elements of shape (k, m).

    A body that is gone has nan."""

    times: Floats
    names: tuple[str, ...]
    elements: Elements
    mu: Floats  # (k, m) G times the masses at the centre of each orbit and on it


def G_given(forces: Iterable[Any], units: UnitSystem) -> float | None:
    """G of the first force that sets one, else that of the units; None if both are missing."""
    return next((force.G for force in forces if getattr(force, "G", None) is not None), units.gravity)


def central_row(masses: Floats) -> int | None:
    """Row of the body that the others orbit: the heaviest, if it has half of all mass or is one of two; else None."""
    heaviest = int(np.argmax(masses))
    return heaviest if len(masses) == 2 or masses[heaviest] > DOMINANT * masses.sum() else None


def orbits_of(found: Paths, frame: str = "jacobi", plane: str = "file") -> Orbits:
    """Orbits from paths; see ``orbits``."""
    if plane not in PLANES:
        raise InputError(f"plane: expected one of {', '.join(PLANES)}, got {shown(plane)}{suggestion(plane, PLANES)}")
    if found.central is None:
        raise InputError(f"orbits: no body has {DOMINANT:g} of all mass, so there is no central body")
    others = np.delete(np.arange(len(found.masses)), found.central)
    turn = (
        invariable_axes(found.masses, found.positions[0], found.velocities[0]) if plane == "invariable" else np.eye(3)
    )
    values = np.full((len(Elements._fields) + 1, len(found.times), len(others)), np.nan)
    there = np.isfinite(found.positions[:, :, 0])
    changes = np.any((there[1:] != there[:-1]) | (found.held[1:] != found.held[:-1]), axis=1)
    for frames in np.split(np.arange(len(there)), np.flatnonzero(changes) + 1):  # frames with the same bodies
        left = np.flatnonzero(there[frames[0], others])
        if not (there[frames[0], found.central] and left.size):
            continue
        order = np.array([found.central, *others[left]])
        x, v = (y[frames][:, order] @ turn.T for y in (found.positions, found.velocities))
        m = found.held[frames[0], order]
        mu = found.gravity * attracting_masses(m, frame)
        osculating = elements(about_centre(x, m, frame), about_centre(v, m, frame), mu)
        for row, value in enumerate((*osculating, mu)):
            values[row][np.ix_(frames, left)] = value
    return Orbits(found.times, tuple(found.names[i] for i in others), Elements(*values[:-1]), values[-1])


COARSE = 0.35  # largest angle in radians between frames for which a trail is a path


def axes_of(found: Paths, central_rests: bool = False) -> Floats:
    """Ellipses (f, n, 9): centre c relative to the body, and semi-axes a and b of r = c + a cos E + b sin E.

    The ellipse is the orbit about the centre of mass of the bodies inside (Jacobi), as seen where the barycentre rests,
    or where the central body rests. The row of the central body, and rows without an ellipse, are nan.
    """
    central = found.central
    assert central is not None
    frames, n = found.positions.shape[:2]
    axes = np.full((frames, n, 9), np.nan)
    found = found._replace(names=tuple(map(str, range(n))))
    with np.errstate(all="ignore"):
        orbits = orbits_of(found)
        at = orbits.elements
        a = at.q / (1.0 - at.e)
        b = a * np.sqrt(np.maximum(1.0 - at.e**2, 0.0))
        towards, across = _perifocal(at.Omega, at.omega, at.inc)
        long, short = a[..., None] * towards, b[..., None] * across
        here = long * (np.cos(at.E) - at.e)[..., None] + short * np.sin(at.E)[..., None]
        middle = -at.e[..., None] * long - here  # the ellipse passes through the body
        bound = (at.e < 1.0)[..., None]
        found_axes = np.where(bound, np.concatenate([middle, long, short], axis=2), np.nan)
    others = np.delete(np.arange(n), central)
    if central_rests:
        axes[:, others] = found_axes
        return axes
    inside = np.cumsum(found.held[:, [central, *others]], axis=1)[:, 1:]
    part = 1.0 - found.held[:, others] / inside  # the barycentre of the body and all inside its orbit is at rest
    axes[:, others] = found_axes * part[..., None]
    return axes


def _perifocal(Omega: Floats, omega: Floats, inc: Floats) -> tuple[Floats, Floats]:
    """Unit vectors to the pericentre, and across to the direction of motion there."""
    co, so, cw, sw, ci, si = np.cos(Omega), np.sin(Omega), np.cos(omega), np.sin(omega), np.cos(inc), np.sin(inc)
    towards = np.stack([co * cw - so * sw * ci, so * cw + co * sw * ci, sw * si], axis=-1)
    across = np.stack([-co * sw - so * cw * ci, -so * sw + co * cw * ci, cw * si], axis=-1)
    return towards, across


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

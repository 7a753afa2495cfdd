"""Orbits of bodies about a central one: their elements, in any frame and plane."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any, NamedTuple

import numpy as np

from kickdrift.errors import InputError
from kickdrift.model.starts.coordinates import about_centre, attracting_masses
from kickdrift.model.starts.elements import Elements, elements
from kickdrift.model.state import Floats
from kickdrift.model.units.unit_systems import UnitSystem
from kickdrift.text import shown, suggestion

DOMINANT = 0.5  # least part of all mass for a body that the others orbit
PLANES = ("file", "invariable")
FLAT = 1e-10  # part of the sum of the bodies' own angular momenta: a smaller total has no direction


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
    turn = invariable_axes(found) if plane == "invariable" else np.eye(3)
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


def invariable_axes(found: Paths) -> Floats:
    """Axes of the invariable plane as rows, (3, 3). The third is along the total angular momentum at the start, the
    first as near to x as possible. Without rotation, the axes are the file's own."""
    own = found.masses[:, None] * np.nan_to_num(np.cross(found.positions[0], found.velocities[0]))
    total = own.sum(axis=0)
    size = float(np.linalg.norm(total))
    if size <= FLAT * float(np.linalg.norm(own, axis=1).sum()):
        return np.eye(3)
    up = total / size
    near = np.eye(3)[0 if abs(up[0]) < 0.9 else 1]
    first = near - (near @ up) * up
    first /= np.linalg.norm(first)
    return np.array([first, np.cross(up, first), up])

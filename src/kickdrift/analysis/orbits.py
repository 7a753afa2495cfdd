"""Orbits of a run's bodies: their elements over time, and the paths they are drawn from."""

from __future__ import annotations

import os
from typing import NamedTuple

import numpy as np

from kickdrift.coordinates import about_centre, attracting_masses, to_barycentric
from kickdrift.elements import Elements, elements
from kickdrift.errors import InputError
from kickdrift.state import Floats
from kickdrift.trajectory import reader
from kickdrift.units import shown, suggestion

DOMINANT = 0.5  # of all mass: from there on a body is what the others orbit
PLANES = ("file", "invariable")
FLAT = 1e-10  # of the sum of the bodies' own angular momenta: less than that, all of it, has no direction


class Paths(NamedTuple):
    """Where bodies were: (k,) times, (k, n, 3) positions and velocities relative to their barycentre, (n,) masses.

    ``central`` is the row of the body that the others orbit, None where none dominates.
    """

    times: Floats
    positions: Floats
    velocities: Floats
    masses: Floats
    names: tuple[str, ...]
    gravity: float
    central: int | None


class Orbits(NamedTuple):
    """Elements over time: (k,) times, (m,) names of the bodies but the central one, Elements of (k, m)."""

    times: Floats
    names: tuple[str, ...]
    elements: Elements
    mu: Floats  # (m,) G times the masses that each body orbits


def orbits(
    run: reader.Run | str | os.PathLike[str],
    frame: str = "jacobi",
    plane: str = "file",
    most_frames: int | None = None,
) -> Orbits:
    """The osculating elements of a run's bodies at its frames.

    Parameters
    ----------
    run : a run's file, open or by its path
    frame : "heliocentric", "jacobi" (in the order of the file) or "barycentric"; what the elements are relative to
    plane : "file", the x-y plane, or "invariable", at right angles to the total angular momentum at the start; what
        inclinations and nodes are counted from
    most_frames : no more frames than that, spread evenly; default all

    Raises
    ------
    InputError
        For a run without gravity, or whose bodies orbit none that has half of all mass.
    """
    found = paths(run, most_frames)
    return orbits_of(found, frame, plane)


def orbits_of(found: Paths, frame: str = "jacobi", plane: str = "file") -> Orbits:
    """``orbits`` of bodies that were read already."""
    if plane not in PLANES:
        raise InputError(f"plane: expected one of {', '.join(PLANES)}, got {shown(plane)}{suggestion(plane, PLANES)}")
    if found.central is None:
        raise InputError(f"orbits: no body has {DOMINANT:g} of all mass, so that there is none that the others orbit")
    others = [i for i in range(len(found.masses)) if i != found.central]
    order = [found.central, *others]
    x, v, m = found.positions[:, order], found.velocities[:, order], found.masses[order]
    if plane == "invariable":
        turn = invariable_axes(found)
        x, v = x @ turn.T, v @ turn.T
    mu = found.gravity * attracting_masses(m, frame)
    osculating = elements(about_centre(x, m, frame), about_centre(v, m, frame), mu)
    return Orbits(found.times, tuple(found.names[i] for i in others), osculating, mu)


def paths(run: reader.Run | str | os.PathLike[str], most_frames: int | None = None) -> Paths:
    """Positions and velocities of a run under gravity, relative to the barycentre of each frame."""
    if not isinstance(run, reader.Run):
        with reader.open(run) as opened:
            return paths(opened, most_frames)
    gravity = gravity_of(run)
    if gravity is None:
        raise InputError(f"{run.path}: has no gravity, and so no orbits")
    if not len(run):
        raise InputError(f"{run.path}: holds no frame")
    kept = len(run) if most_frames is None else min(most_frames, len(run))
    chosen = np.unique(np.linspace(0, len(run) - 1, kept).round().astype(int))
    m = run.masses
    x = to_barycentric(np.array([run[int(k)].positions for k in chosen]), m)[0]
    v = to_barycentric(np.array([run[int(k)].velocities for k in chosen]), m)[0]
    names = run.names or tuple(f"particle {i}" for i in range(len(m)))
    heaviest = int(np.argmax(m))
    central = heaviest if len(m) == 2 or m[heaviest] > DOMINANT * m.sum() else None
    return Paths(run.times[chosen], x, v, m, names, gravity, central)


def gravity_of(run: reader.Run) -> float | None:
    """G of a run's gravity, in its units; None where it has none."""
    for force in run.system_record["forces"]:
        if isinstance(force["parameters"], dict) and "G" in force["parameters"]:
            given = force["parameters"]["G"]
            return run.units.gravity if given is None else float(given)
    return None


def invariable_axes(found: Paths) -> Floats:
    """(3, 3), the rows the axes of the invariable plane: the third along the total angular momentum at the start, the
    first as near to x as that leaves; the file's own where the bodies do not turn."""
    own = found.masses[:, None] * np.cross(found.positions[0], found.velocities[0])
    total = own.sum(axis=0)
    size = float(np.linalg.norm(total))
    if size <= FLAT * float(np.linalg.norm(own, axis=1).sum()):
        return np.eye(3)
    up = total / size
    near = np.eye(3)[0 if abs(up[0]) < 0.9 else 1]
    first = near - (near @ up) * up
    first /= np.linalg.norm(first)
    return np.array([first, np.cross(up, first), up])

"""Hard spheres in the form for compiled code, and checks of their sizes and places."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from kickdrift.errors import InputError
from kickdrift.forces.fields.walls import distances, unit
from kickdrift.model.events.collision import Collision, restitution_of
from kickdrift.model.state import Floats

WIDER = 1.0 + 1e-9  # cells over the largest diameter, for rounding
PER_CELL = 2  # least mean number of spheres in a cell, so that few cells are empty
ROUNDING = 1e-9  # of a diameter: so much may spheres overlap at the start, as positions of a text do

Whole = NDArray[np.int64]


class Spheres(NamedTuple):
    """Spheres, cells and walls of a run.

    The fractional coordinates are those of `Box.fractional`: parts of the edges along periodic axes, lengths along the
    others. The outermost cells of an axis that is not periodic reach to infinity.
    """

    masses: Floats  # (n,) in the coherent unit
    radii: Floats  # (n,)
    edges: Floats  # (3, 3) edge vectors as rows, unit vectors along open axes
    inverse: Floats  # (3, 3)
    periodic: NDArray[np.bool_]  # (3,)
    cells: Whole  # (3,) numbers of cells
    low: Floats  # (3,) fractional coordinate of the first cell's lower side
    width: Floats  # (3,) fractional width of the cells
    restitution: tuple[float, float, float]  # see `model.events.collision.ratio`
    normals: Floats  # (walls, 3) of length 1
    walls: Floats  # (3, walls) offset at t = 0, speed along the normal, restitution


def spheres_of(event: Collision, system: Any) -> Spheres:
    """The spheres of a System. Raises InputError for spheres that do not fit."""
    radii, x = event.radii_in(system), system.state.positions
    walls = [force for force in system.forces if getattr(force, "reflects", False)]
    check_places(event, system, radii, walls)
    box = system.box
    periodic = np.array(box.periodic_axes)
    edges = np.where(periodic[:, None], box.matrix, np.eye(3))
    widest = 2.0 * float(radii.max(initial=0.0))
    heights = np.where(periodic, box.heights, 0.0)
    fractions = box.fractional(x)
    low = np.where(periodic, 0.0, fractions.min(axis=0))
    span = np.where(periodic, heights, fractions.max(axis=0) - low)
    long = span > 0.0
    while True:
        room, axes = float(np.prod(span[long])), max(1, int(long.sum()))
        least = max(widest * WIDER, (PER_CELL * room / len(system)) ** (1.0 / axes))
        if not (long & (span < least)).any():
            break
        long &= span >= least  # a thin layer has one cell across
    cells = np.maximum(1, np.minimum(span / least, len(system)).astype(np.int64))
    width = np.where(periodic, 1.0, np.where(span > 0.0, span, 1.0)) / cells
    normals = np.array([unit(wall) for wall in walls]).reshape(-1, 3)
    numbers = [
        (normal @ np.array(wall.point), wall.speed, wall.restitution)
        for normal, wall in zip(normals, walls, strict=True)
    ]
    return Spheres(
        system.coherent_masses.copy(), radii, edges, np.linalg.inv(edges), periodic, cells, low, width,
        restitution_of(event, system), normals, np.array(numbers, float).reshape(-1, 3).T.copy(),
    )  # fmt: skip


def check_places(event: Collision, system: Any, radii: Floats, walls: list[Any]) -> None:
    """Refuse spheres that overlap, or that reach into a wall."""
    from scipy.spatial import cKDTree

    x = system.state.positions
    for wall in walls:
        gap = distances(wall, x) - wall.speed * system.state.time - radii
        i = int(gap.argmin())
        if gap[i] < -ROUNDING * max(radii[i], float(np.abs(x[i]).max())):
            raise InputError(
                f"{wall.name}: reaches {-gap[i]:.6g} into {system.body(i)}, which has the radius {radii[i]:g}"
            )
    box, largest = system.box, float(radii.max(initial=0.0))
    if not largest > 0.0 or len(system) < 2:
        return
    wrapped = box.wrap(x)
    shifts = np.array(np.meshgrid(*[(-1, 0, 1) if along else (0,) for along in box.periodic_axes])).reshape(3, -1).T
    images = np.concatenate([wrapped + shift @ box.matrix for shift in shifts.astype(float)])
    near = cKDTree(images).query_ball_point(wrapped, 2.0 * largest)
    for i, found in enumerate(near):
        others = np.array(found)
        body = others % len(system)
        others, body = others[body > i], body[body > i]
        apart = np.linalg.norm(images[others] - wrapped[i], axis=1)
        reach = (radii[i] + radii[body]) * (1.0 - ROUNDING)
        reach[(system.state.masses[body] == 0.0) & (system.state.masses[i] == 0.0)] = 0.0
        if (apart < reach).any():
            k = int((apart - reach).argmin())
            raise InputError(
                f"{event.kind}: {system.body(i)} and {system.body(int(body[k]))} overlap at the start: they are "
                f"{apart[k]:.6g} apart, and their radii add up to {radii[i] + radii[body[k]]:.6g}"
            )

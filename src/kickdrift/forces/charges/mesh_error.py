"""Error of the forces of particle-mesh Ewald, for charges at random places.

The force of a pair on the mesh has Fourier components that Ewald's sum lacks, and other components of a wrong size.
The mean square of these differences over all places follows from the splines (Hockney & Eastwood 1988; Wang, Dommert &
Holm 2010, doi:10.1063/1.3446812). A charge also pushes itself, as far as it sees the points of the mesh (Ballenegger
2011, doi:10.1063/1.3555122).
"""

import math
from functools import cache
from typing import Any

import numpy as np

from kickdrift.forces.charges.accuracy import Charged
from kickdrift.forces.charges.mesh_sizes import IMAGES
from kickdrift.model.state import Floats

POINTS = 10  # waves along each axis at which errors are taken
REACH = 7.0  # wave number over the splitting parameter beyond which the mesh may be wrong: the waves are too small
TABLE = np.geomspace(0.05, 4.0, 24)  # splitting parameters times distances of the mesh


def squares_of(cell: Floats, alpha: float, order: int) -> tuple[float, float]:
    """Mean square errors of the force between two unit charges at random places, times the volume, and of the force of
    a unit charge on itself. ``cell`` (3, 3) has the edge vectors of a cell of the mesh as rows."""
    inverse = np.linalg.inv(cell)
    metric = (2.0 * math.pi) ** 2 * inverse.T @ inverse  # k^2 = n metric n
    parts = np.minimum(1.0, REACH * alpha / (math.pi * np.linalg.norm(inverse, axis=0)))  # of all waves, that count
    between = (np.arange(POINTS) + 0.5) / POINTS - 0.5
    n = [part * between + np.arange(-IMAGES, IMAGES + 1)[:, None] for part in parts.tolist()]
    w = [np.sinc(each) ** order for each in n]
    near = slice(IMAGES - 1, IMAGES + 2)
    k, seen = [each[near] for each in n], [wave[near] ** 2 for wave in w]
    k2 = sum(metric[a, b] * _along(k, a) * _along(k, b) for a in range(3) for b in range(3))
    exact = 4.0 * math.pi * np.exp(-0.25 * k2 / alpha**2) / k2  # (image, wave) along each axis
    others = [np.delete(wave, IMAGES, axis=0) for wave in w]  # differences from these do not cancel
    more = [np.log1p((other**2).sum(axis=0) / each[1]) for other, each in zip(others, seen, strict=True)]
    beyond = more[0][:, None, None] + more[1][:, None] + more[2]
    alone = seen[0][1][:, None, None] * seen[1][1][:, None] * seen[2][1]
    influence = np.exp(-2.0 * beyond) / alone * exact[1, :, 1, :, 1, :]
    crossed = _along(seen, 0) * _along(seen, 1) * _along(seen, 2)
    wrong = exact - crossed * influence[:, None, :, None, :]
    wrong[1, :, 1, :, 1, :] = -np.expm1(-2.0 * beyond) * exact[1, :, 1, :, 1, :]
    aliased = (alone * np.exp(beyond))[:, None, :, None, :] - crossed
    aliased[1, :, 1, :, 1, :] = alone * np.expm1(beyond)
    error = (k2 * (wrong**2 + crossed * aliased * influence[:, None, :, None, :] ** 2)).sum(axis=(0, 2, 4))
    share = float(parts.prod()) / abs(float(np.linalg.det(cell)))
    return share * float(error.mean()), share**2 * _on_itself(n, w, influence, metric)


def _along(k: list[Floats], axis: int) -> Floats:
    """Numbers (images, waves) of an axis, for products with those of other axes."""
    shape = [1] * 6
    shape[2 * axis : 2 * axis + 2] = k[axis].shape
    return k[axis].reshape(shape)


def _on_itself(n: list[Floats], w: list[Floats], influence: Floats, metric: Floats) -> float:
    """Mean square of a unit charge's force on itself, if the waves of a cell are one."""
    shifts = (-1, 0, 1)
    rows = []
    for each, wave in zip(n, w, strict=True):
        both = [wave * np.roll(wave, shift, axis=0) for shift in shifts]
        rows.append(np.array([[product.sum(axis=0) for product in both], [(each * p).sum(axis=0) for p in both]]))
    summed = np.einsum("pai,qbj,rck,ijk->pqrabc", *rows, influence, optimize=True) / influence.size
    force = np.array([summed[1, 0, 0], summed[0, 1, 0], summed[0, 0, 1]])  # (3, shift along x, y, z)
    force[:, 1, 1, 1] = 0.0
    return float(np.einsum("aijk,ab,bijk", force, metric, force))


def mesh_error(charged: Charged, cell: Floats, alpha: float, order: int) -> float:
    """Root-mean-square error of a force by the mesh, over the unit."""
    return float(_over_unit(charged, *squares_of(cell, alpha, order)))


def errors_by_alpha(charged: Charged, spacing: float, order: int) -> tuple[Floats, Floats]:
    """Splitting parameters, rising, and the errors of meshes with cubic cells of this edge, likewise over the unit."""
    pair, alone = _table(order)
    return TABLE / spacing, _over_unit(charged, pair / spacing, alone / spacing**4)


def _over_unit(charged: Charged, pair: Any, alone: Any) -> Any:
    square = charged.squares**2 / (charged.charges * charged.volume) * pair
    return np.sqrt(square + charged.fourths / charged.charges * alone) / charged.unit


@cache
def _table(order: int) -> Floats:
    """`squares_of` (2, TABLE) for cells of edge 1."""
    return np.array([squares_of(np.eye(3), alpha, order) for alpha in TABLE.tolist()]).T

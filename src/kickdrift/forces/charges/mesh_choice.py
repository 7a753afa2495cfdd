"""Parameters of particle-mesh Ewald for a wanted error: the cheapest cutoff, splitting parameter, mesh and order.

Costs are fixed numbers, measured once. So the choice depends on the system alone, and not on the machine."""

import math
from collections.abc import Iterator
from functools import lru_cache

import numpy as np

from kickdrift.forces.charges.accuracy import PAIR, SHARE, Charged, Split, rising
from kickdrift.forces.charges.mesh_error import errors_by_alpha, mesh_error
from kickdrift.forces.charges.mesh_sizes import ORDERS, SMALLEST, is_smooth
from kickdrift.model.state import Floats

ROW, POINT = 4.2, 0.4  # nanoseconds of each row of the mesh for an ion, and of a point over its binary logarithm
FINEST = 25.0  # points for the mean distance of charges in the finest mesh that is tried
LARGEST = 512  # points along an axis of the largest mesh that is chosen
TURNS = 40  # of the cheapest meshes, whose exact errors are computed
NEAR, NEARBY = 1.6, 7  # splitting parameters at which they are: their range, as a factor, and their number

Matrix = tuple[tuple[float, ...], ...]


@lru_cache(maxsize=64)
def cheapest_mesh(
    charged: Charged,
    matrix: Matrix,
    accuracy: float,
    shortest: float,
    longest: float,
    cutoff: float | None,
    alpha: float | None,
    mesh: tuple[int, ...] | None,
    order: int | None,
) -> tuple[float, Split] | None:
    """The cheapest Split with a mesh, and its cost in nanoseconds for each charge; None if nothing gives the accuracy.

    ``matrix`` has the edge vectors of the box as rows. Values that are given stay. A pair force has the ``shortest``
    cutoff anyway. A mesh that is given may be too coarse for the accuracy."""
    wanted, box = SHARE * accuracy, np.array(matrix)
    shortest = min(shortest, longest)
    most = alpha or _alpha_of_cutoff(charged, cutoff or shortest, wanted)
    fixed = alpha is not None or cutoff is not None
    found: list[tuple[float, Split]] = []
    for shape in [mesh] if mesh else _meshes(charged, box):
        spacing = (charged.volume / math.prod(shape)) ** (1.0 / 3.0)
        for each in [order] if order else ORDERS:
            able = _largest_alpha(*errors_by_alpha(charged, spacing, each), wanted)
            if min(shape) < each or (fixed and mesh is None and able < most):
                continue
            split = _split(charged, most if fixed else min(most, able), cutoff, wanted, shape, each)
            if fixed or split.cutoff <= longest:
                found.append((cost(charged, split, shortest), split))
    for _, split in sorted(found)[:TURNS]:
        cell = box / np.array(split.mesh)[:, None]
        able = _exact_alpha(charged, cell, split, wanted)
        if fixed and (mesh is not None or able >= most):
            return cost(charged, split, shortest), split
        split = _split(charged, min(most, able), cutoff, wanted, split.mesh, split.order)
        if not fixed and split.cutoff <= longest:
            return cost(charged, split, shortest), split
    return None


def _split(
    charged: Charged, alpha: float, cutoff: float | None, wanted: float, mesh: tuple[int, ...], order: int
) -> Split:
    """The Split with this mesh, and with the cutoff for the wanted error unless it is given."""
    if cutoff is None:
        cutoff = rising(lambda r: charged.near_error(alpha, r) - wanted, 1e-2 / alpha, 1e2 / alpha)
    return Split(alpha, cutoff, 0.0, mesh, order)


def cost(charged: Charged, split: Split, shortest: float) -> float:
    """Nanoseconds of an evaluation with a mesh, for each charge."""
    pairs = 2.0 / 3.0 * math.pi * charged.charges / charged.volume * max(split.cutoff, shortest) ** 3
    points = math.prod(split.mesh)
    return PAIR * pairs + ROW * split.order**2 + POINT * points * math.log2(points) / charged.charges


def predicted(charged: Charged, split: Split, matrix: Floats) -> float:
    """Predicted error of the forces, relative to ``charged.unit``, in a box with these edge vectors."""
    if not split.mesh:
        return split.error(charged)
    far = mesh_error(charged, matrix / np.array(split.mesh)[:, None], split.alpha, split.order)
    return math.hypot(charged.near_error(split.alpha, split.cutoff), far)


def _meshes(charged: Charged, box: Floats) -> Iterator[tuple[int, ...]]:
    """Meshes from coarse to fine, with nearly the same distance along each axis."""
    heights = 1.0 / np.linalg.norm(np.linalg.inv(box), axis=0)
    sizes = [n for n in range(SMALLEST, 2 * LARGEST) if is_smooth(n)]
    apart, last = (charged.volume / charged.charges) ** (1.0 / 3.0), None
    for first in sizes:
        spacing = float(heights.max()) / first
        if first > LARGEST or spacing < apart / FINEST:
            return
        if spacing > 2.0 * apart and first > 4 * SMALLEST:
            continue
        shape = tuple(
            next(n for n in sizes if n >= height / spacing * (1.0 - 1e-9) and (axis < 2 or n % 2 == 0))
            for axis, height in enumerate(heights.tolist())
        )
        if shape != last:
            yield shape
        last = shape


def _alpha_of_cutoff(charged: Charged, cutoff: float, wanted: float) -> float:
    return rising(lambda a: charged.near_error(a, cutoff) - wanted, 1e-3 / cutoff, 1e2 / cutoff)


def _largest_alpha(alphas: Floats, errors: Floats, wanted: float) -> float:
    """The splitting parameter at which the error is the wanted one, between those of a table."""
    return math.exp(float(np.interp(math.log(wanted), np.log(errors), np.log(alphas))))


def _exact_alpha(charged: Charged, cell: Floats, split: Split, wanted: float) -> float:
    """The same for a mesh with this cell, near the splitting parameter of a Split."""
    alphas = split.alpha * np.geomspace(1.0 / NEAR, NEAR, NEARBY)
    errors = np.array([mesh_error(charged, cell, alpha, split.order) for alpha in alphas.tolist()])
    return _largest_alpha(alphas, errors, wanted)

"""Checks of the edge vectors that users give for a box, and short vectors of a lattice for nearest images.

Every refusal suggests what to give instead.
"""

import itertools
import math
from collections.abc import Iterable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from kickdrift.errors import InputError
from kickdrift.model.checks.values import is_number, listed, number
from kickdrift.text import shown

Rows = NDArray[np.float64]

SMALLER = 1 - 1e-12  # largest ratio of squares that counts as shorter, so that rounding ends the search


def lower(rows: Rows) -> Rows:
    """Same lattice with tilts of half an edge at most: the lower triangular ``rows`` (3, 3), each less multiples of
    earlier rows."""
    made = rows.copy()
    for k, before in ((2, 1), (2, 0), (1, 0)):
        if made[before, before]:
            made[k] -= np.rint(made[k, before] / made[before, before]) * made[before]
    return made


def shortest(rows: Rows) -> Rows:
    """Minkowski-reduced vectors (m, 3) of the lattice with the vectors ``rows`` (m, 3), m = 1, 2 or 3.

    Source: the greedy algorithm of Nguyen & Stehlé (ACM Trans. Algorithms 5, 46, 2009, doi:10.1145/1597036.1597050).
    Their lemma on Voronoi coordinates gives the nearest image of a vector with coordinates within ±1/2 along these
    rows: the vector plus -1, 0 or 1 times each row.
    """
    made = rows[np.argsort((rows**2).sum(axis=1), kind="stable")]
    if len(made) == 1:
        return made
    while True:
        first = made[:-1] if len(made) == 2 else shortest(made[:-1])
        last = made[-1] - np.rint(np.linalg.lstsq(first.T, made[-1], rcond=None)[0]) @ first
        steps = np.array(list(itertools.product((0, 1, -1), repeat=len(first)))) @ first
        last = min(last + steps, key=lambda vector: float(vector @ vector))
        done = last @ last >= SMALLER * (first[-1] @ first[-1])
        made = np.vstack([first, last])
        if done:
            return made
        made = made[np.argsort((made**2).sum(axis=1), kind="stable")]


def neighbours(rows: Rows) -> Rows:
    """Sums of -1, 0 or 1 times each of the ``rows`` (m, 3), without zero, shape (3^m - 1, 3)."""
    return np.array([n for n in itertools.product((-1, 0, 1), repeat=len(rows)) if any(n)]) @ rows


Floats = NDArray[np.float64]
Vector = tuple[float, float, float]

LEAN = 0.5 * (1 + 1e-9)  # largest tilt as a part of an edge, with room for rounding
FLAT = 1e-12  # part of the product of the edges: a smaller volume is only rounding
STRAIGHT = 1e-12  # part of an edge: a smaller tilt is only rounding
TRUTHS = "true or false, or three of them"
EXPECTED = "three edge lengths, a matrix of edge vectors, or None"


def written(rows: Floats) -> str:
    """A matrix in the form that a user would type."""
    return "[" + ", ".join("[" + ", ".join(f"{value:.10g}" for value in row) + "]" for row in rows) + "]"


def axes_of(periodic: Any) -> tuple[bool, bool, bool]:
    """Check ``periodic`` and return three flags, for x, y and z."""
    given = [periodic] * 3 if isinstance(periodic, bool | np.bool_) else listed("box: periodic", periodic, TRUTHS)
    if len(given) != 3 or not all(isinstance(axis, bool | np.bool_) for axis in given):
        raise InputError(f"box: periodic: expected {TRUTHS}, got {shown(periodic)}")
    if not any(given):
        raise InputError("box: edges make a box periodic, but periodic is False along each axis")
    x, y, z = map(bool, given)
    return x, y, z


def rows_of(given: Any, needs_matrix: bool) -> tuple[Floats, bool]:
    """Edge vectors (3, 3) from lengths or a matrix, and whether these are of a plane."""
    if is_number(given):
        raise InputError(
            f"box: expected three edge lengths, got {given:g}; a cube is box=({given:g}, {given:g}, {given:g})"
        )
    items = listed("box", given, EXPECTED)
    size, rows = len(items), np.zeros((3, 3))
    if needs_matrix or any(isinstance(item, Iterable) and not isinstance(item, str) for item in items):
        for k, item in enumerate(items):
            row = listed(f"box: matrix[{k}]", item, "three numbers")
            if len(row) != size or size not in (2, 3):
                raise InputError(f"box: expected a matrix of three rows of three numbers, got {shown(given)}")
            rows[k, :size] = [number(value) for value in row]
        if not np.isfinite(rows).all():
            raise InputError(f"box: matrix: expected finite numbers, got {shown(given)}")
    elif size in (2, 3):
        for k, value in enumerate(items):
            rows[k, k] = length = number(value)
            if not (math.isfinite(length) and length >= 0):
                raise InputError(f"box: edge {'xyz'[k]} must be a positive finite length, got {shown(value)}")
    else:
        raise InputError(f"box: expected three edge lengths or None, got {size}")
    return rows, size == 2


def checked_rows(rows: Floats, axes: tuple[bool, bool, bool]) -> tuple[Vector, Vector, Vector]:
    """Return the rows as tuples. Raises InputError unless they are edge vectors of a box periodic along these axes."""
    tilts = rows - np.diag(np.diag(rows))
    for k, (axis, there) in enumerate(zip("xyz", axes, strict=True)):
        if not there and (tilts[k].any() or tilts[:, k].any() or rows[k, k] < 0):
            raise InputError(
                f"box: not periodic along {axis}, so edge {'abc'[k]} must lie along {axis} and "
                f"no other edge may lean along {axis}, got {written(rows)}"
            )
        if there and not tilts.any() and not rows[k, k] > 0:
            raise InputError(f"box: edge {axis} must be a positive finite length, got {shown(float(rows[k, k]))}")
    filled = np.where(np.array(axes)[:, None], rows, np.eye(3))
    x, y, z = (float(edge) for edge in np.diag(filled))
    if not tilts.any() and not 0.0 < x * y * z < math.inf:
        raise InputError(f"box: edges of {x:g}, {y:g} and {z:g} have a volume beyond the range of numbers")
    if tilts.any():
        _check_volume(filled)
        _check_triangle(filled)
    a, b, c = ((float(row[0]), float(row[1]), float(row[2])) for row in rows + 0.0)
    return a, b, c


def turned(rows: Floats) -> tuple[Floats, Floats]:
    """Rotate right-handed edge vectors (3, 3) so that a lies along x and b in the x-y plane. Returns the rotated
    vectors and the rotation (3, 3)."""
    _check_volume(rows)
    rotation = np.eye(3)
    if np.triu(rows, 1).any() or np.diag(rows).min() < 0:
        unit, upper = np.linalg.qr(rows.T)
        signs = np.sign(np.diag(upper))
        rows, rotation = np.tril(upper.T * signs), (unit * signs).T
    return np.where(np.abs(rows) <= STRAIGHT * np.abs(np.diag(rows)), 0.0, rows), rotation


def _check_volume(rows: Floats) -> None:
    """Refuse edge vectors that span no volume or are left-handed."""
    with np.errstate(over="ignore", under="ignore", invalid="ignore"):
        volume, edges = float(np.linalg.det(rows)), float(np.prod(np.linalg.norm(rows, axis=1)))
    if not (0 < edges < math.inf and math.isfinite(volume) and abs(volume) > FLAT * edges):
        raise InputError(
            f"box: the edge vectors are singular (no volume): {written(rows)}; "
            "expected three vectors that do not lie in one plane"
        )
    if volume < 0:
        raise InputError(f"box: the edge vectors are left-handed: {written(rows)}; swap two of them, or reverse one")


def _check_triangle(rows: Floats) -> None:
    """Refuse edge vectors that are not lower triangular or lean too far."""
    if np.triu(rows, 1).any() or np.diag(rows).min() < 0:
        found = lower(turned(rows)[0])
        raise InputError(
            "box: expected a lower triangular matrix with a positive diagonal (a along x, b in the x-y plane), got "
            f"{written(rows)}; Box.from_vectors turns it to {written(found)} and gives the rotation"
        )
    for k, along in ((1, 0), (2, 0), (2, 1)):
        tilt, most = abs(rows[k, along]), LEAN * rows[along, along]
        if tilt > most:
            name, edge = f"{'abc'[k]}{'xyz'[along]}", f"{'abc'[along]}{'xyz'[along]}"
            raise InputError(
                f"box: {name} = {rows[k, along]:.6g} leans too far, over half of {edge} = {rows[along, along]:.6g}; "
                f"the same lattice has the matrix {written(lower(rows))}"
            )

"""Lattices in the plane, for two-dimensional systems."""

from __future__ import annotations

import itertools
import math

import numpy as np

from kickdrift.errors import InputError
from kickdrift.model.starts.builders import check_lattice
from kickdrift.model.state import Floats

# Sites of one rectangular cell in units of its edges, moved off its sides, and the ratio of height to width.
PLANE_LATTICES: dict[str, tuple[tuple[tuple[float, float], ...], float]] = {
    "square": (((0.5, 0.5),), 1.0),
    "hexagonal": (((0.25, 0.25), (0.75, 0.75)), math.sqrt(3.0)),
}
LONGEST = 1.5  # largest ratio of the edges of a hexagonal lattice, which cannot fill a square


def plane_lattice(kind: str, count: int, density: float) -> tuple[Floats, tuple[float, float]]:
    """Positions (count, 3) at z = 0 on a lattice that fills a rectangle, and the rectangle's two edges.

    Parameters
    ----------
    kind : "square" or "hexagonal"
        Hexagonal: each particle has six nearest neighbours. The rows lie along x.
    count : particles
        k^2 for a square. 2 a b for the hexagonal lattice, which fills a rectangle as near to a square as a and b allow;
        the longer edge is at most 1.5 times the shorter one.
    density : particles per area

    Raises
    ------
    InputError
        For another kind, for a density that is not positive and finite, and for a count that leaves the last cells
        part empty; the message names the nearest counts that fill all cells.
    """
    check_lattice(kind, PLANE_LATTICES, count, density)
    sites, height = PLANE_LATTICES[kind]
    cells = _cells(kind, count)
    if cells is None:
        below = next((n for n in range(count - 1, 0, -1) if _cells(kind, n)), None)
        above = next(n for n in itertools.count(count + 1) if _cells(kind, n))
        near = f"counts are {below} and {above}" if below else f"count is {above}"
        raise InputError(f"count: {count} does not fill a {kind} lattice; the nearest {near}")
    width = math.sqrt(len(sites) / (density * height))
    shape = width * np.array([1.0, height])
    corners = np.indices(cells).reshape(2, -1).T[:, None]
    positions = ((corners + np.array(sites)) * shape).reshape(-1, 2)
    edge_x, edge_y = (float(edge) for edge in cells * shape)
    if not 0.0 < edge_x * edge_y < math.inf:
        raise InputError(
            f"density: {density:g} gives the box edges of {edge_x:g} and {edge_y:g}; the area is not a number"
        )
    return np.column_stack([positions, np.zeros(count)]), (edge_x, edge_y)


def _cells(kind: str, count: int) -> tuple[int, int] | None:
    """Numbers of cells along x and y in the rectangle nearest to a square; None if there is none."""
    sites, height = PLANE_LATTICES[kind]
    cells, rest = divmod(count, len(sites))
    if rest or not cells:
        return None
    best = None
    for ny in (n for n in range(1, math.isqrt(cells) + 1) if cells % n == 0):
        for pair in ((cells // ny, ny), (ny, cells // ny)):
            long = abs(math.log(pair[0] / (pair[1] * height)))
            if best is None or long < best[0]:
                best = (long, pair)
    assert best is not None
    most = math.log(LONGEST) if kind == "hexagonal" else 0.0
    return best[1] if best[0] <= most else None

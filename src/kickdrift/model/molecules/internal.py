"""Distances, angles, dihedrals and impropers of listed particles, in NumPy."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from kickdrift.model.box.box import Box
from kickdrift.model.state import Floats

LONGEST = 0.49  # of the least height of a box: near half of it, a bond's nearest image is uncertain


class Measure(NamedTuple):
    """What a list of particles measures: the particles in each item, and the arguments of a law of it."""

    particles: int
    arguments: tuple[str, str]


MEASURED = {
    "bonds": Measure(2, ("p", "r")),
    "angles": Measure(3, ("p", "angle")),
    "dihedrals": Measure(4, ("p", "angle")),
    "impropers": Measure(4, ("p", "angle")),
}


def measured(box: Box, x: Floats, items: NDArray[np.int64], kind: str) -> Floats:
    """Distance, angle, dihedral or improper (m,) of each item (m, 2 to 4) at positions x (3, n); angles in radians."""
    steps = [box.minimum_image((x[:, items[:, k]] - x[:, items[:, k + 1]]).T) for k in range(items.shape[1] - 1)]
    with np.errstate(invalid="ignore"):
        if kind == "bonds":
            return np.asarray(np.sqrt((steps[0] ** 2).sum(axis=1)))
        if kind == "angles":
            normal = np.cross(steps[0], steps[1])
            return np.arctan2(np.linalg.norm(normal, axis=1), -(steps[0] * steps[1]).sum(axis=1))
        first, second = np.cross(steps[0], steps[1]), np.cross(steps[1], steps[2])
        middle = np.linalg.norm(steps[1], axis=1)
        return np.arctan2(-(steps[0] * second).sum(axis=1) * middle, (first * second).sum(axis=1))

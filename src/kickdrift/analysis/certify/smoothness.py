"""Jumps of energies and forces along a line, such as those of a cutoff."""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from kickdrift.model.state import Floats

WHERE = ("energy", "force", "slope of the force", "curvature of the force")
POINTS = 400  # of a line
FINER = 4  # factor between two lattices of points
LEVELS = 5  # of ever finer lattices around the place
STENCIL = 12  # points on each side that are looked at again
CLEAR = 30.0  # times the typical difference of the line
ROUNDING = 1e3  # times the spacing of floats near the values


class Jump(NamedTuple):
    """A jump along a line: its quantity and its place.

    derivative : 0 for the energy, 1 for the force, 2 for its slope, 3 for its curvature
    size : of the jump, in units of energy over length to the power ``derivative``
    place : distance along the line
    """

    derivative: int
    size: float
    place: float


def jump_along(values: Callable[[float], tuple[float, float]], length: float) -> Jump | None:
    """The strongest jump along a line; None if none is resolved.

    ``values(s)`` returns the energy at the distance s, and the force along the line. Fourth differences of smooth
    values fall as the fourth power of the spacing. Near a jump of the k-th derivative they fall as its k-th power.
    """
    s = np.linspace(0.0, length, POINTS)
    line = np.array([values(each) for each in s])
    energy = _jump_of(lambda at: values(at)[0], s, line[:, 0])
    if energy is not None and energy.derivative == 0:
        return energy
    force = _jump_of(lambda at: values(at)[1], s, line[:, 1])
    return None if force is None else Jump(force.derivative + 1, force.size, force.place)


def _jump_of(value: Callable[[float], float], s: Floats, values: Floats) -> Jump | None:
    """The strongest jump of one quantity and of its first two derivatives."""
    size = np.abs(_fourth(values))
    place = int(np.argmax(size))
    noise = ROUNDING * np.spacing(np.abs(values).max())
    if not size[place] > max(CLEAR * np.median(size), noise):
        return None
    exponents: list[float] = []
    levels: list[tuple[Floats, float]] = []  # values near the place, and their spacing
    spacing, centre, largest = float(s[1] - s[0]), float(s[place + 2]), float(size[place])
    for _ in range(LEVELS):
        finer = spacing / FINER
        near = centre + finer * np.arange(-STENCIL, STENCIL + 1)
        near = near - min(0.0, float(near[0]))
        found = np.array([value(float(each)) for each in near])
        size = np.abs(_fourth(found))
        place = int(np.argmax(size))
        if not size[place] > noise:
            break
        exponents.append(float(np.log(largest / size[place]) / np.log(FINER)))
        levels.append((found, finer))
        spacing, centre, largest = finer, float(near[place + 2]), float(size[place])
    if not exponents:
        return None
    exponent = float(np.median(exponents))
    derivative = round(exponent)
    if derivative > 2 or abs(exponent - derivative) > 0.3:
        return None
    if derivative == 0:  # fourth differences around a jump of one are 1, -3, 3, -1
        return Jump(0, largest / 3, centre)
    level = min(1, len(levels) - 1) if derivative == 2 else -1  # rounding limits the spacing for a curvature
    found, spacing = levels[level]
    place = int(np.argmax(np.abs(_fourth(found))))
    near = np.diff(found[max(place - 2, 0) : place + 7], derivative) / spacing**derivative
    return Jump(derivative, abs(float(near[-1] - near[0])), centre)


def _fourth(values: Floats) -> Floats:
    """Fourth differences."""
    return np.diff(values, 4)

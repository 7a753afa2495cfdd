"""A step to search for events, and the event that acts in it."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from kickdrift.model.events import Collision, Escape
from kickdrift.model.patch import HERE, Image
from kickdrift.model.state import Floats

if TYPE_CHECKING:
    pass


@dataclass
class Span:
    """A step, or its part up to an event: y at both ends, and ``at(time)`` in between."""

    y0: Floats
    t0: float
    y1: Floats
    t1: float
    step: int
    at: Callable[[float], Floats]

    @property
    def length(self) -> float:
        return self.t1 - self.t0

    def inside(self, time: float) -> Floats:
        """y at a time of the span, both ends included."""
        return self.y0 if time <= self.t0 else self.y1 if time >= self.t1 else self.at(time)

    def zero(self, g: Callable[[float], float], a: float, b: float, tolerance: float) -> float:
        """Zero of g, which has different signs at a and b. ``tolerance`` is a part of the span."""
        from scipy.optimize import brentq

        least = max(tolerance * self.length, 4 * float(np.spacing(max(abs(a), abs(b)))))
        return float(brentq(g, a, b, xtol=least, rtol=4 * np.finfo(float).eps))


class Act(NamedTuple):
    """An event that is about to change bodies."""

    event: Collision | Escape
    time: float
    bodies: tuple[int, ...]  # rows
    distance: float
    image: Image = HERE  # of the second body, in a patch


def separation(y: Floats, i: int, j: int) -> float:
    """Distance between two bodies."""
    return float(np.linalg.norm(y[0, :, i] - y[0, :, j]))


def approach(y: Floats, i: int, j: int) -> float:
    """r . v of one body relative to another."""
    return float((y[0, :, i] - y[0, :, j]) @ (y[1, :, i] - y[1, :, j]))

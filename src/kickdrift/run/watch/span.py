"""A step to search for events, and the event that acts in it."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from itertools import pairwise
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from kickdrift.forces.laws.central import gravitational_constant
from kickdrift.model.events.events import CloseApproach, Collision, Escape, binding
from kickdrift.model.patch import HERE, Image
from kickdrift.model.state import Floats
from kickdrift.run.watch.zeros import zero

if TYPE_CHECKING:
    from kickdrift.model.system import System


@dataclass
class Span:
    """A step, or its part up to an event: y at both ends, and ``at(time)`` in between."""

    y0: Floats
    t0: float
    y1: Floats
    t1: float
    step: int
    at: Callable[[float], Floats]
    costly: bool = False  # whether ``at`` costs many evaluations of the forces
    failed: bool = False  # whether the step has no end

    @property
    def length(self) -> float:
        return self.t1 - self.t0

    def inside(self, time: float) -> Floats:
        """y at a time of the span, both ends included."""
        return self.y0 if time <= self.t0 else self.y1 if time >= self.t1 else self.at(time)

    def zero(self, g: Callable[[float], float], a: float, b: float, tolerance: float) -> float:
        """Zero of g, which has different signs at a and b. ``tolerance`` is a part of the span."""
        return zero(g, a, b, max(tolerance * self.length, 4 * float(np.spacing(max(abs(a), abs(b))))))


class Part(NamedTuple):
    """A part of a step: y at both ends, and their times."""

    y0: Floats
    t0: float
    y1: Floats
    t1: float


def parts(y0: Floats, t0: float, y1: Floats, t1: float, inner: object) -> list[Part]:
    """Parts of a stepper's last step, from (t0, y0) to (t1, y1): between the states that it knows inside the step, if
    there are any (see ``TraceStepper.inside``), else the step as one part."""
    if not hasattr(type(inner), "inside"):
        return [Part(y0, t0, y1, t1)]
    ends = [(t0, y0), *inner.inside(y0), (t1, y1)]  # type: ignore[attr-defined]
    return [Part(a, begin, b, end) for (begin, a), (end, b) in pairwise(ends)]


class Act(NamedTuple):
    """An event that is about to change bodies, or to end the run."""

    event: Collision | Escape | CloseApproach
    time: float
    bodies: tuple[int, ...]  # rows
    distance: float
    image: Image = HERE  # of the second body, in a patch


def attraction(system: System) -> tuple[Floats, float]:
    """G times the masses (n,), and the squared softening; zeros without gravity."""
    law = binding(system)
    gravity = 0.0 if law is None else gravitational_constant(law.name, law.G, system)
    return gravity * system.state.masses, 0.0 if law is None else float(law.softening) ** 2


def separation(y: Floats, i: int, j: int) -> float:
    """Distance between two bodies."""
    return float(np.linalg.norm(y[0, :, i] - y[0, :, j]))


def approach(y: Floats, i: int, j: int) -> float:
    """r . v of one body relative to another."""
    return float((y[0, :, i] - y[0, :, j]) @ (y[1, :, i] - y[1, :, j]))

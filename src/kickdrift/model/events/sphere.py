"""A body in a collision, as a user's rule gets and returns it."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from kickdrift.model.checks.values import is_number
from kickdrift.model.state import Floats
from kickdrift.text import shown


class Sphere(NamedTuple):
    """A body before or after a collision, in the system's units.

    Attributes
    ----------
    mass : float
    position, velocity : (3,)
    radius : float
    name : str
        The body's name, or "particle 5" in a system without names. A rule that returns a body under the name of one of
        the two keeps that body and its id. A body without a name is new, and gets a name from the heavier body.
    """

    mass: float
    position: Floats
    velocity: Floats
    radius: float
    name: str = ""

    @property
    def momentum(self) -> Floats:
        """Mass times velocity, (3,)."""
        return self.mass * np.asarray(self.velocity)

    def problem(self) -> str:
        """The fault in the values, as text; "" if nothing is."""
        for key, value in (("mass", self.mass), ("radius", self.radius)):
            if not (is_number(value) and 0 <= value < np.inf):
                return f"{key} {shown(value)}; expected a number, zero or more"
        for key, vector in (("position", self.position), ("velocity", self.velocity)):
            if not _is_vector(vector):
                return f"{key} {shown(vector)}; expected three finite numbers"
        return "" if isinstance(self.name, str) else f"name {shown(self.name)}; expected text"


def _is_vector(value: Any) -> bool:
    try:
        found = np.asarray(value, float)
    except (TypeError, ValueError):
        return False
    return found.shape == (3,) and bool(np.isfinite(found).all())

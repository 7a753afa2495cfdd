"""Laws of bonds and angles as a user would write them, with the formulas of laws that ship."""

import math
from typing import NamedTuple

import kickdrift as kd


@kd.bond_law
class OwnFene(NamedTuple):
    """The formula of `Fene` without a core."""

    k: float = 30.0
    longest: float = 1.5

    def law(p, r):
        rest = 1.0 - (r / p.longest) ** 2
        rest = rest if rest > 0.0 else math.nan
        return -0.5 * p.k * p.longest**2 * math.log(rest), p.k * r / rest


@kd.angle_law
class OwnCosine(NamedTuple):
    """The formula of `CosineAngle`."""

    k: float

    def law(p, angle):
        return p.k * (1.0 + math.cos(angle)), -p.k * math.sin(angle)

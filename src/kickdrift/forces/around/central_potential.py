"""Attraction or repulsion by a central body as a power of the distance."""

from __future__ import annotations

import math
from typing import NamedTuple

from kickdrift.forces.laws.around import around
from kickdrift.forces.laws.body_law import body_law
from kickdrift.forces.laws.central import Central, central_body, check_central, check_positive
from kickdrift.model.state import Floats


class Power(NamedTuple):
    """The power law of a System's central body."""

    central: int
    acceleration: float
    scale: float
    power: float
    share: Floats


@body_law
class CentralPotential(NamedTuple):
    """A force along the line to the central body, as a power of the distance r: a = acceleration (r / scale)^power.

    It stands for masses that are not bodies of the system: a halo, a disc, a cloud. U = -m acceleration scale
    (r / scale)^(power + 1) / (power + 1), and -m acceleration scale log(r / scale) for power = -1. A nearly circular
    orbit under this force alone turns by 2 pi / sqrt(3 + power) from pericentre to pericentre (Binney & Tremaine 2008,
    Galactic Dynamics, section 3.1). The central body takes the opposite force.

    Attributes
    ----------
    acceleration : float
        Outward acceleration at the distance ``scale``; negative for attraction.
    power : float
    scale : float
        A length; default 1.
    central : str or int, optional
        The central body's name or number; default the most massive body.
    """

    acceleration: float
    power: float
    scale: float = 1.0
    central: Central = None

    name = "central-potential"  # type: ignore[misc]
    dimensions = {"acceleration": "acceleration", "scale": "length"}  # type: ignore[misc]  # noqa: RUF012
    law = staticmethod(around)  # type: ignore[misc]

    @staticmethod
    def pull(p, i, d, u, t):
        r = math.sqrt(d @ d)
        ratio, above = r / p.scale, p.power + 1.0
        strength = p.acceleration * ratio**p.power
        if above == 0.0:
            energy = -p.acceleration * p.scale * math.log(ratio)
        else:
            energy = -strength * r / above
        return energy, (strength / r) * d

    def check(p):
        check_positive("central-potential", scale=p.scale)
        check_central("central-potential", p.central)

    def bound(p, system):
        """The power law of this System's central body."""
        central = central_body("central-potential", p.central, system)
        masses = system.state.masses
        return Power(central, p.acceleration, p.scale, p.power, masses / masses[central])

"""Gravity of a flattened body: the zonal harmonics J2 and J4 of its field."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, ClassVar

import numpy as np

from kickdrift.errors import InputError
from kickdrift.forces.arguments import Vector, number, vector
from kickdrift.forces.central import (
    Attraction,
    Central,
    central_body,
    check_central,
    check_open,
    check_positive,
    gravitational_constant,
)
from kickdrift.forces.group import Grouped
from kickdrift.model.arguments import checked_arguments

if TYPE_CHECKING:
    from kickdrift.model.subject import Subject


@checked_arguments
@dataclass(frozen=True)
class Oblateness(Grouped):
    """The zonal harmonics J2 and J4 of a flattened central body's field, on top of ``gravity``.

    U = (G M m / r) [J2 (R / r)^2 P2(s) + J4 (R / r)^4 P4(s)], P2 and P4 Legendre's polynomials, s = r . pole / r, the
    sine of the latitude (Murray & Dermott 1999, Solar System Dynamics, section 6.11).

    The pole is fixed. The central body takes the opposite force, so momentum is conserved, but it does not take the
    torque. Only the angular momentum along the pole is conserved.

    Attributes
    ----------
    j2 : float
        Positive for a flattened body: 1.0826e-3 for the Earth.
    radius : float
        R, the equatorial radius that j2 and j4 are given for; a length.
    j4 : float
        Default 0.
    central : str or int, optional
        The flattened body's name or number; default the most massive body.
    pole : (x, y, z)
        Direction of the axis of symmetry, of any length; default z.
    G : float, optional
        Default the unit system's own.
    """

    j2: float
    radius: float
    j4: float = 0.0
    central: Central = None
    pole: Vector = (0.0, 0.0, 1.0)
    G: float | None = None

    name: ClassVar[str] = "j2"
    by_mass: ClassVar[bool] = True
    dimensions: ClassVar[dict[str, str]] = {"radius": "length", "G": "gravitational constant"}

    def __post_init__(self) -> None:
        for key in ("j2", "j4", "radius"):
            object.__setattr__(self, key, number(self.name, key, getattr(self, key)))
        check_positive(self.name, radius=self.radius, G=self.G)
        check_central(self.name, self.central)
        pole = vector(self.name, "pole", self.pole)
        if not any(pole):
            raise InputError(f"{self.name}: pole: expected a vector with a direction, got {list(pole)}")
        object.__setattr__(self, "pole", pole)

    @property
    def axis(self) -> Vector:
        """The pole as a unit vector."""
        largest = max(map(abs, self.pole))
        x, y, z = (p / largest for p in self.pole)
        length = math.sqrt(x * x + y * y + z * z)
        return x / length, y / length, z / length

    def check(self, system: Subject) -> None:
        """Raise InputError for a system that this force cannot run."""
        check_open(self.name, system)
        if system.dimensions == 2 and self.pole[2] and any(self.pole[:2]):
            raise InputError(
                f"{self.name}: pole: expected a vector along z or in the plane of this two-dimensional system, "
                f"got {list(self.pole)}"
            )
        central_body(self.name, self.central, system)
        gravitational_constant(self.name, self.G, system)

    def bind(self, system: Subject, threads: int = 1) -> Any:
        """Bind this force to a System: a NamedTuple with a compiled body."""
        from kickdrift.forces.oblateness_kernel import OblatenessKernel

        central, gm, share, masses = Attraction.of(self, system)
        j2, j4 = self.j2 * self.radius**2, self.j4 * self.radius**4
        return OblatenessKernel(central, gm, j2, j4, np.array(self.axis), share, masses)

"""Fields that act on single particles (trap, uniform and driven field, drag), and springs between given pairs.

A spring is a harmonic bond. Springs list their own pairs, each with its parameters; bonds belong to the topology.

This module does not import numba, so reading and checking a system file stays fast; ``bind`` compiles.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, ClassVar, NamedTuple

import numpy as np

from kickdrift.errors import InputError
from kickdrift.forces.bonded.own_pairs import NOT_NEGATIVE, POSITIVE, OwnPairs
from kickdrift.forces.bonded.shipped import HarmonicBond
from kickdrift.forces.laws.field_law import field_law
from kickdrift.forces.seam.arguments import (
    Vector,
    check_alike,
    check_in_plane,
    check_place_in_plane,
)
from kickdrift.forces.seam.group import Grouped
from kickdrift.model.checks.arguments import checked_arguments
from kickdrift.text import shown

if TYPE_CHECKING:
    from kickdrift.model.subject import Subject


class Field(Grouped):
    """Base class of the forces of this module.

    Attributes
    ----------
    may_overlap : bool
        Whether this force allows particles to begin at the same place.
    external : bool
        Whether this force changes the total momentum.
    """

    may_overlap: ClassVar[bool] = True
    external: ClassVar[bool] = True
    name: ClassVar[str]

    def check(self, system: Subject) -> None:
        """Refuse a system that this force does not support."""

    def bind(self, system: Subject, threads: int = 1) -> Any:
        """Parts of this force for a System: a NamedTuple with a compiled body."""
        raise NotImplementedError


@field_law
class HarmonicTrap(NamedTuple):
    """Harmonic trap, U = k |x - c|^2 / 2 for each particle.

    Attributes
    ----------
    stiffness : float, or three of them
        Energy per length squared, zero or more; three numbers apply along x, y and z.
    centre : (x, y, z)
        Default the origin. In a periodic box each particle is pulled to the nearest image of the centre. The force
        turns round at half the box, where the energy has a kink and does not jump. A leaning box takes one stiffness
        alone, because three would let the energy jump there.
    """

    stiffness: float | Vector
    centre: Vector = (0.0, 0.0, 0.0)

    dimensions = {"stiffness": "stiffness", "centre": "length"}  # type: ignore[misc]  # noqa: RUF012
    varies = ()  # type: ignore[misc]
    nearest = "centre"  # type: ignore[misc]

    def law(p, x, v, m, t):
        d = x - p.centre
        return 0.5 * ((p.stiffness * d) @ d), -(p.stiffness * d)

    def check(p):
        if np.min(p.stiffness) < 0:
            raise InputError(f"stiffness must be zero or more, got {shown(p.stiffness)}")

    def check_system(p, system):
        """Refuse three stiffnesses in a leaning box, and a centre out of the plane of a two-dimensional system."""
        check_alike("stiffness", p.stiffness, system)
        if np.broadcast_to(p.stiffness, 3)[2]:
            check_place_in_plane("harmonic-trap", "centre", p.centre, system)


@field_law
class UniformField(NamedTuple):
    """The same acceleration g for every particle, including massless ones: U = -m g . x.

    In a periodic box x is the unwrapped position, which conserves the energy of particles that fall through the box.
    This energy has no meaning beyond one run, and the total momentum grows without limit.

    Attributes
    ----------
    acceleration : (x, y, z)
    """

    acceleration: Vector

    dimensions = {"acceleration": "acceleration"}  # type: ignore[misc]  # noqa: RUF012
    varies = ()  # type: ignore[misc]
    per_mass = alike = True  # type: ignore[misc]

    def law(p, x, v, m, t):
        return -(p.acceleration @ x), p.acceleration

    def check_system(p, system):
        """Refuse a field out of the plane of a two-dimensional system."""
        check_in_plane("uniform-field", "acceleration", p.acceleration, system)


@field_law
class DrivenField(NamedTuple):
    """The acceleration a cos(2 pi f t + phase) for every particle, with t the time of the run.

    The instantaneous potential energy is U = -m a . x cos(2 pi f t + phase), with x unwrapped. The field does work, so
    the total energy is not conserved.

    Attributes
    ----------
    amplitude : (x, y, z)
        An acceleration.
    frequency : float
        Cycles per unit of time, zero or more; the period is 1 / frequency.
    phase : float
        In radians.
    """

    amplitude: Vector
    frequency: float
    phase: float = 0.0

    odd_in_time = ("phase",)  # type: ignore[misc]
    dimensions = {"amplitude": "acceleration", "frequency": "frequency"}  # type: ignore[misc]  # noqa: RUF012
    varies = ()  # type: ignore[misc]
    per_mass = alike = time_dependent = True  # type: ignore[misc]

    @property
    def works(p):
        """Whether the field does work, so that energy is not conserved."""
        return any(p.amplitude)

    def clock(p, t):
        return math.cos(2.0 * math.pi * p.frequency * t + p.phase)

    def law(p, x, v, m, wave):
        a = p.amplitude * wave
        return -(a @ x), a

    def check(p):
        if p.frequency < 0:
            raise InputError(f"frequency must be zero or more, got {p.frequency}")

    def check_system(p, system):
        """Refuse a field out of the plane of a two-dimensional system."""
        check_in_plane("driven-field", "amplitude", p.amplitude, system)


@field_law
class Hill(NamedTuple):
    """Coriolis and tidal forces in Hill's frame, which circles a far central body with the angular frequency omega.

    x points away from the central body, y along the orbit, and z along the axis. The accelerations are
    (2 omega v_y + 3 omega^2 x, -2 omega v_x, -(vertical omega)^2 z), for any mass. The tidal potential is
    m (-3/2 omega^2 x^2 + (vertical omega)^2 z^2 / 2), and Coriolis forces do no work. Source: Hill 1878,
    doi:10.2307/2369430. The integrator ``sei`` solves this motion exactly.

    Attributes
    ----------
    omega : float
        Angular frequency of the frame, in radians per unit of time; not zero.
    vertical : float
        Frequency of the oscillation along z, over omega; positive, default 1.
    """

    omega: float
    vertical: float = 1.0

    odd_in_time = ("omega",)  # type: ignore[misc]
    dimensions = {"omega": "rate"}  # type: ignore[misc]  # noqa: RUF012
    varies = ()  # type: ignore[misc]
    per_mass = velocity_dependent = True  # type: ignore[misc]

    def law(p, x, v, m, t):
        tide, upright = p.omega**2, (p.vertical * p.omega) ** 2
        energy = 0.5 * upright * x[2] ** 2 - 1.5 * tide * x[0] ** 2
        turn = 2.0 * p.omega
        return energy, (turn * v[1] + 3.0 * tide * x[0], -turn * v[0], -upright * x[2])

    def check(p):
        if p.omega == 0:
            raise InputError("omega must not be zero")
        if p.vertical <= 0:
            raise InputError(f"vertical must be positive, got {shown(p.vertical)}")

    def check_system(p, system):
        """Refuse a box that is periodic across the shear."""
        if system.box.periodic_axes[0] or system.box.periodic_axes[2]:
            raise InputError("Hill's frame is periodic along y at most, but the box is periodic along x or z")


@field_law
class LinearDrag(NamedTuple):
    """The acceleration -rate v for any mass (Stokes' drag with rate = friction / mass).

    Drag has no potential energy, and the total energy falls. Methods for forces of positions alone refuse drag.

    Attributes
    ----------
    rate : float
        Inverse time, zero or more; a free particle slows down as exp(-rate t).
    """

    rate: float

    odd_in_time = ("rate",)  # type: ignore[misc]
    dimensions = {"rate": "rate"}  # type: ignore[misc]  # noqa: RUF012
    varies = ()  # type: ignore[misc]
    per_mass = True  # type: ignore[misc]

    @property
    def velocity_dependent(p):
        """Whether the rate is not zero; splitting methods refuse a force that depends on velocity."""
        return p.rate != 0.0

    @property
    def works(p):
        """Whether the rate is not zero, so that energy is not conserved."""
        return p.rate != 0.0

    def law(p, x, v, m, t):
        return None, -p.rate * v

    def check(p):
        if p.rate < 0:
            raise InputError(f"rate must be zero or more, got {p.rate}")


@checked_arguments
@dataclass(frozen=True)
class Springs(OwnPairs):
    """Springs: U = k (r - l)^2 / 2 for each given pair of particles, with r the distance between nearest images.

    Attributes
    ----------
    pairs : ((i, j), …)
        Ids of particles, counted from 0. No pair may occur twice, in either order.
    stiffness : float, or one for each pair
        Energy per length squared, positive.
    length : float, or one for each pair
        Length at rest, zero (default) or more. In a periodic box it must be under half the shortest edge, since a
        longer spring would switch between images. If both ends meet, the force of a spring with a length has no
        direction, so it is zero there. A system that begins with such ends is refused.
    """

    pairs: Sequence[tuple[int, int]]
    stiffness: float | Sequence[float]
    length: float | Sequence[float] = 0.0

    name: ClassVar[str] = "springs"
    Parameters: ClassVar[Any] = HarmonicBond.Parameters  # type: ignore[attr-defined]
    takes: ClassVar[Mapping[str, str]] = {"stiffness": POSITIVE, "length": NOT_NEGATIVE}
    limited: ClassVar[bool] = False  # a spring may stretch over more than half the box
    dimensions: ClassVar[dict[str, str]] = {"stiffness": "stiffness", "length": "length"}

    def check(self, system: Subject) -> None:
        """Refuse pairs of particles that do not exist, have no mass or begin at the same place."""
        super().check(system)
        lengths = np.broadcast_to(np.array(self.length), len(self.pairs))
        named, height = system.box.narrowest
        if lengths.max() >= 0.5 * height:
            raise InputError(
                f"{self.name}: length {lengths.max():.6g} must be under half the {named}, {0.5 * height:.6g}"
            )
        for k in np.flatnonzero((lengths > 0) & ~self.separations(system).any(axis=1)):
            i, j = self.pairs[int(k)]
            raise InputError(
                f"{self.name}: particles {i} and {j} are at the same place, where their spring "
                f"of length {lengths[k]:.6g} has no direction"
            )

    def half_height(self, system: Subject) -> float:
        """See Grouped: the largest length at rest."""
        return float(np.max(self.length))

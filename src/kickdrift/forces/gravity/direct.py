"""Newtonian gravity by direct summation."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, ClassVar

from kickdrift.errors import InputError
from kickdrift.forces.laws.central import check_masses, gravitational_constant
from kickdrift.forces.seam.group import Grouped
from kickdrift.model.checks.arguments import checked_arguments
from kickdrift.model.checks.values import number, positive
from kickdrift.text import shown

if TYPE_CHECKING:
    from kickdrift.model.subject import Subject


@checked_arguments
@dataclass(frozen=True)
class Gravity(Grouped):
    """Newtonian gravity, every pair summed: U = -G sum m_i m_j / sqrt(r^2 + softening^2).

    The softening is Plummer's (1911, doi:10.1093/mnras/71.5.460).

    Massless particles (test particles) feel the massive bodies and attract nothing. An evaluation costs m^2 / 2 + m k
    for m bodies and k test particles. Each pair counts once, and its two forces are opposite to round-off.

    Attributes
    ----------
    G : float, optional
        In the system's units; default the unit system's own.
    softening : float
        A length; default 0. With one, bodies may be at the same place.
    """

    G: float | None = None
    softening: float = 0.0

    name: ClassVar[str] = "gravity"
    stands_for: ClassVar[str] = "gravity of all pairs"
    by_mass: ClassVar[bool] = True
    dimensions: ClassVar[dict[str, str]] = {"G": "gravitational constant", "softening": "length"}

    def __post_init__(self) -> None:
        if self.G is not None:
            positive("gravity: G", self.G)
        if not (math.isfinite(number(self.softening)) and self.softening >= 0):
            raise InputError(f"gravity: softening must be a length, zero or more, got {shown(self.softening)}")

    @property
    def may_overlap(self) -> bool:
        """Tell whether this force allows particles at the same place at the start."""
        return self.softening > 0

    def check(self, system: Subject) -> None:
        """Raise InputError for a system that this force cannot run."""
        if system.box.periodic:
            raise InputError("gravity: direct summation needs open space, and the box is periodic")
        gravitational_constant(self.name, self.G, system)
        check_masses(self.name, system)

    def bind(self, system: Subject, threads: int = 1) -> Any:
        """Bind this force to a System: a NamedTuple with a compiled body."""
        from kickdrift.forces.gravity.kernel import bind

        gm = gravitational_constant(self.name, self.G, system) * system.state.masses
        return bind(gm, system.coherent_masses, self.softening, threads)

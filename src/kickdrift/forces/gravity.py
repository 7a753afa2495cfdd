"""Newtonian gravity by direct summation."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, ClassVar

from kickdrift.errors import InputError

if TYPE_CHECKING:
    from kickdrift.system import System


@dataclass(frozen=True)
class Gravity:
    """U = -G sum m_i m_j / sqrt(r^2 + softening^2) over pairs (Plummer 1911, doi:10.1093/mnras/71.5.460, for the
    softening).

    Attributes
    ----------
    G : float, optional
        In the system's units; default the unit system's own.
    softening : float
        A length; default 0. Massless particles feel the others and do not pull.
    """

    G: float | None = None
    softening: float = 0.0

    name: ClassVar[str] = "gravity"
    dimensions: ClassVar[dict[str, str]] = {"G": "gravitational constant", "softening": "length"}

    def __post_init__(self) -> None:
        if self.G is not None and not (math.isfinite(self.G) and self.G > 0):
            raise InputError(f"gravity: G must be a positive number, got {self.G}")
        if not (math.isfinite(self.softening) and self.softening >= 0):
            raise InputError(f"gravity: softening must be a length, zero or more, got {self.softening}")

    def check(self, system: System) -> None:
        """Refuse a system that this force cannot run on."""
        if system.box.periodic:
            raise InputError("gravity: direct summation needs open space, and the box is periodic")
        if self.G is None and system.units.gravity is None:
            raise InputError(f"gravity: units {system.units.name!r} have no G of their own; give G")

    def bind(self, system: System, threads: int = 1) -> Any:
        """The compiled form of this force for a System: a NamedTuple that ``accelerate`` knows."""
        from kickdrift.forces.gravity_kernel import bind

        return bind(self, system, threads)

"""Factors between ASE's units (angstrom, eV, u) and those of a System."""

from __future__ import annotations

import math
from typing import NamedTuple

from kickdrift.model.units.file_units import FileUnits
from kickdrift.model.units.quantities import quantity
from kickdrift.model.units.unit_systems import UnitSystem


class Scale(NamedTuple):
    """Factors from ASE's units to a unit system."""

    length: float
    energy: float
    mass: float
    velocity: float

    @property
    def force(self) -> float:
        return self.energy / self.length

    @classmethod
    def of(cls, units: UnitSystem) -> Scale:
        """Return the factors; all are 1 for units unknown to ASE."""
        if FileUnits.of(units).nominal:
            return cls(1.0, 1.0, 1.0, 1.0)
        given = {"length": "angstrom", "energy": "eV", "mass": "u"}
        length, energy, mass = (
            1.0 if getattr(units, key) == unit else quantity(f"1 {unit}", key, units) for key, unit in given.items()
        )
        return cls(length, energy, mass, math.sqrt(energy / (mass * units.coherent_mass)))

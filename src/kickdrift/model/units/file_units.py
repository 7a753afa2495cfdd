"""Units in files for other programs: angstrom and ps if the system's units can be converted; and factors to ASE's."""

from __future__ import annotations

import math
from typing import NamedTuple

from kickdrift.model.units import constants
from kickdrift.model.units.quantities import quantity
from kickdrift.model.units.unit_systems import UnitSystem

# Units of length and time that have a value in MDAnalysis' angstrom and ps.
_ANGSTROM = {"angstrom": 1.0, "nm": 10.0, "m": 1e10}
_PICOSECOND = {"ps": 1.0, "fs": 1e-3, "s": 1e12}
# Forces by units of energy and length, as MDAnalysis spells them.
_KJ_PER_MOL = "kJ mol-1 Angstrom-1"
_FORCE = {
    ("eV", "angstrom"): (constants.ELEMENTARY_CHARGE * constants.AVOGADRO / 1000, _KJ_PER_MOL),
    ("kcal/mol", "angstrom"): (4.184, _KJ_PER_MOL),
    ("kJ/mol", "nm"): (0.1, _KJ_PER_MOL),
    ("J", "m"): (1.0, "Newton"),
}


def elementary_charge(units: UnitSystem) -> float:
    """The elementary charge in these units; 1 in units whose charge has no value in coulombs."""
    return constants.ELEMENTARY_CHARGE if units.charge == "C" else 1.0


class FileUnits(NamedTuple):
    """Factors from the system's units to stored positions, times and forces; exactly 1 for the length except in
    ``gromacs`` and ``si``, and for the time except in ``real`` and ``si``.

    ``nominal`` means that a length unit is written as one angstrom and a time unit as one ps, because there is no
    conversion, as in reduced units.
    """

    length: float
    time: float
    nominal: bool
    force: float = 1.0
    force_unit: str = _KJ_PER_MOL

    @property
    def velocity(self) -> float:
        return self.length / self.time

    @classmethod
    def of(cls, units: UnitSystem) -> FileUnits:
        length, time = _ANGSTROM.get(units.length.lower()), _PICOSECOND.get(units.time.lower())
        if length is None or time is None:
            return cls(1.0, 1.0, True)
        return cls(length, time, False, *_FORCE.get((units.energy, units.length), ()))


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

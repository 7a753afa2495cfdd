"""The units that files for other programs are written in: MD's angstrom and ps where there is such a unit."""

from __future__ import annotations

from typing import NamedTuple

from kickdrift.model import constants
from kickdrift.model.unit_systems import UnitSystem

# Units that are lengths and times to MDAnalysis, in its own angstrom and ps.
_ANGSTROM = {"angstrom": 1.0, "nm": 10.0, "m": 1e10}
_PICOSECOND = {"ps": 1.0, "fs": 1e-3, "s": 1e12}
# Forces by units of energy and length, as MDAnalysis spells them.
_KJ_PER_MOL = "kJ mol-1 Angstrom-1"
_FORCE = {
    ("eV", "angstrom"): (constants.ELEMENTARY_CHARGE * constants.AVOGADRO / 1000, _KJ_PER_MOL),
    ("J", "m"): (1.0, "Newton"),
}


class FileUnits(NamedTuple):
    """What stored positions, times and forces were multiplied by; for length and time exactly 1 but for ``si``.

    ``nominal`` is true where a length unit is written as one angstrom and a time unit as one ps for want of anything
    better, as in reduced units.
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

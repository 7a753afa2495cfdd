"""Bonds, angles and dihedrals with tables of energies."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, ClassVar

import numpy as np

from kickdrift.errors import InputError
from kickdrift.forces.bonded.law import JUMP, TURN, BondedForce
from kickdrift.forces.seam.named import register_force
from kickdrift.forces.tables.curve import Curve, closed, curve_through
from kickdrift.forces.tables.given import Tables
from kickdrift.forces.tables.lines import ListedTable, listed_table
from kickdrift.forces.tables.reading import Columns, checked
from kickdrift.model.checks.arguments import checked_arguments

if TYPE_CHECKING:
    from kickdrift.model.subject import Subject

NEAR = 1e-6  # degrees, between the ends of a table and those of all angles


class ListedTables(Tables, BondedForce):
    """Common parts of bonds, angles and dihedrals with tables."""

    Parameters: ClassVar[Any] = ListedTable

    def __post_init__(self) -> None:
        self.keep_files("types")
        super().__post_init__()
        if "length_unit" not in self.units_of:
            for given in (self.given_with({}), *(self.types or {}).values()):
                if given.get("length_unit") is not None:
                    raise InputError(f"{self.name}: length_unit goes with tables of lengths")

    def __str__(self) -> str:
        return repr(self)

    def _checked(self, key: str, value: Any, where: str) -> Any:
        return value  # `keep_files` has checked the values

    def _check_given(self, where: str, law: Any) -> None:
        """The law is the slope of its energy."""

    def law_of_columns(self, where: str, columns: Columns, given: Mapping[str, Any]) -> Any:
        """See Tables."""
        length, energy = (given.get(key) or 1.0 for key in ("length_unit", "energy_unit"))
        x, force = columns.x, columns.force
        checked(where, x, columns.energy, force, "r" if self.kind == "bonds" else "the angle", length)
        if self.kind != "bonds":
            length = 1.0 if columns.radians else TURN
            x = x / TURN if columns.radians else x  # in degrees, for messages
        force = None if force is None else force * (energy / length)
        return listed_table(self._curve(where, x, columns.energy * energy, force, length))

    def _curve(self, where: str, x: Any, energy: Any, force: Any, length: float) -> Curve:
        raise NotImplementedError

    def check(self, system: Subject) -> None:
        """Refuse a system without such a list, and places where the table has no value."""
        for values in (self.types or {"": {}}).values():
            self.check_units(system, self.given_with(values))
        super().check(system)


@checked_arguments
@dataclass(frozen=True, repr=False)
class TabulatedBond(ListedTables):
    """Bonds whose energy U(r) is a table, with or without the force -U'(r). See `Tabulated` for the curve through the
    points. A bond that leaves the table has no energy: the run stops and names the bond."""

    kind: ClassVar[str] = "bonds"
    name: ClassVar[str] = "tabulated-bond"

    def _curve(self, where: str, x: Any, energy: Any, force: Any, length: float) -> Curve:
        if x[0] < 0:
            raise InputError(f"{where}: begins at r = {x[0]:g}; lengths are zero or more")
        return curve_through(x * length, energy, force)


@checked_arguments
@dataclass(frozen=True, repr=False)
class TabulatedAngle(ListedTables):
    """Angles whose energy is a table from 0 to 180 degrees, with or without the force, minus the slope for each degree
    (each radian in LAMMPS' files that say RADIANS)."""

    kind: ClassVar[str] = "angles"
    name: ClassVar[str] = "tabulated-angle"
    units_of: ClassVar[tuple[str, ...]] = ("energy_unit",)

    def _curve(self, where: str, x: Any, energy: Any, force: Any, length: float) -> Curve:
        if abs(x[0]) > NEAR or abs(x[-1] - 180.0) > NEAR:
            raise InputError(f"{where}: goes from {x[0]:g} to {x[-1]:g} degrees; expected a table from 0 to 180")
        return curve_through(x * TURN, energy, force)


@checked_arguments
@dataclass(frozen=True, repr=False)
class TabulatedDihedral(ListedTables):
    """Dihedrals whose energy is a table of one turn, such as -180 to 180 degrees, with or without the force, minus the
    slope for each degree. The curve is periodic. Both ends may stand in the table, with one energy."""

    kind: ClassVar[str] = "dihedrals"
    name: ClassVar[str] = "tabulated-dihedral"
    units_of: ClassVar[tuple[str, ...]] = ("energy_unit",)

    def _curve(self, where: str, x: Any, energy: Any, force: Any, length: float) -> Curve:
        span = x[-1] - x[0]
        if span > 360.0 + NEAR or span + 2.0 * float(np.diff(x).max()) < 360.0:
            raise InputError(f"{where}: goes from {x[0]:g} to {x[-1]:g} degrees; expected a table of one turn")
        if span > 360.0 - NEAR:
            if abs(energy[-1] - energy[0]) > 1e3 * JUMP * float(np.abs(energy).max()):
                raise InputError(
                    f"{where}: the energies at {x[0]:g} and {x[-1]:g} degrees, one place, are {energy[0]:.6g} and "
                    f"{energy[-1]:.6g}"
                )
            x, energy, force = x[:-1], energy[:-1], None if force is None else force[:-1]
        turn = closed(x * TURN, energy, force, 2.0 * math.pi)
        cells = max(len(x), round(2.0 * math.pi / float(np.diff(turn.x).min())))
        nodes = np.linspace(-math.pi, math.pi, cells + 1)
        return Curve(nodes, *turn.at(turn.x[0] + np.mod(nodes - turn.x[0], 2.0 * math.pi)))


for _each in (TabulatedBond, TabulatedAngle, TabulatedDihedral):
    register_force(_each, overwrite=True)

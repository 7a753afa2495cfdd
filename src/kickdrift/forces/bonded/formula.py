"""Bonds, angles, dihedrals and impropers from formulas that are text."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, ClassVar

from kickdrift.forces.bonded.law import BondedForce, check_closed
from kickdrift.forces.formulas.given import Formulas
from kickdrift.forces.seam.named import register_force
from kickdrift.model.checks.arguments import checked_arguments


class ListedFormulas(Formulas, BondedForce):
    """Common parts of the four kinds."""

    variable: ClassVar[str] = "theta"

    def __post_init__(self) -> None:
        self.keep("types")
        if self.types is None:
            self.law_with("", {})  # names a parameter without a value
        super().__post_init__()

    @property
    def stands_for(self) -> str:  # type: ignore[override]
        """What the force models: nothing that another could model again, since formulas may be parts of a sum."""
        return ""

    def _checked(self, key: str, value: Any, where: str) -> Any:
        return value  # `keep` has checked the values

    def _check_given(self, where: str, law: Any) -> None:
        if self.kind == "dihedrals":  # the slope follows from the energy
            check_closed(f"{self.name}{where}", law)


@checked_arguments
@dataclass(frozen=True)
class FormulaBond(ListedFormulas):
    """Bonds whose energy is a formula of their length r, in OpenMM's notation, such as ``k*(r-r0)^4``."""

    kind: ClassVar[str] = "bonds"
    name: ClassVar[str] = "formula-bond"
    variable: ClassVar[str] = "r"


@checked_arguments
@dataclass(frozen=True)
class FormulaAngle(ListedFormulas):
    """Angles whose energy is a formula of ``theta``, in radians from 0 to pi, such as ``k*(cos(theta)-c)^2``."""

    kind: ClassVar[str] = "angles"
    name: ClassVar[str] = "formula-angle"


@checked_arguments
@dataclass(frozen=True)
class FormulaDihedral(ListedFormulas):
    """Dihedrals whose energy is a formula of ``theta``, in radians from -pi to pi, where both ends are one place."""

    kind: ClassVar[str] = "dihedrals"
    name: ClassVar[str] = "formula-dihedral"


@checked_arguments
@dataclass(frozen=True)
class FormulaImproper(ListedFormulas):
    """Impropers whose energy is a formula of ``theta``, in radians from -pi to pi, as for dihedrals."""

    kind: ClassVar[str] = "impropers"
    name: ClassVar[str] = "formula-improper"


for _each in (FormulaBond, FormulaAngle, FormulaDihedral, FormulaImproper):
    register_force(_each, overwrite=True)

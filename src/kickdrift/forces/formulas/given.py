"""What users say of a formula, common to pairs, bonds, angles, dihedrals and impropers."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, ClassVar, NamedTuple

from kickdrift.errors import InputError
from kickdrift.forces.formulas.expression import Law, law_of
from kickdrift.forces.seam.arguments import number
from kickdrift.text import choices, shown, suggestion


class NoFormula(NamedTuple):
    """Numbers of the law of a class whose formula is not known yet."""


class _OfFormula:
    """Attribute ``Parameters``: the class of the numbers of a force's law, which its formula makes."""

    def __get__(self, force: Any, owner: type) -> Any:
        return NoFormula if force is None else force.own_law.Parameters


@dataclass(frozen=True)
class Formulas:
    """Parameters of every force whose law is a formula.

    Attributes
    ----------
    formula : str
        The energy, in the notation of OpenMM's custom forces: ``k*d^2; d=r-r0``. Pairs and bonds have the distance
        ``r``; angles, dihedrals and impropers have ``theta`` in radians. ``+ - * / ^`` and OpenMM's functions sqrt,
        exp, log, sin, cos, tan, sec, csc, cot, sinh, cosh, tanh, square, cube, recip, abs, step, min, max and select
        are known. The force follows by the chain rule.
    parameters : {name: number}, optional
        Values of the other names in the formula. Tables of species, pairs and types have ``parameters`` of their own.
    length_unit : float
        Length of one unit of the formula; default the System's.
    energy_unit : float
        Likewise of energy.
    """

    formula: str
    parameters: dict[str, float] | None = None
    length_unit: float = 1.0
    energy_unit: float = 1.0

    name: ClassVar[str]
    variable: ClassVar[str]  # see `law_of`
    law_keys: ClassVar[tuple[str, ...]] = ("parameters",)
    dimensions: ClassVar[dict[str, str]] = {"length_unit": "length", "energy_unit": "energy"}
    Parameters: ClassVar[Any] = _OfFormula()

    def keep(self, *keys: str) -> None:
        """Check the formula and its parameters, and keep copies. ``keys`` name the force's tables of tables."""
        if not isinstance(self.formula, str):
            raise InputError(f"{self.name}: formula: expected text, got {shown(self.formula)}")
        try:
            law_of(self.formula, self.variable)
        except InputError as error:
            raise InputError(f"{self.name}: {error}") from None
        for key in ("length_unit", "energy_unit"):
            found = number(self.name, key, getattr(self, key))
            if not found > 0:
                raise InputError(f"{self.name}: {key} must be positive, got {shown(found)}")
            object.__setattr__(self, key, found)
        object.__setattr__(self, "parameters", self._kept("parameters", self.parameters))
        for key in keys:
            inner = getattr(self, key)
            if isinstance(inner, Mapping):
                kept = {
                    each: {**values, "parameters": self._kept(f"{key}[{shown(each)}].parameters", values["parameters"])}
                    if isinstance(values, Mapping) and "parameters" in values
                    else values
                    for each, values in inner.items()
                }
                object.__setattr__(self, key, kept)

    def _kept(self, key: str, given: Any) -> dict[str, float] | None:
        if given is None:
            return None
        if not isinstance(given, Mapping):
            raise InputError(f"{self.name}: {key}: expected a table of numbers, got {shown(given)}")
        known = self.known_names
        for name in given:
            if name not in known:
                hint = suggestion(str(name), known) or (f"; it has {choices(known)}" if known else "")
                raise InputError(f"{self.name}: {key}: the formula has no {shown(name)}{hint}")
        return {name: number(self.name, f"{key}.{name}", value) for name, value in given.items()}

    @property
    def own_law(self) -> Law:
        """The law of the formula."""
        return law_of(self.formula, self.variable)

    @property
    def known_names(self) -> tuple[str, ...]:
        """Names that ``parameters`` may have."""
        return self.own_law.formula.parameters

    def values_with(self, values: Mapping[str, Any]) -> dict[str, float]:
        """The parameters with those of a table in place of the force's own."""
        return {**(self.parameters or {}), **(values.get("parameters") or {})}

    def law_with(self, where: str, values: Mapping[str, Any]) -> Any:
        """The law's numbers with these values in place of the force's own; ``where`` says whose they are."""
        return self.law_of_values(where, self.values_with(values))

    def law_of_values(self, where: str, values: Mapping[str, float]) -> Any:
        """The law's numbers for these parameters."""
        return self.own_law.of(f"{self.name}{where}", values, self.length_unit, self.energy_unit)

    @property
    def empty(self) -> bool:
        """Whether the force's own parameters leave some to its tables."""
        return not set(self.own_law.formula.parameters) <= self.values_with({}).keys()

    @property
    def law(self) -> Any:
        """The law's numbers of the force's own parameters; nan if some stand in its tables."""
        if self.empty:
            return self.Parameters(*[float("nan")] * len(self.Parameters._fields))
        return self.law_with("", {})

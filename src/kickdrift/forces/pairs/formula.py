"""Pair forces from a formula that is text."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from itertools import combinations
from typing import TYPE_CHECKING, Any, ClassVar

from kickdrift.errors import InputError
from kickdrift.forces.formulas.given import Formulas
from kickdrift.forces.laws.law import DISTANCES, check_law
from kickdrift.forces.pairs.ends import End
from kickdrift.forces.pairs.law import PairForce
from kickdrift.forces.seam.named import register_force
from kickdrift.model.checks.arguments import checked_arguments
from kickdrift.text import shown

if TYPE_CHECKING:
    from kickdrift.model.subject import Subject

CLOSE = 1e-9  # relative, between the energies of a pair and of the pair in the other order


@checked_arguments
@dataclass(frozen=True)
class FormulaPair(Formulas, PairForce):
    """A pair force whose energy is a formula of r, in OpenMM's notation, such as ``q1*q2*exp(-r)``.

    A parameter ``q`` of the table ``species`` is ``q1`` and ``q2`` in the formula: the values of the first particle and
    of the second, as in OpenMM. The formula must give the same energy in both orders. ``pairs`` may name pairs of
    species with parameters of their own. A cutoff is needed. The law is compiled for SIMD lanes.
    """

    name: ClassVar[str] = "formula-pair"
    variable: ClassVar[str] = "r2"
    dimensions: ClassVar[dict[str, str]] = {**Formulas.dimensions, "cutoff": "length", "switch_start": "length"}

    def __post_init__(self) -> None:
        self.keep("species", "pairs")
        super().__post_init__()

    @property
    def known_names(self) -> tuple[str, ...]:
        """See Formulas: the names in the formula, and those of which it has a first and a second value."""
        names = self.own_law.formula.parameters
        return tuple(dict.fromkeys([*names, *(name[:-1] for name in names if name[-1] in "12" and len(name) > 1)]))

    def values_with(self, values: Mapping[str, Any]) -> dict[str, float]:
        """See Formulas. Values of one species hold for both particles."""
        found = super().values_with(values)
        return both(found, found)

    def _tables_given(self) -> list[tuple[str, Mapping[str, Any]]]:
        given = super()._tables_given()
        return given[1:] if self.pairs and not given[0][0] and self.empty else given

    def _check_given(self, where: str, law: Any, end: End) -> None:
        check_law(f"{self.name}{where}", law, end.cutoff)  # the slope follows from the energy

    def pair_law(self, a: str, b: str) -> Any:
        """The law's numbers between species a and b."""
        return self.law_of_values(f" of pair {a}-{b}", self.pair_values(a, b))

    def pair_values(self, a: str, b: str) -> dict[str, float]:
        """Parameters of the formula between species a and b."""
        if (given := self._given(a, b)) is not None or not self.species:
            return self.values_with(given or {})
        for name in (a, b):
            if name not in self.species:
                raise InputError(f"{self.name}: species {name!r} has no parameters (and no pair {a}-{b} is given)")
        first, second = ((self.parameters or {}) | (self.species[name].get("parameters") or {}) for name in (a, b))
        return both(first, second)

    def check(self, system: Subject) -> None:
        """Refuse a system that this force does not support, and a formula that depends on the order of a pair."""
        super().check(system)
        for a, b in combinations(system.species, 2):
            first, second, cutoff = self.pair_law(a, b), self.pair_law(b, a), self.pair_end(a, b).cutoff
            for r in (part * cutoff for part in DISTANCES):
                one, other = (float(law.law(r * r)[0]) for law in (first, second))
                if not math.isclose(one, other, rel_tol=CLOSE, abs_tol=1e-300):
                    raise InputError(
                        f"{self.name}: {shown(self.formula)} gives {one:.6g} for the pair {a}-{b} at r = {r:.4g} and "
                        f"{other:.6g} for {b}-{a}; both orders must give one energy"
                    )


def both(first: Mapping[str, float], second: Mapping[str, float]) -> dict[str, float]:
    """Parameters of a pair from those of its two particles; shared ones keep their names too."""
    shared = {key: value for key, value in first.items() if second.get(key) == value}
    found = {f"{key}1": value for key, value in first.items()} | {f"{key}2": value for key, value in second.items()}
    return found | shared


register_force(FormulaPair, overwrite=True)

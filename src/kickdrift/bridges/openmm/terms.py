"""Bonded terms of OpenMM's forces as lists of a Topology with types, and the forces that act on these types.

A term is a class of forces and its parameters. Items with the same terms have one type. An item with several terms of
one class, such as a dihedral with a series of periods, has a force for each place in the series.
"""

from __future__ import annotations

import math
import re
from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Sequence
from itertools import pairwise
from typing import Any

from kickdrift.bridges.openmm.custom import OfFormula, Well, listed
from kickdrift.forces import (
    Cmap,
    HarmonicAngle,
    HarmonicBond,
    HarmonicImproper,
    ListedPairs,
    PeriodicDihedral,
    PeriodicImproper,
    RyckaertBellemans,
)
from kickdrift.model.units.unit_systems import UNIT_SYSTEMS

Item = tuple[int, ...]
Term = tuple[Any, tuple[float, ...]]
NO_TERM = "none"  # type of an item on which no force acts, such as a rigid bond
PI = r"(?:pi|3\.14\d*)"
HARMONIC = (  # formulas of harmonic impropers that OpenMM's readers write, without spaces, and their stiffness over k
    (re.compile(rf"k\*min\(dtheta,2\*{PI}-dtheta\)\^2;dtheta=abs\(theta-theta0\);?(pi={PI};?)?"), 2.0),
    (re.compile(r"0\.5\*k\*\(thetap-theta0\)\^2;thetap=step\(-\(theta-theta0\+pi\)\)\*2\*pi\+theta\+"
                rf"step\(theta-theta0-pi\)\*\(-2\*pi\);pi={PI}"), 1.0),
)  # fmt: skip
COULOMB = float(UNIT_SYSTEMS["gromacs"].coulomb or 0.0)
SAME = 1e-6  # radians between equal angles of rest; readers write pi with seven digits


def number(quantity: Any) -> Any:
    """The number in OpenMM's own units: nm, ps, u, kJ/mol, elementary charges and radians. `value_in_unit` would copy,
    which takes ten times as long."""
    return getattr(quantity, "_value", quantity)


def forwards(item: Item) -> Item:
    """The item in the direction in which its first particle has the lower number."""
    return item if item[0] < item[-1] else item[::-1]


class Terms:
    """Items of one kind, such as "angles", with the terms of each."""

    def __init__(self, kind: str, items: Iterable[Item] = ()) -> None:
        self.kind = kind
        self.items: dict[Item, list[Term]] = {forwards(item): [] for item in items}

    def add(self, item: Item, cls: Any, *parameters: float) -> None:
        """Add a term to an item."""
        self.items.setdefault(forwards(item), []).append((cls, parameters))

    def lists(self, species: Sequence[str]) -> tuple[dict[str, Any], list[Any]]:
        """Arguments of a Topology, and the forces. A type is named by the ``species`` of its first item."""
        named: dict[tuple[Term, ...], str] = {(): NO_TERM}
        taken: Counter[str] = Counter()
        types = []
        for item, terms in self.items.items():
            key = tuple(terms)
            if key not in named:
                name = "-".join(species[i] for i in item)
                taken[name] += 1
                named[key] = name if taken[name] == 1 else f"{name} {taken[name]}"
            types.append(named[key])
        if not types:
            return {}, []
        return {self.kind: list(self.items), f"{self.kind[:-1]}_types": types}, list(_forces(named))


def _forces(named: dict[tuple[Term, ...], str]) -> Iterator[Any]:
    """The forces on types, one for each class and each place in a series of its terms."""
    tables: dict[tuple[Any, int], dict[str, dict[str, float]]] = {}
    for terms, name in named.items():
        place: Counter[Any] = Counter()
        for cls, parameters in terms:
            table = tables.setdefault((cls, place[cls]), {})
            of_formula = isinstance(cls, OfFormula)
            table[name] = (
                cls.table(parameters) if of_formula else dict(zip(cls.Parameters._fields, parameters, strict=True))
            )
            place[cls] += 1
    for (cls, _), table in tables.items():
        yield cls(**next(iter(table.values())), types=table)


class Molecules:
    """Bonds, angles, dihedrals and impropers of a System, collected from OpenMM's forces."""

    def __init__(self, bonds: Iterable[Item]) -> None:
        self.bonds = Terms("bonds", bonds)
        self.chains = set(self.bonds.items)
        self.angles, self.dihedrals, self.impropers = map(Terms, ("angles", "dihedrals", "impropers"))
        self.maps: list[Cmap] = []
        self.wells: list[tuple[tuple[int, int], Well]] = []

    def lists(self, species: Sequence[str]) -> tuple[dict[str, Any], list[Any]]:
        """Arguments of a Topology, and the forces."""
        lists: dict[str, Any] = {}
        forces = []
        for terms in (self.bonds, self.angles, self.dihedrals, self.impropers):
            more, acting = terms.lists(species)
            lists |= more
            forces += acting
        if self.wells:
            wells = [each for _, each in self.wells]
            charges = [each.strength / COULOMB for each in wells]
            epsilon, sigma = [each.epsilon for each in wells], [each.sigma for each in wells]
            forces.append(ListedPairs([pair for pair, _ in self.wells], epsilon, sigma, charges))
        return lists, [*forces, *self.maps]

    def _is_chain(self, item: Item) -> bool:
        return all(forwards(pair) in self.chains for pair in pairwise(item))

    def harmonic_bonds(self, force: Any) -> None:
        """Take the terms of a HarmonicBondForce."""
        for k in range(force.getNumBonds()):
            i, j, length, stiffness = map(number, force.getBondParameters(k))
            if stiffness:
                self.bonds.add((i, j), HarmonicBond, stiffness, length)

    def harmonic_angles(self, force: Any) -> None:
        """Take the terms of a HarmonicAngleForce."""
        for k in range(force.getNumAngles()):
            i, j, m, rest, stiffness = map(number, force.getAngleParameters(k))
            if stiffness:
                self.angles.add((i, j, m), HarmonicAngle, stiffness, math.degrees(rest))

    def periodic_torsions(self, force: Any) -> None:
        """Take the terms of a PeriodicTorsionForce: a dihedral along a chain of bonds, else an improper."""
        for k in range(force.getNumTorsions()):
            *item, period, phase, barrier = map(number, force.getTorsionParameters(k))
            if barrier:
                term = barrier, float(period), math.degrees(phase)
                if self._is_chain(tuple(item)):
                    self.dihedrals.add(tuple(item), PeriodicDihedral, *term)
                else:
                    self.impropers.add(tuple(item), PeriodicImproper, *term)

    def ryckaert_bellemans(self, force: Any) -> None:
        """Take the terms of an RBTorsionForce."""
        for k in range(force.getNumTorsions()):
            i, j, m, n, *series = map(number, force.getTorsionParameters(k))
            if any(series):
                self.dihedrals.add((i, j, m, n), RyckaertBellemans, *series)

    def cmaps(self, force: Any) -> None:
        """Take the maps and terms of a CMAPTorsionForce, whose map has phi along its columns."""
        if force.getNumTorsions():
            chains = [force.getTorsionParameters(k) for k in range(force.getNumTorsions())]
            maps = []
            for k in range(force.getNumMaps()):
                size, energies = force.getMapParameters(k)
                maps.append([[number(energies[j * size + i]) for j in range(size)] for i in range(size)])
            self.maps.append(Cmap([each[1:] for each in chains], maps, [each[0] for each in chains]))

    def custom_bonds(self, force: Any) -> None:
        """Take the terms of a CustomBondForce, whose pairs may have the terms of `ListedPairs`."""
        for item, terms in listed(force, "Bond"):
            if isinstance(terms, Well):
                self.wells.append(((item[0], item[1]), terms))
            for cls, parameters in () if isinstance(terms, Well) else terms:
                self.bonds.add(item, cls, *parameters)

    def custom_angles(self, force: Any) -> None:
        """Take the terms of a CustomAngleForce."""
        for item, terms in listed(force, "Angle"):
            for cls, parameters in terms:
                self.angles.add(item, cls, *parameters)

    def custom_torsions(self, force: Any) -> None:
        """Take the terms of a CustomTorsionForce: harmonic impropers, a series of periods, or the formula itself."""
        for item, terms in _harmonic_impropers(force) or listed(force, "Torsion"):
            for cls, parameters in terms:
                on = cls.on_impropers() if isinstance(cls, OfFormula) else IMPROPER.get(cls, cls)
                if on != cls and self._is_chain(item):
                    self.dihedrals.add(item, cls, *parameters)
                else:
                    self.impropers.add(item, on, *parameters)


IMPROPER: dict[Any, Any] = {PeriodicDihedral: PeriodicImproper}


def _harmonic_impropers(force: Any) -> list[tuple[Item, list[Term]]] | None:
    """Terms of a CustomTorsionForce that is that of harmonic impropers at rest at 0 or 180 degrees; else None."""
    formula = force.getEnergyFunction().replace(" ", "")
    factor = next((factor for pattern, factor in HARMONIC if pattern.fullmatch(formula)), None)
    keys = [force.getPerTorsionParameterName(k) for k in range(force.getNumPerTorsionParameters())]
    if factor is None or sorted(keys) != ["k", "theta0"]:
        return None
    found: list[tuple[Item, list[Term]]] = []
    for t in range(force.getNumTorsions()):
        *item, values = force.getTorsionParameters(t)
        given = dict(zip(keys, values, strict=True))
        rest = abs(given["theta0"])
        if min(rest, abs(rest - math.pi)) > SAME:  # whose sign counts
            return None
        term = HarmonicImproper, (factor * given["k"], 180.0 if rest > 1.0 else 0.0)
        found.append((tuple(item), [term] if given["k"] else []))
    return found


TAKEN: dict[str, Callable[[Molecules, Any], None]] = {  # OpenMM's forces of bonded terms
    "HarmonicBondForce": Molecules.harmonic_bonds,
    "HarmonicAngleForce": Molecules.harmonic_angles,
    "PeriodicTorsionForce": Molecules.periodic_torsions,
    "RBTorsionForce": Molecules.ryckaert_bellemans,
    "CMAPTorsionForce": Molecules.cmaps,
    "CustomBondForce": Molecules.custom_bonds,
    "CustomAngleForce": Molecules.custom_angles,
    "CustomTorsionForce": Molecules.custom_torsions,
}

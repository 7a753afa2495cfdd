"""OpenMM's custom forces as kickdrift's laws.

OpenMM itself evaluates a formula, for each set of parameters, at several distances or angles. A law whose parameters
follow from some of these energies must give the others. So the notation of a formula does not matter, and tables of
parameters may stand in it. A formula with other energies becomes a law by its text, compiled, if its functions are
known; its energies, too, must be those of OpenMM.
"""

from __future__ import annotations

import copy
import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from itertools import combinations_with_replacement
from typing import Any, NamedTuple

import numpy as np
import openmm

from kickdrift.errors import InputError
from kickdrift.forces import (
    CosineAngle,
    FormulaAngle,
    FormulaBond,
    FormulaDihedral,
    FormulaImproper,
    FormulaPair,
    HarmonicAngle,
    HarmonicBond,
    HarmonicImproper,
    PeriodicDihedral,
)
from kickdrift.forces.bonded.law import value_of
from kickdrift.forces.formulas.expression import Law, law_of
from kickdrift.forces.pairs.formula import both
from kickdrift.model.state import Floats
from kickdrift.text import shown

DISTANCES = np.array([0.11, 0.17, 0.25, 0.36, 0.5, 0.7, 0.9])  # nm
FAR = np.array([1.5, 4.0, 30.0])  # nm; where a bond that is silent at DISTANCES may begin to pull
ANGLES = np.linspace(0.4, 2.9, 7)
TURNS = np.linspace(-math.pi, math.pi, 23, endpoint=False) + 0.05
MOST = 6  # multiplicity of a dihedral's series
SAME = 1e-9  # of the largest term
REFERENCE = "Reference"
PROBED = 50  # pairs of species whose energies by a formula are compared

Terms = list[tuple[Any, tuple[float, ...]]]


class Well(NamedTuple):
    """Lennard-Jones and Coulomb's law of a pair: the depth, its length, and the energy of the charges times length."""

    epsilon: float
    sigma: float
    strength: float


def refuse(force: Any, reason: str) -> InputError:
    """The error for a custom force, with its formula."""
    return InputError(f"system: {type(force).__name__} {shown(text_of(force))}: {reason}")


class Probe:
    """A custom force on one item, or on two particles, whose energy is asked at any place.

    ``kind`` is Bond, Angle, Torsion, or Particle for a CustomNonbondedForce."""

    def __init__(self, force: Any, kind: str) -> None:
        if force.getNumEnergyParameterDerivatives():
            raise refuse(force, "kickdrift gives no derivatives by global parameters")
        self.kind, self._of = kind, {"Bond": 2, "Angle": 3, "Torsion": 4, "Particle": 2}[kind]
        made = type(force)(force.getEnergyFunction())
        for k in range(force.getNumGlobalParameters()):
            made.addGlobalParameter(force.getGlobalParameterName(k), force.getGlobalParameterDefaultValue(k))
        count = getattr(force, f"getNumPer{kind}Parameters")()
        for k in range(count):
            getattr(made, f"addPer{kind}Parameter")(getattr(force, f"getPer{kind}ParameterName")(k))
        if kind == "Particle":
            for k in range(force.getNumTabulatedFunctions()):
                made.addTabulatedFunction(force.getTabulatedFunctionName(k), copy.copy(force.getTabulatedFunction(k)))
        system = openmm.System()
        for _ in range(self._of):
            system.addParticle(1.0)
        for _ in range(2 if kind == "Particle" else 1):
            items = [] if kind == "Particle" else [*range(self._of)]
            getattr(made, f"add{kind}")(*items, [0.0] * count)
        system.addForce(made)
        self._force = made
        platform = openmm.Platform.getPlatformByName(REFERENCE)
        self._context = openmm.Context(system, openmm.VerletIntegrator(1.0), platform)

    def energies(self, at: Floats, *parameters: Sequence[float]) -> Floats:
        """Energies of an item with these parameters, or of two particles with theirs, at distances or angles."""
        for k, values in enumerate(parameters):
            if self.kind == "Particle":
                self._force.setParticleParameters(k, values)
            else:
                getattr(self._force, f"set{self.kind}Parameters")(0, *range(self._of), values)
        self._force.updateParametersInContext(self._context)
        found = []
        for value in at:
            self._context.setPositions(_places(self.kind, float(value)))
            found.append(self._context.getState(energy=True).getPotentialEnergy()._value)
        return np.array(found)


def _places(kind: str, value: float) -> Floats:
    """Particles (n, 3) at this distance or angle, in nm."""
    if kind == "Angle":
        return 0.1 * np.array([[1.0, 0.0, 0.0], [0.0, 0.0, 0.0], [math.cos(value), math.sin(value), 0.0]])
    if kind == "Torsion":
        turned = [1.0, math.cos(value), math.sin(value)]
        return 0.1 * np.array([[0.0, 1.0, 0.0], [0.0, 0.0, 0.0], [1.0, 0.0, 0.0], turned])
    return np.array([[0.0, 0.0, 0.0], [value, 0.0, 0.0]])


def fitted(at: Floats, energies: Floats, columns: Callable[[Floats], Floats]) -> Floats | None:
    """Coefficients of the sum of columns (m, k) that is the energy at every place; None if there is none."""
    matrix = columns(at)
    scale = np.abs(matrix).max(axis=0)
    weights = 1.0 / np.maximum(np.abs(energies), 1e-12 * np.abs(energies).max(initial=1e-300))
    found = np.linalg.lstsq(weights[:, None] * matrix / scale, weights * energies, rcond=None)[0] / scale
    terms = matrix * found
    largest = np.maximum(np.abs(terms).max(axis=1), np.abs(energies))
    return found if bool((np.abs(terms.sum(axis=1) - energies) <= SAME * np.maximum(largest, 1e-12)).all()) else None


def well(energies: Floats) -> Well | None:
    """The pair law with these energies at DISTANCES; None if they are not those of Lennard-Jones and Coulomb."""
    if not energies.any():
        return Well(0.0, 1.0, 0.0)
    found = fitted(DISTANCES, energies, lambda r: np.column_stack([r**-12, r**-6, 1.0 / r]))
    if found is None:
        return None
    twelve, six, one = found.tolist()
    one = one if abs(one) > 1e-9 * abs(six) ** (1 / 6) else 0.0
    if twelve <= 0.0 or six >= 0.0:  # without a well; a force that only repels has no such form
        small = max(abs(twelve) * 0.1**-12, abs(six) * 0.1**-6) < SAME * abs(one) * 10.0
        return Well(0.0, 1.0, one) if small else None
    return Well(six * six / (4.0 * twelve), (-twelve / six) ** (1 / 6), one)


def bond_terms(energies: Floats) -> Terms | None:
    """Terms of a bond with these energies at DISTANCES."""
    found = fitted(DISTANCES, energies, lambda r: np.column_stack([np.ones_like(r), r, r * r]))
    if found is None or found[2] <= 0.0:
        return None
    c, b, a = found.tolist()
    length = -b / (2.0 * a)
    offset = abs(c - a * length**2) > 1e-7 * a
    return None if offset or length < 0.0 else [(HarmonicBond, (2.0 * a, length))]


def angle_terms(energies: Floats) -> Terms | None:
    """Terms of an angle with these energies at ANGLES."""
    found = fitted(ANGLES, energies, lambda x: np.column_stack([np.ones_like(x), x, x * x]))
    if found is not None and found[2] > 0.0:
        c, b, a = found.tolist()
        rest = -b / (2.0 * a)
        if abs(c - a * rest**2) < 1e-7 * a and 0.0 <= rest <= math.pi + 1e-9:
            return [(HarmonicAngle, (2.0 * a, min(math.degrees(rest), 180.0)))]
    found = fitted(ANGLES, energies, lambda x: (1.0 + np.cos(x))[:, None])
    return None if found is None else [(CosineAngle, (float(found[0]),))]


def torsion_terms(energies: Floats) -> Terms | None:
    """Terms of a dihedral with these energies at TURNS: a series of periods 1 to 6, and a constant."""
    orders = range(1, MOST + 1)

    def columns(x: Floats) -> Floats:
        waves = [wave(n * x) for n in orders for wave in (np.cos, np.sin)]
        return np.column_stack([np.ones_like(x), *waves])

    found = np.linalg.lstsq(columns(TURNS), energies, rcond=None)[0]
    size = float(np.abs(energies).max())
    if float(np.abs(columns(TURNS) @ found - energies).max()) > SAME * size:
        return _harmonic(energies)
    terms: Terms = []
    constant = float(found[0])
    for n in orders:
        cosine, sine = found[2 * n - 1 : 2 * n + 1].tolist()
        barrier = math.hypot(cosine, sine)
        if barrier > SAME * size:
            phase = math.degrees(math.atan2(sine, cosine))
            terms.append((PeriodicDihedral, (barrier, float(n), 0.0 if abs(phase) < 1e-6 else phase)))
            constant -= barrier
    if abs(constant) > SAME * size:
        terms.append((PeriodicDihedral, (constant, 0.0, 90.0)))  # constant (1 + cos(-90 degrees))
    return terms


def _harmonic(energies: Floats) -> Terms | None:
    """The term of an improper whose energy is harmonic in the size of the angle, at rest at 0 or 180 degrees."""
    found = fitted(np.abs(TURNS), energies, lambda x: np.column_stack([np.ones_like(x), x, x * x]))
    if found is None or found[2] <= 0.0:
        return None
    c, b, a = found.tolist()
    rest = -b / (2.0 * a)
    settled = 0.0 if abs(rest) < 1e-6 else math.pi if abs(rest - math.pi) < 1e-6 else None
    if settled is None or abs(c - a * rest**2) > 1e-7 * a:
        return None
    return [(HarmonicImproper, (2.0 * a, math.degrees(settled)))]


KINDS: dict[str, tuple[Floats, Callable[[Floats], Terms | None]]] = {
    "Bond": (DISTANCES, bond_terms), "Angle": (ANGLES, angle_terms), "Torsion": (TURNS, torsion_terms),
}  # fmt: skip
BY_FORMULA: dict[str, Any] = {"Bond": FormulaBond, "Angle": FormulaAngle, "Torsion": FormulaDihedral}


class OfFormula(NamedTuple):
    """A class of forces with its formula, in the place of a class whose law is known.

    ``names`` are those of the parameters, and their values a term's parameters."""

    cls: Any
    formula: str
    names: tuple[str, ...]

    def table(self, parameters: tuple[float, ...]) -> dict[str, Any]:
        """Parameters of a type."""
        return {"parameters": dict(zip(self.names, parameters, strict=True))}

    def __call__(self, types: Any, **_: Any) -> Any:
        """The force on these types."""
        return self.cls(self.formula, types=types)

    def on_impropers(self) -> OfFormula:
        """The same for impropers."""
        return self._replace(cls=FormulaImproper)


def text_of(force: Any) -> str:
    """The formula in one line."""
    return " ".join(force.getEnergyFunction().split())


def _globals(force: Any) -> dict[str, float]:
    """Values of the global parameters."""
    each = range(force.getNumGlobalParameters())
    return {force.getGlobalParameterName(k): force.getGlobalParameterDefaultValue(k) for k in each}


def listed(force: Any, kind: str) -> Iterator[tuple[tuple[int, ...], Any]]:
    """Items of a CustomBondForce, CustomAngleForce or CustomTorsionForce with their terms, or the well of a pair."""
    at, terms_of = KINDS[kind]
    probe, known = Probe(force, kind), dict[tuple[float, ...], Terms | Well]()
    for k in range(getattr(force, f"getNum{kind}s")()):
        *item, values = getattr(force, f"get{kind}Parameters")(k)
        if (key := tuple(values)) not in known:
            energies = probe.energies(at, values)
            found: Any = terms_of(energies) if energies.any() else []
            found = well(energies) if found is None and kind == "Bond" else found
            far = kind == "Bond" and not energies.any() and bool(probe.energies(FAR, values).any())
            known[key] = [_by_formula(force, kind, at, energies, values)] if found is None or far else found
        yield tuple(item), known[key]


def _law(force: Any, variable: str, given: Mapping[str, float], at: Floats, energies: Floats) -> Law:
    """The law of a custom force's formula. Refuses one that kickdrift cannot read, or whose energies differ."""
    try:
        law = law_of(text_of(force), variable)
        numbers = law.of("", given, 1.0, 1.0)
    except InputError as error:
        raise refuse(force, str(error).removeprefix(": ").removeprefix("formula: ")) from None
    ours = np.array([value_of(numbers, place * place if variable == "r2" else place)[0] for place in at.tolist()])
    differ = np.abs(ours - energies) > SAME * np.maximum(np.abs(energies), 1e-12 * np.nanmax(np.abs(energies)))
    if differ.any() or (np.isfinite(ours) != np.isfinite(energies)).any():
        raise refuse(force, "its energies by kickdrift are not those of OpenMM")
    return law


def _by_formula(force: Any, kind: str, at: Floats, energies: Floats, values: Sequence[float]) -> tuple[Any, Any]:
    """The term of an item whose law is the formula itself."""
    names = [getattr(force, f"getPer{kind}ParameterName")(k) for k in range(len(values))]
    given = _globals(force) | dict(zip(names, values, strict=True))
    cls = BY_FORMULA[kind]
    law = _law(force, cls.variable, given, at, energies)
    used = law.formula.parameters
    if kind == "Torsion":
        first, last = (value_of(law.of("", given, 1.0, 1.0), end)[0] for end in (-math.pi, math.pi))
        cls = cls if abs(first - last) <= SAME * np.abs(energies).max() else FormulaImproper
    return OfFormula(cls, text_of(force), used), tuple(given[name] for name in used)


def wells(force: Any, kinds: Sequence[Sequence[float]]) -> list[list[Well]] | None:
    """The Lennard-Jones wells between particles with each two of these parameters of a CustomNonbondedForce; None if
    its law is another."""
    probe = Probe(force, "Particle")
    found = []
    for k, first in enumerate(kinds):
        row = []
        for other in kinds[: k + 1]:
            pair = well(probe.energies(DISTANCES, first, other))
            if pair is None or pair.strength:
                return None
            row.append(pair)
        found.append(row)
    return found


def pairs_by_formula(force: Any, kinds: Mapping[str, Sequence[float]], **end: Any) -> FormulaPair:
    """The pair force of a CustomNonbondedForce, whose species have these parameters. ``end`` says where pairs end."""
    names = [force.getPerParticleParameterName(k) for k in range(force.getNumPerParticleParameters())]
    species = {name: dict(zip(names, values, strict=True)) for name, values in kinds.items()}
    probe, shared = Probe(force, "Particle"), _globals(force)
    law = None
    for name, other in list(combinations_with_replacement(species, 2))[:PROBED]:
        given = shared | both(species[name], species[other])
        law = _law(force, "r2", given, DISTANCES, probe.energies(DISTANCES, kinds[name], kinds[other]))
    assert law is not None
    needed = law.formula.parameters
    own = {key for key in names if f"{key}1" in needed or f"{key}2" in needed}
    tables = {
        name: {"parameters": {key: values[key] for key in names if key in own}} for name, values in species.items()
    }
    parameters = {key: value for key, value in shared.items() if key in needed}
    return FormulaPair(text_of(force), parameters or None, species=tables if own else None, **end)

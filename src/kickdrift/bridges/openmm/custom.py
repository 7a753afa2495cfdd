"""OpenMM's custom forces whose formulas are those of kickdrift's laws.

OpenMM itself evaluates a formula, for each set of parameters, at several distances or angles. A law whose parameters
follow from some of these energies must give the others. So the notation of a formula does not matter, and tables of
parameters may stand in it.
"""

from __future__ import annotations

import copy
import math
from collections.abc import Callable, Iterator, Sequence
from typing import Any, NamedTuple

import numpy as np
import openmm

from kickdrift.errors import InputError
from kickdrift.forces import CosineAngle, HarmonicAngle, HarmonicBond, HarmonicImproper, PeriodicDihedral
from kickdrift.model.state import Floats
from kickdrift.text import shown

DISTANCES = np.array([0.11, 0.17, 0.25, 0.36, 0.5, 0.7, 0.9])  # nm
FAR = np.array([1.5, 4.0, 30.0])  # nm; where a bond that is silent at DISTANCES may begin to pull
ANGLES = np.linspace(0.4, 2.9, 7)
TURNS = np.linspace(-math.pi, math.pi, 23, endpoint=False) + 0.05
MOST = 6  # multiplicity of a dihedral's series
SAME = 1e-9  # of the largest term
REFERENCE = "Reference"

Terms = list[tuple[Any, tuple[float, ...]]]


class Well(NamedTuple):
    """Lennard-Jones and Coulomb's law of a pair: the depth, its length, and the energy of the charges times length."""

    epsilon: float
    sigma: float
    strength: float


def refuse(force: Any, reason: str) -> InputError:
    """The error for a custom force, with its formula."""
    formula = " ".join(force.getEnergyFunction().split())
    return InputError(f"system: {type(force).__name__} {shown(formula)}: {reason}")


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
            if found is None or far:
                laws = {"Bond": "harmonic-bond or listed-pairs", "Angle": "harmonic-angle or cosine-angle",
                        "Torsion": "a series of periodic-dihedral or harmonic-improper"}[kind]  # fmt: skip
                where = ", ".join(map(str, item))
                raise refuse(force, f"its energy for the particles {where} is not that of {laws}")
            known[key] = found
        yield tuple(item), known[key]


def wells(force: Any, kinds: Sequence[Sequence[float]]) -> list[list[Well]]:
    """The pair law between particles with each two of these parameters of a CustomNonbondedForce."""
    if force.getNumInteractionGroups():
        raise refuse(force, "kickdrift has no interaction groups")
    probe = Probe(force, "Particle")
    found = []
    for k, first in enumerate(kinds):
        row = []
        for other in kinds[: k + 1]:
            pair = well(probe.energies(DISTANCES, first, other))
            if pair is None or pair.strength:
                raise refuse(force, "its energy is not that of lennard-jones; other pair laws are not taken")
            row.append(pair)
        found.append(row)
    return found

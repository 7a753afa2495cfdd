"""OpenMM's NonbondedForce as Lennard-Jones by species, Coulomb's law, exclusions, and listed pairs.

Every exception leaves its pair out of the other pair forces. An exception with a charge or a well of its own becomes a
listed pair.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from kickdrift.bridges.openmm.custom import Well, pairs_by_formula, refuse, wells
from kickdrift.bridges.openmm.terms import number
from kickdrift.errors import InputError
from kickdrift.forces import FORCES, Coulomb, ListedPairs
from kickdrift.model.state import Floats

METHODS = ("NoCutoff", "CutoffNonPeriodic", "CutoffPeriodic", "Ewald", "PME", "LJPME")  # by OpenMM's number
FAR = 100.0  # nm, or ten times the extent: a cutoff in open space beyond which no pair gets
LEAST_SIGMA = 1e-3  # nm: a shorter sigma belongs to a particle without a well


class Nonbonded(NamedTuple):
    """A NonbondedForce in kickdrift's terms."""

    forces: list[Any]
    species: list[str]  # of each particle
    charges: Floats | None
    exclusions: NDArray[np.int64]


def nonbonded(force: Any, symbols: Sequence[str], positions: Floats, customs: Sequence[Any] = ()) -> Nonbonded:
    """Return the terms of a NonbondedForce, which may be None, and of the CustomNonbondedForces beside it.

    Particles with one symbol, sigma, epsilon and parameters of the custom forces are one species. A custom force may
    have the Lennard-Jones of all pairs, as CHARMM's force fields have it in OpenMM. Another is a `FormulaPair`."""
    out, first = _left_out(force or customs[0]), "NonbondedForce" if force else "the first"
    for custom in customs:
        if custom.getNumInteractionGroups():
            raise refuse(custom, "kickdrift has no interaction groups")
        for pair in sorted(out ^ _left_out(custom)):
            one, other = (first, "it") if pair in out else ("it", first)
            raise refuse(custom, f"{one} leaves out the pair {list(pair)}, and {other} does not")
    charges = sigma = epsilon = np.zeros(len(symbols))
    if force:
        charges, sigma, epsilon = _particles(force).T
    own = _wells(epsilon, sigma) if epsilon.any() or not customs else [()] * len(symbols)
    given = [[tuple(custom.getParticleParameters(i)) for i in range(len(symbols))] for custom in customs]
    kinds = list(zip(symbols, own, *given, strict=True))
    named = _names(kinds)
    forces: list[Any] = []
    if epsilon.any():
        table = {name: {"epsilon": kind[1][1], "sigma": kind[1][0]} for kind, name in named.items()}
        forces.append(FORCES["lennard-jones"](species=table, **_end(force, positions)))
    for k, custom in enumerate(customs, 2):
        parameters = {name: kind[k] for kind, name in named.items()}
        found = None if any(each.name == "lennard-jones" for each in forces) else wells(custom, [*parameters.values()])
        if found is None:
            forces.append(pairs_by_formula(custom, parameters, **_end(custom, positions)))
        else:
            forces.append(FORCES["lennard-jones"](**_tables(list(named.values()), found), **_end(custom, positions)))
    if charges.any():
        forces.append(_coulomb(force))
    if not force:
        return Nonbonded(forces, [named[kind] for kind in kinds], None, np.array(sorted(out), np.int64).reshape(-1, 2))
    exceptions = [force.getExceptionParameters(k) for k in range(force.getNumExceptions())]
    pairs = np.array([each[:2] for each in exceptions], np.int64).reshape(-1, 2)
    terms = np.array([[number(value) for value in each[2:]] for each in exceptions], dtype=float).reshape(-1, 3)
    acting = (terms[:, 0] != 0) | (terms[:, 2] != 0)
    if acting.any():
        products, sigmas, epsilons = terms[acting].T
        sigmas = np.where(epsilons == 0, LEAST_SIGMA, sigmas)
        forces.append(ListedPairs(pairs[acting].tolist(), epsilons.tolist(), sigmas.tolist(), products.tolist()))
    return Nonbonded(forces, [named[kind] for kind in kinds], charges if charges.any() else None, pairs)


def _particles(force: Any) -> Floats:
    """Charge, sigma and epsilon of each particle (n, 3) of a NonbondedForce that kickdrift takes."""
    if METHODS[force.getNonbondedMethod()] == "LJPME":
        raise InputError(
            "system: NonbondedForce: LJPME, a mesh for r^-6 too, has no counterpart in kickdrift; take PME with the "
            "dispersion correction (nonbondedMethod=PME)"
        )
    if force.getNumParticleParameterOffsets() or force.getNumExceptionParameterOffsets():
        raise InputError("system: NonbondedForce: its parameter offsets have no counterpart in kickdrift")
    every = range(force.getNumParticles())
    return np.array([[number(each) for each in force.getParticleParameters(i)] for i in every], float).reshape(-1, 3)


def _end(force: Any, positions: Floats) -> dict[str, Any]:
    """Cutoff, truncation and tail of a NonbondedForce or a CustomNonbondedForce."""
    method = METHODS[force.getNonbondedMethod()]
    if method == "NoCutoff":
        return {"cutoff": max(FAR, 10.0 * float(np.ptp(positions))), "truncation": "cut"}
    custom = hasattr(force, "getUseLongRangeCorrection")
    corrected = force.getUseLongRangeCorrection() if custom else force.getUseDispersionCorrection()
    end = {"cutoff": number(force.getCutoffDistance()), "tail": bool(method in METHODS[2:] and corrected)}
    if not force.getUseSwitchingFunction():
        return {**end, "truncation": "cut"}
    return {**end, "truncation": "potential-switch", "switch_start": number(force.getSwitchingDistance())}


def _left_out(force: Any) -> set[tuple[int, int]]:
    """Pairs that a NonbondedForce or a CustomNonbondedForce leaves out."""
    if hasattr(force, "getNumExceptions"):
        pairs = (force.getExceptionParameters(k)[:2] for k in range(force.getNumExceptions()))
    else:
        pairs = (force.getExclusionParticles(k) for k in range(force.getNumExclusions()))
    return {(min(i, j), max(i, j)) for i, j in pairs}


def _coulomb(force: Any) -> Coulomb:
    method = METHODS[force.getNonbondedMethod()]
    if method == "NoCutoff":
        return Coulomb("direct")
    cutoff = number(force.getCutoffDistance())
    if method.startswith("Cutoff"):
        return Coulomb("reaction-field", cutoff=cutoff, surroundings=force.getReactionFieldDielectric())
    alpha, *mesh = map(number, force.getPMEParameters())
    if method == "PME" and alpha:
        return Coulomb("pme", cutoff=cutoff, alpha=alpha, mesh=tuple(mesh), order=5)
    return Coulomb(method.lower(), accuracy=force.getEwaldErrorTolerance(), cutoff=cutoff)


def _tables(names: list[str], pairs: list[list[Well]]) -> dict[str, Any]:
    """The tables of Lennard-Jones of all species and pairs."""

    def parameters(pair: Well) -> dict[str, float]:
        return {"epsilon": pair.epsilon, "sigma": pair.sigma}

    species = {name: parameters(pairs[k][k]) for k, name in enumerate(names)}
    mixed = {(name, names[j]): parameters(pairs[k][j]) for k, name in enumerate(names) for j in range(k)}
    return {"species": species, **({"pairs": mixed} if mixed else {})}


def _names(kinds: Sequence[tuple[Any, ...]]) -> dict[tuple[Any, ...], str]:
    """Name of each kind of particle, which begins with its symbol: "O" if all O are alike, else "O1", "O2"."""
    different = list(dict.fromkeys(kinds))
    alike, so_far, named = Counter(symbol for symbol, *_ in different), Counter[str](), {}
    for kind in different:
        so_far[kind[0]] += 1
        named[kind] = kind[0] if alike[kind[0]] == 1 else f"{kind[0]}{so_far[kind[0]]}"
    return named


def _wells(epsilon: Floats, sigma: Floats) -> list[tuple[float, float]]:
    """Sigma and epsilon of each particle. The sigma of a particle without a well does not count."""
    without = epsilon == 0
    sigma = np.where(without, sigma[~without].min(initial=1.0), sigma)
    return list(zip(sigma.tolist(), epsilon.tolist(), strict=True))

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

from kickdrift.bridges.openmm.custom import Well, refuse, wells
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


def nonbonded(force: Any, symbols: Sequence[str], positions: Floats, custom: Any = None) -> Nonbonded:
    """Return the terms of a NonbondedForce. Particles with one symbol, sigma and epsilon are one species.

    A CustomNonbondedForce may have the Lennard-Jones of all pairs in its place, as CHARMM's force fields have it in
    OpenMM. Then particles with one symbol and the same parameters are one species."""
    method = METHODS[force.getNonbondedMethod()]
    if method == "LJPME":
        raise InputError(
            "system: NonbondedForce: LJPME, a mesh for r^-6 too, has no counterpart in kickdrift; take PME with the "
            "dispersion correction (nonbondedMethod=PME)"
        )
    if force.getNumParticleParameterOffsets() or force.getNumExceptionParameterOffsets():
        raise InputError("system: NonbondedForce: its parameter offsets have no counterpart in kickdrift")
    rows = np.array(
        [[number(each) for each in force.getParticleParameters(i)] for i in range(force.getNumParticles())], dtype=float
    ).reshape(-1, 3)
    charges, sigma, epsilon = rows.T
    forces: list[Any] = []
    open_space = method == "NoCutoff"
    cutoff = max(FAR, 10.0 * float(np.ptp(positions))) if open_space else number(force.getCutoffDistance())
    tables: dict[str, Any] = {}
    if custom is None:
        species, tables["species"] = _species(symbols, sigma, epsilon)
    else:
        if epsilon.any():
            raise refuse(custom, "NonbondedForce has wells too; kickdrift takes one Lennard-Jones force")
        _same_pairs(force, custom)
        species, tables = _species_of_pairs(symbols, custom)
    shape = force if custom is None else custom
    if epsilon.any() or custom is not None:
        cut: dict[str, Any] = {"truncation": "cut"}
        if not open_space and shape.getUseSwitchingFunction():
            cut = {"truncation": "potential-switch", "switch_start": number(shape.getSwitchingDistance())}
        corrected = force.getUseDispersionCorrection() if custom is None else custom.getUseLongRangeCorrection()
        forces.append(FORCES["lennard-jones"](cutoff=cutoff, tail=method in METHODS[2:] and corrected, **tables, **cut))
    if charges.any():
        forces.append(_coulomb(force, method, cutoff))
    exceptions = [force.getExceptionParameters(k) for k in range(force.getNumExceptions())]
    pairs = np.array([each[:2] for each in exceptions], np.int64).reshape(-1, 2)
    terms = np.array([[number(value) for value in each[2:]] for each in exceptions], dtype=float).reshape(-1, 3)
    acting = (terms[:, 0] != 0) | (terms[:, 2] != 0)
    if acting.any():
        products, sigmas, epsilons = terms[acting].T
        sigmas = np.where(epsilons == 0, LEAST_SIGMA, sigmas)
        forces.append(ListedPairs(pairs[acting].tolist(), epsilons.tolist(), sigmas.tolist(), products.tolist()))
    return Nonbonded(forces, species, charges if charges.any() else None, pairs)


def _coulomb(force: Any, method: str, cutoff: float) -> Coulomb:
    if method == "NoCutoff":
        return Coulomb("direct")
    if method.startswith("Cutoff"):
        return Coulomb("reaction-field", cutoff=cutoff, surroundings=force.getReactionFieldDielectric())
    alpha, *mesh = map(number, force.getPMEParameters())
    if method == "PME" and alpha:
        return Coulomb("pme", cutoff=cutoff, alpha=alpha, mesh=tuple(mesh), order=5)
    return Coulomb(method.lower(), accuracy=force.getEwaldErrorTolerance(), cutoff=cutoff)


def _same_pairs(force: Any, custom: Any) -> None:
    """Refuse a CustomNonbondedForce that leaves out other pairs than the NonbondedForce, or has another cutoff."""
    out = {tuple(sorted(force.getExceptionParameters(k)[:2])) for k in range(force.getNumExceptions())}
    own = {tuple(sorted(custom.getExclusionParticles(k))) for k in range(custom.getNumExclusions())}
    for i, j in sorted(out ^ own):
        first, other = ("NonbondedForce", "it") if (i, j) in out else ("it", "NonbondedForce")
        raise refuse(custom, f"{first} leaves out the pair {[i, j]}, and {other} does not")
    method = METHODS[force.getNonbondedMethod()]
    alike = METHODS[custom.getNonbondedMethod()] == (method if method in METHODS[:3] else "CutoffPeriodic")
    if not alike or (method != "NoCutoff" and number(custom.getCutoffDistance()) != number(force.getCutoffDistance())):
        raise refuse(custom, "its method or cutoff differs from that of NonbondedForce")


def _species_of_pairs(symbols: Sequence[str], custom: Any) -> tuple[list[str], dict[str, Any]]:
    """The species of each particle of a CustomNonbondedForce, and the tables of all species and pairs."""
    kinds = [(symbol, *custom.getParticleParameters(i)) for i, symbol in enumerate(symbols)]
    named = _names(kinds)
    pairs = wells(custom, [kind[1:] for kind in named])

    def parameters(pair: Well) -> dict[str, float]:
        return {"epsilon": pair.epsilon, "sigma": pair.sigma}

    names = list(named.values())
    species = {name: parameters(pairs[k][k]) for k, name in enumerate(names)}
    mixed = {(name, names[j]): parameters(pairs[k][j]) for k, name in enumerate(names) for j in range(k)}
    return [named[kind] for kind in kinds], {"species": species, **({"pairs": mixed} if mixed else {})}


def _names(kinds: Sequence[tuple[Any, ...]]) -> dict[tuple[Any, ...], str]:
    """Name of each kind of particle, which begins with its symbol: "O" if all O are alike, else "O1", "O2"."""
    different = list(dict.fromkeys(kinds))
    alike, so_far, named = Counter(symbol for symbol, *_ in different), Counter[str](), {}
    for kind in different:
        so_far[kind[0]] += 1
        named[kind] = kind[0] if alike[kind[0]] == 1 else f"{kind[0]}{so_far[kind[0]]}"
    return named


def _species(symbols: Sequence[str], sigma: Floats, epsilon: Floats) -> tuple[list[str], dict[str, dict[str, float]]]:
    """The species of each particle, and the parameters of each: "O" if all O are alike, else "O1", "O2" and so on. The
    sigma of a particle without a well does not count."""
    without = epsilon == 0
    sigma = np.where(without, sigma[~without].min(initial=1.0), sigma)
    kinds = list(zip(symbols, sigma.tolist(), epsilon.tolist(), strict=True))
    named = _names(kinds)
    table = {name: {"epsilon": kind[2], "sigma": kind[1]} for kind, name in named.items()}
    return [named[kind] for kind in kinds], table

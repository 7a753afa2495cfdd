"""A soft push-off: overlapping chains are drawn apart by potentials through which they can still cross."""

from __future__ import annotations

from collections.abc import Iterator
from itertools import combinations_with_replacement
from typing import Any

import numpy as np

from kickdrift.errors import InputError
from kickdrift.forces.bonded.shipped import HarmonicBond
from kickdrift.forces.pairs.law import PairForce
from kickdrift.forces.pairs.shipped import WELL, SoftPair
from kickdrift.model.system import System

STRENGTHS = 1.0, 3.0, 10.0, 30.0, 100.0  # A of the soft potentials over epsilon, one after the other
SPRING = 400.0  # stiffness of a bond, in epsilon / sigma²
SOFT_STEPS = 300  # most steps at each strength
FORCE = 0.5  # largest force at which the next strength begins, in epsilon / sigma


def soft_systems(system: System) -> Iterator[tuple[System, float]]:
    """Systems with soft potentials of growing strength in place of the forces of a System, and the largest force, in
    its units, down to which each is minimized.

    Pairs repel by A (1 + cos(pi r / w)) up to w = 2^(1/6) sigma, the minimum of their Lennard-Jones law, and bonds of
    each type are springs of their mean present length. Angles, dihedrals and impropers keep their laws, and all other
    forces wait. Such a start keeps chains from catching on each other: Auhl et al., J. Chem. Phys. 119, 12718 (2003),
    doi:10.1063/1.1628670.

    Raises InputError if no pair force has an epsilon and a sigma."""
    cores = [each for each in system.forces if isinstance(each, PairForce) and {"epsilon", "sigma"} <= {*each.law_keys}]
    if not cores:
        raise InputError('minimize: soft = true needs a pair force with epsilon and sigma, such as "lennard-jones"')
    laws = {pair: cores[0].pair_law(*pair) for pair in combinations_with_replacement(sorted(system.species), 2)}
    epsilon, sigma = (max(getattr(law, key) for law in laws.values()) for key in ("epsilon", "sigma"))
    others = [each for each in system.forces if getattr(each, "kind", "") in ("angles", "dihedrals", "impropers")]
    if system.topology is not None and len(system.topology.bonds):
        others.append(_springs(system, SPRING * epsilon / sigma**2))
    pairs: Any = SoftPair  # a force, once `pair_law` has made it
    for strength in STRENGTHS:
        tables = {pair: {"A": strength * law.epsilon, "sigma": WELL * law.sigma} for pair, law in laws.items()}
        soft = pairs(pairs=tables, cutoff=WELL * sigma)
        yield system.with_forces(soft, *others), FORCE * epsilon / sigma


def _springs(system: System, stiffness: float) -> Any:
    """Springs of the mean present length of each type of bond."""
    assert system.topology is not None
    first, second = system.topology.bonds.T
    x = system.state.phase[0]
    lengths = np.linalg.norm(system.box.minimum_image((x[:, first] - x[:, second]).T), axis=1)
    kinds = np.array(system.topology.types("bonds"))
    means = {str(kind): {"length": float(lengths[kinds == kind].mean())} for kind in np.unique(kinds)}
    springs: Any = HarmonicBond
    return springs(stiffness=stiffness, length=float(lengths.mean()), types=means)

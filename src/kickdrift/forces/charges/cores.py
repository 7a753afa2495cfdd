"""Opposite charges that no core keeps apart, so that they can fall into each other."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from kickdrift.forces.bonded.law import BondedForce
from kickdrift.forces.charges.coulomb import Coulomb
from kickdrift.forces.pairs.law import PairForce

if TYPE_CHECKING:
    from kickdrift.model.subject import Subject

CLOSE = 0.01  # distance at which energies are compared, in mean distances of particles
PAIRS = 10_000_000  # distances that a search computes at most


def coreless_pair(force: Coulomb, system: Subject) -> tuple[int, int] | None:
    """Rows of two near particles with opposite charges and nothing that keeps them apart; None without such a pair.

    Particles with bonds, constraints or exclusions count as kept apart by the core of another site, as the hydrogen of
    water is. Forces other than pair forces may be a core, and then no pair is named."""
    beside = [each for each in system.forces if not isinstance(each, BondedForce | Coulomb)]
    if not all(isinstance(each, PairForce) for each in beside):
        return None
    charges, species, x = force.scaled_charges(system), system.species_index, np.asarray(system.state.positions)
    free = np.ones(len(x), bool)
    if system.topology is not None:
        free[system.topology.bonds.ravel()] = False
        free[system.topology.scaled.pairs.ravel()] = False
    if system.constraints is not None:
        free[system.constraints.pairs.ravel()] = False
    n = len(x)
    volume = system.volume if np.isfinite(system.volume) else float(np.prod(np.ptp(x, axis=0) + 1.0))
    r = CLOSE * (volume / n) ** (1.0 / 3.0)

    def falls(a: int, b: int, product: float) -> bool:
        core = sum(each.pair_law(system.species[a], system.species[b]).law(r * r)[0] for each in beside)
        return core < -product / r

    ups, downs = np.flatnonzero(free & (charges > 0)), np.flatnonzero(free & (charges < 0))
    nearest, found = np.inf, None
    attracted = {
        (a, b): falls(a, b, charges[ups][species[ups] == a].max() * charges[downs][species[downs] == b].min())
        for a in np.unique(species[ups]).tolist()
        for b in np.unique(species[downs]).tolist()
    }
    if not any(attracted.values()):
        return None
    for i in ups[: max(1, PAIRS // n)].tolist():
        others = downs[[attracted[species[i], b] for b in species[downs].tolist()]]
        if not len(others):
            continue
        r2 = np.square(system.box.minimum_image(x[i] - x[others])).sum(axis=1)
        if r2.min() < nearest:
            nearest, found = r2.min(), (i, int(others[r2.argmin()]))
    return found

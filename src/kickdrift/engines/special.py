"""Factors of pair forces between relatives along bonds, one for Lennard-Jones and one for charges, as LAMMPS has them.

A System may also have exclusions and listed pairs, as force fields of proteins do. They are such factors where each of
the pairs that are equally many bonds apart has the same share of the pair forces.
"""

from typing import Any, NamedTuple

import numpy as np

from kickdrift.forces.bonded.own_pairs import ListedPairs
from kickdrift.forces.pairs.lennard_jones import LennardJones
from kickdrift.model.molecules.relatives import Ids, Relatives, within
from kickdrift.model.molecules.topology import APART
from kickdrift.model.state import Floats
from kickdrift.model.system import System

SAME = 1e-7  # between equal shares, relative; files of force fields have eight digits
WHOLE = (1.0, 1.0, 1.0)


class Special(NamedTuple):
    """Factors of pairs one, two and three bonds apart, for Lennard-Jones and for charges."""

    lennard_jones: tuple[float, ...] = WHOLE
    charges: tuple[float, ...] = WHOLE


def special_of(system: System, pair_force: Any) -> Special | str:
    """The factors, or the reason why there are none. ``pair_force`` is the System's Lennard-Jones force, or None."""
    topology = system.topology
    listed = [force for force in system.forces if isinstance(force, ListedPairs)]
    if topology is None:
        return "listed-pairs: LAMMPS scales pairs by their bonds, and the system has none" if listed else Special()
    if not len(topology.exclusions) and not listed:
        return Special(*(tuple(topology.factors or WHOLE),) * 2)
    other = pair_force is not None and (type(pair_force), getattr(pair_force, "truncation", "")) != (
        LennardJones,
        "cut",
    )
    if listed and other:
        return 'listed-pairs: LAMMPS scales pairs beside lennard-jones with truncation "cut"'
    known, terms = _listed(system, listed)
    special = topology.scaled.pairs
    relatives = Relatives.of(topology.bonds)
    for pairs, what in ((special, "leaves out"), (known, "lists")):
        left = pairs[~within(pairs, np.concatenate(relatives))]
        if len(left):
            return f"topology: LAMMPS scales pairs one to three bonds apart, and this one {what} {left[0].tolist()}"
    found: list[tuple[float, float]] = []
    for pairs, apart in zip(relatives, APART, strict=True):
        factors = _shares(system, pair_force, pairs, known, terms)
        if factors is None:
            return f"topology: pairs that are {apart} have several factors, and LAMMPS has one"
        found.append(factors)
    wells, charges = zip(*found, strict=True)
    return Special(wells, charges)


def _listed(system: System, forces: list[ListedPairs]) -> tuple[Ids, Floats]:
    """Listed pairs (m, 2), and epsilon, sigma and the product of charges (m, 3) of each, in rising order."""
    rows = [
        np.column_stack([np.sort(np.array(force.pairs).reshape(-1, 2), axis=1),
                         *(np.broadcast_to(value, len(force.pairs))
                           for value in (force.epsilon, force.sigma, force.charges))])
        for force in forces
    ]  # fmt: skip
    every = np.concatenate([np.zeros((0, 5)), *rows])
    every = every[np.lexsort((every[:, 1], every[:, 0]))]
    return every[:, :2].astype(np.int64), every[:, 2:]


def _shares(system: System, pair_force: Any, pairs: Ids, known: Ids, terms: Floats) -> tuple[float, float] | None:
    """Factors of Lennard-Jones and of charges that all these pairs share, or None."""
    assert system.topology is not None
    i, j = pairs.T
    factors = system.topology.factor_of(i, j)
    depth, length = _laws(system, pair_force)
    kinds, charges = system.species_index, np.zeros(len(system)) if system.charges is None else system.charges
    whole, sigma, product = depth[kinds[i], kinds[j]], length[kinds[i], kinds[j]], charges[i] * charges[j]
    wells, between = factors * whole, factors * product
    at = within(pairs, known)
    if at.any():
        mine = terms[within(known, pairs)]  # both in rising order
        if len(mine) != at.sum() or ((mine[:, 0] != 0) & (np.abs(mine[:, 1] - sigma[at]) > SAME * sigma[at])).any():
            return None
        wells[at] += mine[:, 0]
        between[at] += mine[:, 2]
    found = []
    for part, of in ((wells, whole), (between, product)):
        acting = np.abs(of) > 0
        share = (
            float(np.median(part[acting] / of[acting])) if acting.any() else float(factors[0]) if len(pairs) else 1.0
        )
        if np.abs(part - share * of).max(initial=0.0) > SAME * np.abs(of).max(initial=0.0):
            return None
        found.append(share)
    return found[0], found[1]


def _laws(system: System, pair_force: Any) -> tuple[Floats, Floats]:
    """Epsilon and sigma of each pair of species; zero without such a force."""
    shape = (len(system.species),) * 2
    if pair_force is None or not hasattr(pair_force, "pair_law"):
        return np.zeros(shape), np.zeros(shape)
    laws = [[pair_force.pair_law(a, b) for b in system.species] for a in system.species]
    found = [[[getattr(law, key, 1.0) for law in row] for row in laws] for key in ("epsilon", "sigma")]
    return np.array(found[0], float), np.array(found[1], float)

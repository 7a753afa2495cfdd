"""Relatives along bonds: angles, dihedrals, and pairs one to three bonds apart; and their distances and angles."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from kickdrift.model.box.box import Box
from kickdrift.model.state import Floats

Ids = NDArray[np.int64]


class Relatives(NamedTuple):
    """Pairs (m, 2), i < j, whose shortest path along bonds has one, two or three bonds."""

    bonded: Ids
    two_apart: Ids
    three_apart: Ids

    @classmethod
    def of(cls, bonds: Ids) -> Relatives:
        """Relatives along bonds (b, 2)."""
        return cls(*(_sorted(paths[:, [0, -1]]) for paths in shortest_paths(bonds)))


def shortest_paths(bonds: Ids) -> list[Ids]:
    """Paths of one, two and three bonds (m, 2 to 4) whose ends no shorter path joins."""
    found: list[Any] = []
    ends: list[Any] = []
    for paths in (bonds, angles_of(bonds), dihedrals_of(bonds)):
        pairs = np.sort(paths[:, [0, -1]], axis=1)
        kept = np.ones(len(pairs), bool)
        for nearer in ends:
            kept &= ~within(pairs, nearer)
        found.append(paths[kept])
        ends.append(_sorted(pairs[kept]))
    return found


def _sorted(pairs: Ids) -> Ids:
    """Different pairs in rising order, each with its smaller number first."""
    return np.unique(np.sort(pairs.reshape(-1, 2), axis=1), axis=0)


def within(pairs: Ids, others: Ids) -> NDArray[np.bool_]:
    """Whether each pair is among the others."""
    base = int(max(pairs.max(initial=0), others.max(initial=0))) + 1
    return np.isin(pairs[:, 0] * base + pairs[:, 1], others[:, 0] * base + others[:, 1])


def neighbours_of(bonds: Ids) -> tuple[Ids, Ids]:
    """Bonded partners of each particle: ``partner[start[i] : start[i + 1]]``, in rising order."""
    both = np.concatenate([bonds, bonds[:, ::-1]])
    both = both[np.lexsort((both[:, 1], both[:, 0]))] if len(both) else both.reshape(0, 2)
    count = np.bincount(both[:, 0], minlength=int(both.max(initial=-1)) + 1)
    return np.concatenate([[0], np.cumsum(count)]).astype(np.int64), both[:, 1].copy()


def _extended(paths: Ids, start: Ids, partner: Ids) -> Ids:
    """Paths with each further bond of their last particle that does not lead back to the particle before."""
    last = paths[:, -1]
    count = start[last + 1] - start[last]
    rows = np.repeat(np.arange(len(paths)), count)
    within = np.arange(len(rows)) - np.repeat(np.cumsum(count) - count, count)
    found = np.column_stack([paths[rows], partner[start[last[rows]] + within]])
    return found[(found[:, -1:] != found[:, :-1]).all(axis=1)]


def _paths(bonds: Ids, particles: int) -> Ids:
    """All paths of so many particles along bonds, each once, in rising order of their middle."""
    bonds = np.asarray(bonds, np.int64).reshape(-1, 2)
    start, partner = neighbours_of(bonds)
    found = np.concatenate([bonds, bonds[:, ::-1]])
    for _ in range(particles - 2):
        found = _extended(found, start, partner)
    found = found[found[:, 0] < found[:, -1]]
    order = np.lexsort((found[:, -1], found[:, 0], *found[:, -2:0:-1].T))
    found = np.ascontiguousarray(found[order])
    found.flags.writeable = False
    return found


def angles_of(bonds: Ids) -> Ids:
    """All angles (a, 3) between two bonds that share a particle, the middle one."""
    return _paths(bonds, 3)


def dihedrals_of(bonds: Ids) -> Ids:
    """All chains (d, 4) of three bonds."""
    return _paths(bonds, 4)


def molecules_of(bonds: Ids, particles: int) -> Ids:
    """Molecule of each particle (n,), numbered from 0 in the order of the first particles."""
    from scipy.sparse import coo_array
    from scipy.sparse.csgraph import connected_components

    joined = coo_array((np.ones(len(bonds), np.int8), (bonds[:, 0], bonds[:, 1])), shape=(particles, particles))
    found: Ids = connected_components(joined, directed=False)[1].astype(np.int64)
    return found


def whole(bonds: Ids, particles: int, steps: Callable[[Ids, Ids], Floats]) -> Floats:
    """Positions (n, 3) of particles along the bonds from the first particle of their molecule.

    ``steps(i, j)`` returns the separations (m, 3) from particles i to particles j."""
    from scipy.sparse import coo_array
    from scipy.sparse.csgraph import breadth_first_order

    _, firsts = np.unique(molecules_of(bonds, particles), return_index=True)
    i = np.concatenate([bonds[:, 0], firsts])
    j = np.concatenate([bonds[:, 1], np.full(len(firsts), particles)])  # a root that joins all molecules
    joined = coo_array((np.ones(len(i), np.int8), (i, j)), shape=(particles + 1,) * 2).tocsr()
    _, before = breadth_first_order(joined, particles, directed=False)
    before[particles] = particles
    found, inner = np.zeros((particles + 1, 3)), np.flatnonzero(before[:-1] != particles)
    found[inner] = steps(before[inner], inner)
    while (before != particles).any():
        found, before = found + found[before], before[before]
    return found[:-1]


LONGEST = 0.49  # of the least height of a box: near half of it, a bond's nearest image is uncertain


class Measure(NamedTuple):
    """What a list of particles measures: the particles in each item, and the arguments of a law of it."""

    particles: int
    arguments: tuple[str, str]


MEASURED = {
    "bonds": Measure(2, ("p", "r")),
    "angles": Measure(3, ("p", "angle")),
    "dihedrals": Measure(4, ("p", "angle")),
    "impropers": Measure(4, ("p", "angle")),
}


def measured(box: Box, x: Floats, items: NDArray[np.int64], kind: str) -> Floats:
    """Distance, angle, dihedral or improper (m,) of each item (m, 2 to 4) at positions x (3, n); angles in radians."""
    steps = [box.minimum_image((x[:, items[:, k]] - x[:, items[:, k + 1]]).T) for k in range(items.shape[1] - 1)]
    with np.errstate(invalid="ignore"):
        if kind == "bonds":
            return np.asarray(np.sqrt((steps[0] ** 2).sum(axis=1)))
        if kind == "angles":
            normal = np.cross(steps[0], steps[1])
            return np.arctan2(np.linalg.norm(normal, axis=1), -(steps[0] * steps[1]).sum(axis=1))
        first, second = np.cross(steps[0], steps[1]), np.cross(steps[1], steps[2])
        middle = np.linalg.norm(steps[1], axis=1)
        return np.arctan2(-(steps[0] * second).sum(axis=1) * middle, (first * second).sum(axis=1))

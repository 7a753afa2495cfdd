"""Bonds between particles of a view, and the molecules that bonds make."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from kickdrift.forces.fields.shipped import Springs

if TYPE_CHECKING:
    from kickdrift.model.system import System

MOST_BONDS = 10_000  # more bonds are not drawn


def pairs_of(system: System) -> NDArray[np.int64]:
    """Rows (b, 2) of the particles at both ends of each bond: those of the topology and of springs."""
    found = [np.zeros((0, 2), dtype=np.int64)]
    if system.topology is not None:
        found.append(np.asarray(system.topology.bonds, dtype=np.int64).reshape(-1, 2))
    found += [np.asarray(force.pairs, dtype=np.int64) for force in system.forces if isinstance(force, Springs)]
    pairs = np.concatenate(found)
    return pairs if len(pairs) <= MOST_BONDS else pairs[:0]


def molecules_of(pairs: NDArray[np.int64], count: int) -> NDArray[np.int64]:
    """Number of the molecule (count,) of each particle; a particle without bonds is a molecule of its own."""
    from scipy.sparse import coo_array
    from scipy.sparse.csgraph import connected_components

    graph = coo_array((np.ones(len(pairs)), (pairs[:, 0], pairs[:, 1])), shape=(count, count))
    found: NDArray[np.int64] = connected_components(graph, directed=False)[1]
    return found

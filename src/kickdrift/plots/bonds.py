"""Bonds between the spheres of views and films."""

import numpy as np

from kickdrift.forces.fields.shipped import Springs
from kickdrift.model.molecules.relatives import Ids
from kickdrift.model.system import System

MOST_BONDS = 10_000  # more bonds are not drawn
STICK = 0.6  # factor of the spheres' sizes where bonds are drawn


def pairs_of(system: System) -> Ids:
    """Rows (b, 2) of the particles at both ends of each bond: those of the topology and of springs."""
    found = [np.zeros((0, 2), dtype=np.int64)]
    if system.topology is not None:
        found.append(np.asarray(system.topology.bonds, dtype=np.int64).reshape(-1, 2))
    found += [np.asarray(force.pairs, dtype=np.int64) for force in system.forces if isinstance(force, Springs)]
    pairs = np.concatenate(found)
    return pairs if len(pairs) <= MOST_BONDS else pairs[:0]

"""Particles of a view: sizes of their spheres, bonds between them, and the molecules that bonds make."""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from kickdrift.forces.fields.shipped import Springs
from kickdrift.model.state import Floats
from kickdrift.model.system import System

SAMPLED = 2000  # particles whose nearest neighbour is sought
HEAVY = 1e-6  # of the largest mass; where most bodies have less, the others are drawn larger
TOUCHING = 0.48  # radius over the distance of nearest neighbours


def radii_of(system: System, x: Floats, count: int, rows: slice) -> Floats:
    """Radius of each shown particle (k,): the body's own; else half the distance of neighbours, times the relative
    sigma of its species; 0 under gravity without radii."""
    if system.radii is not None:
        own = np.zeros(max(count, len(system.radii)))
        own[: len(system.radii)] = system.radii
        return own[rows] if len(own) > count else own
    if not system.box.periodic and not _pair_sizes(system):
        return np.zeros(count)
    radii = np.full(count, TOUCHING * _neighbour(x))
    sizes = _pair_sizes(system)
    kinds = system.species_index[rows]
    if sizes and len(kinds) == count:
        of_kind = np.array([sizes.get(kind, np.nan) for kind in system.species])
        if np.all(of_kind > 0):
            radii = 0.5 * of_kind[kinds]
    return radii


def pixels_of(masses: Floats, central: int | None, kind: str) -> Floats:
    """Least radius of each sphere on the screen, in pixels: bodies far apart would be too small to see."""
    if kind == "box":
        return np.full(len(masses), 0.6)
    if kind == "open":
        heavy = masses >= HEAVY * masses.max(initial=0.0)
        return np.where(heavy & (3 * heavy.sum() < len(masses)), 6.0, np.clip(60 / len(masses) ** 0.5, 1.6, 6.0))
    mass = np.where(masses > 0, masses, np.nan)
    wide = np.log10(mass / np.nanmin(mass)) if np.isfinite(mass).any() else np.zeros(len(masses))
    most = np.nanmax(wide) if np.isfinite(wide).any() else 0.0
    size = 4.5 + 3.5 * np.nan_to_num(wide) / max(float(most), 3.0)
    if central is not None:
        size[central] = 10.0
    return size


def _pair_sizes(system: System) -> dict[str, float]:
    """Sigma of each species under a pair force that has one."""
    for force in system.forces:
        sigma: Any = getattr(force, "sigma", None)
        if not isinstance(sigma, int | float) or not sigma > 0:
            continue
        sizes = dict.fromkeys(system.species, float(sigma))
        for name, table in (getattr(force, "species", None) or {}).items():
            if isinstance(table, dict) and "sigma" in table:
                sizes[name] = float(table["sigma"])
        for pair, table in (getattr(force, "pairs", None) or {}).items():
            names = pair.split("-") if isinstance(pair, str) else list(pair)
            if len(names) == 2 and names[0] == names[1] and isinstance(table, dict) and "sigma" in table:
                sizes[names[0]] = float(table["sigma"])
        return sizes
    return {}


def _neighbour(x: Floats) -> float:
    """Typical distance of nearest neighbours."""
    if len(x) < 2:
        return 1.0
    from scipy.spatial import cKDTree

    some = x[:: max(1, len(x) // SAMPLED)]
    far = cKDTree(x).query(some, k=2)[0][:, 1]
    return float(np.median(far)) or 1.0


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

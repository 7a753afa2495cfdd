"""Particles of a view: sizes of their spheres."""

from typing import Any

import numpy as np

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

"""Binaries of a cluster: pairs of stars that are bound to each other, with their energies and orbits."""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from kickdrift.analysis.clusters.stars import Stars, stars_of
from kickdrift.errors import InputError
from kickdrift.model.checks.values import number
from kickdrift.model.state import Floats
from kickdrift.text import shown

NEAREST = 6  # neighbours among which a star's partner is looked for


class Binary(NamedTuple):
    """Two stars that are bound to each other.

    Attributes
    ----------
    first, second : numbers of the stars among the system's bodies
    energy : energy of the relative motion, negative
    hardness : -energy over kT, where 3 kT / 2 is the mean kinetic energy of single stars and of centres of binaries
    semi_major_axis, eccentricity, period : of the osculating orbit
    """

    first: int
    second: int
    energy: float
    hardness: float
    semi_major_axis: float
    eccentricity: float
    period: float


class Pairs(NamedTuple):
    """Pairs of stars, each star in at most one pair: numbers (k, 2) and energies (k,), the hardest pair first."""

    stars: NDArray[np.int64]
    energies: Floats
    semi_major_axes: Floats
    eccentricities: Floats
    periods: Floats

    def harder(self, least: float) -> Pairs:
        """The pairs with at least this binding energy."""
        return Pairs._make(each[-self.energies >= least] for each in self)

    def within(self, chosen: NDArray[np.bool_]) -> Pairs:
        """The pairs of two chosen stars; ``chosen`` (n,)."""
        return Pairs._make(each[chosen[self.stars].all(axis=1)] for each in self)


def binaries(source: Any, least_hardness: float = 1.0) -> tuple[Binary, ...]:
    """Binaries of a cluster, the hardest first.

    Two stars are a binary if each is the other's most strongly bound partner among its six nearest neighbours, and if
    their binding energy is at least ``least_hardness`` kT. Pairs below some kT are bound by chance and soon part
    (Heggie 1975, doi:10.1093/mnras/173.3.729).

    Parameters
    ----------
    source : a System, a Simulation, or a frame such as ``run[-1]``
    least_hardness : in kT; 0 for every bound pair

    Raises
    ------
    InputError
        Without gravity, in a periodic box, for fewer than two massive bodies, and for a negative hardness.
    """
    least = number(least_hardness)
    if not least >= 0:
        raise InputError(f"binaries: least_hardness must be a number of kT, 0 or more, got {shown(least_hardness)}")
    stars = stars_of(source, "binaries")
    found = pairs_in(stars)
    temperature = temperature_of(stars, found)
    hardness = -found.energies / temperature if temperature > 0 else np.full(len(found.energies), np.inf)
    columns = zip(*found.stars.T, found.energies, hardness, *found[2:], strict=True)
    return tuple(
        Binary(int(i), int(j), *(float(each) for each in values)) for i, j, *values in columns if values[1] >= least
    )


def pairs_in(stars: Stars) -> Pairs:
    """All pairs of stars that are each other's most strongly bound partner."""
    x, v, masses, n = stars.x, stars.v, stars.masses, len(stars.masses)
    count = min(NEAREST + 1, n)
    other = np.asarray(cKDTree(x).query(x, count)[1])
    one = np.broadcast_to(np.arange(n)[:, None], other.shape)
    energy = np.where(other == one, np.inf, _energies(stars, one, other)[0])
    partner = other[np.arange(n), energy.argmin(axis=1)]
    bound = (energy.min(axis=1) < 0) & (partner[partner] == np.arange(n)) & (np.arange(n) < partner)
    first = np.flatnonzero(bound)
    second = partner[first]
    energies, reduced = _energies(stars, first, second)
    gm = stars.gravity * (masses[first] + masses[second])
    a = -gm * reduced / (2.0 * energies)
    spin2 = (np.cross(x[second] - x[first], v[second] - v[first]) ** 2).sum(axis=1)
    e = np.sqrt(np.maximum(0.0, 1.0 - spin2 / (gm * a)))
    order = np.argsort(energies, kind="stable")
    found = Pairs(np.stack([first, second], axis=1), energies, a, e, 2.0 * math.pi * np.sqrt(a**3 / gm))
    return Pairs._make(each[order] for each in found)


def _energies(stars: Stars, one: Any, other: Any) -> tuple[Floats, Floats]:
    """Energy of the relative motion of two stars, and their reduced mass."""
    m, k = stars.masses[one], stars.masses[other]
    r = np.sqrt(((stars.x[other] - stars.x[one]) ** 2).sum(axis=-1))
    u = np.sqrt(((stars.v[other] - stars.v[one]) ** 2).sum(axis=-1))
    reduced = m * k / (m + k)
    with np.errstate(divide="ignore"):
        return reduced * (0.5 * u**2 - stars.gravity * (m + k) / np.sqrt(r**2 + stars.softening**2)), reduced


def temperature_of(stars: Stars, pairs: Pairs) -> float:
    """kT of a cluster: two thirds of the mean kinetic energy of its single stars and of the centres of its pairs."""
    whole = as_single(stars, pairs, np.ones(len(stars.masses), bool))
    v = whole.v - np.average(whole.v, axis=0, weights=whole.masses)
    return float((whole.masses * (v**2).sum(axis=1)).mean() / 3.0)


def as_single(stars: Stars, pairs: Pairs, chosen: NDArray[np.bool_]) -> Stars:
    """The chosen stars (n,), with each pair as one body at its centre of mass."""
    first, second = pairs.stars.T
    x, v, masses = stars.x.copy(), stars.v.copy(), stars.masses.copy()
    total = masses[first] + masses[second]
    for each in (x, v):
        each[first] = (masses[first, None] * each[first] + masses[second, None] * each[second]) / total[:, None]
    masses[first] = total
    kept = chosen.copy()
    kept[second] = False
    return stars._replace(x=x, v=v, masses=masses).some(kept)

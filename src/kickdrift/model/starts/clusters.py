"""Star clusters: Plummer's and King's models with mass functions, mass segregation and primordial binaries."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np

from kickdrift.errors import InputError
from kickdrift.model.checks.limits import check_particles
from kickdrift.model.checks.values import number, numbers, whole_number
from kickdrift.model.starts import king
from kickdrift.model.starts.builders import generator
from kickdrift.model.starts.plummer import MOST_SCALED, directions, draw, pair_sum
from kickdrift.model.state import Floats
from kickdrift.text import choices, shown

# Slopes of dN/dm ~ m^-slope, and the masses in solar masses between them.
MASS_FUNCTIONS: dict[str, tuple[tuple[float, ...], tuple[float, ...]]] = {
    "kroupa": ((0.3, 1.3, 2.3), (0.08, 0.5)),  # Kroupa 2001, doi:10.1046/j.1365-8711.2001.04022.x, eq. 2
    "salpeter": ((2.35,), ()),  # Salpeter 1955, doi:10.1086/145971
}
RANGE = (0.08, 100.0)  # solar masses
MOST_DRAWN = 20_000_000  # stars among which segregation chooses


class Stars(NamedTuple):
    """Stars of a cluster in N-body units: G = 1, the total mass is 1, and the virial radius 1.

    Attributes
    ----------
    positions, velocities : (n, 3); the members of a binary follow one another, binaries first
    masses : (n,)
    total : sum of the masses as they were drawn, in their own unit
    binaries : number of binaries
    """

    positions: Floats
    velocities: Floats
    masses: Floats
    total: float
    binaries: int = 0


def masses_drawn(
    name: str, count: int, seed: int | np.random.Generator, least: float = RANGE[0], most: float = RANGE[1],
    sun: float = 1.0,
) -> Floats:  # fmt: skip
    """Masses (count,) from a mass function, by inversion of its cumulative distribution.

    Parameters
    ----------
    name : "kroupa" or "salpeter"
    seed : a whole number, or a generator of NumPy
    least, most : the range of masses
    sun : the Sun's mass in the unit of these masses

    Raises
    ------
    InputError
        For another name, and for a range that does not begin above zero and end above that.
    """
    if name not in MASS_FUNCTIONS:
        raise InputError(f"masses: expected {choices(MASS_FUNCTIONS, name)}, or numbers, got {shown(name)}")
    if not 0 < number(least) < number(most) < math.inf:
        raise InputError(
            f"mass_range: expected two masses above zero, the smaller one first, got {shown([least, most])}"
        )
    rng = seed if isinstance(seed, np.random.Generator) else generator(seed)
    slopes, between = MASS_FUNCTIONS[name]
    inner = [sun * each for each in between]
    edges = np.array([least, *(each for each in inner if least < each < most), most])
    used = [slopes[sum(each <= low for each in inner)] for low in edges[:-1]]
    factors, parts = [1.0], []
    for k, slope in enumerate(used):
        if k:
            factors.append(factors[-1] * edges[k] ** (slope - used[k - 1]))
        parts.append(factors[k] * _integral(edges[k], edges[k + 1], slope))
    cumulative = np.concatenate([[0.0], np.cumsum(parts)])
    u = rng.random(count) * cumulative[-1]
    place = np.minimum(np.searchsorted(cumulative, u, side="right") - 1, len(used) - 1)
    power = 1.0 - np.array(used)[place]
    return np.asarray(
        (edges[place] ** power + (u - cumulative[place]) * power / np.array(factors)[place]) ** (1 / power)
    )


def _integral(low: float, high: float, slope: float) -> float:
    return float((high ** (1.0 - slope) - low ** (1.0 - slope)) / (1.0 - slope))


def cluster(
    model: str,
    count: int,
    seed: int,
    *,
    W0: float | None = None,
    masses: str | Sequence[float] | None = None,
    mass_range: Sequence[float] | None = None,
    heavy: Mapping[str, float] | None = None,
    segregation: float = 0.0,
    binaries: Mapping[str, Any] | None = None,
    scaled: bool = True,
    sun: float = 1.0,
    length: Any = None,
) -> Stars:
    """Stars of a cluster in equilibrium, in N-body units. The centre of mass is at rest at the origin.

    Parameters
    ----------
    model : "plummer" or "king"
    count : stars, two or more; the two stars of a binary count as two
    W0 : depth of a King model, from 0 to 16
    masses : "kroupa", "salpeter", or a mass for each star; default equal masses
    mass_range : least and largest mass of a mass function; default 0.08 and 100 solar masses
    heavy : ``fraction`` of the stars that are ``ratio`` times as massive as the others: two components
    segregation : from 0, which draws masses without regard to orbits, to 1, where heavier stars have the more bound
        orbits. The density profile stays (Baumgardt, De Marchi & Kroupa 2008, doi:10.1086/590488); numbers between mix
        the order of masses as in Kuepper et al. 2011 (doi:10.1111/j.1365-2966.2011.19412.x)
    binaries : ``fraction`` of the centres of mass that are binaries; ``a``, a semi-major axis or a range of them, drawn
        uniformly in log(a); ``e``, a number or "thermal" (default), the density 2 e. Stars are paired at random
    scaled : stretch lengths and velocities to the exact energy of -1/4 and to virial equilibrium, without the inner
        energy of binaries; refused above 50,000 stars
    sun : the Sun's mass in the unit of the masses
    length : function of the Stars without binaries that returns the N-body unit of length in the unit of ``a``

    Raises
    ------
    InputError
        Names the argument that makes no sense.
    """
    count = whole_number("count", count, 2)
    check_particles("count", count)
    if (model == "king") != (W0 is not None):
        raise InputError("W0: required key is missing for king" if W0 is None else "W0: is for king alone")
    pairs = 0 if binaries is None else _pairs(count, binaries)
    centres = count - pairs
    if centres < 2:
        raise InputError(f"binaries.fraction: leaves one binary alone; expected more stars than count = {count}")
    if scaled and centres > MOST_SCALED:
        raise InputError(
            f"scaled: expected false above {MOST_SCALED} stars, because the energy is summed over all pairs; "
            f"got count = {count}"
        )
    rng = generator(seed)
    given = _masses(count, rng, masses, mass_range, heavy, sun)
    total = float(given.sum())
    own = given / total
    joint = np.concatenate([own[0 : 2 * pairs : 2] + own[1 : 2 * pairs : 2], own[2 * pairs :]])
    x, v = _placed(model, W0, joint, _share("segregation", segregation), rng)
    x -= joint @ x / joint.sum()
    v -= joint @ v / joint.sum()
    if scaled:
        potential, kinetic = -pair_sum(x, joint), 0.5 * float(joint @ np.sum(v**2, axis=1))
        x *= -2.0 * potential
        v *= math.sqrt(0.25 / kinetic)
    if not pairs:
        return Stars(x, v, own, total)
    assert binaries is not None
    unit = 1.0 if length is None else float(length(Stars(x, v, joint, total)))
    d, u = _orbits(pairs, binaries, own[0 : 2 * pairs : 2] + own[1 : 2 * pairs : 2], unit, rng)
    share = (own[1 : 2 * pairs : 2] / joint[:pairs])[:, None]  # of the second star
    found = []
    for whole, apart in ((x, d), (v, u)):
        split = np.stack([whole[:pairs] - share * apart, whole[:pairs] + (1.0 - share) * apart], axis=1)
        found.append(np.concatenate([split.reshape(-1, 3), whole[pairs:]]))
    return Stars(found[0], found[1], own, total, pairs)


def _share(key: str, value: Any) -> float:
    if not 0 <= number(value) <= 1:
        raise InputError(f"{key}: expected a number from 0 to 1, got {shown(value)}")
    return float(value)


def _pairs(count: int, binaries: Mapping[str, Any]) -> int:
    """Number of binaries: f of the centres of mass, where binaries and single stars are ``count`` stars together."""
    fraction = _share("binaries.fraction", binaries.get("fraction"))
    return round(fraction * count / (1.0 + fraction))


def _masses(
    count: int, rng: np.random.Generator, masses: Any, mass_range: Any, heavy: Mapping[str, float] | None, sun: float
) -> Floats:
    """Masses of the stars, in a random order."""
    if mass_range is not None and not isinstance(masses, str):
        raise InputError('mass_range: goes with masses = "kroupa" or "salpeter"')
    if heavy is not None:
        if masses is not None:
            raise InputError("heavy: excludes masses")
        ratio = number(heavy.get("ratio"))
        if not 0 < ratio < math.inf:
            raise InputError(f"heavy.ratio: expected a positive number, got {shown(heavy.get('ratio'))}")
        found = np.ones(count)
        found[: round(_share("heavy.fraction", heavy.get("fraction")) * count)] = ratio
        return sun * rng.permutation(found)
    if masses is None:
        return np.full(count, sun)
    if isinstance(masses, str):
        least, most = (sun * each for each in RANGE) if mass_range is None else mass_range
        return masses_drawn(masses, count, rng, least, most, sun)
    given = numbers("masses", masses, f"{count} numbers")
    if given.shape != (count,):
        raise InputError(f"masses: expected {count} numbers, got {given.size}")
    for i in np.flatnonzero(~(np.isfinite(given) & (given > 0))):
        raise InputError(f"masses[{i}]: expected a mass above zero, got {given[i]:g}")
    return given


def _placed(
    model: str, W0: float | None, masses: Floats, segregation: float, rng: np.random.Generator
) -> tuple[Floats, Floats]:
    """Positions and velocities of stars with these masses."""

    def drawn(count: int) -> tuple[Floats, Floats, Floats]:
        return draw(count, rng) if W0 is None else king.draw(W0, count, rng)

    if segregation == 0.0 or np.ptp(masses) == 0.0:
        return drawn(len(masses))[:2]
    n = len(masses)
    many = max(2 * n, math.ceil(float(masses.sum() / masses.min())))
    if many > MOST_DRAWN:
        raise InputError(f"segregation: chooses among {many:,} orbits, at most {MOST_DRAWN:,}; raise the least mass")
    lightest_first, order = list(np.argsort(masses, kind="stable")), []
    for left in range(n - 1, -1, -1):
        order.append(lightest_first.pop(left - int((left + 1) * (1.0 - rng.random() ** (1.0 - segregation)))))
    x, v, energy = drawn(many)
    by_energy = np.argsort(energy)
    within = np.concatenate([[0.0], np.cumsum(masses[order])]) / masses.sum()
    low = np.floor(within[:-1] * many).astype(int)
    high = np.maximum(np.floor(within[1:] * many).astype(int), low + 1)
    chosen = by_energy[np.minimum(low + (rng.random(n) * (high - low)).astype(int), many - 1)]
    place = np.empty(n, int)
    place[order] = chosen
    return x[place], v[place]


def _orbits(
    count: int, binaries: Mapping[str, Any], masses: Floats, unit: float, rng: np.random.Generator
) -> tuple[Floats, Floats]:
    """Separations and velocities (count, 3) within binaries of these masses, with G = 1 and lengths in ``unit``."""
    given = binaries.get("a")
    ends = list(given) if isinstance(given, Sequence) and not isinstance(given, str) else [given, given]
    if len(ends) != 2 or ends[0] is None or not 0 < number(ends[0]) <= number(ends[1]) < math.inf:
        raise InputError(f"binaries.a: expected a length above zero, or a range of two, got {shown(given)}")
    low, high = (number(each) for each in ends)
    a = low * (high / low) ** rng.random(count) / unit
    e: Any = binaries.get("e", "thermal")
    if e == "thermal":
        eccentricity = np.sqrt(rng.random(count))
    elif not isinstance(e, str) and 0 <= number(e) < 1:
        eccentricity = np.full(count, float(e))
    else:
        raise InputError(f'binaries.e: expected "thermal", or a number from 0 to below 1, got {shown(e)}')
    anomaly = 2.0 * math.pi * rng.random(count)
    eccentric = anomaly + 0.85 * eccentricity * np.sign(np.sin(anomaly))
    for _ in range(60):  # Newton's method from Danby's guess
        eccentric -= (eccentric - eccentricity * np.sin(eccentric) - anomaly) / (1.0 - eccentricity * np.cos(eccentric))
    root, first = np.sqrt(1.0 - eccentricity**2), directions(rng, count)
    other = np.cross(first, directions(rng, count))
    second = other / np.linalg.norm(other, axis=1, keepdims=True)
    cosine, sine = np.cos(eccentric), np.sin(eccentric)
    speed = np.sqrt(masses / a) / (1.0 - eccentricity * cosine)
    d = (a * (cosine - eccentricity))[:, None] * first + (a * root * sine)[:, None] * second
    return d, (-speed * sine)[:, None] * first + (speed * root * cosine)[:, None] * second


def half_mass_radius(stars: Stars) -> float:
    """Distance from the centre of mass within which half of the mass lies."""
    r = np.linalg.norm(stars.positions, axis=1)
    order = np.argsort(r)
    return float(r[order][np.searchsorted(np.cumsum(stars.masses[order]), 0.5 * stars.masses.sum())])

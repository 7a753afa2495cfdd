"""What a cluster is like at one time: its centre, radii, core, relaxation, anisotropy, binaries and escapers."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
from scipy.spatial import cKDTree

from kickdrift.analysis.clusters.binaries import as_single, pairs_in, temperature_of
from kickdrift.analysis.clusters.stars import Stars, potentials, stars_of, tidal_strength
from kickdrift.errors import InputError
from kickdrift.model.checks.values import numbers, positive, whole_number
from kickdrift.model.state import Floats

FRACTIONS = (0.01, 0.05, 0.1, 0.25, 0.5, 0.75, 0.9)
NEIGHBOURS = 6  # Casertano & Hut's own choice
COULOMB = 0.11  # the number before N in Coulomb's logarithm, for equal masses (Giersz & Heggie 1994)
ROUNDS = 20  # most repetitions in the search for bound stars, or for the tidal radius


class Cluster(NamedTuple):
    """A cluster at one time, in the units of its system.

    Attributes
    ----------
    time : of the state
    stars : number of bodies with mass
    centre, velocity : (3,) density centre, and mean velocity of the bound stars
    fractions, lagrangian_radii : (k,) shares of the bound mass, and radii about the density centre that hold them
    half_mass_radius : the Lagrangian radius of one half
    core_radius, core_density, core_mass : mean distance from the density centre and mean mass density, each weighted
        with the local density, and the mass inside the core radius
    relaxation_time : at the half-mass radius
    anisotropy : 1 - (tangential dispersion) / (2 radial dispersion), both squared, of the bound stars: 0 where
        velocities have no direction, 1 for radial orbits, below 0 for round ones
    shell_anisotropy : (k,) the same between one Lagrangian radius and the next; nan for fewer than two stars
    bound_stars, bound_mass : stars with a negative energy relative to the rest, inside twice the tidal radius
    escapers : number of the other stars
    tidal_radius : nan without a galaxy
    binaries : number of pairs with a binding energy of at least kT
    binary_energy : sum of their energies, negative or 0
    hardest : largest binding energy of a pair in kT; 0 without a pair
    temperature : kT, two thirds of the mean kinetic energy of single stars and centres of pairs
    """

    time: float
    stars: int
    centre: Floats
    velocity: Floats
    fractions: Floats
    lagrangian_radii: Floats
    half_mass_radius: float
    core_radius: float
    core_density: float
    core_mass: float
    relaxation_time: float
    anisotropy: float
    shell_anisotropy: Floats
    bound_stars: int
    bound_mass: float
    escapers: int
    tidal_radius: float
    binaries: int
    binary_energy: float
    hardest: float
    temperature: float


def cluster(
    source: Any,
    fractions: Sequence[float] = FRACTIONS,
    *,
    neighbours: int = NEIGHBOURS,
    coulomb: float = COULOMB,
    tidal_radius: float | None = None,
) -> Cluster:
    """Radii, core, relaxation time, anisotropy, binaries and escapers of a star cluster at one time.

    The local density at a star is the mass of its nearest ``neighbours`` but the last, over the volume of the sphere
    that reaches to the last. Density centre, core radius and core density are means with this weight (Casertano & Hut
    1985, doi:10.1086/163589, where the core radius is the density radius). The square of the estimate is too large by
    (neighbours - 1) / (neighbours - 2) on average, and the core density is divided by this factor.

    The half-mass relaxation time is 0.138 N^(1/2) r_h^(3/2) / ((G m)^(1/2) ln(coulomb N)) for N bound stars of mean
    mass m (Spitzer 1987, Dynamical Evolution of Globular Clusters, eq. 2-63; Giersz & Heggie 1994,
    doi:10.1093/mnras/268.1.257, for the factor 0.11).

    A star is bound if its energy is negative, with the potential of all stars and its velocity relative to the bound
    ones. Under fields such as those of a galaxy, the tidal radius is (G M / (Omega^2 + dF_r / dr))^(1/3), with the mass
    M inside it (King 1962, doi:10.1086/108756), about the centre of the field, or the origin. Stars beyond twice
    this radius count as escapers. A pair with a binding energy of kT or more is one body in anisotropy and temperature.

    Parameters
    ----------
    source : a System, a Simulation, or a frame such as ``run[-1]``
    fractions : increasing shares of the bound mass, above 0 and up to 1
    neighbours : of each star for its density, 3 or more
    coulomb : the number before N in Coulomb's logarithm
    tidal_radius : in place of that of the system's fields

    Raises
    ------
    InputError
        Without gravity, in a periodic box, for fewer massive bodies than ``neighbours`` + 1, and for arguments that
        make no sense.
    """
    settings = checked_settings(fractions, neighbours, coulomb, tidal_radius)
    return cluster_in(stars_of(source, "cluster"), *settings)


def checked_settings(
    fractions: Any, neighbours: Any, coulomb: Any, tidal_radius: Any
) -> tuple[Floats, int, float, float | None]:
    shares = numbers("cluster: fractions", fractions)
    if shares.ndim != 1 or not len(shares) or not (np.diff(shares, prepend=0.0) > 0).all() or shares[-1] > 1:
        raise InputError(f"cluster: fractions must increase from above 0 to at most 1, got {fractions}")
    return (
        shares,
        whole_number("cluster: neighbours", neighbours, 3),
        positive("cluster: coulomb", coulomb),
        None if tidal_radius is None else positive("cluster: tidal_radius", tidal_radius, "a positive length"),
    )


def cluster_in(stars: Stars, shares: Floats, neighbours: int, coulomb: float, tidal_radius: float | None) -> Cluster:
    """See `cluster`; the arguments are checked."""
    if len(stars.masses) <= neighbours:
        raise InputError(
            f"cluster: {neighbours} neighbours need {neighbours + 1} bodies with mass or more, got {len(stars.masses)}"
        )
    density = densities(stars, neighbours)
    centre = np.average(stars.x, axis=0, weights=density)
    r = np.linalg.norm(stars.x - centre, axis=1)
    bound, velocity, tide = _bound(stars, centre, r, tidal_radius)
    mass, count = float(stars.masses[bound].sum()), int(bound.sum())
    radii = lagrangian(r[bound], stars.masses[bound], np.append(shares, 0.5))
    core = float(np.average(r, weights=density))
    pairs = pairs_in(stars)
    kt = temperature_of(stars, pairs)
    hard = -pairs.energies >= kt
    single = as_single(stars, pairs.within(bound).harder(kt), bound)
    beta, shells = anisotropies(single, centre, velocity, radii[:-1])
    return Cluster(
        stars.time,
        len(stars.masses),
        centre,
        velocity,
        shares,
        radii[:-1],
        float(radii[-1]),
        core,
        (neighbours - 2) / (neighbours - 1) * float(np.average(density, weights=density)),
        float(stars.masses[r <= core].sum()),
        relaxation_time(stars.gravity, count, mass, float(radii[-1]), coulomb),
        beta,
        shells,
        count,
        mass,
        len(stars.masses) - count,
        tide,
        int(np.count_nonzero(hard)),
        float(pairs.energies[hard].sum()),
        float(-pairs.energies[0] / kt) if len(pairs.energies) and kt > 0 else 0.0,
        kt,
    )


def densities(stars: Stars, neighbours: int) -> Floats:
    """Mass density (n,) at each star: the mass of all of its nearest neighbours but the last, over the volume of the
    sphere that reaches to the last. For equal masses the mean of this estimate is the density (Casertano & Hut 1985,
    eq. II.2). Stars in one place share a volume that is not 0."""
    distance, which = cKDTree(stars.x).query(stars.x, neighbours + 1)
    own = which == np.arange(len(stars.x))[:, None]  # a star at the same place may come first
    own[:, -1] |= ~own.any(axis=1)
    inner = np.where(own, 0.0, stars.masses[which])
    mass = inner.sum(axis=1) - stars.masses[which[:, -1]]
    reach = np.maximum(distance[:, -1], np.finfo(float).tiny ** (1 / 3))
    return np.asarray(mass / (4.0 / 3.0 * math.pi * reach**3))


def lagrangian(r: Floats, masses: Floats, shares: Floats) -> Floats:
    """Radii (k,) that hold shares of the mass, between the two stars where the sum of masses passes the share."""
    if not len(r):
        return np.full(len(shares), np.nan)
    order = np.argsort(r)
    inside = np.cumsum(masses[order])
    return np.asarray(np.interp(shares * inside[-1], inside - 0.5 * masses[order], r[order]))


def anisotropies(stars: Stars, centre: Floats, velocity: Floats, radii: Floats) -> tuple[float, Floats]:
    """Anisotropy 1 - <v_t^2> / (2 <v_r^2>), weighted with masses, of all stars and between the radii."""
    d, u = stars.x - centre, stars.v - velocity
    r = np.linalg.norm(d, axis=1)
    inwards = (d * u).sum(axis=1) / np.where(r > 0, r, 1.0)
    radial, all_ = stars.masses * inwards**2, stars.masses * (u**2).sum(axis=1)
    shell = np.searchsorted(radii, r)
    size = len(radii)
    along, every, many = (np.bincount(shell, weights, size + 1)[:size] for weights in (radial, all_, np.ones(len(r))))
    with np.errstate(divide="ignore", invalid="ignore"):
        shells = np.where(many > 1, 1.0 - (every - along) / (2.0 * along), np.nan)
        return float(1.0 - (all_.sum() - radial.sum()) / (2.0 * radial.sum())), shells


def relaxation_time(gravity: float, count: int, mass: float, half_mass_radius: float, coulomb: float) -> float:
    """Half-mass relaxation time, see `cluster`; nan without stars, and where Coulomb's logarithm is not positive."""
    if coulomb * count <= 1.0:
        return math.nan
    return 0.138 * count * math.sqrt(half_mass_radius**3 / (gravity * mass)) / math.log(coulomb * count)


def _bound(stars: Stars, centre: Floats, r: Floats, given: float | None) -> tuple[Any, Floats, float]:
    """Which stars are bound (n,), their mean velocity, and the tidal radius or nan."""
    phi = potentials(stars)
    bound = np.ones(len(r), bool)
    velocity = np.average(stars.v, axis=0, weights=stars.masses)
    tide, strength = math.nan if given is None else given, None
    for turn in range(ROUNDS):
        if given is None and (turn == 0 or strength is not None):
            strength = tidal_strength(stars, centre, velocity)
            tide = math.nan if strength is None else _tidal_radius(stars, r, bound, strength)
        found = 0.5 * ((stars.v - velocity) ** 2).sum(axis=1) + phi < 0
        if not math.isnan(tide):
            found &= r <= 2.0 * tide
        if not found.any() or np.array_equal(found, bound):
            return found, velocity, tide
        bound, velocity = found, np.average(stars.v[found], axis=0, weights=stars.masses[found])
    return bound, velocity, tide


def _tidal_radius(stars: Stars, r: Floats, bound: Any, strength: float) -> float:
    """The radius with r^3 = G M(r) / strength, from outside."""
    masses = np.where(bound, stars.masses, 0.0)
    found = (stars.gravity * masses.sum() / strength) ** (1 / 3)
    for _ in range(ROUNDS):
        later = (stars.gravity * masses[r <= found].sum() / strength) ** (1 / 3)
        if later == found or later == 0.0:
            break
        found = later
    return float(found)

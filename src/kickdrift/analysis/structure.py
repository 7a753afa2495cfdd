"""Structure of particles around each other: the radial distribution function and the structure factor."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from kickdrift.analysis.vectors import Source, Vectors, vectors_of
from kickdrift.analysis.waves import Waves, in_shells, reciprocal
from kickdrift.errors import InputError
from kickdrift.model.box import Box
from kickdrift.model.state import Floats
from kickdrift.statistics.blocks import mean_over_frames

CLOSED = "needs a box periodic along all axes, or particles in one plane of a box open along z"
PLANE = (True, True, False)  # axes of a box that is periodic in two dimensions


class RadialDistribution(NamedTuple):
    """g(r) in bins, each field (bins,): centres, values, standard errors and ``coordination``.

    Errors are infinite if there are too few frames. ``coordination`` is the mean number of neighbours within each bin's
    outer edge."""

    r: Floats
    g: Floats
    error: Floats
    coordination: Floats
    frames: int


class StructureFactor(NamedTuple):
    """S(k) in shells of wave vectors, each field (m,): mean |k|, values, standard errors, and numbers of vectors.

    Errors are infinite if there are too few frames. k and -k count as one vector."""

    k: Floats
    s: Floats
    error: Floats
    vectors: NDArray[np.int64]
    frames: int


def radial_distribution(
    source: Source,
    box: Box | Sequence[float] | None = None,
    r_max: float | None = None,
    bins: int = 200,
    *,
    pair: tuple[str, str] | None = None,
    species: Sequence[str] | None = None,
) -> RadialDistribution:
    """Radial distribution function g(r) of particles in a periodic box, averaged over frames.

    g is the number of ordered pairs (i, j ≠ i) with r in a bin, divided by that of n(n-1) independent pairs spread
    evenly: n(n-1) (4π/3)(r₊³ - r₋³) / V; n_a n_b for two species. In two dimensions, with the box open along z and z
    equal for all, the shell is π(r₊² - r₋²) / A. So g is 1 on average for an ideal gas, whatever n is.
    (Allen & Tildesley, Computer Simulation of Liquids, 2nd ed. 2017, section 8.2, eq. 8.15,
    doi:10.1093/oso/9780198803195.001.0001; there with n^2 for n(n-1).) The error is by block averages over frames.
    Parameters
    ----------
    source : a run, open or by its path, or some of its frames, ``run[100::10]``; or positions (n, 3) or (frames, n, 3),
        wrapped or not
    box : three edge lengths, or a periodic Box; with positions alone
    r_max : largest distance; default and upper limit half the least of the box's heights. The heights of a rectangular
        box are its edges
    bins : number of bins of equal width between 0 and r_max
    pair : two species: g of the second around the first; default all particles of any species
    species : (n,) names; with positions alone

    Raises InputError for an open box, an r_max beyond half the least height, or a species that is not there.
    """
    found = vectors_of(source, "positions", box=box, species=species)
    plane = found.box.periodic_axes == PLANE
    _check_periodic(found, "radial_distribution")
    if not (plane or all(found.box.periodic_axes)):
        raise InputError(f"radial_distribution: {CLOSED}")
    if bins < 1:
        raise InputError(f"radial_distribution: expected one bin or more, got {bins}")
    half = float(found.box.heights.min()) / 2
    r_max = half if r_max is None else float(r_max)
    if not 0 < r_max <= half:
        raise InputError(
            f"radial_distribution: r_max = {r_max:g} is not in (0, {half:g}], half the least height of the box"
        )
    first, second = _members(found, pair)
    unlike = first is not second
    ordered = len(first) * (len(second) if unlike else len(first) - 1)
    if ordered < 1:
        raise InputError(f"radial_distribution: expected two particles or more, n >= 2, got {len(first)}")
    chosen = np.concatenate([first, second]) if unlike else first
    kinds = (np.arange(len(chosen)) >= len(first)).astype(np.int64) if unlike else np.zeros(len(chosen), np.int64)
    edges = np.linspace(0.0, r_max, bins + 1)
    if plane:
        ideal = ordered * np.pi * np.diff(edges**2) / found.box.area
    else:
        ideal = ordered * 4 / 3 * np.pi * np.diff(edges**3) / found.box.volume

    from kickdrift.analysis.pair_counts import pair_counts

    frames = map(_in_plane if plane else _in_space, found.each())
    twice = 1 if unlike else 2  # a pair of one kind counts from both ends
    counts = (twice * pair_counts(x[chosen], found.box, kinds, unlike, r_max, bins) for x in frames)
    g = mean_over_frames(len(found), (row / ideal for row in counts))
    coordination = np.cumsum(g.value * ideal) / len(first)
    return RadialDistribution((edges[1:] + edges[:-1]) / 2, g.value, g.error, coordination, len(found))


def structure_factor(
    source: Source,
    box: Box | Sequence[float] | None = None,
    k_max: float | None = None,
    width: float | None = None,
    *,
    vectors: ArrayLike | None = None,
) -> StructureFactor:
    """Static structure factor S(k) = <|sum of exp(-i k·r)|²> / n on the wave vectors that fit a periodic box.

    These are k = a a* + b b* + c c*, with whole a, b, c not all zero and the reciprocal vectors of the edges. In a
    rectangular box a* is 2π/Lx along x (Allen & Tildesley 2017, section 8.2, doi:10.1093/oso/9780198803195.001.0001).
    An average over shells takes all vectors up to ``k_max``. Along an open axis k is zero. S is 1 for an ideal gas, n
    at a Bragg peak of a perfect crystal. The error is by block averages of a shell's or vector's values over frames.
    The cost of a frame grows as n times the number of vectors, so as n^2 at the default ``k_max``.

    Parameters
    ----------
    source : a run, open or by its path, or some of its frames, ``run[100::10]``; or positions (n, 3) or (frames, n, 3),
        wrapped or not
    box : three edge lengths, or a periodic Box; with positions alone
    k_max : largest |k|; default 3π over the mean distance (V/n)^(1/3), in a plane (A/n)^(1/2), beyond the first peak
        of a liquid
    width : width of the shells; default half the smallest |k|, π over the longest edge of a rectangular box
    vectors : (m, 3) whole numbers a, b, c; each is then a shell of its own, in the given order
    """
    found = vectors_of(source, "positions", box=box)
    _check_periodic(found, "structure_factor")
    units = reciprocal(found.box)
    if vectors is None:
        wanted, shell, shells = in_shells(found.box, units, found.particles, k_max, width)
    else:
        wanted = np.asarray(vectors)
        if wanted.ndim != 2 or wanted.shape[1] != 3 or not len(wanted) or np.any(wanted != np.rint(wanted)):
            raise InputError(f"structure_factor: vectors: expected whole numbers of shape (m, 3), got {vectors}")
        if wanted[:, ~units.any(axis=1)].any():
            along = found.box.described("")
            raise InputError(f"structure_factor: vectors: expected 0 along open axes; the box is {along}")
        wanted, shell, shells = wanted.astype(np.int64), np.arange(len(wanted)), len(wanted)
    each = np.bincount(shell, minlength=shells)
    k = np.bincount(shell, np.linalg.norm(wanted @ units, axis=1), shells) / each
    waves = Waves.of(wanted, units)
    rows = (np.bincount(shell, waves.intensity(x), shells) / each for x in found.each())
    s = mean_over_frames(len(found), rows)
    return StructureFactor(k, s.value, s.error, each, len(found))


def _check_periodic(found: Vectors, name: str) -> None:
    if not found.box.periodic:
        raise InputError(f"{name}: needs a periodic box; an open system has no density")


def _in_plane(x: Floats) -> Floats:
    if np.any(x[:, 2] != x[0, 2]):
        raise InputError(f"radial_distribution: {CLOSED}")
    return x


def _in_space(x: Floats) -> Floats:
    if len(x) > 2 and not np.ptp(x, axis=0).all():
        axis = "xyz"[int(np.argmin(np.ptp(x, axis=0)))]
        raise InputError(
            f"radial_distribution: all particles have the same {axis}, and spheres around them have no uniform "
            "density; run the layer with dimensions = 2 (z constant), or give a Box that is open along z"
        )
    return x


def _members(found: Vectors, pair: tuple[str, str] | None) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Particles of the two species; the same array twice if the species are equal."""
    if pair is None:
        every = np.arange(found.particles)
        return every, every
    if isinstance(pair, str) or len(pair) != 2:
        raise InputError(f"radial_distribution: pair: expected two species, got {pair!r}")
    members = {name: np.flatnonzero(found.species == name) for name in pair}
    for name, those in members.items():
        if not those.size:
            known = ", ".join(sorted(set(found.species)))
            raise InputError(f"radial_distribution: pair: no species {name!r}; known are {known}")
    return members[pair[0]], members[pair[1]]

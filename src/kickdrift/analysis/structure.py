"""How particles are arranged around each other: the radial distribution function and the structure factor."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from kickdrift.analysis.vectors import Source, Vectors, vectors_of
from kickdrift.errors import InputError
from kickdrift.model.box import Box
from kickdrift.model.state import Floats
from kickdrift.statistics.blocks import mean_over_frames

REACH = 1.5  # times 2π over the mean distance (V/n)^(1/3): how far S(k) goes unless told, past a liquid's first peak
ROOM = 2**22  # complex numbers of one product that are in memory at once


class RadialDistribution(NamedTuple):
    """g(r) in bins, each (bins,): centres, values, standard errors (infinite where there are too few frames to tell)
    and ``coordination``, the mean number of neighbours within each bin's outer edge."""

    r: Floats
    g: Floats
    error: Floats
    coordination: Floats
    frames: int


class StructureFactor(NamedTuple):
    """S(k) in shells of wave vectors, each (m,): mean |k|, values, standard errors (infinite where there are too few
    frames to tell), and how many vectors, k and -k counted once, are averaged."""

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
    """The radial distribution function g(r) of particles in a periodic box, averaged over frames.

    g is the number of ordered pairs (i, j ≠ i) with r in a bin, over that of n(n-1) independent pairs spread evenly:
    n(n-1) (4π/3)(r₊³ - r₋³) / V; n_a n_b for two species. In two dimensions, where the box is open along z and z is
    the same for all, the shell is π(r₊² - r₋²) / A. So g is 1 on average for an ideal gas, whatever n is.
    (Allen & Tildesley, Computer Simulation of Liquids, 2nd ed. 2017, section 8.2, eq. 8.15,
    doi:10.1093/oso/9780198803195.001.0001; there with n^2 for n(n-1).) The error is by block averages over frames.

    Parameters
    ----------
    source : a run, open or by its path, or some of its frames, ``run[100::10]``; or positions (n, 3) or (frames, n, 3),
        wrapped or not
    box : three edge lengths, or a periodic Box; with positions alone
    r_max : largest distance, by default half the shortest edge, which it cannot pass
    bins : number of bins of equal width between 0 and r_max
    pair : two species, of which the first looks at the second; default all particles, whatever they are
    species : (n,) names; with positions alone

    Raises InputError for an open box, an r_max beyond half the shortest edge, or a species that is not there.
    """
    found = vectors_of(source, "positions", box=box, species=species)
    plane = found.box.periodic_axes == (True, True, False) and not found.box.triclinic
    lengths = found.box.heights if plane else _lengths(found, "radial_distribution")
    if bins < 1:
        raise InputError(f"radial_distribution: expected one bin or more, got {bins}")
    half = min(lengths) / 2
    r_max = half if r_max is None else float(r_max)
    if not 0 < r_max <= half:
        raise InputError(f"radial_distribution: r_max = {r_max:g} is not in (0, {half:g}], half the shortest edge")
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

    frames = map(_in_plane, found.each()) if plane else found.each()
    twice = 1 if unlike else 2  # a pair of one kind is seen from both ends
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
    """The static structure factor S(k) = <|sum of exp(-i k·r)|²> / n on the wave vectors that fit a periodic box.

    These are k = 2π (a/Lx, b/Ly, c/Lz), with whole a, b, c not all zero (Allen & Tildesley 2017, section 8.2,
    doi:10.1093/oso/9780198803195.001.0001), all of them up to ``k_max``, averaged over shells. S is 1 for an ideal gas,
    n at a Bragg peak of a perfect crystal. The error is by block averages over frames of what a shell or vector has in
    each. The cost of a frame grows as n times the number of vectors, so as n^2 at the default ``k_max``.

    Parameters
    ----------
    source : a run, open or by its path, or some of its frames, ``run[100::10]``; or positions (n, 3) or (frames, n, 3),
        wrapped or not
    box : three edge lengths, or a periodic Box; with positions alone
    k_max : largest |k|; default 3π over the mean distance (V/n)^(1/3), beyond the first peak of a liquid
    width : of the shells; default π over the longest edge
    vectors : (m, 3) whole numbers a, b, c; each is then a shell of its own, in the order given
    """
    found = vectors_of(source, "positions", box=box)
    unit = 2 * np.pi / np.array(_lengths(found, "structure_factor"))
    if vectors is None:
        wanted, shell, shells = _shells(found, unit, k_max, width)
    else:
        wanted = np.asarray(vectors)
        if wanted.ndim != 2 or wanted.shape[1] != 3 or not len(wanted) or np.any(wanted != np.rint(wanted)):
            raise InputError(f"structure_factor: vectors: expected whole numbers of shape (m, 3), got {vectors}")
        wanted, shell, shells = wanted.astype(np.int64), np.arange(len(wanted)), len(wanted)
    each = np.bincount(shell, minlength=shells)
    k = np.bincount(shell, np.linalg.norm(wanted * unit, axis=1), shells) / each
    waves = _Waves.of(wanted, unit)
    rows = (np.bincount(shell, waves.intensity(x), shells) / each for x in found.each())
    s = mean_over_frames(len(found), rows)
    return StructureFactor(k, s.value, s.error, each, len(found))


def _lengths(found: Vectors, name: str) -> tuple[float, float, float]:
    lengths = found.box.cuboid(name)
    if lengths is None:
        raise InputError(f"{name}: needs a periodic box; an open system has no density")
    return lengths


def _in_plane(x: Floats) -> Floats:
    if np.any(x[:, 2] != x[0, 2]):
        raise InputError(
            "radial_distribution: needs a box periodic along all axes, or particles in one plane of a box open along z"
        )
    return x


def _members(found: Vectors, pair: tuple[str, str] | None) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """The particles of the two species; one and the same array where they are alike."""
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


def _shells(
    found: Vectors, unit: Floats, k_max: float | None, width: float | None
) -> tuple[NDArray[np.int64], NDArray[np.int64], int]:
    """Half of the vectors (m, 3) up to k_max, of each k and -k one; the shell of each; how many shells."""
    mean_distance = (found.box.volume / found.particles) ** (1 / 3)
    largest = REACH * 2 * math.pi / mean_distance if k_max is None else float(k_max)
    step = float(unit.min()) / 2 if width is None else float(width)
    if not (math.isfinite(largest) and largest >= unit.min()):
        raise InputError(f"structure_factor: k_max = {largest:g} is below the smallest wave vector, {unit.min():g}")
    if not (math.isfinite(step) and step > 0):
        raise InputError(f"structure_factor: width must be positive, got {step:g}")
    most = np.floor(largest / unit).astype(int)
    grid = np.stack(np.meshgrid(*(np.arange(-m, m + 1) for m in most), indexing="ij"), axis=-1).reshape(-1, 3)
    a, b, c = grid.T
    half = (a > 0) | ((a == 0) & ((b > 0) | ((b == 0) & (c > 0))))
    length = np.linalg.norm(grid * unit, axis=1)
    wanted = grid[half & (length <= largest)]
    # Shells begin half a width below the smallest vector; a hair keeps equal lengths in one shell.
    place = np.floor((np.linalg.norm(wanted * unit, axis=1) - unit.min()) / step + 0.5 + 1e-9).astype(np.int64)
    kept, shell = np.unique(place, return_inverse=True)
    return wanted, shell.ravel(), len(kept)


class _Waves(NamedTuple):
    """Wave vectors, sorted for ``intensity``: columns (p, 2) of a and b that share their values of c."""

    unit: Floats  # (3,)
    low: NDArray[np.int64]  # (3,) the smallest a, b, c, and the largest
    high: NDArray[np.int64]
    columns: NDArray[np.int64]
    column: NDArray[np.int64]  # (m,) of each vector, and its c, counted from the smallest
    depth: NDArray[np.int64]
    order: NDArray[np.int64]  # (m,) where each vector was asked for

    @classmethod
    def of(cls, wanted: NDArray[np.int64], unit: Floats) -> _Waves:
        columns, column = np.unique(wanted[:, :2], axis=0, return_inverse=True)
        column = column.ravel()
        order = np.argsort(column, kind="stable")
        low, high = wanted.min(axis=0), wanted.max(axis=0)
        return cls(unit, low, high, columns - low[:2], column[order], wanted[order, 2] - low[2], order)

    def intensity(self, x: Floats) -> Floats:
        """(m,) |sum over particles of exp(-i k·r)|² / n, in the order asked for.

        The factors of each axis are tabulated; sums over particles for all c at given a, b are one matrix product.
        """
        n = len(x)
        along = [
            np.exp(-1j * np.arange(self.low[axis], self.high[axis] + 1)[:, None] * (x[:, axis] * self.unit[axis]))
            for axis in range(3)
        ]
        result = np.empty(len(self.order))
        size = max(1, ROOM // n)
        for start in range(0, len(self.columns), size):
            a, b = self.columns[start : start + size].T
            sums = (along[0][a] * along[1][b]) @ along[2].T
            some = slice(*np.searchsorted(self.column, (start, start + len(a))))
            amplitude = sums[self.column[some] - start, self.depth[some]]
            result[self.order[some]] = (amplitude.real**2 + amplitude.imag**2) / n
        return result

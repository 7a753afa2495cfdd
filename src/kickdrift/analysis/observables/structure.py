"""Structure of particles around each other: the radial distribution function and the structure factor."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from kickdrift.analysis.observables.vectors import Boxes, Source, Vectors, vectors_of
from kickdrift.errors import InputError
from kickdrift.model.box.box import Box
from kickdrift.model.box.edges import shortest
from kickdrift.model.state import Floats
from kickdrift.statistics.blocks import mean_over_frames

REACH = 1.5  # default range in units of 2π over the mean distance (V/n)^(1/3), beyond a liquid's first peak
ROOM = 2**22  # most complex numbers of one product in memory
CLOSED = "needs a box periodic along all axes, or along x and y: a slab or a plane open along z"
PLANE = (True, True, False)  # axes of a box that is periodic in two dimensions


def reciprocal(box: Box) -> Floats:
    """Reciprocal vectors as rows, (3, 3). The product with the own edge vector is 2π, with the others 0. Rows of open
    axes are zero."""
    axes = np.array(box.periodic_axes)
    rows, found = np.where(axes[:, None], box.matrix, np.eye(3)), np.zeros((3, 3))
    for j in np.flatnonzero(axes):
        found[j, j] = 2 * np.pi / rows[j, j]
        for k in range(j + 1, 3):
            found[j, k] = -(rows[k, :k] @ found[j, :k]) / rows[k, k]
    return found


def in_shells(
    box: Box, units: Floats, particles: int, k_max: float | None, width: float | None
) -> tuple[NDArray[np.int64], NDArray[np.int64], int]:
    """One half of the vectors (m, 3) up to k_max, without -k for each k; the shell of each; and the number of
    shells."""
    axes = np.array(box.periodic_axes)
    room = float(np.prod(np.diag(box.matrix)[axes]))
    mean_distance = (room / particles) ** (1 / int(axes.sum()))
    smallest = float(np.linalg.norm(shortest(units[axes])[0]))
    largest = REACH * 2 * math.pi / mean_distance if k_max is None else float(k_max)
    step = smallest / 2 if width is None else float(width)
    if not (math.isfinite(largest) and largest >= smallest):
        raise InputError(f"structure_factor: k_max = {largest:g} is below the smallest wave vector, {smallest:g}")
    if not (math.isfinite(step) and step > 0):
        raise InputError(f"structure_factor: width must be positive, got {step:g}")
    # The number of a wave vector along an edge is their product over 2π.
    edges = np.linalg.norm(box.matrix, axis=1)
    most = [int(largest / (2 * np.pi / edge)) if there else 0 for edge, there in zip(edges, axes, strict=True)]
    grid = np.stack(np.meshgrid(*(np.arange(-m, m + 1) for m in most), indexing="ij"), axis=-1).reshape(-1, 3)
    a, b, c = grid.T
    half = (a > 0) | ((a == 0) & ((b > 0) | ((b == 0) & (c > 0))))
    wanted = grid[half & (np.linalg.norm(grid @ units, axis=1) <= largest)]
    # Shells begin half a width below the smallest vector. A small margin keeps equal lengths in one shell.
    place = np.floor((np.linalg.norm(wanted @ units, axis=1) - smallest) / step + 0.5 + 1e-9).astype(np.int64)
    kept, shell = np.unique(place, return_inverse=True)
    return wanted, shell.ravel(), len(kept)


class Waves(NamedTuple):
    """Wave vectors, sorted for ``amplitudes``: columns (p, 2) of a and b that share their values of c."""

    units: Floats  # (3, 3) reciprocal vectors as rows
    low: NDArray[np.int64]  # (3,) smallest a, b, c, and the largest
    high: NDArray[np.int64]
    columns: NDArray[np.int64]
    column: NDArray[np.int64]  # (m,) column of each vector, and its c, counted from the smallest
    depth: NDArray[np.int64]
    order: NDArray[np.int64]  # (m,) index of each vector in the caller's order

    @classmethod
    def of(cls, wanted: NDArray[np.int64], units: Floats) -> Waves:
        columns, column = np.unique(wanted[:, :2], axis=0, return_inverse=True)
        column = column.ravel()
        order = np.argsort(column, kind="stable")
        low, high = wanted.min(axis=0), wanted.max(axis=0)
        return cls(units, low, high, columns - low[:2], column[order], wanted[order, 2] - low[2], order)

    def amplitudes(self, x: Floats) -> NDArray[np.complex128]:
        """Sum over particles of exp(-i k·r) for each vector (m,), in the caller's order.

        The factors of each reciprocal vector are tabulated. For given a, b, one matrix product sums over particles for
        all c.
        """
        n, phases = len(x), np.ascontiguousarray((x @ self.units.T).T)
        along = [
            np.exp(-1j * np.arange(self.low[axis], self.high[axis] + 1)[:, None] * phases[axis]) for axis in range(3)
        ]
        result = np.empty(len(self.order), complex)
        size = max(1, ROOM // n)
        for start in range(0, len(self.columns), size):
            a, b = self.columns[start : start + size].T
            sums = (along[0][a] * along[1][b]) @ along[2].T
            some = slice(*np.searchsorted(self.column, (start, start + len(a))))
            result[self.order[some]] = sums[self.column[some] - start, self.depth[some]]
        return result

    def intensity(self, x: Floats, first: NDArray[np.int64], second: NDArray[np.int64]) -> Floats:
        """Real part of the first particles' amplitudes times the conjugate ones of the second, over the number of all
        particles, for each vector (m,); the particles of ``first`` are in ``second`` too if both are the same array."""
        a = self.amplitudes(x[first])
        b = a if second is first else self.amplitudes(x[second])
        return np.asarray((a.real * b.real + a.imag * b.imag) / len(x))


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
    box: Boxes = None,
    r_max: float | None = None,
    bins: int = 200,
    *,
    pair: tuple[str, str] | None = None,
    species: Sequence[str] | None = None,
) -> RadialDistribution:
    """Radial distribution function g(r) of particles in a periodic box, averaged over frames.

    g is the number of ordered pairs (i, j ≠ i) with r in a bin, divided by that of n(n-1) independent pairs spread
    evenly: n(n-1) (4π/3)(r₊³ - r₋³) / V; n_a n_b for two species. In two dimensions, with the box open along z and z
    equal for all, the shell is π(r₊² - r₋²) / A. So g is 1 on average for an ideal gas, whatever n is. In a slab, a box
    open along z, the independent pairs have the heights of the particles and are spread evenly along x and y alone: a
    pair dz apart in height has the part π(max(0, r₊² - dz²) - max(0, r₋² - dz²)) / A of the ring around it.
    Where a barostat changes the box, each frame counts with the volume of its own box.
    (Allen & Tildesley, Computer Simulation of Liquids, 2nd ed. 2017, section 8.2, eq. 8.15,
    doi:10.1093/oso/9780198803195.001.0001; there with n^2 for n(n-1).) The error comes from block averages over frames.

    Parameters
    ----------
    source : a run, open or by its path, or some of its frames, ``run[100::10]``; or positions (n, 3) or (frames, n, 3),
        wrapped or not
    box : three edge lengths, a periodic Box, or a list with a Box for each frame; with positions alone
    r_max : largest distance; default and upper limit half the least of the boxes' heights. The heights of a rectangular
        box are its edges
    bins : number of bins of equal width between 0 and r_max
    pair : two species: g of the second around the first; default all particles of any species
    species : (n,) names; with positions alone

    Raises
    ------
    InputError
        For an open box, an r_max beyond half the least height, or a species that is not there.
    """
    found = vectors_of(source, "positions", box=box, species=species)
    plane = found.box.periodic_axes == PLANE
    _check_periodic(found, "radial_distribution")
    if not (plane or all(found.box.periodic_axes)):
        raise InputError(f"radial_distribution: {CLOSED}")
    if bins < 1:
        raise InputError(f"radial_distribution: expected one bin or more, got {bins}")
    half = min(float(box.heights.min()) for box in each_of(found.boxes)) / 2
    r_max = half if r_max is None else float(r_max)
    if not 0 < r_max <= half:
        raise InputError(
            f"radial_distribution: r_max = {r_max:g} is not in (0, {half:g}], half the least height of the box"
        )
    first, second = _members(found, pair, "radial_distribution")
    unlike = first is not second
    ordered = len(first) * (len(second) if unlike else len(first) - 1)
    if ordered < 1:
        raise InputError(f"radial_distribution: expected two particles or more, n >= 2, got {len(first)}")
    chosen = np.concatenate([first, second]) if unlike else first
    kinds = (np.arange(len(chosen)) >= len(first)).astype(np.int64) if unlike else np.zeros(len(chosen), np.int64)
    edges = np.linspace(0.0, r_max, bins + 1)
    slab = plane and any(np.ptp(x[:, 2]) > 0 for x in found.each())
    shells = ordered * np.pi * np.diff(edges**2) if plane else ordered * 4 / 3 * np.pi * np.diff(edges**3)

    from kickdrift.analysis.observables.pair_counts import pair_counts

    frames = found.each() if plane else map(_in_space, found.each())
    twice = 1 if unlike else 2  # a pair of one kind counts from both ends
    total = np.zeros(bins, np.int64)

    def rows() -> Iterator[Floats]:
        for x, box in zip(frames, found.boxes, strict=True):
            counts = twice * pair_counts(x[chosen], box, kinds, unlike, r_max, bins)
            np.add(total, counts, out=total)
            spread = _in_slab(x[first, 2], x[second, 2], not unlike, edges) if slab else shells
            expected = spread / (box.area if plane else box.volume)
            yield np.divide(counts, expected, out=np.zeros(bins), where=expected > 0)

    g = mean_over_frames(len(found), rows())
    coordination = np.cumsum(total) / (len(found) * len(first))
    return RadialDistribution((edges[1:] + edges[:-1]) / 2, g.value, g.error, coordination, len(found))


def structure_factor(
    source: Source,
    box: Boxes = None,
    k_max: float | None = None,
    width: float | None = None,
    *,
    vectors: ArrayLike | None = None,
    pair: tuple[str, str] | None = None,
    species: Sequence[str] | None = None,
) -> StructureFactor:
    """Static structure factor S(k) = <|sum of exp(-i k·r)|²> / n on the wave vectors that fit a periodic box.

    With ``pair`` it is the partial one of species a and b, S_ab(k) = <real part of rho_a(k) rho_b(-k)> / n, where rho_a
    is the sum over particles of species a and n counts all particles (Hansen & McDonald, Theory of Simple Liquids,
    2013, section 4.1). S is the sum of S_ab over all ordered pairs of species.

    These are k = a a* + b b* + c c*, with whole a, b, c not all zero and the reciprocal vectors of the edges. In a
    rectangular box a* is 2π/Lx along x (Allen & Tildesley 2017, section 8.2, doi:10.1093/oso/9780198803195.001.0001).
    An average over shells takes all vectors up to ``k_max``. Along an open axis k is zero. S is 1 for an ideal gas, n
    at a Bragg peak of a perfect crystal. The error comes from block averages of a shell's or vector's values over
    frames. The cost of a frame grows as n times the number of vectors, so as n^2 at the default ``k_max``. Where a
    barostat changes the box, a, b, c stay and k is the mean over frames; the shells are those of the mean box.

    Parameters
    ----------
    source : a run, open or by its path, or some of its frames, ``run[100::10]``; or positions (n, 3) or (frames, n, 3),
        wrapped or not
    box : three edge lengths, a periodic Box, or a list with a Box for each frame; with positions alone
    k_max : largest |k|; default 3π over the mean distance (V/n)^(1/3), in a plane (A/n)^(1/2), beyond the first peak
        of a liquid
    width : width of the shells; default half the smallest |k|, π over the longest edge of a rectangular box
    vectors : (m, 3) whole numbers a, b, c; each is then a shell of its own, in the given order
    pair : two species; default all particles of any species
    species : the species of each particle, with positions alone
    """
    found = vectors_of(source, "positions", box=box, species=species)
    _check_periodic(found, "structure_factor")
    first, second = _members(found, pair, "structure_factor")
    mean = mean_box(found.boxes)
    units = reciprocal(mean)
    if vectors is None:
        wanted, shell, shells = in_shells(mean, units, found.particles, k_max, width)
    else:
        wanted = np.asarray(vectors)
        if wanted.ndim != 2 or wanted.shape[1] != 3 or not len(wanted) or np.any(wanted != np.rint(wanted)):
            raise InputError(f"structure_factor: vectors: expected whole numbers of shape (m, 3), got {vectors}")
        if wanted[:, ~units.any(axis=1)].any():
            along = found.box.described("")
            raise InputError(f"structure_factor: vectors: expected 0 along open axes; the box is {along}")
        wanted, shell, shells = wanted.astype(np.int64), np.arange(len(wanted)), len(wanted)
    each = np.bincount(shell, minlength=shells)
    waves = Waves.of(wanted, units)
    parts = {id(box): reciprocal(box) for box in each_of(found.boxes)}
    of_frames = [parts[id(box)] for box in found.boxes]
    if found.box_varies:
        k = np.mean([_lengths(wanted @ own, shell, each) for own in of_frames], axis=0)
    else:
        k = _lengths(wanted @ units, shell, each)
    shown = zip(found.each(), of_frames, strict=True)
    rows = (
        np.bincount(shell, waves._replace(units=own).intensity(x, first, second), shells) / each for x, own in shown
    )
    s = mean_over_frames(len(found), rows)
    return StructureFactor(k, s.value, s.error, each, len(found))


def _lengths(vectors: Floats, shell: NDArray[np.int64], each: NDArray[np.int64]) -> Floats:
    """Mean length of the vectors (m, 3) of each shell."""
    return np.bincount(shell, np.linalg.norm(vectors, axis=1), len(each)) / each


def each_of(boxes: Iterable[Box]) -> list[Box]:
    """The boxes without repeated objects."""
    return list({id(box): box for box in boxes}.values())


def mean_box(boxes: Sequence[Box]) -> Box:
    """The box whose edge vectors are the means of those of the boxes; the box itself if there is only one."""
    if len(each_of(boxes)) == 1:
        return boxes[0]
    return Box(matrix=np.mean([box.matrix for box in boxes], axis=0), periodic=boxes[0].periodic_axes)


def _check_periodic(found: Vectors, name: str) -> None:
    if not found.box.periodic:
        raise InputError(f"{name}: needs a periodic box; an open system has no density")


def _in_slab(first: Floats, second: Floats, alike: bool, edges: Floats) -> Floats:
    """Area of the rings (bins,) between spheres of the radii ``edges``, summed over ordered pairs of these heights."""
    ordered = np.sort(second)
    sums = np.concatenate([[0.0], np.cumsum(ordered)])
    squares = np.concatenate([[0.0], np.cumsum(ordered**2)])
    inside = np.empty(len(edges))
    for k, r in enumerate(edges):
        low, high = np.searchsorted(ordered, first - r), np.searchsorted(ordered, first + r, side="right")
        count, sum1, sum2 = high - low, sums[high] - sums[low], squares[high] - squares[low]
        inside[k] = (count * (r * r - first**2) + 2.0 * first * sum1 - sum2).sum()
        inside[k] -= len(first) * r * r if alike else 0.0  # a particle is no neighbour of its own
    return np.pi * np.diff(inside)


def _in_space(x: Floats) -> Floats:
    if len(x) > 2 and not np.ptp(x, axis=0).all():
        axis = "xyz"[int(np.argmin(np.ptp(x, axis=0)))]
        raise InputError(
            f"radial_distribution: all particles have the same {axis}, and spheres around them have no uniform "
            "density; run the layer with dimensions = 2 (z constant), or give a Box that is open along z"
        )
    return x


def _members(found: Vectors, pair: tuple[str, str] | None, name: str) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Particles of the two species; the same array twice if the species are equal."""
    if pair is None:
        every = np.arange(found.particles)
        return every, every
    if isinstance(pair, str) or len(pair) != 2:
        raise InputError(f"{name}: pair: expected two species, got {pair!r}")
    members = {name: np.flatnonzero(found.species == name) for name in pair}
    for each, those in members.items():
        if not those.size:
            known = ", ".join(sorted(set(found.species)))
            raise InputError(f"{name}: pair: no species {each!r}; known are {known}")
    return members[pair[0]], members[pair[1]]

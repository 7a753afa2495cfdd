"""The constraints of one System: which distances are kept, the molecules that they join, and the projection of states.

A state lies on the manifold of the constraints if each pair has its distance, and if the velocities do not change any.
A state beside the manifold is projected: along the gradients of the distances, weighted by the inverse masses. The
total momentum and the centre of mass of each molecule stay as they are.
"""

from functools import cached_property
from typing import Any, NamedTuple

import numpy as np

from kickdrift.errors import InputError
from kickdrift.model.box.box import Box
from kickdrift.model.checks.values import listed
from kickdrift.model.molecules.constraint import (
    ROUNDING,
    Constraint,
    Distances,
    Joined,
    check_particles,
    numbered,
)
from kickdrift.model.molecules.relatives import LONGEST, Ids, molecules_of, whole
from kickdrift.model.state import Floats
from kickdrift.text import counted

MOST = 10_000  # constraints in one molecule
SAME = 1e-9  # relative difference of two distances that are the same
ROUGHLY = 1e-12  # relative error of squared distances, and of velocities, that needs no projection
ITERATIONS = 60
FAR = 3.0  # largest distance at the start, in lengths of the constraint, that is projected
DEPENDENT = 1e-9  # pivot, relative to 1, below which a condition follows from the others


class Projected(NamedTuple):
    """How far a start was from the manifold."""

    moved: float  # largest displacement of a particle
    lost: float  # part of the kinetic energy that the projection of the velocities has taken


class Constraints:
    """Distances that a run keeps.

    Attributes
    ----------
    pairs : (c, 2) particles
    lengths : (c,) distances
    tolerance : see `Constraint`
    molecule : (n,) molecule of each particle, numbered from 0 in the order of the first particles; a particle without
        constraints is a molecule of its own
    start : how far the given start was from the manifold
    """

    def __init__(self, pairs: Ids, lengths: Floats, tolerance: float, particles: int) -> None:
        self.pairs, self.lengths, self.tolerance = pairs, lengths, tolerance
        self.molecule = molecules_of(pairs, particles)
        self.start = Projected(0.0, 0.0)

    def __len__(self) -> int:
        return len(self.pairs)

    def __str__(self) -> str:
        return f"{counted(len(self), 'rigid distance')} in {counted(len(self.sizes), 'molecule')}"

    @cached_property
    def sizes(self) -> Ids:
        """Number of constraints in each molecule that has any."""
        count = np.bincount(self.molecule[self.pairs[:, 0]])
        return np.asarray(count[count > 0])

    @cached_property
    def members(self) -> tuple[Ids, Ids]:
        """Particles of all molecules with constraints, molecule by molecule, and the place (molecules + 1,) where each
        begins."""
        with_any = np.unique(self.molecule[self.pairs[:, 0]])
        inside = np.flatnonzero(np.isin(self.molecule, with_any))
        inside = inside[np.argsort(self.molecule[inside], kind="stable")]
        begins = np.searchsorted(self.molecule[inside], with_any)
        return inside, np.append(begins, len(inside)).astype(np.int64)

    def tables(self) -> list[dict[str, Any]]:
        """Tables ``[[constraint]]`` of a system file, which make the same constraints."""
        one = bool(np.all(self.lengths == self.lengths[0]))
        distance = float(self.lengths[0]) if one else self.lengths.tolist()
        return [{"pairs": self.pairs.tolist(), "distance": distance, "tolerance": self.tolerance}]

    def errors(self, x: Floats) -> Floats:
        """Relative errors (c,) of the squared distances at positions x (3, n) of whole molecules, halved: about the
        relative error of each distance."""
        i, j = self.pairs.T
        square = ((x[:, i] - x[:, j]) ** 2).sum(axis=0)
        return np.asarray(0.5 * (square / self.lengths**2 - 1.0))

    def rates(self, x: Floats, v: Floats) -> Floats:
        """Relative speeds (c,) of the pairs along their separation, at x and v, both (3, n)."""
        i, j = self.pairs.T
        return np.asarray(((x[:, i] - x[:, j]) * (v[:, i] - v[:, j])).sum(axis=0) / self.lengths)

    def gradients(self, x: Floats) -> Any:
        """Sparse matrix (c, 3 n) of the gradients of half the squared distances, for coordinates in the order of x."""
        from scipy.sparse import csr_array

        (i, j), n = self.pairs.T, x.shape[1]
        apart, c = x[:, i] - x[:, j], len(self)
        rows = np.tile(np.arange(c), 6)
        columns = np.concatenate([i + n * axis for axis in range(3)] + [j + n * axis for axis in range(3)])
        return csr_array((np.concatenate([apart, -apart]).ravel(), (rows, columns)), shape=(c, 3 * n))

    def projected(self, masses: Floats, x: Floats, v: Floats) -> tuple[Floats, Floats, Projected]:
        """Positions and velocities (3, n) on the manifold, near x of whole molecules and v, and how far these were.

        What lies on the manifold to rounding stays as it is, to the last bit. Raises InputError for positions without
        such a place nearby."""
        from scipy.sparse import csr_array

        over = np.tile(1.0 / np.where(masses > 0, masses, 1.0), 3)
        inverse = csr_array((over, (np.arange(len(over)), np.arange(len(over)))))
        moved, lost, begun = 0.0, 0.0, x
        error = self.errors(x)
        stretch = np.sqrt(1.0 + 2.0 * error)
        if (far := np.flatnonzero(stretch > FAR)).size:
            i, j = self.pairs[far[0]].tolist()
            length = self.lengths[far[0]]
            raise InputError(
                f"constraint: particles {i} and {j} are {length * stretch[far[0]]:.6g} apart, and their constraint is "
                f"{length:.6g}; start nearer to that"
            )
        if np.abs(error).max() > ROUGHLY:
            for _ in range(ITERATIONS):
                error = self.errors(x)
                if np.abs(error).max() <= 4.0 * min(self.tolerance, ROUNDING):
                    break
                slopes = self.gradients(x)
                push = _solve(slopes @ inverse @ slopes.T, -error * self.lengths**2)
                step = (inverse @ (slopes.T @ push)).reshape(3, -1)
                x = x + step
                if np.abs(step).max() <= 1e-15 * np.abs(x).max():
                    break
            error = np.abs(self.errors(x))
            if not error.max() <= 1e-10:
                k = int(np.nanargmax(np.where(np.isnan(error), np.inf, error)))
                i, j = self.pairs[k].tolist()
                raise InputError(
                    f"constraint: particles {i} and {j} cannot be {self.lengths[k]:.6g} apart: the constraints of "
                    "their molecule contradict each other, or the start is too far from them"
                )
            moved = float(np.sqrt(((x - begun) ** 2).sum(axis=0)).max())
        speed = float(np.abs(v).max())
        if speed > 0 and np.abs(self.rates(x, v)).max() > ROUGHLY * speed:
            before = float(masses @ (v * v).sum(axis=0))
            slopes = self.gradients(x)
            push = _solve(slopes @ inverse @ slopes.T, -(slopes @ v.ravel()))
            v = v + (inverse @ (slopes.T @ push)).reshape(3, -1)
            lost = 1.0 - float(masses @ (v * v).sum(axis=0)) / before
        return x, v, Projected(moved, lost)

    def check(self, system: Joined) -> None:
        """Refuse constraints that no run of this System can keep."""
        masses, d = system.state.masses, system.dimensions
        if (light := np.flatnonzero(masses[self.pairs].min(axis=1) <= 0)).size:
            i = int(self.pairs[light[0]][np.argmin(masses[self.pairs[light[0]]])])
            raise InputError(
                f"constraint: {system.body(i)} has no mass, and a constraint moves particles by their masses"
            )
        named, height = system.box.narrowest
        if system.box.periodic and (long := np.flatnonzero(self.lengths >= LONGEST * height)).size:
            i, j = self.pairs[long[0]].tolist()
            raise InputError(
                f"constraint: particles {i} and {j} keep {self.lengths[long[0]]:.6g} apart; it must be under {LONGEST} "
                f"of the {named}, {LONGEST * height:.6g}, so that the nearest image is certain"
            )
        of, count = np.unique(self.molecule[self.pairs[:, 0]], return_counts=True)
        particles = np.bincount(self.molecule)[of]
        first = self.members[0][self.members[1][:-1]]
        if (large := np.flatnonzero(count > MOST)).size:
            raise InputError(
                f"constraint: the molecule of {system.body(int(first[large[0]]))} has {count[large[0]]:,} constraints; "
                f"the limit is {MOST:,}"
            )
        left = d * particles - (d + np.where(particles == 2, d - 1, d * (d - 1) // 2)) - count
        if (none := np.flatnonzero(left < 0)).size:
            k = none[0]
            raise InputError(
                f"constraint: the molecule of {system.body(int(first[k]))} has {count[k]} constraints, {-left[k]} more "
                f"than its {particles[k]} particles have internal motions"
            )

    def check_independent(self, masses: Floats, x: Floats) -> None:
        """Refuse a condition that follows from the others at positions x (3, n) on the manifold."""
        slopes = self.gradients(x)
        over = np.tile(1.0 / np.where(masses > 0, masses, 1.0), 3)
        squares = (slopes * slopes) @ over
        scaled = slopes * np.sqrt(over)[None, :] / np.sqrt(squares)[:, None]
        pivots = _pivots(scaled @ scaled.T)
        if (low := np.flatnonzero(pivots < DEPENDENT)).size:
            i, j = self.pairs[low[0]].tolist()
            raise InputError(
                f"constraint: the distance of particles {i} and {j} follows from the others of their molecule, so "
                "leave it out. A rigid molecule in a plane has at most three sites, one on a line two"
            )


def _solve(matrix: Any, right: Floats) -> Floats:
    from scipy.sparse.linalg import splu

    try:
        return np.asarray(splu(matrix.tocsc(), diag_pivot_thresh=0.0).solve(right))
    except RuntimeError:  # singular
        return np.full(len(right), np.nan)


def _pivots(matrix: Any) -> Floats:
    """Pivots of the elimination in the order of the rows; zero where it ends at a singular matrix."""
    from scipy.sparse.linalg import splu

    jittered = matrix.tocsc()
    jittered.setdiag(jittered.diagonal() * (1.0 + 1e-12))
    made = splu(jittered, permc_spec="NATURAL", diag_pivot_thresh=0.0, options={"SymmetricMode": True})
    return np.asarray(np.abs(made.U.diagonal()))


def constraints_of(system: Joined, given: Any) -> Constraints | None:
    """The constraints of a System from a list of `Constraint`, or from those of an earlier System; None for none."""
    if given is None:
        return None
    if isinstance(given, Constraints):
        check_particles(given.pairs, len(system.state))
        made = Constraints(given.pairs, given.lengths, given.tolerance, len(system.state))
        made.start = given.start
        return made
    wanted = "a list of kickdrift.Constraint"
    stated = [given] if isinstance(given, Constraint) else listed("constraints", given, wanted)
    if not stated:
        return None
    for each in stated:
        if not isinstance(each, Constraint):
            raise InputError(f"constraints: expected kickdrift.Constraint, got {type(each).__name__}")
    found = Distances(np.zeros((0, 2), np.int64), np.zeros(0))
    order = sorted(range(len(stated)), key=lambda k: stated[k].angles is not None)  # angles need the lengths of bonds
    for k in order:
        with numbered(k):
            more = stated[k].in_units(system.units).distances(system, found)
        found = Distances(np.concatenate([found.pairs, more.pairs]), np.concatenate([found.lengths, more.lengths]))
    ordered = np.sort(found.pairs, axis=1)
    _, first, inverse = np.unique(ordered, axis=0, return_index=True, return_inverse=True)
    earlier = first[inverse.reshape(-1)]
    differ = np.flatnonzero(np.abs(found.lengths - found.lengths[earlier]) > SAME * found.lengths)
    if differ.size:
        k = differ[0]
        i, j = ordered[k].tolist()
        raise InputError(
            f"constraint: particles {i} and {j} cannot be both {found.lengths[earlier[k]]:.6g} and "
            f"{found.lengths[k]:.6g} apart"
        )
    kept = np.sort(first)
    return Constraints(ordered[kept], found.lengths[kept], min(each.tolerance for each in stated), len(system.state))


def on_manifold(system: Joined, held: Constraints, masses: Floats, phase: Floats) -> tuple[Floats, Projected]:
    """Positions and velocities (2, 3, n) of whole molecules on the manifold, near a phase (2, 3, n)."""
    x = in_one_image(system.box, held.pairs, phase[0])
    x, v, projected = held.projected(masses, x, phase[1])
    return np.array([x, v]), projected


def in_one_image(box: Box, pairs: Ids, x: Floats) -> Floats:
    """Positions (3, n) with each molecule that pairs (c, 2) join in one image of the box: that of its first
    particle."""
    if not box.periodic:
        return x
    i, j = pairs.T
    steps = (x[:, j] - x[:, i]).T
    far = box.minimum_image(steps) - steps
    if not np.abs(far).max() > 1e-9 * np.abs(steps).max():
        return x
    places = whole(pairs, x.shape[1], lambda a, b: box.minimum_image((x[:, b] - x[:, a]).T)).T
    molecule = molecules_of(pairs, x.shape[1])
    first = np.unique(molecule, return_index=True)[1][molecule]
    count = np.round(box.fractional((x[:, first] + places - x).T))
    return np.asarray(x + box.cartesian(np.where(box.periodic_axes, count, 0.0)).T)

"""Simulation box: open, or periodic along any of the axes, with edges that may lean."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from kickdrift.errors import InputError
from kickdrift.model.box.edges import (
    Floats,
    Vector,
    axes_of,
    checked_rows,
    lower,
    neighbours,
    rows_of,
    shortest,
    turned,
    written,
)
from kickdrift.model.units.unit_systems import UnitSystem
from kickdrift.text import measured


class Oriented(NamedTuple):
    """A Box, and the rotation (3, 3) of vectors x (n, 3) into its axes: ``x @ rotation.T``."""

    box: Box
    rotation: Floats


@dataclass(frozen=True, init=False, repr=False)
class Box:
    """A box with its corner at the origin, periodic along some axes, or open space.

    Parameters
    ----------
    lengths : None (open space), three edge lengths (Lx, Ly, Lz), or a matrix. Two lengths, or a matrix (2, 2), make the
        box of a plane, which is open along z
    matrix : (3, 3), in place of lengths
        The rows are the edge vectors a = (ax, 0, 0), b = (bx, by, 0), c = (cx, cy, cz), the convention of GROMACS and
        LAMMPS, with ax, by, cz > 0 and tilts |bx| and |cx| up to ax / 2, |cy| up to by / 2.
    periodic : True, or three of True and False, default True along each axis
        The edge along an axis that is not periodic is perpendicular to the other edges. Its length bounds nothing and
        may be zero.

    Attributes
    ----------
    vectors : three edge vectors as tuples; None in open space
    periodic_axes : (x, y, z) whether the box is periodic along each

    Raises
    ------
    InputError
        For edges that are not positive and finite, and for vectors that are singular, left-handed, not lower triangular
        or lean too far; the message shows a matrix of the same box, if there is one.
    """

    vectors: tuple[Vector, Vector, Vector] | None
    periodic_axes: tuple[bool, bool, bool]

    def __init__(
        self,
        lengths: Sequence[float] | ArrayLike | None = None,
        matrix: ArrayLike | None = None,
        periodic: bool | Sequence[bool] = True,
    ) -> None:
        if lengths is not None and matrix is not None:
            raise InputError("box: expected lengths or a matrix, got both")
        given = lengths if matrix is None else matrix
        axes = axes_of(periodic)
        vectors = None
        if given is not None:
            rows, flat = rows_of(given, needs_matrix=matrix is not None)
            axes = (axes[0], axes[1], axes[2] and not flat)
            vectors = checked_rows(rows, axes)
        object.__setattr__(self, "vectors", vectors)
        object.__setattr__(self, "periodic_axes", axes if given is not None else (False, False, False))

    @classmethod
    def of(cls, given: Box | Sequence[float] | ArrayLike | None) -> Box:
        """Return the box that a user means by ``None``, three edge lengths, a matrix, or a Box."""
        return given if isinstance(given, Box) else cls(given)

    @classmethod
    def from_vectors(cls, vectors: ArrayLike, periodic: bool | Sequence[bool] = True) -> Oriented:
        """Return the Box with any right-handed edge vectors (3, 3), one a row, and the rotation into its axes.

        The rotation turns a onto the x axis and b into the x-y plane. Edges that lean too far are replaced by other
        edges of the same lattice. Use ``box, rotation = Box.from_vectors(v)`` and then ``x @ rotation.T`` for positions
        and velocities x (n, 3).
        """
        rows, flat = rows_of(vectors, needs_matrix=True)
        rows[2, 2] += flat  # any c serves for a plane
        rows, rotation = turned(rows)
        return Oriented(cls(matrix=lower(rows), periodic=periodic), rotation)

    def __repr__(self) -> str:
        of = "matrix" if self.triclinic else "lengths"
        along = f", periodic={self.periodic_axes}" if self.periodic and not all(self.periodic_axes) else ""
        return f"Box({of}={self.shape}{along})"

    def described(self, unit: str) -> str:
        """The box as text: "10 x 10 x 12 nm", "[[10, 0, 0], [5, 10, 0], [0, 0, 12]] nm", "open"."""
        if self.vectors is None:
            return "open"
        edges = np.diag(self.matrix)
        shape = written(self.matrix) if self.triclinic else " x ".join(f"{edge:.6g}" for edge in edges[edges > 0])
        edges_in = measured(shape, unit)
        return edges_in if all(self.periodic_axes) else f"{edges_in}, periodic along {self._along}"

    # --- shape ---

    @property
    def periodic(self) -> bool:
        """Whether the box is periodic along any axis."""
        return any(self.periodic_axes)

    @property
    def triclinic(self) -> bool:
        """Whether any edge leans."""
        if self.vectors is None:
            return False
        _, b, c = self.vectors
        return bool(b[0] or c[0] or c[1])

    @property
    def matrix(self) -> Floats:
        """Edge vectors as rows, shape (3, 3); zeros in open space."""
        return np.array(self.vectors) if self.vectors is not None else np.zeros((3, 3))

    @property
    def tilts(self) -> tuple[float, ...]:
        """(bx, cx, cy), how far the edges b and c lean along x and y; empty where no edge leans."""
        return tuple(self.matrix[[1, 2, 2], [0, 0, 1]].tolist()) if self.triclinic else ()

    @property
    def shape(self) -> Vector | tuple[Vector, Vector, Vector] | None:
        """Edge lengths, or edge vectors if they lean; None in open space."""
        return self.vectors if self.triclinic else self.lengths

    @property
    def lengths(self) -> Vector | None:
        """Edge lengths (Lx, Ly, Lz) of a box whose edges do not lean; None in open space. Raises InputError if edges
        lean, since three lengths do not define such a box."""
        if self.vectors is None:
            return None
        if self.triclinic:
            raise InputError(f"box: a leaning box has no three lengths: {written(self.matrix)}")
        a, b, c = self.vectors
        return a[0], b[1], c[2]

    def cuboid(self, what: str) -> Vector | None:
        """Return the lengths for a method ``what`` that needs a rectangular box, periodic along all axes or none.
        Raises an InputError that names ``what`` for any other box."""
        if self.vectors is None:
            return None
        if self.triclinic:
            raise InputError(f"{what}: cannot use a leaning box, with edges {written(self.matrix)}")
        if not all(self.periodic_axes):
            raise InputError(
                f"{what}: needs a box periodic along x, y and z; this box is periodic only along {self._along}"
            )
        return self.lengths

    @property
    def volume(self) -> float:
        """Volume ax by cz; infinite if the box is open along any axis."""
        return float(np.prod(np.diag(self.matrix))) if all(self.periodic_axes) else math.inf

    @property
    def area(self) -> float:
        """Area ax by in the x-y plane; infinite if the box is open along x or y."""
        return float(np.prod(np.diag(self.matrix)[:2])) if all(self.periodic_axes[:2]) else math.inf

    @property
    def heights(self) -> Floats:
        """Distances (3,) between opposite faces; infinite along axes that are not periodic.

        In a rectangular box these are the edge lengths. Every image of a particle is at least the least height away
        from the particle.
        """
        heights = 1.0 / np.linalg.norm(self._inverse, axis=0) if self.triclinic else np.diag(self.matrix)
        return np.where(self.periodic_axes, heights, math.inf)

    @property
    def narrowest(self) -> tuple[str, float]:
        """The name of the least of the heights, as messages have it, and its length."""
        return "smallest height of the box" if self.triclinic else "shortest box edge", float(self.heights.min())

    def check_cutoff(self, what: str, cutoff: float, units: UnitSystem | None = None) -> None:
        """Refuse a cutoff beyond half the least height, because a particle would meet two images of another particle.
        ``what`` begins the message, and ``units`` has the name of the unit of length."""
        of = "" if units is None or units.reduced else f" {units.length}"
        for axis, height in zip("xyz", self.heights, strict=True):
            if height < 2 * cutoff:
                edge = f"box edge {axis} is {height:.6g}{of}"
                between = f"the box is {height:.6g}{of} high between its faces across {'abc'['xyz'.index(axis)]}"
                raise InputError(
                    f"{what}: {between if self.triclinic else edge}, shorter than twice the cutoff, "
                    f"2 x {cutoff:.6g} = {2 * cutoff:.6g}{of}"
                )

    def with_edges(self, matrix: Floats) -> Box:
        """Return the box with the edge vectors of this matrix (3, 3) along its periodic axes."""
        rows = np.where(np.array(self.periodic_axes)[:, None], matrix, self.matrix)
        return Box(matrix=rows, periodic=self.periodic_axes)

    # --- coordinates and images ---

    def fractional(self, positions: Floats) -> Floats:
        """Coordinates (…, 3) in units of the edge vectors; along axes that are not periodic, lengths."""
        return np.asarray(positions) @ self._inverse

    def cartesian(self, fractions: Floats) -> Floats:
        """Positions (…, 3) at these fractional coordinates; the inverse of `fractional`."""
        return np.asarray(fractions) @ self._units

    def wrap(self, positions: Floats) -> Floats:
        """Positions (n, 3) moved by whole edge vectors to fractional coordinates in [0, 1); unchanged along open axes.

        In a leaning box, rounding may leave a position just outside.
        """
        moved = np.array(positions, dtype=float)
        rows, within = self.matrix, np.zeros(moved.shape)
        for k in self._last_first:
            edge = rows[k, k]
            lean = sum((within[..., m] * rows[m, k] for m in range(k + 1, 3) if rows[m, k]), start=0.0)
            count = np.floor((moved[..., k] - lean) / edge)
            for m in range(k + 1):
                if rows[k, m]:
                    moved[..., m] -= count * rows[k, m]
            over = moved[..., k] - lean >= edge  # rounding can put a position exactly on the edge
            for m in range(k):
                if rows[k, m]:
                    moved[..., m] -= over * rows[k, m]
            moved[..., k] = np.where(over, lean, moved[..., k])
            within[..., k] = (moved[..., k] - lean) / edge
        return moved

    def minimum_image(self, separations: Floats) -> Floats:
        """Separations (…, 3) between nearest images; unchanged in open space."""
        moved = np.array(separations, dtype=float)
        rows = self.matrix
        for k in self._last_first:
            count = np.round(moved[..., k] / rows[k, k])
            for m in range(k + 1):
                if rows[k, m]:
                    moved[..., m] -= count * rows[k, m]
        if self.triclinic:
            self._choose_nearest(moved)
        return moved

    def _choose_nearest(self, moved: Floats) -> None:
        """Replace separations (…, 3) in a leaning box by those between nearest images."""
        images = self.images
        far = ~(np.einsum("...k,...k->...", moved, moved) <= images.sure2)
        if not far.any():
            return
        begun = moved[far]
        begun = begun - np.rint(begun @ images.inverse) @ images.reduced
        best, least = begun.copy(), np.einsum("nk,nk->n", begun, begun)
        for step in images.neighbours:
            other = begun + step
            square = np.einsum("nk,nk->n", other, other)
            nearer = square < least
            best[nearer], least[nearer] = other[nearer], square[nearer]
        moved[far] = best

    @cached_property
    def images(self) -> Images:
        """Lattice vectors for the search of nearest images in a leaning box."""
        chosen = self.matrix[list(self.periodic_axes)]
        reduced = shortest(chosen)
        return Images(
            reduced,
            np.array(np.linalg.pinv(reduced), dtype=float),
            neighbours(reduced),
            0.25 * float(reduced[0] @ reduced[0]),
        )

    @property
    def _along(self) -> str:
        return " and ".join(axis for axis, there in zip("xyz", self.periodic_axes, strict=True) if there)

    @property
    def _last_first(self) -> list[int]:
        return [k for k in (2, 1, 0) if self.periodic_axes[k]]

    @property
    def _units(self) -> Floats:
        """Edge vectors as rows, shape (3, 3); unit vectors along axes that are not periodic."""
        return np.where(np.array(self.periodic_axes)[:, None], self.matrix, np.eye(3))

    @cached_property
    def _inverse(self) -> Floats:
        return np.array(np.linalg.inv(self._units), dtype=float)


class Images(NamedTuple):
    """Lattice vectors for the search of nearest images in a leaning box with m periodic axes."""

    reduced: Floats  # (m, 3) shortest edge vectors of the lattice
    inverse: Floats  # (3, m) pseudo-inverse of ``reduced``
    neighbours: Floats  # (3^m - 1, 3) sums of -1, 0 and 1 times each vector
    sure2: float  # square of a separation below which no image is nearer

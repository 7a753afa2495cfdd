"""The simulation box: open, or periodic along any of the axes, with edges that may lean."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from kickdrift.errors import InputError
from kickdrift.model.edges import Floats, Vector, axes_of, checked_rows, rows_of, turned, written
from kickdrift.model.reduction import lower, neighbours, shortest
from kickdrift.text import measured


class Oriented(NamedTuple):
    """A Box, and the rotation (3, 3) that turns vectors x (n, 3) into its axes: ``x @ rotation.T``."""

    box: Box
    rotation: Floats


@dataclass(frozen=True, init=False, repr=False)
class Box:
    """A box with its corner at the origin, periodic along some axes, or open space.

    Parameters
    ----------
    lengths : None (open space), three edge lengths (Lx, Ly, Lz), or a matrix
    matrix : (3, 3), in place of lengths
        The rows are the edge vectors a = (ax, 0, 0), b = (bx, by, 0), c = (cx, cy, cz), the convention of GROMACS and
        LAMMPS, with ax, by, cz > 0 and tilts |bx| and |cx| up to ax / 2, |cy| up to by / 2.
    periodic : True, or three of True and False, default True along each axis
        The edge along an axis that is not periodic stands at right angles to the others. Its length bounds nothing; it
        may be zero.

    Two lengths, or a matrix (2, 2), are a plane's: the box is open along z.

    Attributes
    ----------
    vectors : three edge vectors as tuples; None in open space
    periodic_axes : (x, y, z) whether it is periodic along each

    Raises
    ------
    InputError
        For edges that are not positive and finite, and for vectors that are singular, left-handed, not lower triangular
        or lean too far; the message has the matrix that does.
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
        """The box that a user meant: ``None``, three edge lengths, a matrix, or a Box as it is."""
        return given if isinstance(given, Box) else cls(given)

    @classmethod
    def from_vectors(cls, vectors: ArrayLike, periodic: bool | Sequence[bool] = True) -> Oriented:
        """The Box with any right-handed edge vectors (3, 3), one a row, and the rotation into its axes.

        The vectors are turned until a lies along x and b in the x-y plane. Edges that lean too far are replaced by
        others of the same lattice. ``box, rotation = Box.from_vectors(v)`` and then ``x @ rotation.T`` for positions
        and velocities x (n, 3).
        """
        rows, flat = rows_of(vectors, needs_matrix=True)
        rows[2, 2] += flat  # a plane's c is as good as any
        rows, rotation = turned(rows)
        return Oriented(cls(matrix=lower(rows), periodic=periodic), rotation)

    def __repr__(self) -> str:
        of = "matrix" if self.triclinic else "lengths"
        along = f", periodic={self.periodic_axes}" if self.periodic and not all(self.periodic_axes) else ""
        return f"Box({of}={self.shape}{along})"

    def described(self, unit: str) -> str:
        """The box in words: "10 x 10 x 12 nm", "[[10, 0, 0], [5, 10, 0], [0, 0, 12]] nm", "open"."""
        if self.vectors is None:
            return "open"
        edges = np.diag(self.matrix)
        shape = written(self.matrix) if self.triclinic else " x ".join(f"{edge:.6g}" for edge in edges[edges > 0])
        edges_in = measured(shape, unit)
        return edges_in if all(self.periodic_axes) else f"{edges_in}, periodic along {self._along}"

    # --- its shape ---

    @property
    def periodic(self) -> bool:
        """Whether it is periodic along any axis."""
        return any(self.periodic_axes)

    @property
    def triclinic(self) -> bool:
        """Whether any edge leans."""
        return self.vectors is not None and bool(np.tril(self.matrix, -1).any())

    @property
    def matrix(self) -> Floats:
        """(3, 3) the edge vectors as rows; zeros in open space."""
        return np.array(self.vectors) if self.vectors is not None else np.zeros((3, 3))

    @property
    def shape(self) -> Vector | tuple[Vector, Vector, Vector] | None:
        """The edge lengths, or the edge vectors where they lean; None in open space."""
        return self.vectors if self.triclinic else self.lengths

    @property
    def lengths(self) -> Vector | None:
        """The edge lengths (Lx, Ly, Lz) of a box whose edges do not lean; None in open space. An InputError where they
        lean: three lengths do not tell such a box from another."""
        if self.vectors is None:
            return None
        if self.triclinic:
            raise InputError(f"box: a leaning box has no three lengths: {written(self.matrix)}")
        a, b, c = self.vectors
        return a[0], b[1], c[2]

    def cuboid(self, what: str) -> Vector | None:
        """The lengths for ``what`` takes boxes at right angles alone, periodic along all axes or none. An InputError
        that names ``what`` for any other box."""
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
        """ax by cz, or infinity where the box is open along any axis."""
        return float(np.prod(np.diag(self.matrix))) if all(self.periodic_axes) else math.inf

    @property
    def area(self) -> float:
        """ax by, the area in the x-y plane, or infinity where the box is open along x or y."""
        return float(np.prod(np.diag(self.matrix)[:2])) if all(self.periodic_axes[:2]) else math.inf

    @property
    def heights(self) -> Floats:
        """(3,) distances between opposite faces; infinity along axes that are not periodic.

        An upright box has its edge lengths here. No image of a particle is nearer to it than the least height.
        """
        heights = 1.0 / np.linalg.norm(self._inverse, axis=0) if self.triclinic else np.diag(self.matrix)
        return np.where(self.periodic_axes, heights, math.inf)

    def check_cutoff(self, what: str, cutoff: float) -> None:
        """Refuse a cutoff beyond half the least height, where a particle would meet two images of another; ``what``
        begins the message."""
        for axis, height in zip("xyz", self.heights, strict=True):
            if height < 2 * cutoff:
                edge = f"box edge {axis} is {height:.6g}"
                between = f"the box is {height:.6g} high between its faces across {'abc'['xyz'.index(axis)]}"
                raise InputError(
                    f"{what}: {between if self.triclinic else edge}, shorter than twice the cutoff, "
                    f"2 x {cutoff:.6g} = {2 * cutoff:.6g}"
                )

    # --- coordinates and images ---

    def fractional(self, positions: Floats) -> Floats:
        """Coordinates (…, 3) in units of the edge vectors; lengths along axes that are not periodic."""
        return np.asarray(positions) @ self._inverse

    def cartesian(self, fractions: Floats) -> Floats:
        """Positions (…, 3) at these fractional coordinates; the inverse of `fractional`."""
        return np.asarray(fractions) @ self._units

    def wrap(self, positions: Floats) -> Floats:
        """Positions (n, 3) moved by whole edge vectors to fractional coordinates in [0, 1); unchanged along open axes.

        In a box that leans rounding may leave a position just outside.
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
            over = moved[..., k] - lean >= edge  # rounding can land exactly on the edge
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
        """Put the nearest images in place of separations (…, 3) in a box that leans."""
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
        """What finds the nearest image where edges lean."""
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
        """(3, 3) the edge vectors; unit vectors along axes that are not periodic."""
        return np.where(np.array(self.periodic_axes)[:, None], self.matrix, np.eye(3))

    @cached_property
    def _inverse(self) -> Floats:
        return np.array(np.linalg.inv(self._units), dtype=float)


class Images(NamedTuple):
    """What finds the nearest image in a box with m periodic axes whose edges lean."""

    reduced: Floats  # (m, 3) the shortest edge vectors of its lattice
    inverse: Floats  # (3, m) of these
    neighbours: Floats  # (3^m - 1, 3) sums of -1, 0 and 1 of each
    sure2: float  # a separation up to this square has no nearer image

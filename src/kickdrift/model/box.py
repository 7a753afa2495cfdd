"""The simulation box: open, or periodic and orthorhombic."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from kickdrift.errors import InputError
from kickdrift.model.checks import listed, number
from kickdrift.text import shown


@dataclass(frozen=True)
class Box:
    """Edge lengths (Lx, Ly, Lz) of a periodic box with its corner at the origin, or ``None`` for open space."""

    lengths: tuple[float, float, float] | None = None

    @classmethod
    def of(cls, lengths: Box | Sequence[float] | None) -> Box:
        """The box that a user meant: ``None``, three edge lengths, or a Box as it is."""
        return lengths if isinstance(lengths, Box) else cls(lengths)  # type: ignore[arg-type]

    def __post_init__(self) -> None:
        if self.lengths is None:
            return
        given = listed("box", self.lengths, "three edge lengths or None")
        if len(given) != 3:
            raise InputError(f"box: expected three edge lengths or None, got {len(given)}")
        x, y, z = edges = tuple(number(length) for length in given)
        for axis, length, value in zip("xyz", edges, given, strict=True):
            if not (np.isfinite(length) and length > 0):
                raise InputError(f"box: edge {axis} must be a positive finite length, got {shown(value)}")
        if not 0.0 < x * y * z < np.inf:
            raise InputError(f"box: edges of {x:g}, {y:g} and {z:g} have a volume that no number can hold")
        object.__setattr__(self, "lengths", edges)

    @property
    def periodic(self) -> bool:
        return self.lengths is not None

    @property
    def volume(self) -> float:
        """Lx Ly Lz, or infinity where the box is open."""
        return float(np.prod(self.lengths)) if self.lengths is not None else float("inf")

    def wrap(self, positions: NDArray[np.float64]) -> NDArray[np.float64]:
        """Positions (n, 3) moved by whole edges into [0, L); unchanged in open space."""
        if self.lengths is None:
            return positions.copy()
        edges = np.array(self.lengths)
        wrapped = positions - np.floor(positions / edges) * edges
        return np.where(wrapped >= edges, 0.0, wrapped)  # rounding can land exactly on the edge

    def minimum_image(self, separations: NDArray[np.float64]) -> NDArray[np.float64]:
        """Separations (…, 3) between nearest images; unchanged in open space."""
        if self.lengths is None:
            return separations.copy()
        edges = np.array(self.lengths)
        return separations - np.round(separations / edges) * edges

"""The simulation box: open, or periodic and orthorhombic."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from kickdrift.errors import InputError


@dataclass(frozen=True)
class Box:
    """Edge lengths (Lx, Ly, Lz) of a periodic box with its corner at the origin, or ``None`` for open space."""

    lengths: tuple[float, float, float] | None = None

    @classmethod
    def of(cls, lengths: Box | Sequence[float] | None) -> Box:
        """The box that a user meant: ``None``, three edge lengths, or a Box as it is."""
        if isinstance(lengths, Box):
            return lengths
        if lengths is None:
            return cls(None)
        values = tuple(float(length) for length in lengths)
        if len(values) != 3:
            raise InputError(f"box: expected three edge lengths or None, got {len(values)}")
        for axis, length in zip("xyz", values, strict=True):
            if not (np.isfinite(length) and length > 0):
                raise InputError(f"box: edge {axis} must be a positive finite length, got {length}")
        return cls(values)

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

"""State of the particles at one time."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from kickdrift.model.box.box import Box

Floats = NDArray[np.float64]


def read_only(array: NDArray) -> NDArray:
    array.flags.writeable = False
    return array


@dataclass(frozen=True)
class State:
    """Positions and velocities of n particles at one time.

    Attributes
    ----------
    phase : (2, 3, n) float64
        Positions ``phase[0]`` and velocities ``phase[1]``, one row per axis; positions are never wrapped.
    masses : (n,) float64
        In the unit of mass of the system's units.
    ids : (n,) int64
        Unique numbers of the particles, kept through every reordering.
    box : Box
    time : float
    steps_done : int
        Steps begun since the start. At a look inside an adaptive step, that step counts.
    spins : (3, n) float64, optional
        Angular velocities of bodies whose spins evolve, see ``TidesSpin``; None for other bodies.
    unknowns : (k,) float64, optional
        Unknowns beside the bodies, see ``Beside``; None without any.
    """

    phase: Floats
    masses: Floats
    ids: NDArray[np.int64]
    box: Box = field(default_factory=Box)
    time: float = 0.0
    steps_done: int = 0
    spins: Floats | None = None
    unknowns: Floats | None = None

    def __len__(self) -> int:
        return self.phase.shape[2]

    @property
    def positions(self) -> Floats:
        """Unwrapped positions, shape (n, 3); a read-only copy."""
        return read_only(np.array(self.phase[0].T, order="C"))

    @property
    def velocities(self) -> Floats:
        """Velocities, shape (n, 3); a read-only copy."""
        return read_only(np.array(self.phase[1].T, order="C"))

    def wrapped(self) -> Floats:
        """Positions inside the box, shape (n, 3); a read-only copy."""
        return read_only(self.box.wrap(self.positions))

    def copy(self) -> State:
        """Return a State that shares no memory with this one."""
        beside = (None if each is None else each.copy() for each in (self.spins, self.unknowns))
        copied = self.phase.copy(), self.masses.copy(), self.ids.copy()
        return State(*copied, self.box, self.time, self.steps_done, *beside)

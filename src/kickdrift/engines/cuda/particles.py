"""Particles on the device, in the order of its lists."""

from __future__ import annotations

from typing import Any

import numpy as np
from numba import cuda

from kickdrift.engines.cuda.launches import Launches, zeros
from kickdrift.engines.cuda.motion import MARKS, copy, put_in_order
from kickdrift.model.state import Floats


class Rows:
    """One copy of a state.

    Attributes
    ----------
    x, v, a : (3, n) positions, velocities and accelerations
    ids : (n,) place of each particle in the caller's order
    weights : (n,) inverse masses, or G m
    """

    def __init__(self, phase: Floats, weights: Floats) -> None:
        self.n = phase.shape[2]
        self.x, self.v = (cuda.to_device(np.ascontiguousarray(rows)) for rows in phase)
        self.a = zeros((3, self.n), float)
        self.ids = cuda.to_device(np.arange(self.n, dtype=np.int32))
        self.weights = cuda.to_device(np.ascontiguousarray(weights))

    @property
    def arrays(self) -> tuple[Any, ...]:
        return self.x, self.v, self.a, self.ids, self.weights


class Particles(Rows):
    """The state, with a spare copy.

    Attributes
    ----------
    at : (3, n) positions at the last list
    placed : positions in the form that the forces read
    marks : see `motion`
    spare : the state at the begin of a block of steps
    """

    def __init__(self, launches: Launches, phase: Floats, weights: Floats) -> None:
        super().__init__(phase, weights)
        self.launches, self.spare = launches, Rows(phase, weights)
        self.at: Any = self.x
        self.placed: Any = self.x
        self.marks = zeros(MARKS, float)

    def keep(self) -> None:
        """Write the state to the spare copy."""
        self.launches.over(self.n, copy, *self.arrays, *self.spare.arrays)

    def settle(self) -> None:
        """Take the state from the spare copy."""
        self.launches.over(self.n, copy, *self.spare.arrays, *self.arrays)

    def phase(self) -> Floats:
        """Copy of positions and velocities (2, 3, n), in the caller's order."""
        return np.array([self.in_order(self.x), self.in_order(self.v)])

    def in_order(self, rows: Any) -> Floats:
        """Copy of rows (m, n) in the caller's order."""
        ordered = cuda.device_array(rows.shape, np.float64)
        self.launches.over(self.n, put_in_order, self.ids, rows, ordered)
        return np.array(self.launches.read(ordered))

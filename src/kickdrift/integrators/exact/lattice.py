"""State of leapfrog-exact: positions and momenta as whole numbers."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

Integers = NDArray[np.int64]


class Lattice(NamedTuple):
    """Positions and momenta as whole numbers. ``np.savez(path, **lattice._asdict())`` saves them, and
    ``Lattice(**np.load(path))`` loads them.

    Attributes
    ----------
    positions : (3, n) int64
        In steps of ``spacing``; in a periodic box the nearest image, so that the box is 2^64 steps long.
    images : (3, n) int64
        Whole box edges to add; zero in open space.
    momenta : (3, n) int64
        In steps of ``momentum``: of mass times velocity under pair forces alone, of velocity with gravity.
    spacing : (3,) lengths
    momentum : (n,) one step: equal for all, in the system's coherent mass unit times its velocity unit; or a step of
        velocity, finer for heavy particles
    time, steps_done
    """

    positions: Integers
    images: Integers
    momenta: Integers
    spacing: NDArray[np.float64]
    momentum: NDArray[np.float64]
    time: float = 0.0
    steps_done: int = 0

    def reversed(self) -> Lattice:
        """The same with all momenta negated: from here a run retraces its path."""
        return self._replace(momenta=-self.momenta)

    def same(self, other: Lattice) -> bool:
        """Tell whether positions, images and momenta are equal to the last bit."""
        return all(np.array_equal(getattr(self, key), getattr(other, key)) for key in self._fields[:5])

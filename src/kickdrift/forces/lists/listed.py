"""Common base of the forces on a list of neighbours."""

from __future__ import annotations

from typing import ClassVar


class ListedForce:
    """A force with a cutoff, whose particles find each other through a list of neighbours.

    ``bind(system, threads, mixed)`` returns a `pairs.kernel.PairKernel`."""

    name: ClassVar[str]
    thermal: ClassVar[bool] = True  # particles act on each other, so that samples have a temperature

"""A box whose edges change during a run."""

from __future__ import annotations

from copy import copy
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from kickdrift.errors import InputError
from kickdrift.model.box.box import Box
from kickdrift.model.state import Floats

if TYPE_CHECKING:
    from kickdrift.model.system import System

ALIKE = 1e-9  # relative difference of two boxes of one shape


class LiveBox:
    """A box with its edge lengths in memory that compiled code reads and writes.

    A leaning box keeps its shape: its edge vectors are those of a box with lengths 1, times the lengths.

    Attributes
    ----------
    lengths : (3,) lengths ax, by and cz now, which are the edges of a box that does not lean; zero along axes that are
        not periodic
    """

    def __init__(self, box: Box) -> None:
        self._start = box
        self._axes = np.array(box.periodic_axes)
        self.lengths: Floats = np.where(self._axes, np.diag(box.matrix), 0.0)
        self._shape = box.matrix / np.where(self._axes, self.lengths, 1.0)
        self._per_height: Floats = self.lengths / box.heights

    def lengths_of_height(self, height: float) -> Floats:
        """Lengths (3,) at which the box is this high between its faces across each axis."""
        return height * self._per_height

    @property
    def box(self) -> Box:
        """The Box with the lengths of now."""
        return self._start.with_edges(self._shape * self.lengths)

    @box.setter
    def box(self, box: Box) -> None:
        lengths = np.where(self._axes, np.diag(box.matrix), 0.0)
        if box.periodic_axes != tuple(self._axes.tolist()) or not np.allclose(
            box.matrix[self._axes], (self._shape * lengths)[self._axes], rtol=ALIKE, atol=ALIKE * lengths.max()
        ):
            raise InputError(
                f"state: the box is {box.shape}, but a run with a barostat has a box like {self.box.shape}"
            )
        self.lengths[:] = lengths

    @property
    def volume(self) -> float:
        """Product of the lengths along periodic axes: a volume, or an area in two dimensions."""
        return float(np.prod(self.lengths[self._axes]))


def in_box(system: System, box: Box) -> System:
    """Return the system in another box, with the same positions."""
    other = copy(system)
    object.__setattr__(other, "state", replace(system.state, box=box))
    return other

"""A box whose edges change during a run."""

from __future__ import annotations

from copy import copy
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from kickdrift.errors import InputError
from kickdrift.model.box.box import Box
from kickdrift.model.box.cell import LENGTHS, lengths_and_tilts
from kickdrift.model.box.edges import lower
from kickdrift.model.state import Floats

if TYPE_CHECKING:
    from kickdrift.model.system import System

ALIKE = 1e-9  # relative difference of two boxes of one shape


class LiveBox:
    """A box with its edge lengths in memory that compiled code reads and writes.

    A leaning box keeps its shape: its edge vectors are those of a box with lengths 1, times the lengths. Unless it is
    ``free`` to change its shape: then its tilts are in memory too.

    Attributes
    ----------
    lengths : (3,) lengths ax, by and cz now, which are the edges of a box that does not lean; zero along axes that are
        not periodic. Of a free box (6,): also the tilts cy, cx and bx
    """

    def __init__(self, box: Box, free: bool = False) -> None:
        self._start = box
        self._axes = np.array(box.periodic_axes)
        self.free = free
        self.lengths: Floats = self._numbers(box)
        lengths = self.lengths[:LENGTHS]
        self._shape = box.matrix / np.where(self._axes, lengths, 1.0)
        self._per_height: Floats = lengths / box.heights

    def lengths_of_height(self, height: float) -> Floats:
        """Lengths (3,) at which the box is this high between its faces across each axis."""
        return height * self._per_height

    @property
    def box(self) -> Box:
        """The Box with the edges of now. Rounding may leave a tilt just beyond half an edge."""
        if self.free:
            rows = np.diag(self.lengths[:LENGTHS])
            rows[[2, 2, 1], [1, 0, 0]] = self.lengths[LENGTHS:]
            return self._start.with_edges(lower(rows))
        return self._start.with_edges(self._shape * self.lengths)

    @box.setter
    def box(self, box: Box) -> None:
        lengths = self._numbers(box)
        if box.periodic_axes != tuple(self._axes.tolist()) or not (
            self.free
            or np.allclose(
                box.matrix[self._axes], (self._shape * lengths)[self._axes], rtol=ALIKE, atol=ALIKE * lengths.max()
            )
        ):
            raise InputError(
                f"state: the box is {box.shape}, but a run with a barostat has a box like {self.box.shape}"
            )
        self.lengths[:] = lengths

    @property
    def volume(self) -> float:
        """Product of the lengths along periodic axes: a volume, or an area in two dimensions."""
        return float(np.prod(self.lengths[:LENGTHS][self._axes]))

    def _numbers(self, box: Box) -> Floats:
        """The numbers of a box that are in memory."""
        rows = np.where(self._axes[:, None], box.matrix, 0.0)
        return lengths_and_tilts(rows)[: None if self.free else LENGTHS]


def in_box(system: System, box: Box) -> System:
    """Return the system in another box, with the same positions."""
    other = copy(system)
    object.__setattr__(other, "state", replace(system.state, box=box))
    return other

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


class LiveBox:
    """A rectangular box with its edge lengths in memory that compiled code reads and writes.

    Attributes
    ----------
    lengths : (3,) edge lengths now; zero along axes that are not periodic
    """

    def __init__(self, box: Box) -> None:
        self._axes = np.array(box.periodic_axes)
        self._open = np.where(self._axes, 0.0, np.diag(box.matrix))  # edges that bound nothing
        self.lengths: Floats = np.where(self._axes, np.diag(box.matrix), 0.0)

    @property
    def box(self) -> Box:
        """The Box with the lengths of now."""
        return Box((self.lengths + self._open).tolist(), periodic=self._axes.tolist())

    @box.setter
    def box(self, box: Box) -> None:
        if box.tilts or box.periodic_axes != tuple(self._axes.tolist()):
            raise InputError(
                f"state: the box is {box.shape}, but a run with a barostat has a box like {self.box.shape}"
            )
        self.lengths[:] = np.where(self._axes, np.diag(box.matrix), 0.0)

    @property
    def volume(self) -> float:
        """Product of the edge lengths along periodic axes: a volume, or an area in two dimensions."""
        return float(np.prod(self.lengths[self._axes]))


def in_box(system: System, box: Box) -> System:
    """Return the system in another box, with the same positions."""
    other = copy(system)
    object.__setattr__(other, "state", replace(system.state, box=box))
    return other

"""Components of the pressure in samples of a run whose box changes its shape."""

from __future__ import annotations

import numpy as np

from kickdrift.model.freedom import apart_of, whole_motion
from kickdrift.model.state import Floats
from kickdrift.model.system import System

TENSOR = "pressure_tensor"  # name of the column
NAMES = ("xx", "yy", "zz", "yz", "xz", "xy")  # of the components, in their order


def components(system: System, y: Floats, virial: float, along: Floats, volume: float, drags: bool) -> Floats:
    """Return the components (6,) of the pressure tensor of particles at y (2, 3, n) in a box of this volume.

    ``virial`` is the whole virial, and ``along`` (rows, 2, 3) its parts along and across the axes without tail
    corrections, which are the same along all axes. ``drags`` tells whether the bath changes the total momentum."""
    masses, v, axes = system.coherent_masses, y[1], system.dimensions
    if (moved := whole_motion(masses, y[0], v, apart_of(system, drags))) is not None:
        v = v - moved
    heat = (masses * v) @ v.T
    found = along.sum(axis=0).ravel() + heat[[0, 1, 2, 1, 0, 0], [0, 1, 2, 2, 2, 1]]
    found[:axes] += (virial - along[:, 0].sum()) / axes
    return np.asarray(found / volume)

"""Components of the pressure in samples of a run whose box changes its shape."""

from __future__ import annotations

import numpy as np

from kickdrift.model.freedom import apart_of, whole_motion
from kickdrift.model.state import Floats
from kickdrift.model.system import System

TENSOR = "pressure_tensor"  # name of the column
NAMES = ("xx", "yy", "zz", "yz", "xz", "xy")  # of the components, in their order
PLACES = ([0, 1, 2, 1, 0, 0], [0, 1, 2, 2, 2, 1])  # rows and columns of these in a matrix


def components(
    system: System, y: Floats, virial: float, along: Floats, a: Floats, volume: float, drags: bool
) -> Floats:
    """Return the components (6,) of the pressure tensor of particles at y (2, 3, n) in a box of this volume.

    ``virial`` is the whole virial, and ``along`` (rows, 2, 3) its parts along and across the axes without tail
    corrections, which are the same along all axes. ``drags`` tells whether the bath changes the total momentum.
    Molecules with constraints have the pressure of their centres, as ``virial`` has it; see `looks.centres`. This takes
    the accelerations ``a`` (3, n)."""
    masses, v, axes = system.coherent_masses, y[1], system.dimensions
    if (moved := whole_motion(masses, y[0], v, apart_of(system, drags))) is not None:
        v = v - moved
    heat = (masses * v) @ v.T
    within = _within(system, y, a)
    found = along.sum(axis=0).ravel() + (heat - within)[PLACES]
    found[:axes] += (virial + np.trace(within) - along[:, 0].sum()) / axes
    return np.asarray(found / volume)


def _within(system: System, y: Floats, a: Floats) -> Floats:
    """Sums (3, 3) within molecules with constraints of m (v - V) (v - V) and of m (x - X) a, made symmetric."""
    held = system.constraints
    if held is None:
        return np.zeros((3, 3))
    members, begins = held.members
    m = system.coherent_masses[members]
    total, count = np.add.reduceat(m, begins[:-1]), np.diff(begins)
    x, v = y[:, :, members]
    x, v = (values - np.repeat(np.add.reduceat(m * values, begins[:-1], axis=1) / total, count, 1) for values in (x, v))
    arms = (m * x) @ a[:, members].T
    return np.asarray((m * v) @ v.T + 0.5 * (arms + arms.T))

"""Warning of a system in three dimensions whose particles all lie and move in one plane."""

from __future__ import annotations

from typing import Any

import numpy as np

from kickdrift.forces.listed import ListedForce
from kickdrift.model.state import Floats
from kickdrift.model.system import System


def layer_warning(system: Any, phase: Floats) -> str:
    """Return the warning for positions and velocities (2, 3, n); "" if they fill three dimensions.

    Pair forces keep such particles in their plane. The temperature then counts velocities that are always zero."""
    if not isinstance(system, System) or system.dimensions == 2 or len(system) < 3:
        return ""
    if not any(isinstance(force, ListedForce) for force in system.forces):
        return ""
    x, v = phase
    flat = np.flatnonzero((np.ptp(x, axis=1) == 0.0) & ~v.any(axis=1))
    if not flat.size:
        return ""
    axis = "xyz"[flat[0]]
    remedy = "give dimensions = 2" if axis == "z" else "let z be the constant coordinate and give dimensions = 2"
    return (
        f"all particles have {axis} = {x[flat[0], 0]:g} and never leave this plane, but temperature and pressure "
        f"count three dimensions; {remedy}"
    )

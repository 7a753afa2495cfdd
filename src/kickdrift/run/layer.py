"""Warnings of a System before its run: all particles in one plane, and forces without a pressure."""

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


def pressure_warning(system: Any) -> str:
    """Return the warning that samples have no pressure, and why; "" if they have one, and in open space."""
    if not isinstance(system, System):
        return ""
    reasons = [force.no_pressure(system) for force in system.forces if hasattr(force, "no_pressure")]
    reasons = [reason for reason in reasons if reason]
    return f"pressure is left out: {'; '.join(reasons)}" if reasons else ""

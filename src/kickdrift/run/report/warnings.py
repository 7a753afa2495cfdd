"""Warnings of a System at the start and the end of its run, beside those about its energy."""

from __future__ import annotations

from typing import Any

import numpy as np

from kickdrift.forces.pairs.law import PairForce
from kickdrift.forces.seam.group import ListedForce
from kickdrift.looks.doubts import digits_doubt
from kickdrift.model.body_checks import doubtful_forces
from kickdrift.model.state import Floats
from kickdrift.model.system import System
from kickdrift.text import choices, suggestion


def layer_warning(system: Any, phase: Any) -> str:
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


def begins_badly(system: Any, phase: Floats) -> list[str]:
    """Return the warnings at the start of a run, at positions and velocities (2, 3, n)."""
    if not isinstance(system, System):
        return []
    x, v = phase[:, :, : len(system)]  # spins, if there are any, follow
    found = [layer_warning(system, (x, v)), pressure_warning(system), digits_doubt(system, x)]
    return [*filter(None, found), *doubtful_forces(system), *unused_warnings(system)]


def ends_badly(system: Any, state: Any) -> list[str]:
    """Return the warnings of positions at the end of a run; a Batch keeps no state."""
    if not isinstance(system, System) or state is None or len(state) != len(system):
        return []
    x, topology = state.phase[0], system.topology
    paired = topology is not None and any(isinstance(force, PairForce) for force in system.forces)
    far = topology.far_special(state.box, x) if topology is not None and paired else ""
    return [digits_doubt(system, x), far]


def unused_warnings(system: Any) -> list[str]:
    """Return warnings of what a System gives and nothing uses: parameters of species that no particle has, and factors
    without a pair force."""
    if not isinstance(system, System):
        return []
    found, pairs = [], [force for force in system.forces if isinstance(force, PairForce)]
    for force in pairs:
        named = [*(force.species or ()), *(name for pair in force.pairs or () for name in pair)]
        if strange := [name for name in dict.fromkeys(named) if name not in system.species]:
            near = suggestion(strange[0], system.species) if len(strange) == 1 else ""
            found.append(f"{force.name}: no particle is of species {choices(map(repr, strange))}{near}")
    topology = system.topology
    if topology is not None and not pairs and system.forces and len(topology.scaled.pairs):
        acting = " and ".join(dict.fromkeys(force.name for force in system.forces))
        found.append(f"topology: factors and exclusions have no effect: they are about pair forces, and not {acting}")
    return found

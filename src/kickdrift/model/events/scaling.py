"""Constants of collisions in a system's units: the material of fragments, and the speed in the restitution of ice."""

from __future__ import annotations

from functools import lru_cache
from typing import Any

import numpy as np

from kickdrift.errors import InputError
from kickdrift.model.events.collision import BRIDGES, Collision
from kickdrift.model.subject import Bodies
from kickdrift.model.units.quantities import quantity
from kickdrift.model.units.unit_systems import UnitSystem

WATER = "1000 kg/m^3"  # rho_1 of Leinhardt & Stewart 2012
SLOW = "1 cm/s"  # unit of speed of Bridges, Hatzes & Lin 1984


def check_action(event: Collision, system: Bodies, gravity: Any) -> None:
    """Raise InputError if the system lacks what the event's action needs. ``gravity`` is the force that
    binds bodies, or None."""
    if event.restitution == BRIDGES and system.units.reduced:
        raise InputError(f"{event.kind}: restitution {BRIDGES!r} needs units with metres; {system.units.name} has none")
    if event.action != "fragment":
        return
    material_of(event, system, gravity)
    bare = np.flatnonzero((event.radii_in(system) == 0) & (system.state.masses > 0))
    if bare.size:
        raise InputError(
            f"{event.kind}: radii: action 'fragment' needs a radius for every body with mass, and "
            f"{system.body(int(bare[0]))} has none"
        )


def material_of(event: Collision, system: Bodies, gravity: Any) -> tuple[float, float, float, float]:
    """c*, mu-bar, rho_1 and G in the system's units."""
    if gravity is None:
        raise InputError(f"{event.kind}: action 'fragment' needs gravity, but {system.name!r} has none")
    density = event.reference_density
    if density is None:
        if system.units.reduced:
            raise InputError(
                f"{event.kind}: reference_density: required in {system.units.name} units: {WATER} in the system's units"
            )
        density = quantity(WATER, "density", system.units)
    G = system.units.gravity if gravity.G is None else gravity.G
    return event.c_star, event.mu_bar, float(density), float(G)  # type: ignore[arg-type]


def restitution_of(event: Collision, system: Bodies, speed: float) -> float:
    """Restitution at a normal speed."""
    if speed < event.elastic_below:
        return 1.0
    if event.restitution != BRIDGES:
        return float(event.restitution)
    if not speed > 0:
        return 1.0
    return min(1.0, 0.32 * (speed / _slow(system.units)) ** -0.234)


@lru_cache
def _slow(units: UnitSystem) -> float:
    return quantity(SLOW, "velocity", units)

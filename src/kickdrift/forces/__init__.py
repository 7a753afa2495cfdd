"""The registry of forces, by the name that system files use. Reading it compiles nothing."""

from __future__ import annotations

from typing import Any

from kickdrift.forces.fields import DrivenField, HarmonicTrap, LinearDrag, Springs, UniformField
from kickdrift.forces.gravity import Gravity
from kickdrift.forces.lennard_jones import LennardJones

_ALL: tuple[Any, ...] = (LennardJones, Gravity, Springs, HarmonicTrap, UniformField, DrivenField, LinearDrag)
FORCES: dict[str, Any] = {force.name: force for force in _ALL}

__all__ = [
    "FORCES",
    "DrivenField",
    "Gravity",
    "HarmonicTrap",
    "LennardJones",
    "LinearDrag",
    "Springs",
    "UniformField",
]

"""Systems whose bodies' spins are part of the state: which force turns them, and the other forces beside them.

y of such a System has 2 n columns. The first n are the bodies. The others hold the spins as velocities, and the angles
of rotation as positions. Only the force that turns the spins sees all columns.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np

from kickdrift.errors import InputError
from kickdrift.forces.around.tides_spin import TidesSpin
from kickdrift.forces.lists.listed import ListedForce
from kickdrift.model.state import Floats

SPINS = "spins"  # column of a run's file


def spinning(system: Any) -> Any | None:
    """The force that turns the spins of a System's bodies; None if spins are no part of the state."""
    found = [force for force in getattr(system, "forces", ()) if isinstance(force, TidesSpin)]
    if len(found) > 1:
        raise InputError("tides-spin: a system takes one force of this kind; give the values of all bodies in it")
    return found[0] if found else None


def first_spins(system: Any) -> tuple[Floats, Floats]:
    """Spins (3, n) at the start, and moments of inertia (n,)."""
    p = spinning(system).bound_law(system)  # type: ignore[union-attr]
    return np.array(p.spin), np.array(p.inertia)


def with_spins(system: Any, spins: Floats) -> Any:
    """The system with these spins (n, 3) at the start."""
    given = tuple(map(tuple, spins.tolist()))
    return system.under(replace(each, spin=given) if each.name == TidesSpin.name else each for each in system.forces)


class Beside:
    """A force of a System with spins: on the bodies alone, unless the force turns the spins."""

    def __init__(self, force: Any, system: Any) -> None:
        if isinstance(force, ListedForce):
            raise InputError(f"force {force.name!r}: does not go with tides-spin, which takes gravity and fields")
        self.force, self.system, self.name = force, system, force.name

    def bind(self, system: Any, threads: int = 1) -> Any:
        """Return the parts: a NamedTuple with a compiled body."""
        from kickdrift.forces.around.spins_kernel import BesideSpins

        if self.force.name == TidesSpin.name:
            return self.force.bind(self.system, threads)
        n = len(self.system)
        return BesideSpins(self.force.bind(self.system, threads), np.zeros((2, 3, n)), np.zeros((3, n)))


class UnderSpins:
    """The forces of a System with spins, for its bodies and their spins. See ``BoundForces``."""

    def __init__(self, system: Any) -> None:
        self.name = system.name
        self.forces = tuple(Beside(force, system) for force in system.forces)

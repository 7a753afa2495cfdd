"""Forces with their first-order variations: deviation vectors ride along as further particles.

A *varied* System has 2 n particles: the n of the System, then their deviations, massless, whose accelerations are those
of the variational equations, a' = (da/dx) dx + (da/dv) dv. Any integrator of y' = f(t, y) moves both at once, and its
step for the deviations is the derivative of its step for the particles.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, ClassVar

import numpy as np

from kickdrift.errors import InputError
from kickdrift.forces.gravity import Gravity
from kickdrift.forces.pair_law import PairForce
from kickdrift.forces.tree import GravityTree

if TYPE_CHECKING:
    from kickdrift.model.state import Floats
    from kickdrift.model.system import System


class Varied:
    """A force of a System, for its particles and their deviations.

    That of gravity is analytic; other forces' are central differences along the deviation, with an error of some 1e-10
    of the force. Pair forces on a neighbour list and gravity by a tree are refused.
    """

    may_overlap: ClassVar[bool] = True  # a deviation is no place

    def __init__(self, force: Any, system: System) -> None:
        if isinstance(force, (PairForce, GravityTree)):  # what a list or a tree sums changes in jumps
            raise InputError(f"force {force.name!r}: has no variational equations; gravity and fields have them")
        self.force, self.system, self.name = force, system, force.name
        for trait in ("external", "works", "velocity_dependent"):
            setattr(self, trait, getattr(force, trait, False))

    def check(self, system: System) -> None:
        """Refuse nothing: the System itself was checked."""

    def bind(self, system: System, threads: int = 1) -> Any:
        """The parts: a NamedTuple with a compiled body."""
        from kickdrift.forces.variations_kernel import bind

        return bind(self.force, self.system, threads, analytic=isinstance(self.force, Gravity))


def varied(system: System, deviations: Floats) -> System:
    """The System with its deviations (2, 3, n), of positions and velocities, as further particles."""
    from kickdrift.model.starts.builders import check_overlaps
    from kickdrift.model.system import System

    check_overlaps(system)
    x, v = np.concatenate([system.state.phase, deviations], axis=2)
    masses = np.concatenate([system.state.masses, np.zeros(len(system))])
    names = [system.body(i) for i in range(len(system))]
    names += [f"the deviation of {name}" for name in names]
    return System(
        x.T, v.T, masses, system.box, [Varied(force, system) for force in system.forces], system.units,
        name=system.name, run=system.run, names=names,
    )  # fmt: skip

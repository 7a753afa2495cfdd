"""Forces with their first-order variations: deviation vectors move as additional particles.

A *varied* System has 2 n particles: the n particles of the System, then n massless deviations. The accelerations of the
deviations follow the variational equations, a' = (da/dx) dx + (da/dv) dv. Any integrator of y' = f(t, y) moves both;
its step for the deviations is the derivative of its step for the particles.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, ClassVar

import numpy as np

from kickdrift.errors import InputError
from kickdrift.forces.external_calculator import CalculatorForce
from kickdrift.forces.gravity import Gravity
from kickdrift.forces.listed import ListedForce
from kickdrift.forces.tree import GravityTree

if TYPE_CHECKING:
    from kickdrift.model.state import Floats
    from kickdrift.model.system import System


class Varied:
    """A force of a System, for its particles and their deviations.

    Gravity has an analytic variation. Other forces use central differences along the deviation, with a relative error
    of some 1e-10. Pair forces on a neighbour list and gravity by a tree are refused.
    """

    may_overlap: ClassVar[bool] = True  # a deviation is not a position

    def __init__(self, force: Any, system: System) -> None:
        if isinstance(force, (ListedForce, GravityTree)):  # their lists and trees make the sums jump
            raise InputError(f"force {force.name!r}: has no variational equations; gravity and fields have them")
        if isinstance(force, CalculatorForce):  # its memory does so too, and rounding may be that of float32
            raise InputError(f"force {force.name!r}: has no variational equations; gravity, fields and functions do")
        self.force, self.system, self.name = force, system, force.name
        for trait in ("external", "works", "velocity_dependent"):
            setattr(self, trait, getattr(force, trait, False))

    def check(self, system: System) -> None:
        """Accept every System, since it has already been checked."""

    def bind(self, system: System, threads: int = 1) -> Any:
        """Return the parts: a NamedTuple with a compiled body."""
        from kickdrift.forces.variations_kernel import bind

        return bind(self.force, self.system, threads, analytic=isinstance(self.force, Gravity))


def varied(system: System, deviations: Floats) -> System:
    """Return the System with deviations (2, 3, n) of positions and velocities as additional particles."""
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

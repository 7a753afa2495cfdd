"""Leapfrog on whole numbers: a run can be reversed and returns to exactly the same bits."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from kickdrift.errors import InputError
from kickdrift.integrators.method import OWN_FORCES, Method
from kickdrift.integrators.option import Option

if TYPE_CHECKING:
    from kickdrift.integrators.flow import Flow
    from kickdrift.integrators.options import Options
    from kickdrift.integrators.stepping import Stepper

Integers = NDArray[np.int64]


class Lattice(NamedTuple):
    """Positions and momenta as whole numbers. ``np.savez(path, **lattice._asdict())`` saves them, and
    ``Lattice(**np.load(path))`` loads them.

    Attributes
    ----------
    positions : (3, n) int64
        In steps of ``spacing``; in a periodic box the nearest image, so that the box is 2^64 steps long.
    images : (3, n) int64
        Whole box edges to add; zero in open space.
    momenta : (3, n) int64
        In steps of ``momentum``: of mass times velocity under pair forces alone, of velocity with gravity.
    spacing : (3,) lengths
    momentum : (n,) one step: equal for all, in the system's coherent mass unit times its velocity unit; or a step of
        velocity, finer for heavy particles
    time, steps_done
    """

    positions: Integers
    images: Integers
    momenta: Integers
    spacing: NDArray[np.float64]
    momentum: NDArray[np.float64]
    time: float = 0.0
    steps_done: int = 0

    def reversed(self) -> Lattice:
        """The same with all momenta negated: from here a run retraces its path."""
        return self._replace(momenta=-self.momenta)

    def same(self, other: Lattice) -> bool:
        """Tell whether positions, images and momenta are equal to the last bit."""
        return all(np.array_equal(getattr(self, key), getattr(other, key)) for key in self._fields[:5])


@dataclass(frozen=True)
class Exact(Method):
    """Kick, drift, kick on int64. Every increment is a float rounded to a whole number of steps, and whole numbers add
    exactly and in any order.

    A kick depends only on positions and a drift only on momenta, and both change sign with the momenta. So a run with
    negated momenta undoes every step bit by bit. Before rounding the method is velocity Verlet, symplectic of order 2.
    The rounded map is a permutation of the lattice, as volume conservation demands. It differs from a symplectic map by
    less than float64 rounding.
    """

    name: str
    order: int
    source: str
    use: str = ""

    family = "whole numbers"
    symplectic = True
    reversible = True
    separable = True
    particles_only = True
    float64_because = OWN_FORCES

    @property
    def evaluations(self) -> int:
        return 1

    @property
    def declared(self) -> tuple[Option, ...]:
        return ()

    def stepper(self, flow: Flow, options: Options) -> Stepper:
        from kickdrift.forces.gravity import Gravity
        from kickdrift.forces.pair_law import PairForce
        from kickdrift.model.system import System

        system: Any = flow.subject
        if not isinstance(system, System):
            raise InputError(f"{self.name}: needs particles under pair forces or gravity; {flow.name!r} is an ODE")
        for force in system.forces:
            if not isinstance(force, (PairForce, Gravity)):
                raise InputError(f"{self.name}: takes only pair forces and gravity; force {force.name!r} is neither")
        from kickdrift.integrators.exact_stepper import ExactStepper

        return ExactStepper(flow, options)


ROWS = (
    Exact(
        "leapfrog-exact", 2,
        "Levesque & Verlet 1993, J. Stat. Phys. 72, 519, doi:10.1007/BF01048022; Rein & Tamayo 2018, "
        "doi:10.1093/mnras/stx2479",
        "runs that must come back bit by bit",
    ),
)  # fmt: skip

"""Leapfrog on whole numbers: a run can be turned around and comes back to the very same bits."""

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
    """Positions and momenta as whole numbers; ``np.savez(path, **lattice._asdict())`` keeps them, and
    ``Lattice(**np.load(path))`` has them back.

    Attributes
    ----------
    positions : (3, n) int64
        In steps of ``spacing``; in a periodic box the nearest image, so that the box is 2^64 steps long.
    images : (3, n) int64
        Whole box edges to add; zero in open space.
    momenta : (3, n) int64
        In steps of ``momentum``; of mass times velocity under pair forces alone, of velocity where there is gravity.
    spacing : (3,) lengths
    momentum : (n,) one step, the same for all, in the system's mass unit (made coherent) times its velocity unit; or
        of velocity, finer for the heavy
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
        """The same with all momenta turned around: from here a run goes back the way it came."""
        return self._replace(momenta=-self.momenta)

    def same(self, other: Lattice) -> bool:
        """Whether positions, images and momenta are equal to the last bit."""
        return all(np.array_equal(getattr(self, key), getattr(other, key)) for key in self._fields[:5])


@dataclass(frozen=True)
class Exact(Method):
    """Kick, drift, kick on int64: every increment is a float rounded to a whole number of steps, and whole numbers add
    without error and in any order.

    A kick depends on positions alone and a drift on momenta alone, and both turn their sign with the momenta, so a run
    with the momenta negated undoes every step bit by bit. Before rounding it is velocity Verlet, symplectic of order 2;
    the rounded map is a permutation of the lattice, as volume conservation demands, and differs from a symplectic map
    by less than float64 rounding does.
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
            raise InputError(f"{self.name}: moves particles under pair forces and gravity, and {flow.name!r} is an ODE")
        for force in system.forces:
            if not isinstance(force, (PairForce, Gravity)):
                raise InputError(
                    f"{self.name}: adds pair forces and gravity as whole numbers, and force {force.name!r} is neither"
                )
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

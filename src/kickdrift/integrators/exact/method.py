"""Leapfrog on whole numbers: a run can be reversed and returns to exactly the same bits."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from kickdrift.errors import InputError
from kickdrift.integrators.method import OWN_FORCES, Method

if TYPE_CHECKING:
    from kickdrift.integrators.flows.flow import Flow
    from kickdrift.integrators.options import Options
    from kickdrift.integrators.stepping.stepper import Stepper


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
    moves_all_because = "sums its own forces in whole numbers"
    symplectic = True
    reversible = True
    separable = True
    particles_only = True
    float64_because = OWN_FORCES
    evaluations = 1
    moves = "particles under pair forces or gravity"
    declared = ()

    def stepper(self, flow: Flow, options: Options) -> Stepper:
        from kickdrift.forces.gravity.direct import Gravity
        from kickdrift.forces.pairs.law import PairForce
        from kickdrift.forces.pairs.tabulated import Tabulated

        system = self.system_of(flow)
        for force in system.forces:
            if not isinstance(force, (PairForce, Gravity)):
                raise InputError(f"{self.name}: takes only pair forces and gravity; force {force.name!r} is neither")
            if isinstance(force, Tabulated):
                raise InputError(
                    f"{self.name}: takes only pair forces and gravity with a formula; force {force.name!r} is a table"
                )
        if system.topology is not None and len(system.topology.scaled.pairs):
            i, j = system.topology.scaled.pairs[0].tolist()
            raise InputError(
                f"{self.name}: sums all pairs alike, and the topology leaves out or scales pairs, "
                f"as particles {i} and {j}"
            )
        from kickdrift.integrators.exact.stepper import ExactStepper

        return ExactStepper(flow, options)


ROWS = (
    Exact(
        "leapfrog-exact", 2,
        "Levesque & Verlet 1993, J. Stat. Phys. 72, 519, doi:10.1007/BF01048022; Rein & Tamayo 2018, "
        "doi:10.1093/mnras/stx2479",
        "runs that must come back bit by bit",
    ),
)  # fmt: skip
